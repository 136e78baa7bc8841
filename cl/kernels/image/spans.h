// Pixels of PACK rows at once, as 32-bit words: bit i of word w is pixel 32 w + i. A span of pixels
// is packed as its first one and, in the upper half, the one after its last.
#if !defined(PACK)
#error "image/spans.h needs PACK"
#endif
#include "common/pack.h"

// The bits from `first` on, counted from the word's own first pixel.
static inline vuint bits_from(vint first)
{
    const vuint bits = (vuint)(0xffffffffu) << TO_UINT(first & 31);
    return first <= 0 ? (vuint)(0xffffffffu) : first >= 32 ? (vuint)(0) : bits;
}

// The bits of the pixels from `first` to before `end` that lie in word `word`.
static inline vuint bits_between(vint first, vint end, int word)
{
    return bits_from(first - 32 * word) & ~bits_from(end - 32 * word);
}

static inline vuint span_bits(vint span, int word)
{
    return bits_between(span & 0xffff, span >> 16, word);
}

// The least integer from `x` >= 0 on. Operators instead of ceil, which PoCL does not inline.
static inline vint first_from(vfloat x)
{
    const vint before = TO_INT(x);
    return x > TO_FLOAT(before) ? before + 1 : before;
}
