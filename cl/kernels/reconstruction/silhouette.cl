// Silhouette likelihood maps, Song et al. eq. (1)-(2), as evidence counts (see psfs/silhouettes/config.py);
// twin: reference/silhouette.py. A work-item has PACK neighbouring pixels of a row; the last of a
// row begin earlier where its width is not a multiple.
// Defines: SHADOW_LOW, SHADOW_HIGH, FLOOR_LOW, LIT_VARIANCE and FLOOR_VARIANCE (of
// the light factor where the light is above FULLY_LIT, and in shadows), FLOOR_DEPTH (1 / variance
// of its shadows), RIM_SHARE, RIM_COST (nats), RIM_CHROMA (1 / the chroma's share of the luma's
// variance) and whether there is a RIM at all, STEPS (counts of log ratio per nat), LOWEST and HIGHEST (counts), BINS of a colour
// channel; CELL (px); PACK; SPAN (px), SUM_REACH (px, 0 or 1), SMOOTH_REACH
// (px, 0 to 2), CONTRAST (1 / grey levels^2).
#if !defined(BINS) || !defined(CELL) || \
    !defined(FLOOR_DEPTH) || !defined(FLOOR_LOW) || !defined(CONTRAST) || !defined(SMOOTH_REACH) || !defined(FLOOR_VARIANCE) || \
    !defined(FULLY_LIT) || !defined(LIT_VARIANCE) || !defined(PACK) || !defined(RIM) || !defined(RIM_CHROMA) || !defined(RIM_COST) || \
    !defined(RIM_SHARE) || !defined(SHADOW_HIGH) || !defined(SHADOW_LOW) || \
    !defined(SPAN) || !defined(STEPS) || !defined(SUM_REACH)
#error "reconstruction/silhouette.cl needs BINS, CELL, CONTRAST, FLOOR_DEPTH, FLOOR_LOW, FLOOR_VARIANCE, FULLY_LIT, LIT_VARIANCE, PACK, RIM, RIM_CHROMA, RIM_COST, RIM_SHARE, SHADOW_HIGH, SHADOW_LOW, SMOOTH_REACH, SPAN, STEPS and SUM_REACH"
#endif
#include "reconstruction/background.h"
#include "reconstruction/cells.h"
#include "reconstruction/ratios.h"

// The first pixel of a pack.
#define PACK_BEGIN(index) ((index) * PACK < WIDTH - PACK ? (index) * PACK : WIDTH - PACK)

// Are the pixels inside the picture of their view, which may be smaller than the stack of views?
static inline vint in_picture(__global const int2 *sizes, int view, int x, int y)
{
    const int2 size = sizes[view];
    return x + LANE_NUMBERS < (y < size.y ? size.x : 0);
}

// Cells of a row that a pack may lie in, and those whose middles are around it.
#define PACK_CELLS ((CELL + PACK - 2) / CELL + 1)
#define PACK_MIDDLES ((2 * PACK + 2 * CELL - 3) / (2 * CELL) + 2)

// What a row of cells has for the pixels from column x on.
static inline vint by_cell(int2 picture, __global const char *cells, int x)
{
    const vint cell = (x % CELL + LANE_NUMBERS) / CELL;
    vint values = 0;
#pragma unroll
    for (int k = 0; k < PACK_CELLS; ++k) {
        const int value = cells[x / CELL + k < CELLS_X ? x / CELL + k : CELLS_X - 1];
        values = cell == k ? value : values;
    }
    return values;
}

// What a map of cells has for the pixels from (x, y) on, linearly between the cells' middles, times
// (2 * CELL)^2. `cells` has a border of one cell; the lowest bit of its values is left out.
static inline vint between_cells(int2 picture, __global const uchar *cells, int x, int y)
{
    const int u = 2 * x - (CELL - 1) + 2 * CELL, v = 2 * y - (CELL - 1) + 2 * CELL;
    const int column = u / (2 * CELL), below = v % (2 * CELL);
    __global const uchar *row = cells + v / (2 * CELL) * (CELLS_X + 2);
    const vint place = u % (2 * CELL) + 2 * LANE_NUMBERS;
    vint sum = 0;
#pragma unroll
    for (int k = 0; k < PACK_MIDDLES; ++k) {
        const int at = column + k < CELLS_X + 1 ? column + k : CELLS_X + 1;
        const int value = (2 * CELL - below) * (row[at] & 254) +
                          below * (row[CELLS_X + 2 + at] & 254);
        const vint away = place < 2 * CELL * k ? 2 * CELL * k - place : place - 2 * CELL * k;
        sum += away < 2 * CELL ? (2 * CELL - away) * value : 0;
    }
    return sum;
}

// What the table has for the pixels' colours.
static inline vint by_colour(__global const char *table, Colour c)
{
    const vint b = TO_INT(c.b) * BINS >> 8, g = TO_INT(c.g) * BINS >> 8, r = TO_INT(c.r) * BINS >> 8;
    return look_up(table, (b * BINS + g) * BINS + r);
}

static inline vfloat luma_of(Colour c) { return 0.114f * c.b + 0.587f * c.g + 0.299f * c.r; }

// Log of the background's density over the foreground's, in counts of 1 / STEPS nats.
// `background` holds, per view, planes of floats: mean of the channels (3), 1 / sigma^2 of the
// channels (3), log of the background's peak density over the uniform foreground's, 1 / variance
// of the light factor. `colours` holds the log of the foreground's density over the uniform one,
// `location` the log odds of foreground by cell; both in counts; `floor_light` that of floor_light.cl,
// `light` that of light.cl. `ratios` has a border of one pixel. `luma` is that of the pictures.
__kernel void log_ratio(int2 picture, __global const uchar *restrict images,
                        __global const float *restrict background,
                        __global const int2 *restrict sizes,
                        __global const char *restrict colours,
                        __global const char *restrict location,
                        __global const uchar *restrict floor_light,
                        __global const float *restrict light,
                        __global char *restrict ratios, __global uchar *restrict luma)
{
    const int x = PACK_BEGIN((int)get_global_id(0)), y = get_global_id(1), view = get_global_id(2);
    if (get_global_id(0) * PACK >= WIDTH || y >= HEIGHT) return;
    const int pixel = y * WIDTH + x;
    __global const uchar *colour = images + 3 * (view * PIXELS + pixel);
    __global const float *plane = background + (size_t)view * 8 * PIXELS + pixel;
    __global const float *own = light + LIGHT_FLOATS * view;
    const Colour shown = colour_of(colour), mean = lit_planes(picture, own, plane, x, y);
    const Colour w = weight_in(own, planes_of(picture, plane, 3));

    // Squared distances to the background's colour in plain light; under less light; and, on the
    // floor, instead of that under the light that other cameras see, in between cells linearly.
    const vfloat factor = fitting(w, shown, mean);
    const vfloat plain = distance_left(w, shown, 1.0f, mean);

    const vfloat alpha = within(factor, SHADOW_LOW, SHADOW_HIGH);
    const vfloat shaded = distance_left(w, shown, alpha, mean) +
                          LOAD_PACK(plane + 7 * PIXELS) * (1.0f - alpha) * (1.0f - alpha);

    __global const uchar *lights = floor_light + view * (CELLS_Y + 2) * (CELLS_X + 2);
    __global const uchar *floors = lights + (y / CELL + 1) * (CELLS_X + 2) + 1;
    const vint on_floor = (by_cell(picture, (__global const char *)floors, x) & 1) == 1;
    const vfloat seen = TO_FLOAT(between_cells(picture, lights, x, y)) * (1.0f / (4 * CELL * CELL * 254));
    const vfloat dim = within(factor, FLOOR_LOW, SHADOW_HIGH);
    const vfloat off = seen - dim, noise = 1.0f / (weighed(w, mean, mean) + 1e-6f);
    const vfloat variance = seen > FULLY_LIT ? LIT_VARIANCE : FLOOR_VARIANCE + noise;
    const vfloat on_it = distance_left(w, shown, dim, mean) + off * off / variance +
                         FLOOR_DEPTH * (1.0f - dim) * (1.0f - dim);
    const vfloat nearest = least(plain, on_floor ? on_it : shaded);

    const vfloat uniform_ratio = LOAD_PACK(plane + 6 * PIXELS) - own[10] - 0.5f * nearest;
    const int cells = (view * CELLS_Y + y / CELL) * CELLS_X;
    const vint known = by_colour(colours, shown) + by_cell(picture, location + cells, x);
    const vchar counts = in_counts(STEPS * uniform_ratio - TO_FLOAT(known));
    STORE_PACK(TO_CHAR(in_picture(sizes, view, x, y) ? TO_INT(counts) : 0),
               ratios + ratio_place(picture, view, x, y));
    STORE_PACK(TO_BYTES(luma_of(shown) + 0.5f), luma + view * PIXELS + pixel);
}

// Evidence, by `table`, of voxels that project to the pixels: of the ratios of 3x3 pixels each, or
// of nine times the pixel's own.
static inline vchar evidence_of(int2 picture, __global const char *ratios,
                                __global const int2 *sizes, __global const char *table, int view, int x, int y)
{
    __global const char *middle = ratios + ratio_place(picture, view, x, y);
    vint sum = -9 * LOWEST;
#pragma unroll
    for (int row = -1; row <= 1; ++row)
#pragma unroll
        for (int column = -1; column <= 1; ++column)
            sum += TO_INT(LOAD_PACK(middle + SUM_REACH * (row * (WIDTH + 2) + column)));
    const vint counts = look_up(table, sum);
    return TO_CHAR(in_picture(sizes, view, x, y) ? counts : 0);
}

// Blocks of the picture: as high as a cell, as wide as a cell or a pack; and spans of SPAN pixels, a
// whole number of blocks.
#define SPANS_X ((WIDTH + SPAN - 1) / SPAN)
#define BLOCK (CELL > PACK ? CELL : PACK)
#define BLOCKS_X ((WIDTH + BLOCK - 1) / BLOCK)

// Where the span that has a pixel lies in the maps of spans.
static inline int span_place(int2 picture, int view, int x, int y)
{
    return (view * (CELLS_Y + 2) + y / CELL + 1) * (SPANS_X + 2) + x / SPAN + 1;
}

// Evidence of the pixels. Clears `shown`, if there is one: which spans show foreground, see `rim`.
__kernel void silhouette(int2 picture, __global const char *restrict ratios, __global const int2 *restrict sizes,
                         __global const char *restrict table, __global char *restrict evidence,
                         __global uchar *restrict shown)
{
    const int x = PACK_BEGIN((int)get_global_id(0)), y = get_global_id(1), view = get_global_id(2);
    const int begin = get_global_id(0) * PACK;
    if (begin >= WIDTH || y >= HEIGHT) return;
    if (shown && begin % SPAN == 0 && y % CELL == 0) shown[span_place(picture, view, begin, y)] = 0;
    STORE_PACK(evidence_of(picture, ratios, sizes, table, view, x, y),
               evidence + view * PIXELS + y * WIDTH + x);
}

// Luma and, beside it, the chroma of a difference of colours.
typedef struct { vfloat y, b, r; } Chroma;

static inline Chroma chroma_of(Colour c)
{
    const vfloat y = luma_of(c);
    return (Chroma){y, c.b - y, c.r - y};
}

// Log ratio of pixels of the rim: how well the background's colour mixed with the person's, not
// more than RIM_SHARE of its luma his and any share of its chroma, which videos have blurred,
// explains the pixel. The person is two pixels ahead, in one of eight directions, and the background
// as far behind, as `person`, the evidence at the pixel, has it. Less than LOWEST, if no direction
// is so. All pointers point to the pixel (x, y), but for that to the view's `light`.
static inline vfloat mixed(int2 picture, __global const uchar *colour,
                           __global const float *plane, __global const char *person, __global const float *light, int x, int y)
{
    const vfloat weight = light[9] * LOAD_PACK(plane + 4 * PIXELS);
    const Chroma here = chroma_of(less(colour_of(colour), 1.0f, lit_planes(picture, light, plane, x, y)));
    vfloat nearest = 1e9f;
#pragma unroll
    for (int direction = 0; direction < 9; ++direction) {
        const int dx = 2 * (direction % 3 - 1), dy = 2 * (direction / 3 - 1);
        const int step = dy * WIDTH + dx;
        const vint on_rim =
            (TO_INT(LOAD_PACK(person + step)) > 0) & (TO_INT(LOAD_PACK(person - step)) < 0);
        if (!PACK_ANY(on_rim)) continue;
        const Chroma ahead =
            chroma_of(less(colour_of(colour + 3 * step), 1.0f,
                           lit_planes(picture, light, plane + step, x + dx, y + dy)));
        const vfloat luma = within(here.y * ahead.y / (ahead.y * ahead.y + 1e-3f), 0.0f, RIM_SHARE);
        const vfloat chroma = within((here.b * ahead.b + here.r * ahead.r) /
                                         (ahead.b * ahead.b + ahead.r * ahead.r + 1e-3f),
                                     0.0f, 1.0f);
        const vfloat grey = here.y - luma * ahead.y;
        const vfloat b = here.b - chroma * ahead.b, r = here.r - chroma * ahead.r;
        const vfloat left = weight * (grey * grey + RIM_CHROMA * (b * b + r * r));
        nearest = (on_rim & (left < nearest)) ? left : nearest;
    }
    return STEPS * (LOAD_PACK(plane + 6 * PIXELS) - light[10] - RIM_COST - 0.5f * nearest);
}

// Gives the pixels of the person's rim that are mixed the ratios of `mixed`, where these are
// higher; without a RIM it only finds the spans. `evidence` is that of the ratios as they came. `shown` is 1 for spans with foreground, and
// has a border of one; the picture's outermost two pixels do not count.
__kernel void rim(int2 picture, __global const uchar *restrict images, __global const float *restrict background,
                  __global const char *restrict colours, __global const char *restrict location,
                  __global const char *restrict evidence, __global const float *restrict light,
                  __global char *restrict ratios, __global uchar *restrict shown)
{
    const int block_x = get_global_id(0), block_y = get_global_id(1), view = get_global_id(2);
    if (block_x >= BLOCKS_X || block_y >= CELLS_Y) return;
    const int begin_x = max(BLOCK * block_x, 2), end_x = min(BLOCK * block_x + BLOCK, WIDTH - 2);
    const int begin_y = max(CELL * block_y, 2), end_y = min(CELL * block_y + CELL, HEIGHT - 2);
    const int cells = (view * CELLS_Y + block_y) * CELLS_X;
    int any = 0;
    for (int y = begin_y; y < end_y; ++y)
        for (int first = begin_x; first < end_x; first += PACK) {
            const int x = first < WIDTH - 2 - PACK ? first : WIDTH - 2 - PACK;
            const int here = view * PIXELS + y * WIDTH + x;
            const vint column = x + LANE_NUMBERS;
            const vint asked = (column >= first) & (column < end_x) &
                               (TO_INT(LOAD_PACK(evidence + here)) > 0);
            if (!PACK_ANY(asked)) continue;
            any = 1;
            if (!RIM) break;
            __global const uchar *colour = images + 3 * here;
            const vfloat ratio = mixed(picture, colour, background + (size_t)(7 * view) * PIXELS + here,
                                       evidence + here, light + LIGHT_FLOATS * view, x, y) -
                                 TO_FLOAT(by_colour(colours, colour_of(colour)) +
                                          by_cell(picture, location + cells, x));
            __global char *old = ratios + ratio_place(picture, view, x, y);
            const vchar counts = in_counts(ratio);
            const vint better = asked & (TO_INT(counts) > TO_INT(LOAD_PACK(old)));
            if (!PACK_ANY(better)) continue;
            // One by one: other pixels of the pack may be another work-item's.
            char values[PACK];
            int taken[PACK];
            STORE_PACK(counts, values);
            STORE_PACK(better, taken);
            for (int k = 0; k < PACK; ++k)
                if (taken[k]) old[k] = values[k];
        }
    if (any) shown[span_place(picture, view, BLOCK * block_x, CELL * block_y)] = 1;
}

// Does the span of a pixel or one of its neighbours show foreground?
static inline int near_foreground(int2 picture, __global const uchar *shown, int view, int x, int y)
{
    __global const uchar *corner = shown + span_place(picture, view, x, y) - (SPANS_X + 2) - 1;
    int near = 0;
#pragma unroll
    for (int row = 0; row < 3; ++row)
#pragma unroll
        for (int column = 0; column < 3; ++column) near |= corner[row * (SPANS_X + 2) + column];
    return near;
}

// The evidence once more, near foreground: of the ratios of all pixels within SMOOTH_REACH, as far
// as they look like this one: weighed with 1 / (1 + CONTRAST d^2)^2 by how far their luma differs.
__kernel void smoothed_evidence(int2 picture, __global const uchar *restrict shown,
                             __global const char *restrict ratios,
                             __global const uchar *restrict luma,
                             __global const int2 *restrict sizes,
                             __global const char *restrict table, __global char *restrict evidence)
{
    const int y = get_global_id(1), view = get_global_id(2), first = 2 + get_global_id(0) * PACK;
    if (first >= WIDTH - 2 || y < 2 || y >= HEIGHT - 2) return;
    const int x = first < WIDTH - 2 - PACK ? first : WIDTH - 2 - PACK;
    const int left = near_foreground(picture, shown, view, x, y);
    const int right = near_foreground(picture, shown, view, x + PACK - 1, y);
    if (!(left | right)) return;
    __global const uchar *light = luma + view * PIXELS + y * WIDTH + x;
    __global const char *ratio = ratios + ratio_place(picture, view, x, y);
    const vfloat here = TO_FLOAT(LOAD_PACK(light));
    vfloat sum = 0.0f, weights = 0.0f;
#pragma unroll
    for (int row = -SMOOTH_REACH; row <= SMOOTH_REACH; ++row)
#pragma unroll
        for (int column = -SMOOTH_REACH; column <= SMOOTH_REACH; ++column) {
            const vfloat off = TO_FLOAT(LOAD_PACK(light + row * WIDTH + column)) - here;
            const vfloat unlike = 1.0f + CONTRAST * off * off;
            const vfloat weight = 1.0f / (unlike * unlike);
            sum += weight * TO_FLOAT(LOAD_PACK(ratio + row * (WIDTH + 2) + column));
            weights += weight;
        }
    const vint place = TO_INT(9.0f * (sum / weights) - 9 * LOWEST + 0.5f);
    const vint counts = look_up(table, place);
    __global char *out = evidence + view * PIXELS + y * WIDTH + x;
    const vint leftmost = (x + LANE_NUMBERS) / SPAN == x / SPAN;
    const vint near = (leftmost ? (vint)left : (vint)right) > 0;
    const vint found = in_picture(sizes, view, x, y) ? counts : 0;
    STORE_PACK(TO_CHAR(near ? found : TO_INT(LOAD_PACK(out))), out);
}

// Ready masks, 0..255; `table` holds the evidence of the 256 values.
__kernel void mask_silhouette(int2 picture, __global const uchar *restrict masks,
                              __global const int2 *restrict sizes,
                              __global const char *restrict table,
                              __global char *restrict evidence)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= WIDTH || y >= HEIGHT) return;
    const int at = view * PIXELS + y * WIDTH + x;
    const int2 size = sizes[view];
    evidence[at] = ((x < size.x) & (y < size.y)) ? table[masks[at]] : (char)0;
}
