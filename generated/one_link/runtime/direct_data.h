/* What direct.c keeps of kernels and their functions. */
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

enum { ARRAYS = 12, PLACES = 16, AXES = 4, LIBRARIES = 64 }; /* at most: read by a function, arguments, ... */

/* Work that others may run beside: multiplications and additions; microseconds, in which a GIL's return is lost. */
static const double LONG = 2e4;
/* States that are worth a separate thread, as in calls.py. */
static const npy_intp SHARE = 256;

/* Bytes of arguments and results that stay in a cache; states in multiples of so many fill vectors. */
enum { PIECE = 1 << 19, ROUND = 16 };

/* What an argument is for. */
typedef enum {
    READ,    /* an array that the code reads */
    WRENCH,  /* an array that may be None; further code reads it, and what that computes is added */
    FRAME,   /* the name of a frame, in place of its number */
    OUT,     /* an array to write to */
    NOTHING, /* plain only where it is None */
    CUT,     /* whether loops are meant to be open */
    ZEROS    /* no argument: an array of zeros that the code reads */
} Role;

typedef struct {
    int axes;
    npy_intp lengths[AXES];
    npy_intp size; /* their product */
} Shape;

typedef struct {
    PyObject *label; /* interned: a keyword is it, not only equal to it */
    Role role;
    int array; /* its number among those that the code reads, of READ and ZEROS */
    Shape shape;
} Place;

/* What a function calls, and for what: for one state or for many. */
typedef enum {
    MAIN,  /* the function itself */
    ADDED, /* what wrenches add: reads the first array and them, writes what "main" writes or one of its arrays */
    KINDS
} CodeKind;
static const char *const KIND_NAMES[KINDS] = {"main", "added"};

/* Code for one state or for many, and what it reads of the parameters. */
typedef struct {
    PyObject *library; /* which keeps it */
    int number;        /* of the library */
    npy_intp hoisted;  /* numbers that the library computes from the parameters */
    double operations; /* of a state */
    npy_intp piece;    /* states that one call computes at most */
    uintptr_t setup;   /* address of the library's code that computes from the parameters */
    uintptr_t address; /* of the code; 0 until armed, and published last */
    char asked;        /* whether arming was asked for it */
} Code;

typedef struct {
    PyObject_HEAD
    PyObject *name;
    PyObject *arming; /* arming(function, kind, many) tells the address of a code after a first call of it */
    PyObject *frames; /* their numbers by name, a dict */
    PyArray_Descr *dtype;
    int places, positional; /* of these the first may come without their names */
    Place place[PLACES];
    int reads;              /* number of arrays that the code reads */
    double *zeros;          /* what it reads for a place that is no argument, of either dtype; NULL without one */
    Shape result, returned; /* as the code writes it, and the leading numbers of the last two axes that calls return */
    int framed, in_parts; /* takes a frame's number; its result are views along the first axis */
    int cut_must_be_false;
    Code codes[KINDS][2]; /* of each kind for one state and for many */
    double sign;         /* of what is added to the result */
    int into;            /* place of the array that it is added to instead, with sign 1; -1 for the result */
    npy_intp *left;      /* places of this array that nothing is added to */
    Py_ssize_t lefts;
} Function;

typedef struct {
    PyObject_HEAD
    PyArrayObject *values; /* of the parameters; replaced as a whole, never written to */
    PyObject *make, *setup; /* setup is make(values), for callers in Python; NULL until they ask for it */
    char checks;
    Py_ssize_t threads;
    int libraries; /* as many of h as may be there */
    PyArrayObject *h[LIBRARIES]; /* what each library computes of the values, when it is first needed; NULL before */
} State;

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    Function *function;
    State *state;
    PyObject *checked; /* the same in Python, with all that a method shows */
} Direct;

typedef struct {
    PyTypeObject *function, *state, *direct;
} Types;
