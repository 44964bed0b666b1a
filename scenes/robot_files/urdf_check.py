"""Errors in a URDF that its reader silently ignores, each of which would make a proof about a different robot.

urdfdom drops a geometry with a malformed number (the link would collide with nothing), accepts negative sizes, and
omits links that are not connected to the root. The input is a parsed URDF; the first error found is raised.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Mapping

import numpy as np

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.poses import Pose, from_rpy
from hdplan.scenes.robot_files.xml_text import DEEPEST_LEVEL, finite_numbers

SIZES = {  # attributes of each shape with their number of values, all of which must be positive
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "ellipsoid": {"radii": 3},
    "mesh": {},
}
BOUNDED = ("revolute", "prismatic")
KINDS = (*BOUNDED, "continuous", "fixed", "floating", "planar")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MOMENT_ROUNDING = 1e-2, 1e-9  # of moments of inertia, relative and [kg m²]: descriptions give two to nine digits
SHORTEST_AXIS = 1e-9  # length of an axis: squares of shorter ones are lost, and the joint would stand still, or shear
WORLD = "universe"  # Pinocchio's name for the world: of a joint of this name it would find another one's limits
LARGEST_NUMBER = 1e6  # [m, rad] in size, of any number of a geometry: beyond it distances are lost in rounding


def check_urdf(root: ElementTree.Element) -> None:
    """Check links and joints. Raises InputError naming link or joint, attribute, value and what is allowed."""
    links = _names(root, "link")
    if not links:
        raise InputError("holds no <link>; a file of macros holds no robot of its own")
    for link in root.findall("link"):
        for collision in link.findall("collision"):
            check_body(collision, f"link '{link.get('name')}': collision")
        for inertial in link.findall("inertial"):
            _check_inertial(inertial, f"link '{link.get('name')}': inertial")
    joints = dict(zip(_names(root, "joint"), root.findall("joint"), strict=True))
    for name, joint in joints.items():
        _check_joint(joint, f"joint '{name}'", joints)
    _check_connected(links, joints)


def impossible_inertias(root: ElementTree.Element) -> tuple[str, ...]:
    """Return the links whose moments of inertia no body has, beyond rounding: of the principal moments, each is at most
    the sum of the other two and none is negative; without mass all are 0."""
    found = []
    for link in root.findall("link"):
        for inertial in link.findall("inertial"):
            xx, xy, xz, yy, yz, zz = _moments(inertial, "inertial")
            least, middle, most = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            (mass,) = _numbers(inertial.find("mass"), "value", 1, "inertial: mass")
            rounding = MOMENT_ROUNDING[0] * max(most, -least) + MOMENT_ROUNDING[1]
            if min(least, least + middle - most) < -rounding or (mass == 0.0 and most > MOMENT_ROUNDING[1]):
                found.append(link.get("name", ""))
    return tuple(found)


def _names(root: ElementTree.Element, tag: str) -> list[str]:
    """Return the names of links or joints. Raises InputError for one that is missing, or that two have."""
    names = [each.get("name", "") for each in root.findall(tag)]
    for name, count in Counter(names).items():
        if not name:
            raise InputError(f"<{tag}> has no name")
        if name == WORLD:
            raise InputError(f"{tag} '{name}': the name stands for the world; another one is needed")
        if count > 1:
            raise InputError(f"{tag} '{name}' appears {count} times; names must differ")
    return names


def _check_inertial(inertial: ElementTree.Element, where: str) -> None:
    (mass,) = _numbers(inertial.find("mass"), "value", 1, f"{where}: mass")
    if mass < 0.0:
        raise InputError(f"{where}: mass: value must not be negative [kg], found '{mass:g}'")
    _moments(inertial, where)
    read_origin(inertial, where)


def _moments(inertial: ElementTree.Element, where: str) -> list[float]:
    return [_numbers(inertial.find("inertia"), key, 1, f"{where}: inertia")[0] for key in MOMENTS]


def check_body(element: ElementTree.Element, where: str) -> ElementTree.Element:
    """Return the one shape of a collision or visual. Raises InputError for none, an unknown one, or wrong numbers."""
    geometry = element.find("geometry")
    shapes = list(geometry) if geometry is not None else []
    if len(shapes) != 1:
        raise InputError(f"{where}: must hold one geometry with one shape, found {len(shapes)}")
    shape = shapes[0]
    if shape.tag not in SIZES:
        raise InputError(f"{where}: unknown shape <{shape.tag}>{nearest(shape.tag, SIZES)}")
    for attribute, count in SIZES[shape.tag].items():
        values = _numbers(shape, attribute, count, f"{where}: {shape.tag}")
        if not all(value > 0 for value in values):
            raise InputError(
                f"{where}: {shape.tag}: {attribute} must be greater than 0 [m], found '{shape.get(attribute)}'"
            )
    if shape.tag == "mesh":
        if not shape.get("filename"):
            raise InputError(f"{where}: mesh: the attribute 'filename' is missing")
        if shape.get("scale") is not None and 0.0 in _numbers(shape, "scale", 3, f"{where}: mesh"):
            raise InputError(f"{where}: mesh: scale must not be 0, found '{shape.get('scale')}'")
    read_origin(element, where)
    return shape


def read_origin(element: ElementTree.Element, where: str) -> Pose:
    """Return the pose in an element's `origin`. Raises InputError for values that are not numbers."""
    origin = element.find("origin")
    if origin is None:
        return Pose()
    (x, y, z), (roll, pitch, yaw) = (
        _numbers(origin, attribute, 3, f"{where}: origin", default="0 0 0") for attribute in ("xyz", "rpy")
    )
    return Pose((x, y, z), from_rpy(roll, pitch, yaw))


def _check_joint(joint: ElementTree.Element, where: str, joints: Mapping[str, ElementTree.Element]) -> None:
    axis, limit, mimic = joint.find("axis"), joint.find("limit"), joint.find("mimic")
    if joint.get("type") not in KINDS:
        raise InputError(f"{where}: unknown type '{joint.get('type')}'{nearest(joint.get('type', ''), KINDS)}")
    read_origin(joint, where)
    if limit is None and joint.get("type") in BOUNDED:
        raise InputError(f"{where}: a {joint.get('type')} joint needs a <limit>")
    for attribute in ("effort", "velocity") if limit is not None else ():
        _numbers(limit, attribute, 1, f"{where}: limit", largest=math.inf)
    moved = axis if joint.get("type") != "fixed" else None
    if moved is not None and math.hypot(*_numbers(moved, "xyz", 3, f"{where}: axis")) < SHORTEST_AXIS:
        raise InputError(f"{where}: axis: xyz must not be 0, found '{moved.get('xyz')}'")
    if limit is not None and joint.get("type") in BOUNDED:
        ends = [limit.get(key) for key in ("lower", "upper")]
        lower, upper = (_numbers(limit, key, 1, f"{where}: limit", "0", math.inf)[0] for key in ("lower", "upper"))
        if joint.get("type") == "prismatic" and max(abs(lower), abs(upper)) > LARGEST_NUMBER:
            raise InputError(
                f"{where}: limit: a prismatic joint has limits of at most {LARGEST_NUMBER:g} m, found {ends}"
            )
        if lower > upper:
            raise InputError(f"{where}: limit: lower must not exceed upper, found {ends[0]} and {ends[1]}")
    seen: list[str] = []
    while mimic is not None:
        followed = mimic.get("joint", "")
        if followed in seen or joints.get(followed) is joint:
            raise InputError(f"{where}: mimic: follows itself")
        if len(seen) == DEEPEST_LEVEL:
            raise InputError(f"{where}: mimic: follows through more than {DEEPEST_LEVEL} joints")
        for key in ("multiplier", "offset"):
            _numbers(mimic, key, 1, f"{where}: mimic", default="0")
        seen.append(followed)
        mimic = joints[followed].find("mimic") if followed in joints else None


def _check_connected(links: list[str], joints: Mapping[str, ElementTree.Element]) -> None:
    """Check that joints connect links that exist, and that every link is connected to one root."""
    below: dict[str, list[str]] = {}
    above: dict[str, str] = {}  # child link -> joint
    for name, joint in joints.items():
        ends = [joint.find(end) for end in ("parent", "child")]
        parent, child = ("" if end is None else end.get("link", "") for end in ends)
        for end, link in (("parent", parent), ("child", child)):
            if link not in links:
                raise InputError(f"joint '{name}': {end}: unknown link '{link}'{nearest(link, links)}")
        if other := above.get(child):
            raise InputError(f"link '{child}' is the child of two joints, '{other}' and '{name}'; one is allowed")
        below.setdefault(parent, []).append(child)
        above[child] = name
    root = next((link for link in links if link not in above), "")
    reached, waiting = set(), [root]
    while waiting:
        link = waiting.pop()
        reached.add(link)
        waiting.extend(child for child in below.get(link, []) if child not in reached)
    if lost := [link for link in links if link not in reached]:
        raise InputError(
            f"link '{lost[0]}' is not connected to the root link '{root}': joints form a loop, or one is missing"
        )


def _numbers(
    element: ElementTree.Element | None,
    attribute: str,
    count: int,
    where: str,
    default: str = "",
    largest: float = LARGEST_NUMBER,
) -> tuple[float, ...]:
    if element is None:
        raise InputError(f"{where} is missing")
    return finite_numbers(element.get(attribute, default), f"{where}: {attribute}", count, largest)
