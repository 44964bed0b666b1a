"""A scene as its file says, by the judge's own reading: bodies, where they are over time, and which are kept apart."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial import ConvexHull

from hdplan.scenes.array_types import Array
from sieges import meshes, poses
from sieges.gjk import Index, Pieces
from sieges.machine import DATA, NAMED, SHARE, Machine, Mass, Motion
from sieges.rows import Rows

SAME = np.eye(3)
Row = tuple[Array, float, float, Array]  # a convex piece: points, ball, disc, axes
CONVEX = 1.0 - 1e-3  # of its hull's volume from which a closed mesh counts as its hull, as hdplan says it does


@dataclass(frozen=True, eq=False)
class Body:
    """A thing of one owner: a link's geometry, a held object, an obstacle."""

    name: str  # of the link, the object or the obstacle
    link: str  # that carries it; empty for an obstacle
    place: Array  # (4, 4) in the link's frame, or in the world at time 0
    rows: list[Row]
    mesh: meshes.Mesh | None = None  # that is not convex: where it is closed, inside is contact too
    closed: bool = False
    motion: dict[str, Any] | None = None  # of an obstacle


class World:
    """One scene file with its robot."""

    def __init__(self, scene: Path, planned: tuple[str, ...]) -> None:
        """Read the scene; `planned`: the joints that a motion moves."""
        self.folder = scene.parent
        self.content: dict[str, Any] = yaml.load(scene.read_text(), yaml.CSafeLoader)
        robot = self.content["robot"]
        home, files = (
            (DATA, NAMED[robot["name"]]) if "name" in robot else (self.folder, (robot["urdf"], robot.get("srdf")))
        )
        urdf, srdf = home / files[0], home / files[1] if files[1] else None
        self.machine = _machine(urdf, urdf.stat().st_mtime_ns)
        locked = {name: float(value) for name, value in (robot.get("locked") or {}).items()}
        self.planned = [name for name in planned if name not in locked]
        self.held = self.machine.held(locked, set(self.planned))
        self.base = poses.of_scene(robot.get("base"))
        self.held_objects = self.content.get("attached") or []
        self.bodies = [
            _body(link, link, place, _of_urdf(shape, urdf)) for link, place, shape in self.machine.collisions
        ]
        self.bodies += [
            _body(held["name"], held["link"], poses.of_scene(held.get("pose")), self._shape(held["shape"]))
            for held in self.held_objects
        ]
        self.robot_count = len(self.bodies)
        for item in self.content.get("obstacles") or []:
            motion, place = item.get("motion"), poses.of_scene(item.get("pose"))
            self.bodies.append(_body(item["name"], "", place, self._shape(item["shape"]), motion))
        rows = [(k, *row) for k, body in enumerate(self.bodies) for row in body.rows]
        self.pieces = Pieces.of(rows)
        self.carrier = [self.machine.carrier(body.link, set(self.planned)) if body.link else "" for body in self.bodies]
        self.required = {
            item["name"]: item.get("clearance", (self.content.get("planner") or {}).get("clearance", 0.0))
            for item in self.content.get("obstacles") or []
        }
        self.insist = {item["name"] for item in self.content.get("obstacles") or [] if "clearance" in item}
        own = self.content.get("self_collision", True)
        self.own_required = own.get("clearance", 0.0) if isinstance(own, dict) else 0.0
        self.checks_own = own is not False
        self.pairs = self._pairs(_disabled(srdf), {frozenset(pair) for pair in robot.get("ignore_pairs") or []})

    def _pairs(self, disabled: set[frozenset[str]], ignored: set[frozenset[str]]) -> list[tuple[int, int]]:
        """Return the bodies that are kept apart: (robot's, obstacle) and (robot's, robot's)."""
        found = []
        for a, b in itertools.product(range(self.robot_count), range(self.robot_count, len(self.bodies))):
            if self.carrier[a] or self.bodies[b].motion is not None:
                found.append((a, b))
        if not self.checks_own:
            return found
        touch = {held["name"]: set(held.get("touch_links") or []) for held in self.held_objects}
        for a, b in itertools.combinations(range(self.robot_count), 2):
            one, other = self.bodies[a].name, self.bodies[b].name
            if self.carrier[a] == self.carrier[b]:
                continue
            if one in touch or other in touch:
                if other in touch.get(one, ()) or one in touch.get(other, ()):
                    continue
            elif self._neighbours(a, b) or frozenset((one, other)) in disabled | ignored:
                continue
            found.append((a, b))
        return found

    def _neighbours(self, a: int, b: int) -> bool:
        """True if exactly one planned joint lies between two links."""
        first, second = self.carrier[a], self.carrier[b]
        return self._below(first) == second or self._below(second) == first

    def _below(self, joint: str) -> str | None:
        """Return the planned joint that carries the link from which a joint comes; None for the world."""
        return self.machine.carrier(self.machine.by_name[joint].parent, set(self.planned)) if joint else None

    def values(self, names: tuple[str, ...], q: Array) -> dict[str, Array]:
        """Return all joints' values (T,) where the motion's joints are at q (T, n)."""
        count = len(q)
        return {
            **{name: np.full(count, value) for name, value in self.held.items()},
            **{name: q[:, names.index(name)] for name in self.planned},
        }

    def motion(self, rows: Rows, interval: Index, s: Array) -> Motion:
        """Return the links' motion at places of a motion that has velocities."""
        q, v, a = (self.values(rows.names, rows.at(interval, s, order)) for order in range(3))
        v, a = ({name: each[name] for name in self.planned} for each in (v, a))
        return self.machine.motion(q, v, a, self.base)

    def places(self, names: tuple[str, ...], q: Array, times: Array) -> Array:
        """Return the pose of each body (B, T, 4, 4)."""
        if not self.bodies:
            return np.zeros((0, len(q), 4, 4))
        frames = self.machine.frames(self.values(names, q), self.base)
        return np.stack(
            [frames[body.link] @ body.place if body.link else _passage(body, times) for body in self.bodies]
        )

    def _shape(self, shape: dict[str, Any]) -> list[Row] | meshes.Mesh:
        if shape["type"] != "mesh":
            return _primitive(shape)
        points, faces = meshes.read(self.folder / shape["file"])
        return points * np.array(shape.get("scale", 1.0), dtype=float), faces

    def pair_name(self, pair: tuple[int, int]) -> str:
        """Return the names of two bodies."""
        return " and ".join(self.bodies[k].name for k in pair)

    def masses(self) -> list[Mass]:
        """Return all that weighs something: links, payload, held objects."""
        found = list(self.machine.masses)
        if (load := self.content.get("payload")) is not None:
            xx, xy, xz, yy, yz, zz = load.get("inertia", [0.0] * 6)
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            found.append(Mass(load["link"], load["mass"], np.array(load.get("com", [0, 0, 0]), dtype=float), inertia))
        for held in self.held_objects:
            if held.get("mass"):
                place = poses.of_scene(held.get("pose"))
                inertia = place[:3, :3] @ _even(held["shape"], held["mass"]) @ place[:3, :3].T
                found.append(Mass(held["link"], held["mass"], place[:3, 3], inertia))
        return found


@lru_cache(maxsize=64)
def _machine(urdf: Path, _: int) -> Machine:
    return Machine(urdf)


@lru_cache(maxsize=64)
def _disabled(srdf: Path | None) -> set[frozenset[str]]:
    if srdf is None:
        return set()
    found = ElementTree.parse(srdf).getroot().findall("disable_collisions")
    return {frozenset((pair.get("link1", ""), pair.get("link2", ""))) for pair in found}


def _body(
    name: str, link: str, place: Array, shape: list[Row] | meshes.Mesh, motion: dict[str, Any] | None = None
) -> Body:
    if isinstance(shape, list):
        return Body(name, link, place, shape, motion=motion)
    points, faces = shape
    solid = meshes.closed(shape)
    corners = points[faces] - points.mean(axis=0)
    volume = abs(float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))) / 6.0
    used = points[np.unique(faces)]
    hull = ConvexHull(used) if solid else None
    if hull is not None and volume >= CONVEX * hull.volume:
        return Body(name, link, place, [(used[hull.vertices], 0.0, 0.0, SAME)], motion=motion)
    rows = [(corner, 0.0, 0.0, SAME) for corner in points[faces]]
    return Body(name, link, place, rows, shape, solid, motion)


def _of_urdf(shape: ElementTree.Element, urdf: Path) -> list[Row] | meshes.Mesh:
    about = {key: [float(word) for word in value.split()] for key, value in shape.items() if key != "filename"}
    if shape.tag != "mesh":
        return _primitive({"type": shape.tag, **{key: x if key == "size" else x[0] for key, x in about.items()}})
    name = shape.get("filename", "")
    known = name.removeprefix("package://")
    file = SHARE / known if known != name else urdf.parent / name
    return _mesh(file, tuple(about.get("scale", [1.0, 1.0, 1.0])), file.stat().st_mtime_ns)


def _primitive(shape: dict[str, Any]) -> list[Row]:
    """Return the convex piece of a shape that has no file."""
    radius, segment = shape.get("radius", 0.0), np.array([[0, 0, -0.5], [0, 0, 0.5]]) * shape.get("length", 0.0)
    match shape["type"]:
        case "box":
            return [(meshes.box(np.array(shape["size"], dtype=float))[0], 0.0, 0.0, SAME)]
        case "sphere" | "capsule":
            return [(segment[: 1 + ("length" in shape)], radius, 0.0, SAME)]
        case "cylinder":
            return [(segment, 0.0, radius, SAME)]
        case _:
            points = np.array(shape["points"], dtype=float)
            return [(points[ConvexHull(points).vertices], 0.0, 0.0, SAME)]


@lru_cache(maxsize=64)
def _mesh(file: Path, scale: tuple[float, ...], _: int) -> meshes.Mesh:
    points, faces = meshes.read(file)
    scaled = points * np.array(scale)
    return scaled, faces if np.prod(scale) > 0 else faces[:, ::-1]


def _passage(body: Body, times: Array) -> Array:
    """Return the poses of an obstacle at times (T,)."""
    motion, count = body.motion, len(times)
    found = np.broadcast_to(body.place, (count, 4, 4)).copy()
    if motion is None:
        return found
    if "times" not in motion:
        spin = np.array(motion.get("spin", [0, 0, 0]), dtype=float)
        found[:, :3, :3] = poses.turn(spin, times) @ body.place[:3, :3]
        found[:, :3, 3] += times[:, None] * np.array(motion.get("velocity", [0, 0, 0]), dtype=float)
        return found
    marks, through = motion["times"], [poses.of_scene(pose) for pose in motion["poses"]]
    for k, time in enumerate(times.tolist()):
        i = int(np.clip(np.searchsorted(marks, time, side="right") - 1, 0, len(marks) - 2))
        part = float(np.clip((time - marks[i]) / (marks[i + 1] - marks[i]), 0.0, 1.0))
        way = poses.vector_of(through[i + 1][:3, :3] @ through[i][:3, :3].T)
        found[k, :3, :3] = poses.turn(way, np.array([part]))[0] @ through[i][:3, :3]
        found[k, :3, 3] = (1.0 - part) * through[i][:3, 3] + part * through[i + 1][:3, 3]
    return found


def _even(shape: dict[str, Any], mass: float) -> Array:
    """Return the inertia (3, 3) of a body of even density about its centre: box, sphere, cylinder."""
    match shape["type"]:
        case "box":
            x, y, z = (np.array(shape["size"], dtype=float) ** 2).tolist()
            return np.diag([y + z, x + z, x + y]) * mass / 12.0
        case "sphere":
            return np.eye(3) * (0.4 * mass * float(shape["radius"]) ** 2)
        case "cylinder":
            r, h = shape["radius"] ** 2, shape["length"] ** 2
            return np.diag([3 * r + h, 3 * r + h, 6 * r]) * mass / 12.0
        case kind:
            raise ValueError(f"the judge knows no inertia of a {kind}")
