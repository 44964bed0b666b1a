"""Words of an SRDF: part of the format, known to be harmless, or refused; and names of what the robot does not have.

An SRDF says which pairs of links are not checked: `<enable_colisions>` must not be passed over.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

from hdplan.scenes.errors import InputError, listed, nearest
from hdplan.scenes.robot_files.urdf_words import LISTED_NAMES
from hdplan.scenes.robot_files.xml_text import Element, split, stray_text

PAIR = ("link1", "link2", "reason")
# Element -> what it may contain, its attributes.
WORDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "robot": (
        (
            *("group", "group_state", "end_effector", "virtual_joint", "passive_joint"),
            *("disable_collisions", "disable_default_collisions", "enable_collisions"),
        ),
        ("name", "version"),
    ),
    "group": (("link", "joint", "chain", "group"), ("name",)),
    "group_state": (("joint",), ("name", "group")),
    "end_effector": ((), ("name", "parent_link", "group", "parent_group")),
    "virtual_joint": ((), ("name", "type", "parent_frame", "child_link")),
    "passive_joint": ((), ("name",)),
    "disable_collisions": ((), PAIR),
    "enable_collisions": ((), PAIR),
    "disable_default_collisions": ((), ("link",)),
    "link": ((), ("name",)),
    "joint": ((), ("name", "value")),
    "chain": ((), ("base_link", "tip_link")),
}
# Attributes that must be there: without them an element says nothing.
NEEDED: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("group", "group_state", "link", "joint", "passive_joint"), ("name",)),
    **dict.fromkeys(("disable_collisions", "enable_collisions"), PAIR[:2]),
    "disable_default_collisions": ("link",),
    "chain": ("base_link", "tip_link"),
}
# Attributes that name a link, joint or group.
NAMES: dict[str, dict[str, str]] = {
    **{kind: {"name": kind} for kind in ("link", "joint", "group")},
    **{pair: {"link1": "link", "link2": "link"} for pair in ("disable_collisions", "enable_collisions")},
    "disable_default_collisions": {"link": "link"},
    "chain": {"base_link": "link", "tip_link": "link"},
    "passive_joint": {"name": "joint"},
    "end_effector": {"parent_link": "link", "group": "group", "parent_group": "group"},
}
# Elements that are not MoveIt's and say nothing of motions and pairs, and why; what they contain is not read.
HARMLESS = {
    "robot": {
        "gripper": "where Humanoid Path Planner grasps",
        "handle": "where Humanoid Path Planner is to grasp",
        "rotor_params": "inertia and gears of motors, for Pinocchio",
        "specificities": "sizes of a humanoid's feet",
        "link_sphere_approximation": "spheres for distance fields; here the link's own geometry is checked",
        "joint_property": "weights of MoveIt's planners",
    },
    "group": {"passive_joint": "a joint that MoveIt reads outside of groups alone"},
}
FLOATING = "root_joint"  # what Pinocchio calls the joint of a floating base


def check_srdf_words(root: Element, links: Collection[str], joints: Collection[str]) -> tuple[str, ...]:
    """Return notes on links and joints that an SRDF names and the robot does not have, and groups that nothing defines.

    Raises InputError for an element or attribute that is not known, or of a namespace, and for texts within elements.
    """
    _walk(root, "robot", "")
    _check_unique(root, "group", ("name",))
    _check_unique(root, "group_state", ("name", "group"))
    for state in root.findall("group_state"):
        _check_unique(state, "joint", ("name",))
    named: dict[str, list[str]] = {"link": [], "joint": [], "group": []}
    for owner in (root, *root.findall("group"), *root.findall("group_state")):
        for element in owner:
            for key, kind in NAMES.get(element.tag, {}).items():
                if (name := element.get(key, "")) or kind != "group":  # an end effector may have no group
                    named[kind].append(name)
    virtual = [element.get("name", "") for element in root.findall("virtual_joint")]
    notes = [f"not part of SRDF, ignored: the text '{text}'"] if (text := stray_text(root)) else []
    groups = {group.get("name", "") for group in root.findall("group")}
    for kind, there in (("link", {*links}), ("joint", {*joints, *virtual, FLOATING}), ("group", groups)):
        if unknown := [name for name in dict.fromkeys(named[kind]) if name not in there]:
            shown = [f"'{name}'{nearest(name, there, 'none is like it')}" for name in unknown[:LISTED_NAMES]]
            shown += unknown[LISTED_NAMES:]
            lacking = "that nothing defines" if kind == "group" else "that the robot does not have"
            notes.append(f"the SRDF names {kind}s {lacking}: {listed(shown, LISTED_NAMES)}")
    return tuple(notes)


def _check_unique(owner: Element, tag: str, keys: tuple[str, ...]) -> None:
    """Raise InputError for two elements of the same names: readers differ about which one counts."""
    names = Counter(tuple(each.get(key, "") for key in keys) for each in owner.findall(tag))
    for (name, *of), count in names.items():
        if count > 1:
            where = f"{owner.tag} '{owner.get('name')}': " if owner.tag != "robot" else ""
            group = f" of group '{of[0]}'" if of else ""
            raise InputError(f"{where}{tag} '{name}'{group} appears {count} times; names must differ")


def _walk(element: Element, tag: str, where: str) -> None:
    children, attributes = WORDS[tag]
    for attribute in element.attrib:
        if attribute not in attributes and not (tag == "robot" and split(attribute)[0]):
            raise InputError(f"{where}{tag}: attribute {_unknown(attribute, attributes)}")
    for attribute in NEEDED.get(tag, ()):
        if not element.get(attribute):
            raise InputError(f"{where}{tag}: must have the attribute '{attribute}'")
    if (text := stray_text(element)) and tag != "robot":
        raise InputError(f"{where}{tag}: holds the text '{text}', where none belongs")
    harmless = HARMLESS.get(tag, {})
    for child in element:
        if child.tag in children:
            named = f"{child.tag} '{child.get('name')}': " if child.get("name") else ""
            _walk(child, child.tag, named if tag == "robot" else where)
        elif child.tag not in harmless:
            raise InputError(f"{where}element {_unknown(child.tag, (*children, *harmless))}")


def _unknown(word: str, known: Collection[str]) -> str:
    namespace, local = split(word)
    if namespace:
        return f"'{local}' is of the namespace '{namespace}', in which SRDF has none"
    return f"'{word}' is not known{nearest(word, known, 'not part of SRDF')}"
