// From counted pixels to the errors 1 - f, Rymut 2016 eq. (4.41)-(4.50); counterpart of
// cl/kernels/image/objective.cl. KIND is one of 0 WS, 1 SP, 2 AoWS, 3 AoSP, 4 PoSP.
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Counts { int counts[]; };     // (V, N, 4)
layout(std430, binding = 1) readonly buffer Areas { int areas[]; };       // (V,)
layout(std430, binding = 2) writeonly buffer Errors { float errors[]; };  // (N,)
uniform int n_particles, n_views;
uniform vec3 weights;  // balance, w1, w2

float ratio(float part, float whole) { return whole > 0.0 ? part / whole : 0.0; }
float power(float x, float w) { return w == 0.0 ? 1.0 : x > 0.0 ? pow(x, w) : 0.0; }

float joined(float f1, float f2)
{
#if KIND == 0 || KIND == 2
    return weights.y * f1 + weights.z * f2;
#else
    return power(f1, weights.y) * power(f2, weights.z);
#endif
}

void main()
{
    const int particle = int(gl_GlobalInvocationID.x);
    if (particle >= n_particles) return;
    const int together = KIND < 2 ? n_views : 1, n_parts = n_views / together;
    float f = KIND == 4 ? 1.0 : 0.0;
    for (int i = 0; i < n_parts; ++i) {
        float edge = 0.0, near_edge = 0.0, image = 0.0, model = 0.0, overlap = 0.0;
        for (int v = i; v < i + together; ++v) {
            const int at = 4 * (v * n_particles + particle);
            edge += counts[at];
            near_edge += counts[at + 1] / 255.0;
            image += areas[v];
            model += counts[at + 2];
            overlap += counts[at + 3];
        }
        const float f1 =
            weights.x * ratio(overlap, image) + (1.0 - weights.x) * ratio(overlap, model);
        const float value = joined(f1, ratio(near_edge, edge));
#if KIND == 4
        f *= value;
#else
        f += value / n_parts;
#endif
    }
    errors[particle] = 1.0 - f;
}
