// Numbers that a work-item works on at once, PACK of them: vectors on a CPU, single numbers on a
// GPU. A work-group of GROUP items works on one pack of particles: on a GPU many items on one
// particle, on a CPU one item on PACK particles. The text of the kernels is the same for both.
// Define: PACK, 1 (also where it is not defined) or 8.
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
// Lane l (0 to 7) of a pack, and a pack of what the macro `each` says for every lane.
#define LANE_OF(pack, l) (pack)
#define PACK_OF(type, each) ((type)(each(0)))
#define LOAD_PACK(place) (*(place))
#define LOAD_CHARS LOAD_PACK
#define STORE_PACK(pack, place) (*(place) = (pack))
#define PACK_SUM(pack) (pack)
#define PACK_ANY(truth) (truth)
#else
typedef float8 vfloat;
typedef int8 vint;
typedef uint8 vuint;
typedef char8 vchar;
#define TO_INT convert_int8
#define TO_FLOAT convert_float8
#define TO_UINT convert_uint8
#define TO_CHAR convert_char8
#define LANE_OF(pack, l) ((pack).s##l)
#define PACK_OF(type, each) \
    ((type)(each(0), each(1), each(2), each(3), each(4), each(5), each(6), each(7)))
#define LOAD_PACK(place) vload8(0, place)
// Of chars: PoCL's vload8 loads them one by one.
typedef char8 char8_anywhere __attribute__((aligned(1)));
#define LOAD_CHARS(place) (*(__global const char8_anywhere *)(place))
#define STORE_PACK(pack, place) vstore8(pack, 0, place)
#define PACK_SUM(pack) pack_sum4((pack).lo + (pack).hi)
#define PACK_ANY(truth) pack_any4((truth).lo | (truth).hi)
#endif

// The number of every lane.
#define LANE_NUMBER(l) l
#define LANE_NUMBERS PACK_OF(vint, LANE_NUMBER)

inline float pack_sum4(float4 v) { return (v.x + v.y) + (v.z + v.w); }
inline int pack_any4(int4 v) { return v.x | v.y | v.z | v.w; }

// Operators instead of min, fmin, clamp and the like: PoCL does not inline those.

// Which of `n` things lane `lane` of the pack that begins with the `first` works on; lanes beyond
// the end repeat the last one.
inline int lane_index(int first, int lane, int n)
{
    return first + lane < n ? first + lane : n - 1;
}

inline vfloat least(vfloat a, vfloat b) { return a < b ? a : b; }
inline vfloat most(vfloat a, vfloat b) { return a > b ? a : b; }
inline vfloat within(vfloat a, vfloat low, vfloat high) { return least(most(a, low), high); }

typedef struct { vfloat x, y, z; } vpoint;

inline vfloat inner(vpoint a, vpoint b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

inline vpoint load_point(__local const vfloat *place)
{
    return (vpoint){place[0], place[1], place[2]};
}
