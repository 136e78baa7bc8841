// Numbers that a work-item works on at once, PACK of them: vectors on a CPU, single numbers on a
// GPU. A work-group of GROUP items works on one pack of particles: on a GPU many items on one
// particle, on a CPU one item on PACK particles. The text of the kernels is the same for both.
// Define: PACK, 1 (also where it is not defined), 8 or 16.
#include "common/inlined.h"
#ifndef PACK
#define PACK 1
#endif

#if PACK == 1
typedef float vfloat;
typedef int vint;
typedef uint vuint;
typedef char vchar;
#define TO_INT convert_int // towards zero
#define TO_FLOAT convert_float
#define TO_UINT convert_uint
#define TO_CHAR convert_char
#define TO_BYTES convert_uchar
// Lane l (0 to F) of a pack, and a pack of what the macro `each` says for every lane.
#define LANE_OF(pack, l) (pack)
#define PACK_OF(type, each) ((type)(each(0)))
#define LOAD_PACK(place) (*(place))
#define STORE_PACK(pack, place) (*(place) = (pack))
#define PACK_SUM(pack) (pack)
#define PACK_ANY(truth) (truth)
#else
#if PACK == 8
#define PACKED(name) name##8
#define PACK_OF(type, each) \
    ((type)(each(0), each(1), each(2), each(3), each(4), each(5), each(6), each(7)))
#define PACK_SUM(pack) pack_sum4((pack).lo + (pack).hi)
#define PACK_ANY(truth) pack_any4((truth).lo | (truth).hi)
#else
#define PACKED(name) name##16
#define PACK_OF(type, each) \
    ((type)(each(0), each(1), each(2), each(3), each(4), each(5), each(6), each(7), \
            each(8), each(9), each(A), each(B), each(C), each(D), each(E), each(F)))
#define PACK_SUM(pack) pack_sum4((pack).lo.lo + (pack).lo.hi + (pack).hi.lo + (pack).hi.hi)
#define PACK_ANY(truth) pack_any4((truth).lo.lo | (truth).lo.hi | (truth).hi.lo | (truth).hi.hi)
#endif
typedef PACKED(float) vfloat;
typedef PACKED(int) vint;
typedef PACKED(uint) vuint;
typedef PACKED(char) vchar;
#define TO_INT PACKED(convert_int)
#define TO_FLOAT PACKED(convert_float)
#define TO_UINT PACKED(convert_uint)
#define TO_CHAR PACKED(convert_char)
#define TO_BYTES PACKED(convert_uchar)
#define LANE_OF(pack, l) ((pack).s##l)
#define LOAD_PACK load_pack
#define STORE_PACK store_pack
// No vload and vstore: PoCL does not inline them, and loads chars one by one.
#define ACCESS(space, type) \
    typedef PACKED(type) space##_##type##s __attribute__((aligned(sizeof(type)))); \
    static inline __attribute__((overloadable)) PACKED(type) load_pack(space const type *place) \
    { \
        return *(space const space##_##type##s *)place; \
    } \
    static inline __attribute__((overloadable)) void store_pack(PACKED(type) pack, space type *place) \
    { \
        *(space space##_##type##s *)place = pack; \
    }
#define ACCESSES(space) \
    ACCESS(space, float) ACCESS(space, int) ACCESS(space, uint) ACCESS(space, char) ACCESS(space, uchar)
ACCESSES(__global)
ACCESSES(__local)
ACCESSES(__private)
#endif

// The bytes at these places of a table. A CPU loads the words that they are in: its vector units
// gather words alone, and PoCL makes gathers of loops alone.
#if PACK == 1
#define look_up(table, place) ((int)(table)[place])
#else
static inline vint look_up_words(const size_t table, vint place)
{
    __global const int *words = (__global const int *)(table & ~(size_t)3);
    int places[PACK], found[PACK];
    place += (int)(table & 3);
    STORE_PACK(place >> 2, places);
#pragma clang loop unroll(disable) vectorize(enable)
    for (int lane = 0; lane < PACK; ++lane) found[lane] = words[places[lane]];
    return LOAD_PACK(found) << (24 - 8 * (place & 3));
}
static inline __attribute__((overloadable)) vint look_up(__global const char *table, vint place)
{
    return look_up_words((size_t)table, place) >> 24;
}
static inline __attribute__((overloadable)) vint look_up(__global const uchar *table, vint place)
{
    return look_up_words((size_t)table, place) >> 24 & 255;
}
#endif

// The number of every lane.
#define LANE_NUMBER(l) 0x##l
#define LANE_NUMBERS PACK_OF(vint, LANE_NUMBER)

static inline float pack_sum4(float4 v) { return (v.x + v.y) + (v.z + v.w); }
static inline int pack_any4(int4 v) { return v.x | v.y | v.z | v.w; }

// Operators instead of min, fmin, clamp and the like: PoCL does not inline those.

// Which of `n` things lane `lane` of the pack that begins with the `first` works on; lanes beyond
// the end repeat the last one.
static inline int lane_index(int first, int lane, int n)
{
    return first + lane < n ? first + lane : n - 1;
}

static inline vfloat least(vfloat a, vfloat b) { return a < b ? a : b; }
static inline vfloat most(vfloat a, vfloat b) { return a > b ? a : b; }
static inline vfloat within(vfloat a, vfloat low, vfloat high) { return least(most(a, low), high); }

typedef struct { vfloat x, y, z; } vpoint;

static inline vfloat inner(vpoint a, vpoint b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// a . b + c, in as few steps as can be.
static inline vfloat inner_plus(vpoint a, vpoint b, vfloat c)
{
    return a.x * b.x + (a.y * b.y + (a.z * b.z + c));
}

INLINED vpoint load_point(__local const vfloat *place)
{
    return (vpoint){place[0], place[1], place[2]};
}
