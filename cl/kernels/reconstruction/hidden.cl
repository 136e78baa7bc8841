// Pixels where furniture hides what is behind it; twin: reference/hidden.py.
// Defines: UNKNOWN, the evidence count of a pixel that says nothing.
#if !defined(UNKNOWN)
#error "reconstruction/hidden.cl needs UNKNOWN"
#endif

// Makes the evidence of hidden pixels unknown, where it is not for the foreground.
__kernel void hide(int n_pixels, __global const uchar *restrict hidden,
                   __global char *restrict evidence)
{
    const int at = get_global_id(0);
    if (at >= n_pixels || !hidden[at]) return;
    if (evidence[at] <= 0) evidence[at] = UNKNOWN;
}

// Turns the lowest bit of the silhouettes, the first channel of maps, where the evidence is unknown.
__kernel void mark_hidden(int n_pixels, __global const char *restrict evidence,
                          __global uchar *restrict maps)
{
    const int at = get_global_id(0);
    if (at >= n_pixels || evidence[at] != UNKNOWN) return;
    maps[2 * (size_t)at] ^= 1;
}
