"""Hostile scenes around a motion: obstacles close to the arm, traps that only a solid's inside tells, moving things."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sieges import judge, meshes, motions, poses, rows
from sieges.arms import random_arm
from sieges.world import World

PANDA = {"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04}
ENDINGS = (".json", ".csv", ".npz")


def write(path: Path, content: dict[str, Any]) -> None:
    """Write a scene."""
    path.write_text(yaml.dump(content, Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True))


def random_case(rng: np.random.Generator, folder: Path) -> tuple[dict[str, Any], rows.Rows, str]:
    """Write scene.yaml, a motion and all that they name into a folder; return scene, motion and the motion's file."""
    content: dict[str, Any] = {"hdplan": 1, "robot": {}, "obstacles": []}
    own = rng.random() < 0.9
    if own:
        arm = random_arm(rng, folder)
        content["robot"] = {"urdf": "arm.urdf", "locked": arm.locked}
        links, planned = arm.links, arm.planned
    else:
        name = str(rng.choice(["panda", "ur5"]))
        content["robot"] = {"name": name, "locked": PANDA if name == "panda" else {}}
        links = ["panda_hand", "panda_link5"] if name == "panda" else ["wrist_3_link", "forearm_link"]
    if rng.random() < 0.4:
        place, turn = rng.uniform(-1, 1, 3).round(3), rng.choice([0.0, np.pi, np.pi / 2, 0.3], 3)
        content["robot"]["base"] = {"position": place.tolist(), "rpy": turn.tolist()}
    moving, limited = rng.random() < 0.2, rng.random() < 0.3
    write(folder / "scene.yaml", content)
    names = tuple(planned) if own else named_joints(folder, content)
    world = World(folder / "scene.yaml", names)
    motion = motions.random_rows(rng, world.machine, names, moving or limited)
    if rng.random() < 0.3:
        content["attached"] = [held(rng, folder, links)]
        write(folder / "scene.yaml", content)
        world = World(folder / "scene.yaml", names)
    if limited and rng.random() < 0.6:  # so that nothing but the limits decides
        content["self_collision"] = False
    elif world.bodies:
        content["obstacles"] = obstacles(rng, folder, world, motion, moving)
    if limited:
        content["limits"] = limits(rng, world, motion)
    if moving or (limited and "acceleration" not in content.get("limits", {})):
        duration = 1.0 if motion.times is None else float(np.ptp(motion.times))
        content["timing"] = {"duration": min(max(duration, 1e-3), 1e3)}
    if rng.random() < 0.15:
        content["path"] = constraints(rng, world, motion, links)
    if rng.random() < 0.2:
        content["planner"] = {"clearance": float(rng.choice([1e-4, 0.01, 0.05]))}
    if rng.random() < 0.15 and "self_collision" not in content:
        content["self_collision"] = bool(rng.random() < 0.5) or {"clearance": float(rng.choice([1e-4, 0.01]))}
    if "torque" in content.get("limits", {}) and rng.random() < 0.5:
        mass = float(rng.uniform(0.1, 3.0))
        content["payload"] = {"link": links[-1], "mass": mass, "com": rng.uniform(-0.1, 0.1, 3).round(4).tolist()}
    content["start"] = {"joints": dict(zip(names, motion.positions[0].tolist(), strict=True))}
    content["goal"] = {"joints": dict(zip(names, motion.positions[-1].tolist(), strict=True))}
    write(folder / "scene.yaml", content)
    file = "m" + str(rng.choice(ENDINGS))
    rows.write(folder / file, motion)
    return content, motion, file


def named_joints(folder: Path, content: dict[str, Any]) -> tuple[str, ...]:
    """Return the joints of a scene's robot by name, without its fingers."""
    write(folder / "scene.yaml", content)
    order = World(folder / "scene.yaml", ()).machine.order
    return tuple(joint.name for joint in order if joint.kind != "fixed" and "finger" not in joint.name)


def held(rng: np.random.Generator, folder: Path, links: list[str]) -> dict[str, Any]:
    """Return an object that a link holds; often a mesh."""
    link = links[-1] if rng.random() < 0.7 else links[int(rng.integers(len(links)))]
    shape = mesh(rng, folder, "held", float(rng.uniform(0.1, 0.3))) if rng.random() < 0.6 else solid(rng, 0.1)
    touch = [name for name in links if rng.random() < 0.4 and name != link]
    place = {"position": rng.uniform(-0.2, 0.2, 3).round(4).tolist(), "rpy": rng.uniform(-1, 1, 3).round(4).tolist()}
    return {"name": "held", "link": link, "shape": shape, "pose": place, "touch_links": touch}


def mesh(rng: np.random.Generator, folder: Path, name: str, size: float, kind: str | None = None) -> dict[str, Any]:
    """Write a hostile mesh and return its shape."""
    file = f"{name}.{rng.choice(['obj', 'stl', 'ply'])}"
    meshes.write(folder / file, meshes.hostile(kind or str(rng.choice(meshes.KINDS)), rng, 1.0))
    scale = [size] * 3 if rng.random() < 0.7 else (size * rng.uniform(0.5, 1.0, 3)).tolist()
    return {"type": "mesh", "file": file, "scale": scale}


def solid(rng: np.random.Generator, size: float) -> dict[str, Any]:
    """Return a shape without a file, about as large as `size` [m]."""
    half = float(size * rng.uniform(0.2, 0.6))
    match str(rng.choice(["box", "sphere", "cylinder", "capsule", "points"])):
        case "box":
            return {"type": "box", "size": (size * rng.uniform(0.2, 1.0, 3)).tolist()}
        case "sphere":
            return {"type": "sphere", "radius": half}
        case "cylinder":
            return {"type": "cylinder", "radius": half, "length": float(size * rng.uniform(0.1, 1.5))}
        case "capsule":
            return {"type": "capsule", "radius": half, "length": float(size * rng.choice([0.0, 0.5, 1.0]))}
        case _:
            return {"type": "points", "points": (size * rng.uniform(-0.6, 0.6, (int(rng.integers(5, 12)), 3))).tolist()}


def obstacles(
    rng: np.random.Generator, folder: Path, world: World, motion: rows.Rows, moving: bool
) -> list[dict[str, Any]]:
    """Return obstacles that the motion passes closely, or that hold it within them."""
    interval, s = motion.grid(32)
    places = world.places(motion.names, motion.at(interval, s), motion.when(interval, s))
    found = []
    for number in range(int(rng.choice([0, 1, 2, 3], p=[0.05, 0.5, 0.3, 0.15]))):
        name = f"thing{number}"
        body = int(rng.integers(len(world.bodies)))  # small ones as often as those of many triangles
        piece = int(rng.choice(np.flatnonzero(world.pieces.body == body)))
        time = int(rng.integers(places.shape[1]))
        place = places[world.pieces.body[piece], time]
        own = world.bodies[int(world.pieces.body[piece])].rows
        middle = np.mean([points.mean(axis=0) for points, *_ in own], axis=0)  # of the whole body
        centre = place[:3, :3] @ world.pieces.centre[piece] + place[:3, 3]
        size, trap = float(rng.uniform(0.03, 0.4)), rng.random()
        turn = rng.choice([0.0, np.pi / 2], 3) if rng.random() < 0.3 else rng.uniform(-3, 3, 3)
        if trap < 0.12:  # a thing within a body, or a solid or a shell around it
            centre = place[:3, :3] @ middle + place[:3, 3]
            shape = solid(rng, 0.02) if rng.random() < 0.5 else mesh(rng, folder, name, 0.02)
        elif trap < 0.25:
            kind = str(rng.choice(["star", "room", "ball", "inverted", "hollow", "open", "nested"]))
            shape = mesh(rng, folder, name, float(rng.choice([2.0, 6.0])), kind)
        else:
            shape = solid(rng, size) if rng.random() < 0.5 else mesh(rng, folder, name, size)
            way = rng.normal(size=3)
            away = world.pieces.radius[piece] * rng.uniform(0.5, 1.0) + 0.6 * size + rng.uniform(-0.02, 0.1)
            centre = centre + way / np.linalg.norm(way) * away
        entry: dict[str, Any] = {"name": name, "shape": shape}
        pose = {"position": centre.tolist(), "rpy": turn.tolist()}
        if moving and (number == 0 or rng.random() < 0.5):
            entry |= passage(rng, pose, float(motion.when(interval, s)[time]))
        else:
            entry["pose"] = pose
        if rng.random() < 0.15:
            entry["clearance"] = float(rng.choice([0.0, 1e-3, 0.02]))
        found.append(entry)
    return found


def passage(rng: np.random.Generator, pose: dict[str, Any], time: float) -> dict[str, Any]:
    """Return a motion that brings an obstacle to a pose at about a time."""
    if rng.random() < 0.5:
        velocity = rng.uniform(-0.5, 0.5, 3)
        start = np.array(pose["position"]) - velocity * min(time, 10.0)
        spin = rng.uniform(-2, 2, 3).tolist() if rng.random() < 0.6 else [0.0, 0.0, 0.0]
        return {"pose": {**pose, "position": start.tolist()}, "motion": {"velocity": velocity.tolist(), "spin": spin}}
    ways = rng.uniform(-0.5, 0.5, (3, 3)) + np.array(pose["position"])
    ways[1] = pose["position"]
    marks = max(0.0, time - 0.3) + np.cumsum(rng.uniform(0.1, 0.6, 3))
    stops = [{"position": way.tolist(), "rpy": rng.uniform(-1.5, 1.5, 3).tolist()} for way in ways]
    return {"motion": {"times": marks.tolist(), "poses": stops}}


def limits(rng: np.random.Generator, world: World, motion: rows.Rows) -> dict[str, Any]:
    """Return limits that the motion just keeps, or just breaks."""
    interval, s = motion.grid(128)
    found: dict[str, Any] = {}
    factors = [0.99, 1.0 - 1e-5, 1.0 + 1e-5, 1.05, 1.2, 2.0, 5.0, 20.0]
    for order, key in enumerate(("velocity", "acceleration", "jerk"), start=1):
        if rng.random() < 0.6:
            most = np.abs(motion.at(interval, s, order)).max(axis=0)
            found[key] = dict(zip(motion.names, (np.maximum(most, 1e-3) * rng.choice(factors)).tolist(), strict=True))
    if rng.random() < 0.4:
        q = motion.at(interval, s)
        slack = float(rng.choice([-1e-3, -1e-8, 0.0, 1e-3, 0.1]))
        spans = {}
        for name, low, high in zip(motion.names, q.min(axis=0) - slack, q.max(axis=0) + slack, strict=True):
            joint = world.machine.by_name[name]
            low, high = max(joint.low, float(low)), min(joint.high, float(high))
            if low < high and joint.kind != "continuous":
                spans[name] = [low, high]
        if spans:
            found["position"] = spans
    if rng.random() < 0.4 and motion.velocities is not None:
        moved = world.motion(motion, interval, s)
        most = np.abs(world.machine.torques(moved, world.masses(), world.planned)).max(axis=0)
        found["torque"] = dict(zip(world.planned, (np.maximum(most, 0.1) * rng.choice(factors)).tolist(), strict=True))
    if not found:
        found["velocity"] = "urdf"
    return found


def constraints(rng: np.random.Generator, world: World, motion: rows.Rows, links: list[str]) -> dict[str, Any]:
    """Return constraints of the whole way that the motion just keeps, or just breaks."""
    link = links[int(rng.integers(1, len(links)))]
    interval, s = motion.grid(128)
    frames = world.machine.frames(world.values(motion.names, motion.at(interval, s)), world.base)[link]
    if rng.random() < 0.5:
        axis = np.vstack([np.eye(3), -np.eye(3), [[0.0, 0.6, 0.8]]])[rng.integers(7)]
        tilt = float(judge.tilt(frames, axis).max()) * float(rng.choice([0.99, 1.0 - 1e-6, 1.0 + 1e-6, 1.05, 1.5]))
        return {"upright": {"link": link, "axis": axis.tolist(), "tolerance": float(np.clip(tilt, 1e-6, np.pi))}}
    point, turned = rng.uniform(-0.2, 0.2, 3), rng.uniform(-3, 3, 3)
    box = poses.from_rpy([0, 0, 0], turned)
    places = (frames @ [*point, 1.0])[:, :3] @ box[:3, :3]
    low, high = places.min(axis=0), places.max(axis=0)
    size = np.maximum(high - low, 1e-4) * rng.choice([0.99, 1.0 + 1e-5, 1.1])
    centre = box[:3, :3] @ (0.5 * (low + high))
    edges: list[float] = [float("inf") if rng.random() < 0.3 and k else float(size[k]) for k in range(3)]
    place = {"position": centre.tolist(), "rpy": turned.tolist()}
    return {"position": {"link": link, "size": edges, "point": point.tolist(), **place}}
