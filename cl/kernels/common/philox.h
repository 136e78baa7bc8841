// Counter-based random numbers, Philox 4x32-10 (Salmon et al. 2011): the counterpart of
// apf/reference/filters/noise.py. The same key and counter give the same words on every device.
#include "common/pack.h"

#define PHILOX(name, words, word) \
    static inline words name(words counter, uint2 key) \
    { \
        for (int round = 0; round < 10; ++round) { \
            const word x = counter.x, z = counter.z; \
            counter.x = mul_hi(z, (word)0xCD9E8D57u) ^ counter.y ^ key.x; \
            counter.y = z * 0xCD9E8D57u; \
            counter.z = mul_hi(x, (word)0xD2511F53u) ^ counter.w ^ key.y; \
            counter.w = x * 0xD2511F53u; \
            key += (uint2)(0x9E3779B9u, 0xBB67AE85u); \
        } \
        return counter; \
    }

typedef struct { vuint x, y, z, w; } vwords;

PHILOX(philox4x32, uint4, uint)
PHILOX(philox_pack, vwords, vuint)

// Uniform in the open interval (0, 1): 23 bits and a half, so that it is exact in float.
static inline float uniform01(uint word) { return ((word >> 9) + 0.5f) * 0x1p-23f; }
static inline vfloat uniform01_pack(vuint word) { return (TO_FLOAT(word >> 9) + 0.5f) * 0x1p-23f; }

// Standard normal numbers (Box-Muller).
static inline vfloat normal_pack(vwords counter, uint2 key)
{
    const vwords words = philox_pack(counter, key);
    return sqrt(-2.0f * log(uniform01_pack(words.x))) * cospi(2.0f * uniform01_pack(words.y));
}
