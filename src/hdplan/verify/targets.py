"""Start and goal: configurations and poses, as a world has them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from . import scene as scenes
from .balls import need
from .joints import Joints
from .other_robot import NotClaimedError, OtherRobot
from .text import listing, mapping, values


class Targets:
    """Reads the targets of a robot, which may be about objects that it moves, too; those of a request may name joints
    that the robot does not have."""

    def __init__(self, joints: Joints | OtherRobot, from_request: bool, moved: Collection[str] = ()) -> None:
        self.joints, self.from_request, self.moved = joints, from_request, moved

    def target(self, value: Any, end: str) -> dict[str, Any]:
        """A configuration as a world has it."""
        section = mapping(value, end, "joints state velocity acceleration")
        names = [x for x in ("velocity", "acceleration") if x in section]
        rates: dict[str, Any] = {x: self.rates(section.pop(x), f"{end}.{x}") for x in names}
        need("velocity" in rates or not rates, f"{end}: an acceleration without a velocity")
        return {**self.place(section, end), **rates}

    def rates(self, value: Any, what: str) -> list[float]:
        """Rates of the leading joints; those that are not named are 0."""
        joints = self.joints
        need(isinstance(value, (list, dict)) and len(value) > 0, f"{what}: numbers are expected")
        if isinstance(value, list):
            return [float(x) for x in values(value, len(joints.lead), what)]
        given = {x: scenes.one(y, f"{what}: '{x}'") for x, y in value.items()}
        need({*given} <= {*joints.movable} or self.from_request, f"{what}: names an unknown joint")
        for name, x in given.items():
            if name in joints.rules:
                leader, factor, _ = joints.rules[name]
                need(abs(x - factor * given.get(leader, 0.0)) <= 1e-6, f"{what}: '{name}' follows otherwise")
            need(name not in joints.held or x == 0, f"{what}: '{name}' is held, and is to move")
        return [given.get(x, 0.0) for x in joints.lead]

    def place(self, section: dict[str, Any], end: str) -> dict[str, Any]:
        """Values of the joints of a configuration."""
        joints = self.joints
        need(len(section) == 1, f"{end}: joints or a state")
        if "state" in section:
            states = joints.semantics.states(joints.group)
            need(section["state"] in states, f"{end}: no state '{section['state']}'")
            named: Any = {x: y for x, y in states[section["state"]].items() if x in joints.movable}
        else:
            named = section["joints"]
        if isinstance(named, list):
            return {"joints": values(named, len(joints.lead), end).tolist(), "others": {}}
        given = {x: scenes.one(y, f"{end}: '{x}'") for x, y in named.items()}
        need({*given} <= {*joints.movable} or self.from_request, f"{end}: names an unknown joint")
        need({*joints.lead} <= {*given}, f"{end}: names not every joint that moves")
        placed = joints.spec.get("locked") or {} if "state" in section else {}  # which says where they stand
        others = {x: y for x, y in given.items() if (x in joints.held or x in joints.rules) and x not in placed}
        return {"joints": [given[x] for x in joints.lead], "others": dict(sorted(others.items()))}

    def goals(self, value: Any) -> list[Any]:
        """The goal's targets, one of which is to be met; a tuple has poses that are worked out already."""
        if type(value) is tuple:
            need(all(self.known(x["link"]) for x in value), "goal: a link that there is not")
            return [{"poses": list(value)}]
        section = mapping(value, "goal", "joints state pose poses all any velocity acceleration")
        if {"velocity", "acceleration"} & {*section}:
            several = any(isinstance(x, (list, dict)) for x in section.get("joints", {}))
            need({"joints", "state"} & {*section} and not several, "goal: a velocity at a goal that leaves a choice")
            return [self.target(section, "goal")]
        need(len(section) == 1, "goal: one of joints, state, pose, poses, all, any")
        if "pose" in section:
            return [{"poses": [self.pose(section["pose"])]}]
        if "poses" in section:
            return [{"poses": [self.pose(x)]} for x in listing(section["poses"], "goal.poses")]
        if "all" in section:
            each = [mapping(x, "goal.all", "pose").get("pose") for x in listing(section["all"], "goal.all")]
            return [{"poses": [self.pose(x) for x in each]}]
        if "any" in section:
            return [
                {"poses": [self.pose(x["pose"])]} if "pose" in mapping(x, "goal.any", "joints state pose")
                else self.place(mapping(x, "goal.any", "joints state"), "goal")
                for x in listing(section["any"], "goal.any")
            ]  # fmt: skip
        values_ = section.get("joints")
        if isinstance(values_, list) and any(isinstance(x, (list, dict)) for x in values_):
            return [self.target({"joints": x}, "goal") for x in values_]
        return [self.target(section, "goal")]

    def pose(self, value: Any) -> dict[str, Any]:
        """A goal pose."""
        section = scenes.pose_goal(value, "goal", self.end_effector)
        link = section["link"]
        need(self.known(link), f"goal: no link '{link}', and nothing of this name is held and moves")
        return section

    def known(self, link: str) -> bool:
        """True for a link, and for a held object that moves."""
        return link in self.joints.at or link in self.moved

    def end_effector(self) -> str:
        """The link that a goal is about where it names none: the one of all that every leading joint moves that carries
        the SRDF's end effector, or else the last one of the group's chain, or of the joints that move."""
        joints, lead = self.joints, {*self.joints.lead}
        if isinstance(joints, OtherRobot):
            raise NotClaimedError
        tree = joints.tree
        ways = {x: [y for y in tree.way(x) if y in joints.moving] for x in joints.moving}
        last = [x for x, way in ways.items() if {joints.rules.get(y, (y,))[0] for y in way} == lead]
        carrier = {link: joints.moving[at[0]] if at[0] >= 0 else None for link, at in joints.at.items()}
        hands = sorted({link for link in joints.semantics.hands if carrier.get(link) in last})
        if last and not hands:
            groups = [{*own} for own in joints.semantics.groups.values()]
            whole = [own for own in groups if lead <= own and not own & {*joints.held}]
            behind = [x for x in tree.order if carrier[tree.joints[x].child] == last[0]]
            fixed = [x for x in behind if tree.joints[x].kind == "fixed" and whole and x in whole[0]]
            hands = [tree.joints[fixed[-1] if fixed else last[0]].child]
        need(len(hands) == 1, "goal: names no link, and the robot has no one end effector")
        return str(hands[0])

    def beyond(self, top: dict[str, Any]) -> dict[str, list[float]]:
        """Values of a named state, or of a request, which may lie a little beyond the limits of joints that nothing
        follows."""
        ends = [top[x] for x in ("start", "goal")]
        ends = [x for x in ends if "state" in x or self.from_request]
        found = dict[str, list[float]]()
        for each in ends:
            section = {x: each[x] for x in ("joints", "state") if x in each}
            values = section.get("joints", [])
            if not section or (isinstance(values, list) and any(isinstance(x, (list, dict)) for x in values)):
                continue
            for name, x in zip(self.joints.lead, self.target(section, "an end")["joints"], strict=True):
                if name not in [rule[0] for rule in self.joints.rules.values()]:
                    found.setdefault(name, []).append(x)
        return found
