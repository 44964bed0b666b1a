"""The loops of C that hdplan was built with, `hdplan._loops`, and the one place that decides between them and NumPy.

Every function of C checks what it is given (`border.h`): an array of another type, shape or layout raises an error
that names it. Each loop has a twin in NumPy, which serves where hdplan was installed without a C compiler, and to which
laws hold the loop; in place of closed forms of inverse kinematics the search does.
"""

from __future__ import annotations

import functools
import importlib
import warnings
from collections.abc import Callable
from functools import cached_property
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.once import read_only

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")

C: Any = None  # the functions of C; None where there are none
_missing: ImportError | None = None
try:
    C = importlib.import_module("hdplan._loops")
except ImportError as error:
    _missing = error


@functools.cache
def warn_without_loops() -> None:
    """Warn, once in a process, where there are no loops: not at import, so that bad input remains one line."""
    if _missing is not None:
        warnings.warn(
            f"hdplan runs without its C loops, with the same results, but plans take 10 to 30 times as long "
            f"({_missing}): install a wheel, or install from source where there is a C compiler",
            stacklevel=3,
        )


def twin_of(
    loop: Callable[Concatenate[T, P], R],
) -> Callable[[Callable[Concatenate[T, P], R]], Callable[Concatenate[T, P], R]]:
    """Decorator of a function's form in NumPy: `loop` itself takes its place where hdplan has its loops of C, so that
    the choice costs no call anything. The twin remains as the attribute `twin`, for the laws that compare the two."""

    def chosen(twin: Callable[Concatenate[T, P], R]) -> Callable[Concatenate[T, P], R]:
        if C is None:
            return twin
        loop.twin = twin  # type: ignore[attr-defined]
        return functools.update_wrapper(loop, twin)

    return chosen


class Record:
    """A C struct of numbers, arrays and other structs, which stay alive with it; another process makes its own."""

    def __init__(self, kind: str, *fields: float | NDArray[Any] | Record | tuple[Record, ...] | None) -> None:
        """Take the fields in the order of the function `kind`, which makes the struct."""
        warn_without_loops()
        kept = (read_only(np.ascontiguousarray(x)) if isinstance(x, np.ndarray) else x for x in fields)
        self.kind, self.fields = kind, tuple(kept)

    @cached_property
    def struct(self) -> Any:
        """The struct, made on first use. Raises ValueError for a field that is not as it should be."""
        return getattr(C, self.kind)(*map(_struct, self.fields))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the fields: addresses are of this process."""
        return Record, (self.kind, *self.fields)


def _struct(field: Any) -> Any:
    if isinstance(field, tuple):
        return tuple(map(_struct, field))
    return field.struct if isinstance(field, Record) else field
