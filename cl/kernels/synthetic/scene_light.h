// Light of the synthetic scene, display-linear, and what a camera makes of it.
#include "common/inlined.h"

// Where the two lamps hang and how strong they are (display-linear units).
__constant float LAMPS[8] = {1.6f, -1.9f, 4.6f, 0.56f, -2.1f, 1.4f, 4.3f, 0.36f};
#define LAMP_RADIUS 0.32f

// Light from both lamps and the room's own brightness; `open` dims the latter.
INLINED float lighting(float3 p, float3 n, float open)
{
    // Bounced light comes from all sides, more from above.
    float light = open * (0.58f + 0.22f * n.z);
    for (int i = 0; i < 2; ++i) {
        const float3 to = (float3)(LAMPS[4 * i], LAMPS[4 * i + 1], LAMPS[4 * i + 2]) - p;
        const float d2 = dot(to, to);
        const float facing = dot(n, to) * rsqrt(d2);
        light += LAMPS[4 * i + 3] * fmax(facing, 0.0f) * 26.0f / (d2 + 8.0f);
    }
    return light;
}

// Linear light to grey levels 0..255, with a soft shoulder.
INLINED float3 display(float3 linear)
{
    const float3 c = linear / (1.0f + 0.18f * linear);
    return 255.0f * sqrt(clamp(c, 0.0f, 1.0f));
}
