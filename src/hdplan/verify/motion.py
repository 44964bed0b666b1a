"""The rows of a motion's file, JSON or CSV, for the joints that lead; what else the file says must agree with the
world."""

from __future__ import annotations

import copy
import csv
from pathlib import Path
from typing import Any

import numpy as np

from .balls import Ball, need
from .text import DECIMAL, mapping, values
from .world import hermite, loads, numbers, unique

SAME_VALUE = 1e-6  # [rad or m] between a joint that stands still or follows and what the file says of it
RATES = ("positions", "velocities", "accelerations")
KINDS = (".json", ".csv")


class Rows:
    """Contents of a motion's file."""

    def __init__(self, path: Path, data: bytes) -> None:
        need(path.suffix.lower() in KINDS, f"{path}: motions of this kind cannot be checked (json and csv can)")
        content: Any = self._json(path, data) if path.suffix.lower() == ".json" else self._csv(path, data)
        locked = content.get("locked") or {}
        self.path, self.locked = path, mapping(locked, "locked", " ".join(locked))
        self.names: Any = content.get("joint_names")
        need(type(self.names) is list and all(type(x) is str for x in self.names), f"{path}: joint_names")
        need(len({*self.names}) == len(self.names) > 0, f"{path}: a joint appears twice, or there is none")
        given = [content[key] for key in RATES if content.get(key) is not None]
        need(all(type(x) is list and all(type(y) is list for y in x) for x in given), f"{path}: lists of rows")
        self.given = [np.array([values(x, len(self.names), RATES[i]) for x in rows]) for i, rows in enumerate(given)]
        self.times, self.stages = content.get("times"), content.get("stages")
        rated = [content.get(x) is not None for x in ("times", *RATES[1:])]
        need(content.get("positions") is not None, f"{path}: has no positions")  # else rates would stand for them
        need(sorted(rated, reverse=True) == rated, f"{path}: velocities need times, accelerations need velocities")
        self.rule = ("", "linear", "cubic", "quintic")[len(self.given)]
        need(content.get("interpolation", self.rule) == self.rule, f"{path}: its interpolation is not that of its rows")

    def between(self, first: int, last: int) -> Rows:
        """The rows from one to another, both with them."""
        need(self.times is not None, f"{self.path}: has no times")
        part = copy.copy(self)
        part.given, part.times = [x[first : last + 1] for x in self.given], self.times[first : last + 1]
        return part

    def still(self, names: list[str], values_: list[float]) -> Rows:
        """A second in which joints stand still."""
        rest = np.zeros((2, len(names)))
        part = copy.copy(self)
        part.names, part.locked, part.times, part.rule = names, {}, [0.0, 1.0], "quintic"
        part.given = [rest + values_, rest, rest]
        return part

    def moves(self) -> bool:
        """True if anything moves."""
        at, *rates = self.given
        return bool((at != at[0]).any() or any(x.any() for x in rates))

    def rests(self, row: int) -> bool:
        """True if nothing moves at a row, and nothing speeds up: both have to be given."""
        rates = self.given[1:]
        return len(rates) == 2 and not any(x[row].any() for x in rates)

    def at(self, name: str, row: int) -> float:
        """The value of a joint at a row."""
        need(name in self.names, f"{self.path}: has no column of joint '{name}'")
        return float(self.given[0][row, self.names.index(name)])

    def last(self, name: str) -> float:
        """The value of a joint at the last row."""
        return self.at(name, -1)

    @staticmethod
    def _json(path: Path, data: bytes) -> dict[str, Any]:
        keys = f"hdplan_trajectory joint_names interpolation locked times stages verdict steps {' '.join(RATES)}"
        content = mapping(loads(data), str(path), keys)
        need(content.get("hdplan_trajectory") == 1, f"{path}: not a hdplan trajectory, version 1")
        return content

    @staticmethod
    def _csv(path: Path, data: bytes) -> dict[str, Any]:
        text = data.decode("utf-8-sig").replace("\r\n", "\n")
        lines = [next(csv.reader([line], strict=True)) for line in text.split("\n") if line.strip(" ")]
        head, *cells = [[x.strip(" ") for x in line] for line in lines]
        good = all(len(x) == len(head) and all(map(DECIMAL.fullmatch, x)) for x in cells)
        need(good, f"{path}: a cell is not a number")
        columns = unique([(x, [*map(float, each)]) for x, each in zip(head, zip(*cells, strict=True), strict=True)])
        ends = ("", ".velocity", ".acceleration")
        names = [x for x in columns if x != "time" and not x.endswith(ends[1:])]
        content: dict[str, Any] = {"joint_names": names} | ({"times": columns.pop("time")} if "time" in columns else {})
        for rate, end in zip(RATES, ends, strict=True):
            if any(x.endswith(end) for x in columns):
                content[rate] = [list(x) for x in zip(*(columns.pop(name + end) for name in names), strict=True)]
        need(not columns, f"{path}: columns of other kinds, {', '.join(columns)}")
        return content

    def of(self, joints: list[Any], held: dict[str, float]) -> dict[str, Any]:
        """The motion of a world with these joints; those that are held, or that follow, must be there where the file
        has them, too."""
        lead = [x["name"] for x in joints if x["follows"] is None]
        missing = [x for x in lead if x not in self.names]
        need(not missing, f"{self.path}: has no column of joint '{missing[0] if missing else ''}', which moves")
        for name, at in self.locked.items():
            need(name in held, f"{self.path}: locked: '{name}' is not a joint that is held")
            off = abs(float(values(at, 1, f"locked.{name}")[0]) - held[name])
            need(off <= SAME_VALUE, f"{self.path}: locked: '{name}' is held at {held[name]:g}")
        if {*self.names} - {*lead}:
            self.check_others(joints, held)
        order = [self.names.index(x) for x in lead]
        rates = zip(RATES, (rows[:, order].tolist() for rows in self.given), strict=False)
        return {"rule": self.rule, "times": self.times, **dict(rates)}

    def check_others(self, joints: list[Any], held: dict[str, float]) -> None:
        """Reject unless joints that are held, or that follow, do so at every row, and between rows: rates that are
        hardly any lead far in much time."""
        times = None if self.times is None else numbers(self.times, (len(self.given[0]),), "times")
        curve = hermite(self.given, times)  # its control points: between two rows it is within their hull
        rules = {x["name"]: x["follows"] for x in joints}
        rules |= {x: (None, 0.0, at) for x, at in held.items()}
        for i, name in enumerate(self.names):
            need(name in rules, f"{self.path}: '{name}' is not a joint of the robot")
            if rules[name] is None:
                continue  # it leads
            other, factor, add = rules[name]
            leader = i if other is None else self.names.index(joints[other]["name"])
            for k, rows in enumerate([curve, *map(Ball, self.given)]):
                off = rows[..., i] - (rows[..., leader] * factor + add * (k < 2))
                need((off.size <= SAME_VALUE).all(), f"{self.path}: '{name}' moves otherwise in the world")
