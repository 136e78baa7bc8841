// Sums over a work-group of GROUP items. Define: GROUP, a power of two.
#if !defined(GROUP)
#error "common/reduction.h needs GROUP"
#endif

inline float group_sum(__local float *scratch, float value)
{
    const int lane = get_local_id(0);
    scratch[lane] = value;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int half_size = GROUP / 2; half_size > 0; half_size /= 2) {
        if (lane < half_size) scratch[lane] += scratch[lane + half_size];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    const float sum = scratch[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    return sum;
}
