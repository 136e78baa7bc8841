// A pixel of a contour; the colour mask leaves the number of the part that it crosses.
out vec2 colour;
void main() { colour = vec2(0.0, 1.0); }
