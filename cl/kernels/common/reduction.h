// Sums over a work-group of GROUP items. Define: GROUP, a power of two.
#if !defined(GROUP)
#error "common/reduction.h needs GROUP"
#endif

// What all items get; in two steps, since barriers are what it costs.
inline float group_sum(__local float *scratch, float value)
{
    const int lane = get_local_id(0), left = GROUP < 16 ? GROUP : 16;
    scratch[lane] = value;
    barrier(CLK_LOCAL_MEM_FENCE);
    float sum = 0.0f;
    for (int i = lane; i < (lane < left ? GROUP : 0); i += left) sum += scratch[i];
    barrier(CLK_LOCAL_MEM_FENCE);
    if (lane < left) scratch[lane] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    sum = 0.0f;
    for (int i = 0; i < left; ++i) sum += scratch[i];
    barrier(CLK_LOCAL_MEM_FENCE);
    return sum;
}
