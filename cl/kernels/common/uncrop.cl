// Whole pictures from one part of each that was kept; beside it they go on as at its rim. Twin:
// apf/reference/likelihood/voxel.py.
// Defines: CHANNELS, bytes of a pixel, 1 or 3; LANES, items of a row, a work-group.
#if !defined(CHANNELS) || !defined(LANES)
#error "common/uncrop.cl needs CHANNELS and LANES"
#endif

// parts: (V, 5) first row and column, rows and columns, place of the part in `kept`: (h, w) bytes,
// and behind them, where CHANNELS is 3, (h, w, 3). whole: (V, H, width, CHANNELS).
__kernel __attribute__((reqd_work_group_size(LANES, 1, 1)))
void uncrop(int width, __global const int *restrict parts, __global const uchar *restrict kept,
            __global uchar *restrict whole)
{
    const int lane = get_local_id(0), y = get_global_id(1), view = get_global_id(2);
    __global const int *part = parts + 5 * view;
    const int left = part[1], n_columns = part[3], right = left + n_columns;
    __global const uchar *from = kept + part[4] + (CHANNELS > 1 ? part[2] * n_columns : 0);
    from += CHANNELS * n_columns * clamp(y - part[0], 0, part[2] - 1);
    __global const uchar *last = from + CHANNELS * (n_columns - 1);
    __global uchar *to = whole + CHANNELS * ((size_t)view * get_global_size(1) + y) * width;
    for (int x = lane; x < left; x += LANES)
        for (int c = 0; c < CHANNELS; ++c) to[CHANNELS * x + c] = from[c];
    for (int at = lane; at < CHANNELS * n_columns; at += LANES) to[CHANNELS * left + at] = from[at];
    for (int x = right + lane; x < width; x += LANES)
        for (int c = 0; c < CHANNELS; ++c) to[CHANNELS * x + c] = last[c];
}
