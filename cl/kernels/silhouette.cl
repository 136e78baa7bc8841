// Silhouette likelihood maps, Song et al. eq. (1)-(2), as evidence counts (see psfs/config.py);
// twin: reference/silhouette.py.
// Defines: WIDTH, HEIGHT, VIEWS, FLOOR (m), SHADOW_LOW, SHADOW_HIGH, FLOOR_LOW, FLOOR_LIT,
// FLOOR_WEIGHT (1 / variance of the light factor), FLOOR_LEFT (squared distance), FLOOR_DEPTH
// (1 / variance of its shadows), RIM_SHARE, RIM_COST (nats), STEPS (counts of log ratio per nat),
// LOWEST and HIGHEST (counts), BINS of a colour channel, CELL (px), CELLS_X, CELLS_Y of the cells.
#include "camera.h"
#include "ratios.h"

#define PIXELS (WIDTH * HEIGHT)

// Is the pixel inside the picture of its view, which may be smaller than the stack of views?
inline bool in_picture(__global const int2 *sizes, int view, int x, int y)
{
    return x < sizes[view].x && y < sizes[view].y;
}

// Three channels of a pixel, not a float3, which PoCL does not spread over its vectors.
typedef struct { float b, g, r; } Colour;

inline Colour colour_of(__global const uchar *pixel)
{
    return (Colour){pixel[0], pixel[1], pixel[2]};
}

// The pixel's mean, or its 1 / sigma^2, in the background's planes from `first` on.
inline Colour planes_of(__global const float *plane, int first)
{
    plane += first * PIXELS;
    return (Colour){plane[0], plane[PIXELS], plane[2 * PIXELS]};
}

// Sum of w x y over the channels.
inline float weighed(Colour w, Colour x, Colour y)
{
    return w.b * x.b * y.b + w.g * x.g * y.g + w.r * x.r * y.r;
}

inline Colour less(Colour x, float factor, Colour y)
{
    return (Colour){x.b - factor * y.b, x.g - factor * y.g, x.r - factor * y.r};
}

// The factor that takes y nearest to x, and the squared distance that a factor leaves.
inline float fitting(Colour w, Colour x, Colour y)
{
    return weighed(w, x, y) / (weighed(w, y, y) + 1e-6f);
}

inline float distance_left(Colour w, Colour x, float factor, Colour y)
{
    const Colour rest = less(x, factor, y);
    return weighed(w, rest, rest);
}

inline int colour_bin(__global const uchar *colour)
{
    const int b = colour[0], g = colour[1], r = colour[2];
    return ((b * BINS >> 8) * BINS + (g * BINS >> 8)) * BINS + (r * BINS >> 8);
}

// Light factor that explains the colour of a pixel of the background best, and in *left the squared
// distance that it leaves. `plane` points to the pixel in the first of the view's planes.
inline float light_factor(__global const uchar *colour, __global const float *plane, float *left)
{
    const Colour shown = colour_of(colour), mean = planes_of(plane, 0), w = planes_of(plane, 3);
    const float alpha = fitting(w, shown, mean);
    *left = distance_left(w, shown, alpha, mean);
    return alpha;
}

// The light on the floor behind every cell: the brightest that any other camera sees there, told
// in steps of 1 / 127, times 2, plus 1 where there is floor at all. A camera whose pixel cannot be
// floor, shaded or not, has no say; where nobody has, the floor is lit. The person who hides
// the floor from some cameras may be dark like a shadow, but others see the floor beside him.
// A cell whose middle shows the floor lit asks nobody.
// `points` holds the floor behind a cell (x, y), NaN if there is none. `light` has a border of one
// cell, which repeats the outermost.
__kernel void floor_light(__global const float *restrict cameras,
                          __global const float2 *restrict points,
                          __global const uchar *restrict images,
                          __global const float *restrict background,
                          __global uchar *restrict light)
{
    const int column = get_global_id(0), row = get_global_id(1), view = get_global_id(2);
    if (column >= CELLS_X + 2 || row >= CELLS_Y + 2) return;
    const int x = min(max(column - 1, 0), CELLS_X - 1), y = min(max(row - 1, 0), CELLS_Y - 1);
    const float2 point = points[(view * CELLS_Y + y) * CELLS_X + x];
    const int on_floor = point.x == point.x;
    const int middle = min(CELL * y + CELL / 2, HEIGHT - 1) * WIDTH +
                       min(CELL * x + CELL / 2, WIDTH - 1);
    float left;
    const float own = light_factor(images + 3 * (view * PIXELS + middle),
                                   background + (size_t)view * 8 * PIXELS + middle, &left);
    const int asks = on_floor && (own <= FLOOR_LIT || left >= FLOOR_LEFT);
    float brightest = 0.0f;
    for (int other = 0; asks && other < VIEWS; ++other) {
        if (other == view) continue;
        __global const float *camera = cameras + other * CAMERA_FLOATS;
        float2 pixel;
        const float depth = camera_project(camera, point.x, point.y, FLOOR, &pixel);
        const int at = camera_offset(camera, pixel, WIDTH);
        if (depth <= 0.0f || at < 0) continue;
        const float alpha = light_factor(images + 3 * (other * PIXELS + at),
                                         background + (size_t)other * 8 * PIXELS + at, &left);
        if (left < FLOOR_LEFT && alpha < SHADOW_HIGH && alpha > brightest) brightest = alpha;
    }
    const int told = brightest > 0.0f && brightest < 1.0f ? (int)(127.0f * brightest + 0.5f) : 127;
    light[(view * (CELLS_Y + 2) + row) * (CELLS_X + 2) + column] = 2 * told + on_floor;
}

// Log of the background's density over the foreground's, in counts of 1 / STEPS nats.
// `background` holds, per view, planes of floats: mean of the channels (3), 1 / sigma^2 of the
// channels (3), log of the background's peak density over the uniform foreground's, 1 / variance
// of the light factor. `colours` holds the log of the foreground's density over the uniform one,
// `place` the log odds of foreground by cell, both in counts. `ratios` has a border of one pixel.
__kernel void log_ratio(__global const uchar *restrict images,
                        __global const float *restrict background,
                        __global const int2 *restrict sizes,
                        __global const char *restrict colours,
                        __global const char *restrict place,
                        __global const uchar *restrict light,
                        __global char *restrict ratios)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    const int pixel = y * WIDTH + x;
    __global const uchar *colour = images + 3 * (view * PIXELS + pixel);
    __global const float *plane = background + (size_t)view * 8 * PIXELS + pixel;
    const Colour shown = colour_of(colour), mean = planes_of(plane, 0), w = planes_of(plane, 3);

    // Squared distances to the background's colour in plain light, under less light, and, on the
    // floor, under the light that other cameras see, in between cells linearly.
    const float factor = fitting(w, shown, mean);
    float least = distance_left(w, shown, 1.0f, mean);

    const float alpha = limit(factor, SHADOW_LOW, SHADOW_HIGH);
    const float shaded = distance_left(w, shown, alpha, mean) +
                         plane[7 * PIXELS] * (1.0f - alpha) * (1.0f - alpha);
    least = shaded < least ? shaded : least;

    const int u = 2 * x - (CELL - 1) + 2 * CELL, v = 2 * y - (CELL - 1) + 2 * CELL;
    const int cx = u / (2 * CELL), cy = v / (2 * CELL);
    const int fx = u % (2 * CELL), fy = v % (2 * CELL);
    __global const uchar *corner = light + (view * (CELLS_Y + 2) + cy) * (CELLS_X + 2) + cx;
    const int upper = (2 * CELL - fx) * (corner[0] & 254) + fx * (corner[1] & 254);
    const int lower = (2 * CELL - fx) * (corner[CELLS_X + 2] & 254) +
                      fx * (corner[CELLS_X + 3] & 254);
    const float seen = ((2 * CELL - fy) * upper + fy * lower) * (1.0f / (4 * CELL * CELL * 254));
    const int on_floor =
        light[(view * (CELLS_Y + 2) + y / CELL + 1) * (CELLS_X + 2) + x / CELL + 1] & 1;
    const float dim = limit(factor, FLOOR_LOW, SHADOW_HIGH);
    const float darker = seen > dim ? seen - dim : 0.0f;
    const float on_it = distance_left(w, shown, dim, mean) +
                        FLOOR_WEIGHT * darker * darker + FLOOR_DEPTH * (1.0f - dim) * (1.0f - dim);
    least = on_floor && on_it < least ? on_it : least;

    const float uniform_ratio = plane[6 * PIXELS] - 0.5f * least;
    const int odds = place[(view * CELLS_Y + y / CELL) * CELLS_X + x / CELL];
    const char counts = in_counts(STEPS * uniform_ratio - (colours[colour_bin(colour)] + odds));
    ratios[ratio_place(view, x, y)] = in_picture(sizes, view, x, y) ? counts : (char)0;
}

// Evidence, by `table`, of a voxel that projects to a pixel: of the ratios of 3x3 pixels.
inline char evidence_of(__global const char *ratios, __global const int2 *sizes,
                        __global const char *table, int view, int x, int y)
{
    __global const char *corner = ratios + ratio_place(view, x - 1, y - 1);
    int sum = -9 * LOWEST;
#pragma unroll
    for (int row = 0; row < 3; ++row)
#pragma unroll
        for (int column = 0; column < 3; ++column) sum += corner[row * (WIDTH + 2) + column];
    const char counts = table[sum];
    return in_picture(sizes, view, x, y) ? counts : (char)0;
}

__kernel void silhouette(__global const char *restrict ratios, __global const int2 *restrict sizes,
                         __global const char *restrict table, __global char *restrict evidence)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    evidence[view * PIXELS + y * WIDTH + x] = evidence_of(ratios, sizes, table, view, x, y);
}

// Log ratio of a pixel of the rim: how well the background's colour mixed with the person's, not
// more than RIM_SHARE of it his, explains the pixel. The person is two pixels ahead, in one of
// eight directions, and the background as far behind, as `person`, the evidence at the pixel, has
// it. Less than LOWEST, if no direction is so. All pointers point to the pixel.
inline float mixed(__global const uchar *colour, __global const float *plane,
                   __global const char *person)
{
    const Colour w = planes_of(plane, 3);
    const Colour here = less(colour_of(colour), 1.0f, planes_of(plane, 0));
    float least = 1e9f;
#pragma unroll
    for (int direction = 0; direction < 9; ++direction) {
        const int step = 2 * (direction / 3 - 1) * WIDTH + 2 * (direction % 3 - 1);
        if (person[step] <= 0 || person[-step] >= 0) continue;
        const Colour ahead = less(colour_of(colour + 3 * step), 1.0f, planes_of(plane + step, 0));
        const float share = limit(fitting(w, here, ahead), 0.0f, RIM_SHARE);
        const float left = distance_left(w, here, share, ahead);
        least = left < least ? left : least;
    }
    return STEPS * (plane[6 * PIXELS] - RIM_COST - 0.5f * least);
}

// Gives the pixels of the person's rim that are mixed the ratios of `mixed`, where these are
// higher. `evidence` is that of the ratios as they came. `changed` says which cells have new
// ratios; it has a border of one cell.
__kernel void rim(__global const uchar *restrict images, __global const float *restrict background,
                  __global const char *restrict colours, __global const char *restrict place,
                  __global const char *restrict evidence, __global char *restrict ratios,
                  __global uchar *restrict changed)
{
    const int cell_x = get_global_id(0), cell_y = get_global_id(1), view = get_global_id(2);
    if (cell_x >= CELLS_X || cell_y >= CELLS_Y) return;
    __global const char *person = evidence + view * PIXELS;
    const int begin_x = max(CELL * cell_x, 2), end_x = min(CELL * cell_x + CELL, WIDTH - 2);
    const int begin_y = max(CELL * cell_y, 2), end_y = min(CELL * cell_y + CELL, HEIGHT - 2);
    const int odds = place[(view * CELLS_Y + cell_y) * CELLS_X + cell_x];
    int any = 0;
    for (int y = begin_y; y < end_y; ++y)
        for (int x = begin_x; x < end_x; ++x) {
            const int here = y * WIDTH + x;
            if (person[here] <= 0) continue;
            __global const uchar *colour = images + 3 * (view * PIXELS + here);
            const float ratio = mixed(colour, background + (size_t)view * 8 * PIXELS + here,
                                      person + here) - (colours[colour_bin(colour)] + odds);
            const char counts = in_counts(ratio);
            __global char *old = ratios + ratio_place(view, x, y);
            if (counts <= *old) continue;
            *old = counts;
            any = 1;
        }
    changed[(view * (CELLS_Y + 2) + cell_y + 1) * (CELLS_X + 2) + cell_x + 1] = any;
}

// The evidence once more, of the cells that are changed or have such neighbours.
__kernel void silhouette_again(__global const uchar *restrict changed,
                               __global const char *restrict ratios,
                               __global const int2 *restrict sizes,
                               __global const char *restrict table,
                               __global char *restrict evidence)
{
    const int cell_x = get_global_id(0), cell_y = get_global_id(1), view = get_global_id(2);
    if (cell_x >= CELLS_X || cell_y >= CELLS_Y) return;
    __global const uchar *corner =
        changed + (view * (CELLS_Y + 2) + cell_y) * (CELLS_X + 2) + cell_x;
    int any = 0;
#pragma unroll
    for (int row = 0; row < 3; ++row)
#pragma unroll
        for (int column = 0; column < 3; ++column) any |= corner[row * (CELLS_X + 2) + column];
    if (!any) return;
    const int end_x = min(CELL * cell_x + CELL, WIDTH), end_y = min(CELL * cell_y + CELL, HEIGHT);
    for (int y = CELL * cell_y; y < end_y; ++y)
        for (int x = CELL * cell_x; x < end_x; ++x)
            evidence[view * PIXELS + y * WIDTH + x] =
                evidence_of(ratios, sizes, table, view, x, y);
}

// Ready masks, 0..255; `table` holds the evidence of the 256 values.
__kernel void mask_silhouette(__global const uchar *restrict masks,
                              __global const int2 *restrict sizes,
                              __global const char *restrict table,
                              __global char *restrict evidence)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    const int at = view * PIXELS + y * WIDTH + x;
    evidence[at] = in_picture(sizes, view, x, y) ? table[masks[at]] : (char)0;
}
