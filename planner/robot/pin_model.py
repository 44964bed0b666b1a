"""Pinocchio models from URDF files: read without output, joints removed, base moved.

URDF file -> pin.Model and pin.GeometryModel (collision geometry), fixed base; frames and joint order are Pinocchio's.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hdplan.planner.geometry.coal_shapes import triangle_tree
from hdplan.planner.geometry.mesh_files import mesh_stamps
from hdplan.planner.geometry.meshes import TriangleMesh, load_mesh
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import Stamps
from hdplan.scenes.number_text import read_numbers
from hdplan.scenes.once import ForkSafeLock
from hdplan.scenes.poses import Vector3
from hdplan.scenes.robot_files.packages import Packages
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_files.urdf_text import read_description
from hdplan.scenes.shapes import Mesh

Result = TypeVar("Result")

_reading = ForkSafeLock()  # the error stream belongs to the whole process: one reader at a time may redirect it


@dataclass(frozen=True)
class MeshElement:
    """A mesh element of a URDF."""

    link: str
    address: str
    scale: str

    @classmethod
    def of(cls, mesh: ElementTree.Element, link: str) -> MeshElement:
        """Take a mesh element of a link."""
        return cls(link, mesh.get("filename", ""), mesh.get("scale", "1 1 1"))

    def found(self, packages: Packages) -> tuple[Path, Vector3]:
        """Return its file and its scale; a negative scale mirrors. Raises InputError for a scale that is not three
        numbers, or a file that is not found."""
        with naming(f"link '{self.link}'"):
            try:
                x, y, z = read_numbers(self.scale.split())
            except ValueError:
                raise InputError(f"mesh: scale must be three numbers, found '{self.scale}'") from None
            return packages.file(self.address), (x, y, z)


def read_model(source: Source) -> tuple[pin.Model, pin.GeometryModel, Stamps]:
    """Read a robot, on the joints of a mobile base, if any, and its collision geometry.

    Meshes are read by `load_mesh`, like those of scenes: Pinocchio's own reader accepts damaged files in part, and on
    some it hangs or crashes the process. The stamps of the mesh files, and of those beside them, taken before
    reading, are returned too.

    Raises:
        InputError: the URDF is not valid, or a mesh is missing, damaged or flat.
    """
    urdf, packages = source.urdf, Packages(source.urdf, source.package_dirs)
    model, geometry, named = _read_urdf(source)
    meshes: dict[str, tuple[str, Path, Vector3]] = {}  # name of the geometry -> link, file, scale
    for name, each in named.items():
        with naming(f"robot.urdf: {urdf}"):
            meshes[name] = each.link, *each.found(packages)
    stamps = mesh_stamps(sorted({file for _, file, _ in meshes.values()}))
    trees: dict[tuple[Path, Vector3], Any] = {}
    for item in geometry.geometryObjects:
        if item.name in meshes:
            link, file, scale = meshes[item.name]
            if (file, scale) not in trees:
                with naming(f"robot.urdf: {urdf}"):
                    trees[file, scale] = triangle_tree(_load(link, file, scale))
            item.geometry = trees[file, scale]
            item.meshPath, item.meshScale = str(file), np.array(scale)
    return model, geometry, stamps


def _load(link: str, file: Path, scale: Vector3) -> TriangleMesh:
    """Read a link's mesh; a negative scale mirrors it, as URDFs do for left and right parts, so that its triangles are
    reversed."""
    x, y, z = map(abs, scale)
    mesh = load_mesh(Mesh(file, (x, y, z)), f"link '{link}'")
    turned = slice(None, None, -1 if math.prod(scale) < 0 else 1)
    return TriangleMesh(mesh.vertices * np.sign(scale), mesh.triangles[:, turned])


def _read_urdf(source: Source) -> tuple[pin.Model, pin.GeometryModel, dict[str, MeshElement]]:
    """Read a robot and its collision geometry, with a sphere in place of every mesh; and the meshes, by Pinocchio's
    names for the geometry. Capsules and ellipsoids, which its reader passes over, are put in place here."""
    root = read_description(source).root
    _strip(root)
    whole = ElementTree.tostring(root, encoding="unicode")
    model = _quietly(lambda: pin.buildModelFromXML(whole), source.urdf)
    meshes: dict[str, MeshElement] = {}
    solids: dict[str, Any] = {}
    for link in root.findall("link"):
        name = link.get("name", "")
        for i, shape in enumerate(link.findall("collision/geometry")):
            for found in [each for each in shape if each.tag in ("mesh", "capsule", "ellipsoid")]:
                if found.tag == "mesh":
                    meshes[f"{name}_{i}"] = MeshElement.of(found, name)
                else:
                    solids[f"{name}_{i}"] = solid_of(found)
                shape.remove(found)
                ElementTree.SubElement(shape, "sphere", radius="1")  # in its place
    text = ElementTree.tostring(root, encoding="unicode")
    geometry = _quietly(lambda: pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION), source.urdf)
    for item in geometry.geometryObjects:
        if item.name in solids:
            item.geometry = solids[item.name]
    return model, geometry, meshes


def _strip(root: ElementTree.Element) -> None:
    """Leave links and joints without their visuals: what is of no concern of planning must not fail to be read."""
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
        for visual in element.findall("visual"):
            element.remove(visual)


def solid_of(element: ElementTree.Element) -> Any:
    """Return a checked primitive of a URDF as coal's."""
    sizes = {key: read_numbers(text.split()) for key, text in element.attrib.items()}
    match element.tag:
        case "box":
            return coal.Box(*sizes["size"])
        case "sphere":
            return coal.Sphere(*sizes["radius"])
        case "cylinder":
            return coal.Cylinder(*sizes["radius"], *sizes["length"])
        case "capsule":
            return coal.Capsule(*sizes["radius"], *sizes["length"])
    return coal.Ellipsoid(*sizes["radii"])


def without_joints(
    full: pin.Model, geometry: pin.GeometryModel, held: Mapping[str, float]
) -> tuple[pin.Model, pin.GeometryModel]:
    """Return the model and geometry with the held joints fixed at their values."""
    if not held:
        return full, geometry
    reference = configuration_at(full, ((full.getJointId(joint), value) for joint, value in held.items()))
    # Pinocchio finds a joint's frame by name only, and fails if a link has the joint's name, be it fixed.
    mark = "\x1f"  # which no name in XML has
    joints = {str(frame.name) for frame in full.frames if frame.type != pin.FrameType.BODY}
    for frame in full.frames:
        if frame.type == pin.FrameType.BODY and frame.name in joints:
            frame.name += mark
    model, collision = pin.buildReducedModel(full, geometry, [full.getJointId(joint) for joint in held], reference)
    for frame in model.frames:
        frame.name = frame.name.removesuffix(mark)
    return model, collision


def configuration_at(model: pin.Model, values: Iterable[tuple[int, float]]) -> NDArray[np.float64]:
    """Return Pinocchio's configuration with some joints, by index, at these values, and the others at 0."""
    q = pin.neutral(model)
    for joint, value in values:
        kind = model.joints[joint]
        q[kind.idx_q : kind.idx_q + kind.nq] = value if kind.nq == 1 else (math.cos(value), math.sin(value))
    return np.asarray(q)


def move_base(model: pin.Model, collision: pin.GeometryModel, base: pin.SE3) -> None:
    """Place the root link at `base` in the world."""
    for index in range(1, model.njoints):
        if model.parents[index] == 0:
            model.jointPlacements[index] = base * model.jointPlacements[index]
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == 0 and index > 0:
            frame.placement = base * frame.placement
    for item in collision.geometryObjects:
        if item.parentJoint == 0:
            item.placement = base * item.placement


def motion_axes(joint: pin.JointModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a one-coordinate joint's linear and angular unit velocity in its own frame."""
    data = joint.createData()
    joint.calc(data, np.eye(1, joint.idx_q + joint.nq, joint.idx_q)[0])
    motion = np.asarray(data.S, dtype=np.float64).reshape(6)
    return motion[:3], motion[3:]


def _quietly(read: Callable[[], Result], urdf: Path) -> Result:
    """Run a C++ reader that writes its messages to the error stream; they become the text of the error instead."""
    with _reading, tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as stream:
        try:
            with _error_stream_to(stream.fileno()):
                return read()
        except (ValueError, RuntimeError) as error:
            stream.seek(0)
            reasons = [line.removeprefix("Error:").strip() for line in stream if line.startswith("Error:")]
            reason = "; ".join(reasons) or " ".join(str(error).split())
            reason = reason.partition("message: ")[2].partition(" Hint:")[0] or reason  # of the mesh reader
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
