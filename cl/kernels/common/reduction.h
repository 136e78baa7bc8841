// Sums over a work-group of GROUP items. Define: GROUP, a power of two; PACK of pack.h.
#if !defined(GROUP)
#error "common/reduction.h needs GROUP"
#endif
#include "common/pack.h"

// Sum of `value` over the items, which all of them get; in two steps, since barriers are what it
// costs. scratch: room for GROUP.
#define GROUP_SUM(name, type)                                                            \
    INLINED type name(__local type *scratch, type value)                                 \
    {                                                                                    \
        const int lane = get_local_id(0), left = GROUP < 16 ? GROUP : 16;                \
        scratch[lane] = value;                                                           \
        barrier(CLK_LOCAL_MEM_FENCE);                                                    \
        type sum = 0.0f;                                                                 \
        for (int i = lane; i < (lane < left ? GROUP : 0); i += left) sum += scratch[i];  \
        barrier(CLK_LOCAL_MEM_FENCE);                                                    \
        if (lane < left) scratch[lane] = sum;                                            \
        barrier(CLK_LOCAL_MEM_FENCE);                                                    \
        sum = 0.0f;                                                                      \
        for (int i = 0; i < left; ++i) sum += scratch[i];                                \
        barrier(CLK_LOCAL_MEM_FENCE);                                                    \
        return sum;                                                                      \
    }
GROUP_SUM(group_sum, float)
GROUP_SUM(group_sum_of_packs, vfloat)
