// Where the pictures have contours, and in which direction; twin: reference/likelihood/contour.py.
// Defines: REACH, pixels that a contour is looked for to either side, and DIAGONAL_REACH, diagonal
// steps that are about as far.
#if !defined(DIAGONAL_REACH) || !defined(REACH)
#error "tracking/contour.cl needs DIAGONAL_REACH and REACH"
#endif

// Grey value of a BGR pixel, by ITU-R BT.601 in 256ths.
inline int grey_of(__global const uchar *pictures, size_t at)
{
    const uchar3 colour = vload3(at, pictures);
    return (29 * colour.x + 150 * colour.y + 77 * colour.z) >> 8;
}

// Derivatives along x and y (V, H, W, 2), by the Sobel operator of 5 x 5 pixels, of the grey values
// of pictures (V, H, W, 3) BGR where maps (V, H, W, 2) show a silhouette or its edge; 0 elsewhere.
__kernel void differentiate(int n_views, int width, int height, __global const uchar *maps,
                            __global const uchar *pictures, __global short2 *gradients)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= width || y >= height) return;
    const size_t first = (size_t)view * width * height, at = first + (size_t)y * width + x;
    int along_x = 0, along_y = 0;
    if (maps[2 * at] > 0 || maps[2 * at + 1] > 0) {
        const int smooth[5] = {1, 4, 6, 4, 1}, derive[5] = {-1, -2, 0, 2, 1};
        for (int j = 0; j < 5; ++j)
            for (int i = 0; i < 5; ++i) {
                const int column = clamp(x + i - 2, 0, width - 1);
                const int row = clamp(y + j - 2, 0, height - 1);
                const int grey = grey_of(pictures, first + (size_t)row * width + column);
                along_x += grey * derive[i] * smooth[j];
                along_y += grey * smooth[i] * derive[j];
            }
    }
    gradients[at] = (short2)(along_x, along_y);
}

// Contours (V, H, W, 4): the largest derivative along each of four normals, (1, 0), (1, 1), (0, 1)
// and (-1, 1), within REACH of the pixel along that normal; 255 at `contrast` and beyond.
__kernel void find_contours(int n_views, int width, int height, int contrast,
                            __global const uchar *maps, __global const short2 *gradients,
                            __global uchar4 *contours)
{
    const int x = get_global_id(0), y = get_global_id(1), view = get_global_id(2);
    if (x >= width || y >= height) return;
    const size_t first = (size_t)view * width * height, at = first + (size_t)y * width + x;
    int4 largest = 0;
    if (maps[2 * at] > 0 || maps[2 * at + 1] > 0)
        for (int step = -REACH; step <= REACH; ++step) {
            const int column = clamp(x + step, 0, width - 1);
            const int row = clamp(y + step, 0, height - 1);
            const int across = gradients[first + (size_t)y * width + column].x;
            const int down = gradients[first + (size_t)row * width + x].y;
            largest.s02 = max(largest.s02, (int2)(abs(across), abs(down)));
            if (abs(step) > DIAGONAL_REACH) continue;
            const int back = clamp(x - step, 0, width - 1);
            const short2 falling = gradients[first + (size_t)row * width + column];
            const short2 rising = gradients[first + (size_t)row * width + back];
            // 181 / 256: the length of a diagonal normal.
            const int one = (int)abs(falling.x + falling.y) * 181 >> 8;
            const int other = (int)abs(rising.y - rising.x) * 181 >> 8;
            largest.s13 = max(largest.s13, (int2)(one, other));
        }
    contours[at] = convert_uchar4(min(largest, contrast) * 255 / contrast);
}
