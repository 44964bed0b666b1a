"""STL: triangles as bytes, or as text of one or several solids."""

from __future__ import annotations

import re

import numpy as np

from hdplan.planner.geometry.mesh_formats.text import line_at, numbers, shown, text_of
from hdplan.planner.geometry.mesh_formats.triangles import Triangles
from hdplan.scenes.errors import InputError
from hdplan.scenes.number_text import read_numbers

# Harmless in a binary file: the header (80 bytes, whatever they say: "solid", or "COLOR=" of Magics), the normals (the
# corners run around them) and the two bytes after each triangle, in which some programs keep a colour.
_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD = 84  # [bytes]

# the lines of a triangle, and how many words follow
_FACET = (("facet normal", 3), ("outer loop", 0), *[("vertex", 3)] * 3, ("endloop", 0), ("endfacet", 0))
_KEYWORDS = {"facet", "normal", "outer", "loop", "vertex", "endloop", "endfacet", "endsolid"}
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf)(?:inity)?(?:\([a-z0-9]*\))?|[-+]?1\.#[a-z0-9]+")


def read_stl(data: bytes) -> Triangles:
    """Read an STL file. Raises InputError for anything unknown in it.

    It is binary where its length is what its number of triangles says, as in every reader; no text of less than 7 GB
    is that by accident.
    """
    length = _HEAD + _ROW.itemsize * int.from_bytes(data[_HEAD - 4 : _HEAD], "little")
    if len(data) == length:
        with np.errstate(invalid="ignore"):  # values that are not finite are refused where they are used
            corners = np.frombuffer(data, dtype=_ROW, offset=_HEAD)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = np.array(_solids(text_of(data).lower())).reshape(-1, 3)
    else:
        raise InputError(f"is not an STL file, or is damaged: binary, it would have {length} bytes; it has {len(data)}")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _solids(text: str) -> list[float]:
    """Return the coordinates of all corners of all solids."""
    found: list[float] = []
    at = _SPACE.match(text).end()  # type: ignore[union-attr]
    while at < len(text):
        at = _named(text, at, "solid")
        while facet := _FACET_LINES.match(text, at):
            words = facet.groups()
            try:
                found += read_numbers(words[3:])
                read_numbers(words[:3])
            except ValueError:
                _explain(text, at)
            at = facet.end()
        if not text.startswith("endsolid", at):
            _explain(text, at)
        at = _named(text, at, "endsolid")
    return found


def _named(text: str, at: int, keyword: str) -> int:
    """Pass a line of a keyword and a name; return where the next line begins."""
    line = _LINE.match(text, at)[0]  # type: ignore[index]
    first, *name = line.split()
    if first != keyword:
        raise InputError(f"line {line_at(text, at)}: {shown(line)}: '{keyword}' is expected")
    if clash := _KEYWORDS.intersection(name):  # readers that go by words take it for content
        raise InputError(f"line {line_at(text, at)}: {shown(line)}: a name with the keyword '{min(clash)}'")
    return _SPACE.match(text, at + len(line)).end()  # type: ignore[union-attr]


def _explain(text: str, at: int) -> None:
    """Raise what is wrong with the triangle that begins here; a normal may hold numbers that are not finite."""
    for (keyword, count), pattern in zip(_FACET, _LINES, strict=True):
        if not (line := pattern.match(text, at)):
            if at == len(text):
                raise InputError("is cut short: it does not end with 'endsolid'")
            what = f"'{keyword}'{' and 3 numbers' * (count > 0)}"
            content = _LINE.match(text, at)[0]  # type: ignore[index]
            raise InputError(f"line {line_at(text, at)}: {shown(content)}: {what} is expected")
        words = [word for word in line.groups() if keyword == "vertex" or not _NOT_FINITE.fullmatch(word)]
        numbers(words, line_at(text, at))
        at = line.end()


def _pattern(keyword: str, count: int) -> str:
    """Return the pattern of a line with its end, and with the space before the next one."""
    return r"[ \t]+".join([*keyword.split(), *[r"(\S+)"] * count]) + r"[ \t]*(?:\n\s*|\Z)"


_SPACE, _LINE = re.compile(r"\s*"), re.compile(r"[^\n]*")  # these match everywhere
_LINES = [re.compile(_pattern(*line)) for line in _FACET]
_FACET_LINES = re.compile("".join(_pattern(*line) for line in _FACET))
