// Divides the surface voxels and the foreground of several people among them. Each person is
// SPHERES spheres (x, y, z, radius in m). Twin: psfs/reference/division.py. Defines: PEOPLE,
// SPHERES, LANES, UNKNOWN, PACK, and those of camera.h.
#if !defined(CAMERA_FLOATS) || !defined(LANES) || !defined(PACK) || !defined(PEOPLE) || \
    !defined(SPHERES) || !defined(UNKNOWN)
#error "people.cl needs CAMERA_FLOATS LANES PACK PEOPLE SPHERES and UNKNOWN"
#endif
#include "common/camera.h"
#include "reconstruction/packed_voxels.h"

// Depth where there is nobody, m.
#define FAR 1e6f

// The spheres in every camera: x, y (px), depth (m), m per px there; far away without an image. The
// boxes x0, y0, x1, y1 (px) of the people hold all that is not further than `reach`, m.
INLINED void project_person(int person, int view, __global const float *cameras, float reach,
                            __global const float4 *spheres, __global float4 *seen,
                            __global float4 *boxes)
{
    __global const float *camera = cameras + view * CAMERA_FLOATS;
    float4 box = (float4)(FAR, FAR, -FAR, -FAR);
    for (int first = 0; first < SPHERES; first += PACK) {
#define SPHERE(l) spheres[person * SPHERES + lane_index(first, 0x##l, SPHERES)]
#define CENTRE_X(l) SPHERE(l).x
#define CENTRE_Y(l) SPHERE(l).y
#define CENTRE_Z(l) SPHERE(l).z
        float x[PACK], y[PACK], depth[PACK];
        vfloat px, py;
        STORE_PACK(camera_project_pack(camera, PACK_OF(vfloat, CENTRE_X), PACK_OF(vfloat, CENTRE_Y),
                                       PACK_OF(vfloat, CENTRE_Z), &px, &py), depth);
        STORE_PACK(px, x);
        STORE_PACK(py, y);
        for (int l = 0; l < PACK && first + l < SPHERES; ++l) {
            const int k = person * SPHERES + first + l;
            const float scale = depth[l] / camera[12];
            if (depth[l] > 0.0f) {
                const float around = sqrt(reach * reach + spheres[k].w * spheres[k].w) / scale;
                box.x = fmin(box.x, x[l] - around);
                box.y = fmin(box.y, y[l] - around);
                box.z = fmax(box.z, x[l] + around);
                box.w = fmax(box.w, y[l] + around);
            }
            seen[view * PEOPLE * SPHERES + k] = depth[l] > 0.0f
                ? (float4)(x[l], y[l], depth[l], scale) : (float4)(-FAR, -FAR, FAR, 1.0f);
        }
    }
    boxes[view * PEOPLE + person] = box;
}

// The person nearest to each surface voxel, PEOPLE if nobody is nearer than the root of `reach`.
// Distances are squared, of the point from a sphere's centre less the radius: tangents of spheres.
// `geometry`: origin of the grid, voxel size. Beside it, the first item of a group does one person's
// spheres in one view, see project_person.
__kernel void assign_and_project(int3 grid, __global const float4 *restrict spheres, float4 geometry,
                                 float reach, __global const int *restrict indices,
                                 __global const int *restrict n_surface,
                                 __global uchar *restrict owners, int n_views, float beside,
                                 __global const float *restrict cameras,
                                 __global float4 *restrict seen, __global float4 *restrict boxes)
{
    if (get_local_id(0) == 0)
        for (int k = get_group_id(0); k < PEOPLE * n_views; k += get_num_groups(0))
            project_person(k % PEOPLE, k / PEOPLE, cameras, beside, spheres, seen, boxes);
    const int n = *n_surface;
    for (int first = get_global_id(0) * PACK; first < n; first += get_global_size(0) * PACK) {
#define VOXEL(l) indices[lane_index(first, 0x##l, n)]
        const voxel_place at = place_of(grid, PACK_OF(vint, VOXEL));
        const vfloat x = geometry.x + (TO_FLOAT(at.x) + 0.5f) * geometry.w;
        const vfloat y = geometry.y + (TO_FLOAT(at.y) + 0.5f) * geometry.w;
        const vfloat z = geometry.z + (TO_FLOAT(at.z) + 0.5f) * geometry.w;
        vfloat nearest = (vfloat)(reach);
        vint owner = (vint)(PEOPLE);
        for (int person = 0; person < PEOPLE; ++person) {
            vfloat own = (vfloat)(FAR);
            for (int k = person * SPHERES; k < (person + 1) * SPHERES; ++k) {
                const float4 sphere = spheres[k];
                const vfloat dx = x - sphere.x, dy = y - sphere.y, dz = z - sphere.z;
                own = least(own, dx * dx + dy * dy + dz * dz - sphere.w * sphere.w);
            }
            owner = own < nearest ? (vint)(person) : owner;
            nearest = least(own, nearest);
        }
        uchar found[PACK];
        STORE_PACK(TO_BYTES(owner), found);
        for (int l = 0; l < PACK && first + l < n; ++l) owners[first + l] = found[l];
    }
}

// Each person's voxels, in their order, at most `room` of them; the counts lie `step` apart. One
// work-group per person; an item has a run of voxels.
__kernel __attribute__((reqd_work_group_size(LANES, 1, 1)))
void list_voxels(__global const uchar *restrict owners, __global const int *restrict indices,
                 __global const int *restrict n_surface, int room, int step,
                 __global int *restrict lists, __global int *restrict counts)
{
    __local int found[LANES];
    const int lane = get_local_id(0), person = get_group_id(0), n = *n_surface;
    const int share = (n + LANES - 1) / LANES;
    const int first = min(lane * share, n), end = min(first + share, n);
    int own = 0;
    for (int i = first; i < end; ++i) own += owners[i] == person;
    found[lane] = own;
    barrier(CLK_LOCAL_MEM_FENCE);
    int at = 0;
    for (int before = 0; before < lane; ++before) at += found[before];
    if (lane == LANES - 1) counts[person * step] = min(at + own, room);
    __global int *list = lists + (size_t)person * room;
    for (int i = first; i < end; ++i)
        if (owners[i] == person) {
            if (at < room) list[at] = indices[i];
            ++at;
        }
}

// Each person's evidence: that of the foreground which the person's spheres cover or are nearest
// to, up to the root of `beside`; UNKNOWN where another one stands before the person by `before` m;
// 0 in the rest of the foreground; as it is elsewhere. A person's maps lie `step` after the one
// before. Views are dimension 1; an item has a pack of pixels.
__kernel void divide_evidence(int2 picture, __global const float4 *restrict spheres,
                              __global const float4 *restrict seen,
                              __global const float4 *restrict boxes, float beside, float before,
                              int step, __global const char *restrict evidence,
                              __global char *restrict own)
{
    const int view = get_global_id(1), n = WIDTH * HEIGHT;
    if (get_global_id(0) * PACK >= n) return;
    const int first = min((int)get_global_id(0) * PACK, n - PACK); // the last packs may overlap
    const size_t at = (size_t)view * n + first;
    const vchar counts = LOAD_CHARS(evidence + at);
    const vint shown = TO_INT(counts) > 0;
    if (!PACK_ANY(shown)) {
        for (int person = 0; person < PEOPLE; ++person)
            STORE_PACK(counts, own + (size_t)person * step + at);
        return;
    }
    const vint pixel = first + LANE_NUMBERS;
    const vint row = quotient(pixel, WIDTH);
    const vfloat x = TO_FLOAT(pixel - row * WIDTH), y = TO_FLOAT(row);
    vfloat gaps[PEOPLE], depths[PEOPLE];
    vfloat closest = (vfloat)(beside), front = (vfloat)(FAR);
    for (int person = 0; person < PEOPLE; ++person) {
        vfloat gap = (vfloat)(FAR), depth = (vfloat)(FAR);
        const float4 box = boxes[view * PEOPLE + person];
        const vint inside = (x >= box.x) & (x <= box.z) & (y >= box.y) & (y <= box.w) & shown;
        for (int k = PACK_ANY(inside) ? person * SPHERES : PEOPLE * SPHERES;
             k < (person + 1) * SPHERES; ++k) {
            const float4 image = seen[view * PEOPLE * SPHERES + k];
            const float radius = spheres[k].w;
            const vfloat dx = (x - image.x) * image.w, dy = (y - image.y) * image.w;
            const vfloat away = dx * dx + dy * dy - radius * radius;
            gap = least(gap, away);
            depth = away <= 0.0f ? least(depth, (vfloat)(image.z)) : depth;
        }
        gaps[person] = most(gap, (vfloat)(0.0f));
        depths[person] = depth;
        closest = least(closest, gaps[person]);
        front = least(front, depth);
    }
    for (int person = 0; person < PEOPLE; ++person) {
        const vint hidden = (depths[person] < FAR) & (front < depths[person] - before);
        const vint mine = (gaps[person] <= closest) & (gaps[person] < beside);
        vint count = mine ? TO_INT(counts) : (vint)(0);
        count = hidden ? (vint)(UNKNOWN) : count;
        count = shown ? count : TO_INT(counts);
        STORE_PACK(TO_CHAR(count), own + (size_t)person * step + at);
    }
}
