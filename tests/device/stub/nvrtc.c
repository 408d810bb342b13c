/* A compiler like NVRTC for tests on processors: the text becomes a library of C++ whose functions take packed arguments. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct { char *source, path[256], log[1024], asked[64]; } Program;
static int compiled;
static const char WORD[] = "\nEOM_KERNEL ";
static const char PACKED[] =
    "\n#include <cstddef>\ntemplate<std::size_t... I> struct Places {};\n"
    "template<std::size_t N, std::size_t... I> struct Count : Count<N - 1, N - 1, I...> {};\n"
    "template<std::size_t... I> struct Count<0, I...> { typedef Places<I...> type; };\n"
    "template<class... A, std::size_t... I> void unpacked(void (*f)(A...), void **p, Places<I...>) { f(*static_cast<A *>(p[I])...); }\n"
    "template<class... A> void unpacked(void (*f)(A...), void **p) { unpacked(f, p, typename Count<sizeof...(A)>::type()); }\n";

int stub_compiled(void) { return compiled; }
int nvrtcVersion(int *major, int *minor) { *major = 12; *minor = atoi(getenv("STUB_VERSION")); return 0; }
int nvrtcGetNumSupportedArchs(int *n) { *n = 3; return 0; }
int nvrtcGetSupportedArchs(int *x) { x[0] = 80; x[1] = 90; x[2] = 100; return 0; }
int nvrtcCreateProgram(Program **out, const char *source, const char *name, int n, const void *a, const void *b)
{
    Program *p = (Program *)calloc(1, sizeof *p);
    (void)name; (void)a; (void)b;
    p->source = strdup(source);
    *out = p;
    return n != 0;
}
int nvrtcCompileProgram(Program *p, int n, const char **options)
{
    char source[300], command[1400];
    FILE *file;
    const char *folder = getenv("STUB_FOLDER"), *at = p->source;
    for (int i = 0; i < n; ++i) {
        if (strncmp(options[i], "--gpu-architecture=", 19) == 0) { (void)snprintf(p->asked, sizeof p->asked, "%s", options[i] + 19); }
    }
    if (strstr(p->source, "cannot compile")) { (void)snprintf(p->log, sizeof p->log, "stub: line 7 is wrong"); return 6; }
    (void)snprintf(p->path, sizeof p->path, "%s/%d_%d.%s.so", folder, (int)getpid(), ++compiled, p->asked);
    (void)snprintf(source, sizeof source, "%s.cpp", p->path);
    file = fopen(source, "w");
    if (!file) { return 1; }
    (void)fprintf(file, "%s%s", p->source, PACKED);
    while ((at = strstr(at, WORD)) != NULL) {
        int length;
        at += strlen(WORD);
        length = (int)strcspn(at, "(");
        (void)fprintf(file, "extern \"C\" void %.*s_packed(void **p) { unpacked(%.*s, p); }\n", length, at, length, at);
    }
    (void)fclose(file);
    (void)snprintf(command, sizeof command, "g++ -std=c++11 -O0 -ffp-contract=off -fPIC -shared %s -o %s", source, p->path);
    return system(command) != 0;
}
int nvrtcGetProgramLogSize(Program *p, size_t *n) { *n = strlen(p->log) + 1; return 0; }
int nvrtcGetProgramLog(Program *p, char *text) { (void)strcpy(text, p->log); return 0; }
int nvrtcGetCUBINSize(Program *p, size_t *n) { *n = strlen(p->path) + 1; return strncmp(p->asked, "sm_", 3) != 0; }
int nvrtcGetCUBIN(Program *p, char *text) { (void)strcpy(text, p->path); return 0; }
int nvrtcGetPTXSize(Program *p, size_t *n) { *n = strlen(p->path) + 1; return strncmp(p->asked, "compute_", 8) != 0; }
int nvrtcGetPTX(Program *p, char *text) { (void)strcpy(text, p->path); return 0; }
int nvrtcDestroyProgram(Program **p) { free((*p)->source); free(*p); *p = NULL; return 0; }
