// Tapered cones in the world, the counterpart of apf/reference/cones.py. A posed cone is
// CONE_FLOATS floats: A (3), radius at A, B (3), radius at B, X / sx (3), 0, Y / sy (3), 0, where
// A, B are the end centres and X, Y the unit axes of the elliptic section.
#define CONE_FLOATS 16

// Corners A + s, A - s, B - s, B + s of the trapezoid that the cone shows to `eye`
// (Kwolek & Rymut 2016, section 3).
inline void cone_corners(__global const float *cone, float3 eye, float3 corners[4])
{
    const float3 a = vload3(0, cone), b = vload3(0, cone + 4);
    const float3 x = vload3(0, cone + 8), y = vload3(0, cone + 12);
    float ex = dot(eye - a, x), ey = dot(eye - a, y);
    const float norm = sqrt(ex * ex + ey * ey);
    ex = norm > 1e-9f ? ex / norm : 0.0f;
    ey = norm > 1e-9f ? ey / norm : 1.0f;
    const float3 side = -ey / dot(x, x) * x + ex / dot(y, y) * y;
    corners[0] = a + cone[3] * side;
    corners[1] = a - cone[3] * side;
    corners[2] = b - cone[7] * side;
    corners[3] = b + cone[7] * side;
}

// Signed distance from `point` to the cone's surface, negative inside; the ends are rounded.
// A macro, because OpenCL C 1.2 has no pointers to any address space; uses `point` once.
#define CONE_DISTANCE(cone, point) \
    cone_distance(vload3(0, cone), (cone)[3], vload3(0, (cone) + 4), (cone)[7], \
                  vload3(0, (cone) + 8), vload3(0, (cone) + 12), point)

inline float cone_distance(float3 a, float radius_a, float3 b, float radius_b, float3 x, float3 y,
                           float3 point)
{
    const float3 axis = b - a, offset = point - a;
    const float length2 = dot(axis, axis);
    const float along = dot(offset, axis) / length2;
    const float t = clamp(along, 0.0f, 1.0f);
    const float u = dot(offset, x), v = dot(offset, y), beyond = along - t;
    return sqrt(u * u + v * v + beyond * beyond * length2) -
           (radius_a + t * (radius_b - radius_a));
}

// Unit gradient of the distance with respect to the point: the normal of the surface nearby.
#define CONE_NORMAL(cone, point) \
    cone_normal(vload3(0, cone), (cone)[3], vload3(0, (cone) + 4), (cone)[7], \
                vload3(0, (cone) + 8), vload3(0, (cone) + 12), point)

inline float3 cone_normal(float3 a, float radius_a, float3 b, float radius_b, float3 x, float3 y,
                          float3 point)
{
    const float3 axis = b - a, offset = point - a;
    const float length2 = dot(axis, axis);
    const float along = dot(offset, axis) / length2;
    const float t = clamp(along, 0.0f, 1.0f);
    const float u = dot(offset, x), v = dot(offset, y), beyond = along - t;
    const float distance = sqrt(u * u + v * v + beyond * beyond * length2);
    const float3 normal = (u * x + v * y + beyond * axis) / fmax(distance, 1e-9f);
    // Along the side the radius changes with the place.
    return beyond == 0.0f ? normal - (radius_b - radius_a) / length2 * axis : normal;
}
