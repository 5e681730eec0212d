/* make(kind, a, b): the named tuple kind(a, b), in one allocation.

   Called by its name a kind counts its arguments in Python, packs them three times and unpacks
   them twice.  Only the compiled copy of the source calls this (direct_tuples.py), which gives as
   many values as the kind has fields. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>

static PyObject *make(PyObject *module, PyObject *const *given, Py_ssize_t count)
{
    (void)module;
    if (count < 1 || !PyType_Check(given[0])
        || !PyType_FastSubclass((PyTypeObject *)given[0], Py_TPFLAGS_TUPLE_SUBCLASS)) {
        PyErr_SetString(PyExc_TypeError, "not a kind of tuple");
        return NULL;
    }
    PyTypeObject *kind = (PyTypeObject *)given[0];
    PyObject *made = kind->tp_alloc(kind, count - 1);
    if (made == NULL)
        return NULL;
#if PY_VERSION_HEX >= 0x030E0000
    ((PyTupleObject *)made)->ob_hash = -1; /* not known yet */
#endif
    for (Py_ssize_t i = 1; i < count; i++) {
        Py_INCREF(given[i]);
        PyTuple_SET_ITEM(made, i - 1, given[i]);
    }
    return made;
}

static PyMethodDef functions[] = {
    {"make", (PyCFunction)(void (*)(void))make, METH_FASTCALL, "A named tuple of its fields."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "tgl_soar_tuples",
    .m_size = 0,
    .m_methods = functions,
};

PyMODINIT_FUNC PyInit_tgl_soar_tuples(void)
{
    return PyModule_Create(&definition);
}
