"""The text of objects that RViz exports (`.scene`), as a planning scene's message.

A line with a name; for each object a line `* ID`, its pose, the number of its shapes, each with kind, sizes, pose and
colour, and the number of its subframes, each with name and pose; a line `.` ends it. Older files have no poses and
subframes of objects: there the line below the first object's name is a number alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from .balls import need
from .text import SPACE, split

ENDING = ".scene"
SIZES = {"box": 3, "sphere": 1, "cylinder": 2}


def exported(data: bytes) -> dict[str, Any]:
    """The message."""
    _, *lines = [x.strip(SPACE) for x in data.decode("utf-8-sig").rstrip(SPACE).split("\n")]
    starts = [i for i, x in enumerate(lines) if split(x)[:1] == ["*"]]
    need(lines[-1:] == ["."] and not any(lines[: (starts or [-1])[0]]), "text of objects: is not whole")
    posed = bool(starts) and " " in lines[starts[0] + 1]
    ends = [*starts[1:], len(lines) - 1]
    objects = [_object(lines[i:end], posed) for i, end in zip(starts, ends, strict=bool(starts))]
    return {"world": {"collision_objects": objects}}


def _object(lines: list[str], posed: bool) -> dict[str, Any]:
    """One object: the first line has its name."""
    name, left = lines[0][1:].strip(SPACE), iter(split(" ".join(lines[1:])))
    need(name, "text of objects: one has no name")
    found: dict[str, Any] = {"id": name, "primitives": [], "primitive_poses": []}
    if posed:
        found["pose"] = _pose(left)
    for _ in range(_count(left)):
        (kind,) = _words(left, 1)
        need(kind in SIZES, f"'{name}': a shape '{kind}' cannot be checked")
        sizes = _words(left, SIZES[kind])
        found["primitives"].append({"type": kind, "dimensions": sizes[::-1] if kind == "cylinder" else sizes})
        found["primitive_poses"].append(_pose(left))
        _words(left, 4)  # its colour
    for _ in range(_count(left) if posed else 0):
        _words(left, 8)  # a subframe
    need(next(left, None) is None, f"'{name}': has more than is known of it")
    return found


def _words(left: Iterator[str], count: int) -> list[str]:
    found = list(islice(left, count))
    need(len(found) == count, "text of objects: is cut off")
    return found


def _count(left: Iterator[str]) -> int:
    (found,) = _words(left, 1)
    need(found.isascii() and found.isdigit() and len(found) < 8, f"text of objects: '{found}' is not a number of parts")
    return int(found)


def _pose(left: Iterator[str]) -> dict[str, Any]:
    return {"position": _words(left, 3), "orientation": _words(left, 4)}
