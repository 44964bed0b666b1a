"""The `planner` section: keys and types are those of `PlannerSettings`' fields, the ranges stand in one table here."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping

from hdplan.scenes.fields import Field
from hdplan.scenes.model import PlannerSettings

# Numbers: smallest and largest value. Texts: the words allowed. Truth values need no line.
ALLOWED: Mapping[str, tuple[float, float] | tuple[str, ...]] = {
    "waypoints": (3, 1000),
    "clearance": (0.0, 1.0),  # [m]
    "activation": (0.0, 1.0),  # [m]
    "gamma": (1, 32),
    "shaping_length": (1e-9, 1.0),  # [m]
    "distance": ("hdsdf", "fcl"),
    "link_bodies": ("fitted", "capsule", "outer-4", "outer-12", "box", "hull"),
    "normals": ("faces", "box", "sphere"),
}


def read_settings(section: Field) -> PlannerSettings:
    """Read a `planner` section; what it does not say keeps its default.

    Raises:
        InputError: unknown key, wrong type, or a value out of its range.
    """
    types = typing.get_type_hints(PlannerSettings)
    names = [field.name for field in dataclasses.fields(PlannerSettings)]
    values = {name: _read(entry, types[name], ALLOWED.get(name, ())) for name, entry in section.mapping(names).items()}
    return PlannerSettings(**values)


def _read(entry: Field, kind: object, allowed: tuple[typing.Any, ...]) -> typing.Any:
    if kind is bool:
        return entry.boolean()
    if kind is str:
        return entry.choice(allowed)
    low, high = allowed
    return entry.integer(low, high) if kind is int else entry.number(low, high)
