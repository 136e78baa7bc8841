// Codes of the pictures' colours, see part_colour.cl. Define: N_CODES, at most 256.
#if !defined(N_CODES)
#error "tracking/codes.h needs N_CODES"
#endif

// Outside the silhouettes, and only there; inside, where something before the person hides the colour.
#define NO_CODE (N_CODES - 1)
#define HIDDEN_CODE (N_CODES - 2)
