/* Functions of kernels as callables in C: calls with plain arrays go from Python to the compiled function at once.
 *
 * Nothing here knows a robot.  A Function is the same for all kernels of a package: the names, roles
 * and shapes of its arguments, and, once they are armed, the addresses of its codes: its main one and that of wrenches,
 * each for one state and for many, each armed after a first call that needs it, which may have compiled it.  A State is
 * what may change of one kernel: its parameters, checks and threads.  A Direct is the function of one kernel: a
 * Function, a State, and the function in Python, which takes the same arguments.
 *
 * A call is plain where every array is an ndarray itself (no subclass) of the kernel's dtype, aligned, C-contiguous, of
 * exactly the shape of one state or of N of them, and no option asks for more than `out`, `wrench` and `z`.  Whatever
 * is not plain, and whatever turns out not to be regular (NaN, infinity, a singular mass matrix), is left to the function
 * in Python, which is called with the very same arguments: it computes what has to be computed, or raises.  So results
 * and messages are the same by construction.
 *
 * A generated package carries a copy of this file and of its headers, and what they were compiled to where Python's
 * and NumPy's headers were. */
#include "direct_types.h"

PyDoc_STRVAR(bind_doc, "bind(function, checked, state)\n\n"
                       "Return a callable that takes the arguments of a Function, in their order or by their names.\n\n"
                       "Arguments: a Function; the same in Python, for a kernel; the State of that.");

static PyObject *bind(PyObject *module, PyObject *args)
{
    const Types *types = PyModule_GetState(module);
    PyObject *function, *checked, *state;
    if (!PyArg_ParseTuple(args, "O!OO!:bind", types->function, &function, &checked, types->state, &state)) return NULL;
    Direct *direct = (Direct *)types->direct->tp_alloc(types->direct, 0);
    if (direct == NULL) return NULL;
    direct->vectorcall = direct_vectorcall;
    Py_INCREF(function), direct->function = (Function *)function;
    Py_INCREF(state), direct->state = (State *)state;
    Py_INCREF(checked), direct->checked = checked;
    return (PyObject *)direct;
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
    choose_loops();
    if (PyModule_AddIntMacro(module, ARRAYS) < 0) return -1;
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
    .m_doc = "Functions of kernels as callables in C.",
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
