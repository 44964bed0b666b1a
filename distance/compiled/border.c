/* Implements `border.h`. */

#include "border.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

_Static_assert(sizeof(long long) == 8 && sizeof(double) == 8, "arrays are of int64 and float64");

arguments begin(const char* function, PyObject* const* given, Py_ssize_t count) {
  return (arguments){.function = function, .given = given, .count = count};
}

/* The next argument; null after an error, or if there is none. */
static PyObject* next(arguments* taken, const char* name) {
  if (taken->failed) return NULL;
  if (taken->next >= MOST_ARGUMENTS) {
    taken->failed = 1;
    PyErr_Format(PyExc_SystemError, "%s: %s is one argument too many", taken->function, name);
    return NULL;
  }
  if (taken->next >= taken->count) {
    taken->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s is missing", taken->function, name);
    return NULL;
  }
  return taken->given[taken->next++];
}

void wrong(arguments* taken, const char* name, const char* expected) {
  if (taken->failed) return;
  taken->failed = 1;
  PyErr_Format(PyExc_ValueError, "%s: %s must be %s", taken->function, name, expected);
}

/* --- numbers ---------------------------------------------------------------------------------------------------- */

double number(arguments* taken, const char* name) {
  PyObject* given = next(taken, name);
  if (!given) return 0.0;
  const double value = PyFloat_AsDouble(given);
  if (value == -1.0 && PyErr_Occurred()) {
    taken->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s must be a number, not %R", taken->function, name, Py_TYPE(given));
    return 0.0;
  }
  return value;
}

long long whole(arguments* taken, const char* name, long long least, long long most) {
  PyObject* given = next(taken, name);
  if (!given) return 0;
  const long long value = PyLong_AsLongLong(given);
  if ((value == -1 && PyErr_Occurred()) || value < least || value > most) {
    taken->failed = 1;
    PyErr_Format(PyExc_ValueError, "%s: %s must be a whole number from %lld to %lld, not %R", taken->function, name,
                 least, most, given);
    return 0;
  }
  return value;
}

/* --- arrays ----------------------------------------------------------------------------------------------------- */

/* What an array has to be. */
typedef struct {
  int of_indices, writable, optional, dimensions;
  const long long* shape;
} requirement;

/* Raise ValueError: what the array must be, and what it is. */
static void complain(arguments* taken, const char* name, PyObject* given, const requirement* required) {
  char shape[160];
  int used = 0;
  for (int i = 0; i < required->dimensions && used < 120; ++i)
    used += required->shape[i] < 0 ? PyOS_snprintf(shape + used, 24, i ? ", any" : "any")
                                : PyOS_snprintf(shape + used, 24, i ? ", %lld" : "%lld", required->shape[i]);
  shape[used] = '\0';
  taken->failed = 1;
  PyErr_Clear();
  PyObject* type = PyObject_GetAttrString(given, "dtype");
  PyObject* size = type ? PyObject_GetAttrString(given, "shape") : NULL;
  PyErr_Clear();
  PyObject* found = type && size ? PyUnicode_FromFormat("%S of shape %S", type, size)
                                 : PyUnicode_FromFormat("%R", Py_TYPE(given));
  if (found)
    PyErr_Format(PyExc_ValueError, "%s: %s must be %s, aligned and contiguous, of shape (%s)%s, not %U",
                 taken->function, name, required->of_indices ? "int64" : "float64", shape,
                 required->writable ? " and writable" : "", found);
  Py_XDECREF(type);
  Py_XDECREF(size);
  Py_XDECREF(found);
}

static int fits(const Py_buffer* view, const requirement* required) {
  if (view->ndim != required->dimensions || view->itemsize != 8 || !view->format) return 0;
  if ((uintptr_t)view->buf % sizeof(double) != 0) return 0;
  for (int i = 0; i < required->dimensions; ++i)
    if (required->shape[i] >= 0 && view->shape[i] != required->shape[i]) return 0;
  if (!required->of_indices) return strcmp(view->format, "d") == 0;
  return strcmp(view->format, "q") == 0 || strcmp(view->format, "l") == 0;
}

static void* array(arguments* taken, const char* name, const requirement* required) {
  PyObject* given = next(taken, name);
  if (!given || (required->optional && given == Py_None)) return NULL;
  Py_buffer* view = taken->held + taken->holding;
  if (PyObject_GetBuffer(given, view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS | (required->writable ? PyBUF_WRITABLE : 0))) {
    complain(taken, name, given, required);
    return NULL;
  }
  if (!fits(view, required)) {
    PyBuffer_Release(view);
    complain(taken, name, given, required);
    return NULL;
  }
  for (int i = 0; i < required->dimensions; ++i) taken->shape[i] = view->shape[i];
  taken->names[taken->holding] = name;
  taken->outputs[taken->holding] = required->writable;
  ++taken->holding;
  return view->buf;
}

const double* numbers(arguments* taken, const char* name, int dimensions, const long long* shape) {
  return array(taken, name, &(requirement){.dimensions = dimensions, .shape = shape});
}

const double* numbers_or_none(arguments* taken, const char* name, int dimensions, const long long* shape) {
  return array(taken, name, &(requirement){.optional = 1, .dimensions = dimensions, .shape = shape});
}

double* written(arguments* taken, const char* name, int dimensions, const long long* shape) {
  return array(taken, name, &(requirement){.writable = 1, .dimensions = dimensions, .shape = shape});
}

long long* written_indices(arguments* taken, const char* name, int dimensions, const long long* shape) {
  return array(taken, name, &(requirement){.of_indices = 1, .writable = 1, .dimensions = dimensions, .shape = shape});
}

const long long* indices(arguments* taken, const char* name, long long least, long long end, int dimensions,
                         const long long* shape) {
  const long long* values = array(taken, name, &(requirement){.of_indices = 1, .dimensions = dimensions, .shape = shape});
  if (!values) return NULL;
  long long size = 1;
  for (int i = 0; i < dimensions; ++i) size *= taken->shape[i];
  for (long long i = 0; i < size; ++i)
    if (values[i] < least || values[i] >= end) {
      taken->failed = 1;
      PyErr_Format(PyExc_ValueError, "%s: %s has %lld, which is not from %lld to %lld", taken->function, name,
                   values[i], least, end - 1);
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

static void deallocate(PyObject* self) {
  struct_object* object = (struct_object*)self;
  PyTypeObject* type = Py_TYPE(self);
  for (int i = 0; i < object->holding; ++i) PyBuffer_Release(object->held + i);
  for (int i = 0; i < object->including; ++i) Py_DECREF(object->within[i]);
  PyMem_Free(object->held);
  PyMem_Free(object->within);
  PyMem_Free(object->memory);
  PyMem_Free(object->addresses);
  PyObject_Free(self);
  Py_DECREF(type);
}

static PyObject* described(PyObject* self) {
  return PyUnicode_FromFormat("<struct '%s' of hdplan._loops>", ((struct_object*)self)->kind);
}

static PyType_Slot slots[] = {{Py_tp_dealloc, deallocate}, {Py_tp_repr, described}, {0, NULL}};
static PyType_Spec specification = {"hdplan._loops.Struct", sizeof(struct_object), 0,
                                    Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION, slots};

int add_record_type(PyObject* module) {
  record_type = (PyTypeObject*)PyType_FromSpec(&specification);
  return record_type ? PyModule_AddObjectRef(module, "Struct", (PyObject*)record_type) : -1;
}

static struct_object* struct_of(arguments* taken, const char* name, const char* kind, PyObject* given) {
  struct_object* object = (struct_object*)given;
  if (Py_TYPE(given) != record_type || strcmp(object->kind, kind) != 0) {
    taken->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s must be a struct '%s', not %R", taken->function, name, kind,
                 Py_TYPE(given) == record_type ? given : (PyObject*)Py_TYPE(given));
    return NULL;
  }
  return object;
}

static void keep(arguments* taken, PyObject* given) { taken->within[taken->including++] = Py_NewRef(given); }

const void* record(arguments* taken, const char* name, const char* kind) {
  PyObject* given = next(taken, name);
  struct_object* object = given ? struct_of(taken, name, kind, given) : NULL;
  if (!object) return NULL;
  keep(taken, given);
  return object->memory;
}

const void* record_or_none(arguments* taken, const char* name, const char* kind) {
  if (!taken->failed && taken->next < taken->count && taken->given[taken->next] == Py_None) {
    ++taken->next;
    return NULL;
  }
  return record(taken, name, kind);
}

const void* const* records(arguments* taken, const char* name, const char* kind) {
  PyObject* given = next(taken, name);
  if (!given) return NULL;
  if (!PyTuple_Check(given)) {
    taken->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: %s must be a tuple, not %R", taken->function, name, Py_TYPE(given));
    return NULL;
  }
  const Py_ssize_t count = PyTuple_Size(given);
  taken->shape[0] = count;
  taken->addresses = PyMem_Calloc((size_t)count + 1, sizeof(void*));
  if (!taken->addresses) {
    taken->failed = 1;
    PyErr_NoMemory();
    return NULL;
  }
  for (Py_ssize_t i = 0; i < count; ++i) {
    struct_object* object = struct_of(taken, name, kind, PyTuple_GetItem(given, i));
    if (!object) return NULL;
    taken->addresses[i] = object->memory;
  }
  keep(taken, given);
  return taken->addresses;
}

/* Hand all that was taken over to a struct. Returns 0 without memory. */
static int handed_over(arguments* taken, struct_object* object, const void* from, size_t size) {
  const size_t holding = (size_t)taken->holding, including = (size_t)taken->including;
  object->memory = PyMem_Malloc(size);
  object->held = PyMem_Calloc(holding + 1, sizeof(Py_buffer));
  object->within = PyMem_Calloc(including + 1, sizeof(PyObject*));
  if (!object->memory || !object->held || !object->within) return 0;
  memcpy(object->memory, from, size);
  memcpy(object->held, taken->held, holding * sizeof(Py_buffer));
  memcpy(object->within, taken->within, including * sizeof(PyObject*));
  object->addresses = taken->addresses;
  object->holding = taken->holding;
  object->including = taken->including;
  taken->holding = taken->including = 0;
  taken->addresses = NULL;
  return 1;
}

PyObject* made(arguments* taken, const char* kind, const void* from, size_t size) {
  if (!ready(taken)) return ended(taken, NULL);
  struct_object* object = PyObject_New(struct_object, record_type);
  if (!object) return ended(taken, NULL);
  object->kind = kind;
  object->memory = NULL;
  object->addresses = NULL;
  object->held = NULL;
  object->within = NULL;
  object->holding = object->including = 0;
  if (handed_over(taken, object, from, size)) return ended(taken, (PyObject*)object);
  Py_DECREF(object);
  return ended(taken, no_memory());
}

/* --- a call ----------------------------------------------------------------------------------------------------- */

static void* room(arguments* taken, long long count, size_t size) {
  if (taken->failed) return NULL;
  void* found = NULL;
  if (taken->scratching < MOST_SCRATCH && count >= 0 && (unsigned long long)count < SIZE_MAX / 2 / size)
    found = malloc((size_t)count * size + 1);
  if (found) return taken->scratch[taken->scratching++] = found;
  taken->failed = 1;
  PyErr_NoMemory();
  return NULL;
}

double* scratch(arguments* taken, long long count) { return room(taken, count, sizeof(double)); }
long long* scratch_indices(arguments* taken, long long count) { return room(taken, count, sizeof(long long)); }

static int overlap(const Py_buffer* one, const Py_buffer* other) {
  const char *first = one->buf, *second = other->buf;
  return one->len > 0 && other->len > 0 && first < second + other->len && second < first + one->len;
}

/* Refuse what is written where another array is read or written: loops rely on what they have read. */
static void refuse_overlaps(arguments* taken) {
  for (int i = 0; i < taken->holding; ++i)
    for (int j = 0; taken->outputs[i] && j < taken->holding; ++j)
      if (i != j && overlap(taken->held + i, taken->held + j)) {
        taken->failed = 1;
        PyErr_Format(PyExc_ValueError, "%s: %s is written, and must not overlap %s", taken->function, taken->names[i],
                     taken->names[j]);
        return;
      }
}

int ready(arguments* taken) {
  if (!taken->failed && taken->next < taken->count) {
    taken->failed = 1;
    PyErr_Format(PyExc_TypeError, "%s: takes %zd arguments, not %zd", taken->function, taken->next, taken->count);
  }
  if (!taken->failed) refuse_overlaps(taken);
  return !taken->failed;
}

PyObject* ended(arguments* taken, PyObject* result) {
  for (int i = 0; i < taken->holding; ++i) PyBuffer_Release(taken->held + i);
  for (int i = 0; i < taken->including; ++i) Py_DECREF(taken->within[i]);
  for (int i = 0; i < taken->scratching; ++i) free(taken->scratch[i]);
  PyMem_Free(taken->addresses);
  if (!taken->failed) return result;
  Py_XDECREF(result);
  return NULL;
}

PyObject* none(void) { return Py_NewRef(Py_None); }
PyObject* no_memory(void) { return PyErr_NoMemory(); }
