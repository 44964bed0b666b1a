/* The border between Python and the loops: what a loop takes is checked here, at every call, before any of it is read.

   A wrapper takes its arguments one after the other, in the order in which Python gives them, each by its name:

       static PyObject* scaled_(PyObject* self, PyObject* const* given, Py_ssize_t count) {
         call c = begin("scaled", given, count);
         double factor = number(&c, "factor");
         const double* values = numbers(&c, "values", SHAPE(ANY, 3));
         double* result = written(&c, "result", SHAPE(c.shape[0], 3));
         if (ready(&c)) {
           WITHOUT_LOCK(scaled(factor, c.shape[0], values, result));
         }
         return ended(&c, none());
       }

   Arrays are float64 or int64, aligned, contiguous in C's order, of the shape that is given (ANY: any length), and can
   be written where `written` takes them. The first argument that is not so raises TypeError or ValueError, which names
   function and argument; those after it are null or 0, and nothing runs. */

#ifndef HDPLAN_BORDER_H
#define HDPLAN_BORDER_H

#define Py_LIMITED_API 0x030B0000 /* one binary for Python 3.11 and all later ones */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define ANY (-1LL)
#define MOST_ARGUMENTS 24
#define MOST_DIMENSIONS 4
#define SHAPE(...) \
  (int)(sizeof((const long long[]){__VA_ARGS__}) / sizeof(long long)), (const long long[]) { __VA_ARGS__ }

typedef struct {
  const char* function;
  PyObject* const* given;
  Py_ssize_t count, next;
  long long shape[MOST_DIMENSIONS]; /* of the array that was taken last */
  Py_buffer held[MOST_ARGUMENTS];   /* until the call has ended, or as long as the struct that it makes */
  PyObject* within[MOST_ARGUMENTS]; /* structs that are part of that one */
  const void** addresses;
  int holding, including, failed;
} call;

call begin(const char* function, PyObject* const* given, Py_ssize_t count);

double number(call* c, const char* name);
long long whole(call* c, const char* name, long long least, long long most);
const double* numbers(call* c, const char* name, int dimensions, const long long* shape);
const double* numbers_or_none(call* c, const char* name, int dimensions, const long long* shape);
double* written(call* c, const char* name, int dimensions, const long long* shape);
long long* written_rows(call* c, const char* name, int dimensions, const long long* shape);
/* Whole numbers, each at least `least` and below `end`: what they count or point at is there. */
const long long* rows(call* c, const char* name, long long least, long long end, int dimensions,
                      const long long* shape);

/* A C struct that stays: made once by a wrapper of its own, from arrays that live as long as it does. */
const void* record(call* c, const char* name, const char* kind);
const void* record_or_none(call* c, const char* name, const char* kind);
/* The addresses of structs of one kind, in a tuple; there are c->shape[0]. They belong to the struct that is made. */
const void* const* records(call* c, const char* name, const char* kind);
/* A Python object that holds a copy of a struct of `size` bytes, and all that the call has taken. */
PyObject* made(call* c, const char* kind, const void* from, size_t size);

/* Refuse an argument that was taken, for what else it must be. */
void wrong(call* c, const char* name, const char* expected);

/* Whether all arguments were taken, and were as they should be. */
int ready(call* c);
/* Release what the call holds, and return `result`; null, and nothing of it, after an error. */
PyObject* ended(call* c, PyObject* result);
PyObject* none(void);
/* Complain of memory that there is not. */
PyObject* no_memory(void);

#define WITHOUT_LOCK(work)   \
  do {                       \
    Py_BEGIN_ALLOW_THREADS;  \
    work;                    \
    Py_END_ALLOW_THREADS;    \
  } while (0)

#define FUNCTION(name, wrapper, text) {name, (PyCFunction)(void (*)(void))(wrapper), METH_FASTCALL, text}
#define END_OF_FUNCTIONS {NULL, NULL, 0, NULL}

/* Called once when the module is made. Returns 0, or −1 with an error set. */
int add_record_type(PyObject* module);

#endif
