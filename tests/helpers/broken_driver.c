/* An OpenCL driver that lists a device but cannot build a kernel, for tests/cl/test_broken_driver.py.
 * Only what the loader and pyopencl ask for on the way to a build is there. */
#include <stdint.h>
#include <string.h>

struct object { void **dispatch; };
static void *table[256];
static struct object platform = {table}, device = {table}, anything = {table};

static int unsupported(void) { return 0; }

static int text(const char *value, size_t room, void *out, size_t *size)
{
    size_t length = strlen(value) + 1;
    if (out && room >= length) memcpy(out, value, length);
    if (size) *size = length;
    return 0;
}

static int value(const void *value, size_t length, size_t room, void *out, size_t *size)
{
    if (out && room >= length) memcpy(out, value, length);
    if (size) *size = length;
    return 0;
}

static int number(uint64_t found, size_t length, size_t room, void *out, size_t *size)
{
    return value(&found, length, room, out, size); /* little endian */
}

static int platform_info(void *p, unsigned name, size_t room, void *out, size_t *size)
{
    switch (name) {
    case 0x0900: return text("FULL_PROFILE", room, out, size);
    case 0x0901: return text("OpenCL 1.2 broken", room, out, size);
    case 0x0902: return text("Broken Platform", room, out, size);
    case 0x0903: return text("Nobody", room, out, size);
    case 0x0904: return text("cl_khr_icd", room, out, size);
    case 0x0920: return text("BRK", room, out, size);
    }
    return -30;
}

static int device_ids(void *p, uint64_t type, unsigned room, void **out, unsigned *count)
{
    if (out && room) out[0] = &device;
    if (count) *count = 1;
    return 0;
}

static int device_info(void *d, unsigned name, size_t room, void *out, size_t *size)
{
    void *of = &platform;
    switch (name) {
    case 0x1000: return number(4, 8, room, out, size);            /* a GPU */
    case 0x1002: return number(512, 4, room, out, size);          /* compute units: the most here */
    case 0x1010: case 0x101F: return number(1ull << 33, 8, room, out, size);
    case 0x102B: return text("Broken GPU", room, out, size);
    case 0x102C: return text("Nobody", room, out, size);
    case 0x102D: return text("0.1", room, out, size);
    case 0x102E: return text("FULL_PROFILE", room, out, size);
    case 0x102F: return text("OpenCL 1.2 broken", room, out, size);
    case 0x1030: return text("", room, out, size);
    case 0x1031: return value(&of, sizeof of, room, out, size);
    case 0x103D: return text("OpenCL C 1.2", room, out, size);
    }
    return -30;
}

static void *create(void *a, void *b, void *c, void *d, void *e, int *error)
{
    if (error) *error = 0;
    return &anything;
}
static void *create_queue(void *context, void *d, uint64_t properties, int *error)
{
    if (error) *error = 0;
    return &anything;
}
static void *create_program(void *context, unsigned n, void *texts, void *lengths, int *error)
{
    if (error) *error = 0;
    return &anything;
}
static int build(void) { return -11; }

static int info(void *object, unsigned name, size_t room, void *out, size_t *size)
{
    void *only = &device, *of = &anything;
    if (name == 0x1081 || name == 0x1163 || name == 0x1091) /* devices of context, program, queue */
        return value(&only, sizeof only, room, out, size);
    if (name == 0x1161 || name == 0x1090) return value(&of, sizeof of, room, out, size);
    return number(1, 4, room, out, size);
}

static int build_info(void *program, void *d, unsigned name, size_t room, void *out, size_t *size)
{
    if (name == 0x1181) return number((uint32_t)-2, 4, room, out, size);
    return text("error: unknown target CPU 'generic'", room, out, size);
}

int clIcdGetPlatformIDsKHR(unsigned room, void **out, unsigned *count)
{
    for (int i = 0; i < 256; i++) table[i] = (void *)unsupported;
    table[1] = (void *)platform_info;
    table[2] = (void *)device_ids;
    table[3] = (void *)device_info;
    table[4] = (void *)create;
    table[8] = table[12] = table[32] = (void *)info;
    table[9] = (void *)create_queue;
    table[26] = (void *)create_program;
    table[30] = (void *)build;
    table[33] = (void *)build_info;
    if (out && room) out[0] = &platform;
    if (count) *count = 1;
    return 0;
}

int clGetPlatformInfo(void *p, unsigned name, size_t room, void *out, size_t *size)
{
    return platform_info(p, name, room, out, size);
}

void *clGetExtensionFunctionAddress(const char *name)
{
    return strcmp(name, "clIcdGetPlatformIDsKHR") ? 0 : (void *)clIcdGetPlatformIDsKHR;
}
