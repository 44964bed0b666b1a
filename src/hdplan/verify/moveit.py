"""A planning scene of MoveIt's with its motion plan request, as the sections of a scene.

What is worked out already stands in the sections as a tuple, which no file can hold.
"""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np

from . import scene as scenes
from .balls import HERE, Pose, compose, need
from .constraints import goal_of, path_of
from .joints import links_at
from .messages import Frames, fields, filled, number, numbers, pose, same, solids, words
from .robot import Tree
from .semantics import Semantics
from .text import listing

PRESCRIBED = re.compile(r"pilz|\b(lin|circ|ptp)\b", re.IGNORECASE)  # planners of one shape of motion
MAP = "<octomap>"  # MoveIt's name of it
ACCELERATION = 1.0  # [rad/s^2 or m/s^2] of which a request asks for a share


def sections(scene: Any, request: Any, spec: dict[str, Any], tree: Tree, semantics: Semantics) -> dict[str, Any]:
    """The sections of a scene that the two messages mean, for the robot of a `robot` section."""
    at, _ = links_at(tree, json.dumps(spec.get("base")), (*tree.movable,), ())
    found = sections_around(scene, request, spec, at, {*tree.joints}, tree.solid)
    plan_request = fields(request, "MotionPlanRequest", "request")
    spec = dict(spec, group=_group(plan_request.get("group_name", ""), spec, tree, semantics))
    model, stated, _ = found["matrix"]
    if model in ("", spec.get("name") or tree.stem, tree.name):  # of another robot the links have other shapes
        left = [{*x} for x in listing(spec.get("ignore_pairs"), "robot.ignore_pairs")]
        more = [x for x in stated if {*x} not in left]
        spec["check_pairs"] = [*listing(spec.get("check_pairs"), "robot.check_pairs"), *more]
        found["matrix"] = "", *found["matrix"][1:]
    return {**found, "robot": spec, "limits": _limits(plan_request, tree, "velocity" in found["start"])}


def sections_around(
    scene: Any, request: Any, spec: dict[str, Any], at: dict[str, tuple[int, Pose]], joints: set[str], solid: set[str]
) -> dict[str, Any]:
    """Sections that need no more of the robot than where its links are, which have collision geometry, and the
    names of its joints; `matrix` has the robot's name, and the pairs of links that the allowed collision matrix tells
    to compare, and those of which it says nothing, which MoveIt compares, too."""
    around, plan_request = fields(scene, "PlanningScene", "scene"), fields(request, "MotionPlanRequest", "request")
    for key in ("pipeline_id", "planner_id"):
        prescribed = PRESCRIBED.search(str(plan_request.get(key, "")))
        need(not prescribed, f"request.{key}: prescribes the shape of the motion")
    bounded = filled(plan_request.get("workspace_parameters")) and spec.get("base_joints") is not None
    need(not bounded, "request.workspace_parameters: bounds the mobile base, as robot.base_joints do")
    base = scenes.pose_of(spec.get("base"), "robot.base")
    frames = Frames(at, joints, around.get("fixed_frame_transforms"))
    margin = _margin(around, {*at}, solid)
    states = (around.get("robot_state"), "scene.robot_state"), (plan_request.get("start_state"), "request.start_state")
    start, speeds, held = dict[str, float](), dict[str, float](), dict[str, Any]()
    for state, what in states:
        placed_at, rates = _state(state, frames, base, what)
        start, speeds = start | placed_at, speeds | rates
        held |= _held(state, what)
    moves = any(speeds.values())
    frames.things |= {*held}
    standing = _standing(around.get("world"), frames)
    names = [x["name"] for x in [*standing, *(y for each in held.values() for y in each)]]
    need(len({*names}) == len(names), "scene: the name of an object is taken")
    need(start, "request.start_state: there is no start")
    model = around.get("robot_model_name", "")
    need(type(model) is str, "scene.robot_model_name: a name is expected")
    return {
        "matrix": (model, *_compared(around.get("allowed_collision_matrix"), solid)),
        "obstacles": [{**x, "clearance": margin} if margin else x for x in standing],
        "attached": [x for each in held.values() for x in each],
        "start": {"joints": start, **({"velocity": speeds} if moves else {})},
        "goal": goal_of(plan_request.get("goal_constraints"), frames),
        "from_request": True,
        "limits": _limits(plan_request, None, moves),
        "path": path_of(plan_request.get("path_constraints"), frames),
    }


def _group(requested: Any, spec: dict[str, Any], tree: Tree, semantics: Semantics) -> Any:
    """The group that is planned: the request's, if the SRDF has any."""
    own = spec.get("group")
    if requested == "" or not semantics.groups:
        return own
    name = semantics.group(scenes.word(requested, "request.group_name"), (spec.get("name") or tree.stem, tree.name))
    mine = semantics.group(own, (spec.get("name") or tree.stem, tree.name)) if type(own) is str else own
    need(mine in (None, name), f"request.group_name: '{name}' is not that of the robot's own section")
    return name


def _limits(plan_request: dict[str, Any], tree: Tree | None, moves: bool) -> dict[str, Any]:
    """The limits that the scaling factors mean, of which 0 is one that is not set; a robot that `moves` has some."""
    keys = [f"max_{x}_scaling_factor" for x in ("velocity", "acceleration")]
    slower, softer = (number(plan_request.get(x, 0.0), f"request.{x}", 0.0, 1.0) or 1.0 for x in keys)
    if slower == softer == 1 and not moves:
        return {}
    if tree is None:  # of a robot whose limits are not read
        return {"velocity": "urdf", "acceleration": softer * ACCELERATION}
    rules, most = tree.rules(tree.movable), dict[str, float]()
    for name in tree.movable:
        (leader, factor, _), own = rules.get(name, (name, 1.0, 0.0)), tree.joints[name].velocity
        if own > 0 and factor:  # what follows is within its own limit, too
            most[leader] = min(most.get(leader, np.inf), slower * own / abs(factor))
    return {"velocity": most or "urdf", "acceleration": softer * ACCELERATION}


# --- what stands around, and what is held ---


def _standing(value: Any, frames: Frames) -> list[dict[str, Any]]:
    """Obstacles, as a scene lists them."""
    section = fields({} if value is None else value, "PlanningSceneWorld", "world")
    found = []
    for i, entry in enumerate(listing(section.get("collision_objects"), "world.collision_objects")):
        what = f"world.collision_objects[{i}]"
        place = frames.of(fields(entry, "CollisionObject", what).get("header"), what)
        found += (own := _bodies(entry, place, f"obstacle{i}", what))
        frames.things.add(own[0]["name"])
    octomap = fields(section.get("octomap", {}), "OctomapWithPose", "octomap")
    content = fields(octomap.get("octomap", {}), "Octomap", "octomap")
    if content.get("data"):
        place = frames.of(octomap.get("header"), "octomap")
        own = fields(content.get("header", {}), "Header", "octomap").get("frame_id", "")
        need(own == "" or same(frames.of(content["header"], "octomap"), place), "octomap: is in two frames")
        found.append({"name": MAP, "octomap": "", "pose": compose(place, pose(octomap.get("origin"), "octomap"))})
    return found


def _bodies(value: Any, place: Pose, usual: str, what: str) -> list[dict[str, Any]]:
    """The primitives of an object, by its name, the others than the first with their numbers."""
    section = fields(value, "CollisionObject", what)
    operation = section.get("operation", 0)
    need(type(operation) is int and operation == 0, f"{what}.operation: is not 0 (ADD)")
    name = usual if section.get("id", "") == "" else scenes.word(section["id"], what)
    place = compose(place, pose(section.get("pose"), what))
    shapes = solids(section, what)
    need(shapes, f"{what}: has no shape")
    names = [f"{name}/{i}" if i else name for i in range(len(shapes))]
    return [{"name": x, "shape": y, "pose": compose(place, z)} for x, (y, z) in zip(names, shapes, strict=True)]


def _margin(around: dict[str, Any], links: set[str], solid: set[str]) -> float:
    """The clearance to every obstacle that paddings of links mean, the same for all with collision geometry."""
    for entry in listing(around.get("link_scale"), "link_scale"):
        section = fields(entry, "LinkScale", "link_scale")
        need(number(section.get("scale"), "link_scale") == 1 and "link_name" in section, "link_scale: is not 1")
    found = dict[str, float]()
    for entry in listing(around.get("link_padding"), "link_padding"):
        section = fields(entry, "LinkPadding", "link_padding")
        link = scenes.word(section.get("link_name"), "link_padding")
        size = number(section.get("padding"), f"link_padding of '{link}'", 0.0, 1.0)
        need(found.setdefault(link, size) == size, f"link_padding: '{link}' has two")
        need(link in links or not size, f"link_padding: there is no link '{link}'")
    sizes = {found.get(link, 0.0) for link in solid}
    need(len(sizes) < 2, "link_padding: is not the same for all links with collision geometry")
    return max(sizes, default=0.0)


def _held(state: Any, where: str) -> dict[str, list[dict[str, Any]]]:
    """Held objects, by name."""
    section = fields({} if state is None else state, "RobotState", where)
    found = dict[str, Any]()
    for i, entry in enumerate(listing(section.get("attached_collision_objects"), where)):
        what = f"{where.partition('.')[2]}.attached_collision_objects[{i}]"
        own = fields(entry, "AttachedCollisionObject", what)
        link, thing = scenes.word(own.get("link_name"), what), fields(own.get("object"), "CollisionObject", what)
        frame = fields(thing.get("header", {}), "Header", what).get("frame_id")
        need(frame == link, f"{what}: is not given in the frame of its link")
        near = words(own.get("touch_links"), what)
        parts = [{**x, "link": link, "touch_links": near} for x in _bodies(thing, HERE, what, what)]
        need(parts[0]["name"] not in found, f"{what}: its name is taken")
        found[parts[0]["name"]] = parts
    return found


def _state(state: Any, frames: Frames, base: Pose, what: str) -> tuple[dict[str, float], dict[str, float]]:
    """The values and the velocities of the joints of a robot that stands at its base, or at the world's origin."""
    section = fields({} if state is None else state, "RobotState", what)
    need(type(section.get("is_diff", False)) is bool, f"{what}.is_diff: true or false is expected")
    floating = fields(section.get("multi_dof_joint_state", {}), "MultiDOFJointState", what)
    fields(floating.get("header", {}), "Header", what)
    for entry in listing(floating.get("transforms"), what):
        place = compose(frames.of(floating.get("header"), what), pose(entry, what, "Transform"))
        need(same(place, HERE) or same(place, base), f"{what}: moves the robot's base")
    joints = fields(section.get("joint_state", {}), "JointState", what)
    fields(joints.get("header", {}), "Header", what)
    names, at = words(joints.get("name"), what), numbers(joints.get("position"), None, what)
    need(len({*names}) == len(names) == len(at), f"{what}: a joint appears twice, or has no position")
    found, rates = dict(zip(names, at, strict=True)), numbers(joints.get("velocity"), None, what)
    need(len(rates) in (0, len(names)), f"{what}: velocities of other joints")
    frames.check_base(found, what)
    return found, dict(zip(names, rates or [0.0] * len(names), strict=True))


def _compared(value: Any, solid: set[str]) -> tuple[list[list[str]], list[list[str]]]:
    """The pairs of links that an allowed collision matrix tells to compare, by their entry, or else by their defaults;
    of two that differ, the one that compares counts. And the pairs of which it says nothing, if it says anything."""
    section = fields({} if value is None else value, "AllowedCollisionMatrix", "allowed_collision_matrix")
    entries, defaults = dict[frozenset[str], bool](), dict[str, bool]()
    names, rows = (listing(section.get(f"entry_{x}"), "allowed_collision_matrix") for x in ("names", "values"))
    need(len(names) == len(rows), "allowed_collision_matrix: has other rows than names")
    for name, row in zip(words(names, "entry_names"), rows, strict=True):
        cells = fields(row, "AllowedCollisionEntry", "entry_values").get("enabled") if isinstance(row, dict) else row
        for other, free in zip(names, _booleans(cells, len(names)), strict=True):
            pair = frozenset((name, other))
            entries[pair] = free and entries.get(pair, True)
    usual = words(section.get("default_entry_names"), "default_entry_names")
    for name, free in zip(usual, _booleans(section.get("default_entry_values"), len(usual)), strict=True):
        defaults[name] = free and defaults.get(name, True)
    stated, unstated = list[list[str]](), list[list[str]]()
    for one in sorted(solid):
        for two in [x for x in sorted(solid) if x > one]:
            given = [defaults[x] for x in (one, two) if x in defaults]
            may = entries.get(frozenset((one, two)), all(given) if given else None)
            stated += [[one, two]] * (may is False)
            unstated += [[one, two]] * (may is None and bool(entries or defaults))
    return stated, unstated


def _booleans(value: Any, count: int) -> list[bool]:
    found = listing(value, "allowed_collision_matrix")
    good = len(found) == count and all(type(x) is bool for x in found)
    need(good, f"allowed_collision_matrix: {count} entries, true or false, are expected")
    return found
