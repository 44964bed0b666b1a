"""The stages of a scene's job, each of one kind that is known, as the scene has them."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from typing import Any

from . import scene as scenes
from .balls import need
from .text import listing, mapping

OF_CURVES = "link position_tolerance orientation_tolerance free_rotation tool_speed tool_acceleration"
CURVES = {
    "line": f"by to frame turn rpy {OF_CURVES}",
    "circle": f"by to frame turn rpy interim center {OF_CURVES}",
    "along": f"poses file frame {OF_CURVES}",
}
KINDS = {"move": "", **CURVES, "grip": "joints object link mass", "release": "joints object", "set": "", "wait": ""}
ARM = ("move", *CURVES)  # kinds that move the arm
MOST_STAGES = 1000
COLUMN = re.compile(r"\$(\$|[A-Za-z_][A-Za-z0-9_]*)?")  # of a table, in the texts of a repeated stage


@dataclass(frozen=True)
class Stage:
    """A stage as the scene has it."""

    name: str
    kind: str
    content: Any  # of its kind
    touch: list[tuple[str, str]]
    beside: dict[str, Any]  # what else it has
    blend: float = 0.0  # [m] within which it goes over into the next one; 0: it ends at rest
    stops: bool = False  # whether the motion rests at its end, where it would have had a blend

    @property
    def fingers(self) -> bool:
        """True if fingers move in it."""
        return self.kind in ("grip", "release") and bool(self.content.get("joints"))

    @property
    def curve(self) -> bool:
        """True if a link follows a curve in it."""
        return self.kind in CURVES


def stages_of(top: dict[str, Any]) -> list[Stage]:
    """The stages of a scene's job."""
    entries = [stage for entry in listing(top.get("job"), "job") for stage in repeated(entry)]
    need(0 < len(entries) <= MOST_STAGES, f"job: 1 to {MOST_STAGES} stages are expected")
    found = [stage_of(entry, i) for i, entry in enumerate(entries)]
    need(len({x.name for x in found}) == len(found), "job: two stages of one name")
    for one, other in itertools.zip_longest(found, found[1:]):
        joined = not one.blend or (other is not None and other.kind in ARM)
        need(joined, f"stage '{one.name}': blend: nothing follows that moves the arm")
        same = not one.blend or one.beside.get("limits") == other.beside.get("limits")
        need(same, f"stage '{one.name}': blend: into a stage with other limits")
    return found


def repeated(entry: Any) -> list[Any]:
    """A stage as it stands in the list, or those that a `repeat` makes of the rows of its table: in these `$box` is the
    value of the column `box`, in a longer text its words, and `$$` is a dollar sign. A name that says nothing of the
    row gets its number."""
    if not isinstance(entry, dict) or "repeat" not in entry:
        return [entry]
    need({*entry} == {"repeat"}, "job: repeat goes with nothing else")
    content, made = mapping(entry["repeat"], "repeat", "over stages"), list[Any]()
    rows, stages = (listing(content.get(key), f"repeat.{key}") for key in ("over", "stages"))
    need(0 < len(rows) * len(stages) <= MOST_STAGES, f"repeat: makes 1 to {MOST_STAGES} stages")
    for number, row in enumerate(rows, 1):
        need(isinstance(row, dict) and {*row} == {*rows[0]}, "repeat.over: rows of the same columns are expected")
        for stage in stages:
            one = filled(stage, row)
            same = isinstance(one, dict) and type(one.get("name")) is str and one["name"] == stage["name"]
            made.append({**one, "name": f"{one['name']} {number}"} if same else one)
    return made


def filled(value: Any, row: dict[str, Any]) -> Any:
    """A part of a stage with the values of a row in it."""
    if isinstance(value, dict):
        return {filled(key, row): filled(each, row) for key, each in value.items()}
    if isinstance(value, list):
        return [filled(each, row) for each in value]
    if type(value) is not str:
        return value

    def column(found: re.Match[str]) -> Any:
        need(found[1] == "$" or found[1] in row, f"repeat: there is no column '{found[1]}'")
        return "$" if found[1] == "$" else row[found[1]]

    whole = COLUMN.fullmatch(value)
    return column(whole) if whole else COLUMN.sub(lambda found: str(column(found)), value)


def stage_of(entry: Any, number: int) -> Stage:
    """A stage."""
    what = f"job[{number}]"
    keys = mapping(entry, what, f"{' '.join(KINDS)} name touch limits speed path blend")
    kinds = [x for x in KINDS if x in keys]
    need(len(kinds) == 1, f"{what}: one of {', '.join(KINDS)} is expected")
    (kind,) = kinds
    content = keys.pop(kind)
    content = mapping(content, f"{what}.{kind}", KINDS[kind]) if KINDS[kind] else content
    need("path" not in keys or kind == "move", f"{what}.path: goes with 'move' alone")
    need("blend" not in keys or kind in ARM, f"{what}.blend: goes with {', '.join(ARM)}")
    blend = scenes.one(keys.pop("blend", 0.0), f"{what}.blend")
    need(0 <= blend <= 1, f"{what}.blend: a radius of 0 to 1 m is expected")
    name = scenes.word(keys.pop("name", f"{kind} {number}"), what)
    pairs = dict[tuple[str, str], None]()
    for pair in listing(keys.pop("touch", None), f"{what}.touch"):
        need(type(pair) is list and len(pair) == 2, f"{what}.touch: pairs are expected")
        one, others = pair[0], pair[1] if type(pair[1]) is list else [pair[1]]
        need(one not in others, f"{what}.touch: '{one}' touches itself")
        pairs |= {(scenes.word(one, what), scenes.word(x, what)): None for x in others}
    return Stage(name, kind, content, [*pairs], keys, blend)
