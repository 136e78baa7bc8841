// Camera projection, the counterpart of psfs/camera.py. A camera is CAMERA_FLOATS floats:
//   0-8 R (row-major)  9-11 t  12-16 fx fy cx cy skew  17-21 k1 k2 p1 p2 k3
//   22 largest squared normalised radius  23-24 width height  25-27 centre in the world
#define CAMERA_FLOATS 32

// Project world point (x, y, z): pixel in *pixel, returns the depth, which is <= 0 when the point
// has no image (behind the camera, or beyond the radius where the distortion turns back).
inline float camera_project(__global const float *camera, float x, float y, float z,
                            float2 *pixel)
{
    const float cx = camera[0] * x + camera[1] * y + camera[2] * z + camera[9];
    const float cy = camera[3] * x + camera[4] * y + camera[5] * z + camera[10];
    const float cz = camera[6] * x + camera[7] * y + camera[8] * z + camera[11];
    *pixel = (float2)(-1e6f, -1e6f);
    if (cz <= 1e-6f) return fmin(cz, 0.0f);
    const float u = cx / cz, v = cy / cz;
    const float r2 = u * u + v * v;
    if (r2 >= camera[22]) return 0.0f;
    const float k1 = camera[17], k2 = camera[18], p1 = camera[19], p2 = camera[20];
    const float radial = 1.0f + r2 * (k1 + r2 * (k2 + r2 * camera[21]));
    const float xd = u * radial + 2.0f * p1 * u * v + p2 * (r2 + 2.0f * u * u);
    const float yd = v * radial + p1 * (r2 + 2.0f * v * v) + 2.0f * p2 * u * v;
    *pixel = (float2)(camera[12] * xd + camera[16] * yd + camera[14],
                      camera[13] * yd + camera[15]);
    return cz;
}

// The integer pixel nearest to `pixel`, or (-1, -1) if it lies outside the camera's image.
inline int2 camera_pixel(__global const float *camera, float2 pixel)
{
    const int2 nearest = convert_int2_rte(clamp(pixel, -2.0f, 1e6f));
    const bool inside = nearest.x >= 0 && nearest.y >= 0 && nearest.x < (int)camera[23] &&
                        nearest.y < (int)camera[24];
    return inside ? nearest : (int2)(-1, -1);
}
