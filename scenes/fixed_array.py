"""Arrays as values: read-only, and equal when their numbers are, so that scenes that hold them can be compared."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.once import ReadOnly


def numbers_in(value: object) -> NDArray[Any]:
    """Return a new array of what a program or a file gives: an array, or lists of numbers. Empty for lists of different
    lengths, and for truth values among the numbers of lists, which NumPy would take for 0 and 1."""
    try:
        found = np.array(value)
    except ValueError:  # rows of different lengths
        return np.empty(0)
    if isinstance(value, np.ndarray) or found.dtype.kind == "b":
        return found
    return np.empty(0) if _truth_in(value) else found


def _truth_in(value: Any) -> bool:
    return any(map(_truth_in, value)) if isinstance(value, list | tuple) else isinstance(value, bool | np.bool_)


@dataclass(frozen=True, eq=False)
class FixedArray(ReadOnly):
    """An array of floats, read-only: equal to another one of the same shape with the same numbers."""

    array: NDArray[np.float64]
    left_out: int = 0  # rows that whoever made it left out; not compared

    @cached_property
    def content(self) -> bytes:
        """Key of equality."""
        return hashlib.sha256(np.ascontiguousarray(self.array).data).digest()

    def __eq__(self, other: object) -> bool:
        """Compare the numbers."""
        if self is other:
            return True
        return isinstance(other, FixedArray) and self.array.shape == other.array.shape and self.content == other.content

    def __hash__(self) -> int:
        """Agree with equality."""
        return hash(self.content)

    def __len__(self) -> int:
        """The number of rows."""
        return len(self.array)

    def __repr__(self) -> str:
        """Return the number of entries in words."""
        return f"<{len(self)} rows>"

    def __reduce__(self) -> tuple[type, tuple[NDArray[np.float64], int]]:
        """Pickle the numbers, not what was computed of them; the copy is read-only again."""
        return FixedArray, (self.array, self.left_out)
