// Pixels where furniture hides what is behind it; twin: reference/reprojection.py. An item has LOT pixels,
// of which most lots are left at once.
// Defines: LOT, 16; UNKNOWN, the evidence count of a pixel that says nothing.
#if !defined(LOT) || !defined(UNKNOWN)
#error "reconstruction/hidden.cl needs LOT and UNKNOWN"
#endif
#if LOT != 16
#error "hidden.cl: lots are vectors of 16"
#endif

// Makes the evidence of hidden pixels unknown, where it is not for the foreground.
__kernel void hide(int n_pixels, __global const uchar *restrict hidden,
                   __global char *restrict evidence)
{
    const int first = LOT * get_global_id(0), n = min(LOT, n_pixels - first);
    if (n <= 0 || (n == LOT && !any(vload16(0, hidden + first) != (uchar16)0))) return;
    for (int at = first; at < first + n; ++at)
        if (hidden[at] && evidence[at] <= 0) evidence[at] = UNKNOWN;
}
