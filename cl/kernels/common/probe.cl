// Tries a device: built-in functions, local memory, barriers and atomics. Twin: cl/probe.py.

// Work-items of a group; a power of two.
#ifndef GROUP
#define GROUP 16
#endif

// values: (n,), n a multiple of GROUP. sums: (n / GROUP,), of exp(-value k) + sin(value k) over the
// values of a group and k = 1 ... 16. count: (1,) int, grows by 1 for each group. An item per value.
__kernel void check(int n, __global const float *values, __global float *sums, __global int *count)
{
    __local float part[GROUP];
    const int i = get_global_id(0), item = get_local_id(0);
    // As wide as vectors get: where compiler and library disagree about the processor, these differ.
    const float16 k = (float16)(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16);
    const float16 x = values[min(i, n - 1)] * k;
    const float16 y = exp(-x) + sin(x);
    const float8 y8 = y.lo + y.hi;
    const float4 y4 = y8.lo + y8.hi;
    part[item] = i < n ? y4.x + y4.y + y4.z + y4.w : 0.0f;
    for (int half_group = GROUP / 2; half_group > 0; half_group /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < half_group) part[item] += part[item + half_group];
    }
    if (item == 0 && i < n) {
        sums[get_group_id(0)] = part[0];
        atomic_inc(count);
    }
}
