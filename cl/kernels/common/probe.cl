// Tries a device: built-in functions, local memory, barriers and atomics, its memory and its
// arithmetic. Twin: cl/probe.py.

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

// from, to: (n,) packs of 4. An item per pack.
__kernel void copy(int n, __global const float4 *from, __global float4 *to)
{
    const int i = get_global_id(0);
    if (i < n) to[i] = from[i];
}

// out: (n,), of item i after STEPS steps x <- x a + b from x = i. An item per number.
__kernel void multiply_add(int n, float a, float b, __global float *out)
{
    const int i = get_global_id(0);
    if (i >= n) return;
    // Eight chains, since a step waits for the one before it.
    float8 x = (float8)(i);
    for (int step = 0; step < STEPS; ++step) x = mad(x, (float8)(a), (float8)(b));
    const float4 half_sum = x.lo + x.hi;
    out[i] = (half_sum.x + half_sum.y + half_sum.z + half_sum.w) * 0.125f;
}
