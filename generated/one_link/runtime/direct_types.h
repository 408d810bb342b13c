/* The types Direct, Function and State, as Python sees them.  Part of direct.c. */
#include "direct_calls.h"

/* ---- Direct: a function for one kernel -------------------------------------------------------------------------- */

static PyObject *direct_is_armed(PyObject *self, void *closure)
{
    (void)closure;
    return PyBool_FromLong(PUBLISHED(((Direct *)self)->function->codes[MAIN][0].address) != 0);
}

static PyObject *direct_takes_many(PyObject *self, void *closure)
{
    (void)closure;
    return PyBool_FromLong(PUBLISHED(((Direct *)self)->function->codes[MAIN][1].address) != 0);
}

/* All else that a method shows is that of the function in Python: its names, docstring and signature. */
static PyObject *direct_getattro(PyObject *self, PyObject *name)
{
    const int is_module = PyUnicode_Check(name) && PyUnicode_CompareWithASCIIString(name, "__module__") == 0;
    PyObject *attribute = is_module ? NULL : PyObject_GenericGetAttr(self, name); /* a type has a module of its own */
    if (attribute != NULL || (!is_module && !PyErr_ExceptionMatches(PyExc_AttributeError))) return attribute;
    PyErr_Clear();
    return PyObject_GetAttr(((Direct *)self)->checked, name);
}

static PyObject *direct_doc(PyObject *self, void *closure)
{
    (void)closure;
    return PyObject_GetAttrString(((Direct *)self)->checked, "__doc__");
}

static PyObject *direct_repr(PyObject *self) { return PyObject_Repr(((Direct *)self)->checked); }

static PyObject *direct_reduce(PyObject *self, PyObject *unused)
{
    (void)unused;
    return PyObject_CallMethod(((Direct *)self)->checked, "__reduce__", NULL);
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
    Py_VISIT(direct->checked);
    return 0;
}

/* No tp_clear: a Direct is never without its fields, and whoever keeps it in a circle can be cleared instead. */
static void direct_dealloc(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    Py_XDECREF(((Direct *)self)->function);
    Py_XDECREF(((Direct *)self)->state);
    Py_XDECREF(((Direct *)self)->checked);
    type->tp_free(self);
    Py_DECREF(type);
}

static PyMemberDef direct_members[] = {
    {"__vectorcalloffset__", T_PYSSIZET, offsetof(Direct, vectorcall), READONLY, NULL},
    {NULL, 0, 0, 0, NULL},
};
static PyGetSetDef direct_getset[] = {
    {"__doc__", direct_doc, NULL, NULL, NULL},
    {"is_armed", direct_is_armed, NULL, "whether plain calls with one state go to the code", NULL},
    {"takes_many", direct_takes_many, NULL, "whether plain calls with many states go to the code", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};
static PyMethodDef direct_methods[] = {
    {"__reduce__", direct_reduce, METH_NOARGS, NULL},
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

/* ---- Function: what is the same in all kernels of a package -------------------------------------------------- */

static int read_shape(PyObject *lengths, Shape *shape)
{
    if (!PyTuple_Check(lengths) || PyTuple_GET_SIZE(lengths) > AXES) {
        PyErr_SetString(PyExc_ValueError, "a shape is a tuple with at most four lengths");
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

static int read_place(PyObject *entry, Place *place)
{
    static const char *const names[] = {"read", "wrench", "frame", "out", "nothing", "cut", "zeros"};
    PyObject *label, *lengths;
    const char *role;
    if (!PyArg_ParseTuple(entry, "UsOi:place", &label, &role, &lengths, &place->array) ||
        read_shape(lengths, &place->shape) < 0)
        return -1;
    size_t role_number = 0;
    while (role_number < sizeof names / sizeof *names && strcmp(names[role_number], role) != 0) ++role_number;
    if (role_number == sizeof names / sizeof *names) {
        PyErr_Format(PyExc_ValueError, "role %s is none of a parameter", role);
        return -1;
    }
    place->role = (Role)role_number;
    Py_INCREF(label);
    PyUnicode_InternInPlace(&label);
    place->label = label;
    return 0;
}

static int read_places(Function *f, PyObject *places)
{
    const Py_ssize_t count = PyTuple_GET_SIZE(places);
    int wrenches = 0;
    unsigned seen = 0; /* numbers of arrays, a bit of each */
    if (count > PLACES) {
        PyErr_SetString(PyExc_ValueError, "too many parameters");
        return -1;
    }
    for (Py_ssize_t i = 0; i < count; ++i) {
        const Place *place = &f->place[i];
        if (read_place(PyTuple_GET_ITEM(places, i), &f->place[i]) < 0) return -1;
        f->places = (int)i + 1;
        wrenches += place->role == WRENCH;
        f->framed |= place->role == FRAME;
        if (place->role != READ && place->role != ZEROS) continue;
        if (place->array >= 0 && place->array < ARRAYS) seen |= 1U << place->array;
        ++f->reads;
        if (place->role == READ || f->zeros != NULL) continue;
        f->zeros = PyMem_Calloc((size_t)place->shape.size + 1, sizeof *f->zeros);
        if (f->zeros == NULL) return PyErr_NoMemory(), -1;
    }
    const int all = f->reads > 0 && f->reads <= ARRAYS && seen == (1U << f->reads) - 1U;
    if (!all || wrenches > 1 || (f->framed && (f->reads != 1 || f->frames == NULL))) {
        PyErr_SetString(PyExc_ValueError, "no function reads such arrays");
        return -1;
    }
    return 0;
}

/* What is added of wrenches: a sign, the place of the array that takes it or -1, and its numbers that take nothing. */
static int read_added(Function *f, PyObject *entry)
{
    PyObject *left;
    if (!PyArg_ParseTuple(entry, "diO!:added", &f->sign, &f->into, &PyTuple_Type, &left)) return -1;
    if (f->into < -1 || f->into >= f->places || (f->into >= 0 && f->place[f->into].role != READ)) {
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

/* What is returned of a result: all but so many numbers at the ends of the last axes. */
static int leave_out(Function *f, int axes, int states)
{
    f->returned = f->result;
    f->returned.size = 1;
    for (int i = 0; i < f->result.axes; ++i) {
        if (i >= f->result.axes - axes) f->returned.lengths[i] -= states;
        if (f->returned.lengths[i] < 0) return -1;
        f->returned.size *= f->returned.lengths[i];
    }
    return axes < 0 || axes > 2 || states < 0 ? -1 : 0;
}

static PyObject *function_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"name",   "arming",   "dtype",             "places", "positional", "result",
                            "states", "in_parts", "cut_must_be_false", "frames", "added",      NULL};
    PyObject *name, *arming, *dtype, *places, *result, *frames, *added;
    int positional, axes, states, in_parts, cut;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "UOO!O!iO(ii)ppO!O!:Function", names, &name, &arming,
                                     &PyArrayDescr_Type, &dtype, &PyTuple_Type, &places, &positional, &result,
                                     &axes, &states, &in_parts, &cut, &PyDict_Type, &frames, &PyTuple_Type, &added))
        return NULL;
    const int number = ((PyArray_Descr *)dtype)->type_num;
    if ((number != NPY_DOUBLE && number != NPY_FLOAT) || !PyArray_ISNBO(((PyArray_Descr *)dtype)->byteorder)) {
        PyErr_SetString(PyExc_ValueError, "a dtype is float64 or float32 of this machine");
        return NULL;
    }
    Function *f = (Function *)type->tp_alloc(type, 0);
    if (f == NULL) return NULL;
    Py_INCREF(name), f->name = name;
    Py_INCREF(arming), f->arming = arming;
    Py_INCREF(frames), f->frames = frames;
    Py_INCREF(dtype), f->dtype = (PyArray_Descr *)dtype;
    f->positional = positional;
    f->in_parts = in_parts;
    f->cut_must_be_false = cut;
    if (read_places(f, places) < 0 || read_shape(result, &f->result) < 0 || read_added(f, added) < 0) goto failed;
    if (positional > f->places || (in_parts && f->result.axes < 1) || leave_out(f, axes, states) < 0) {
        PyErr_SetString(PyExc_ValueError, "no function has such a result");
        goto failed;
    }
    return (PyObject *)f;
failed:
    Py_DECREF(f);
    return NULL;
}

PyDoc_STRVAR(arm_doc, "arm(kind, many, library, number, code, setup, hoisted, operations, piece)\n\n"
                      "Tell where a code is; from then on plain calls go there.\n\n"
                      "Arguments: which code: the \"main\" one or what is \"added\", for many states or for one; its\n"
                      "library, which is kept, and the number of that; addresses of the code and of what computes\n"
                      "from the parameters, how many numbers; operations of a state; states that one call computes at\n"
                      "most.");

static PyObject *function_arm(PyObject *self, PyObject *args)
{
    Function *f = (Function *)self;
    unsigned long long address, setup;
    PyObject *library;
    const char *name;
    int many, number, kind = 0;
    double operations;
    Py_ssize_t hoisted_count, piece;
    if (!PyArg_ParseTuple(args, "spOiKKndn:arm", &name, &many, &library, &number, &address, &setup, &hoisted_count,
                          &operations, &piece))
        return NULL;
    while (kind < KINDS && strcmp(KIND_NAMES[kind], name) != 0) ++kind;
    if (kind == KINDS) return PyErr_Format(PyExc_ValueError, "arm: %s is no code of a function", name);
    if (number < 0 || number >= LIBRARIES) Py_RETURN_FALSE;
    npy_intp least = f->returned.size;
    for (int i = 0; i < f->places; ++i)
        if (f->place[i].role <= WRENCH && f->place[i].shape.size < least) least = f->place[i].shape.size;
    if (least < 1 || address == 0 || setup == 0) Py_RETURN_FALSE; /* nothing to point to */
    Code *code = &f->codes[kind][many];
    Py_BEGIN_CRITICAL_SECTION(self);
    if (code->address == 0) {
        Py_INCREF(library), code->library = library;
        code->number = number;
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
    Py_VISIT(f->arming);
    Py_VISIT(f->frames);
    for (int kind = 0; kind < KINDS; ++kind)
        for (int many = 0; many < 2; ++many) Py_VISIT(f->codes[kind][many].library);
    return 0;
}

static void function_dealloc(PyObject *self)
{
    Function *f = (Function *)self;
    PyTypeObject *type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    Py_XDECREF(f->name);
    Py_XDECREF(f->arming);
    Py_XDECREF(f->frames);
    for (int kind = 0; kind < KINDS; ++kind)
        for (int many = 0; many < 2; ++many) Py_XDECREF(f->codes[kind][many].library);
    PyMem_Free(f->left);
    PyMem_Free(f->zeros);
    Py_XDECREF(f->dtype);
    for (int i = 0; i < f->places; ++i) Py_DECREF(f->place[i].label);
    type->tp_free(self);
    Py_DECREF(type);
}

static PyMemberDef function_members[] = {
    {"name", T_OBJECT_EX, offsetof(Function, name), READONLY, "name of the function"},
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
    PyArrayObject *old = NULL, *values = NULL, *gone[LIBRARIES];
    PyObject *setup = NULL;
    int cleared = 0;
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
        for (; cleared < state->libraries; ++cleared) {
            gone[cleared] = state->h[cleared];
            state->h[cleared] = NULL;
        }
        state->libraries = 0;
    }
    Py_END_CRITICAL_SECTION();
    while (cleared > 0) Py_XDECREF(gone[--cleared]);
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
    other->libraries = state->libraries;
    for (int i = 0; i < state->libraries; ++i) {
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
    for (int i = 0; i < state->libraries; ++i) Py_XDECREF(state->h[i]);
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
