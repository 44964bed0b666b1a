"""Couplings of the joints of an MJCF: joints that follow others, as mimic joints of a URDF."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element, SubElement

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.robot_files.mjcf_classes import DefaultClasses
from hdplan.scenes.robot_files.mjcf_values import flag, numbers
from hdplan.scenes.robot_files.mjcf_words import called, check_attributes

STRAIGHT_POLYNOMIAL = (0.0, 1.0, 0.0, 0.0, 0.0)  # the polynomial by default


def add_mimics(
    root: Element, classes: DefaultClasses, joints: Mapping[str, Element], references: Mapping[str, float]
) -> tuple[str, ...]:
    """Make URDF joints mimic others as the `equality` section says, and return notes.

    MuJoCo counts from the `references` [rad or m], the coordinates in which the model is drawn:
    y - y0 = c0 + c1 (x - x0).

    Raises:
        InputError: anything else that couples joints or bodies, and limits of tendons.
    """
    idle = []
    for each in (each for section in root.findall("equality") for each in section):
        where = f"equality: {called(each)}"
        if each.tag != "joint" or not each.get("joint2"):
            raise InputError(f"{where}: not supported: only joints that follow another in a straight line are")
        check_attributes(each, "coupling")
        own = classes.applied(each, kind="equality")
        if not flag(own, "active", where, "true"):
            idle.append(each.get("name") or f"of {each.get('joint1')}")
            continue
        given = numbers(own, "polycoef", where, "0 1 0 0 0")
        factors = (*given, *STRAIGHT_POLYNOMIAL[len(given) :])
        if len(factors) > len(STRAIGHT_POLYNOMIAL) or any(factors[2:]):
            raise InputError(f"{where}: not supported: only joints that follow another in a straight line are")
        one, other = own.get("joint1", ""), own.get("joint2", "")
        for name in (one, other):
            if name not in joints:
                raise InputError(f"{where}: unknown joint '{name}'{nearest(name, joints)}")
        if joints[one].find("mimic") is not None:
            raise InputError(f"{where}: joint '{one}' follows another one already")
        offset = references[one] + factors[0] - factors[1] * references[other]
        SubElement(joints[one], "mimic", joint=other, multiplier=repr(factors[1]), offset=repr(offset))
    _refuse_what_binds(root, classes)
    return (f"couplings that are not active in the MJCF, left out: {', '.join(idle)}",) if idle else ()


def _refuse_what_binds(root: Element, classes: DefaultClasses) -> None:
    """Raise InputError where the `equality` section is switched off, and for limits of tendons."""
    for option in root.findall("option/flag"):
        if option.get("equality") == "disable" and root.find("equality") is not None:
            raise InputError("option: flag: equality='disable' is not supported beside an <equality> section")
    for tendon in (each for section in root.findall("tendon") for each in section):
        own = classes.applied(tendon, kind="tendon")
        if "range" in own and own.get("limited", "auto") != "false":
            raise InputError(f"tendon: {called(tendon)}: range: limits of tendons are not supported")
