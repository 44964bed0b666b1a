"""Numbers in files: one pattern for meshes, URDF, SRDF, MJCF, clouds and messages.

Python's own `float` and `int` read more than any of these formats has: `1_0` (10), digits of other scripts, `inf`. What
another reader refuses, or reads otherwise, is refused here.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

# Possessive (`++`): a million digits before a wrong letter are examined once.
_NUMBER = re.compile(r"[-+]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?")
_WHOLE = re.compile(r"[-+]?[0-9]{1,18}")
_NUMBERS, _WHOLES = (re.compile(rf"{each.pattern}(?: {each.pattern})*") for each in (_NUMBER, _WHOLE))


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


def read_numbers(words: Sequence[str]) -> tuple[float, ...]:
    """Return the numbers of several words, as `read_number` does."""
    if not _NUMBERS.fullmatch(" ".join(words)):  # all at once, as meshes hold millions
        return tuple(map(read_number, words))
    return tuple(map(float, words))


def read_wholes(words: Sequence[str]) -> tuple[int, ...]:
    """Return the whole numbers of several words, as `read_whole` does."""
    if not _WHOLES.fullmatch(" ".join(words)):
        return tuple(map(read_whole, words))
    return tuple(map(int, words))
