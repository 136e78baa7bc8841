// Where the pictures have contours, and in which direction; twin: reference/likelihood/contour.py.
// An item works on STRIP pixels of a row: most strips show nobody, and are left at once; the others
// are vectors. What lies within MARGIN pixels of the border (OUTER_MARGIN of contours) stays 0.
// Defines: ANYWHERE on a CPU; DIAGONAL_REACH, HIDDEN, MARGIN, OUTER_MARGIN, REACH, STRIP = 8.
#if !defined(DIAGONAL_REACH) || !defined(HIDDEN) || !defined(MARGIN) || !defined(OUTER_MARGIN) || !defined(REACH) || \
    !defined(STRIP)
#error "tracking/contour.cl needs DIAGONAL_REACH, HIDDEN, MARGIN, OUTER_MARGIN, REACH and STRIP"
#endif

// Vectors at any place. PoCL's vload and vstore take one number after the other; a GPU may not take
// more than those do.
#ifdef ANYWHERE
typedef uchar16 uchar16_anywhere __attribute__((aligned(1)));
typedef uchar8 uchar8_anywhere __attribute__((aligned(1)));
typedef short8 short8_anywhere __attribute__((aligned(2)));
#define LOAD_UCHAR16(place) (*(__global const uchar16_anywhere *)(place))
#define LOAD_SHORT8(place) (*(__global const short8_anywhere *)(place))
#define STORE_SHORT8(value, place) (*(__global short8_anywhere *)(place) = (value))
#define STORE_UCHAR8(value, place) (*(__global uchar8_anywhere *)(place) = (value))
#else
#define LOAD_UCHAR16(place) vload16(0, place)
#define LOAD_SHORT8(place) vload8(0, place)
#define STORE_SHORT8(value, place) vstore8(value, 0, place)
#define STORE_UCHAR8(value, place) vstore8(value, 0, place)
#endif

// The length of a diagonal normal, in 256ths.
#define DIAGONAL 181

// Pixels that the Sobel operator looks at beside a strip's.
#define ROW (STRIP + 4)

// Which pixels of a strip of maps (.., 2) are hidden, see hidden.cl: -1, else 0.
static inline short8 hidden_in(__global const uchar *maps, size_t at)
{
    const uchar8 silhouette = LOAD_UCHAR16(maps + 2 * at).even;
    return convert_short8(((silhouette ^ silhouette >> (uchar8)7) & (uchar8)1) != (uchar8)0);
}

// Is this item beyond the end of its row, or beyond the last row?
static inline bool is_outside(int width, int height, int margin)
{
    return margin + STRIP * (int)get_global_id(0) >= width - margin ||
           margin + (int)get_global_id(1) >= height - margin;
}

// The first pixel of this item's strip; the last one of a row overlaps the one before.
static inline int strip_of(int width, int margin)
{
    return min(margin + STRIP * (int)get_global_id(0), width - margin - STRIP);
}

// Which pixels of a strip of maps (.., 2) show a silhouette or its edge: -1, else 0.
static inline short8 shown_in(__global const uchar *maps, size_t at)
{
    const uchar16 both = LOAD_UCHAR16(maps + 2 * at);
    return convert_short8((both.even | both.odd) != (uchar8)0);
}

// Derivatives along x and y (V, 2, H, W), by the Sobel operator of 5 x 5 pixels, of the grey values
// (ITU-R BT.601, in 256ths) of pictures (V, H, W, 3) BGR where maps (V, H, W, 2) show a silhouette
// or its edge; 0 elsewhere.
__kernel void differentiate(int width, int height, __global const uchar *maps,
                            __global const uchar *pictures, __global short *gradients)
{
    if (is_outside(width, height, MARGIN)) return;
    const int x = strip_of(width, MARGIN), y = (int)get_global_id(1) + MARGIN;
    const size_t view = get_global_id(2), size = (size_t)width * height;
    const size_t within = (size_t)y * width + x, at = view * size + within;
    const short8 shown = shown_in(maps, at);
    short along[STRIP] = {0}, down[STRIP] = {0};
    if (any(shown)) {
        const short smooth[5] = {1, 4, 6, 4, 1}, derive[5] = {-1, -2, 0, 2, 1};
        short smoothed[ROW] = {0}, derived[ROW] = {0};
        for (int j = 0; j < 5; ++j) {
            __global const uchar *row = pictures + 3 * (at - 2 + (size_t)(j * width) - 2 * width);
            for (int i = 0; i < ROW; ++i) {
                const short grey =
                    (29 * row[3 * i] + 150 * row[3 * i + 1] + 77 * row[3 * i + 2]) >> 8;
                smoothed[i] += smooth[j] * grey;
                derived[i] += derive[j] * grey;
            }
        }
        for (int i = 0; i < STRIP; ++i)
            for (int k = 0; k < 5; ++k) {
                along[i] += derive[k] * smoothed[i + k];
                down[i] += smooth[k] * derived[i + k];
            }
    }
    __global short *to = gradients + 2 * view * size + within;
    STORE_SHORT8(vload8(0, along) & shown, to);
    STORE_SHORT8(vload8(0, down) & shown, to + size);
}

// Contours (V, 4, H, W): the largest derivative along each of four normals, (1, 0), (1, 1), (0, 1)
// and (-1, 1), within REACH of the pixel along that normal, or DIAGONAL_REACH diagonal steps; 255 at
// `contrast` and beyond, HIDDEN where furniture is before the body.
__kernel void find_contours(int width, int height, int contrast, __global const uchar *maps,
                            __global const short *gradients, __global uchar *contours)
{
    if (is_outside(width, height, OUTER_MARGIN)) return;
    const int x = strip_of(width, OUTER_MARGIN), y = (int)get_global_id(1) + OUTER_MARGIN;
    const size_t view = get_global_id(2), size = (size_t)width * height;
    const size_t within = (size_t)y * width + x;
    const short8 shown = shown_in(maps, view * size + within);
    __global uchar *to = contours + 4 * view * size + within;
    if (!any(shown)) {
        for (int normal = 0; normal < 4; ++normal) STORE_UCHAR8((uchar8)0, to + normal * size);
        return;
    }
    __global const short *along = gradients + 2 * view * size + within, *down = along + size;
    ushort8 level = 0, falling = 0, upright = 0, rising = 0;
    for (int step = -REACH; step <= REACH; ++step) {
        level = max(level, abs(LOAD_SHORT8(along + step)));
        upright = max(upright, abs(LOAD_SHORT8(down + step * width)));
    }
    for (int step = -DIAGONAL_REACH; step <= DIAGONAL_REACH; ++step) {
        const int fall = step * (width + 1), rise = step * (width - 1);
        falling = max(falling, abs(LOAD_SHORT8(along + fall) + LOAD_SHORT8(down + fall)));
        rising = max(rising, abs(LOAD_SHORT8(down + rise) - LOAD_SHORT8(along + rise)));
    }
    const short8 hidden = hidden_in(maps, view * size + within);
    const int8 kept = convert_int8(shown & ~hidden), instead = convert_int8(hidden) & HIDDEN;
    const int scale = (255 << 16) / contrast + 1;
#define VALUE(slope) convert_uchar8((min(slope, (int8)(contrast)) * scale >> 16 & kept) | instead)
    STORE_UCHAR8(VALUE(convert_int8(level)), to);
    STORE_UCHAR8(VALUE(convert_int8(falling) * DIAGONAL >> 8), to + size);
    STORE_UCHAR8(VALUE(convert_int8(upright)), to + 2 * size);
    STORE_UCHAR8(VALUE(convert_int8(rising) * DIAGONAL >> 8), to + 3 * size);
#undef VALUE
}
