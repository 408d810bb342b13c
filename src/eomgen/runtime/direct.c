/* Methods of kernels as callables in C: calls with plain arrays go from Python to the compiled function at once.
 *
 * Nothing here knows a robot.  A Function is what one method of all kernels of a package does: the method in Python,
 * the names, roles and shapes of its parameters, and, once they are armed, the addresses of its codes: its own and that
 * of wrenches, each for one state and for many, each armed after a first call that needs it, which may have compiled
 * it.  A State is what may change of one kernel: its parameters, checks and threads.  A Direct is the method of one
 * kernel: a Function and a State, with a kernel that has methods in Python alone.
 *
 * A call is plain where every array is an ndarray itself (no subclass) of the kernel's dtype, aligned, C-contiguous, of
 * exactly the shape of one state or of N of them, and no keyword asks for more than `out` and `wrench`.  Whatever is
 * not plain, and whatever turns out not to be regular (NaN, infinity, a singular mass matrix), is left to the method in
 * Python, which is called with the very same arguments: it computes what has to be computed, or raises.  So results and
 * messages are the same by construction.
 *
 * A generated package carries a copy of this file, and what it was compiled to where Python's and NumPy's headers
 * were. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <structmember.h>

#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <numpy/ndarrayobject.h>

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifndef Py_BEGIN_CRITICAL_SECTION /* before 3.13 there is a lock around all of this anyway */
#define Py_BEGIN_CRITICAL_SECTION(object) {
#define Py_END_CRITICAL_SECTION() }
#endif
#if defined(Py_GIL_DISABLED) && defined(__GNUC__)
#define PUBLISH(place, value) __atomic_store_n(&(place), (value), __ATOMIC_RELEASE)
#define PUBLISHED(place) __atomic_load_n(&(place), __ATOMIC_ACQUIRE)
#else
#define PUBLISH(place, value) ((place) = (value))
#define PUBLISHED(place) (place)
#endif

enum { ARRAYS = 4, PLACES = 8, AXES = 3, PARTS = 64 }; /* that a function reads, parameters, axes, libraries: at most */

/* Work that others may run beside: multiplications and additions; microseconds, in which a GIL's return is lost. */
static const double LONG = 2e4;
/* States that are worth a thread of their own, as in calls.py. */
static const npy_intp SHARE = 256;

/* What a parameter is for. */
typedef enum {
    READ,    /* an array that the code reads */
    BESIDE,  /* an array that may be left out; it has states and is checked, and nothing reads it */
    WRENCH,  /* an array that may be left out; further code reads it, and what that computes is added */
    FRAME,   /* the name of a frame, in place of its number */
    OUT,     /* an array to write to */
    NOTHING, /* plain only where it is left out or None */
    CUT      /* whether loops are meant to be open */
} Role;

typedef struct {
    int axes;
    npy_intp lengths[AXES];
    npy_intp size; /* their product */
} Shape;

typedef struct {
    PyObject *label; /* interned */
    Role role;
    Shape shape;
} Place;

/* What a method calls, and for what: for one state or for many. */
typedef enum {
    OWN,   /* what it is for */
    ADDED, /* what wrenches add: reads the first array and them, writes what "own" writes or one of its arrays */
    WAYS
} Way;
static const char *const WAY_NAMES[WAYS] = {"own", "added"};

/* Code for one state or for many, and what it reads of the parameters. */
typedef struct {
    PyObject *library; /* which keeps it */
    int part;          /* number of the library */
    npy_intp hoisted;  /* numbers that the library computes from the parameters */
    double operations; /* of a state */
    npy_intp piece;    /* states that one call computes at most */
    uintptr_t setup;   /* address of the library's code that computes from the parameters */
    uintptr_t address; /* of the code; 0 until armed, and published last */
    char asked;        /* whether arming was asked for it */
} Code;

typedef struct {
    PyObject_HEAD
    PyObject *method; /* the function of Python */
    PyObject *name;
    PyObject *arming; /* arming(function, way, many) tells the address of a code after a first call of it */
    PyObject *frames; /* their numbers by name, a dict */
    PyArray_Descr *dtype;
    int places, positional;
    Place place[PLACES];
    Shape result;
    int framed, in_three; /* takes a frame's number; its result are three views */
    int cut_must_be_false;
    Code codes[WAYS][2]; /* of each way for one state and for many */
    double sign;         /* of what is added to the result */
    int into;            /* number of the array that it is added to instead, with sign 1; -1 for the result */
    npy_intp *left;      /* places of this array that nothing is added to */
    Py_ssize_t lefts;
} Function;

typedef struct {
    PyObject_HEAD
    PyArrayObject *values; /* of the parameters; replaced as a whole, never written to */
    PyObject *make, *setup; /* setup is make(values), for callers in Python; NULL until they ask for it */
    char checks;
    Py_ssize_t threads;
    int parts; /* as many of h as may be there */
    PyArrayObject *h[PARTS]; /* what each library computes of the values, when it is first needed; NULL before */
} State;

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Function *function;
    State *state;
    PyObject *owner; /* a kernel whose methods are those of Python */
} Direct;

typedef struct {
    PyTypeObject *function, *state, *direct;
} Types;

/* ---- numbers ------------------------------------------------------------------------------------------------- */

/* Exponents with all bits set are those of NaN and infinity: adding one to such an exponent carries into the sign. */
#define DEFINE_FINITE(NAME, WORD, EXPONENT, ONE)                                                                       \
    static int NAME(const void *numbers, npy_intp count)                                                               \
    {                                                                                                                  \
        const char *from = numbers;                                                                                    \
        WORD carry = 0;                                                                                                \
        for (npy_intp i = 0; i < count; ++i) {                                                                         \
            WORD bits;                                                                                                 \
            memcpy(&bits, from + (size_t)i * sizeof bits, sizeof bits);                                                \
            carry |= (bits & (EXPONENT)) + (ONE);                                                                      \
        }                                                                                                              \
        return !(carry >> (8 * sizeof carry - 1));                                                                     \
    }
DEFINE_FINITE(finite_double, uint64_t, UINT64_C(0x7ff0000000000000), UINT64_C(0x0010000000000000))
DEFINE_FINITE(finite_float, uint32_t, UINT32_C(0x7f800000), UINT32_C(0x00800000))

/* Code of one state and of a batch, with as many arrays as it reads; -1 or the first failure. */
#define DEFINE_CALLS(REAL)                                                                                             \
    static long long one_##REAL(const Code *c, int framed, int reads, const void *h, const void *const *x,             \
                                int frame, void *written)                                                              \
    {                                                                                                                  \
        const REAL *p = h, *a = x[0], *b = x[1], *e = x[2], *d = x[3];                                                 \
        REAL *out = written;                                                                                           \
        typedef int (*One)(const REAL *, const REAL *, REAL *);                                                        \
        typedef int (*Framed)(const REAL *, const REAL *, int, REAL *);                                                \
        typedef int (*Two)(const REAL *, const REAL *, const REAL *, REAL *);                                          \
        typedef int (*Three)(const REAL *, const REAL *, const REAL *, const REAL *, REAL *);                          \
        typedef int (*Four)(const REAL *, const REAL *, const REAL *, const REAL *, const REAL *, REAL *);             \
        if (framed) return ((Framed)c->address)(p, a, frame, out) - 1LL;                                               \
        if (reads == 1) return ((One)c->address)(p, a, out) - 1LL;                                                     \
        if (reads == 2) return ((Two)c->address)(p, a, b, out) - 1LL;                                                  \
        if (reads == 3) return ((Three)c->address)(p, a, b, e, out) - 1LL;                                             \
        return ((Four)c->address)(p, a, b, e, d, out) - 1LL;                                                           \
    }                                                                                                                  \
    static long long many_##REAL(const Code *c, int framed, int reads, size_t n, const void *h, const void *const *x,  \
                                 const size_t *s, int frame, void *written)                                            \
    {                                                                                                                  \
        const REAL *p = h, *a = x[0], *b = x[1], *e = x[2], *d = x[3];                                                 \
        REAL *out = written;                                                                                           \
        typedef const REAL *R;                                                                                         \
        typedef long long (*One)(size_t, R, R, size_t, REAL *);                                                        \
        typedef long long (*Framed)(size_t, R, R, size_t, int, REAL *);                                                \
        typedef long long (*Two)(size_t, R, R, size_t, R, size_t, REAL *);                                             \
        typedef long long (*Three)(size_t, R, R, size_t, R, size_t, R, size_t, REAL *);                                \
        typedef long long (*Four)(size_t, R, R, size_t, R, size_t, R, size_t, R, size_t, REAL *);                      \
        if (framed) return ((Framed)c->address)(n, p, a, s[0], frame, out);                                            \
        if (reads == 1) return ((One)c->address)(n, p, a, s[0], out);                                                  \
        if (reads == 2) return ((Two)c->address)(n, p, a, s[0], b, s[1], out);                                         \
        if (reads == 3) return ((Three)c->address)(n, p, a, s[0], b, s[1], e, s[2], out);                              \
        return ((Four)c->address)(n, p, a, s[0], b, s[1], e, s[2], d, s[3], out);                                      \
    }
DEFINE_CALLS(double)
DEFINE_CALLS(float)

/* to[i] = from[i] + sign * what[i], states of so many numbers each; one state stands for all where there are fewer. */
#define DEFINE_SUM(REAL)                                                                                               \
    static void sum_##REAL(const void *from, npy_intp from_step, const void *what, npy_intp what_step, REAL sign,      \
                           npy_intp states, npy_intp size, void *to)                                                   \
    {                                                                                                                  \
        const REAL *x = from, *y = what;                                                                               \
        REAL *out = to;                                                                                                \
        for (npy_intp k = 0; k < states; ++k)                                                                          \
            for (npy_intp i = 0; i < size; ++i)                                                                        \
                out[k * size + i] = x[k * from_step + i] + sign * y[k * what_step + i];                                \
    }
DEFINE_SUM(double)
DEFINE_SUM(float)

/* ---- arrays -------------------------------------------------------------------------------------------------- */

/* An array that the code can take as it is, of one state or of many: their number, 0 for one alone; -1 for another. */
static npy_intp states_of(PyObject *value, const Function *f, const Shape *shape)
{
    if (!PyArray_CheckExact(value)) return -1;
    PyArrayObject *array = (PyArrayObject *)value;
    const int plain = NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED;
    if ((PyArray_FLAGS(array) & plain) != plain) return -1;
    const PyArray_Descr *dtype = PyArray_DESCR(array);
    if (dtype != f->dtype && (dtype->type_num != f->dtype->type_num || !PyArray_ISNBO(dtype->byteorder))) return -1;
    const int leading = PyArray_NDIM(array) - shape->axes;
    if (leading != 0 && leading != 1) return -1;
    const npy_intp *lengths = PyArray_DIMS(array);
    for (int i = 0; i < shape->axes; ++i)
        if (lengths[leading + i] != shape->lengths[i]) return -1;
    if (leading == 0) return 0;
    return lengths[0] > 0 ? lengths[0] : -1;
}

static int all_finite(const Function *f, const void *numbers, npy_intp count)
{
    return f->dtype->type_num == NPY_DOUBLE ? finite_double(numbers, count) : finite_float(numbers, count);
}

static npy_intp bytes_of(const Function *f, npy_intp count)
{
    return count * (f->dtype->type_num == NPY_DOUBLE ? (npy_intp)sizeof(double) : (npy_intp)sizeof(float));
}

/* The three matrices of a result with derivatives, as views of it. */
static PyObject *three_views(const Function *f, PyArrayObject *whole, npy_intp states)
{
    const npy_intp rows = f->result.lengths[1], columns = f->result.lengths[2];
    npy_intp lengths[AXES] = {states, rows, columns};
    npy_intp steps[AXES] = {bytes_of(f, f->result.size), bytes_of(f, columns), bytes_of(f, 1)};
    const int skipped = states == 0;
    PyObject *views = PyTuple_New(3);
    if (views == NULL) return NULL;
    for (npy_intp i = 0; i < 3; ++i) {
        PyArray_Descr *dtype = PyArray_DESCR(whole);
        Py_INCREF(dtype);
        char *first = PyArray_BYTES(whole) + bytes_of(f, i * rows * columns);
        PyObject *view = PyArray_NewFromDescr(&PyArray_Type, dtype, AXES - skipped, lengths + skipped, steps + skipped,
                                              first, PyArray_FLAGS(whole) & NPY_ARRAY_WRITEABLE, NULL);
        if (view == NULL) goto failed;
        PyTuple_SET_ITEM(views, i, view);
        Py_INCREF(whole);
        if (PyArray_SetBaseObject((PyArrayObject *)view, (PyObject *)whole) < 0) goto failed;
    }
    return views;
failed:
    Py_DECREF(views);
    return NULL;
}

/* ---- calls --------------------------------------------------------------------------------------------------- */

/* What the code's library computes from the values of the parameters; a new array. */
static PyArrayObject *computed_from(PyArrayObject *values, const Function *f, const Code *code)
{
    const npy_intp count = code->hoisted > 0 ? code->hoisted : 1;
    if (PyArray_TYPE(values) != f->dtype->type_num) {
        PyErr_SetString(PyExc_TypeError, "values of another dtype than the kernel's");
        return NULL;
    }
    PyArrayObject *h = (PyArrayObject *)PyArray_SimpleNew(1, &count, f->dtype->type_num);
    if (h != NULL && f->dtype->type_num == NPY_DOUBLE)
        ((void (*)(const double *, double *))code->setup)(PyArray_DATA(values), PyArray_DATA(h));
    else if (h != NULL)
        ((void (*)(const float *, float *))code->setup)(PyArray_DATA(values), PyArray_DATA(h));
    return h;
}

/* What the code's library reads of the parameters; a new reference, so that a running call keeps its own. */
static PyArrayObject *hoisted(State *state, const Function *f, const Code *code)
{
    PyArrayObject *h = NULL, *other = NULL, *values = NULL;
    Py_BEGIN_CRITICAL_SECTION(state);
    h = state->h[code->part];
    Py_XINCREF(h);
    if (h == NULL) values = state->values;
    Py_XINCREF(values);
    Py_END_CRITICAL_SECTION();
    if (h != NULL) return h;
    h = computed_from(values, f, code);
    if (h != NULL) {
        Py_BEGIN_CRITICAL_SECTION(state);
        if (state->values == values) { /* no assignment came between */
            other = state->h[code->part];
            Py_INCREF(h);
            state->h[code->part] = h;
            if (state->parts <= code->part) state->parts = code->part + 1;
        }
        Py_END_CRITICAL_SECTION();
    }
    Py_XDECREF(other);
    Py_DECREF(values);
    return h;
}

/* Values of the parameters by place; -1 where a keyword is none of them, or comes twice. */
static int sort_arguments(const Function *f, PyObject *const *args, Py_ssize_t count, PyObject *names,
                          PyObject **given)
{
    if (count > f->positional) return -1;
    for (Py_ssize_t i = 0; i < count; ++i) given[i] = args[i];
    const Py_ssize_t named = names == NULL ? 0 : PyTuple_GET_SIZE(names);
    for (Py_ssize_t k = 0; k < named; ++k) {
        PyObject *name = PyTuple_GET_ITEM(names, k);
        int place = 0;
        while (place < f->places && f->place[place].label != name) ++place;
        if (place == f->places || given[place] != NULL) return -1;
        given[place] = args[count + k];
    }
    return 0;
}

/* A plain call: its arguments as the code takes them. */
typedef struct {
    const void *x[ARRAYS + 1]; /* the arrays that the code reads, and one beside them */
    npy_intp sizes[ARRAYS + 1];
    size_t steps[ARRAYS + 1]; /* numbers between two states */
    int reads, frame;
    npy_intp states; /* 0 for one alone */
    PyArrayObject *out;
    const void *wrench; /* or NULL */
    npy_intp wrench_size;
    size_t wrench_step;
    npy_intp wrench_states; /* of the first array and the wrenches together, 0 for one alone */
    Code *codes[WAYS];      /* that it calls; NULL for none */
} Plain;

/* Find the codes that a call needs; 0 where all are armed. */
static int find_codes(Function *f, Plain *call)
{
    int lacking = 0;
    call->codes[OWN] = &f->codes[OWN][call->states > 0];
    if (call->wrench != NULL) call->codes[ADDED] = &f->codes[ADDED][call->wrench_states > 0];
    for (int way = 0; way < WAYS; ++way)
        lacking |= call->codes[way] != NULL && PUBLISHED(call->codes[way]->address) == 0;
    return lacking ? -1 : 0;
}

/* Look at the arguments; 0 where the call is plain. */
static int look(Function *f, const State *state, PyObject *const *given, Plain *call)
{
    for (int i = 0; i < f->places; ++i) { /* shapes first: what is large and not plain is read once */
        const Place *place = &f->place[i];
        PyObject *value = given[i];
        if (place->role <= WRENCH) {
            if (place->role != READ && (value == NULL || value == Py_None)) continue;
            if (value == NULL) return -1;
            const npy_intp states = states_of(value, f, &place->shape);
            if (states < 0) return -1;
            if (states > 0) {
                if (call->states != 0 && call->states != states) return -1;
                call->states = states;
            }
            if (place->role == WRENCH) {
                call->wrench = PyArray_DATA((PyArrayObject *)value);
                call->wrench_size = states > 0 ? states * place->shape.size : place->shape.size;
                call->wrench_step = states > 0 ? (size_t)place->shape.size : 0;
                continue;
            }
            const int to = place->role == READ ? call->reads++ : ARRAYS;
            call->x[to] = PyArray_DATA((PyArrayObject *)value);
            call->sizes[to] = states > 0 ? states * place->shape.size : place->shape.size;
            call->steps[to] = states > 0 ? (size_t)place->shape.size : 0;
        } else if (place->role == FRAME) {
            if (value == NULL || !PyUnicode_CheckExact(value)) return -1;
            PyObject *number = PyDict_GetItemWithError(f->frames, value);
            if (number == NULL) return -1;
            call->frame = (int)PyLong_AsLong(number);
        } else if (place->role == CUT) {
            if (f->cut_must_be_false && value != NULL && value != Py_False) return -1;
        } else if (value != NULL && value != Py_None) {
            if (place->role != OUT || !PyArray_CheckExact(value)) return -1;
            call->out = (PyArrayObject *)value;
        }
    }
    if (call->wrench != NULL && (call->steps[0] > 0 || call->wrench_step > 0)) call->wrench_states = call->states;
    if (find_codes(f, call) < 0) return -1;
    if (call->states > 0) {
        const Py_ssize_t threads = PUBLISHED(state->threads);
        if (threads > 1 && call->states >= 2 * SHARE) return -1;
        if (call->states > call->codes[OWN]->piece) return -1;
        if (call->wrench_states > 0 && call->states > call->codes[ADDED]->piece) return -1;
    }
    if (call->out != NULL) {
        const npy_intp states = states_of((PyObject *)call->out, f, &f->result);
        if (states != call->states || !PyArray_ISWRITEABLE(call->out)) return -1;
        const char *first = PyArray_DATA(call->out), *end = first + PyArray_NBYTES(call->out);
        for (int i = 0; i < call->reads; ++i) {
            const char *other = call->x[i];
            if (first < other + bytes_of(f, call->sizes[i]) && other < end) return -1;
        }
    }
    if (PUBLISHED(state->checks)) {
        for (int i = 0; i <= ARRAYS; ++i)
            if (call->sizes[i] > 0 && !all_finite(f, call->x[i], call->sizes[i])) return -1;
        if (call->wrench != NULL && !all_finite(f, call->wrench, call->wrench_size)) return -1;
    }
    return 0;
}

static PyArrayObject *new_result(const Function *f, npy_intp states)
{
    npy_intp lengths[AXES + 1] = {states};
    memcpy(lengths + 1, f->result.lengths, sizeof f->result.lengths);
    const int skipped = states == 0;
    Py_INCREF(f->dtype);
    return (PyArrayObject *)PyArray_NewFromDescr(&PyArray_Type, f->dtype, f->result.axes + 1 - skipped,
                                                 lengths + skipped, NULL, NULL, 0, NULL);
}

static long long compute(const Function *f, const void *h, const Plain *call, void *out)
{
    const int is_double = f->dtype->type_num == NPY_DOUBLE;
    if (call->states == 0)
        return (is_double ? one_double : one_float)(call->codes[OWN], f->framed, call->reads, h, call->x, call->frame,
                                                    out);
    return (is_double ? many_double : many_float)(call->codes[OWN], f->framed, call->reads, (size_t)call->states, h,
                                                  call->x, call->steps, call->frame, out);
}

/* What the wrenches add, for as many states as the first array and they have. */
static void compute_added(const Function *f, const void *h, const Plain *call, void *out)
{
    const int is_double = f->dtype->type_num == NPY_DOUBLE;
    const Code *code = call->codes[ADDED];
    const void *x[ARRAYS] = {call->x[0], call->wrench};
    const size_t steps[ARRAYS] = {call->steps[0], call->wrench_step};
    if (call->wrench_states == 0)
        (void)(is_double ? one_double : one_float)(code, 0, 2, h, x, 0, out);
    else
        (void)(is_double ? many_double : many_float)(code, 0, 2, (size_t)call->wrench_states, h, x, steps, 0, out);
}

/* to = from + sign * what, each of one state for all or of as many as there are. */
static void add(const Function *f, const void *from, npy_intp from_step, const void *what, npy_intp what_step,
                double sign, npy_intp states, npy_intp size, void *to)
{
    if (f->dtype->type_num == NPY_DOUBLE)
        sum_double(from, from_step, what, what_step, sign, states, size, to);
    else
        sum_float(from, from_step, what, what_step, (float)sign, states, size, to);
}

/* Numbers of a call with wrenches: what they add, and an array with it; in place where there are few. */
typedef struct {
    double few[128];
    void *memory; /* NULL for these */
    char *added, *sum;
} Beside;

static int make_room(const Function *f, const Plain *call, Beside *beside)
{
    const npy_intp size = f->into < 0 ? f->result.size : f->place[f->into].shape.size;
    const npy_intp states = call->wrench_states > 0 ? call->wrench_states : 1;
    const size_t one = (size_t)bytes_of(f, states * size);
    const size_t other = f->into < 0 ? 0 : (size_t)bytes_of(f, (call->states > 0 ? call->states : 1) * size);
    beside->memory = NULL;
    beside->added = (char *)beside->few;
    if (one + other > sizeof beside->few && (beside->added = beside->memory = PyMem_Malloc(one + other)) == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    beside->sum = beside->added + one;
    return 0;
}

/* Compute what the wrenches add, and put it into the array that takes it, if one does; 0 where all of it is regular. */
static int begin_added(const Function *f, const void *h, Plain *call, Beside *beside, int checks)
{
    const npy_intp size = f->into < 0 ? f->result.size : f->place[f->into].shape.size;
    const npy_intp states = call->wrench_states > 0 ? call->wrench_states : 1;
    const npy_intp step = call->wrench_states > 0 ? size : 0;
    compute_added(f, h, call, beside->added);
    if (checks && !all_finite(f, beside->added, states * size)) return -1;
    if (f->into < 0) return 0;
    for (npy_intp k = 0; k < states; ++k)
        for (Py_ssize_t i = 0; i < f->lefts; ++i)
            memset(beside->added + bytes_of(f, k * size + f->left[i]), 0, (size_t)bytes_of(f, 1));
    const int is_many = call->steps[f->into] > 0 || step > 0;
    const npy_intp all = is_many ? call->states : 1;
    add(f, call->x[f->into], (npy_intp)call->steps[f->into], beside->added, step, 1.0, all, size, beside->sum);
    if (checks && !all_finite(f, beside->sum, all * size)) return -1;
    call->x[f->into] = beside->sum;
    call->steps[f->into] = is_many ? (size_t)size : 0;
    return 0;
}

/* Compute with what the wrenches add; 0 where all of it is regular. */
static int compute_all(const Function *f, const void *h, const void *h_added, Plain *call, Beside *beside, int checks,
                       void *out)
{
    const npy_intp states = call->states > 0 ? call->states : 1, step = call->wrench_states > 0 ? f->result.size : 0;
    if (call->wrench != NULL && begin_added(f, h_added, call, beside, checks) < 0) return -1;
    if (compute(f, h, call, out) >= 0) return -1;
    if (call->wrench != NULL && f->into < 0) {
        if (checks && !all_finite(f, out, states * f->result.size)) return -1;
        add(f, out, f->result.size, beside->added, step, f->sign, states, f->result.size, out);
    }
    return checks && !all_finite(f, out, states * f->result.size) ? -1 : 0;
}

/* The result of a plain call; NULL without an error where the method in Python has to be asked.  ``codes`` are then
 * those that the call would need, and NULL if it is not plain whatever is armed. */
static PyObject *straight(Function *f, State *state, PyObject *const *args, Py_ssize_t count, PyObject *names,
                          Code **codes)
{
    PyObject *given[PLACES] = {NULL};
    Plain call = {.states = 0};
    Beside beside;
    if (sort_arguments(f, args, count, names, given) < 0) return NULL;
    const int is_plain = look(f, state, given, &call) == 0;
    memcpy(codes, call.codes, sizeof call.codes);
    if (!is_plain || (call.wrench != NULL && make_room(f, &call, &beside) < 0)) return NULL;
    PyObject *found = NULL;
    PyArrayObject *out = NULL, *kept = hoisted(state, f, codes[OWN]), *kept_added = NULL;
    if (kept != NULL && call.wrench != NULL) kept_added = hoisted(state, f, codes[ADDED]);
    if (kept == NULL || (call.wrench != NULL && kept_added == NULL)) goto end;
    const void *h = PyArray_DATA(kept), *h_added = kept_added == NULL ? NULL : PyArray_DATA(kept_added);
    out = call.out;
    if (out == NULL)
        out = new_result(f, call.states);
    else
        Py_INCREF(out);
    if (out == NULL) goto end;
    void *written = PyArray_DATA(out);
    const npy_intp states = call.states > 0 ? call.states : 1;
    const double operations = codes[OWN]->operations + (call.wrench == NULL ? 0.0 : codes[ADDED]->operations);
    const int checks = PUBLISHED(state->checks);
    int failed;
    if (operations * (double)states < LONG)
        failed = compute_all(f, h, h_added, &call, &beside, checks, written);
    else {
        Py_BEGIN_ALLOW_THREADS
        failed = compute_all(f, h, h_added, &call, &beside, checks, written);
        Py_END_ALLOW_THREADS
    }
    if (!failed) {
        if (f->in_three)
            found = three_views(f, out, call.states);
        else {
            found = (PyObject *)out;
            Py_INCREF(found);
        }
    }
end:
    Py_XDECREF(out);
    Py_XDECREF(kept);
    Py_XDECREF(kept_added);
    if (call.wrench != NULL) PyMem_Free(beside.memory);
    return found;
}

/* Ask for the address of a code, once: after a first call it is there. */
static int arm_once(Function *f, Way way, Code *code)
{
    int again = 1;
    Py_BEGIN_CRITICAL_SECTION(f);
    again = code->asked;
    code->asked = 1;
    Py_END_CRITICAL_SECTION();
    if (again) return 0;
    PyObject *many = code == &f->codes[way][1] ? Py_True : Py_False;
    PyObject *answer = PyObject_CallFunction(f->arming, "OsO", (PyObject *)f, WAY_NAMES[way], many);
    Py_XDECREF(answer);
    return answer == NULL ? -1 : 0;
}

static PyObject *direct_vectorcall(PyObject *self, PyObject *const *args, size_t nargsf, PyObject *names)
{
    Direct *direct = (Direct *)self;
    Function *f = direct->function;
    Code *codes[WAYS] = {NULL};
    PyObject *found = straight(f, direct->state, args, PyVectorcall_NARGS(nargsf), names, codes);
    if (found != NULL || PyErr_Occurred()) return found;
    PyObject *bound = PyMethod_New(f->method, direct->owner);
    if (bound == NULL) return NULL;
    found = PyObject_Vectorcall(bound, args, nargsf, names);
    Py_DECREF(bound);
    for (int way = 0; way < WAYS && found != NULL; ++way)
        if (codes[way] != NULL && PUBLISHED(codes[way]->address) == 0 && arm_once(f, (Way)way, codes[way]) < 0)
            Py_CLEAR(found);
    return found;
}

/* ---- Direct: the method of a kernel ---------------------------------------------------------------------------- */

static PyObject *bound_method(PyObject *self, void *closure)
{
    (void)closure;
    return PyMethod_New(((Direct *)self)->function->method, ((Direct *)self)->owner);
}

static PyObject *attribute_of_method(PyObject *self, const char *name)
{
    PyObject *bound = bound_method(self, NULL), *found = NULL;
    if (bound != NULL) found = PyObject_GetAttrString(bound, name);
    Py_XDECREF(bound);
    return found;
}

static PyObject *direct_doc(PyObject *self, void *closure)
{
    (void)closure;
    return attribute_of_method(self, "__doc__");
}

static PyObject *direct_is_armed(PyObject *self, void *closure)
{
    (void)closure;
    return PyBool_FromLong(PUBLISHED(((Direct *)self)->function->codes[OWN][0].address) != 0);
}

static PyObject *direct_takes_many(PyObject *self, void *closure)
{
    (void)closure;
    return PyBool_FromLong(PUBLISHED(((Direct *)self)->function->codes[OWN][1].address) != 0);
}

/* All that a bound method shows: its names, annotations, signature. */
static PyObject *direct_getattro(PyObject *self, PyObject *name)
{
    if (PyUnicode_Check(name) && PyUnicode_CompareWithASCIIString(name, "__module__") == 0)
        return attribute_of_method(self, "__module__");
    PyObject *found = PyObject_GenericGetAttr(self, name);
    if (found != NULL || !PyErr_ExceptionMatches(PyExc_AttributeError)) return found;
    PyErr_Clear();
    PyObject *bound = bound_method(self, NULL);
    if (bound != NULL) found = PyObject_GetAttr(bound, name);
    Py_XDECREF(bound);
    return found;
}

static PyObject *direct_repr(PyObject *self)
{
    PyObject *bound = bound_method(self, NULL), *found = NULL;
    if (bound != NULL) found = PyObject_Repr(bound);
    Py_XDECREF(bound);
    return found;
}

/* As a bound method: the attribute of that name of its kernel. */
static PyObject *direct_reduce(PyObject *self, PyObject *unused)
{
    (void)unused;
    PyObject *builtins = PyEval_GetBuiltins(), *getter = PyDict_GetItemString(builtins, "getattr");
    if (getter == NULL) return PyErr_Format(PyExc_RuntimeError, "no getattr among the built-in functions");
    return Py_BuildValue("O(OO)", getter, ((Direct *)self)->owner, ((Direct *)self)->function->name);
}

static PyObject *direct_itself(PyObject *self, PyObject *unused)
{
    (void)unused;
    Py_INCREF(self);
    return self;
}

/* Makes it a routine for `help`; as an attribute of a class it stays what it is, as a bound method does. */
static PyObject *direct_get(PyObject *self, PyObject *object, PyObject *type)
{
    (void)object, (void)type;
    Py_INCREF(self);
    return self;
}

static int direct_traverse(PyObject *self, visitproc visit, void *arg)
{
    Direct *direct = (Direct *)self;
    Py_VISIT(Py_TYPE(self));
    Py_VISIT(direct->function);
    Py_VISIT(direct->state);
    Py_VISIT(direct->owner);
    return 0;
}

/* No tp_clear: a Direct is never without its parts, and whoever keeps it in a circle can be cleared instead. */
static void direct_dealloc(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    Py_XDECREF(((Direct *)self)->function);
    Py_XDECREF(((Direct *)self)->state);
    Py_XDECREF(((Direct *)self)->owner);
    type->tp_free(self);
    Py_DECREF(type);
}

static PyMemberDef direct_members[] = {
    {"__vectorcalloffset__", T_PYSSIZET, offsetof(Direct, vectorcall), READONLY, NULL},
    {NULL, 0, 0, 0, NULL},
};
static PyGetSetDef direct_getset[] = {
    {"__doc__", direct_doc, NULL, NULL, NULL},
    {"__wrapped__", bound_method, NULL, "the method in Python, bound", NULL},
    {"is_armed", direct_is_armed, NULL, "whether plain calls with one state go to the code", NULL},
    {"takes_many", direct_takes_many, NULL, "whether plain calls with many states go to the code", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};
static PyMethodDef direct_methods[] = {
    {"__reduce__", direct_reduce, METH_NOARGS, NULL},
    {"__copy__", direct_itself, METH_NOARGS, NULL},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot direct_slots[] = {
    {Py_tp_call, PyVectorcall_Call},
    {Py_tp_dealloc, direct_dealloc},
    {Py_tp_traverse, direct_traverse},
    {Py_tp_getattro, direct_getattro},
    {Py_tp_repr, direct_repr},
    {Py_tp_descr_get, direct_get},
    {Py_tp_members, direct_members},
    {Py_tp_getset, direct_getset},
    {Py_tp_methods, direct_methods},
    {0, NULL},
};
static PyType_Spec direct_spec = {
    .name = "eomgen.Direct",
    .basicsize = sizeof(Direct),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_IMMUTABLETYPE |
             Py_TPFLAGS_DISALLOW_INSTANTIATION,
    .slots = direct_slots,
};

/* ---- Function: what a method does in all kernels of a package -------------------------------------------------- */

static int read_shape(PyObject *lengths, Shape *shape)
{
    if (!PyTuple_Check(lengths) || PyTuple_GET_SIZE(lengths) > AXES) {
        PyErr_SetString(PyExc_ValueError, "a shape is a tuple with at most three lengths");
        return -1;
    }
    shape->axes = (int)PyTuple_GET_SIZE(lengths);
    shape->size = 1;
    for (int i = 0; i < shape->axes; ++i) {
        const Py_ssize_t length = PyLong_AsSsize_t(PyTuple_GET_ITEM(lengths, i));
        if (length == -1 && PyErr_Occurred()) return -1;
        shape->lengths[i] = length;
        shape->size *= length;
    }
    return 0;
}

static int read_place(PyObject *given, Place *place)
{
    static const char *const names[] = {"read", "beside", "wrench", "frame", "out", "nothing", "cut"};
    PyObject *label, *lengths;
    const char *role;
    if (!PyArg_ParseTuple(given, "UsO:place", &label, &role, &lengths) || read_shape(lengths, &place->shape) < 0)
        return -1;
    size_t found = 0;
    while (found < sizeof names / sizeof *names && strcmp(names[found], role) != 0) ++found;
    if (found == sizeof names / sizeof *names) {
        PyErr_Format(PyExc_ValueError, "role %s is none of a parameter", role);
        return -1;
    }
    place->role = (Role)found;
    Py_INCREF(label);
    PyUnicode_InternInPlace(&label);
    place->label = label;
    return 0;
}

static int read_places(Function *f, PyObject *places)
{
    const Py_ssize_t count = PyTuple_GET_SIZE(places);
    int reads = 0, beside = 0, wrenches = 0;
    if (count > PLACES) {
        PyErr_SetString(PyExc_ValueError, "too many parameters");
        return -1;
    }
    for (Py_ssize_t i = 0; i < count; ++i) {
        if (read_place(PyTuple_GET_ITEM(places, i), &f->place[i]) < 0) return -1;
        f->places = (int)i + 1;
        reads += f->place[i].role == READ;
        beside += f->place[i].role == BESIDE;
        wrenches += f->place[i].role == WRENCH;
        f->framed |= f->place[i].role == FRAME;
    }
    if (reads < 1 || reads > ARRAYS || beside > 1 || wrenches > 1 || (f->framed && (reads != 1 || f->frames == NULL))) {
        PyErr_SetString(PyExc_ValueError, "no function reads such arrays");
        return -1;
    }
    return 0;
}

/* What is added of wrenches: a sign, the place of the array that takes it or -1, and its numbers that take nothing. */
static int read_added(Function *f, PyObject *given)
{
    PyObject *left;
    if (!PyArg_ParseTuple(given, "diO!:added", &f->sign, &f->into, &PyTuple_Type, &left)) return -1;
    int reads = 0; /* at the beginning: there the number of a place is that of its array */
    while (reads < f->places && f->place[reads].role == READ) ++reads;
    if (f->into < -1 || f->into >= reads) {
        PyErr_SetString(PyExc_ValueError, "nothing can be added there");
        return -1;
    }
    const npy_intp size = f->into < 0 ? 0 : f->place[f->into].shape.size;
    f->left = PyMem_Calloc((size_t)PyTuple_GET_SIZE(left) + 1, sizeof *f->left);
    if (f->left == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    for (; f->lefts < PyTuple_GET_SIZE(left); ++f->lefts) {
        const Py_ssize_t place = PyLong_AsSsize_t(PyTuple_GET_ITEM(left, f->lefts));
        if (place < 0 || place >= size) {
            if (!PyErr_Occurred()) PyErr_SetString(PyExc_IndexError, "no such number of the array");
            return -1;
        }
        f->left[f->lefts] = place;
    }
    return 0;
}

static PyObject *function_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"name",     "method",           "arming", "dtype", "places", "positional", "result",
                            "in_three", "cut_must_be_false", "frames", "added", NULL};
    PyObject *name, *method, *arming, *dtype, *places, *result, *frames, *added;
    int positional, in_three, cut;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "UOOO!O!iOppO!O!:Function", names, &name, &method, &arming,
                                     &PyArrayDescr_Type, &dtype, &PyTuple_Type, &places, &positional, &result,
                                     &in_three, &cut, &PyDict_Type, &frames, &PyTuple_Type, &added))
        return NULL;
    const int number = ((PyArray_Descr *)dtype)->type_num;
    if ((number != NPY_DOUBLE && number != NPY_FLOAT) || !PyArray_ISNBO(((PyArray_Descr *)dtype)->byteorder)) {
        PyErr_SetString(PyExc_ValueError, "a dtype is float64 or float32 of this machine");
        return NULL;
    }
    Function *f = (Function *)type->tp_alloc(type, 0);
    if (f == NULL) return NULL;
    Py_INCREF(name), f->name = name;
    Py_INCREF(method), f->method = method;
    Py_INCREF(arming), f->arming = arming;
    Py_INCREF(frames), f->frames = frames;
    Py_INCREF(dtype), f->dtype = (PyArray_Descr *)dtype;
    f->positional = positional;
    f->in_three = in_three;
    f->cut_must_be_false = cut;
    if (read_places(f, places) < 0 || read_shape(result, &f->result) < 0 || read_added(f, added) < 0) goto failed;
    if (positional > f->places || (in_three && (f->result.axes != 3 || f->result.lengths[0] != 3))) {
        PyErr_SetString(PyExc_ValueError, "no function has such parameters or such a result");
        goto failed;
    }
    return (PyObject *)f;
failed:
    Py_DECREF(f);
    return NULL;
}

PyDoc_STRVAR(arm_doc, "arm(way, many, library, part, code, setup, hoisted, operations, piece)\n\n"
                      "Tell where a code is; from then on plain calls go there.\n\n"
                      "Arguments: which code: the \"own\" one or what is \"added\", for many states or for one; its\n"
                      "library, which is kept, and the number of that; addresses of the code and of what computes\n"
                      "from the parameters, how many numbers; operations of a state; states that one call computes at\n"
                      "most.");

static PyObject *function_arm(PyObject *self, PyObject *args)
{
    Function *f = (Function *)self;
    unsigned long long address, setup;
    PyObject *library;
    const char *name;
    int many, part, way = 0;
    double operations;
    Py_ssize_t hoisted_count, piece;
    if (!PyArg_ParseTuple(args, "spOiKKndn:arm", &name, &many, &library, &part, &address, &setup, &hoisted_count,
                          &operations, &piece))
        return NULL;
    while (way < WAYS && strcmp(WAY_NAMES[way], name) != 0) ++way;
    if (way == WAYS) return PyErr_Format(PyExc_ValueError, "arm: %s is no code of a function", name);
    if (part < 0 || part >= PARTS) Py_RETURN_FALSE;
    npy_intp least = f->result.size;
    for (int i = 0; i < f->places; ++i)
        if (f->place[i].role <= WRENCH && f->place[i].shape.size < least) least = f->place[i].shape.size;
    if (least < 1 || address == 0 || setup == 0) Py_RETURN_FALSE; /* nothing to point to */
    Code *code = &f->codes[way][many];
    Py_BEGIN_CRITICAL_SECTION(self);
    if (code->address == 0) {
        Py_INCREF(library), code->library = library;
        code->part = part;
        code->operations = operations;
        code->piece = piece;
        code->hoisted = hoisted_count;
        code->setup = (uintptr_t)setup;
        PUBLISH(code->address, (uintptr_t)address);
    }
    Py_END_CRITICAL_SECTION();
    Py_RETURN_TRUE;
}

static int function_traverse(PyObject *self, visitproc visit, void *arg)
{
    Function *f = (Function *)self;
    Py_VISIT(Py_TYPE(self));
    Py_VISIT(f->method);
    Py_VISIT(f->arming);
    Py_VISIT(f->frames);
    for (int way = 0; way < WAYS; ++way)
        for (int many = 0; many < 2; ++many) Py_VISIT(f->codes[way][many].library);
    return 0;
}

static void function_dealloc(PyObject *self)
{
    Function *f = (Function *)self;
    PyTypeObject *type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    Py_XDECREF(f->method);
    Py_XDECREF(f->name);
    Py_XDECREF(f->arming);
    Py_XDECREF(f->frames);
    for (int way = 0; way < WAYS; ++way)
        for (int many = 0; many < 2; ++many) Py_XDECREF(f->codes[way][many].library);
    PyMem_Free(f->left);
    Py_XDECREF(f->dtype);
    for (int i = 0; i < f->places; ++i) Py_DECREF(f->place[i].label);
    type->tp_free(self);
    Py_DECREF(type);
}

static PyMemberDef function_members[] = {
    {"name", T_OBJECT_EX, offsetof(Function, name), READONLY, "name of the method"},
    {NULL, 0, 0, 0, NULL},
};
static PyMethodDef function_methods[] = {
    {"arm", function_arm, METH_VARARGS, arm_doc},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot function_slots[] = {
    {Py_tp_new, function_new},         {Py_tp_dealloc, function_dealloc}, {Py_tp_traverse, function_traverse},
    {Py_tp_members, function_members}, {Py_tp_methods, function_methods}, {0, NULL},
};
static PyType_Spec function_spec = {
    .name = "eomgen.Function",
    .basicsize = sizeof(Function),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = function_slots,
};

/* ---- State: what may change of a kernel ------------------------------------------------------------------------ */

static PyObject *state_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"values", "make", "checks", "threads", NULL};
    PyObject *values, *make;
    int checks = 1;
    Py_ssize_t threads = 1;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!O|pn:State", names, &PyArray_Type, &values, &make, &checks,
                                     &threads))
        return NULL;
    const int number = PyArray_TYPE((PyArrayObject *)values);
    if ((number != NPY_DOUBLE && number != NPY_FLOAT) || !PyArray_ISCARRAY_RO((PyArrayObject *)values) ||
        PyArray_NDIM((PyArrayObject *)values) != 1) {
        PyErr_SetString(PyExc_ValueError, "values are float64 or float32 numbers, one behind the other");
        return NULL;
    }
    State *state = (State *)type->tp_alloc(type, 0);
    if (state == NULL) return NULL;
    Py_INCREF(values), state->values = (PyArrayObject *)values;
    Py_INCREF(make), state->make = make;
    state->checks = (char)checks;
    state->threads = threads;
    return (PyObject *)state;
}

static PyObject *state_values(PyObject *self, void *closure)
{
    (void)closure;
    PyArrayObject *values = NULL;
    Py_BEGIN_CRITICAL_SECTION(self);
    values = ((State *)self)->values;
    Py_INCREF(values);
    Py_END_CRITICAL_SECTION();
    return (PyObject *)values;
}

static PyObject *state_setup(PyObject *self, void *closure)
{
    (void)closure;
    State *state = (State *)self;
    PyObject *setup = NULL, *values = NULL;
    Py_BEGIN_CRITICAL_SECTION(self);
    setup = state->setup;
    Py_XINCREF(setup);
    values = (PyObject *)state->values;
    Py_INCREF(values);
    Py_END_CRITICAL_SECTION();
    if (setup == NULL && (setup = PyObject_CallOneArg(state->make, values)) != NULL) {
        PyObject *other = NULL;
        Py_BEGIN_CRITICAL_SECTION(self);
        if ((PyObject *)state->values == values) { /* no assignment came between */
            if (state->setup != NULL) { /* another thread was faster */
                other = setup;
                setup = state->setup;
            } else
                state->setup = setup;
            Py_INCREF(setup);
        }
        Py_END_CRITICAL_SECTION();
        Py_XDECREF(other);
    }
    Py_DECREF(values);
    return setup;
}

/* New values in place of the old ones; what was computed of those goes with the last call that reads it. */
static PyObject *state_assign(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    State *state = (State *)self;
    PyArrayObject *old = NULL, *values = NULL, *gone[PARTS];
    PyObject *setup = NULL;
    int parts = 0;
    if (count % 2 != 0) return PyErr_Format(PyExc_TypeError, "assign: a number for every slot");
    Py_BEGIN_CRITICAL_SECTION(self);
    values = (PyArrayObject *)PyArray_NewCopy(state->values, NPY_CORDER);
    for (Py_ssize_t i = 0; values != NULL && i < count; i += 2) {
        const Py_ssize_t slot = PyLong_AsSsize_t(args[i]);
        const double number = PyFloat_AsDouble(args[i + 1]);
        if (!PyErr_Occurred() && (slot < 0 || slot >= PyArray_SIZE(values)))
            PyErr_SetString(PyExc_IndexError, "assign: no such slot");
        if (PyErr_Occurred())
            Py_CLEAR(values);
        else if (PyArray_TYPE(values) == NPY_DOUBLE)
            ((double *)PyArray_DATA(values))[slot] = number;
        else
            ((float *)PyArray_DATA(values))[slot] = (float)number;
    }
    if (values != NULL) {
        old = state->values;
        state->values = values;
        setup = state->setup;
        state->setup = NULL;
        for (; parts < state->parts; ++parts) {
            gone[parts] = state->h[parts];
            state->h[parts] = NULL;
        }
        state->parts = 0;
    }
    Py_END_CRITICAL_SECTION();
    while (parts > 0) Py_XDECREF(gone[--parts]);
    Py_XDECREF(setup);
    if (old == NULL) return NULL;
    Py_DECREF(old);
    Py_RETURN_NONE;
}

static PyObject *state_copy(PyObject *self, PyObject *unused)
{
    (void)unused;
    State *state = (State *)self, *other = (State *)Py_TYPE(self)->tp_alloc(Py_TYPE(self), 0);
    if (other == NULL) return NULL;
    Py_BEGIN_CRITICAL_SECTION(self);
    Py_INCREF(state->values), other->values = state->values;
    Py_INCREF(state->make), other->make = state->make;
    Py_XINCREF(state->setup), other->setup = state->setup;
    other->checks = state->checks;
    other->threads = state->threads;
    other->parts = state->parts;
    for (int i = 0; i < state->parts; ++i) {
        Py_XINCREF(state->h[i]);
        other->h[i] = state->h[i];
    }
    Py_END_CRITICAL_SECTION();
    return (PyObject *)other;
}

static int state_traverse(PyObject *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE(self));
    Py_VISIT(((State *)self)->make);
    Py_VISIT(((State *)self)->setup); /* the arrays lead nowhere */
    return 0;
}

static void state_dealloc(PyObject *self)
{
    State *state = (State *)self;
    PyTypeObject *type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    Py_XDECREF(state->values);
    Py_XDECREF(state->make);
    Py_XDECREF(state->setup);
    for (int i = 0; i < state->parts; ++i) Py_XDECREF(state->h[i]);
    type->tp_free(self);
    Py_DECREF(type);
}

PyDoc_STRVAR(assign_doc, "assign(slot, number, ...)\n\n"
                         "Replace the values by others that differ in these slots, at once.");
PyDoc_STRVAR(copy_doc, "copy()\n\n"
                       "A state with the same values, checks and threads; neither sees what becomes of the other.");

static PyMemberDef state_members[] = {
    {"checks", T_BOOL, offsetof(State, checks), 0, "whether NaN and infinity are refused"},
    {"threads", T_PYSSIZET, offsetof(State, threads), 0, "how many threads share a batch"},
    {NULL, 0, 0, 0, NULL},
};
static PyGetSetDef state_getset[] = {
    {"values", state_values, NULL, "values of the parameters, not to be written to", NULL},
    {"setup", state_setup, NULL, "what make(values) gives", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};
static PyMethodDef state_methods[] = {
    {"assign", (PyCFunction)(void (*)(void))state_assign, METH_FASTCALL, assign_doc},
    {"copy", state_copy, METH_NOARGS, copy_doc},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot state_slots[] = {
    {Py_tp_new, state_new},         {Py_tp_dealloc, state_dealloc}, {Py_tp_traverse, state_traverse},
    {Py_tp_members, state_members}, {Py_tp_getset, state_getset},   {Py_tp_methods, state_methods},
    {0, NULL},
};
static PyType_Spec state_spec = {
    .name = "eomgen.State",
    .basicsize = sizeof(State),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = state_slots,
};

/* ---- the module ------------------------------------------------------------------------------------------------ */

PyDoc_STRVAR(bind_doc, "bind(functions, owner, state, into)\n\n"
                       "Put a Direct of every function into a dict, by its name.\n\n"
                       "Arguments: a tuple of Function; a kernel whose methods are those of Python; its State; a\n"
                       "dict.");

static PyObject *bind(PyObject *module, PyObject *args)
{
    const Types *types = PyModule_GetState(module);
    PyObject *functions, *owner, *state, *into;
    if (!PyArg_ParseTuple(args, "O!OO!O!:bind", &PyTuple_Type, &functions, &owner, types->state, &state, &PyDict_Type,
                          &into))
        return NULL;
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(functions); ++i) {
        PyObject *function = PyTuple_GET_ITEM(functions, i);
        if (!PyObject_TypeCheck(function, types->function))
            return PyErr_Format(PyExc_TypeError, "bind: a %s is no Function", Py_TYPE(function)->tp_name);
        Direct *direct = (Direct *)types->direct->tp_alloc(types->direct, 0);
        if (direct == NULL) return NULL;
        direct->vectorcall = direct_vectorcall;
        Py_INCREF(function), direct->function = (Function *)function;
        Py_INCREF(state), direct->state = (State *)state;
        Py_INCREF(owner), direct->owner = owner;
        const int failed = PyDict_SetItem(into, direct->function->name, (PyObject *)direct);
        Py_DECREF(direct);
        if (failed) return NULL;
    }
    Py_RETURN_NONE;
}

/* Numpy 2 runs what was compiled for it alone, and says so at length on the error stream: better not to ask it. */
static int fits_numpy(void)
{
    PyObject *numpy = PyImport_ImportModule("numpy"), *version = NULL;
    const char *text = NULL;
    int fits = 0;
    if (numpy != NULL) version = PyObject_GetAttrString(numpy, "__version__");
    if (version != NULL) text = PyUnicode_AsUTF8(version);
    if (text != NULL) {
        fits = text[0] == '1' && text[1] == '.' ? 1 : NPY_ABI_VERSION >= 0x02000000;
        if (!fits) PyErr_SetString(PyExc_ImportError, "compiled for another NumPy");
    }
    Py_XDECREF(version);
    Py_XDECREF(numpy);
    return fits ? 0 : -1;
}

static int add_type(PyObject *module, PyType_Spec *spec, PyTypeObject **type)
{
    *type = (PyTypeObject *)PyType_FromModuleAndSpec(module, spec, NULL);
    return *type == NULL ? -1 : PyModule_AddType(module, *type);
}

static int module_exec(PyObject *module)
{
    Types *types = PyModule_GetState(module);
    if (fits_numpy() < 0 || _import_array() < 0) return -1;
    if (add_type(module, &direct_spec, &types->direct) < 0) return -1;
    if (add_type(module, &function_spec, &types->function) < 0) return -1;
    return add_type(module, &state_spec, &types->state);
}

static int module_traverse(PyObject *module, visitproc visit, void *arg)
{
    const Types *types = PyModule_GetState(module);
    Py_VISIT(types->function);
    Py_VISIT(types->state);
    Py_VISIT(types->direct);
    return 0;
}

static int module_clear(PyObject *module)
{
    Types *types = PyModule_GetState(module);
    Py_CLEAR(types->function);
    Py_CLEAR(types->state);
    Py_CLEAR(types->direct);
    return 0;
}

static PyMethodDef module_methods[] = {
    {"bind", bind, METH_VARARGS, bind_doc},
    {NULL, NULL, 0, NULL},
};
static PyModuleDef_Slot module_slots[] = {
    {Py_mod_exec, module_exec},
#ifdef Py_mod_gil
    {Py_mod_gil, Py_MOD_GIL_NOT_USED},
#endif
    {0, NULL},
};
static struct PyModuleDef module_definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = "_direct",
    .m_doc = "Methods of kernels as callables in C.",
    .m_size = sizeof(Types),
    .m_methods = module_methods,
    .m_slots = module_slots,
    .m_traverse = module_traverse,
    .m_clear = module_clear,
};

PyMODINIT_FUNC PyInit__direct(void)
{
    return PyModuleDef_Init(&module_definition);
}
