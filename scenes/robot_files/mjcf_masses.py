"""Masses of an MJCF: the `inertial` elements as URDF has them, and what changes them."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.mjcf_values import Settings, numbers
from hdplan.scenes.robot_files.mjcf_words import TURNS, called
from hdplan.scenes.robot_files.urdf_writing import origin

AS_GIVEN = {  # settings of the compiler by which it leaves the masses as they are, the default first
    "inertiafromgeom": ("auto", "false"),
    "settotalmass": ("-1", "0"),
    "boundmass": ("0",),
    "boundinertia": ("0",),
    "balanceinertia": ("false",),
}
GRAVITY = (0.0, 0.0, -9.81)  # [m/s²] in the world, of MuJoCo by default, and of the torques here


def inertial_of(inertial: Element, frame: Pose, settings: Settings, where: str) -> Element:
    """Return an `inertial` element that stands in a frame of its body, as URDF."""
    own, where = inertial.attrib, f"{where}: inertial"
    result = Element("inertial")
    if "fullinertia" in own:
        if given := [key for key in ("diaginertia", *TURNS) if key in own]:
            raise InputError(f"{where}: fullinertia and {given[0]} are both given: leave one out")
        xx, yy, zz, xy, xz, yz = numbers(own, "fullinertia", where, "", 6)
    else:
        (xx, yy, zz), (xy, xz, yz) = numbers(own, "diaginertia", where, "", 3), (0.0, 0.0, 0.0)
    if "pos" not in own:
        raise InputError(f"{where}: pos is missing")
    result.append(origin(compose(frame, settings.pose(own, where))))
    SubElement(result, "mass", value=repr(numbers(own, "mass", where, "", 1)[0]))
    entries = {"ixx": xx, "iyy": yy, "izz": zz, "ixy": xy, "ixz": xz, "iyz": yz}
    SubElement(result, "inertia", {key: repr(value) for key, value in entries.items()})
    return result


def why_not_known(root: Element, settings: Settings) -> str | None:
    """Return the reason why torques cannot be worked out of the `inertial` elements; None if they can."""
    for key, as_given in AS_GIVEN.items():
        if settings.own.get(key, as_given[0]) not in as_given:
            return f"compiler: {key} changes those of the file"
    for option in root.findall("option"):
        if numbers(option.attrib, "gravity", "option", "0 0 -9.81", 3) != GRAVITY:
            return f"option: gravity is '{option.get('gravity')}' instead of '0 0 -9.81'"
    if any(each.get("gravity") == "disable" for each in root.findall("option/flag")):
        return "option: flag: gravity is disabled"
    for body in root.iter("body"):
        if any(numbers(body.attrib, "gravcomp", called(body), "0", 1)):
            return f"{called(body)} is held against gravity: gravcomp"
    return None
