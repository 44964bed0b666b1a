"""The state of a robot when it was loaded: robots are shared, and every user of one can change its Pinocchio models.

A copy of everything in a robot that can be changed, against which the robot is compared when it is used: models by
Pinocchio's and coal's own comparison, which covers inertias, limits, placements and every vertex (0.1 ms for an arm, a
few for a humanoid of large meshes).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from hdplan.scenes.errors import InputError
from hdplan.scenes.once import read_only

if TYPE_CHECKING:
    from hdplan.planner.robot.robot import Robot

OTHERS = ("lower", "upper", "inner", "locked", "link_joint", "link_geometry", "named_states", "unchecked")


@dataclass(frozen=True, eq=False)
class AsLoaded:
    """Fields of a robot, each beside its copy."""

    model: tuple[pin.Model, pin.Model]
    carriers: tuple[int, ...]  # of the model's frames: Pinocchio does not compare them
    collision: tuple[pin.GeometryModel, pin.GeometryModel]
    others: Mapping[str, tuple[Any, Any]]  # arrays and mappings

    @classmethod
    def of(cls, robot: Robot, before: AsLoaded | None) -> AsLoaded:
        """Copy a robot. What it has from another one keeps the copies that were made `before`: it may have changed."""
        others = {name: (value := getattr(robot, name), _copy(value)) for name in OTHERS}
        if before is not None:
            others |= {name: pair for name, pair in before.others.items() if pair[0] is others[name][0]}
        if before is not None and before.model[0] is robot.model:
            model, carriers = before.model, before.carriers
        else:
            model, carriers = (robot.model, robot.model.copy()), _carriers(robot.model)
        if before is not None and before.collision[0] is robot.collision:
            return cls(model, carriers, before.collision, others)
        for item in robot.collision.geometryObjects:
            item.geometry.computeLocalAABB()  # coal's distances would do it, and its comparison sees it
        return cls(model, carriers, (robot.collision, robot.collision.clone()), others)

    def changed(self, robot: Robot, shapes: bool = True) -> str | None:
        """Name the field of a robot that is not as it was; None if all are. Its meshes, which take milliseconds, are
        compared with `shapes` alone."""
        if robot.model != self.model[1] or _carriers(robot.model) != self.carriers:
            return "model"
        if shapes and robot.collision != self.collision[1]:
            return "collision"
        same = {name: getattr(robot, name) == kept for name, (_, kept) in self.others.items()}
        return next((name for name, each in same.items() if not np.all(each)), None)


def check_as_loaded(robot: Robot, shapes: bool = True) -> None:
    """Raise InputError for a robot that was changed after it was loaded: what is proven would be about another one.
    Where no geometry matters, that of the links need not be compared (`shapes`)."""
    if name := robot.as_loaded.changed(robot, shapes):
        raise InputError(
            f"robot: {robot.name}.{name} was changed after the robot was loaded; robots are shared: change the URDF, "
            "or a copy (robot.model.copy())"
        )


def _copy(value: Any) -> Any:
    return read_only(value.copy()) if isinstance(value, np.ndarray) else value.copy()


def _carriers(model: pin.Model) -> tuple[int, ...]:
    """Return the joint that carries each frame."""
    return tuple(int(frame.parentJoint) for frame in model.frames)
