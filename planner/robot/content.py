"""Content of robots, for keys of the cache: the data that distinguish kinematic trees, or geometries."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.coal_shapes import corners_of
from hdplan.planner.geometry.shape_table import shape_of
from hdplan.planner.robot.pin_model import motion_axes

Parts = list[bytes | str]  # of a key


def tree_content(model: pin.Model) -> Parts:
    """Return the kinds of a model's joints, their axes, their placements to 12 digits (machines differ in the last
    ones), and which joint carries which."""
    parts: Parts = []
    for joint, placement in zip(model.joints, model.jointPlacements, strict=True):
        parts += [str(joint), np.round(placement.homogeneous, 12).tobytes()]
        if "Unaligned" in joint.shortname():  # the others have their axis in their name
            parts.append(np.concatenate(motion_axes(joint)).tobytes())
    return [*parts, np.array(list(model.parents)).tobytes()]


def geometry_content(item: pin.GeometryObject) -> Parts | None:
    """Return one geometry, and its place at its joint, to the last bit; None for one of an unknown kind."""
    place = [str(item.parentJoint), item.placement.homogeneous.tobytes()]
    if isinstance(item.geometry, coal.BVHModelBase):
        mesh: Any = item.geometry
        return [*place, np.array(mesh.vertices()).tobytes(), corners_of(mesh).tobytes()]
    shape = shape_of(item.geometry)
    return None if shape is None else [*place, repr(shape)]
