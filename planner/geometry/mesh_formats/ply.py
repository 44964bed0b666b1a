"""PLY: a header that says what the elements hold, then their rows as text or as bytes of either order."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hdplan.planner.geometry.mesh_formats.text import shown, text_of, wholes
from hdplan.planner.geometry.mesh_formats.triangles import RESTART, Triangles, fans, strips
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, listed, nearest
from hdplan.scenes.number_text import read_number, read_numbers, read_whole, read_wholes

_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {  # how the format names them, and NumPy
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_AXES = ("x", "y", "z")
_CORNERS = ("vertex_indices", "vertex_index")
_USED = {*_AXES, *_CORNERS}
_SURFACES = ("face", "tristrips")

HARMLESS = {  # properties of vertices, faces and strips that have no say in the surface
    *("nx", "ny", "nz"),  # normals: the corners run around them
    *("red", "green", "blue", "alpha"),  # colours
    *(f"{kind}_{color}" for kind in ("ambient", "diffuse", "specular") for color in ("red", "green", "blue")),
    *("s", "t", "u", "v", "texture_u", "texture_v", "texcoord", "texnumber", "material_index"),  # textures
    *("quality", "confidence", "intensity", "curvature", "label"),  # what was measured or found there
    "flags",  # of an editor
}
MEASURED = "scalar_"  # at the head of a name: any other value that was measured
PASSED = {  # elements that are no surface, each with the reason
    "edge": "lines enclose nothing",
    "material": "how the surface is drawn",
    "camera": "where the surface was seen from",
}


@dataclass(frozen=True)
class _Property:
    """A property of an element: a number, or a list of numbers."""

    name: str
    type: np.dtype[Any]
    count: np.dtype[Any] | None = None  # of a list's length; None: one number


@dataclass
class _Element:
    """An element: how many rows it has, and of which properties."""

    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)


# Of the properties that count: lengths (rows,) and all numbers, row after row.
_Columns = dict[str, tuple[Array, Array]]
Numbers = Callable[[Sequence[str]], Sequence[float]]  # what reads words


def read_ply(data: bytes) -> Triangles:
    """Read a PLY file. Raises InputError for anything unknown in it: elements with rows, properties,
    lists, and lines or bytes that are left over."""
    order, elements, begin = _header(data)
    for element in elements:
        _check(element)
    held: dict[str, _Columns] = _of_bytes(data, begin, elements) if order else _of_text(data, begin, elements)
    points = held.get("vertex")
    vertices = np.column_stack([points[axis][1] for axis in _AXES]) if points else np.empty((0, 3))
    with np.errstate(invalid="ignore"):  # values that are not finite are refused where they are used
        double = vertices.astype(np.float64)
    faces, runs = (_lists(held.get(surface)) for surface in _SURFACES)
    if (short := faces[0] < 3).any():
        raise InputError(f"{_face(int(short.argmax()))}: a face has at least 3 vertices")
    of_strips = strips(double, *runs, lambda row: f"tristrips {row} (counted from 0)")
    return double, np.concatenate([fans(double, *faces, _face), of_strips])


def _lists(columns: _Columns | None) -> tuple[Rows, Rows]:
    """Return the lengths and the numbers of an element's lists of corners."""
    lengths, numbers = next(iter(columns.values())) if columns else (np.empty(0), np.empty(0))
    return lengths.astype(np.int64), numbers.astype(np.int64)


def read_ply_points(data: bytes) -> Array:
    """Read the points (m, 3) of a PLY file, some of which may not be finite: cameras mark so what they did not see.
    Raises InputError for a damaged file, and for one without an element vertex that has x, y and z."""
    order, elements, begin = _header(data)
    vertex = next((element for element in elements if element.name == "vertex"), None)
    if vertex is None:
        raise InputError("holds no element vertex")
    if not {*_AXES} <= {known.name for known in vertex.properties if known.count is None}:
        raise InputError("element 'vertex': lacks the properties x, y and z")
    held = _of_bytes(data, begin, elements) if order else _of_text(data, begin, elements, _measured)
    return np.column_stack([held["vertex"][axis][1] for axis in _AXES]).astype(np.float64)


def _measured(words: Sequence[str]) -> tuple[float, ...]:
    """Return numbers of which some may not be finite."""
    return tuple(float(word) if word.lower().lstrip("+-") in ("nan", "inf") else read_number(word) for word in words)


def _face(row: int) -> str:
    return f"face {row} (counted from 0)"


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """Return the order of bytes (empty for text), the elements, and where their rows begin."""
    order: str | None = None
    elements: list[_Element] = []
    begin, windows = 0, b"\r\n" in data[:5]
    for line in itertools.count(1):
        end = data.find(b"\n", begin)
        if end < 0:
            raise InputError("is cut short: its header does not end with 'end_header'")
        text, begin = data[begin:end].decode("ascii", errors="replace"), end + 1
        words = text.split()
        if line == 1 and words != ["ply"]:
            raise InputError("is not a PLY file: its first line is not 'ply'")
        if text.endswith("\r") != windows:  # else a first byte of the rows could be taken for the end of a line
            raise InputError(f"line {line}: {shown(text)}: does not end as the first line does")
        match words:
            case ["ply"] if line == 1:
                pass
            case ["format", kind, "1.0"] if kind in _ORDERS and order is None:
                order = _ORDERS[kind]
            case ["element", name, rows] if order is not None:
                _new(name, [element.name for element in elements], line)
                elements.append(_Element(name, wholes([rows], line)[0]))
            case ["property", *kinds, name] if elements and len(kinds) == 1 + 2 * (kinds[0] == "list"):
                _new(name, [known.name for known in elements[-1].properties], line)
                *count, values = (np.dtype(f"{order}{_type(word, line)}") for word in kinds if word != "list")
                elements[-1].properties.append(_Property(name, values, *count))
            case ["comment" | "obj_info", *_]:
                pass
            case ["end_header"] if order is not None:
                return order, elements, begin
            case _:
                raise InputError(f"line {line}: {shown(text)}: is not a line of a PLY header, or is misplaced")
    raise AssertionError("a file has an end")


def _new(name: str, others: Sequence[str], line: int) -> None:
    if name in others:
        raise InputError(f"line {line}: '{name}' appears twice")


def _type(name: str, line: int) -> str:
    if name not in _TYPES:
        raise InputError(f"line {line}: the type '{name}' is not known{nearest(name, _TYPES)}")
    return _TYPES[name]


def _check(element: _Element) -> None:
    """Refuse an element that holds what is not known."""
    of = f"element '{element.name}'"
    if element.rows < 0 or (element.rows and not element.properties):
        raise InputError(f"{of} has {element.rows} rows of {len(element.properties)} properties")
    if element.rows == 0:
        return
    if element.name not in (names := ("vertex", *_SURFACES, *PASSED)):
        raise InputError(f"{of} is not read{nearest(element.name, names)}")
    for known in element.properties:
        if known.count is not None and (element.name not in _SURFACES or known.count.kind == "f"):
            raise InputError(f"{of}: a list '{known.name}' of {known.type}, counted in {known.count}, is not read")
    if element.name in PASSED:
        return
    allowed = _AXES if element.name == "vertex" else _CORNERS
    there = [known for known in element.properties if known.name in allowed]
    if element.name == "vertex" and len(there) < len(_AXES):
        raise InputError(f"{of}: has no property '{min({*_AXES} - {known.name for known in there})}'")
    if element.name in _SURFACES and (len(there) != 1 or there[0].count is None or there[0].type.kind == "f"):
        raise InputError(f"{of}: does not have exactly one list of whole numbers {' or '.join(_CORNERS)}")
    for known in element.properties:
        if known.name not in (*allowed, *HARMLESS) and not known.name.startswith(MEASURED):
            close = nearest(known.name, (*allowed, *HARMLESS), "remove it if it does not affect the surface")
            raise InputError(f"{of}: the property '{known.name}' is not known{close}")


def _of_text(
    data: bytes, begin: int, elements: Sequence[_Element], numbers: Numbers = read_numbers
) -> dict[str, _Columns]:
    """Read rows that are text, each on a line of its own."""
    first = data.count(b"\n", 0, begin) + 1
    lines = enumerate(text_of(data).split("\n")[first - 1 :], start=first)
    rows = [(line, words) for line, text in lines if (words := text.split())]
    if (declared := sum(element.rows for element in elements)) != len(rows):
        short = "is cut short" if len(rows) < declared else "continues after its end"
        raise InputError(f"{short}: its header says {declared} rows, and it holds {len(rows)}")
    held, at = dict[str, _Columns](), 0
    for element in elements:
        found: dict[str, tuple[list[int], list[float]]] = {
            known.name: ([], []) for known in element.properties if known.name in _USED
        }
        for line, words in rows[at : at + element.rows]:
            try:
                _take(words, element.properties, found, numbers)
            except (ValueError, IndexError):
                names = listed([known.name for known in element.properties])
                raise InputError(f"line {line}: {shown(words)}: '{element.name}' needs numbers: {names}") from None
        held[element.name] = {name: (np.array(a), np.array(b)) for name, (a, b) in found.items()}
        at += element.rows
    return held


def _take(
    words: list[str], properties: Sequence[_Property], found: dict[str, tuple[list[int], list[float]]], numbers: Numbers
) -> None:
    """Add a row's numbers to `found`. Raises ValueError and IndexError for words that are not those of a row."""
    begin = 0
    for known in properties:
        count = 1
        if known.count is not None:
            count, begin = read_whole(words[begin]), begin + 1
        end = begin + count
        if count < 0 or end > len(words):
            raise ValueError
        if known.name in found:
            lengths, values = found[known.name]
            lengths.append(count)
            indices = [word for word in words[begin:end] if word != str(RESTART) or known.type.kind != "i"]
            if known.name in _CORNERS and not all(map(str.isdigit, indices)):  # of signs, readers think differently
                raise ValueError
            values += (read_wholes if known.type.kind in "iu" else numbers)(words[begin:end])
        begin = end
    if begin != len(words):
        raise ValueError


def _of_bytes(data: bytes, at: int, elements: Sequence[_Element]) -> dict[str, _Columns]:
    """Read rows that are bytes."""
    held = dict[str, _Columns]()
    for element in elements:
        held[element.name], at = _alike(data, at, element) or _one_by_one(data, at, element)
    if at != len(data):
        raise InputError(f"continues for {len(data) - at} bytes after its last element")
    return held


def _alike(data: bytes, at: int, element: _Element) -> tuple[_Columns, int] | None:
    """Read an element's rows, and where they end, at once; None if they are not all as long as the first."""
    lengths, fields, end = dict[str, int](), list[Any](), at
    for known in element.properties:
        lengths[known.name], _, end = _place(data, end, known)
        if known.count is not None:
            fields.append((f"count {known.name}", known.count))
        fields.append((known.name, known.type, (lengths[known.name],)))
    row = np.dtype(fields)
    if at + element.rows * row.itemsize > len(data):
        return None
    table = np.frombuffer(data, dtype=row, count=element.rows, offset=at)
    lists = [known.name for known in element.properties if known.count is not None]
    if not all((table[f"count {name}"] == lengths[name]).all() for name in lists):
        return None
    used = [name for name in lengths if name in _USED]
    columns = {name: (np.full(element.rows, lengths[name]), table[name].ravel()) for name in used}
    return columns, at + element.rows * row.itemsize


def _one_by_one(data: bytes, at: int, element: _Element) -> tuple[_Columns, int]:
    """Read an element's rows, and where they end, one after another."""
    found: dict[str, tuple[list[int], list[bytes]]] = {
        known.name: ([], []) for known in element.properties if known.name in _USED
    }
    for _ in range(element.rows):
        for known in element.properties:
            count, begin, at = _place(data, at, known)
            if known.name in found:
                found[known.name][0].append(count)
                found[known.name][1].append(data[begin:at])
    types = {known.name: known.type for known in element.properties}
    columns = {
        name: (np.array(counts), np.frombuffer(b"".join(values), dtype=types[name]))
        for name, (counts, values) in found.items()
    }
    return columns, at


def _place(data: bytes, at: int, known: _Property) -> tuple[int, int, int]:
    """Return the count of numbers of the property that begins here, and the places where they begin and end."""
    count = 1
    if known.count is not None:
        begin, at = at, at + known.count.itemsize
        count = int(np.frombuffer(data[begin:at], dtype=known.count)[0]) if at <= len(data) else -1
    end = at + count * known.type.itemsize
    if count < 0 or end > len(data):
        raise InputError(f"is cut short, or damaged: of '{known.name}', {count} numbers are expected at byte {at}")
    return count, at, end
