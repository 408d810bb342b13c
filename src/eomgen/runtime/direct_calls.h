/* Plain calls: arguments are looked at, codes are looked up and called, results are made; direct.c includes it. */
#include "direct_numbers.h"

/* ---- codes ---------------------------------------------------------------------------------------------------- */

/* Types of so many arrays, R each, with numbers between their states where there are many; and the arrays themselves. */
#define R_1 R
#define R_2 R_1, R
#define R_3 R_2, R
#define R_4 R_3, R
#define R_5 R_4, R
#define R_6 R_5, R
#define R_7 R_6, R
#define R_8 R_7, R
#define R_9 R_8, R
#define R_10 R_9, R
#define R_11 R_10, R
#define R_12 R_11, R
#define X_1 x[0]
#define X_2 X_1, x[1]
#define X_3 X_2, x[2]
#define X_4 X_3, x[3]
#define X_5 X_4, x[4]
#define X_6 X_5, x[5]
#define X_7 X_6, x[6]
#define X_8 X_7, x[7]
#define X_9 X_8, x[8]
#define X_10 X_9, x[9]
#define X_11 X_10, x[10]
#define X_12 X_11, x[11]
#define RS_1 R, size_t
#define RS_2 RS_1, R, size_t
#define RS_3 RS_2, R, size_t
#define RS_4 RS_3, R, size_t
#define RS_5 RS_4, R, size_t
#define RS_6 RS_5, R, size_t
#define RS_7 RS_6, R, size_t
#define RS_8 RS_7, R, size_t
#define RS_9 RS_8, R, size_t
#define RS_10 RS_9, R, size_t
#define RS_11 RS_10, R, size_t
#define RS_12 RS_11, R, size_t
#define XS_1 x[0], s[0]
#define XS_2 XS_1, x[1], s[1]
#define XS_3 XS_2, x[2], s[2]
#define XS_4 XS_3, x[3], s[3]
#define XS_5 XS_4, x[4], s[4]
#define XS_6 XS_5, x[5], s[5]
#define XS_7 XS_6, x[6], s[6]
#define XS_8 XS_7, x[7], s[7]
#define XS_9 XS_8, x[8], s[8]
#define XS_10 XS_9, x[9], s[9]
#define XS_11 XS_10, x[10], s[10]
#define XS_12 XS_11, x[11], s[11]

/* Code of one state and of a batch, with as many arrays as it reads; -1 or the first failure. */
#define ONE(REAL, K)                                                                                                   \
    case K: return ((int (*)(R, R_##K, REAL *))c->address)(h, X_##K, out) - 1LL;
#define MANY(REAL, K)                                                                                                  \
    case K: return ((long long (*)(size_t, R, RS_##K, REAL *))c->address)(n, h, XS_##K, out);
#define ALL(CASE, REAL)                                                                                                \
    CASE(REAL, 1) CASE(REAL, 2) CASE(REAL, 3) CASE(REAL, 4) CASE(REAL, 5) CASE(REAL, 6) CASE(REAL, 7) CASE(REAL, 8)    \
    CASE(REAL, 9) CASE(REAL, 10) CASE(REAL, 11) CASE(REAL, 12)
#define DEFINE_CALLS(REAL)                                                                                             \
    static long long one_##REAL(const Code *c, int framed, int reads, const void *h, const void *const *x,             \
                                int frame, void *out)                                                                  \
    {                                                                                                                  \
        typedef const REAL *R;                                                                                         \
        if (framed) return ((int (*)(R, R, int, REAL *))c->address)(h, x[0], frame, out) - 1LL;                        \
        switch (reads) {                                                                                               \
            ALL(ONE, REAL)                                                                                             \
        default: return -1;                                                                                            \
        }                                                                                                              \
    }                                                                                                                  \
    static long long many_##REAL(const Code *c, int framed, int reads, size_t n, const void *h, const void *const *x,  \
                                 const size_t *s, int frame, void *out)                                                \
    {                                                                                                                  \
        typedef const REAL *R;                                                                                         \
        if (framed)                                                                                                    \
            return ((long long (*)(size_t, R, R, size_t, int, REAL *))c->address)(n, h, x[0], s[0], frame, out);       \
        switch (reads) {                                                                                               \
            ALL(MANY, REAL)                                                                                            \
        default: return -1;                                                                                            \
        }                                                                                                              \
    }
DEFINE_CALLS(double)
DEFINE_CALLS(float)

/* ---- arrays -------------------------------------------------------------------------------------------------- */

/* Numbers between two states; 0 for one state alone. */
static size_t step_of(const Shape *shape, npy_intp states) { return states == 0 ? 0 : (size_t)shape->size; }

/* An array that the code can take as it is, of one state or of many: their number, 0 for one alone; -1 for another. */
static npy_intp states_of(PyObject *value, const Function *f, const Shape *shape)
{
    if (!PyArray_CheckExact(value)) return -1;
    PyArrayObject *array = (PyArrayObject *)value;
    const int plain = NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED;
    if ((PyArray_FLAGS(array) & plain) != plain) return -1;
    const PyArray_Descr *dtype = PyArray_DESCR(array);
    if (dtype != f->dtype && (dtype->type_num != f->dtype->type_num || !PyArray_ISNBO(dtype->byteorder))) return -1;
    const int more = PyArray_NDIM(array) - shape->axes, leading = more > 0;
    if (more != 0 && more != 1) return -1;
    const npy_intp *lengths = PyArray_DIMS(array);
    for (int i = 0; i < shape->axes; ++i)
        if (lengths[leading + i] != shape->lengths[i]) return -1;
    if (leading == 0) return 0;
    return lengths[0] > 0 ? lengths[0] : -1;
}

/* The parts of a result along its first axis, as views of it. */
static PyObject *views_of(const Function *f, PyArrayObject *whole, npy_intp states)
{
    const npy_intp count = f->returned.lengths[0], size = count > 0 ? f->returned.size / count : 0;
    const int axes = f->returned.axes, skipped = states == 0;
    npy_intp lengths[AXES] = {states}, steps[AXES] = {bytes_of(f, f->returned.size)};
    npy_intp below = size;
    for (int i = 1; i < f->returned.axes; ++i) {
        lengths[i] = f->returned.lengths[i];
        below = lengths[i] > 0 ? below / lengths[i] : 0;
        steps[i] = bytes_of(f, below);
    }
    PyObject *views = PyTuple_New(count);
    if (views == NULL) return NULL;
    for (npy_intp i = 0; i < count; ++i) {
        PyArray_Descr *dtype = PyArray_DESCR(whole);
        Py_INCREF(dtype);
        char *first = PyArray_BYTES(whole) + bytes_of(f, i * size);
        PyObject *view = PyArray_NewFromDescr(&PyArray_Type, dtype, axes - skipped, lengths + skipped, steps + skipped,
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

/* What the code's library reads of the parameters; a new reference, which a running call keeps. */
static PyArrayObject *hoisted(State *state, const Function *f, const Code *code)
{
    PyArrayObject *h = NULL, *other = NULL, *values = NULL;
    Py_BEGIN_CRITICAL_SECTION(state);
    h = state->h[code->number];
    Py_XINCREF(h);
    if (h == NULL) values = state->values;
    Py_XINCREF(values);
    Py_END_CRITICAL_SECTION();
    if (h != NULL) return h;
    h = computed_from(values, f, code);
    if (h != NULL) {
        Py_BEGIN_CRITICAL_SECTION(state);
        if (state->values == values) { /* no assignment came between */
            other = state->h[code->number];
            Py_INCREF(h);
            state->h[code->number] = h;
            if (state->libraries <= code->number) state->libraries = code->number + 1;
        }
        Py_END_CRITICAL_SECTION();
    }
    Py_XDECREF(other);
    Py_DECREF(values);
    return h;
}

/* Arguments by place, NULL where there is none; -1 where there are too many, or a name is unknown or comes twice. */
static int sort_arguments(const Function *f, PyObject *const *args, Py_ssize_t count, PyObject *names,
                          PyObject **arguments)
{
    if (count > f->positional) return -1;
    for (Py_ssize_t i = 0; i < f->places; ++i) arguments[i] = i < count ? args[i] : NULL;
    const Py_ssize_t named = names == NULL ? 0 : PyTuple_GET_SIZE(names);
    for (Py_ssize_t k = 0; k < named; ++k) {
        int place = 0;
        while (place < f->places && f->place[place].label != PyTuple_GET_ITEM(names, k)) ++place;
        if (place == f->places || arguments[place] != NULL) return -1;
        arguments[place] = args[count + k];
    }
    return 0;
}

/* A plain call: its arguments as the code takes them. */
typedef struct {
    int frame;
    npy_intp states; /* 0 for one alone */
    PyArrayObject *out;
    const void *wrench; /* or NULL */
    npy_intp wrench_size;
    size_t wrench_step;
    npy_intp wrench_states; /* of the first array and the wrenches together, 0 for one alone */
    Code *codes[KINDS];     /* that it calls; NULL for none */
    const void *x[ARRAYS];  /* the arrays that the code reads, from here on set as they are found */
    npy_intp sizes[ARRAYS];
    size_t steps[ARRAYS]; /* numbers between two states */
} Plain;

/* Find the codes that a call needs; 0 where all are armed. */
static int find_codes(Function *f, Plain *call)
{
    int lacking = 0;
    call->codes[MAIN] = &f->codes[MAIN][call->states > 0];
    if (call->wrench != NULL) call->codes[ADDED] = &f->codes[ADDED][call->wrench_states > 0];
    for (int kind = 0; kind < KINDS; ++kind)
        lacking |= call->codes[kind] != NULL && PUBLISHED(call->codes[kind]->address) == 0;
    return lacking ? -1 : 0;
}

/* Whether numbers are looked at piece by piece, in ``compute_pieces``. */
static int in_pieces(const Plain *call) { return call->states > 0 && call->wrench == NULL; }

/* Look at the arguments; 0 where the call is plain. */
static int look(Function *f, const State *state, PyObject *const *arguments, Plain *call)
{
    for (int i = 0; i < f->places; ++i) { /* shapes first: what is large and not plain is read once */
        const Place *place = &f->place[i];
        PyObject *value = arguments[i];
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
                call->wrench_step = step_of(&place->shape, states);
                continue;
            }
            const int to = place->array;
            call->x[to] = PyArray_DATA((PyArrayObject *)value);
            call->sizes[to] = states > 0 ? states * place->shape.size : place->shape.size;
            call->steps[to] = step_of(&place->shape, states);
        } else if (place->role == FRAME) {
            if (value == NULL || !PyUnicode_CheckExact(value)) return -1;
            PyObject *number = PyDict_GetItemWithError(f->frames, value);
            if (number == NULL) return -1;
            call->frame = (int)PyLong_AsLong(number);
        } else if (place->role == CUT) {
            if (value != NULL && value != Py_False && (f->cut_must_be_false || value != Py_True)) return -1;
        } else if (place->role == ZEROS) {
            if (value != NULL) return -1;
            const int to = place->array;
            call->x[to] = f->zeros;
            call->sizes[to] = 0;
            call->steps[to] = 0;
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
        if (call->states > call->codes[MAIN]->piece) return -1;
        if (call->wrench_states > 0 && call->states > call->codes[ADDED]->piece) return -1;
    }
    if (call->out != NULL) {
        const npy_intp states = states_of((PyObject *)call->out, f, &f->returned);
        if (states != call->states || !PyArray_ISWRITEABLE(call->out)) return -1;
        const char *first = PyArray_DATA(call->out), *end = first + PyArray_NBYTES(call->out);
        for (int i = 0; i < f->reads; ++i) {
            const char *other = call->x[i];
            if (first < other + bytes_of(f, call->sizes[i]) && other < end) return -1;
        }
    }
    if (PUBLISHED(state->checks)) {
        for (int i = 0; i < f->reads; ++i) {
            if (in_pieces(call) && call->steps[i] > 0) continue; /* each piece by itself */
            if (!all_finite(f, call->x[i], call->sizes[i])) return -1;
        }
        if (call->wrench != NULL && !all_finite(f, call->wrench, call->wrench_size)) return -1;
    }
    return 0;
}

static PyArrayObject *new_result(const Function *f, npy_intp states)
{
    npy_intp lengths[AXES + 1] = {states};
    memcpy(lengths + 1, f->returned.lengths, sizeof f->returned.lengths);
    const int skipped = states == 0, axes = f->returned.axes + 1 - skipped;
    Py_INCREF(f->dtype);
    return (PyArrayObject *)PyArray_NewFromDescr(&PyArray_Type, f->dtype, axes, lengths + skipped, NULL, NULL, 0, NULL);
}

static long long compute(const Function *f, const void *h, const Plain *call, void *out)
{
    const int is_double = f->dtype->type_num == NPY_DOUBLE;
    if (call->states == 0)
        return (is_double ? one_double : one_float)(call->codes[MAIN], f->framed, f->reads, h, call->x, call->frame,
                                                    out);
    return (is_double ? many_double : many_float)(call->codes[MAIN], f->framed, f->reads, (size_t)call->states, h,
                                                  call->x, call->steps, call->frame, out);
}

/* Compute many states in pieces that stay in a cache between the looks at their numbers and the code, which reads them, or
 * has written them; 0 where all of it is regular. */
static int compute_pieces(const Function *f, const void *h, const Plain *call, int checks, void *out)
{
    npy_intp numbers = f->result.size;
    for (int i = 0; i < f->reads; ++i)
        if (call->steps[i] > 0) numbers += call->sizes[i] / call->states;
    const npy_intp most = PIECE / bytes_of(f, numbers) / ROUND * ROUND, piece = most > ROUND ? most : ROUND;
    for (npy_intp begin = 0; begin < call->states; begin += piece) {
        Plain part = *call;
        part.states = call->states - begin < piece ? call->states - begin : piece;
        for (int i = 0; i < f->reads; ++i) {
            if (call->steps[i] == 0) continue;
            const npy_intp size = call->sizes[i] / call->states;
            part.x[i] = (const char *)call->x[i] + bytes_of(f, begin * size);
            if (checks && !all_finite(f, part.x[i], part.states * size)) return -1;
        }
        char *const written = (char *)out + bytes_of(f, begin * f->result.size);
        if (compute(f, h, &part, written) >= 0) return -1;
        if (checks && !all_finite(f, written, part.states * f->result.size)) return -1;
    }
    return 0;
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

/* Numbers of a call beside its result: what wrenches add, an array with it, and all that the code writes where calls
 * return a part of that; in place where there are few. */
typedef struct {
    double few[128];
    void *memory; /* NULL for these */
    char *added, *sum, *whole;
} Beside;

/* Numbers of a state that wrenches add. */
static npy_intp added_size(const Function *f)
{
    return f->into < 0 ? f->returned.size : f->place[f->into].shape.size;
}

static int make_room(const Function *f, const Plain *call, Beside *beside)
{
    const npy_intp size = call->wrench == NULL ? 0 : added_size(f), states = call->states > 0 ? call->states : 1;
    const size_t one = (size_t)bytes_of(f, (call->wrench_states > 0 ? call->wrench_states : 1) * size);
    const size_t other = f->into < 0 ? 0 : (size_t)bytes_of(f, states * size);
    const size_t whole = f->returned.size == f->result.size ? 0 : (size_t)bytes_of(f, states * f->result.size);
    const size_t all = one + other + whole;
    beside->added = (char *)beside->few;
    if (all > sizeof beside->few && (beside->added = beside->memory = PyMem_Malloc(all)) == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    beside->sum = beside->added + one;
    beside->whole = whole == 0 ? NULL : beside->sum + other;
    return 0;
}

/* Compute what the wrenches add, and put it into the array that takes it, if one does; 0 where all of it is regular. */
static int begin_added(const Function *f, const void *h, Plain *call, Beside *beside, int checks)
{
    const npy_intp size = added_size(f), step = call->wrench_states > 0 ? size : 0;
    const npy_intp states = call->wrench_states > 0 ? call->wrench_states : 1;
    compute_added(f, h, call, beside->added);
    if (checks && !all_finite(f, beside->added, states * size)) return -1;
    if (f->into < 0) return 0;
    for (npy_intp k = 0; k < states; ++k)
        for (Py_ssize_t i = 0; i < f->lefts; ++i)
            memset(beside->added + bytes_of(f, k * size + f->left[i]), 0, (size_t)bytes_of(f, 1));
    const int into = f->place[f->into].array, is_many = call->steps[into] > 0 || step > 0;
    const npy_intp all = is_many ? call->states : 1;
    add(f, call->x[into], (npy_intp)call->steps[into], beside->added, step, 1.0, all, size, beside->sum);
    if (checks && !all_finite(f, beside->sum, all * size)) return -1;
    call->x[into] = beside->sum;
    call->steps[into] = is_many ? (size_t)size : 0;
    return 0;
}

/* Compute with what the wrenches add; 0 where all of it is regular. */
static int compute_all(const Function *f, const void *h, const void *h_added, Plain *call, Beside *beside, int checks,
                       void *out)
{
    const npy_intp states = call->states > 0 ? call->states : 1, size = f->returned.size;
    const npy_intp step = call->wrench_states > 0 ? size : 0;
    void *const whole = beside->whole == NULL ? out : beside->whole;
    if (in_pieces(call)) {
        if (compute_pieces(f, h, call, checks, whole) < 0) return -1;
    } else {
        if (call->wrench != NULL && begin_added(f, h_added, call, beside, checks) < 0) return -1;
        if (compute(f, h, call, whole) >= 0) return -1;
        if (checks && !all_finite(f, whole, states * f->result.size)) return -1;
    }
    if (whole != out) keep_leading(f, whole, states, out);
    if (call->wrench == NULL || f->into >= 0) return 0;
    add(f, out, size, beside->added, step, f->sign, states, size, out);
    return checks && !all_finite(f, out, states * size) ? -1 : 0;
}

/* The result of a plain call; NULL without an error where the function in Python has to be asked.  ``codes`` are then
 * those that the call would need, and NULL if it is not plain whatever is armed. */
static PyObject *straight(Function *f, State *state, PyObject *const *args, Py_ssize_t count, PyObject *names,
                          Code **codes)
{
    PyObject *arguments[PLACES];
    Plain call;
    Beside beside;
    memset(&call, 0, offsetof(Plain, x));
    const int is_plain = sort_arguments(f, args, count, names, arguments) == 0 && look(f, state, arguments, &call) == 0;
    memcpy(codes, call.codes, sizeof call.codes);
    const int needs_room = call.wrench != NULL || f->returned.size < f->result.size;
    beside.memory = beside.whole = NULL;
    if (!is_plain || (needs_room && make_room(f, &call, &beside) < 0)) return NULL;
    PyObject *answer = NULL;
    PyArrayObject *out = NULL, *kept = hoisted(state, f, codes[MAIN]), *kept_added = NULL;
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
    const double operations = codes[MAIN]->operations + (call.wrench == NULL ? 0.0 : codes[ADDED]->operations);
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
        if (f->in_parts)
            answer = views_of(f, out, call.states);
        else {
            answer = (PyObject *)out;
            Py_INCREF(answer);
        }
    }
end:
    Py_XDECREF(out);
    Py_XDECREF(kept);
    Py_XDECREF(kept_added);
    PyMem_Free(beside.memory);
    return answer;
}

/* Ask for the address of a code, once: after a first call it is there. */
static int arm_once(Function *f, CodeKind kind, Code *code)
{
    int again = 1;
    Py_BEGIN_CRITICAL_SECTION(f);
    again = code->asked;
    code->asked = 1;
    Py_END_CRITICAL_SECTION();
    if (again) return 0;
    PyObject *many = code == &f->codes[kind][1] ? Py_True : Py_False;
    PyObject *answer = PyObject_CallFunction(f->arming, "OsO", (PyObject *)f, KIND_NAMES[kind], many);
    Py_XDECREF(answer);
    return answer == NULL ? -1 : 0;
}

static PyObject *direct_vectorcall(PyObject *self, PyObject *const *args, size_t nargsf, PyObject *names)
{
    Direct *direct = (Direct *)self;
    Function *f = direct->function;
    Code *codes[KINDS] = {NULL};
    PyObject *answer = straight(f, direct->state, args, PyVectorcall_NARGS(nargsf), names, codes);
    if (answer != NULL || PyErr_Occurred()) return answer;
    answer = PyObject_Vectorcall(direct->checked, args, nargsf, names);
    for (int kind = 0; kind < KINDS && answer != NULL; ++kind)
        if (codes[kind] != NULL && PUBLISHED(codes[kind]->address) == 0 && arm_once(f, (CodeKind)kind, codes[kind]) < 0)
            Py_CLEAR(answer);
    return answer;
}
