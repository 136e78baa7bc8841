// How helpers are declared that must be inlined wherever they are called; others are `static inline`.
// Those that take local memory: PoCL 3.0 computes nonsense where LLVM finds that all calls pass the
// same local array and writes that into the helper. Those of float3: in calls of them Intel's runtime
// for CPUs (2026.2), which works on 8 items at once, mixes up its lanes.
// scripts/check_kernels.py defines it otherwise: Oclgrind does not know what inlining leaves behind.
#ifndef INLINED
#define INLINED static inline __attribute__((always_inline))
#endif
