// Counter-based random numbers, Philox 4x32-10 (Salmon et al. 2011): the counterpart of
// apf/reference/noise.py. The same key and counter give the same words on every device.
inline uint4 philox4x32(uint4 counter, uint2 key)
{
    for (int round = 0; round < 10; ++round) {
        const uint hi0 = mul_hi(0xD2511F53u, counter.x), lo0 = 0xD2511F53u * counter.x;
        const uint hi1 = mul_hi(0xCD9E8D57u, counter.z), lo1 = 0xCD9E8D57u * counter.z;
        counter = (uint4)(hi1 ^ counter.y ^ key.x, lo1, hi0 ^ counter.w ^ key.y, lo0);
        key += (uint2)(0x9E3779B9u, 0xBB67AE85u);
    }
    return counter;
}

// Uniform in the open interval (0, 1): 23 bits and a half, so that it is exact in float.
inline float uniform01(uint word) { return ((word >> 9) + 0.5f) * 0x1p-23f; }

// A standard normal number (Box-Muller).
inline float philox_normal(uint4 counter, uint2 key)
{
    const uint4 words = philox4x32(counter, key);
    return sqrt(-2.0f * log(uniform01(words.x))) * cospi(2.0f * uniform01(words.y));
}
