// Divides the foreground among several people, each about `n_spheres` spheres (x, y, z, radius in m).
// Twin: psfs/reference/division.py. Defines: PEOPLE, UNKNOWN, PACK, COLOURS (0 or
// 1), BANDS, LEVELS of a colour's channel, and those of camera.h.
#if !defined(CAMERA_FLOATS) || !defined(PACK) || !defined(PEOPLE) || !defined(UNKNOWN)
#error "people.cl needs CAMERA_FLOATS PACK PEOPLE and UNKNOWN"
#endif
#include "common/camera.h"
#include "reconstruction/packed_voxels.h"

// Depth where there is nobody, m; numbers of colours, and values of a channel that are one level.
#define FAR 1e6f
#define N_COLOURS (LEVELS * LEVELS * LEVELS)
#define WIDE (256 / LEVELS)

// The spheres in every camera: x, y (px), depth (m), m per px there; far away without an image. The
// boxes x0, y0, x1, y1 (px) of the people hold all that is not further than `reach`, m. An item
// projects a person into a view.
__kernel void project_people(int n_spheres, int n_views, float reach,
                             __global const float *restrict cameras,
                             __global const float4 *restrict spheres,
                             // out
                             __global float4 *restrict seen, __global float4 *restrict boxes)
{
    const int person = get_global_id(0), view = get_global_id(1);
    if (person >= PEOPLE || view >= n_views) return;
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    float4 box = (float4)(FAR, FAR, -FAR, -FAR);
    for (int first = 0; first < n_spheres; first += PACK) {
#define SPHERE(l) spheres[person * n_spheres + lane_index(first, 0x##l, n_spheres)]
#define CENTRE_X(l) SPHERE(l).x
#define CENTRE_Y(l) SPHERE(l).y
#define CENTRE_Z(l) SPHERE(l).z
        float x[PACK], y[PACK], depth[PACK];
        vfloat px, py;
        STORE_PACK(camera_project_pack(camera, PACK_OF(vfloat, CENTRE_X), PACK_OF(vfloat, CENTRE_Y),
                                       PACK_OF(vfloat, CENTRE_Z), &px, &py), depth);
        STORE_PACK(px, x);
        STORE_PACK(py, y);
        for (int l = 0; l < PACK && first + l < n_spheres; ++l) {
            const int k = person * n_spheres + first + l;
            const float radius = spheres[k].w, scale = depth[l] / camera[12];
            const bool shown = radius > 0.0f && depth[l] > 0.0f;
            if (shown) {
                const float around = sqrt(reach * reach + radius * radius) / scale;
                box.x = fmin(box.x, x[l] - around);
                box.y = fmin(box.y, y[l] - around);
                box.z = fmax(box.z, x[l] + around);
                box.w = fmax(box.w, y[l] + around);
            }
            seen[view * PEOPLE * n_spheres + k] =
                shown ? (float4)(x[l], y[l], depth[l], scale) : (float4)(-FAR, -FAR, FAR, 1.0f);
        }
    }
    boxes[view * PEOPLE + person] = box;
}

// Each person's evidence, see divide_evidence of the twin. `model`: of the evidence: nats per count,
// P(O) of Song et al. eq. (5), least likelihood of a silhouette, and the nats that speak against who
// is behind another one. `precision`: 1/m^2, of the distance of a pixel's ray from a person; `reach`,
// m^2: of nobody; `before`, m. A person's maps lie `step` after the one before. Views are dimension
// 1; an item has a pack of pixels. With COLOURS: `pictures`; the band of each sphere; and the log
// likelihoods (PEOPLE + 1, BANDS, LEVELS^3) of people's `colours`, the last of nobody's.
__kernel void divide_evidence(int2 picture, int n_spheres, float4 model, float precision,
                              float reach, float before, int step,
                              __global const float4 *restrict spheres,
                              __global const float4 *restrict seen,
                              __global const float4 *restrict boxes,
                              __global const char *restrict evidence,
                              __global const uchar *restrict pictures,
                              __global const uchar *restrict bands,
                              __global const float *restrict colours,
                              // out
                              __global char *restrict parts)
{
    const int view = get_global_id(1), n = WIDTH * HEIGHT;
    if (get_global_id(0) * PACK >= n) return;
    const int first = min((int)get_global_id(0) * PACK, n - PACK); // the last packs may overlap
    const size_t at = (size_t)view * n + first;
    const vchar counts = LOAD_PACK(evidence + at);
    const vint shown = TO_INT(counts) > 0;
    if (!PACK_ANY(shown)) {
        for (int person = 0; person < PEOPLE; ++person)
            STORE_PACK(counts, parts + (size_t)person * step + at);
        return;
    }
    const vint pixel = first + LANE_NUMBERS;
    const vint row = quotient(pixel, WIDTH);
    const vfloat x = TO_FLOAT(pixel - row * WIDTH), y = TO_FLOAT(row);
#if COLOURS
    int codes[PACK];
    for (int l = 0; l < PACK; ++l) {
        __global const uchar *colour = pictures + 3 * (at + l);
        codes[l] = (colour[0] / WIDE * LEVELS + colour[1] / WIDE) * LEVELS + colour[2] / WIDE;
    }
#endif
    vfloat nats[PEOPLE + 1], depths[PEOPLE];
    for (int person = 0; person < PEOPLE; ++person) {
        vfloat gap = (vfloat)(FAR), depth = (vfloat)(FAR);
        vint nearest = (vint)(person * n_spheres);
        const float4 box = boxes[view * PEOPLE + person];
        const vint inside = (x >= box.x) & (x <= box.z) & (y >= box.y) & (y <= box.w) & shown;
        const int end = PACK_ANY(inside) ? (person + 1) * n_spheres : 0;
        for (int k = person * n_spheres; k < end; ++k) {
            const float4 image = seen[view * PEOPLE * n_spheres + k];
            const float radius = spheres[k].w;
            const vfloat dx = (x - image.x) * image.w, dy = (y - image.y) * image.w;
            const vfloat away = dx * dx + dy * dy - radius * radius;
            nearest = away < gap ? (vint)(k) : nearest;
            gap = least(gap, away);
            depth = away <= 0.0f ? least(depth, (vfloat)(image.z)) : depth;
        }
        nats[person] = -precision * most(gap, (vfloat)(0.0f));
        depths[person] = depth;
#if COLOURS
        int sphere[PACK];
        float alike[PACK];
        STORE_PACK(nearest, sphere);
        for (int l = 0; l < PACK; ++l)
            alike[l] = colours[(person * BANDS + bands[sphere[l]]) * N_COLOURS + codes[l]];
        nats[person] += LOAD_PACK(alike);
#endif
    }
    nats[PEOPLE] = (vfloat)(-precision * reach);
#if COLOURS
    nats[PEOPLE] += colours[PEOPLE * BANDS * N_COLOURS];
#endif
    vint behind[PEOPLE];
    vfloat greatest = nats[PEOPLE];
    for (int person = 0; person < PEOPLE; ++person) {
        behind[person] = (vint)(0);
        for (int other = 0; other < PEOPLE; ++other)
            behind[person] |= (depths[person] < FAR) & (depths[other] < depths[person] - before);
        nats[person] -= behind[person] ? (vfloat)(model.w) : (vfloat)(0.0f);
        greatest = most(greatest, nats[person]);
    }
    const float occluded = model.y;
    const vfloat odds = exp(model.x * TO_FLOAT(TO_INT(counts)));
    const vfloat likelihood = odds * (1.0f - occluded) / (1.0f + odds * (1.0f - 2.0f * occluded));
    vfloat sum = exp(nats[PEOPLE] - greatest);
    for (int person = 0; person < PEOPLE; ++person)
        sum += nats[person] = exp(most(nats[person] - greatest, (vfloat)(-80.0f)));
    for (int person = 0; person < PEOPLE; ++person) {
        vfloat before_it = (vfloat)(0.0f);
        for (int other = 0; other < PEOPLE; ++other)
            before_it += depths[other] < depths[person] - before ? nats[other] : (vfloat)(0.0f);
        const vint hidden = behind[person] & (before_it > nats[person]);
        vfloat own = likelihood * nats[person] / sum;
        own = most((vfloat)(model.z), least((vfloat)(1.0f - model.z), own));
        const vfloat against = log(own / (occluded * own + (1.0f - occluded) * (1.0f - own)));
        vint count = TO_INT(rint(against / model.x));
        count = hidden ? (vint)(UNKNOWN) : count;
        count = shown ? count : TO_INT(counts);
        STORE_PACK(TO_CHAR(count), parts + (size_t)person * step + at);
    }
}
