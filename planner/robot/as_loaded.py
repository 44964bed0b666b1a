"""What a robot was like when it was loaded: robots are shared, and whoever has one can change its Pinocchio models.

A copy of everything in a robot that can be changed, against which the robot is compared when it is used: models by
Pinocchio's and coal's own comparison, which covers inertias, limits, placements and every vertex (0.1 ms for an arm, a
few for a humanoid of large meshes).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    from hdplan.planner.robot.robot import Robot

ARRAYS = ("lower", "upper", "inner")
MAPPINGS = ("locked", "link_joint", "link_geometry", "named_states", "unchecked")


@dataclass(frozen=True, eq=False)
class AsLoaded:
    """Copies of a robot's models, arrays and mappings."""

    model: pin.Model
    collision: pin.GeometryModel
    carriers: tuple[int, ...]  # of the frames: Pinocchio does not compare them
    arrays: Mapping[str, NDArray[np.float64]]
    mappings: Mapping[str, Mapping[Any, Any]]

    @classmethod
    def of(cls, robot: Robot) -> AsLoaded:
        """Copy a robot."""
        return cls(
            robot.model.copy(),
            robot.collision.clone(),
            _carriers(robot.model),
            {name: getattr(robot, name).copy() for name in ARRAYS},
            {name: dict(getattr(robot, name)) for name in MAPPINGS},
        )

    def changed(self, robot: Robot) -> str | None:
        """Name the field of a robot that is not as it was; None if all are."""
        if robot.model != self.model or _carriers(robot.model) != self.carriers:
            return "model"
        if robot.collision != self.collision:
            return "collision"
        arrays = (name for name, kept in self.arrays.items() if not np.array_equal(getattr(robot, name), kept))
        mappings = (name for name, kept in self.mappings.items() if getattr(robot, name) != kept)
        return next(itertools.chain(arrays, mappings), None)


def check_as_loaded(robot: Robot) -> None:
    """Raise InputError for a robot that was changed after it was loaded: what is proven would be about another one."""
    if name := robot.as_loaded.changed(robot):
        raise InputError(
            f"robot: {robot.name}.{name} was changed after the robot was loaded; robots are shared: change the URDF, "
            "or a copy (robot.model.copy())"
        )


def _carriers(model: pin.Model) -> tuple[int, ...]:
    """Return the joint that carries each frame."""
    return tuple(int(frame.parentJoint) for frame in model.frames)
