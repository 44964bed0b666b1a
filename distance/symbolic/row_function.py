"""CasADi functions evaluated for many rows at once: as generated C where a compiler is found, else by CasADi's
interpreter.

In: a CasADi Function and, for every input, a table of values and the row of the table that each evaluation takes.
Out: one row per evaluation. Both ways compute the same instructions; C is about six times faster. The rows are
picked inside the C loop, so nothing is gathered, copied or converted in Python.
"""

from __future__ import annotations

import ctypes
import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from hdplan.distance.compiled.c_library import address, c_library
from hdplan.scenes.array_types import Array, Rows

# Calls the generated function once per row; `rows[i][k]` is the row of table i that evaluation k takes.
LOOP = """
void {name}_rows(long long count, const double** tables, const long long* widths, const long long** rows,
                 double** results, const long long* result_widths, const double** arg, double** res, long long* iw,
                 double* w) {{
  long long k;
  int i;
  for (k = 0; k < count; ++k) {{
    for (i = 0; i < {n_in}; ++i) arg[i] = tables[i] + widths[i] * rows[i][k];
    for (i = 0; i < {n_out}; ++i) res[i] = results[i] + result_widths[i] * k;
    {name}(arg, res, iw, w, 0);
  }}
}}
"""


class RowFunction:
    """A CasADi function of dense inputs, evaluated for many rows, by any number of threads at once.

    Every thread has its own memory, so results are the same bit for bit as with one thread. A compiled function
    releases Python's lock, so that threads run in parallel; CasADi's interpreter holds it.

    Parameters
    ----------
    function: the function f(x_1 … x_m) -> (y_1 … y_p), every input and output dense, column-major where it is a
    matrix.
    """

    def __init__(self, function: ca.Function) -> None:
        """Compile the function, or find it in the cache."""
        self.function = function
        self.widths = [function.numel_in(i) for i in range(function.n_in())]
        self.result_widths = [function.numel_out(i) for i in range(function.n_out())]
        library = _library(function)
        self.is_compiled = library is not None
        if library is not None:
            self._loop = getattr(library, f"{function.name()}_rows")
            self._loop.restype = None
            self._numbers = [(ctypes.c_longlong * len(widths))(*widths) for widths in (self.widths, self.result_widths)]
        self._workspace = _Workspace(function, library)

    def __reduce__(self) -> tuple[type[RowFunction], tuple[ca.Function]]:
        """Pickle the function alone: another process compiles it itself, or finds it in the cache."""
        return RowFunction, (self.function,)

    def __call__(self, tables: Sequence[Array], rows: Sequence[Rows]) -> list[Array]:
        """Evaluate for k = 0 … count-1 with input i taken from `tables[i][rows[i][k]]`.

        tables: one array (n_i, width_i) per input. rows: one index array (count,) per input. Returns one array
        (count, width) per output. Raises ValueError for wrong shapes or rows out of range.
        """
        if not len(tables) == len(rows) == len(self.widths):
            raise ValueError(
                f"{self.function.name()}: {len(tables)} tables and rows for {len(rows)}; expected {len(self.widths)}"
            )
        tables = [np.ascontiguousarray(table, dtype=np.float64) for table in tables]
        rows = [np.ascontiguousarray(row, dtype=np.int64) for row in rows]
        count = len(rows[0])
        for i, (table, row) in enumerate(zip(tables, rows, strict=True)):
            if table.ndim != 2 or table.shape[1] != self.widths[i] or row.shape != (count,):
                raise ValueError(
                    f"{self.function.name()}: input {i} is {table.shape} with {row.shape} rows; "
                    f"expected (any, {self.widths[i]}) with ({count},)"
                )
            if count and row.view(np.uint64).max() >= len(table):  # negative ones wrap around
                raise ValueError(f"{self.function.name()}: input {i} has rows outside 0 … {len(table) - 1}")
        results = [np.empty((count, width)) for width in self.result_widths]
        if self.is_compiled:
            self._loop(
                ctypes.c_longlong(count),
                _addresses(tables),
                self._numbers[0],
                _addresses(rows),
                _addresses(results),
                self._numbers[1],
                *self._workspace.memory,
            )
        else:
            self._interpret(tables, rows, results)
        return results

    def once(self, *arguments: Array) -> list[Array]:
        """Evaluate one row of each input, flat arrays (width_i,), with the least overhead."""
        bound, run, results = self._workspace.single
        for slot, argument in zip(bound, arguments, strict=True):
            slot[:] = argument
        run()
        return [result.copy() for result in results]

    def _interpret(self, tables: Sequence[Array], rows: Sequence[Rows], results: Sequence[Array]) -> None:
        """Evaluate in CasADi's virtual machine, through buffers: conversion to CasADi's DM would take longer than the
        work."""
        bound, run, outputs = self._workspace.single
        for k in range(len(rows[0])):
            for argument, table, row in zip(bound, tables, rows, strict=True):
                argument[:] = table[row[k]]
            run()
            for result, output in zip(results, outputs, strict=True):
                result[k] = output


class _Workspace(threading.local):
    """The memory in which a function is evaluated, one for each thread.

    Attributes:
        memory: of a compiled function, the work arrays of its C loop: arg, res, iw and w of CasADi's C interface.
        single: for one evaluation: arrays for the inputs, a function that runs it, and arrays for the outputs.
    """

    def __init__(self, function: ca.Function, library: ctypes.CDLL | None) -> None:
        arguments = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        results = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        run: Callable[[], Any]
        if library is None:
            self._buffer: Any  # must outlive the run
            self._buffer, run = function.buffer()
            for i, argument in enumerate(arguments):
                self._buffer.set_arg(i, argument.data)
            for i, result in enumerate(results):
                self._buffer.set_res(i, result.data)
        else:
            self._numbers = np.zeros(max(function.sz_iw(), 1), np.int64), np.zeros(max(function.sz_w(), 1))
            numbers = [memory.ctypes.data_as(ctypes.c_void_p) for memory in self._numbers]
            pointers = [
                [(ctypes.c_void_p * max(size, 1))() for size in (function.sz_arg(), function.sz_res())] for _ in "ab"
            ]
            self.memory = (*pointers[0], *numbers)
            arg, res = pointers[1]
            arg[: len(arguments)] = [argument.ctypes.data for argument in arguments]
            res[: len(results)] = [result.ctypes.data for result in results]
            run = functools.partial(getattr(library, function.name()), arg, res, *numbers, 0)
        self.single = arguments, run, results


def _addresses(arrays: Sequence[Array] | Sequence[Rows]) -> ctypes.Array[ctypes.c_void_p]:
    return (ctypes.c_void_p * len(arrays))(*(address(array) for array in arrays))


def _library(function: ca.Function) -> ctypes.CDLL | None:
    """The loaded library of a function, with its loop over rows; None without a compiler."""
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    loop = LOOP.format(name=function.name(), n_in=function.n_in(), n_out=function.n_out())
    return c_library(function.name(), generator.dump() + loop)
