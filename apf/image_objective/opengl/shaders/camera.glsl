// Camera projection, the counterpart of cl/kernels/common/camera.h, whose packing it reads.
layout(std430, binding = 0) readonly buffer Cameras { float cameras[]; };

vec3 camera_centre(int view)
{
    const int c = view * CAMERA_FLOATS + 25;
    return vec3(cameras[c], cameras[c + 1], cameras[c + 2]);
}

// Distorted over undistorted radius of Tsai's lens: the root of stretch s^3 + s - 1.
float tsai_share(float stretch)
{
    float s = 1.0 / (1.0 + stretch);
    for (int step = 0; step < 5; ++step)
        s = (2.0 * stretch * s * s * s + 1.0) / (3.0 * stretch * s * s + 1.0);
    return s;
}

// Project a world point; false where it has no image or one too far out.
bool project(int view, vec3 p, out vec2 pixel)
{
    const int c = view * CAMERA_FLOATS;
    const vec3 q = vec3(dot(vec3(cameras[c], cameras[c + 1], cameras[c + 2]), p),
                        dot(vec3(cameras[c + 3], cameras[c + 4], cameras[c + 5]), p),
                        dot(vec3(cameras[c + 6], cameras[c + 7], cameras[c + 8]), p)) +
                   vec3(cameras[c + 9], cameras[c + 10], cameras[c + 11]);
    const float u = q.x / q.z, v = q.y / q.z, r2 = u * u + v * v;
    const float p1 = cameras[c + 19], p2 = cameras[c + 20];
    const float radial =
        1.0 + r2 * (cameras[c + 17] + r2 * (cameras[c + 18] + r2 * cameras[c + 21]));
    float x = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u);
    float y = v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v;
    const float stretch = cameras[c + 28] * r2;
    if (stretch != 0.0) {
        const float share = tsai_share(stretch);
        x = u * share;
        y = v * share;
    }
    if (cameras[c + 29] != 0.0) {
        const float r = sqrt(r2), angle = atan(r), a2 = angle * angle;
        const float share = angle / (r + 1e-12) *
            (1.0 + a2 * (cameras[c + 17] +
                         a2 * (cameras[c + 18] + a2 * (p1 + a2 * p2))));
        x = u * share;
        y = v * share;
    }
    pixel = vec2(cameras[c + 12] * x + cameras[c + 16] * y + cameras[c + 14],
                 cameras[c + 13] * y + cameras[c + 15]);
    return q.z > 1e-6 && r2 < cameras[c + 22] && all(lessThan(abs(pixel), vec2(FAR_OUT)));
}
