// How functions that take or return a float3 are declared: inlined wherever they are called. In calls
// of them Intel's runtime for CPUs (2026.2), which works on 8 items at once, mixes up its lanes.
#define INLINED static inline __attribute__((always_inline))
