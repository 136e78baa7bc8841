// Codes of the pictures' colours, see part_colour.cl. Define: N_CODES, at most 256.
#if !defined(N_CODES)
#error "tracking/codes.h needs N_CODES"
#endif

// Outside the silhouettes, and only there.
#define NO_CODE (N_CODES - 1)
