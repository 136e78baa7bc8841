// Rows of pixels as 32-bit words: bit i of word w is pixel 32 w + i.

// The bits from `first` on, both counted from the word's own first pixel.
inline uint bits_from(int first)
{
    return first <= 0 ? 0xffffffffu : first >= 32 ? 0u : 0xffffffffu << first;
}

// The bits of pixels `first`..`last` that lie in word `word`; none if first > last.
inline uint span_bits(int first, int last, int word)
{
    return bits_from(first - 32 * word) & ~bits_from(last + 1 - 32 * word);
}

// The pixels within [low, high] as integers; operators instead of ceil and floor, which PoCL does
// not inline. Not for negative `low`.
inline int first_pixel(float low)
{
    const int whole = (int)low;
    return whole + (low > (float)whole);
}

inline int last_pixel(float high)
{
    return high < 0.0f ? -1 : (int)high;
}
