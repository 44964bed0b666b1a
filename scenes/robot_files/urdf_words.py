"""Words of a URDF or SRDF that are not part of the format, or name nothing that exists.

URDF readers ignore what they do not know: a shape in `<collisionx>` would never be checked. A word that is close to one
of the format's is taken for a misspelling and refused; any other (contact parameters, filters and the like, which many
robots have) is named in a note. At the top level, vendors add elements of their own.
"""

from __future__ import annotations

import difflib
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterable

from hdplan.scenes.errors import InputError, listed, nearest

# The elements that define a robot's bodies: what each may contain, and its attributes.
ELEMENTS = {
    "link": ("inertial", "visual", "collision", "collision_checking"),  # the last is Pinocchio's, for capsules
    "inertial": ("origin", "mass", "inertia"),
    "collision": ("origin", "geometry", "material", "verbose"),
    "geometry": ("box", "cylinder", "sphere", "capsule", "ellipsoid", "mesh"),
    "joint": ("origin", "parent", "child", "axis", "calibration", "dynamics", "limit", "mimic", "safety_controller"),
}
ATTRIBUTES = {
    "link": ("name", "type"),
    "joint": ("name", "type"),
    "collision": ("name",),
    "geometry": ("name",),
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "ellipsoid": ("radii",),
    "mesh": ("filename", "scale"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "mimic": ("joint", "multiplier", "offset"),
}
ONCE = ("inertial", "origin", "mass", "inertia", "geometry", "parent", "child", "axis", "limit", "mimic")
SRDF = (
    *("group", "group_state", "end_effector", "virtual_joint", "passive_joint"),
    *("disable_collisions", "disable_default_collisions", "enable_collisions"),
)
PAIR, ONE = ("link1", "link2", "reason"), ("link",)
ABOUT_COLLISIONS = {"disable_collisions": PAIR, "enable_collisions": PAIR, "disable_default_collisions": ONE}
FLOATING = "root_joint"  # what Pinocchio calls the joint of a floating base
NEARLY, NEARLY_SHORT = (
    0.7,
    0.6,
)  # similarity from which a word is a misspelling; of at most four letters
MOST = 4  # names in a note; further ones are counted


def check_urdf_words(root: ElementTree.Element) -> tuple[str, ...]:
    """Return a note on parts of links and joints that are not URDF.

    Raises InputError for a word that is close to one of URDF's, and for duplicates of elements that may occur once.
    """
    for element in root:
        if (tag := _name(element)) not in ("link", "joint"):
            check_spelling(tag, ("link", "joint"), "element")
    unknown: dict[str, None] = {}
    for element in root:
        if element.tag in ("link", "joint"):
            _walk(element, f"{element.tag} '{element.get('name')}'", unknown)
    return (f"not part of URDF, ignored: {listed(unknown, MOST)}",) if unknown else ()


def check_srdf_words(root: ElementTree.Element, links: Collection[str], joints: Collection[str]) -> tuple[str, ...]:
    """Return notes on links and joints that an SRDF names and the robot does not have, and groups that nothing defines.

    Raises InputError for a word that is close to one of SRDF's.
    """
    named: dict[str, list[str]] = {"link": [], "joint": [], "group": []}
    for element in root:
        tag = _name(element)
        if tag not in SRDF:
            check_spelling(tag, SRDF, "element")
        if tag in ABOUT_COLLISIONS:
            known = ABOUT_COLLISIONS[tag]
            for attribute in element.attrib:
                if attribute not in known:
                    check_spelling(attribute, known, f"{tag}: attribute")
            named["link"] += [element.get(key, "") for key in known if key != "reason"]
        if tag == "passive_joint":
            named["joint"].append(element.get("name", ""))
        if tag == "end_effector":
            named["link"].append(element.get("parent_link", ""))
            named["group"] += [element.get(key, "") for key in ("group", "parent_group") if element.get(key)]
        if tag == "group":
            for entry in element:
                if entry.tag in named:
                    named[entry.tag].append(entry.get("name", ""))
                if entry.tag == "chain":
                    named["link"] += [entry.get("base_link", ""), entry.get("tip_link", "")]
        if tag == "group_state":
            named["joint"] += [joint.get("name", "") for joint in element.findall("joint")]
    virtual = [element.get("name", "") for element in root.findall("virtual_joint")]
    notes = []
    groups = {group.get("name", "") for group in root.findall("group")}
    for kind, there in (("link", {*links}), ("joint", {*joints, *virtual, FLOATING}), ("group", groups)):
        if unknown := [name for name in dict.fromkeys(named[kind]) if name not in there]:
            shown = [f"'{name}'{nearest(name, there, 'none is like it')}" for name in unknown[:MOST]] + unknown[MOST:]
            lacking = "that nothing defines" if kind == "group" else "that the robot does not have"
            notes.append(f"the SRDF names {kind}s {lacking}: {listed(shown, MOST)}")
    return tuple(notes)


def check_shapes(root: ElementTree.Element) -> tuple[str, ...]:
    """Return a note on links that are visible but have no collision geometry, unless no link has any."""
    links = root.findall("link")
    seen = [
        f"{link.get('name')}" for link in links if link.find("visual") is not None and not link.findall("collision")
    ]
    if not seen or not root.findall("link/collision"):
        return ()
    return (f"links without collision geometry, never checked: {listed(seen, MOST)}",)


def _walk(element: ElementTree.Element, where: str, unknown: dict[str, None]) -> None:
    """Check an element and its children; collect unknown words that resemble no known one."""
    tag = _name(element)
    for attribute in element.attrib if tag in ATTRIBUTES else ():
        if attribute not in ATTRIBUTES[tag]:
            check_spelling(attribute, ATTRIBUTES[tag], f"{where}: {tag}: attribute")
            unknown[f"{attribute} of {tag}"] = None
    if tag not in ELEMENTS:
        return
    seen: set[str] = set()
    for child in element:
        name = _name(child)
        if name not in ELEMENTS[tag]:
            if tag != "geometry":  # which contains one known shape, checked with its sizes
                check_spelling(name, ELEMENTS[tag], f"{where}: element")
                unknown[f"{name} in {tag}"] = None
        elif name in seen and name in ONCE:
            raise InputError(f"{where}: <{name}> occurs twice in <{tag}>; only one is allowed")
        seen.add(name)
        if name != "visual":  # nothing is proven about it
            _walk(child, where, unknown)


def check_spelling(word: str, known: Iterable[str], where: str) -> None:
    """Raise InputError for a word that is close to a known one, unless it is a compound of it (gear_velocity)."""
    likeness = {right: difflib.SequenceMatcher(None, word.lower(), right).ratio() for right in known}
    for right in sorted(likeness, key=likeness.__getitem__, reverse=True):
        if likeness[right] >= (NEARLY if len(right) > 4 else NEARLY_SHORT) and (
            "_" not in word.strip("_") or right not in word
        ):
            raise InputError(f"{where} '{word}' is not known (did you mean '{right}'?)")


def _name(element: ElementTree.Element) -> str:
    """Return an element's name without its namespace; empty for a comment."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
