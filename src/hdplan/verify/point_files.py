"""Files of points: XYZ, PLY and PCD as text or as bytes, LAS. What is cut short, or holds more than it says, is
rejected; compressed files, and those with lists or more elements than points, are not read.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np

from .balls import named, need
from .text import number, split

ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"} | {
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"},
    **{"double": "f8", "float64": "f8"},
}
PCD = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
MOST_POINTS = 5_000_000  # points
NOT_FINITE = re.compile(r"[-+]?(nan|inf)", re.IGNORECASE)
LAS_HEADER, LAS_14 = 227, 375  # bytes


def table(path: Path, data: bytes) -> Any:
    """The points (m, 3) of a file, some of which may not be finite; None if it is not read."""
    return KINDS[path.suffix.lower()](data, named(path.name))


def _words(data: bytes, what: str, comma: bool = False) -> list[list[str]]:
    """The words of each line that has some and is no comment."""
    need(data.isascii() and not re.search(rb"[\x00-\x08\x0b-\x0c\x0e-\x1f\x7f]", data), f"{what}: is not plain text")
    rows = [split(line) for line in re.split(r"\r\n|\n|\r", data.decode("ascii"))]
    rows = [row for row in rows if row and row[0][0] != "#"]
    if comma and rows and "," in " ".join(rows[0]):
        rows = [[x.strip() for x in " ".join(row).split(",")] for row in rows]
    need(all(len(row) == len(rows[0]) for row in rows), f"{what}: lines of other lengths, or one that is cut short")
    return rows


def _numbers(rows: list[list[str]], columns: list[int], kinds: list[str], what: str) -> Any:
    """Three columns of numbers, each rounded to its kind."""
    need(len(rows) <= MOST_POINTS, f"{what}: at most {MOST_POINTS} points are expected")
    found = np.empty((len(rows), 3))
    for axis, (column, kind) in enumerate(zip(columns, kinds, strict=True)):
        words = [row[column] for row in rows]
        column_of = [float(x) if NOT_FINITE.fullmatch(x) else number(x, what) for x in words]
        found[:, axis] = np.array(column_of).astype(kind)
    return found


def _xyz(data: bytes, what: str) -> Any:
    rows = _words(data, what, comma=True)
    need(rows and len(rows[0]) >= 3, f"{what}: three numbers a line are expected")
    return _numbers(rows, [0, 1, 2], ["f8"] * 3, what)


def _ply(data: bytes, what: str) -> Any:
    end = re.search(rb"(?<=\n)end_header(\r?\n)", data[:100_000])
    need(data[:4] in (b"ply\n", b"ply\r") and end, f"{what}: is not a PLY file, or its header is cut short")
    assert end is not None
    line_end = end[1]
    head = data[: end.end()].split(line_end)[:-1]
    need(not any(b"\r" in x or b"\n" in x for x in head), f"{what}: lines that end in other ways")
    lines = [split(x.decode("ascii", "replace")) for x in head]
    need(len(lines) > 2 and lines[1][:1] == ["format"] and lines[1][2:] == ["1.0"], f"{what}: its format")
    need(lines[1][1] in ORDERS, f"{what}: its format")
    order, elements = ORDERS[lines[1][1]], list[tuple[str, int, list[tuple[str, str]]]]()
    for line in lines[2:-1]:
        if line[:1] == ["element"] and len(line) == 3 and line[2].isdigit():
            elements.append((line[1], int(line[2]), []))
        elif line[:1] == ["property"] and len(line) == 3 and line[1] in TYPES and elements:
            kind = TYPES[line[1]] if order or TYPES[line[1]][0] != "f" else "f8"  # text keeps its digits
            elements[-1][2].append((line[2], order + kind))
        elif line[:1] not in (["comment"], ["obj_info"]):
            return None  # lists
    if [name for name, count, _ in elements if count] != ["vertex"]:
        return None
    ((_, count, columns),) = (x for x in elements if x[1])
    return _rows(data[end.end() :], count, columns, order == "", what)


def _pcd(data: bytes, what: str) -> Any:
    head, at = dict[str, list[str]](), 0
    while "DATA" not in head:
        end = data.find(b"\n", at)
        need(0 <= end < 10_000, f"{what}: is not a PCD file, or its header is cut short")
        words, at = split(data[at:end].decode("ascii", "replace")), end + 1
        if words and words[0][0] != "#":
            need(words[0] in PCD and words[0] not in head, f"{what}: '{words[0]}' in its header")
            head[words[0]] = words[1:]
    need(all(key in head for key in PCD if key not in ("VERSION", "COUNT", "VIEWPOINT")), f"{what}: its header")
    sizes = [head[key] for key in ("WIDTH", "HEIGHT", "POINTS")]
    need(all(len(x) == 1 and x[0].isdigit() for x in sizes), f"{what}: its number of points")
    width, height, count = (int(x[0]) for x in sizes)
    need(width * height == count > 0, f"{what}: its number of points")
    counts = head.get("COUNT", ["1"] * len(head["FIELDS"]))
    parts = [head["FIELDS"], head["TYPE"], head["SIZE"], counts]
    need(len({len(x) for x in parts}) == 1, f"{what}: its fields")
    columns = list[tuple[str, str]]()
    for name, kind, size, many in zip(*parts, strict=True):
        need(kind in "IUF" and size in "1248" and many.isdigit() and 0 < int(many) < 10_000, f"{what}: its fields")
        columns += [(name if int(many) == 1 else f"{name} {i}", f"<{kind.lower()}{size}") for i in range(int(many))]
    if head["DATA"] not in (["ascii"], ["binary"]):
        return None  # compressed
    return _rows(data[at:], count, columns, head["DATA"] == ["ascii"], what)


def _rows(data: bytes, count: int, columns: list[tuple[str, str]], text: bool, what: str) -> Any:
    """The columns x, y and z of rows, as text or as bytes; None if they are not all floats of one size."""
    names = [name for name, _ in columns]
    need(all(names.count(axis) == 1 for axis in "xyz"), f"{what}: columns x, y and z are expected, each once")
    need(count <= MOST_POINTS, f"{what}: at most {MOST_POINTS} points are expected")
    at = [names.index(axis) for axis in "xyz"]
    kinds = [columns[i][1] for i in at]
    if len({*kinds}) > 1 or kinds[0][-2] != "f":
        return None
    if text:
        rows = _words(data, what)
        need(len(rows) == count and len(rows[0]) == len(columns), f"{what}: holds more or less than it says")
        return _numbers(rows, at, kinds, what)
    kind = np.dtype([(f"{i}", x) for i, (_, x) in enumerate(columns)])
    need(len(data) == count * kind.itemsize, f"{what}: holds more or less than it says")
    found = np.frombuffer(data, kind)
    return np.stack([found[f"{i}"].astype(np.float64) for i in at], axis=1)


def _las(data: bytes, what: str) -> Any:
    need(data[:4] == b"LASF" and len(data) >= LAS_HEADER, f"{what}: is not a LAS file")
    begins, _, kind, length, count = struct.unpack_from("<IIBHI", data, 96)
    if data[25] >= 4:  # minor version
        need(len(data) >= LAS_14, f"{what}: its header is cut short")
        (count,) = struct.unpack_from("<Q", data, 247)
    if kind > 10:
        return None  # compressed
    need(0 < count <= MOST_POINTS and length >= 20, f"{what}: at most {MOST_POINTS} points are expected")
    need(begins >= LAS_HEADER and begins + count * length <= len(data), f"{what}: is cut short")
    rows = np.frombuffer(data, np.uint8, count * length, begins).reshape(count, length)[:, :12]
    scale, shift = np.array(struct.unpack_from("<6d", data, 131)).reshape(2, 3)
    return np.ascontiguousarray(rows).view("<i4") * scale + shift


KINDS = {".xyz": _xyz, ".ply": _ply, ".pcd": _pcd, ".las": _las}
