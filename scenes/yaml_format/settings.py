"""The `planner` section: its keys are the fields of `PlannerSettings`, which checks them."""

from __future__ import annotations

import dataclasses

from hdplan.scenes.fields import Field
from hdplan.scenes.planner_settings import PlannerSettings


def read_settings(section: Field) -> PlannerSettings:
    """Read a `planner` section; missing keys keep their defaults.

    Raises:
        InputError: unknown key, wrong type, or a value out of its range.
    """
    names = [field.name for field in dataclasses.fields(PlannerSettings)]
    return section.make(PlannerSettings, **section.mapping(names))
