// Tapered cones in the world, the counterpart of apf/body/cones.py and psfs/common/cones.py. A posed cone is
// CONE_FLOATS floats: A (3), radius at A, B (3), radius at B, X / sx (3), 0, Y / sy (3), 0, where
// A, B are the end centres and X, Y the unit axes of the elliptic section.

// Corners A + s, A - s, B - s, B + s of the trapezoid that the cone shows to `eye`
// (Kwolek & Rymut 2016, section 3).
static inline void cone_corners(float16 cone, float3 eye, float3 corners[4])
{
    const float3 a = cone.s012, b = cone.s456, x = cone.s89a, y = cone.scde;
    float ex = dot(eye - a, x), ey = dot(eye - a, y);
    const float norm = sqrt(ex * ex + ey * ey);
    ex = norm > 1e-9f ? ex / norm : 0.0f;
    ey = norm > 1e-9f ? ey / norm : 1.0f;
    const float3 side = -ey / dot(x, x) * x + ex / dot(y, y) * y;
    corners[0] = a + cone.s3 * side;
    corners[1] = a - cone.s3 * side;
    corners[2] = b - cone.s7 * side;
    corners[3] = b + cone.s7 * side;
}

// Signed distance from `point` to the cone's surface, negative inside; the ends are rounded.
static inline float cone_distance(float16 cone, float3 point)
{
    const float3 a = cone.s012, axis = cone.s456 - a, offset = point - a;
    const float along = dot(offset, axis) / dot(axis, axis), t = clamp(along, 0.0f, 1.0f);
    const float u = dot(offset, cone.s89a), v = dot(offset, cone.scde), beyond = along - t;
    return sqrt(u * u + v * v + beyond * beyond * dot(axis, axis)) -
           (cone.s3 + t * (cone.s7 - cone.s3));
}
