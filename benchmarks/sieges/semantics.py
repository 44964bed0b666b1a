"""Meaning of scenes: distances of configurations by hdplan, against the judge's own reading of the same files.

Each case also goes out and in again (scene, text, scene), is made in Python beside the file, and, as far as MoveIt's
messages can say it, is written in MoveIt's words and read from there.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.scenes.yaml_format.writer import scene_text
from sieges import judge, poses, scenes
from sieges.campaign import Outcome
from sieges.certificate import excused
from sieges.world import World

SAME = 2e-6  # [m], and as much for each metre away from the origin: the certificate takes away what rounding may cost
TURNED = 1e-4  # the same downwards, where the directions that coal finds for curved bodies are rough


def attack(rng: np.random.Generator, folder: Path) -> Outcome:
    """Read one scene in every way and compare."""
    content, motion, _ = scenes.random_case(rng, folder)
    try:
        scene = load_scene(folder / "scene.yaml")
        found = _distances(scene, folder, motion)
    except InputError:
        return Outcome("refused")
    wrong = found or _again(scene, folder) or _as_moveit(rng, content, folder, motion)
    return Outcome("different" if wrong else "the same", wrong)


def _distances(scene: Any, folder: Path, motion: Any) -> str:
    """Compare the closest places and the contacts of the motion's first rows; return what differs."""
    robot = load_scene_robot(scene)
    certifier = Certifier(Setup.of(scene, robot))
    world = World(folder / "scene.yaml", motion.names)
    leave = excused(world, robot, motion.names)
    world.pairs = [pair for pair in world.pairs if pair not in leave]
    order = [motion.names.index(name) for name in robot.joint_names]
    for k, q in enumerate(motion.positions[:3] if world.bodies else ()):
        time = 0.0 if motion.times is None else float(motion.times[k])
        wrong = _compare(certifier, world, motion.names, q, q[order], time)
        if wrong:
            return f"row {k}: {wrong}"
    return ""


def _compare(certifier: Any, world: World, names: tuple[str, ...], q: Array, planned: Array, time: float) -> str:
    places = world.places(names, q[None], np.array([time]))
    own = [pair for pair in world.pairs if pair[1] < world.robot_count]
    outer = [pair for pair in world.pairs if pair[1] >= world.robot_count]
    nearest = certifier.nearest(planned, time=time)
    contacts = {frozenset((each.link, each.other)) for each in certifier.contacts(planned, time)}
    every, count = world.pairs, len(world.bodies)
    extra = [(a, b) for a in range(world.robot_count) for b in range(a + 1, count)]
    for word, pairs, place in (("obstacles", outer, nearest[0]), ("links", own, nearest[1])):
        world.pairs = pairs
        if not pairs or (place is None and not any(each.high < 100.0 for each in _near(world, places, 100.0))):
            world.pairs = every
            continue
        if place is None:
            world.pairs = every
            return f"{word}: nothing near"
        within = {pair for pair, _ in judge.inside(world, places)}
        reach = 1.0 + float(np.abs(places[:, 0, :3, 3]).max()) + float(world.pieces.radius.max())
        near = _near(world, places, max(place.distance, 0.0) + TURNED * reach)
        world.pairs = every
        least = min(near, key=lambda each: each.high, default=None)
        if least is not None and place.distance > max(least.high, 0.0) + SAME * reach:
            other = f"the judge {least.high:.9g} m of {world.pair_name(least.pair)}"
            return f"{word}: nothing nearer than {place.distance:.9g} m, {other}"
        touching = within | {each.pair for each in near if each.high < -SAME * reach}
        seen = [pair for pair in touching if frozenset(world.bodies[k].name for k in pair) in contacts]
        if len(seen) < len(touching):
            missed = world.pair_name(next(pair for pair in touching if pair not in seen))
            return f"{word}: contact of {missed} is not seen"
        world.pairs = [pair for pair in extra if world.pair_name(pair) in _both(place)]  # it may look at more pairs
        met = bool(touching) or bool(judge.inside(world, places, open_too=True))  # and take an open mesh for a solid
        near = _near(world, places, max(place.distance, 0.0) + TURNED * reach)
        world.pairs = every
        if not met and not any(each.low <= max(place.distance, 0.0) + TURNED * reach for each in near):
            return f"{word}: {place.distance:.9g} m of {_both(place)[0]}, the judge finds them farther apart"
    return ""


def _near(world: World, places: Array, within: float) -> list[judge.Nearest]:
    return judge.closest(world, places, np.array([0]), np.full(len(world.pairs), within))


def _both(place: Any) -> tuple[str, str]:
    return f"{place.link} and {place.other}", f"{place.other} and {place.link}"


def _again(scene: Any, folder: Path) -> str:
    """Write the scene, read it, and compare everything but its source."""
    text = scene_text(scene)
    (folder / "again.yaml").write_text(text)
    other = load_scene(folder / "again.yaml")
    for name in {field.name for field in dataclasses.fields(scene)} - {"name", "source", "notes"}:
        if _plain(getattr(scene, name)) != _plain(getattr(other, name)):
            return f"written and read again: {name} is another"
    if scene_text(other) != text:
        return "written, read and written again: another text"
    return ""


def _plain(value: Any) -> Any:
    """Return paths resolved, so that files are the same where their names are not."""
    if isinstance(value, Path):
        return value.resolve()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in dataclasses.fields(value) if field.compare]
        return type(value).__name__, [(name, _plain(getattr(value, name))) for name in names]
    if isinstance(value, tuple):
        return tuple(_plain(item) for item in value)
    return value


def _as_moveit(rng: np.random.Generator, content: dict[str, Any], folder: Path, motion: Any) -> str:
    """Write boxes, balls and cylinders of the scene in MoveIt's words; the closest must be as far as before."""
    known = {"box", "sphere", "cylinder"}
    things = [item for item in content["obstacles"] if item["shape"]["type"] in known and "motion" not in item]
    robot = content["robot"]
    held = [item for item in content.get("attached") or [] if item["shape"]["type"] in known]
    if not things or "urdf" not in robot or "limits" in content or "timing" in content:
        return ""
    scenes.write(folder / "robot.yaml", {"robot": robot})
    state: dict[str, Any] = {"joint_state": {"name": list(motion.names), "position": motion.positions[0].tolist()}}
    state["attached_collision_objects"] = [
        {"link_name": item["link"], "object": thing, "touch_links": item.get("touch_links") or []}
        for item, thing in ((item, {**_message(rng, item), "header": {"frame_id": item["link"]}}) for item in held)
    ]
    messages = [_message(rng, item) for item in things]
    world = {"collision_objects": messages}
    scenes.write(folder / "moveit.yaml", {"name": "", "robot_model_name": "arm", "robot_state": state, "world": world})
    goal = [{"joint_name": n, "position": v} for n, v in zip(motion.names, motion.positions[-1].tolist(), strict=True)]
    request = {"group_name": "", "start_state": state, "goal_constraints": [{"joint_constraints": goal}]}
    scenes.write(folder / "request.yaml", request)
    found = []
    content = {**content, "obstacles": things, "attached": held, "planner": {}, "self_collision": True}
    scenes.write(folder / "plain.yaml", content)
    for files in (["plain.yaml"], ["moveit.yaml", "request.yaml", "robot.yaml"]):
        scene = load_scene(*(folder / file for file in files))
        arm = load_scene_robot(scene)
        order = [motion.names.index(name) for name in arm.joint_names]
        places = Certifier(Setup.of(scene, arm)).nearest(motion.positions[0][order])
        found.append([("nothing", 0.0) if near is None else (near.other, near.distance) for near in places])
    for (one, here), (other, there) in zip(*found, strict=True):
        if (one == "nothing") != (other == "nothing") or abs(here - there) > 1e-6 * (1.0 + abs(here)):
            return f"in MoveIt's words {other} at {there:.9g} m, in hdplan's {one} at {here:.9g} m"
    return ""


def _message(rng: np.random.Generator, item: dict[str, Any]) -> dict[str, Any]:
    """Return a collision object; its place is split at random between the object's pose and the primitive's."""
    shape, whole = item["shape"], poses.of_scene(item.get("pose"))
    outer = poses.from_rpy(rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3))
    inner = np.linalg.inv(outer) @ whole
    length, radius = shape.get("length"), shape.get("radius")
    sizes = {"box": shape.get("size"), "sphere": [radius], "cylinder": [length, radius]}[shape["type"]]
    return {
        "id": item["name"],
        "pose": _pose(outer),
        "primitives": [{"type": shape["type"], "dimensions": sizes}],
        "primitive_poses": [_pose(inner)],
    }


def _pose(matrix: Array) -> dict[str, Any]:
    return {"position": matrix[:3, 3].tolist(), "orientation": poses.quaternion_of(matrix[:3, :3])}
