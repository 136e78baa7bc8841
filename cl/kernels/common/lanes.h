// Memory and barriers of a work-group of LANES items.
#ifndef LANES
#error "common/lanes.h needs LANES"
#endif

// A group of one item needs neither local memory nor barriers. PoCL's compiler fails on some of
// these, and only knows of private memory that nothing else points there (else no vector code).
#if LANES > 1
#define SYNC barrier(CLK_LOCAL_MEM_FENCE)
#define SCRATCH __local
#else
#define SYNC
#define SCRATCH __private
#endif
