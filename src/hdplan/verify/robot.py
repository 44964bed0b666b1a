"""A URDF as the checker reads it: the tree of links, joints, collision geometry and masses.

Every element and attribute that counts is known here, or rejected; of visuals nothing is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .balls import EPS, HERE, Ball, Pose, compose, dot, need, unit
from .text import attributes, children, number, row, strict_xml, values
from .turns import rotation
from .world import symmetric

# of these nothing is read; not <collision_checking>, by which Pinocchio takes capsules for cylinders
LINK = "contact surface gravity kinematic self_collide self_collision_checking self_filter sensor"
LIMIT = "acceleration deceleration jerk current command_effort gear_velocity k_velocity"  # beside those of URDF
JOINT = "calibration dynamics safety_controller joint_properties controller_gains"
SIZES = {"box": "size", "cylinder": "radius length", "sphere": "radius", "capsule": "radius length"}
SIZES |= {"ellipsoid": "radii", "mesh": "filename scale"}
KINDS = ("revolute", "continuous", "prismatic", "fixed")
BASE = ("base_origin", "base_at_x", "base_at_y")  # links of a planar base


def rpy(angles: Any) -> Ball:
    """R = Rz(yaw) Ry(pitch) Rx(roll), of decimals."""
    turn = HERE[0]
    for axis in np.flatnonzero(angles):
        turn = dot("ij,jk->ik", rotation(Ball(np.eye(3)[axis]), angles[axis]), turn)
    return Ball(turn.mid, turn.rad + 2 * EPS * np.abs(angles).sum())


def decimal(x: Any) -> Ball:
    """The decimals that are nearest to doubles."""
    return Ball(x, EPS * np.abs(x))


def upward(above: dict[str, tuple[str, str]], link: str) -> Iterator[tuple[str, str]]:
    """The joints from a link to the root, each with the link above it."""
    while link in above:
        joint, link = above[link]
        yield joint, link


def origin(element: Any, where: str) -> Pose:
    """The frame of an element's origin."""
    at = element.find("origin")
    if at is None:
        return HERE
    written = attributes(at, where, "xyz rpy")
    turn, place = (row(written.get(key, "0 0 0"), 3, f"{where}: origin") for key in ("rpy", "xyz"))
    return rpy(turn), decimal(place)


@dataclass(eq=False)
class UrdfJoint:
    """A joint as the URDF has it."""

    kind: str
    parent: str
    child: str
    pose: Pose
    axis: Ball
    low: float
    high: float
    velocity: float
    effort: float
    mimic: tuple[str, float, float] | None


class Tree:
    """The links and joints of a URDF, on the joints of a planar base if the scene has one."""

    def __init__(self, path: Path, data: bytes, base: dict[str, Any] | None) -> None:
        root = strict_xml(data)
        need(root.tag == "robot", f"{path}: is not a URDF, and cannot be checked")
        need("xacro" not in "".join(x.tag for x in root.iter()), f"{path}: is xacro, and its name must end in .xacro")
        self.name, self.stem = root.get("name", ""), path.stem.removesuffix(".urdf")
        self.elements = {x.get("name", ""): x for x in root.findall("link")}
        need(len(self.elements) == len(root.findall("link")), f"{path}: two links of one name")
        for name, link in self.elements.items():
            attributes(link, f"link '{name}'", "name type")
            placed_ = children(link, f"link '{name}'", "inertial origin", "visual collision", LINK)["origin"]
            still = placed_ is None or not any(row(x, 3, f"link '{name}'").any() for x in placed_.attrib.values())
            need(still, f"link '{name}': an origin of its own, which is not part of URDF")
        self.solid = {name for name, link in self.elements.items() if link.find("collision") is not None}
        self.joints = dict[str, UrdfJoint]()
        for each in root.findall("joint"):
            name = each.get("name", "")
            need(name not in self.joints, f"{path}: two joints of the name '{name}'")
            self.joints[name] = self._joint(each, f"joint '{name}'")
        for tag in ("link", "joint"):
            spelt = [x for x in root if x.tag.rpartition("}")[2].lower() == tag and x.tag != tag]
            need(not spelt, f"{path}: a {tag} in other letters or of a namespace")
        if base is not None:
            self._add_base(base)
        self.above = {x.child: (name, x.parent) for name, x in self.joints.items()}
        self.links = [*self.elements, *(BASE if base is not None else ())]
        need(len(self.above) == len(self.joints), f"{path}: two joints carry one link")
        self.root = next((x for x in self.links if x not in self.above), "")
        self._under, self._shapes = dict[str, list[str]](), dict[str, list[Any]]()
        for name in sorted(self.joints, reverse=True):
            self._under.setdefault(self.joints[name].parent, []).append(name)
        self.order = list[str]()  # of all joints: depth first, by name
        waiting = self._below(self.root)
        while waiting:
            name = waiting.pop()
            self.order.append(name)
            waiting += self._below(self.joints[name].child)
        need(len(self.order) == len(self.joints) == len(self.links) - 1, f"{path}: its links make no tree")
        self.movable = [x for x in self.order if self.joints[x].kind != "fixed"]

    def _below(self, link: str) -> list[str]:
        return self._under.get(link, [])

    def _joint(self, each: Any, where: str) -> UrdfJoint:
        attributes(each, where, "name type dont_collapse")
        part = children(each, where, "origin parent child axis limit mimic", "", JOINT)
        need(each.get("type") in KINDS, f"{where}: type '{each.get('type')}' cannot be checked")
        need(part["parent"] is not None and part["child"] is not None, f"{where}: has no parent or child")
        ends = [attributes(part[x], where, "link").get("link", "") for x in ("parent", "child")]
        need({*ends} <= {*self.elements}, f"{where}: is of a link that there is not")
        along = np.array([1.0, 0.0, 0.0])
        if part["axis"] is not None and each.get("type") != "fixed":
            written = attributes(part["axis"], where, "xyz rpy")
            need(not np.any(row(written.get("rpy", "0 0 0"), 3, where)), f"{where}: an axis with rpy")
            along = row(written.get("xyz"), 3, f"{where}: axis")  # URDF's default is for a joint without this element
        limit, mimic = part["limit"], None
        most = dict.fromkeys(("lower", "upper", "effort", "velocity"), 0.0)
        if limit is not None:
            written = attributes(limit, where, f"{' '.join(most)} {LIMIT} {{http://drake.mit.edu}}acceleration")
            most = {key: number(written.get(key, "0"), f"{where}: limit") for key in most}
        need(limit is not None or each.get("type") in ("continuous", "fixed"), f"{where}: has no limit")
        if part["mimic"] is not None:
            written = attributes(part["mimic"], where, "joint multiplier offset")
            factor, add = (number(written.get(key, x), where) for key, x in (("multiplier", "1"), ("offset", "0")))
            mimic = written.get("joint", ""), factor, add
        free = each.get("type") == "continuous"
        low, high = (-np.inf, np.inf) if free else (most["lower"], most["upper"])
        axis = unit(decimal(along)) if each.get("type") != "fixed" else Ball(along)
        pose = origin(each, where)
        return UrdfJoint(
            each.get("type"), ends[0], ends[1], pose, axis, low, high, most["velocity"], most["effort"], mimic
        )

    def _add_base(self, base: dict[str, Any]) -> None:
        """Put the joints of a planar base under the root link."""
        children_ = {x.child for x in self.joints.values()}
        roots = [x for x in self.elements if x not in children_]
        need(not {*BASE} & {*self.elements} and len(roots) == 1, "robot.base_joints: the URDF has such links itself")
        need(base.get("kind", "planar") == "planar", "robot.base_joints: 'planar' is the only kind")
        ways = (("x", "prismatic"), ("y", "prismatic"), ("yaw", "revolute"))
        for i, (name, kind) in enumerate(ways):
            low, high = values(base[name], 2, f"robot.base_joints.{name}").tolist()
            need(f"base_{name}" not in self.joints, "robot.base_joints: the URDF has such joints itself")
            axis = Ball(np.eye(3)[2 if name == "yaw" else i])
            below = [*BASE[1:], roots[0]][i]
            self.joints[f"base_{name}"] = UrdfJoint(kind, BASE[i], below, HERE, axis, low, high, 0.0, 0.0, None)

    def rules(self, joints: list[str]) -> dict[str, tuple[str, float, float]]:
        """Rules of some joints that follow another one of them, chains composed: leader, factor, offset."""
        found = dict[str, tuple[str, float, float]]()
        for joint in joints:
            leader, factor, offset = joint, 1.0, 0.0
            for _ in range(len(joints) + 1):
                mimic = self.joints[leader].mimic if leader in joints else None
                if mimic is None:
                    break
                leader, factor, offset = mimic[0], factor * mimic[1], factor * mimic[2] + offset
            else:
                need(False, f"joint '{joint}': follows itself")
            if leader != joint and leader in joints:
                found[joint] = leader, factor, offset
        return found

    def room(self, joint: str, rules: dict[str, tuple[str, float, float]]) -> tuple[float, float]:
        """The range that a joint's limits, and those of what follows it, leave it."""
        low, high = self.joints[joint].low, self.joints[joint].high
        for follower, (leader, factor, offset) in rules.items():
            if leader == joint and factor:
                ends = [(x - offset) / factor for x in (self.joints[follower].low, self.joints[follower].high)]
                low, high = max(low, min(ends)), min(high, max(ends))
        return low, high

    def way(self, joint: str) -> list[str]:
        """The joints that move from the root to one, with itself."""
        found = [joint, *(above for above, _ in upward(self.above, self.joints[joint].parent))]
        return [x for x in found if self.joints[x].kind != "fixed"]

    def between(self, one: str, two: str) -> set[str]:
        """The links on the way from one link to another, without the two."""
        ways = [[link, *(above for _, above in upward(self.above, link))] for link in (one, two)]
        meeting = next(x for x in ways[0] if x in ways[1])
        return ({*ways[0]} ^ {*ways[1]} | {meeting}) - {one, two}

    def shapes(self, link: str) -> list[tuple[Pose, str, dict[str, str]]]:
        """The collision geometry of a link: frame, kind and sizes in words."""
        if link in self._shapes:
            return self._shapes[link]
        found, where = list[Any](), f"link '{link}'"
        for each in self.elements[link].findall("collision") if link in self.elements else []:
            attributes(each, where, "name")
            part = children(each, where, "origin geometry", "", "material surface verbose")
            need(part["geometry"] is not None and len(part["geometry"]) == 1, f"{where}: a collision without one shape")
            shape = part["geometry"][0]
            need(shape.tag in SIZES, f"{where}: a shape <{shape.tag}>")
            found.append((origin(each, where), shape.tag, attributes(shape, where, SIZES[shape.tag])))
        self._shapes[link] = found
        return found

    def masses(self) -> list[tuple[str, float, Pose, Any]]:
        """Link, mass, frame of its centre and inertia (3, 3) about it, along that frame's axes."""
        found = []
        for link, element in self.elements.items():
            each, where = element.find("inertial"), f"link '{link}': inertial"
            if each is None:
                continue
            part = children(each, where, "origin mass inertia")
            need(part["mass"] is not None and part["inertia"] is not None, f"{where}: has no mass or inertia")
            mass = number(attributes(part["mass"], where, "value").get("value"), where)
            written = attributes(part["inertia"], where, "ixx ixy ixz iyy iyz izz")
            six = [number(written.get(key), where) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
            need(mass >= 0, f"{where}: a mass below 0")
            found.append((link, mass, origin(each, where), symmetric(np.array(six))))
        return found


def placed(tree: Tree, base: Pose, numbers: dict[str, int], held: dict[str, float]) -> tuple[Any, Any]:
    """Pose of every link, by the number of the moving joint that carries it, and for each moving joint its parent and
    frame at 0."""
    at: dict[str, tuple[int, Pose]] = {tree.root: (-1, base)}
    frames = dict[str, tuple[int, Pose]]()
    for name in tree.order:
        joint = tree.joints[name]
        parent, pose = at[joint.parent]
        pose = compose(pose, joint.pose)
        if name in numbers:
            frames[name], at[joint.child] = (parent, pose), (numbers[name], HERE)
            continue
        if joint.kind != "fixed":
            value = held[name]
            slides = joint.kind == "prismatic"
            step = (HERE[0], joint.axis * value) if slides else (rotation(joint.axis, value), HERE[1])
            pose = compose(pose, (step[0], Ball(step[1].mid, step[1].rad + EPS * np.abs(step[1].mid))))
        at[joint.child] = parent, pose
    return at, frames
