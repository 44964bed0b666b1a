"""Variants of one scene file: the same scene with some of its fields replaced, as a row of a table gives them."""

from __future__ import annotations

import copy
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.fields import Document, Field, read_document
from hdplan.scenes.files import stamps_of
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import find_scene, read_scene

ENDS = ("start", "goal")  # sections that a variant gives again, whatever the file says


def load_variant(path: Path, fields: Mapping[str, object], name: str) -> Scene:
    """Read a hdplan scene with some fields replaced.

    Args:
        path: the scene's file, or a shipped one's name.
        fields: path of a field → its value, such as ``start.joints.panda_joint1``, ``goal.pose.position.0``,
            ``obstacles.shelf.pose.position.2`` (an obstacle by name or number). A variant that gives anything of
            `start` or `goal` gives all of it; of other sections, what it does not give stays.
        name: of the variant.

    Raises:
        InputError: as `load_scene`, with the file and the field; also a field of something that the scene has not.
    """
    file = find_scene(path)
    content = copy.deepcopy(_content(file, stamps_of([str(file)])))
    top = Field(content, "", Document(file))
    for end in {key.partition(".")[0] for key in fields} & {*ENDS}:
        content[end] = {}
    for key in sorted(fields, key=_order):
        _set(top, key, fields[key])
    return read_scene(top, name)


@functools.lru_cache(maxsize=8)
def _content(file: Path, _: object) -> dict[str, Any]:
    content: dict[str, Any] = read_document(file).value  # type: ignore[assignment]
    return content


def _order(key: str) -> list[tuple[int, str]]:
    """Order paths so that the entries of a list come one after another."""
    return [(int(part) if part.isdecimal() else -1, part) for part in key.split(".")]


def _set(top: Field, key: str, value: object) -> None:
    """Set the field of a document at a path; whole numbers that follow each other make a list where there is none."""
    holder: Any = top.value
    done, left = "", key
    going = True
    while going:
        part = _first_part(holder, done, left)
        done, left = f"{done}.{part}" if done else part, left[len(part) + 1 :]
        follows: Any = [] if left.partition(".")[0].isdecimal() and done.partition(".")[0] in ENDS else {}
        going = bool(left)
        held = follows if going else value
        if isinstance(holder, dict):
            if not going or holder.get(part) is None:
                holder[part] = held
            holder = holder[part]
        elif isinstance(holder, list):
            names = [entry.get("name") if isinstance(entry, dict) else None for entry in holder]
            index = names.index(part) if part in names else int(part) if part.isdecimal() else -1
            if index == len(holder) and done.partition(".")[0] in ENDS:
                holder.append(held)
            if not 0 <= index < len(holder):
                given = [str(name) for name in names if name]
                raise InputError(f"{top.document.file}: {done}: the scene has no such entry{nearest(part, given)}")
            if not going:
                holder[index] = value
            holder = holder[index]
        else:
            raise InputError(f"{top.document.file}: {done}: the scene has nothing there that holds fields")


def _first_part(holder: object, done: str, left: str) -> str:
    """Return the first part of a path: the longest key or name there that it begins with, else up to the first dot.
    Joints' names of a variant's own ends may hold dots."""
    if done in (f"{end}.joints" for end in ENDS):
        return left
    known: list[str] = []
    if isinstance(holder, dict):
        known = [str(name) for name in holder]
    elif isinstance(holder, list):
        known = [str(entry["name"]) for entry in holder if isinstance(entry, dict) and "name" in entry]
    fitting = [name for name in known if left == name or left.startswith(f"{name}.")]
    return max(fitting, key=len, default=left.partition(".")[0])
