// A pixel of a part.
flat in float number;
out vec2 colour;
void main() { colour = vec2(number, 0.0); }
