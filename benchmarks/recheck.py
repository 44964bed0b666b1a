"""Re-check a trajectory on a MotionBenchMaker problem by code that shares nothing with hdplan.

URDF and forward kinematics by the sieges' judge (`sieges.machine`, NumPy), own reading of MoveIt's scene and request,
meshes by trimesh, collisions by python-fcl, dense samples of the motion; in a cloud of points every ball against every
link, hulls by SciPy. It can refute a certificate, not give one.
"""

from __future__ import annotations

import itertools
import json
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import fcl
import numpy as np
import trimesh
import yaml
from scipy.spatial import ConvexHull, cKDTree
from sieges.machine import DATA, NAMED, SHARE, Joint, Machine
from sieges.poses import from_quaternion, from_rpy

from hdplan.scenes.array_types import Array

STEP = 0.005  # [rad] or [m], largest joint step between two samples
SAME_END = 1e-6  # [rad] or [m] between the trajectory's ends and the request's
WITHIN = 1e-9  # [rad] or [m] of a limit, that is rounding; a request's own end may lie farther beyond, and only there


@dataclass(frozen=True)
class Solid:
    """A collision body."""

    name: str  # link or obstacle
    shape: Any  # FCL's
    pose: Array  # (4, 4) in the link's frame, or in the world
    center: Array  # (3,) of a ball around it, in its own frame
    radius: float  # [m] of that ball
    mesh: Any = None  # trimesh's, in its own frame, of a link that is one


@dataclass(frozen=True, eq=False)
class Moved:
    """A robot at dense samples of a motion that was planned for a request."""

    machine: Machine
    links: list[Solid]
    frames: dict[str, Array]  # of each link (T, 4, 4) in the world
    times: Array  # (T,) in [0, 1]
    request: dict[str, Any]
    start: dict[str, float]
    srdf: Path
    ignored: list[list[str]]  # pairs of links

    @classmethod
    def of(cls, motion: dict[str, Any], request: Path, robot: Path) -> Moved:
        """Read a motion's content, a request and a robot's section."""
        wanted, section = _yaml(request), _yaml(robot)["robot"]
        files = (section["urdf"], section["srdf"]) if "urdf" in section else NAMED[section["name"]]
        urdf, srdf = ((robot.parent if "urdf" in section else DATA) / file for file in files)
        base, state = section.get("base", {}), wanted["start_state"]["joint_state"]
        machine, start = Machine(urdf), dict(zip(state["name"], _floats(state["position"]), strict=True))
        samples, times = _dense(np.array(motion["positions"], dtype=np.float64))
        values = {joint.name: np.full(len(samples), start.get(joint.name, 0.0)) for joint in machine.joints}
        values |= {name: samples[:, i] for i, name in enumerate(motion["joint_names"])}
        frames = machine.frames(values, from_rpy(base.get("position", [0, 0, 0]), base.get("rpy", [0, 0, 0])))
        links = [_link_solid(*each, urdf) for each in machine.collisions]
        ignored = section.get("ignore_pairs", [])
        return cls(machine, links, frames, times, wanted, start, srdf, ignored)


def recheck(trajectory: Path, scene: Path, request: Path, robot: Path) -> str:
    """Return the faults and the first contact that are found, empty for none."""
    content = json.loads(trajectory.read_text())
    motion = Moved.of(content, request, robot)
    wanted, values, times = motion.request, motion.start, motion.times
    goal = {c["joint_name"]: float(c["position"]) for c in wanted["goal_constraints"][0]["joint_constraints"]}
    names, waypoints = content["joint_names"], np.array(content["positions"], dtype=np.float64)

    faults = []
    for word, row, end in (("start", waypoints[0], values), ("goal", waypoints[-1], goal)):
        faults += [
            f"{word}: {name}" for name, value in zip(names, row, strict=True) if abs(value - end[name]) > SAME_END
        ]
    for joint in motion.machine.joints:
        if joint.name in names and joint.kind != "continuous":
            column = waypoints[:, names.index(joint.name)]
            ends = values[joint.name], goal.get(joint.name, column[-1])
            low, high = (np.full(len(column), limit) for limit in (joint.low, joint.high))
            low[[0, -1]], high[[0, -1]] = np.minimum(low[0], ends), np.maximum(high[0], ends)
            if np.any((column < low - WITHIN) | (column > high + WITHIN)):
                faults.append(f"limits: {joint.name}")

    links, obstacles = motion.links, _obstacles(_yaml(scene))
    pairs = [(a, b) for a in links for b in obstacles]
    apart = _kept_apart(motion.machine.joints, motion.srdf, motion.ignored)
    pairs += [(a, b) for a, b in itertools.combinations(links, 2) if a.name != b.name and not apart(a.name, b.name)]

    world = {id(o): np.broadcast_to(o.pose, (len(times), 4, 4)) for o in obstacles}
    world |= {id(link): motion.frames[link.name] @ link.pose for link in links}
    middle = {id(each): world[id(each)][:, :3] @ np.append(each.center, 1.0) for each in (*obstacles, *links)}
    for a, b in pairs:
        between = np.linalg.norm(middle[id(a)] - middle[id(b)], axis=1) - a.radius - b.radius
        for t in np.flatnonzero(between <= 0.0).tolist():
            if fcl.collide(_placed(a, world, t), _placed(b, world, t), fcl.CollisionRequest(), fcl.CollisionResult()):
                return "; ".join([*faults, f"{a.name} and {b.name} touch at {times[t]:.6g} of the motion"])
    return "; ".join(faults)


def touching(trajectory: Path, request: Path, robot: Path, points: Array, radius: float) -> dict[str, Any] | None:
    """Return the first contact found, of a link with the ball of a point (m, 3) in the world, or None."""
    motion = Moved.of(json.loads(trajectory.read_text()), request, robot)
    nearby, ball = cKDTree(points), fcl.Sphere(radius)
    for link in motion.links:
        placements = motion.frames[link.name] @ link.pose
        if np.ptp(placements, axis=0).max() < 1e-12:
            continue  # fixed to the world: it may stand on what is seen
        reach = link.radius + radius
        planes = None if link.mesh is None else ConvexHull(link.mesh.vertices).equations
        for t, pose in enumerate(placements):
            rows = nearby.query_ball_point(pose[:3] @ np.append(link.center, 1.0), reach)
            local = (points[rows] - pose[:3, 3]) @ pose[:3, :3]
            if planes is not None and len(local):  # the others are outside of the hull, by more than the radius
                local = local[(local @ planes[:, :3].T + planes[:, 3]).max(axis=1) <= radius]
            for point in local:
                bodies = fcl.CollisionObject(link.shape), fcl.CollisionObject(ball, fcl.Transform(point))
                hit = fcl.collide(*bodies, fcl.CollisionRequest(), fcl.CollisionResult())
                if hit or (link.mesh is not None and link.mesh.is_watertight and link.mesh.contains(point[None])[0]):
                    return {"link": link.name, "time": float(motion.times[t]), "point": point.tolist()}
    return None


def _placed(solid: Solid, world: dict[int, Array], t: int) -> Any:
    pose = world[id(solid)][t]
    return fcl.CollisionObject(solid.shape, fcl.Transform(pose[:3, :3], pose[:3, 3]))


def _dense(waypoints: Array) -> tuple[Array, Array]:
    """Return samples along the straight lines, no joint moving more than STEP between two, and times in [0, 1]."""
    where = [np.zeros(1)]
    for i, (a, b) in enumerate(itertools.pairwise(waypoints)):
        count = max(1, int(np.ceil(np.abs(b - a).max() / STEP)))
        where.append(i + np.arange(1, count + 1) / count)
    times = np.concatenate(where)
    index = np.minimum(times.astype(int), len(waypoints) - 2)
    part = (times - index)[:, None]
    return (1 - part) * waypoints[index] + part * waypoints[index + 1], times / (len(waypoints) - 1)


# --- robot ------------------------------------------------------------------------------------------------------------


def _link_solid(link: str, pose: Array, shape: ElementTree.Element, urdf: Path) -> Solid:
    if shape.tag == "mesh":
        name = shape.get("filename", "").removeprefix("package://")
        file = next(file for file in (urdf.parent / name, SHARE / name) if file.exists())
        return _mesh_solid(link, file, _floats(shape.get("scale", "1 1 1").split()), pose)
    size = _floats((shape.get("size") or "").split())
    numbers = size or [float(shape.get(key, 0)) for key in ("length", "radius") if shape.get(key)]
    return _primitive(link, shape.tag, numbers, pose)


def _mesh_solid(name: str, file: Path, scale: list[float], pose: Array) -> Solid:
    mesh = trimesh.load_mesh(str(file))
    vertices = np.asarray(mesh.vertices) * scale
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(mesh.faces))
    model.addSubModel(vertices, np.asarray(mesh.faces))
    model.endModel()
    return replace(_solid(name, model, pose, vertices), mesh=trimesh.Trimesh(vertices, mesh.faces))


def _kept_apart(joints: list[Joint], srdf: Path, ignored: list[list[str]]) -> Any:
    """Return the test whether a pair of links is not to be checked: named in the SRDF or the scene, or joined."""
    named = [
        (e.get("link1", ""), e.get("link2", ""))
        for e in ElementTree.parse(srdf).getroot().findall("disable_collisions")
    ]
    named += [(joint.parent, joint.child) for joint in joints] + [(a, b) for a, b in ignored]
    known = {frozenset(pair) for pair in named}
    return lambda a, b: frozenset((a, b)) in known


# --- scene ------------------------------------------------------------------------------------------------------------


def _obstacles(scene: dict[str, Any]) -> list[Solid]:
    return [
        _primitive(item["id"], shape["type"], _floats(shape["dimensions"]), _pose(item.get("pose")) @ _pose(pose))
        for item in scene["world"]["collision_objects"]
        for shape, pose in zip(item["primitives"], item["primitive_poses"], strict=True)
    ]


def _primitive(name: str, kind: str, numbers: list[float], pose: Array) -> Solid:
    """Make a box [x, y, z], cylinder [height, radius] or sphere [radius]."""
    if kind == "box":
        shape, half = fcl.Box(*numbers), np.array(numbers) / 2
    elif kind == "cylinder":
        shape, half = fcl.Cylinder(numbers[1], numbers[0]), np.array([numbers[1], numbers[1], numbers[0] / 2])
    elif kind == "sphere":
        shape, half = fcl.Sphere(numbers[0]), np.full(3, numbers[0])
    else:
        raise ValueError(f"{name}: shape {kind} is not known")
    return _solid(name, shape, pose, np.array(list(itertools.product(*zip(-half, half, strict=True)))))


def _solid(name: str, shape: Any, pose: Array, points: Array) -> Solid:
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - center, axis=1).max())
    return Solid(name, shape, pose, center, radius)


def _pose(pose: dict[str, Any] | None) -> Array:
    return from_quaternion(pose["position"], pose["orientation"]) if pose else np.eye(4)


def _yaml(path: str | Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(Path(path).read_text())
    return content


def _floats(values: Any) -> list[float]:
    return [float(value) for value in values]
