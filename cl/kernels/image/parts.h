// Cones as they show in pictures: a part is a trapezoid with a disc at each end. Define:
// PART_WORDS, the 32-bit words that the host allocates for each.
#if !defined(PART_WORDS)
#error "image/parts.h needs PART_WORDS"
#endif

// A side of a trapezoid: the pixels right (left) of the line x + slope (row - y) are inside.
typedef struct {
    float x, y, slope;
    int left;  // 1 where the line is the trapezoid's left border
} Side;

// Sides 0 and 2 are the ends of the cone, which `ends` and `radii` (px, 0 for none) belong to; 1
// and 3 are the long ones, whose outlines are edges. The rows are empty (top > bottom) where
// nothing is seen. distance: m from the camera to the cone's middle. number: of its cone. edged:
// whether it has edges at all. outlined: bit e where also the outline of end e is an edge. bare:
// whether the discs are all of it.
typedef struct {
    Side sides[4];
    float2 ends[2];
    float radii[2];
    float distance;
    int top, bottom;
    int number, edged, outlined, bare;
} Part;
typedef char part_has_part_words[sizeof(Part) == 4 * PART_WORDS ? 1 : -1];
