/* The border between Python and the loops: what a loop takes is checked here, at every call, before any of it is read.

   A wrapper takes its arguments one after the other, in the order in which Python gives them, each by its name:

       WRAPPER(call_scaled) {
         arguments taken = begin("scaled", given, count);
         const double factor = number(&taken, "factor");
         const double* values = numbers(&taken, "values", SHAPE(ANY, 3));
         const long long rows = taken.shape[0];
         double* result = written(&taken, "result", SHAPE(rows, 3));
         if (ready(&taken)) WITHOUT_LOCK(scaled(factor, rows, values, result));
         return ended(&taken, none());
       }

   Arrays are float64 or int64, aligned, contiguous in C's order, of the shape that is given (ANY: any length), and can
   be written where `written` takes them; what is written overlaps no other array of the call. The first argument that
   differs raises TypeError or ValueError, with the names of function and argument; later arguments are null or 0, and
   nothing runs. Values are trusted only as far as a wrapper checks them: whatever a loop takes as a row or a number of
   rows goes through `indices` or `whole`. No other thread may change an array during a call. */

#ifndef HDPLAN_BORDER_H
#define HDPLAN_BORDER_H

#define Py_LIMITED_API 0x030B0000 /* one binary for Python 3.11 and all later ones */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define ANY (-1LL)
#define MANY (1LL << 40) /* more rows than any memory holds; sums and products of two do not overflow */
#define MOST_ARGUMENTS 24
#define MOST_DIMENSIONS 4
#define MOST_SCRATCH 4
#define SHAPE(...) \
  (int)(sizeof((const long long[]){__VA_ARGS__}) / sizeof(long long)), (const long long[]) { __VA_ARGS__ }

typedef struct {
  const char* function;
  PyObject* const* given;
  Py_ssize_t count, next;
  long long shape[MOST_DIMENSIONS];  /* of the array that was taken last */
  Py_buffer held[MOST_ARGUMENTS];    /* until the call has ended, or as long as the struct that it makes */
  const char* names[MOST_ARGUMENTS]; /* of what is held */
  int outputs[MOST_ARGUMENTS];       /* whether it is written */
  PyObject* within[MOST_ARGUMENTS];  /* structs that are part of that one */
  void* scratch[MOST_SCRATCH];
  const void** addresses;
  int holding, including, scratching, failed;
} arguments;

#define WRAPPER(name) static PyObject* name(PyObject* Py_UNUSED(self), PyObject* const* given, Py_ssize_t count)

arguments begin(const char* function, PyObject* const* given, Py_ssize_t count);

double number(arguments* taken, const char* name);
long long whole(arguments* taken, const char* name, long long least, long long most);
const double* numbers(arguments* taken, const char* name, int dimensions, const long long* shape);
const double* numbers_or_none(arguments* taken, const char* name, int dimensions, const long long* shape);
double* written(arguments* taken, const char* name, int dimensions, const long long* shape);
long long* written_indices(arguments* taken, const char* name, int dimensions, const long long* shape);
/* Whole numbers, each at least `least` and below `end`: what they count or point at is there. */
const long long* indices(arguments* taken, const char* name, long long least, long long end, int dimensions,
                         const long long* shape);

/* A C struct that stays: made once by a wrapper of its own, from arrays that live as long as it does. */
const void* record(arguments* taken, const char* name, const char* kind);
const void* record_or_none(arguments* taken, const char* name, const char* kind);
/* The addresses of structs of one kind, in a tuple; there are shape[0]. They belong to the struct that is made. */
const void* const* records(arguments* taken, const char* name, const char* kind);
/* The end of a call that makes a struct: an object that holds a copy of `from`, and all that was taken. */
PyObject* made(arguments* taken, const char* kind, const void* from, size_t size);

/* Refuse an argument that was taken, for what else it must be. */
void wrong(arguments* taken, const char* name, const char* expected);

/* Memory for `count` numbers until the call has ended, not set to anything; null, and an error, if there is none. */
double* scratch(arguments* taken, long long count);
long long* scratch_indices(arguments* taken, long long count);

/* Whether all arguments were taken, and were as they should be. */
int ready(arguments* taken);
/* Release what the call holds, and return `result`; null, and nothing of it, after an error. */
PyObject* ended(arguments* taken, PyObject* result);
PyObject* none(void);
/* Raise MemoryError. */
PyObject* no_memory(void);

#define WITHOUT_LOCK(work)  \
  do {                      \
    Py_BEGIN_ALLOW_THREADS; \
    work;                   \
    Py_END_ALLOW_THREADS;   \
  } while (0)

#define FUNCTION(name, wrapper, text) {name, (PyCFunction)(void (*)(void))(wrapper), METH_FASTCALL, text}
#define END_OF_FUNCTIONS {NULL, NULL, 0, NULL}

/* Called once when the module is made. Returns 0, or −1 with an error set. */
int add_record_type(PyObject* module);

#endif
