// A pixel of a part, and whether one of its neighbours lies beyond the outline.
flat in vec4 disc;
flat in float number;
noperspective in vec4 here;
out vec2 colour;

void main()
{
    bool rim = min(here.z, here.w) < 1.0;
    if (disc.x > 0.0) {
        const vec2 away = abs(here.xy - disc.yz);
        const float radius2 = disc.x * disc.x, away2 = dot(away, away);
        if (away2 > radius2) discard;
        rim = away2 + 2.0 * max(away.x, away.y) + 1.0 > radius2;
    }
    colour = vec2(number, rim && disc.w > 0.0 ? 1.0 : 0.0);
}
