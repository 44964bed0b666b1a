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
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from hdplan.planner.coal_shapes import triangle_tree
from hdplan.planner.meshes import load_mesh
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.model import Mesh

Result = TypeVar("Result")

_reading = threading.Lock()  # the error stream is the whole process's: one reader at a time may turn it aside


def read_model(urdf: Path, package_dirs: tuple[Path, ...]) -> tuple[pin.Model, pin.GeometryModel]:
    """Read a robot and its collision geometry; package:// addresses are looked up below `package_dirs`.

    Meshes are read by `load_mesh`, as those of scenes: the reader that Pinocchio has takes what it finds of a damaged
    file, and with some it never ends, or ends the process.

    Raises:
        InputError: the URDF is not valid, or a mesh is missing, damaged or flat.
    """
    model = _quietly(lambda: pin.buildModelFromUrdf(str(urdf)), urdf)
    root = ElementTree.parse(urdf).getroot()
    meshes: dict[str, tuple[str, Mesh]] = {}  # name of the geometry, as Pinocchio gives it -> link, mesh
    for link in root.findall("link"):
        for i, shape in enumerate(link.findall("collision/geometry")):
            for mesh in shape.findall("mesh"):
                scale = np.array([float(word) for word in mesh.get("scale", "1 1 1").split()])
                name = link.get("name", "")
                with naming(f"robot.urdf: {urdf}: link '{name}'"):
                    file = _mesh_file(mesh.get("filename", ""), urdf, package_dirs)
                meshes[f"{name}_{i}"] = name, Mesh(file, (float(scale[0]), float(scale[1]), float(scale[2])))
                shape.remove(mesh)
                ElementTree.SubElement(shape, "sphere", radius="1")  # in its place
    text, kind = ElementTree.tostring(root, encoding="unicode"), pin.GeometryType.COLLISION
    geometry = _quietly(lambda: pin.buildGeomFromUrdfString(model, text, kind), urdf)
    trees: dict[Mesh, Any] = {}
    for item in geometry.geometryObjects:
        if item.name in meshes:
            carrier, told = meshes[item.name]
            if told not in trees:
                with naming(f"robot.urdf: {urdf}"):
                    trees[told] = triangle_tree(load_mesh(told, f"link '{carrier}'"))
            item.geometry = trees[told]
            item.meshPath, item.meshScale = str(told.file), np.array(told.scale)
    return model, geometry


def _mesh_file(address: str, urdf: Path, package_dirs: tuple[Path, ...]) -> Path:
    """Return the file that a URDF means: package:// is below one of the folders or ROS's, file:// says it in full, and
    without either it is beside the URDF, or in the working folder."""
    scheme, told, rest = address.partition("://")
    below = rest.lstrip("/")
    if not told or scheme == "file":
        file = Path(rest or address)
        return next((each for each in (urdf.parent / file, file) if each.exists()), file)
    if scheme not in ("package", "model"):
        raise InputError(f"mesh '{address}': '{scheme}://' is not known (allowed: package://, model://, file://)")
    ros = [Path(word) for word in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if word]
    ament = [Path(word) / "share" for word in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if word]
    folders = (*package_dirs, *ros, *(folder.parent for folder in ros), *ament)
    found = next((folder / below for folder in folders if (folder / below).exists()), None)
    if found is None:
        raise InputError(f"mesh '{address}': there is no such file in any package folder (package_dirs, ROS)")
    return found


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
