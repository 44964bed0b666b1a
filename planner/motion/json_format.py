"""Trajectories as JSON: all their fields, with the verdict on them, one line per key and per waypoint.

The key `interpolation` names the curve's rule; numbers are written in the shortest form that reads back bit for bit.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.motion.curve import ROW_RATES, RULES
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.values import shorten

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import StageMark, Trajectory

FIELDS = ("joint_names", "positions", "locked", "times", *ROW_RATES, "stages")
KEYS = ("hdplan_trajectory", "interpolation", *FIELDS, "verdict", "steps")


def write_json(trajectory: Trajectory, about: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Return the file's content; `about` holds its further entries, by key."""
    timed = [] if trajectory.times is None else [f'"times": {json.dumps(trajectory.times.tolist(), allow_nan=False)}']
    lines = [
        '"hdplan_trajectory": 1',
        f'"joint_names": {json.dumps(trajectory.joint_names)}',
        *([f'"interpolation": "{trajectory.curve.rule}"'] if timed else []),
        _rows("positions", trajectory.positions),
        f'"locked": {json.dumps(dict(trajectory.locked), allow_nan=False)}',
        *timed,
        *(_rows(key, values) for key in ROW_RATES if (values := getattr(trajectory, key)) is not None),
        *(
            [f'"stages": {json.dumps(list(map(_mark, trajectory.stages)), allow_nan=False)}']
            if trajectory.stages
            else []
        ),
        *(f'"{key}": {json.dumps(dict(value), allow_nan=False)}' for key, value in about.items()),
    ]
    return ("{\n " + ",\n ".join(lines) + "\n}\n").encode()


def _mark(mark: StageMark) -> dict[str, Any]:
    entry = {"name": mark.name, "row": mark.row}
    return {**entry, "outputs": dict(mark.outputs)} if mark.outputs else entry


def _rows(key: str, values: NDArray[np.float64]) -> str:
    rows = ",\n  ".join(json.dumps(row, allow_nan=False) for row in values.tolist())
    return f'"{key}": [\n  {rows}\n ]'


def read_json(data: bytes) -> dict[str, Any]:
    """Return the fields of the trajectory in a file. Raises InputError saying what is wrong."""
    try:
        content = json.loads(data, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON ({error})") from error
    if not isinstance(content, dict) or content.get("hdplan_trajectory") != 1:
        raise InputError(
            "not a trajectory: an object with `hdplan_trajectory: 1`, `joint_names` and `positions` is expected"
        )
    for key in content:
        if key not in KEYS:
            raise InputError(f"unknown key {shorten(repr(key))}{nearest(key, KEYS)}")
    for key in ("joint_names", "positions"):
        if not isinstance(content.get(key), list):
            raise InputError(f"{key}: missing, or not a list")
    if not isinstance(content.setdefault("locked", {}), dict):
        raise InputError("locked: an object of joint names and numbers is expected")
    rule = RULES[1 + 2 * sum(content.get(key) is not None for key in ROW_RATES)]
    if content.get("interpolation", rule) != rule:
        raise InputError(f"interpolation: '{content['interpolation']}', but the fields of its rows make it {rule}")
    if not isinstance(content.setdefault("stages", []), list):
        raise InputError("stages: a list of names and rows is expected")
    return {key: content.get(key) for key in FIELDS}


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object; of a key that appears twice, the last value would count silently."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"the key {shorten(repr(key))} appears twice")
        found[key] = value
    return found
