/* What `border.h` says. */

#include "border.h"

#include <stdint.h>
#include <string.h>

_Static_assert(sizeof(long long) == 8 && sizeof(double) == 8, "arrays are of int64 and float64");

call begin(const char* function, PyObject* const* given, Py_ssize_t count) {
  call c = {0};
  c.function = function;
  c.given = given;
  c.count = count;
  return c;
}

/* The next argument; null after an error, or if there is none. */
static PyObject* next(call* c, const char* name) {
  if (c->failed) return NULL;
  if (c->next >= MOST_ARGUMENTS) {
    c->failed = 1;
    PyErr_Format(PyExc_SystemError, "%s: %s is one argument too many", c->function, name);
    return NULL;
  }
  if (c->next >= c->count) {
    c->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s is missing", c->function, name);
    return NULL;
  }
  return c->given[c->next++];
}

double number(call* c, const char* name) {
  PyObject* given = next(c, name);
  double value;
  if (!given) return 0.0;
  value = PyFloat_AsDouble(given);
  if (value == -1.0 && PyErr_Occurred()) {
    c->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s must be a number, not %R", c->function, name, given);
    return 0.0;
  }
  return value;
}

long long whole(call* c, const char* name, long long least, long long most) {
  PyObject* given = next(c, name);
  long long value;
  if (!given) return 0;
  value = PyLong_AsLongLong(given);
  if ((value == -1 && PyErr_Occurred()) || value < least || value > most) {
    c->failed = 1;
    PyErr_Format(PyExc_ValueError, "%s: %s must be a whole number from %lld to %lld, not %R", c->function, name, least,
                 most, given);
    return 0;
  }
  return value;
}

/* Say what an array must be, and what it is. */
static void complain(call* c, const char* name, PyObject* given, const char* kind, int writable, int dimensions,
                     const long long* shape) {
  char expected[160];
  int i, used = 0;
  PyObject *type, *size, *message;
  c->failed = 1;
  PyErr_Clear();
  for (i = 0; i < dimensions && used < 120; ++i)
    used += shape[i] < 0 ? PyOS_snprintf(expected + used, 24, i ? ", any" : "any")
                         : PyOS_snprintf(expected + used, 24, i ? ", %lld" : "%lld", shape[i]);
  expected[used] = '\0';
  type = PyObject_GetAttrString(given, "dtype");
  size = type ? PyObject_GetAttrString(given, "shape") : NULL;
  PyErr_Clear();
  message = type && size ? PyUnicode_FromFormat("%S of shape %S", type, size) : PyUnicode_FromFormat("%R", given);
  if (message) {
    PyErr_Format(PyExc_ValueError, "%s: %s must be %s, aligned and contiguous, of shape (%s)%s, not %U", c->function,
                 name, kind, expected, writable ? " and writable" : "", message);
  }
  Py_XDECREF(type);
  Py_XDECREF(size);
  Py_XDECREF(message);
}

static int is_numbers(const Py_buffer* view) { return view->itemsize == 8 && strcmp(view->format, "d") == 0; }

static int is_whole(const Py_buffer* view) {
  return view->itemsize == 8 && (strcmp(view->format, "q") == 0 || strcmp(view->format, "l") == 0);
}

static void* array(call* c, const char* name, int optional, int of_whole, int writable, int dimensions,
                   const long long* shape) {
  const char* kind = of_whole ? "int64" : "float64";
  PyObject* given = next(c, name);
  Py_buffer* view = c->held + c->holding;
  int i, good;
  if (!given || (optional && given == Py_None)) return NULL;
  if (PyObject_GetBuffer(given, view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS | (writable ? PyBUF_WRITABLE : 0))) {
    complain(c, name, given, kind, writable, dimensions, shape);
    return NULL;
  }
  good = view->ndim == dimensions && view->format && (of_whole ? is_whole(view) : is_numbers(view));
  good = good && (uintptr_t)view->buf % sizeof(double) == 0;
  for (i = 0; good && i < dimensions; ++i) {
    good = shape[i] < 0 || view->shape[i] == shape[i];
    c->shape[i] = view->shape[i];
  }
  if (!good) {
    PyBuffer_Release(view);
    complain(c, name, given, kind, writable, dimensions, shape);
    return NULL;
  }
  ++c->holding;
  return view->buf;
}

const double* numbers(call* c, const char* name, int dimensions, const long long* shape) {
  return array(c, name, 0, 0, 0, dimensions, shape);
}

const double* numbers_or_none(call* c, const char* name, int dimensions, const long long* shape) {
  return array(c, name, 1, 0, 0, dimensions, shape);
}

double* written(call* c, const char* name, int dimensions, const long long* shape) {
  return array(c, name, 0, 0, 1, dimensions, shape);
}

long long* written_rows(call* c, const char* name, int dimensions, const long long* shape) {
  return array(c, name, 0, 1, 1, dimensions, shape);
}

const long long* rows(call* c, const char* name, long long least, long long end, int dimensions,
                      const long long* shape) {
  const long long* values = array(c, name, 0, 1, 0, dimensions, shape);
  long long size = 1, i;
  if (!values) return NULL;
  for (i = 0; i < dimensions; ++i) size *= c->shape[i];
  for (i = 0; i < size; ++i)
    if (values[i] < least || values[i] >= end) {
      c->failed = 1;
      PyErr_Format(PyExc_ValueError, "%s: %s has %lld, which is not from %lld to %lld", c->function, name, values[i],
                   least, end - 1);
      return NULL;
    }
  return values;
}

/* --- structs ---------------------------------------------------------------------------------------------------- */

typedef struct {
  PyObject_HEAD
  const char* kind;
  void* memory;
  const void** addresses;
  Py_buffer* held;
  PyObject** within;
  int holding, including;
} struct_object;

static PyTypeObject* record_type; /* one for the process: the module is never unloaded */

static void released(struct_object* object) {
  int i;
  for (i = 0; i < object->holding; ++i) PyBuffer_Release(object->held + i);
  for (i = 0; i < object->including; ++i) Py_DECREF(object->within[i]);
  PyMem_Free(object->held);
  PyMem_Free(object->within);
  PyMem_Free(object->memory);
  PyMem_Free(object->addresses);
}

static void deallocate(PyObject* self) {
  PyTypeObject* type = Py_TYPE(self);
  released((struct_object*)self);
  PyObject_Free(self);
  Py_DECREF(type);
}

static PyType_Slot slots[] = {{Py_tp_dealloc, deallocate}, {0, NULL}};
static PyType_Spec specification = {"hdplan._loops.Struct", sizeof(struct_object), 0,
                                    Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION, slots};

int add_record_type(PyObject* module) {
  record_type = (PyTypeObject*)PyType_FromSpec(&specification);
  return record_type ? PyModule_AddObjectRef(module, "Struct", (PyObject*)record_type) : -1;
}

static struct_object* struct_of(call* c, const char* name, const char* kind, PyObject* given) {
  struct_object* object = (struct_object*)given;
  if (Py_TYPE(given) != record_type || strcmp(object->kind, kind) != 0) {
    c->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s must be a struct '%s', not %R", c->function, name, kind, given);
    return NULL;
  }
  return object;
}

static void keep(call* c, PyObject* given) { c->within[c->including++] = Py_NewRef(given); }

const void* record(call* c, const char* name, const char* kind) {
  PyObject* given = next(c, name);
  struct_object* object = given ? struct_of(c, name, kind, given) : NULL;
  if (!object) return NULL;
  keep(c, given);
  return object->memory;
}

const void* record_or_none(call* c, const char* name, const char* kind) {
  if (!c->failed && c->next < c->count && c->given[c->next] == Py_None) {
    ++c->next;
    return NULL;
  }
  return record(c, name, kind);
}

const void* const* records(call* c, const char* name, const char* kind) {
  PyObject* given = next(c, name);
  Py_ssize_t count, i;
  if (!given) return NULL;
  if (!PyTuple_Check(given)) {
    c->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s must be a tuple, not %R", c->function, name, given);
    return NULL;
  }
  c->shape[0] = count = PyTuple_Size(given);
  c->addresses = PyMem_Calloc((size_t)count + 1, sizeof(void*));
  if (!c->addresses) {
    c->failed = 1;
    PyErr_NoMemory();
    return NULL;
  }
  for (i = 0; i < count; ++i) {
    struct_object* object = struct_of(c, name, kind, PyTuple_GetItem(given, i));
    if (!object) return NULL;
    c->addresses[i] = object->memory;
  }
  keep(c, given);
  return c->addresses;
}

PyObject* made(call* c, const char* kind, const void* from, size_t size) {
  struct_object* object;
  if (!ready(c)) return NULL;
  object = PyObject_New(struct_object, record_type);
  if (!object) return NULL;
  object->kind = kind;
  object->holding = object->including = 0;
  object->addresses = NULL;
  object->memory = PyMem_Malloc(size);
  object->held = PyMem_Calloc((size_t)c->holding + 1, sizeof(Py_buffer));
  object->within = PyMem_Calloc((size_t)c->including + 1, sizeof(PyObject*));
  if (!object->memory || !object->held || !object->within) {
    Py_DECREF(object);
    return PyErr_NoMemory();
  }
  memcpy(object->memory, from, size);
  memcpy(object->held, c->held, (size_t)c->holding * sizeof(Py_buffer));
  memcpy(object->within, c->within, (size_t)c->including * sizeof(PyObject*));
  object->addresses = c->addresses;
  object->holding = c->holding;
  object->including = c->including;
  c->holding = c->including = 0;
  c->addresses = NULL;
  return (PyObject*)object;
}

void wrong(call* c, const char* name, const char* expected) {
  if (c->failed) return;
  c->failed = 1;
  PyErr_Format(PyExc_ValueError, "%s: %s must be %s", c->function, name, expected);
}

/* --- the end of a call ------------------------------------------------------------------------------------------ */

int ready(call* c) {
  if (!c->failed && c->next < c->count) {
    c->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: takes %zd arguments, not %zd", c->function, c->next, c->count);
  }
  return !c->failed;
}

PyObject* ended(call* c, PyObject* result) {
  int i;
  for (i = 0; i < c->holding; ++i) PyBuffer_Release(c->held + i);
  for (i = 0; i < c->including; ++i) Py_DECREF(c->within[i]);
  PyMem_Free(c->addresses);
  if (!c->failed) return result;
  Py_XDECREF(result);
  return NULL;
}

PyObject* none(void) { return Py_NewRef(Py_None); }
PyObject* no_memory(void) { return PyErr_NoMemory(); }
