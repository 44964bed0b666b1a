"""A robot as its URDF says, by the judge's own reading: places of links over time, shapes, torques (Newton, Euler)."""

from __future__ import annotations

import sysconfig
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.scenes.array_types import Array
from sieges import poses

SHARE = Path(sysconfig.get_path("purelib")) / "cmeel.prefix" / "share"
DATA = SHARE / "example-robot-data" / "robots"
NAMED = {  # URDF and SRDF of robots that go by a name
    "panda": ("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ur_description/srdf/ur5.srdf"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "xarm_description/srdf/xarm7.srdf"),
}
GRAVITY = np.array([0.0, 0.0, -9.81])
TURNS = ("revolute", "continuous")


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the URDF."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array  # (3,) of length one
    low: float
    high: float
    effort: float
    speed: float
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True, eq=False)
class Mass:
    """A body that weighs something, in its link's frame."""

    link: str
    mass: float
    centre: Array  # (3,)
    inertia: Array  # (3, 3) about the centre, in the link's axes


@dataclass(frozen=True, eq=False)
class Motion:
    """Places of links, their turns, and how both change (T, ..)."""

    frames: dict[str, Array]
    axes: dict[str, Array]  # of each joint (T, 3), in the world
    spin: dict[str, Array]
    spin_rate: dict[str, Array]
    acceleration: dict[str, Array]  # of the link's origin


class Machine:
    """A URDF."""

    def __init__(self, urdf: Path) -> None:
        """Read links, joints and masses."""
        root = ElementTree.parse(urdf).getroot()
        self.folder = urdf.parent
        self.joints = [_joint(element) for element in root.findall("joint")]
        self.by_name = {joint.name: joint for joint in self.joints}
        self.links = [link.get("name", "") for link in root.findall("link")]
        self.above = {joint.child: joint for joint in self.joints}
        self.collisions = [
            (link.get("name", ""), _origin(collision), next(iter(collision.find("geometry") or [])))
            for link in root.findall("link")
            for collision in link.findall("collision")
        ]
        self.masses = [mass for link in root.findall("link") if (mass := _mass(link)) is not None]
        self.order: list[Joint] = []
        reached, left = {link for link in self.links if link not in self.above}, list(self.joints)
        while left:
            ready = [joint for joint in left if joint.parent in reached]
            self.order += ready
            reached |= {joint.child for joint in ready}
            left = [joint for joint in left if joint not in ready]

    def reach(self, names: Sequence[str], most: float) -> Array:
        """Return the limits (2, n) of joints, none farther than `most` from 0."""
        joints = [self.by_name[name] for name in names]
        return np.clip([[joint.low for joint in joints], [joint.high for joint in joints]], -most, most)

    def held(self, locked: dict[str, float], planned: set[str]) -> dict[str, float]:
        """Return the values of the joints that are not planned: locked, as another one says, or 0 within limits."""

        def value(name: str) -> float:
            joint = self.by_name[name]
            if name in locked:
                return float(locked[name])
            if joint.mimic is not None:
                followed, factor, offset = joint.mimic
                return factor * value(followed) + offset
            return min(max(0.0, joint.low), joint.high)

        return {
            joint.name: value(joint.name)
            for joint in self.joints
            if joint.kind != "fixed" and joint.name not in planned
        }

    def carrier(self, link: str, planned: set[str]) -> str:
        """Return the planned joint that carries a link; empty for the world."""
        while link in self.above:
            joint = self.above[link]
            if joint.name in planned:
                return joint.name
            link = joint.parent
        return ""

    def frames(self, values: dict[str, Array], base: Array) -> dict[str, Array]:
        """Return the links' places (T, 4, 4) for joints' values (T,)."""
        count = len(next(iter(values.values())))
        roots = [link for link in self.links if link not in self.above]
        found = {link: np.broadcast_to(base, (count, 4, 4)) for link in roots}
        for joint in self.order:
            found[joint.child] = found[joint.parent] @ joint.origin @ _step(joint, values, count)
        return found

    def motion(self, q: dict[str, Array], v: dict[str, Array], a: dict[str, Array], base: Array) -> Motion:
        """Return the links' motion, from the joints' values and their first and second derivatives (T,)."""
        frames, axes = self.frames(q, base), {}
        count = len(next(iter(q.values())))
        still = {link: np.zeros((count, 3)) for link in self.links if link not in self.above}
        spin, rate, push = dict(still), dict(still), dict(still)
        for joint in self.order:
            axis = (frames[joint.parent] @ joint.origin)[:, :3, :3] @ joint.axis
            axes[joint.name] = axis
            arm = frames[joint.child][:, :3, 3] - frames[joint.parent][:, :3, 3]
            w, dw = spin[joint.parent], rate[joint.parent]
            moved = push[joint.parent] + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
            speed, change = (x.get(joint.name, np.zeros(count))[:, None] * axis for x in (v, a))
            if joint.kind in TURNS:
                spin[joint.child], rate[joint.child] = w + speed, dw + change + np.cross(w, speed)
            else:
                spin[joint.child], rate[joint.child] = w, dw
                moved = moved + change + 2.0 * np.cross(w, speed)
            push[joint.child] = moved
        return Motion(frames, axes, spin, rate, push)

    def torques(self, motion: Motion, masses: list[Mass], planned: list[str]) -> Array:
        """Return the joints' required torques (T, n): force and moment about each axis, of all that the joint
        carries."""
        count = len(next(iter(motion.frames.values())))
        found = {name: np.zeros(count) for name in planned}
        for body in masses:
            frame = motion.frames[body.link]
            turned, w, dw = frame[:, :3, :3], motion.spin[body.link], motion.spin_rate[body.link]
            arm = turned @ body.centre
            push = motion.acceleration[body.link] + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
            force = body.mass * (push - GRAVITY)
            inertia = turned @ body.inertia @ np.swapaxes(turned, 1, 2)
            moment = np.einsum("tij,tj->ti", inertia, dw) + np.cross(w, np.einsum("tij,tj->ti", inertia, w))
            link, centre = body.link, frame[:, :3, 3] + arm
            while link in self.above:
                joint = self.above[link]
                if joint.name in found:
                    about = centre - motion.frames[joint.child][:, :3, 3]
                    whole = moment + np.cross(about, force) if joint.kind in TURNS else force
                    found[joint.name] += np.einsum("ti,ti->t", motion.axes[joint.name], whole)
                link = joint.parent
        return np.stack([found[name] for name in planned], axis=1)


def _step(joint: Joint, values: dict[str, Array], count: int) -> Array:
    step = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    if joint.kind in TURNS:
        step[:, :3, :3] = poses.turn(joint.axis, values[joint.name])
    elif joint.kind == "prismatic":
        step[:, :3, 3] = values[joint.name][:, None] * joint.axis
    return step


def _joint(element: ElementTree.Element) -> Joint:
    kind, limit, axis, mimic = element.get("type", ""), *map(element.find, ("limit", "axis", "mimic"))
    about: dict[str, str] = {} if limit is None else dict(limit.attrib)
    direction = np.array([float(word) for word in ("1 0 0" if axis is None else axis.get("xyz", "")).split()])
    low, high, effort, speed = (float(about.get(key, 0.0)) for key in ("lower", "upper", "effort", "velocity"))
    low, high = (-np.inf, np.inf) if kind == "continuous" else (low, high)
    follows = None
    if mimic is not None:
        follows = mimic.get("joint", ""), float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
    links, axis = (_link(element, "parent"), _link(element, "child")), direction / np.linalg.norm(direction)
    return Joint(element.get("name", ""), kind, *links, _origin(element), axis, low, high, effort, speed, follows)


def _link(element: ElementTree.Element, end: str) -> str:
    found = element.find(end)
    return "" if found is None else found.get("link", "")


def _origin(element: ElementTree.Element) -> Array:
    origin = element.find("origin")
    about: dict[str, Any] = {} if origin is None else dict(origin.attrib)
    return poses.from_rpy(about.get("xyz", "0 0 0").split(), about.get("rpy", "0 0 0").split())


def _mass(link: ElementTree.Element) -> Mass | None:
    inertial = link.find("inertial")
    mass, inertia = (None, None) if inertial is None else (inertial.find("mass"), inertial.find("inertia"))
    if inertial is None or mass is None or inertia is None:
        return None
    xx, xy, xz, yy, yz, zz = (float(inertia.get(key, 0.0)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    placed = _origin(inertial)
    turned = placed[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ placed[:3, :3].T
    return Mass(link.get("name", ""), float(mass.get("value", 0.0)), placed[:3, 3], turned)
