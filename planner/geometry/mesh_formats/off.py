"""OFF: numbers of vertices and faces, then a line for each."""

from __future__ import annotations

import re

import numpy as np

from hdplan.planner.geometry.mesh_formats.text import lines_of_words, numbers, shown, text_of, wholes
from hdplan.planner.geometry.mesh_formats.triangles import Triangles, fans
from hdplan.scenes.errors import InputError

_FIRST = re.compile(r"(ST)?(C)?(N)?OFF")  # texture coordinates, colours and normals of the vertices: harmless
_COLORS = (0, 1, 3, 4)  # numbers that may follow a face: none, the row of a map, red green blue, and how opaque


def read_off(data: bytes) -> Triangles:
    """Read an OFF file. Raises InputError for anything unknown in it, such as a fourth coordinate (4OFF), other
    dimensions (nOFF) and OFF BINARY."""
    lines = list(lines_of_words(text_of(data)))
    if not lines or not (kind := _FIRST.fullmatch(lines[0][1][0])):
        first = f", but {shown(lines[0][1][0])}" if lines else ""
        raise InputError(f"its first word is not OFF, or COFF, NOFF, CNOFF, STOFF or alike{first}")
    lines[0] = (lines[0][0], lines[0][1][1:])  # the numbers may follow on the same line
    (at, counts), *rows = [line for line in lines if line[1]] or [(lines[0][0], [])]
    if len(counts) not in (2, 3) or not all(re.fullmatch(r"[0-9]{1,12}", count) for count in counts):
        raise InputError(f"line {at}: {shown(counts)}: the numbers of vertices, faces and edges are expected")
    points, faces, *_ = wholes(counts, at)
    if len(rows) < points + faces:
        raise InputError(f"is cut short: it says {points} vertices and {faces} faces, and holds {len(rows)} lines")
    for line, words in rows[points + faces :]:
        raise InputError(
            f"line {line}: {shown(words)}: the file continues after its {points} vertices and {faces} faces"
        )

    texture, color, normal = (group is not None for group in kind.groups())
    least = 3 + 3 * normal + 3 * color + 2 * texture
    vertices = []
    for line, words in rows[:points]:
        if not least <= len(words) <= least + color:  # a colour may say how opaque it is
            raise InputError(f"line {line}: {shown(words)}: a vertex of {kind[0]} has {least} numbers")
        vertices.append(numbers(words, line)[:3])
    corners, sizes = list[int](), list[int]()
    for line, words in rows[points:]:
        count, *_ = wholes(words[:1], line)
        if count < 3:
            raise InputError(f"line {line}: {shown(words)}: a face has at least 3 vertices")
        if len(words) < 1 + count:
            raise InputError(f"line {line}: says {count} vertices and holds {len(words) - 1}")
        if len(words) - 1 - count not in _COLORS:
            raise InputError(f"line {line}: {shown(words)}: a face of {count} vertices and a colour are expected")
        if len(words) > 1 + count:
            numbers(words[1 + count :], line)
        if not all(map(str.isdigit, indices := words[1 : 1 + count])):  # of signs, readers think differently
            raise InputError(f"line {line}: {shown(words)}: vertices are whole numbers without a sign")
        corners += wholes(indices, line)
        sizes.append(count)
    found = np.array(vertices).reshape(-1, 3)
    of_faces = np.array(sizes, dtype=np.int64), np.array(corners, dtype=np.int64)
    return found, fans(found, *of_faces, lambda k: f"line {rows[points + k][0]}")
