// Samples on the outlines and inside of cones, in maps and pictures. Defines: those of
// packed_cones.h; EDGE_FLOATS; N_CODES; OUTLINE_FLOATS; TRUNK, the cone that hides limbs behind it,
// or -1.
#if !defined(CAMERA_FLOATS) || !defined(EDGE_FLOATS) || !defined(N_CODES) || \
    !defined(OUTLINE_FLOATS) || !defined(TRUNK)
#error "tracking/samples.h needs CAMERA_FLOATS, EDGE_FLOATS, N_CODES, OUTLINE_FLOATS and TRUNK"
#endif
#include "common/packed_cones.h"
#include "tracking/codes.h"

// Slope from which a line counts as upright: that of half of a right angle's quarter, 67.5 degrees.
#define STEEP 2.41421356f

// Items that share a row of samples: a GPU's would wait for one sample after the other.
#define SHARES (GROUP > 1 ? 2 : 1)

// Sums over samples of a map: 255 - value, and how many of them lie in the picture; of `colour` the
// log ratios of visible samples, see part_colour.cl; of `contour` what visible samples of outlines
// find of contour.cl's; and how many of the `n_shown` surface samples no cone covers.
typedef struct {
    vint edge, n_edge, inside, n_inside, colour, n_colour, contour, n_contour, uncovered, n_shown;
} samples;

// Surface samples in a camera's picture: the pixels of all `n_points`, NOWHERE of those without one,
// and the `n` that count, every `stride`-th from `first` on, after the last the first.
typedef struct {
    __global const float2 *pixels;
    int n_points, first, stride, n;
} surface_samples;

// What is looked up in the pictures themselves: their codes, the table of log ratios, the part of
// every row, their contours along each normal, the pixels of a picture, and what the means of both
// weigh.
typedef struct {
    __global const uchar *codes;
    __global const char *ratios;
    __global const int *row_parts;
    __global const uchar *contours;
    int n_pixels;
    float colour_weight, contour_weight;
} picture_cues;

// The edges of an outline: four times a, b, c, of which a x + b y + c is positive on the inner side,
// whichever way round the corners go; 0 of an outline that is NOWHERE.
INLINED void outline_edges(__local const vfloat *corners, __local vfloat *edges)
{
    const vfloat area = (corners[4] - corners[0]) * (corners[7] - corners[3]) -
                        (corners[6] - corners[2]) * (corners[5] - corners[1]);
    const vfloat none = 0.0f, one = 1.0f;
    const vfloat turn = corners[0] > NOWHERE && area != 0.0f ? (area > 0.0f ? one : -one) : none;
    for (int i = 0; i < 4; ++i) {
        const vfloat x = corners[2 * i], y = corners[2 * i + 1];
        const vfloat a = turn * (y - corners[(2 * i + 3) % 8]);
        const vfloat b = turn * (corners[(2 * i + 2) % 8] - x);
        edges[3 * i] = a;
        edges[3 * i + 1] = b;
        edges[3 * i + 2] = -(a * x + b * y);
    }
}

// Positive on the inner side of an edge.
INLINED vfloat on_side(__local const vfloat *edge, float2 pixel)
{
    return edge[0] * pixel.x + (edge[1] * pixel.y + edge[2]);
}

// Adds the k-th of the surface samples. edges: of all cones.
INLINED void take_shown(surface_samples shown, int k, __local const vfloat *edges, samples *sums)
{
    const int at = shown.first + k * shown.stride;
    const float2 pixel = shown.pixels[at < shown.n_points ? at : at - shown.n_points];
    if (pixel.x <= NOWHERE) return;
    vfloat covered = 0.0f;
    const vint one = 1;
    for (int c = 0; c < N_CONES; ++c, edges += EDGE_FLOATS) {
        const vfloat ends = least(on_side(edges, pixel), on_side(edges + 6, pixel));
        const vfloat sides = least(on_side(edges + 3, pixel), on_side(edges + 9, pixel));
        covered = most(covered, least(ends, sides));
    }
    sums->uncovered += covered > 0.0f ? 0 : one;
    sums->n_shown += 1;
}

// Adds the sample at pixel (x, y), whose half is added already, of one channel of a map.
static inline void take_sample(__global const float *camera, __global const uchar *channel,
                               int width, vfloat x, vfloat y, vint *error, vint *count)
{
    const vint inside = (x >= 0.0f) & (y >= 0.0f) & (x < camera[23]) & (y < camera[24]);
    const vint pixel = inside ? 2 * (TO_INT(y) * width + TO_INT(x)) : 0;
    const vint value = look_up(channel, pixel);
    *error += inside ? 255 - value : 0;
    *count += inside & 1;
}

// Whether a row of a cone, `row` as in take_row, lies further from the camera than the trunk's
// middle: what it shows inside the trunk's outline is hidden.
INLINED vint behind_trunk(__global const float *camera, __local const vfloat *cones,
                          float4 row)
{
#if TRUNK < 0
    return (vint)0;
#else
    __local const vfloat *own = cones + (int)row.x * CONE_FLOATS;
    __local const vfloat *trunk = cones + TRUNK * CONE_FLOATS;
    vfloat further = 0.0f;
    for (int i = 0; i < 3; ++i)
        further += camera[6 + i] * (own[i] + row.y * (own[4 + i] - own[i]) -
                                    0.5f * (trunk[i] + trunk[4 + i]));
    return further > 0.0f;
#endif
}

// Whether pixel (x, y) lies in the trapezoid with these corners; never in one that is NOWHERE.
INLINED vint in_outline(__local const vfloat *corners, vfloat x, vfloat y)
{
    vint left = corners[0] > NOWHERE, right = left;
    for (int i = 0; i < 4; ++i) {
        const int j = (i + 1) % 4;
        const vfloat side = (corners[2 * j] - corners[2 * i]) * (y - corners[2 * i + 1]) -
                            (corners[2 * j + 1] - corners[2 * i + 1]) * (x - corners[2 * i]);
        left &= side >= 0.0f;
        right &= side <= 0.0f;
    }
    return left | right;
}

// Adds the sample at pixel (x, y), whose half is added already, of the picture's codes, which say both
// where the silhouette is, as the map's first channel does, and, where it is `visible` and nothing
// hides its colour, the log ratio of that; ratios: the part's.
static inline void take_colour(__global const float *camera, __global const uchar *codes,
                               __global const char *ratios, int width, vfloat x, vfloat y,
                               vint visible, samples *sums)
{
    const vint inside = (x >= 0.0f) & (y >= 0.0f) & (x < camera[23]) & (y < camera[24]);
    const vint pixel = inside ? TO_INT(y) * width + TO_INT(x) : 0;
    const vint code = look_up(codes, pixel);
    const vint value = look_up(ratios, code);
    const vint coloured = inside & visible & (code != HIDDEN_CODE);
    sums->inside += (inside & (code == NO_CODE)) ? 255 : 0;
    sums->n_inside += inside & 1;
    sums->colour += coloured ? value : 0;
    sums->n_colour += coloured & 1;
}

// The normal, of contour.cl's four, of a line in direction (x, y).
static inline vint normal_of(vfloat x, vfloat y)
{
    const vfloat across = most(x, -x), down = most(y, -y);
    const vint diagonal = x * y < 0.0f ? (vint)1 : (vint)3;
    return down > STEEP * across ? (vint)0 : across > STEEP * down ? (vint)2 : diagonal;
}

// Adds what the sample at pixel (x, y), whose half is added already, of an outline with this normal
// finds of contours.
static inline void take_contour(__global const float *camera, picture_cues cues, vint normal,
                                int width, vfloat x, vfloat y, vint visible, samples *sums)
{
    const vint inside =
        visible & (x >= 0.0f) & (y >= 0.0f) & (x < camera[23]) & (y < camera[24]);
    const vint pixel = inside ? normal * cues.n_pixels + TO_INT(y) * width + TO_INT(x) : 0;
    const vint value = look_up(cues.contours, pixel);
    sums->contour += inside ? value : 0;
    sums->n_contour += inside & 1;
}

// Whether a sample at pixel (x, y), whose half is added already, is seen: unless the row is `hidden`
// where the trunk's outline covers it.
INLINED vint seen_sample(__local const vfloat *outlines, vfloat x, vfloat y, vint hidden)
{
#if TRUNK < 0
    return (vint)-1;
#else
    return (hidden & in_outline(outlines + TRUNK * OUTLINE_FLOATS, x - 0.5f, y - 0.5f)) == 0;
#endif
}

// One row of a cone, x = its number, y = share of the way along it: samples at both outlines and z
// evenly between them, w = 1 / z; of these every SHARES-th from number `share` on.
// Where its part is looked for in the pictures, `part` is not negative and `hidden` says whether it
// lies behind the trunk. cues: of this camera.
INLINED void take_row(__global const float *camera, __global const uchar *map, int width,
                      __local const vfloat *outlines, float4 row, int share, int part,
                      picture_cues cues, vint hidden, samples *sums)
{
    __local const vfloat *corner = outlines + (int)row.x * OUTLINE_FLOATS;
    const vfloat left_x = corner[0] + row.y * (corner[6] - corner[0]) + 0.5f;
    const vfloat left_y = corner[1] + row.y * (corner[7] - corner[1]) + 0.5f;
    const vfloat right_x = corner[2] + row.y * (corner[4] - corner[2]) + 0.5f;
    const vfloat right_y = corner[3] + row.y * (corner[5] - corner[3]) + 0.5f;
    for (int side = share; side < 2; side += SHARES) {
        const vfloat x = side ? right_x : left_x, y = side ? right_y : left_y;
        take_sample(camera, map + 1, width, x, y, &sums->edge, &sums->n_edge);
        if (part >= 0 && cues.contour_weight > 0.0f) {
            __local const vfloat *low = corner + 2 * side, *high = corner + 6 - 2 * side;
            take_contour(camera, cues, normal_of(high[0] - low[0], high[1] - low[1]), width, x, y,
                         seen_sample(outlines, x, y, hidden), sums);
        }
    }
    const bool coloured = part >= 0 && cues.colour_weight > 0.0f;
    const vfloat step_x = (right_x - left_x) * row.w, step_y = (right_y - left_y) * row.w;
    const int n = (int)row.z;
    for (int column = share; column < n; column += SHARES) {
        const vfloat x = left_x + (column + 0.5f) * step_x;
        const vfloat y = left_y + (column + 0.5f) * step_y;
        if (coloured)
            take_colour(camera, cues.codes, cues.ratios + part * N_CODES, width, x, y,
                        seen_sample(outlines, x, y, hidden), sums);
        else
            take_sample(camera, map, width, x, y, &sums->inside, &sums->n_inside);
    }
}
