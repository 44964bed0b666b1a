"""MoveIt's `.scene` text files, which RViz exports and imports: obstacles, read as a planning scene's messages.

A line with the scene's name; then for each object a line `* ID`, its pose (x y z, then a quaternion x y z w), the count
of its shapes, and each shape: its kind, its sizes, its pose in the object, its colour; then the count of its subframes,
each with its name and pose; a line `.` ends the file. Older files have no poses or subframes of objects: all shapes
are given in the planning frame. Line ends matter only after the name and after ids.

The planning frame is taken to be the world. Source: planning_scene.cpp of MoveIt, saveGeometryToStream and
loadGeometryFromStream; shape_operations.cpp of geometric_shapes, saveAsText.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.fields import Document, Field
from hdplan.scenes.files import read_file
from hdplan.scenes.number_text import read_number, read_whole
from hdplan.scenes.values import shorten
from hdplan.scenes.yaml_values import MOST_VALUES

ENDING = ".scene"
SIZES = {"sphere": 1, "box": 3, "cylinder": 2}  # numbers of each kind
_WORD = re.compile(r"[^ \t\r\f\v]+")  # Python knows more spaces than C++, which would end a number there
REFUSED = ("cone", "mesh", "plane")


def read_geometry(file: Path) -> Field:
    """Read a `.scene` file as the message PlanningScene. Raises InputError naming the file, the line and what is
    wrong."""
    with naming(file):
        try:
            text = read_file(file).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"is not UTF-8 text (byte {error.start} is 0x{error.object[error.start]:02x})") from None
        scene = _Words(text).scene()
    return Field(scene, "", Document(file))


class _Words:
    """The text, read word by word."""

    def __init__(self, text: str) -> None:
        self.lines = text.split("\n")
        self.row = 0  # index of the current line; the first holds the name
        self.words: list[str] = []  # left in the current line

    def scene(self) -> dict[str, Any]:
        name, objects, posed = self.lines[0].strip(), list[dict[str, Any]](), self._poses_objects()
        while (marker := self._word("an object (*) or the end (.)")) != ".":
            if marker != "*":
                raise self._error(f"found {shorten(repr(marker))}, but an object (*) or the end (.) is expected here")
            objects.append(self._object(posed))
        if self.words or any(line.strip() for line in self.lines[self.row + 1 :]):
            raise self._error("the file continues after its end (.)")
        return {"name": name, "world": {"collision_objects": objects}}

    def _poses_objects(self) -> bool:
        """Tell whether objects have poses, as MoveIt does: by the line after that of the first object."""
        first = next((i for i, line in enumerate(self.lines) if i and line.startswith("*")), len(self.lines))
        return " " in "".join(self.lines[first + 1 : first + 2]).strip()

    def _object(self, posed: bool) -> dict[str, Any]:
        name, self.words = self.lines[self.row].partition("*")[2].strip(), []
        if not name:
            raise self._error("the object has no name")
        found: dict[str, Any] = {"id": name, "primitives": [], "primitive_poses": []}
        if posed:
            found["pose"] = self._pose()
        for _ in range(self._count("shapes")):
            found["primitives"].append(self._shape(name))
            found["primitive_poses"].append(self._pose())
            self._numbers(4, "a colour")
        for _ in range(self._count("subframes") if posed else 0):
            self._word("a subframe's name")
            self._pose()
        return found

    def _shape(self, name: str) -> dict[str, Any]:
        kind = self._word("a shape")
        if kind in REFUSED:
            raise self._error(f"a {kind} in MoveIt scenes is not supported yet (box, cylinder and sphere are)")
        if kind not in SIZES:
            raise self._error(f"unknown shape {shorten(repr(kind))} of {name!r}{nearest(kind, SIZES)}")
        sizes = self._numbers(SIZES[kind], f"the size of a {kind}")
        if not min(sizes) > 0.0:
            raise self._error(f"the {kind} of {name!r} must have sizes greater than 0 [m], found {min(sizes):g}")
        return {"type": kind, "dimensions": sizes[::-1] if kind == "cylinder" else sizes}  # height, radius

    def _pose(self) -> dict[str, list[float]]:
        return {"position": self._numbers(3, "a position"), "orientation": self._numbers(4, "a quaternion")}

    def _count(self, of: str) -> int:
        word = self._word(f"the number of {of}")
        if not (word.isascii() and word.isdigit() and len(word) < 8 and read_whole(word) <= MOST_VALUES):
            raise self._error(f"found {shorten(repr(word))}, but the number of {of} is expected here")
        return read_whole(word)

    def _numbers(self, count: int, of: str) -> list[float]:
        return [self._number(of) for _ in range(count)]

    def _number(self, of: str) -> float:
        word = self._word(of)
        try:
            number = read_number(word)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise self._error(f"found {shorten(repr(word))}, but a number of {of} is expected here")
        return number

    def _word(self, of: str) -> str:
        while not self.words:
            self.row += 1
            if self.row >= len(self.lines):
                self.row -= 1
                raise self._error(f"the file ends where {of} is expected: it was cut off; a whole file ends with '.'")
            self.words = _WORD.findall(self.lines[self.row])
        return self.words.pop(0)

    def _error(self, message: str) -> InputError:
        return InputError(f"line {self.row + 1}: {message}")
