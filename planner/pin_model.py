"""Pinocchio's models from URDF files: read quietly, joints taken out, base moved.

URDF file -> pin.Model and pin.GeometryModel (collision geometry), fixed base; frames and joint order are Pinocchio's.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hdplan.planner.meshes import FLAT, thinness
from hdplan.scenes.errors import InputError

Result = TypeVar("Result")

_reading = threading.Lock()  # the error stream is the whole process's: one reader at a time may turn it aside


def read_model(urdf: Path, package_dirs: tuple[Path, ...]) -> tuple[pin.Model, pin.GeometryModel]:
    """Read a robot and its collision geometry; package:// addresses are looked up below `package_dirs`.

    Raises:
        InputError: the URDF is not valid, or a mesh is missing, unreadable or flat.
    """
    model = _quietly(lambda: pin.buildModelFromUrdf(str(urdf)), urdf)
    folders = [str(folder) for folder in package_dirs]
    kind = pin.GeometryType.COLLISION
    geometry = _quietly(lambda: pin.buildGeomFromUrdf(model, str(urdf), kind, package_dirs=folders), urdf)
    for item in geometry.geometryObjects:
        if isinstance(item.geometry, coal.BVHModelBase):
            _check_mesh(np.asarray(item.geometry.vertices()), f"robot.urdf: {urdf}: mesh {item.meshPath}")
    return model, geometry


def read_visuals(urdf: Path, package_dirs: tuple[Path, ...]) -> tuple[tuple[str, pin.SE3, pin.GeometryObject], ...]:
    """Read what a robot looks like: (link, placement in the link's frame, geometry) of every visual.

    Raises:
        InputError: the URDF is not valid, or a mesh is missing or unreadable.
    """
    model = _quietly(lambda: pin.buildModelFromUrdf(str(urdf)), urdf)
    folders = [str(folder) for folder in package_dirs]
    kind = pin.GeometryType.VISUAL
    geometry = _quietly(lambda: pin.buildGeomFromUrdf(model, str(urdf), kind, package_dirs=folders), urdf)
    links = [model.frames[item.parentFrame] for item in geometry.geometryObjects]
    return tuple(
        (str(link.name), link.placement.inverse() * item.placement, item)
        for link, item in zip(links, geometry.geometryObjects, strict=True)
    )


def _check_mesh(vertices: NDArray[np.float64], where: str) -> None:
    if not np.isfinite(vertices).all():
        raise InputError(f"{where}: holds coordinates that are not finite (NaN or infinite)")
    if thinness(vertices) <= FLAT:
        raise InputError(f"{where}: is flat; a body with some thickness is needed")


def without_joints(
    full: pin.Model, geometry: pin.GeometryModel, held: Mapping[str, float]
) -> tuple[pin.Model, pin.GeometryModel]:
    """Return the model and geometry with the held joints fixed at their values."""
    if not held:
        return full, geometry
    reference = pin.neutral(full)
    for joint, value in held.items():
        kind = full.joints[full.getJointId(joint)]
        coordinates = (value,) if kind.nq == 1 else (math.cos(value), math.sin(value))
        reference[kind.idx_q : kind.idx_q + kind.nq] = coordinates
    # Pinocchio finds a joint's frame by name alone and gives up where a link bears the joint's name.
    mark = " (link)"
    for frame in full.frames:
        if frame.type == pin.FrameType.BODY and frame.name in full.names:
            frame.name += mark
    model, collision = pin.buildReducedModel(full, geometry, [full.getJointId(joint) for joint in held], reference)
    for frame in model.frames:
        frame.name = frame.name.removesuffix(mark)
    return model, collision


def move_base(model: pin.Model, collision: pin.GeometryModel, base: pin.SE3) -> None:
    """Put the root link at `base` in the world."""
    for index in range(1, model.njoints):
        if model.parents[index] == 0:
            model.jointPlacements[index] = base * model.jointPlacements[index]
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == 0 and index > 0:
            frame.placement = base * frame.placement
    for item in collision.geometryObjects:
        if item.parentJoint == 0:
            item.placement = base * item.placement


def _quietly(read: Callable[[], Result], urdf: Path) -> Result:
    """Run a C++ reader that writes its complaints to the error stream; they become the text of the error instead."""
    with _reading, tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said:
        try:
            with _error_stream_to(said.fileno()):
                return read()
        except (ValueError, RuntimeError) as error:
            said.seek(0)
            reasons = [line.removeprefix("Error:").strip() for line in said if line.startswith("Error:")]
            reason = "; ".join(reasons) or " ".join(str(error).split())
            reason = reason.partition("message: ")[2].partition(" Hint:")[0] or reason  # of the mesh reader's words
            raise InputError(f"robot.urdf: {urdf}: {reason}") from None


@contextlib.contextmanager
def _error_stream_to(handle: int) -> Iterator[None]:
    sys.stderr.flush()
    kept = os.dup(2)
    os.dup2(handle, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
