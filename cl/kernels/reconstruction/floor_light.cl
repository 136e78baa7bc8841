// The light on the floor, as other cameras see it; twin: reference/silhouette.py.
// Defines: SHADOW_HIGH, FLOOR_LIT, FLOOR_LEFT (squared distance),
// FLOOR_ENOUGH (cameras);
// CELL (px).
#if !defined(CAMERA_FLOATS) || !defined(CELL) || !defined(FLOOR_ENOUGH) || !defined(FLOOR_LEFT) || !defined(FLOOR_LIT) || !defined(SHADOW_HIGH)
#error "reconstruction/floor_light.cl needs CAMERA_FLOATS, CELL, FLOOR_ENOUGH, FLOOR_LEFT, FLOOR_LIT and SHADOW_HIGH"
#endif
#include "reconstruction/background.h"
#include "reconstruction/cells.h"
#include "common/camera.h"

// Light factor that explains the colour of pixel (x, y) of the background best, and in *left the squared
// distance that it leaves. `images`, `background` and `light` are those of all views.
INLINED float light_factor(int2 picture, __global const uchar *images,
                           __global const float *background, __global const float *light, int view,
                           int x, int y, float *left)
{
    const int pixel = y * WIDTH + x;
    __global const float *plane = background + (size_t)view * 8 * PIXELS + pixel;
    __global const float *own = light + LIGHT_FLOATS * view;
    const Colour shown = colour_of(images + 3 * (view * PIXELS + pixel));
    const Colour mean = lit_planes(picture, own, plane, x, y);
    const Colour w = weight_in(own, planes_of(picture, plane, 3));
    const float alpha = fitting(w, shown, mean);
    *left = distance_left(w, shown, alpha, mean);
    return alpha;
}

// The light on the floor behind every cell, as the other cameras have it that see there what the
// cell's middle shows: of their light factors the one second nearest to the middle's, the nearest
// if fewer than FLOOR_ENOUGH have a say; in steps of 1 / 127, times 2, plus 1 where there is floor
// at all. A shadow looks alike to all who see it; shoes before a shadow hide another piece of floor
// from every camera. A camera whose pixel cannot be floor, shaded or not, has no say, and where
// nobody has the floor is lit. A cell whose middle shows the floor lit asks nobody.
// `points` holds the floor behind a cell (x, y), NaN if there is none. `floor_light` has a border of
// one cell, which repeats the outermost; `light` is that of light.cl.
__kernel void floor_light(int2 picture, float floor, __global const float *restrict cameras,
                          __global const float2 *restrict points,
                          __global const uchar *restrict images,
                          __global const float *restrict background,
                          __global const float *restrict light,
                          __global uchar *restrict floor_light)
{
    const int column = get_global_id(0), row = get_global_id(1), view = get_global_id(2);
    if (column >= CELLS_X + 2 || row >= CELLS_Y + 2) return;
    const int x = column < 1 ? 0 : column > CELLS_X ? CELLS_X - 1 : column - 1;
    const int y = row < 1 ? 0 : row > CELLS_Y ? CELLS_Y - 1 : row - 1;
    const float2 point = points[(view * CELLS_Y + y) * CELLS_X + x];
    const int at = (view * (CELLS_Y + 2) + row) * (CELLS_X + 2) + column;
    if (point.x != point.x) {
        floor_light[at] = 2 * 127;
        return;
    }
    const int middle_x = CELL * x + CELL / 2 < WIDTH ? CELL * x + CELL / 2 : WIDTH - 1;
    const int middle_y = CELL * y + CELL / 2 < HEIGHT ? CELL * y + CELL / 2 : HEIGHT - 1;
    float left;
    const float own =
        light_factor(picture, images, background, light, view, middle_x, middle_y, &left);
    const int asks = own <= FLOOR_LIT || left >= FLOOR_LEFT;
    int asked = 0;
    float nearest = 1.0f, second = 1.0f, nearest_off = 1e9f, second_off = 1e9f;
    for (int other = 0; asks && other < (int)get_global_size(2); ++other) {
        if (other == view) continue;
        __global const float *camera = cameras + other * CAMERA_FLOATS;
        float2 pixel;
        const float depth = camera_project(camera, point.x, point.y, floor, &pixel);
        if (depth <= 0.0f || camera_offset(camera, pixel, WIDTH) < 0) continue;
        const float alpha = light_factor(picture, images, background, light, other,
                                         (int)(pixel.x + 0.5f), (int)(pixel.y + 0.5f), &left);
        if (left >= FLOOR_LEFT || alpha >= SHADOW_HIGH) continue;
        ++asked;
        const float off = alpha > own ? alpha - own : own - alpha;
        if (off < nearest_off) {
            second = nearest;
            second_off = nearest_off;
            nearest = alpha;
            nearest_off = off;
        } else if (off < second_off) {
            second = alpha;
            second_off = off;
        }
    }
    const float agreed = asked >= FLOOR_ENOUGH ? second : nearest;
    const int steps = (int)(127.0f * within(agreed, 0.0f, 1.0f) + 0.5f);
    floor_light[at] = 2 * steps + 1;
}
