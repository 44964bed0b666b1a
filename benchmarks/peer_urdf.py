"""A task of `peers` as URDF and SRDF, for planners that read these: every body a link of its own, obstacles included.

The moving joints come from hdplan's model, each with a link `carrier_I`; a body is the link `body_K`, fixed to its
carrier. The SRDF leaves out every pair of bodies that is none of the task's. Hulls are STL files, marked as convex in
Pinocchio's words (`collision_checking`) and in Tesseract's (`tesseract:make_convex`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

import coal
import numpy as np
import pinocchio as pin
import trimesh
from peer_task import Body, Task

from hdplan.scenes.array_types import Array

GROUP = "arm"
BASE = "carrier_0"


@dataclass(frozen=True)
class Description:
    """Input of a planner."""

    urdf: str
    srdf: str
    group: str  # the arm's name in the SRDF
    joints: tuple[str, ...]  # in hdplan's order
    base: str  # the link that does not move
    tip: str  # the last joint's link, or the hand whose pose is the goal


def describe(task: Task, folder: Path) -> Description:
    """Describe robot and obstacles; hulls are written to the folder. Raises RuntimeError for a shape that URDF has
    not."""
    model = task.robot.model
    robot = Element("robot", {"name": "task", "tesseract:make_convex": "true"})
    SubElement(robot, "link", name=BASE)
    for index in range(1, model.njoints):
        linear, angular = np.split(np.asarray(model.joints[index].createData().S).ravel(), 2)
        kind, axis = ("revolute", angular) if angular.any() else ("prismatic", linear)
        joint = _joint(robot, kind, model.names[index], model.parents[index], f"carrier_{index}")
        _origin(joint, model.jointPlacements[index].homogeneous)
        SubElement(joint, "axis", xyz=_words(axis))
        low, high = task.lower[index - 1], task.upper[index - 1]
        SubElement(joint, "limit", lower=repr(float(low)), upper=repr(float(high)), velocity="1", effort="1")
        SubElement(robot, "link", name=f"carrier_{index}")
    for index, body in enumerate(task.bodies):
        _joint(robot, "fixed", f"fix_{index}", body.joint, f"body_{index}")
        _link(robot, index, body, folder)
    tip = f"carrier_{model.njoints - 1}"
    if task.hand:
        frame, tip = model.frames[model.getFrameId(task.hand)], "hand"
        _origin(_joint(robot, "fixed", "fix_hand", frame.parentJoint, tip), frame.placement.homogeneous)
        SubElement(robot, "link", name=tip)
    names = tuple(model.names[1:])
    return Description(tostring(robot, encoding="unicode"), _srdf(task, tip), GROUP, names, BASE, tip)


def _srdf(task: Task, tip: str) -> str:
    """Name the arm, and the pairs that may touch."""
    robot = Element("robot", name="task")
    group, model = SubElement(robot, "group", name=GROUP), task.robot.model
    if all(before == index for index, before in enumerate(model.parents[1:].tolist())):
        SubElement(group, "chain", base_link=BASE, tip_link=tip)
    else:  # several arms
        for name in model.names[1:]:
            SubElement(group, "joint", name=name)
    for a, b in task.excused:
        SubElement(robot, "disable_collisions", link1=f"body_{a}", link2=f"body_{b}", reason="Never")
    return tostring(robot, encoding="unicode")


def _joint(robot: Element, kind: str, name: str, parent: int, child: str) -> Element:
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=f"carrier_{parent}")
    SubElement(joint, "child", link=child)
    return joint


def _link(robot: Element, index: int, body: Body, folder: Path) -> None:
    name = f"body_{index}"
    link = SubElement(robot, "link", name=name)
    collision = SubElement(link, "collision", name=name)
    _origin(collision, body.pose)
    geometry = SubElement(collision, "geometry")
    match body.piece.shape:
        case coal.Box() as box:
            SubElement(geometry, "box", size=_words(2.0 * box.halfSide))
        case coal.Sphere() as sphere:
            SubElement(geometry, "sphere", radius=repr(sphere.radius))
        case coal.Cylinder() as cylinder:
            SubElement(geometry, "cylinder", radius=repr(cylinder.radius), length=repr(2.0 * cylinder.halfLength))
        case coal.Capsule() | coal.Cone() | coal.Ellipsoid() as other:
            raise RuntimeError(f"{body.name}: URDF knows no {type(other).__name__.lower()}")
        case _:
            file = folder / f"{name}.stl"
            trimesh.convex.convex_hull(body.piece.vertices).export(file)
            SubElement(geometry, "mesh", filename=f"file://{file}")
            SubElement(SubElement(link, "collision_checking"), "convex", name=name)


def _origin(element: Element, pose: Array) -> None:
    SubElement(element, "origin", xyz=_words(pose[:3, 3]), rpy=_words(pin.rpy.matrixToRpy(pose[:3, :3])))


def _words(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
