// Camera projection, the counterpart of psfs/cameras/camera.py (in OpenGL: camera.glsl). A camera is
// CAMERA_FLOATS floats:
//   0-8 R (row-major)  9-11 t  12-16 fx fy cx cy skew  17-21 k1 k2 p1 p2 k3
//   22 largest squared normalised radius  23-24 width height  25-27 centre in the world
//   28 Tsai's kappa, in the place of 17-21  29 whether 17-20 are k1 k2 k3 k4 of a fisheye lens
#include "common/pack.h"

// Distorted over undistorted radius of Tsai's lens: the root of stretch s^3 + s - 1, by Newton's
// method; stretch is kappa times the squared undistorted radius.
static inline vfloat tsai_share(vfloat stretch)
{
    vfloat s = 1.0f / (1.0f + stretch);
#pragma unroll
    for (int step = 0; step < 5; ++step)
        s = (2.0f * stretch * s * s * s + 1.0f) / (3.0f * stretch * s * s + 1.0f);
    return s;
}

// Project a pack of world points (x, y, z): pixels in *px and *py, returns the depth, which is <= 0
// when the point has no image (behind the camera, or beyond the radius where the distortion turns
// back). Selections instead of branches, and operators instead of fmin, rint and the like, which
// PoCL does not inline: so loops around it become vector code (occupancy: 330 ms -> 60 ms).
static inline vfloat camera_project_pack(__global const float *camera, vfloat x, vfloat y, vfloat z,
                                         vfloat *px, vfloat *py)
{
    const vfloat cx = camera[0] * x + camera[1] * y + camera[2] * z + camera[9];
    const vfloat cy = camera[3] * x + camera[4] * y + camera[5] * z + camera[10];
    const vfloat cz = camera[6] * x + camera[7] * y + camera[8] * z + camera[11];
    const vfloat inverse = 1.0f / cz;
    const vfloat u = cx * inverse, v = cy * inverse;
#ifdef NO_DISTORTION // set by callers whose cameras have none
    const vfloat xd = u, yd = v;
    const vint seen = cz > 1e-6f;
#else
    const vfloat r2 = u * u + v * v;
    const vint seen = (cz > 1e-6f) & (r2 < camera[22]);
    const float k1 = camera[17], k2 = camera[18], p1 = camera[19], p2 = camera[20];
    const vfloat radial = 1.0f + r2 * (k1 + r2 * (k2 + r2 * camera[21]));
    vfloat xd = u * radial + 2.0f * p1 * u * v + p2 * (r2 + 2.0f * u * u);
    vfloat yd = v * radial + p1 * (r2 + 2.0f * v * v) + 2.0f * p2 * u * v;
#if TSAI // set by callers with such cameras: other occupancies would take three times as long
    if (camera[28] != 0.0f) {
        const vfloat share = tsai_share(camera[28] * r2);
        xd = u * share;
        yd = v * share;
    }
#endif
#if FISHEYE // the same
    if (camera[29] != 0.0f) {
        const vfloat r = sqrt(r2), angle = atan(r), a2 = angle * angle;
        const vfloat bent = 1.0f + a2 * (k1 + a2 * (k2 + a2 * (p1 + a2 * p2)));
        const vfloat share = angle * bent / (r + 1e-12f);
        xd = u * share;
        yd = v * share;
    }
#endif
#endif
    // Before the selection: what reads memory inside of it stays a branch (occupancy: three times).
    const vfloat image_x = camera[12] * xd + camera[16] * yd + camera[14];
    const vfloat image_y = camera[13] * yd + camera[15];
    *px = seen ? image_x : -1e6f;
    *py = seen ? image_y : -1e6f;
    return seen ? cz : (cz < 0.0f ? cz : 0.0f);
}

#if PACK == 1
// The same for a single point.
static inline float camera_project(__global const float *camera, float x, float y, float z,
                                   float2 *pixel)
{
    float px, py;
    const float depth = camera_project_pack(camera, x, y, z, &px, &py);
    *pixel = (float2)(px, py);
    return depth;
}
#endif

// Offset y * width + x of the integer pixel nearest to `pixel` in an image whose rows are `width`
// pixels apart, or -1 if it lies outside the camera's image.
static inline int camera_offset(__global const float *camera, float2 pixel, int width)
{
    const float x = pixel.x + 0.5f, y = pixel.y + 0.5f;
    const int inside = (x >= 0.0f) & (y >= 0.0f) & (x < camera[23]) & (y < camera[24]);
    return inside ? (int)y * width + (int)x : -1;
}
