"""The joints of a robot in a scene: which move, lead and follow, where the others stand, and where that puts the
links."""

from __future__ import annotations

import functools
import json
from typing import Any

from . import scene as scenes
from .balls import Pose, compose, need
from .robot import Tree, placed
from .semantics import Semantics, held_at, moving
from .text import mapping

LIMIT_ROOM = 0.1  # [rad or m] by which held joints, a named state or a request may be beyond limits, as URDFs differ


@functools.lru_cache(maxsize=16)
def links_at(tree: Tree, base: str, moving: tuple[str, ...], held: tuple[tuple[str, float], ...]) -> tuple[Any, Any]:
    """Joints as `placed`, with a base's pose in JSON; known for a motion through the same robot."""
    pose = scenes.pose_of(json.loads(base), "robot.base")
    return placed(tree, pose, {x: i for i, x in enumerate(moving)}, dict(held))


@functools.lru_cache(maxsize=16)
def shapes_at(tree: Tree, base: str, moving: tuple[str, ...], held: tuple[tuple[str, float], ...]) -> list[Any]:
    """The shapes of all links, by link: its number there, where it is, and what the description says of it."""
    at, _ = links_at(tree, base, moving, held)
    return [
        (link, i, {"joint": at[link][0], **scenes.frame(compose(at[link][1], own))}, kind, sizes)
        for link in sorted(tree.elements)
        for i, (own, kind, sizes) in enumerate(tree.shapes(link))
    ]


class Joints:
    """A robot's joints, as its files and a scene's `robot` and `start` have them."""

    def __init__(self, spec: dict[str, Any], start: Any, tree: Tree, semantics: Semantics) -> None:
        """Choose them."""
        self.spec, self.tree, self.semantics = spec, tree, semantics
        self.movable = tree.movable
        spec = dict(spec)
        named = mapping(start, "start", "joints state velocity acceleration").get("joints")
        locked = {x: scenes.one(y, f"robot.locked.{x}") for x, y in (spec.get("locked") or {}).items()}
        need({*locked} <= {*tree.movable}, "robot.locked: names an unknown joint")
        spec["locked"] = locked
        planned, self.group = moving(spec, tree, semantics)
        if spec.get("base_joints") is not None:
            planned += [x for x in ("base_x", "base_y", "base_yaw") if x not in planned and x not in locked]
        rules = {x: rule for x, rule in tree.rules(tree.movable).items() if rule[0] in planned and rule[1]}
        need(not {*locked} & {*rules}, "robot.locked: holds a joint that follows one that moves")
        self.moving = [x for x in tree.movable if x in planned or x in rules]
        self.rules = rules
        self.lead = [x for x in self.moving if x not in rules]
        resting = [x for x in tree.movable if x not in self.moving]
        if isinstance(named, dict):  # values of the start hold joints that do not move
            spec["locked"] = {x: scenes.one(y, f"start: '{x}'") for x, y in named.items() if x in resting} | locked
        self.held = {x: held_at(x, spec, tree, semantics) for x in resting}
        for x, at in self.held.items():
            near = tree.joints[x].low - LIMIT_ROOM <= at <= tree.joints[x].high + LIMIT_ROOM
            need(near, f"joint '{x}' is held at {at:g}, more than {LIMIT_ROOM} beyond its limits")
        where = tree, json.dumps(spec.get("base")), (*self.moving,), (*self.held.items(),)
        (self.at, self.frames), self.shapes = links_at(*where), shapes_at(*where)

    def listed(self) -> list[Any]:
        """The joints that move, as a world has them."""
        found = []
        for name in self.moving:
            joint, (parent, pose) = self.tree.joints[name], self.frames[name]
            placed = scenes.frame(pose)
            placed["off"] = max(placed["off"], float(joint.axis.rad.max()))
            kind = "prismatic" if joint.kind == "prismatic" else "revolute"
            follows = self.rules.get(name)
            rule = None if follows is None else [self.moving.index(follows[0]), follows[1], follows[2]]
            along = {"axis": joint.axis.mid.tolist()}
            found.append({"name": name, "parent": parent, "kind": kind, **placed, **along, "follows": rule})
        return found

    def everywhere(self, lead: dict[str, float]) -> dict[str, float]:
        """The values of all joints, by those of the ones that lead."""
        found = {**self.held, **lead}
        return found | {x: factor * found[leader] + add for x, (leader, factor, add) in self.rules.items()}

    def standing(self, lead: dict[str, float]) -> tuple[dict[str, tuple[int, Pose]], list[Any]]:
        """Placements of all links in the world, and their shapes, by the values of the joints that lead."""
        where = self.tree, json.dumps(self.spec.get("base")), (), (*self.everywhere(lead).items(),)
        return links_at(*where)[0], shapes_at(*where)

    def place(self, link: str) -> dict[str, Any]:
        """The joint that carries a link, and its frame there."""
        joint, pose = self.at[link]
        return {"joint": joint, **scenes.frame(pose)}
