// Tapered cones in the world, the counterpart of apf/body/cones.py. A posed cone is
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
