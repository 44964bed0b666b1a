"""Numbers in files: one pattern for meshes, URDF, SRDF, MJCF, clouds and messages.

Python's own `float` and `int` read more than any of these formats has: `1_0` (10), digits of other scripts, `inf`. What
another reader refuses, or reads otherwise, is refused here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_WHOLE = re.compile(r"[-+]?[0-9]{1,18}")


def read_number(word: str) -> float:
    """Return a number in decimal digits; one beyond the range of doubles is infinite. Raises ValueError for any other
    word, such as `inf`, `nan` and `0x10`."""
    if not _NUMBER.fullmatch(word):
        raise ValueError(f"{word!r} is not a number")
    return float(word)


def read_whole(word: str) -> int:
    """Return a whole number in decimal digits. Raises ValueError for any other word."""
    if not _WHOLE.fullmatch(word):
        raise ValueError(f"{word!r} is not a whole number")
    return int(word)


def read_numbers(words: Iterable[str]) -> tuple[float, ...]:
    """Return the numbers of several words. Raises ValueError for a word that is none."""
    return tuple(map(read_number, words))
