"""Mesh files that are text: their lines, words and numbers, which are ASCII; names and comments may hold anything."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from hdplan.scenes.errors import InputError
from hdplan.scenes.number_text import read_numbers, read_wholes

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")  # where some readers end a line, or the file, and others do not


def text_of(data: bytes) -> str:
    """Return a file's text, its lines ended by `\\n`. Every byte that is not ASCII becomes one character that no number
    and no keyword has. Raises InputError for control characters."""
    text = data.decode("ascii", errors="replace").replace("\r\n", "\n")
    if found := _CONTROL.search(text):
        raise InputError(f"line {line_at(text, found.start())}: holds the control character {found[0]!r}")
    return text


def line_at(text: str, position: int) -> int:
    """Return the number of the line, from 1, in which a position of a text lies."""
    return text.count("\n", 0, position) + 1


def lines_of_words(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that hold anything but a comment, from a word with `#` on, each as its number and its words."""
    for number, line in enumerate(text.split("\n"), start=1):
        words = line.split()
        if "#" in line:
            words = words[: next((i for i, word in enumerate(words) if word[0] == "#"), None)]
        if words:
            yield number, words


def shown(words: Sequence[str] | str) -> str:
    """Return a line's content, fit to be printed."""
    text = (words if isinstance(words, str) else " ".join(words)).strip()
    return repr(text if len(text) <= 60 else f"{text[:57]}...")


def numbers(words: Sequence[str], line: int) -> tuple[float, ...]:
    """Return the numbers of a line."""
    try:
        return read_numbers(words)
    except ValueError:
        raise InputError(f"line {line}: {shown(words)}: numbers are expected") from None


def wholes(words: Sequence[str], line: int) -> tuple[int, ...]:
    """Return the whole numbers of a line."""
    try:
        return read_wholes(words)
    except ValueError:
        raise InputError(f"line {line}: {shown(words)}: whole numbers are expected") from None
