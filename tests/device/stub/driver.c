/* A driver of CUDA for tests on processors: images are paths of C++ builds of a text, a launch is a call, a stream is a number. */
#include <dlfcn.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DEVICES = 2, MOST = 64, OUT_OF_MEMORY = 2, INVALID = 1, NOT_FOUND = 500 };
static long live_memory, live_events, live_modules, depth, launches, waits;
static size_t most_bytes = (size_t)1 << 40;
static int processor = 90;
static const void *elsewhere[MOST]; /* addresses of device 1 */
static int elsewhere_count, current;

/* What tests set and read. */
void stub_elsewhere(const void *p) { elsewhere[elsewhere_count++ % MOST] = p; }
void stub_forget_elsewhere(void) { elsewhere_count = 0; }
void stub_most_bytes(size_t n) { most_bytes = n; }
void stub_processor(int number) { processor = number; }
long stub_count(const char *what)
{
    if (strcmp(what, "memory") == 0) { return live_memory; }
    if (strcmp(what, "events") == 0) { return live_events; }
    if (strcmp(what, "modules") == 0) { return live_modules; }
    if (strcmp(what, "contexts") == 0) { return depth; }
    return strcmp(what, "waits") == 0 ? waits : launches;
}

int cuInit(unsigned flags) { return flags != 0; }
int cuDriverGetVersion(int *v) { *v = 12090; return 0; }
int cuDeviceGetCount(int *n) { *n = DEVICES; return 0; }
int cuDeviceGet(int *d, int i) { *d = 10 + i; return i >= DEVICES; }
int cuDeviceGetName(char *text, int n, int d) { (void)snprintf(text, (size_t)n, "stub %d", d - 10); return 0; }
int cuDeviceGetAttribute(int *x, int k, int d) { (void)d; *x = k == 75 ? processor/10 : processor%10; return 0; }
int cuDevicePrimaryCtxRetain(void **c, int d) { *c = (void *)(ptrdiff_t)d; return 0; }
int cuCtxPushCurrent_v2(void *c) { ++depth; current = (int)(ptrdiff_t)c - 10; return c == 0; }
int cuCtxPopCurrent_v2(void **c) { --depth; *c = 0; return 0; }
int cuModuleLoadData(void **m, const char *image)
{
    *m = dlopen(image, RTLD_NOW | RTLD_LOCAL);
    live_modules += *m != 0;
    return *m ? 0 : 200;
}
int cuModuleUnload(void *m) { --live_modules; return dlclose(m); }
int cuModuleGetFunction(void **f, void *m, const char *name)
{
    char packed[512];
    (void)snprintf(packed, sizeof packed, "%s_packed", name);
    *f = dlsym(m, packed);
    return *f ? 0 : NOT_FOUND;
}
int cuLaunchKernel(void *f, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by, unsigned bz, unsigned shared, void *stream, void **p, void **extra)
{
    unsigned long long count;
    void (*call)(void **);
    (void)stream;
    if (depth < 1 || gx < 1 || gy != 1 || gz != 1 || by != 1 || bz != 1 || shared || extra) { return INVALID; }
    (void)memcpy(&count, p[0], sizeof count);
    if ((unsigned long long)gx*bx < count) { return INVALID; }
    (void)memcpy(&call, &f, sizeof call);
    call(p);
    ++launches;
    return 0;
}
int cuMemAlloc_v2(void **p, size_t n)
{
    if (depth < 1 || n == 0) { return INVALID; }
    if (n > most_bytes) { return OUT_OF_MEMORY; }
    *p = aligned_alloc(256, (n + 255)/256*256);
    (void)memset(*p, 0xA5, n); /* what nobody wrote is seen */
    ++live_memory;
    if (current == 1) { stub_elsewhere(*p); }
    return 0;
}
int cuMemFree_v2(void *p) { free(p); --live_memory; return depth < 1; }
int cuMemcpyDtoHAsync_v2(void *to, const void *from, size_t n, void *s) { (void)s; (void)memcpy(to, from, n); return 0; }
int cuMemcpyHtoDAsync_v2(void *to, const void *from, size_t n, void *s) { (void)s; (void)memcpy(to, from, n); return 0; }
int cuMemsetD32Async(unsigned *p, unsigned value, size_t n, void *s)
{
    (void)s;
    for (size_t i = 0; i < n; ++i) { p[i] = value; }
    return 0;
}
int cuPointerGetAttribute(int *x, int k, const void *p)
{
    if (k != 9 || p == 0) { return INVALID; }
    *x = 0;
    for (int i = 0; i < elsewhere_count && i < MOST; ++i) { *x |= elsewhere[i] == p; }
    return 0;
}
int cuStreamSynchronize(void *s) { (void)s; return 0; }
int cuEventCreate(void **e, unsigned flags) { *e = malloc(1); ++live_events; return flags != 2; }
int cuEventRecord(void *e, void *s) { (void)s; return e == 0; }
int cuStreamWaitEvent(void *s, void *e, unsigned flags) { (void)s; ++waits; return e == 0 || flags != 0; }
int cuEventDestroy_v2(void *e) { free(e); --live_events; return 0; }
int cuGetErrorString(int code, const char **text) { *text = code == OUT_OF_MEMORY ? "out of memory" : "stub's error"; return 0; }
