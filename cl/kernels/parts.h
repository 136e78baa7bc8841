// Cones as they show in pictures: a part is a trapezoid, or a disc.

// A side of a trapezoid: the pixels right (left) of the line x + slope (row - y) are inside.
typedef struct {
    float x, y, slope;
    int left;  // 1 where the line is the trapezoid's left border
} Side;

// Where radius > 0 it is a disc around `centre` instead of a trapezoid. Of the sides, 1 and 3 are
// the long ones, which show an edge. The rows are empty (top > bottom) where nothing is seen.
typedef struct {
    Side sides[4];
    float2 centre;
    float radius, distance;  // px; m from the camera to the cone's middle
    int top, bottom;         // first and last row
    int number;              // of its cone
    int edged;               // whether its outline is an edge
} Part;
