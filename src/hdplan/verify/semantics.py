"""The joints of a robot that move, and where the others stand, by SRDF and scene: groups, named states, pairs that are
left out.

The rules are those of docs/scene.md, written a second time: a joint that the wrong one of two rules moves would make a
proof one of another robot.
"""

from __future__ import annotations

import re
from typing import Any

from .balls import need
from .robot import Tree, upward
from .text import attributes, children, number, strict_xml

GRIPPER = re.compile("finger|gripper|knuckle|thumb", re.IGNORECASE)  # joints of a hand: held
ARM_GROUP = re.compile(r"(^|_)arm$|^manipulator$")  # the SRDF's group that moves, where it has several
PAIRS = ("disable_collisions", "enable_collisions")
WORDS = {  # of an SRDF: what each holds, and its attributes
    "group": ("link joint chain group passive_joint", "name"),
    "group_state": ("joint", "name group"),
    "end_effector": ("", "name parent_link group parent_group"),
    "virtual_joint": ("", "name type parent_frame child_link"),
    "passive_joint": ("", "name"),
    "disable_collisions": ("", "link1 link2 reason"),
    "enable_collisions": ("", "link1 link2 reason"),
    "disable_default_collisions": ("", "link"),
    "link": ("", "name"),
    "joint": ("", "name value"),
    "chain": ("", "base_link tip_link"),
}
HARMLESS = "gripper handle rotor_params specificities link_sphere_approximation joint_property"


class Semantics:
    """An SRDF, read beside the tree of links: `above` has for each link but the root (joint, link above)."""

    def __init__(self, data: bytes, above: dict[str, tuple[str, str]], links: list[str]) -> None:
        root = strict_xml(data)
        need(root.tag == "robot", "SRDF: its root must be a robot")
        children(root, "SRDF", "", " ".join({*WORDS} - {"link", "joint", "chain"}), HARMLESS)
        for each in [y for x in root if x.tag in WORDS for y in (x, *x)]:
            holds, words = WORDS[each.tag]
            children(each, "SRDF", "", holds)
            attributes(each, "SRDF", words)
        self.above, self.links = above, links
        self._groups = {x.get("name", ""): x for x in root.findall("group")}
        need(len(self._groups) == len(root.findall("group")), "SRDF: two groups of one name")
        self.groups = {name: self._joints(name, ()) for name in self._groups}
        self.passive = {x.get("name", "") for x in root.findall("passive_joint")}
        self.hands = [x.get("parent_link", "") for x in root.findall("end_effector")]  # the links that carry them
        self._states: dict[str, dict[str, dict[str, float]]] = {}  # by name and group
        for state in root.findall("group_state"):
            of = state.get("name", ""), state.get("group", "")
            need(of[1] not in self._states.get(of[0], {}), f"SRDF: state '{of[0]}' appears twice")
            own = self._states.setdefault(of[0], {}).setdefault(of[1], {})
            for joint in state.findall("joint"):
                if len(joint.get("value", "").split()) < 2:  # others are of joints of another kind
                    what = f"SRDF: state '{of[0]}'"
                    need(joint.get("name", "") not in own, f"{what}: joint '{joint.get('name')}' appears twice")
                    own[joint.get("name", "")] = number(joint.get("value"), what)
        off = {x.get("link", "") for x in root.findall("disable_default_collisions")} & {*links}
        pairs = [{frozenset((x.get("link1", ""), x.get("link2", ""))) for x in root.findall(tag)} for tag in PAIRS]
        self.disabled = ({frozenset((a, b)) for a in off for b in links if a != b} - pairs[1]) | pairs[0]

    def group(self, requested: Any, robots: tuple[str, ...]) -> str:
        """The name of a group, which may have a robot's name before it (`panda_arm`: arm)."""
        names = (str(requested), *(str(requested).removeprefix(f"{x}_") for x in robots))
        name = next((x for x in names if x in self.groups), None)
        need(name is not None, f"robot.group: no group '{requested}'")
        return name or ""

    def states(self, group: str | None) -> dict[str, dict[str, float]]:
        """The values of each named state; of a joint that it has in several groups, this one's, or else the last."""
        ordered = {name: sorted(by.items(), key=lambda each: each[0] == group) for name, by in self._states.items()}
        return {name: {joint: x for _, own in by for joint, x in own.items()} for name, by in ordered.items()}

    def _joints(self, name: str, within: tuple[str, ...]) -> list[str]:
        need(name not in within and len(within) < 50, f"SRDF: group '{name}' contains itself")
        found = list[str]()
        for x in self._groups.get(name, ()):
            link = x.get("name", "")
            if x.tag == "joint":
                found.append(link)
            elif x.tag == "link" and link in self.above:
                found.append(self.above[link][0])
            elif x.tag == "chain" and {x.get("base_link"), x.get("tip_link")} <= {*self.links}:
                found += self._chain(x.get("tip_link"), x.get("base_link"))
            elif x.tag == "group":
                found += self._joints(link, (*within, name))
        return list(dict.fromkeys(found))

    def _chain(self, tip: str, base: str) -> list[str]:
        """The joints from base to tip, as MoveIt has them: down from where the two ways to the root meet, whose own
        joint is in it if the base is not above the tip."""
        one, two = ([joint for joint, _ in upward(self.above, link)] for link in (tip, base))
        shared = [x for x in one if x in two]
        down = [x for x in one if x not in shared]
        up_ = [x for x in two if x not in shared]
        meeting = shared[:1] if up_ else []
        return [*up_[::-1], *reversed([*down, *meeting])]


def moving(spec: dict[str, Any], tree: Tree, words: Semantics) -> tuple[list[str], str | None]:
    """The joints that a scene's robot section moves, in the order of the tree, and the SRDF's group of theirs."""
    joints, locked, rules = tree.movable, spec["locked"], tree.rules(tree.movable)
    leader = {x: y.mimic[0] for x, y in tree.joints.items() if y.mimic} | {x: rule[0] for x, rule in rules.items()}
    followed = {rule[0] for rule in rules.values()}
    rooms = {x: tree.room(x, rules) for x in joints if not tree.joints[x].mimic}
    candidates = [x for x, (low, high) in rooms.items() if (low < high or x not in followed) and x not in words.passive]
    group = spec.get("group")
    if isinstance(group, list):
        free = {*candidates} - {*locked}
        need({*group} <= free and len({*group}) == len(group) > 0, "robot.group: a joint cannot move")
        return [x for x in joints if x in group], None
    groups = {name: [x for x in candidates if x in own] for name, own in words.groups.items()}
    if group is not None:
        name = words.group(group, (spec.get("name") or tree.stem, tree.name))
        planned = [x for x in groups[name] if x not in locked]
        need(planned, f"robot.group: '{group}' has no joint that moves")
        return planned, name
    movable = [x for x in joints if not tree.joints[x].mimic and x not in words.passive]
    hands = _hands(tree, movable, leader)
    candidates = [x for x in candidates if x not in hands]
    groups = {name: left for name, own in groups.items() if (left := [x for x in own if x not in hands])}
    arms, chosen = [x for x in groups if ARM_GROUP.search(x)] if len(groups) > 1 else list(groups), None
    if len(arms) == 1 and len(groups[arms[0]]) < len(candidates):
        chosen, candidates = arms[0], groups[arms[0]]
    candidates = [x for x in candidates if not GRIPPER.search(x)] or candidates
    planned = [x for x in candidates if x not in locked]
    need(planned, "robot: has no joint that moves")
    return planned, chosen


def _hands(tree: Tree, movable: list[str], leader: dict[str, str]) -> set[str]:
    """The joints that drive a hand: those with followers of which one has a finger's name, or none of which carries
    another joint of the arm."""
    followers = {x: [y for y in leader if leader[y] == x] for x in movable}
    arm = [x for x in movable if not followers[x] and not GRIPPER.search(x)]
    carrying = {y for x in arm for y in tree.way(x)}
    found = set()
    for x in movable:
        moved = [x, *followers[x]]
        if followers[x] and (any(map(GRIPPER.search, moved)) or not carrying & {y for y in moved if y in tree.movable}):
            found.add(x)
    return found


def held_at(joint: str, spec: dict[str, Any], tree: Tree, words: Semantics) -> float:
    """Value of a joint that does not move: where the scene says, or where it follows another one, or at the first
    named state's value, or as near to 0 as its limits allow."""
    if joint in spec["locked"]:
        return float(spec["locked"][joint])
    each = tree.joints[joint]
    if each.mimic and each.mimic[0] in tree.joints:
        other, factor, offset = each.mimic
        return float(factor * (held_at(other, spec, tree, words) if other in tree.movable else 0.0) + offset)
    at = next((x[joint] for x in words.states(None).values() if joint in x), 0.0)
    return at if each.kind == "continuous" else float(min(max(at, each.low), each.high))
