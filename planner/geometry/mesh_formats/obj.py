"""OBJ: vertices and faces, among entries for renderers."""

from __future__ import annotations

import re

import numpy as np

from hdplan.planner.geometry.mesh_formats.text import line_at, lines_of_words, numbers, shown, text_of, wholes
from hdplan.planner.geometry.mesh_formats.triangles import Triangles, fans
from hdplan.scenes.errors import InputError, nearest

_NAME, _LOOK, _THIN = "a name", "how the surface is drawn", "points and lines enclose nothing"
HARMLESS = {  # keywords of lines that have no say in the surface, each with the reason
    **dict.fromkeys(("g", "o", "mg"), _NAME),
    **dict.fromkeys(("vn", "vt", "s", "usemtl", "mtllib", "usemap", "maplib"), _LOOK),
    **dict.fromkeys(("lod", "bevel", "c_interp", "d_interp"), _LOOK),
    **dict.fromkeys(("p", "l"), _THIN),
}
_FREE_FORM = "vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con res ctech stech bsp bzp cdc cdp"
REFUSED = {
    **dict.fromkeys(_FREE_FORM.split(), "free-form curves and surfaces are not read: export it as triangles"),
    **dict.fromkeys(("shadow_obj", "trace_obj"), "other files that stand for this one are not read"),
    **dict.fromkeys(("call", "csh"), "other files and commands are not read"),
}
CONTINUED = {"v", "vn", "vt", "f", "p", "l"}  # lines of numbers, which continue after a backslash

_FACE = re.compile(r"f(?: [-+]?[0-9]++(?:/[-+]?[0-9]*+){0,2})+")  # of each corner: vertex/texture/normal
_CONTINUED_LINE = re.compile(r"^(?:[^\n]*\\\n)+[^\n]*", re.MULTILINE)
_DIVIDED = re.compile(r"[^\s]\\\n[^\s]")


def read_obj(data: bytes) -> Triangles:
    """Read an OBJ file. Raises InputError for anything unknown in it."""
    vertices: list[tuple[float, ...]] = []
    corners, counts, lines = list[int](), list[int](), list[int]()  # of faces
    text = text_of(data)
    if "\\\n" in text:
        text = _CONTINUED_LINE.sub(_joined, text)
    for number, words in lines_of_words(text):
        match words:
            case ["v", x, y, z]:
                vertices.append(numbers((x, y, z), number))
            case ["f", _, _, _, *_]:
                if not _FACE.fullmatch(" ".join(words)):
                    raise InputError(f"line {number}: {shown(words)}: vertices are whole numbers")
                indices = wholes([word.partition("/")[0] for word in words[1:]], number)
                rows = [row - 1 if row > 0 else len(vertices) + row for row in indices]  # from 1, or backwards
                if 0 in indices or min(rows) < 0:
                    raise InputError(f"line {number}: {shown(words)}: there is no such vertex")
                corners += rows
                counts.append(len(rows))
                lines.append(number)
            case ["v", *coordinates]:
                vertices.append(_point(coordinates, number))
            case ["f", *_]:
                raise InputError(f"line {number}: {shown(words)}: a face has at least 3 vertices")
            case [keyword, *_] if keyword not in HARMLESS:
                reason = REFUSED.get(keyword) or f"'{keyword}' is not known{nearest(keyword, ('v', 'f', *HARMLESS))}"
                raise InputError(f"line {number}: {shown(words)}: {reason}")
    points = np.array(vertices).reshape(-1, 3)
    of_faces = np.array(counts, dtype=np.int64), np.array(corners, dtype=np.int64)
    return points, fans(points, *of_faces, lambda k: f"line {lines[k]}")


def _point(words: list[str], line: int) -> tuple[float, ...]:
    """Return the place of a vertex with a weight, which must be 1, or with a colour of three numbers."""
    if len(words) not in (4, 6):
        raise InputError(f"line {line}: {shown(['v', *words])}: a vertex has 3 coordinates, and 3 numbers for a colour")
    x, y, z, *more = numbers(words, line)
    if len(more) == 1 and more != [1.0]:
        raise InputError(
            f"line {line}: {shown(['v', *words])}: the weight of a vertex must be 1; readers differ about any other"
        )
    return x, y, z


def _joined(found: re.Match[str]) -> str:
    """Join lines that continue after a backslash; empty lines follow, so that the numbers of lines stay."""
    line = found[0]
    if line.split()[0] not in CONTINUED or "#" in line[: line.rindex("\\\n")] or _DIVIDED.search(line):
        at = line_at(found.string, found.start())
        raise InputError(f"line {at}: {shown(line.partition(chr(10))[0])}: a backslash at its end has two readings")
    return line.replace("\\\n", " ") + "\n" * line.count("\n")
