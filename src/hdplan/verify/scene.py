"""The sections of a scene file that need no robot: poses, shapes, obstacles and their motions, what is wanted.

Every key is known here, or the scene is rejected.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .balls import EPS, HERE, Ball, Pose, named, need, unit
from .meshes import KINDS, triangles
from .robot import decimal, rpy
from .text import LARGEST, Files, listing, mapping, values, yaml_of
from .world import numbers

SECTIONS = (
    "hdplan robot obstacles attached start goal job from_request self_collision limits payload path timing planner"
)
PLANNER = "waypoints clearance activation gamma shaping_length distance link_bodies swept normals polish objective"
SHAPES = {"box": "size", "sphere": "radius", "ellipsoid": "radii", "cylinder": "radius length"}
SHAPES |= {"capsule": "radius length", "points": "points", "mesh": "file"}
SEEN = ("cloud", "depth", "octomap", "voxels")
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}
POSE = "position rpy quaternion_xyzw"


def read_scene(path: Path, data: bytes) -> dict[str, Any]:
    """The sections of a scene file."""
    section = yaml_of(data)
    beside = "one of MoveIt's goes with its request and a robot, --request FILE --robot NAME|FILE"
    need(isinstance(section, dict) and "hdplan" in section, f"{path}: not a hdplan scene, version 1; {beside}")
    top = mapping(section, str(path), SECTIONS)
    need(top.get("hdplan") == 1 and type(top["hdplan"]) is int, f"{path}: not a hdplan scene, version 1")
    need("start" in top and ("goal" in top) != ("job" in top), f"{path}: has no start, or not one of goal and job")
    need(type(top.get("from_request", False)) is bool, "from_request: true or false is expected")
    mapping(top.get("planner", {}), "planner", PLANNER)
    mapping(top.get("timing", {}), "timing", "duration scale rate")
    return top


def one(value: Any, what: str) -> float:
    """A number."""
    need(type(value) in (int, float) and abs(value) < LARGEST, f"{what}: a finite number is expected")
    return float(value)


def word(value: Any, what: str) -> str:
    """A text."""
    need(type(value) is str and value, f"{what}: a word is expected")
    return str(value)


def pose_of(value: Any, what: str) -> Pose:
    """A pose of a scene, some of the keys of a mapping; what is missing is 0. One that is worked out already is a
    tuple, which YAML does not have."""
    if type(value) is tuple:
        return value
    keys, turn = mapping({} if value is None else value, what, POSE), HERE[0]
    need(not {"rpy", "quaternion_xyzw"} <= {*keys}, f"{what}: has two rotations")
    if "quaternion_xyzw" in keys:
        given = values(keys["quaternion_xyzw"], 4, what)
        need(abs(np.sqrt(given @ given) - 1) < 0.011, f"{what}.quaternion_xyzw: must be a unit quaternion")
        if given[:3].any():  # or else it is not turned
            turn = turned_by(*given.tolist())
    elif "rpy" in keys:
        need(type(keys["rpy"]) is list, f"{what}.rpy: three numbers are expected")
        turn = rpy(values(keys["rpy"], 3, what))
    need(type(keys.get("position", [])) is list, f"{what}.position: three numbers are expected")
    at = values(keys.get("position", [0.0] * 3), 3, what)
    return HERE if turn is HERE[0] and not at.any() else (turn, decimal(at))


def turned_by(x: float, y: float, z: float, w: float) -> Ball:
    """The rotation by a quaternion of about unit length, in decimals: 1 + (w K + K^2) 2 / |q|^2, K the cross product's
    matrix of (x, y, z). 2 / |q|^2 is off by 5 roundings, each of the 9 sums times it is at most 2 and off by 2 more, or
    by 3 on the diagonal: by less than 20 EPS. What the decimals are off turns q by at most EPS, and its rotation by
    twice that."""
    f = 2.0 / (x * x + y * y + z * z + w * w)
    rows = (
        (1.0 - f * (y * y + z * z), f * (x * y - w * z), f * (x * z + w * y)),
        (f * (x * y + w * z), 1.0 - f * (x * x + z * z), f * (y * z - w * x)),
        (f * (x * z - w * y), f * (y * z + w * x), 1.0 - f * (x * x + y * y)),
    )
    return Ball(np.array(rows), 32 * EPS)


def frame(pose: Pose) -> dict[str, Any]:
    """A pose as a world has it."""
    off = float(max(pose[0].rad.max(), pose[1].rad.max()))
    return {"rotation": pose[0].mid.ravel().tolist(), "position": pose[1].mid.tolist(), "off": off}


def shape_of(value: Any, what: str, folder: Path, files: Files, claimed: Claimed) -> dict[str, Any]:
    """A shape of a scene as a world has it; a mesh of a kind that the checker does not read as the proof has it."""
    section = mapping(value, f"{what}: shape", "type size radius radii length points file scale")
    kind = str(section.pop("type", ""))
    need(kind in SHAPES, f"{what}: a shape '{kind}'")
    keys = {*section} - ({"scale"} if kind == "mesh" else set())
    need(keys == {*SHAPES[kind].split()}, f"{what}: a shape '{kind}' of other keys")
    if kind == "mesh":
        scale = section.get("scale", 1.0)  # one for all axes will do
        scale = values(scale if isinstance(scale, list) else [scale] * 3, 3, what)
        need(scale.min() > 0, f"{what}: scale: must be above 0")
        body = what, None, named(what)
        return mesh_of(folder / word(section["file"], what), scale, files, claimed, body, upright=True)
    if kind == "points":
        return hull([values(x, 3, what).tolist() for x in listing(section["points"], what)])
    sizes: dict[str, Any] = {x: one(y, what) for x, y in section.items() if x in ("radius", "length")}
    sizes |= {x: values(y, 3, what).tolist() for x, y in section.items() if x in ("size", "radii")}
    small = [x for x in np.hstack([*sizes.values()]).tolist() if x <= 0]
    need(not small or (kind == "capsule" and small == [0.0] and sizes["length"] == 0), f"{what}: a size is not above 0")
    return solid(kind, sizes)


def hull(points: Any, *radii: float) -> dict[str, Any]:
    """The hull of points, swept by an ellipsoid, as a world has it."""
    return {"points": points, "parts": None, "sweep": [[*radii] or [0.0] * 3], "off": 0.0}


def solid(kind: str, sizes: dict[str, Any]) -> dict[str, Any]:
    """A shape of certain sizes as a world has it."""
    if kind == "box":
        x, y, z = (size / 2 for size in sizes["size"])
        return hull([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (-z, z)])
    if kind == "ellipsoid":
        return hull([[0.0] * 3], *sizes["radii"])
    r = sizes["radius"]
    if kind == "sphere":
        return hull([[0.0] * 3], r, r, r)
    end = sizes["length"] / 2  # of a cylinder, or of a capsule
    return hull([[0.0, 0.0, -end], [0.0, 0.0, end]], r, r, r * (kind == "capsule"))


class Claimed:
    """Bodies of the proof's own world, in place of files that the checker does not read; the verdict names them."""

    def __init__(self, world: Any) -> None:
        self._bodies = list((world or {}).get("bodies", []))
        self.taken = dict[str, None]()

    def shape(self, name: str, number: int | None, what: str) -> dict[str, Any]:
        """The shape of a link, one of several, or, without a number, of a held object or an obstacle."""
        link = number is not None
        own = [x["shape"] for x in self._bodies if x["name"] == name and (x["kind"] == "link") == link]
        need((number or 0) < len(own), f"{what}: cannot be read by the checker, and the proof has none")
        self.taken[what] = None
        return dict(own[number or 0])

    def seen(self, name: str) -> dict[str, Any]:
        """The shape of an obstacle that was seen: how it is put together, and what is left out, the proof may say."""
        own = [x["shape"] for x in self._bodies if x["name"] == name and x["kind"] == "obstacle"]
        need(len(own) == 1, f"'{name}': the proof does not have it")
        return dict(own[0])

    def points(self, name: str) -> Any:
        """The points (k, 3) of an obstacle that was seen."""
        return numbers(self.seen(name)["points"], (-1, 3), f"'{name}'")


def mesh_of(
    path: Path, scale: Any, files: Files, claimed: Claimed, body: tuple[str, int | None, str], upright: bool
) -> dict[str, Any]:
    """A mesh as a world has it; of a kind that the checker does not read as the proof has it. `body`: the name of its
    body, which one of a link's it is, and what it is called."""
    data, (name, number, what) = files.read(f"mesh {path.parent.name}/{path.name}", path), body
    if path.suffix.lower() not in KINDS:
        return claimed.shape(name, number, f"{named(path.name)} ({what})")
    return mesh(path, data, scale, upright)


def mesh(path: Path, data: bytes, scale: Any, upright: bool) -> dict[str, Any]:
    """The triangles of a mesh file as a world has them, in arrays that cannot be written: points in the order of their
    first use, triangles with two equal corners left out; named backwards where the scale mirrors."""
    points, faces, off = _merged(path, data, tuple(scale.tolist()), upright)
    return {"points": points, "parts": faces, "sweep": [[0.0] * 3], "off": off}


@functools.lru_cache(maxsize=256)  # by the content of files, which are read each time
def _merged(path: Path, data: bytes, scale: tuple[float, ...], upright: bool) -> tuple[Any, Any, float]:
    """Points (m, 3), triangles (F, 3) by the numbers of their points, and the bound on the points' errors."""
    found, factor = triangles(path, data, upright), np.array(scale)
    corners = found.mid * factor
    off = float((found.rad * np.abs(factor) + (found.rad > 0) * EPS * np.abs(corners)).max())
    flat = corners.reshape(-1, 3)
    distinct, index = np.unique(flat, axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    faces = faces[:, ::-1] if np.prod(np.sign(factor)) < 0 else faces
    need(len(faces), f"{path}: has no triangles")
    used, first = np.unique(faces.ravel(), return_index=True)
    order = used[np.argsort(first)]
    where = np.zeros(index.max() + 1, dtype=np.int64)
    where[order] = np.arange(len(order))
    points, faces = distinct[order], where[faces]
    points.flags.writeable = faces.flags.writeable = False
    return points, faces, off


def obstacles(
    top: dict[str, Any], folder: Path, files: Files, claimed: Claimed, seen: Callable[..., dict[str, Any]]
) -> tuple[list[Any], dict[str, Any], dict[str, Any]]:
    """Bodies of the obstacles, the motions of some, for `moving`, and their own clearances. `seen` gives the shape of
    what was seen, by name, kind, section and pose."""
    bodies, motions, own = [], dict[str, Any](), dict[str, Any]()
    for i, entry in enumerate(listing(top.get("obstacles"), "obstacles")):
        what = f"obstacles[{i}]"
        section = mapping(entry, what, f"name shape pose clearance motion uncertainty {' '.join(SEEN)}")
        name = word(section.get("name", f"obstacle{i}"), what)
        pose = begins = pose_of(section.get("pose"), name)
        if "motion" in section:
            need("pose" not in section or "times" not in section["motion"], f"{what}: has two poses")
            motions[name], pose = motion(section["motion"], pose, name), HERE
            begins = motions[name].get("poses", [begins])[0]
        kinds = [x for x in ("shape", *SEEN) if x in section]
        need(len(kinds) == 1, f"{what}: one of shape, {', '.join(SEEN)} is expected")
        if kinds == ["shape"]:
            shape = shape_of(section["shape"], name, folder, files, claimed)
        else:
            shape = seen(name, kinds[0], section[kinds[0]], begins)
        bodies.append({"name": name, "kind": "obstacle", "joint": -1, **frame(pose), "shape": shape})
        if "clearance" in section:
            own[name] = one(section["clearance"], f"{what}.clearance")
    return bodies, motions, own


def motion(value: Any, pose: Pose, name: str) -> dict[str, Any]:
    """Motion of an obstacle."""
    section = mapping(value, f"{name}: motion", "velocity spin times poses")
    if "times" in section or "poses" in section:
        need({*section} == {"times", "poses"}, f"{name}: motion: times and poses, or velocity and spin")
        times = values(listing(section["times"], name), len(section["times"]), name).tolist()
        return {"times": times, "poses": [pose_of(x, name) for x in listing(section["poses"], name)]}
    rates = {key: values(section.get(key, [0.0] * 3), 3, name).tolist() for key in ("velocity", "spin")}
    return {**rates, "pose": pose}


def path_of(top: dict[str, Any]) -> list[Any]:
    """The path constraints as a world has them; a tuple has those that are worked out already."""
    if type(top.get("path")) is tuple:
        return list(top["path"])
    section, found = mapping(top.get("path", {}), "path", "upright position relative"), list[Any]()
    if "upright" in section:
        keys = mapping(section["upright"], "path.upright", "link axis tolerance")
        axis = keys.get("axis", "z")
        need(type(axis) is not str or axis in AXES, f"path.upright.axis: one of {', '.join(AXES)}, or three numbers")
        way = unit(decimal(values(list(AXES[axis]) if type(axis) is str else axis, 3, "path.upright")))
        tolerance = one(keys.get("tolerance", 0.1), "path.upright")
        direction = {"axis": way.mid.tolist(), "off": float(way.rad.max())}
        found.append({"kind": "upright", "link": word(keys.get("link"), "path"), **direction, "tolerance": tolerance})
    if "position" in section:
        keys = mapping(section["position"], "path.position", f"link size point {POSE}")
        point = values(keys.get("point", [0.0] * 3), 3, "path.position").tolist()
        size = listing(keys.get("size"), "path.position.size")
        size = [None if x == np.inf else one(x, "path.position.size") for x in size]
        pose = pose_of({x: keys[x] for x in POSE.split() if x in keys}, "path.position")
        box = {"link": word(keys.get("link"), "path"), "point": point, "size": size, **frame(pose)}
        found.append({"kind": "position", **box})
    if "relative" in section:
        keys = mapping(section["relative"], "path.relative", "link to pose position_tolerance orientation_tolerance")
        place = frame(pose_of(keys["pose"], "path.relative")) if "pose" in keys else None
        usual = {"position_tolerance": 5e-3, "orientation_tolerance": 0.05}
        more = {key: one(keys.get(key, x), "path.relative") for key, x in usual.items()}
        links = {key: word(keys.get(key), "path.relative") for key in ("link", "to")}
        found.append({"kind": "relative", **links, "frame": place, **more})
    return found


def pose_goal(value: Any, what: str, end_effector: Any) -> dict[str, Any]:
    """A goal pose as a world has it; `end_effector` gives the link where none is named."""
    section = mapping(value, what, f"link {POSE} position_tolerance orientation_tolerance free_rotation")
    free = section.get("free_rotation", "none")
    need(free in ("none", "x", "y", "z", "all") and "position" in section, f"{what}: free_rotation or position")
    turned = {*section} & {"rpy", "quaternion_xyzw"}
    need(bool(turned) != (free == "all"), f"{what}: has no orientation, or one that does not matter")
    need(free != "all" or "orientation_tolerance" not in section, f"{what}: a tolerance that does not matter")
    usual = {"position_tolerance": 1e-3, "orientation_tolerance": 1e-2}
    more = {key: one(section.get(key, x), what) for key, x in usual.items()}
    link = word(section["link"], what) if "link" in section else end_effector()
    pose = pose_of({x: section[x] for x in POSE.split() if x in section}, what)
    return {"link": link, **frame(pose), **more, "free": free}
