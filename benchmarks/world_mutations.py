"""Change worlds and proofs at random, and see what the kernel of the checker accepts.

    python benchmarks/world_mutations.py [--count N] [--seed S] [--seconds T] [--scene NAME ...] [--state FILE]

Numbers, signs, indices and names of a world are changed, entries are dropped, doubled and exchanged, proofs get other
leaves, directions, groups and claims. Whatever the kernel accepts is judged from the changed world alone, by Pinocchio
and coal, without hdplan and without the kernel: at 200 moments of the motion bodies must be as far apart as stated, and
limits, torques, path constraints, start, goal and duration must be kept as claimed. Where a world has sizes of what is
unknown, every unknown goes to the edge that brings two bodies together. Prints a table with a row per kind
of change: "false" must be 0, as must errors other than a rejection. Of the changed worlds that are rejected, every
tenth is judged, too: the judge must find many of them false. With a file of `--state`, a campaign that was ended goes
on.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import itertools
import json
import pickle
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import yaml
from campaign import Tally
from scipy.interpolate import BPoly
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify import RejectedError
from hdplan.verify.checking import check
from hdplan.verify.compare import plain
from hdplan.verify.kernel import CLAIMS, MAGIC, accept

Random = np.random.Generator
World = dict[str, Any]

SCENES = (
    *("planar_arm", "ur5_table", "ur5_payload", "panda_cup", "panda_carry", "panda_conveyor", "panda_heavy"),
    *("panda_grasp", "panda_cage", "panda_table_pick", "panda_person"),
    *("planar_arm, sizes", "ur5_table, sizes", "panda_carry, sizes", "panda_conveyor, sizes"),
)
SIZES = {  # of what is unknown, as scenes have it: of the robot, and of every obstacle; speeds where a motion has times
    "robot": {"tracking": {"position": 0.001}, "calibration": {"position": 0.001, "orientation": 0.001}},
    "obstacle": {"position": 0.002, "orientation": 0.005},
}
MOMENTS = 200
TEETH = "of those rejected"  # as the judge finds them
WORST = 4  # moments of a pair at which what is unknown goes to its edges
WAYS = ((0.6180339, 0.3247179, 0.7161573), (-0.7548776, 0.5698402, 0.2360679), (0.1415926, -0.7182818, -0.5772156))
SLACK = 1e-6  # [m, rad or of a limit]: coal's and Pinocchio's own errors, and what the kernel lets ends be off


# --- the judge --------------------------------------------------------------------------------------------------------


def se3(frame: World) -> pin.SE3:
    return pin.SE3(np.reshape(frame["rotation"], (3, 3)).astype(float), np.array(frame["position"], dtype=float))


BALL = Rotation.random(400, rng=np.random.default_rng(0)).apply([0.0, 0.0, 1.0])


def primitive_of(shape: World) -> Any:
    """coal's box, ball, ellipsoid, capsule or cylinder for a shape that is one; None for any other."""
    points, sweep = np.array(shape["points"], dtype=float), np.array(shape["sweep"][0], dtype=float)
    half, r = np.abs(points[0]), sweep[0]
    corners = [[x, y, z] for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (-half[2], half[2])]
    if shape["parts"] is not None:
        return None
    if len(points) == 8 and not sweep.any() and (points == corners).all():
        return coal.Box(*(2 * half))
    if len(points) == 1 and not half.any() and sweep.all():
        return coal.Ellipsoid(*sweep) if (sweep != r).any() else coal.Sphere(r)
    along = len(points) == 2 and (points[0] == -points[1]).all() and not half[:2].any() and r == sweep[1] > 0
    if along and sweep[2] in (0.0, r):
        return (coal.Capsule if sweep[2] else coal.Cylinder)(r, 2 * half[2])
    return None


def triangles_of(shape: World) -> Any:
    """The triangles (F, 3, 3) of a mesh, or of a hull within that of other points, swept or not; None for what coal has
    itself."""
    if primitive_of(shape) is not None:
        return None
    points, sweep = np.array(shape["points"], dtype=float), np.array(shape["sweep"], dtype=float)
    if shape["parts"] is not None:
        parts = np.array(shape["parts"], dtype=int)
        ways = (
            [*itertools.combinations_with_replacement(range(parts.shape[1]), 3)] if parts.shape[1] != 3 else [range(3)]
        )
        return np.concatenate([points[parts[:, [*way]]] for way in ways])
    if sweep.any():
        points = (points[:, None] + BALL * sweep[0]).reshape(-1, 3)
    try:
        return points[ConvexHull(points).simplices]
    except QhullError:  # flat, or a line
        return points[[*itertools.combinations_with_replacement(range(min(len(points), 20)), 3)]]


def geometry_of(shape: World) -> Any:
    """coal's geometry of a shape."""
    corners = triangles_of(shape)
    if corners is None:
        return primitive_of(shape)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(corners), 3 * len(corners))
    for one, two, three in corners:
        mesh.addTriangle(one, two, three)
    mesh.endModel()
    return mesh


def inside(point: Any, corners: Any) -> bool:
    """Whether rays from a point meet triangles (F, 3, 3) an odd number of times, whatever their way: of a surface that
    a change has opened, one way alone says nothing."""
    return all(odd(point, corners, np.array(way)) for way in WAYS)


def odd(point: Any, corners: Any, way: Any) -> bool:
    """Whether a ray along a way meets triangles (F, 3, 3) an odd number of times."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    h = np.cross(way, two)
    det = np.einsum("fi,fi->f", one, h)
    s = point - corners[:, 0]
    with np.errstate(all="ignore"):
        u = np.einsum("fi,fi->f", s, h) / det
        q = np.cross(s, one)
        v, t = q @ way / det, np.einsum("fi,fi->f", q, two) / det
        return bool(np.sum((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)) % 2)


def apart(shape: Any, place: Any, other: Any, beside: Any) -> tuple[float, Any, Any]:
    """The distance of two shapes at places (4, 4), and their closest points."""
    result, ways = coal.DistanceResult(), (coal.Transform3s(x[:3, :3], x[:3, 3]) for x in (place, beside))
    a, b = ways
    away = coal.distance(shape, a, other, b, coal.DistanceRequest(), result)
    return away, np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())


def wedge(a: Any, b: Any) -> Any:
    """The products a x b of vectors (k, 3)."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def strayed(places: Any, centers: Any, radius: float, k: int, others: Any) -> Any:
    """How far points of a ball around a body are from where they are at a moment, at others at most."""
    turn = np.linalg.norm(places[others, :3, :3] - places[k, :3, :3], axis=(1, 2))
    return np.linalg.norm(centers[others] - centers[k], axis=1) + turn * radius


def turned(place: Any, origin: Any, axis: Any, angle: float) -> Any:
    """A place (4, 4), turned about an axis through a point."""
    length = float(np.linalg.norm(axis))
    if not angle or length < 1e-12:
        return place
    turn = Rotation.from_rotvec(angle / length * axis).as_matrix()
    found = place.copy()
    found[:3, :3], found[:3, 3] = turn @ place[:3, :3], turn @ (place[:3, 3] - origin) + origin
    return found


class Judge:
    """A world as Pinocchio and coal have it, at moments of its motion."""

    def __init__(self, world: World) -> None:
        self.world = world
        model = pin.Model()
        for i, joint in enumerate(world["joints"]):
            axis = np.array(joint["axis"], dtype=float)
            kind = pin.JointModelRevoluteUnaligned if joint["kind"] == "revolute" else pin.JointModelPrismaticUnaligned
            model.addJoint(joint["parent"] + 1, kind(axis), se3(joint), f"j{i}")
        for i, load in enumerate(world.get("loads", [])):
            xx, xy, xz, yy, yz, zz = load["inertia"]  # about the joint's origin
            body = pin.Inertia.FromDynamicParameters(np.array([load["mass"], *load["moment"], xx, xy, yy, xz, yz, zz]))
            body = body if abs(load["mass"]) > 1e-100 else pin.Inertia.Zero()
            model.inertias[i + 1] = body
        for i, track in enumerate(world["tracks"]):
            way = np.array(track["way"], dtype=float)
            kind = pin.JointModelRevoluteUnaligned if track["kind"] == "revolute" else pin.JointModelPrismaticUnaligned
            model.addJoint(track["parent"] + 1, kind(way / np.linalg.norm(way)), pin.SE3.Identity(), f"t{i}")
        self.model, self.data = model, model.createData()
        self.model.gravity.linear = np.array([0.0, 0.0, -9.81])
        self._move(world["motion"])
        self.frames = []
        followed = [np.interp(self.at, x["times"], x["values"]) * np.linalg.norm(x["way"]) for x in world["tracks"]]
        for q in np.column_stack([self.q, *followed]):
            pin.forwardKinematics(model, self.data, q)
            self.frames.append([x.copy() for x in self.data.oMi])
        self.sizes = world.get("sizes")
        sizes = self.sizes or {"around": {}, "base": None, "joints": [], "rates": []}
        self.around, self.base = sizes["around"], sizes["base"] or {"shift": 0.0, "turn": 0.0, "about": [0.0] * 3}
        self.followed = followed
        self.off, self.rates = (self._off(sizes[key]) for key in ("joints", "rates"))
        joints, count = world["joints"], len(world["joints"])
        self.axes = np.array([x["axis"] for x in joints], dtype=float)
        self.turns = np.array([x["kind"] == "revolute" for x in joints])[:, None]
        self.follow = np.zeros((count, count))  # of each joint by the one that it follows, or by itself
        for i, x in enumerate(joints):
            leader, factor, _ = x["follows"] or (i, 1.0, 0.0)
            self.follow[i, leader] = factor
        self.above = np.zeros((len(model.names), count), dtype=bool)  # by which joints each is moved; the last: none
        for i in range(len(model.names) - 1):
            self.above[i] = self.above[int(model.parents[i + 1]) - 1]
            self.above[i, i : i + 1] = True

    def _off(self, pair: list[float]) -> Any:
        """How far all joints may be off, by that of those which follow none."""
        joints = self.world["joints"]
        lead = [i for i, x in enumerate(joints) if x["follows"] is None]
        own = dict(zip(lead, pair or [0.0] * len(lead), strict=True))
        return np.array([own[i] if i in own else abs(x["follows"][1]) * own[x["follows"][0]]
                         for i, x in enumerate(joints)])  # fmt: skip

    def _move(self, motion: World) -> None:
        """Values and rates of all joints at the moments."""
        rows, times, joints = np.array(motion["positions"], dtype=float), motion["times"], self.world["joints"]
        knots = np.arange(len(rows), dtype=float) if times is None else np.array(times, dtype=float)
        rng, n = np.random.default_rng(0), len(knots) - 1
        at = np.sort(rng.uniform(0, n, MOMENTS - min(n + 1, MOMENTS // 2)))
        at = np.sort(np.r_[at, np.linspace(0, n, min(n + 1, MOMENTS // 2))])
        low = np.minimum(at.astype(int), n - 1)
        self.at = knots[low] + (at - low) * (knots[low + 1] - knots[low])
        rates = [rows, *(np.array(motion[x], dtype=float) for x in ("velocities", "accelerations") if x in motion)]
        curve = BPoly.from_derivatives(knots, np.stack(rates, axis=1))
        lead = iter(range(rows.shape[1]))
        column = {i: next(lead) for i, x in enumerate(joints) if x["follows"] is None}
        self.values = list[Any]()
        for order in range(4):
            found = (
                (curve if order == 0 else curve.derivative(order))(self.at)
                if order < curve.c.shape[0]
                else 0 * self.values[0]
            )
            full = np.zeros((len(self.at), len(joints)))
            for i, x in enumerate(joints):
                j, factor, add = x["follows"] or (i, 1.0, 0.0)
                full[:, i] = (
                    factor * found[:, column[j]] + (add if order == 0 else 0.0) if order < curve.c.shape[0] else 0.0
                )
            self.values.append(full)
        self.q = self.values[0]

    def link(self, name: str, k: int) -> pin.SE3:
        """A link's frame at a moment."""
        frame = self.world["links"][name]
        return self.frames[k][frame["joint"] + 1] * se3(frame)

    def bodies(self, body: World) -> Any:
        """A body's frames (k, 4, 4) at all moments."""
        return np.array([x[body["joint"] + 1].homogeneous for x in self.frames]) @ se3(body).homogeneous

    def too_close(self, head: World) -> str:
        """Bodies that are closer than stated, or within one another."""
        world, bodies = self.world, self.world["bodies"]
        left_out = {frozenset(x[:2]) for x in world["not_compared"]}
        made = [geometry_of(x["shape"]) for x in bodies]
        for each in made:
            each.computeLocalAABB()
        centers, radii = np.array([x.aabb_center for x in made]), np.array([x.aabb_radius for x in made])
        places = [self.bodies(x) for x in bodies]
        seen = [x[:, :3, :3] @ c + x[:, :3, 3] for x, c in zip(places, centers, strict=True)]
        usual = world["clearances"]["obstacles"] if "clearance" in head["claims"] else 0.0
        for i, one in enumerate(bodies):
            for j in range(i + 1, len(bodies)):
                two = bodies[j]
                if one["kind"] == "obstacle" or one["name"] == two["name"]:
                    continue
                least = head["self_clearance"]
                if two["kind"] != "obstacle":
                    if frozenset((one["name"], two["name"])) in left_out:
                        continue
                elif one["joint"] == two["joint"] == -1:
                    continue
                else:
                    least = max(head["clearance"], world["clearances"]["own"].get(two["name"], usual))
                far, limit = np.linalg.norm(seen[i] - seen[j], axis=1) - radii[i] - radii[j], least + self.room(two)
                left, near = np.flatnonzero(far < limit), list[tuple[float, int]]()
                while len(left):
                    k = int(left[len(left) // 2])
                    away, _, _ = apart(made[i], places[i][k], made[j], places[j][k])
                    near += [(away - limit[k], k)] * bool(away < limit[k])
                    if away < least - SLACK:
                        return f"{one['name']} and {two['name']}: {away} m at {self.at[k]}, not {least}"
                    gone = sum(strayed(places[x], seen[x], radii[x], k, left) for x in (i, j))
                    left = left[(away - gone < limit[left]) & (left != k)]  # others are surely farther apart
                for _, k in sorted(near)[: WORST * bool(self.sizes)]:
                    away = self.closest(one, made[i], two, made[j], k)
                    if away < least - SLACK:
                        return f"{one['name']} and {two['name']}: {away} m at {self.at[k]}, if unlucky, not {least}"
                if two["kind"] != "link" and (why := self.contained(i, j, places, centers)):
                    return why
        return ""

    def room(self, two: World) -> Any:
        """How much closer a body may be to another one as something is unknown, roughly, at all moments."""
        found = 2.0 * self.off.sum() + np.zeros(len(self.at))
        if two["kind"] == "obstacle":
            own = self.around.get(two["name"], {"shift": 0.0, "turn": 0.0, "speed": 0.0})
            found += own["shift"] + self.base["shift"] + 3.0 * (own["turn"] + self.base["turn"])
            found += own["speed"] * np.abs(self.at)
        return found

    def closest(self, one: World, shape: Any, two: World, other: Any, k: int) -> float:
        """A distance [m] that two bodies have at a moment in a world within the sizes: each unknown goes to the edge at
        which the closest points of the two come together."""
        frames, joints = self.frames[k], self.world["joints"]
        moves = np.array([self.above[x["joint"]] for x in (one, two)])
        places, best = [frames[x["joint"] + 1].homogeneous @ se3(x).homogeneous for x in (one, two)], np.inf
        obstacle, none = two["kind"] == "obstacle", {"shift": 0.0, "turn": 0.0, "speed": 0.0}
        still: dict[str, Any] = {"shift": 0.0, "turn": 0.0, "about": [0.0] * 3}
        own = self.around.get(two["name"], none) if obstacle else none
        base = self.base if obstacle else still
        about, origin = np.array(base["about"], dtype=float), places[1][:3, 3].copy()
        shift = base["shift"] + own["shift"] + own["speed"] * abs(self.at[k])
        axes = np.array([x.rotation @ y for x, y in zip(frames[1:], self.axes, strict=False)])
        points = np.array([x.translation for x in frames[1 : len(joints) + 1]])
        for _ in range(2):
            away, a, b = apart(shape, places[0], other, places[1])
            best = min(best, away - shift)
            if away <= shift or not (self.off.any() or base["turn"] or own["turn"]):
                break
            way = (a - b) / away
            rates = [np.where(self.turns, wedge(axes, x - points), axes) @ way for x in (a, b)]
            pull = self.follow.T @ (rates[0] * moves[0] - rates[1] * moves[1])  # by how much a joint parts the two
            q = self.q[k] - self.follow @ (np.sign(pull) * self.off)
            pin.forwardKinematics(self.model, self.data, np.append(q, [x[k] for x in self.followed]))
            places = [self.data.oMi[x["joint"] + 1].homogeneous @ se3(x).homogeneous for x in (one, two)]
            places[0] = turned(places[0], about, -np.cross(a - about, way), base["turn"])
            places[1] = turned(places[1], origin, np.cross(b - origin, way), own["turn"])
        away, _, _ = apart(shape, places[0], other, places[1])
        return float(min(best, away - shift))

    def contained(self, i: int, j: int, places: list[Any], centers: Any) -> str:
        """Whether one of two bodies is within the other: surfaces that never meet stay as they are at the beginning."""
        bodies = self.world["bodies"]
        for x, y in ((i, j), (j, i)):
            corners = triangles_of(bodies[y]["shape"])
            if corners is not None:
                own = triangles_of(bodies[x]["shape"])
                point = own[0, 0] if own is not None else centers[x]
                one, two = places[x][0], places[y][0]
                if inside(two[:3, :3].T @ (one[:3, :3] @ point + one[:3, 3] - two[:3, 3]), corners):
                    return f"{bodies[x]['name']} within {bodies[y]['name']}"
        return ""

    def claimed(self, head: World, whole: bool) -> str:
        """A claim beside clearances that is not so."""
        world, claims = self.world, {*head["claims"]}
        limits = world["limits"]
        wanted = {"start", "goal", "limits", *(x for x in limits if x != "position")}
        wanted |= {"path"} if world["path"] else set()
        wanted |= {"duration"} if world["duration"] is not None else set()
        if whole and (not wanted <= claims or world["also"]):
            return f"whole, without {wanted - claims}"
        if "limits" in claims:
            low, high = np.array([[y if x is None else x for x, y in zip(r, (-np.inf, np.inf), strict=True)]
                                  for r in limits["position"]], dtype=float).T  # fmt: skip
            if ((self.q - self.off < low - SLACK) | (self.q + self.off > high + SLACK)).any():
                return "position limits"
        for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
            most = np.array([np.inf if x is None else x for x in limits.get(name, [])], dtype=float)
            off = self.rates if name == "velocity" else 0.0
            if name in claims and (np.abs(self.values[order]) + off > most * (1 + SLACK) + SLACK).any():
                return name
        if "torque" in claims:
            most = np.array([np.inf if x is None else x for x in limits["torque"]], dtype=float)
            rest = np.zeros(len(world["tracks"]))  # which carry nothing
            for q, v, a in zip(*self.values[:3], strict=True):
                found = pin.rnea(self.model, self.data, *(np.append(x, rest) for x in (q, v, a)))
                if (np.abs(found[: len(q)]) > most * (1 + SLACK) + SLACK).any():
                    return "torque"
        if (
            "duration" in claims
            and abs(world["motion"]["times"][-1] - world["motion"]["times"][0] - world["duration"]) > 2 * SLACK
        ):
            return "duration"
        for end, k in (("start", 0), ("goal", -1)):
            if end in claims and not any(self.there(x, end, k) for x in world[end]):
                return end
        return self.off_path() if "path" in claims else ""

    def there(self, target: World, end: str, k: int) -> bool:
        """Whether the motion is at a target at its end."""
        world = self.world
        if "poses" in target:
            tolerances = ("position_tolerance", "orientation_tolerance", "free")
            good = (self.near(self.link(x["link"], k), se3(x), *(x[y] for y in tolerances)) for x in target["poses"])
            return end == "goal" and all(good)
        lead = [i for i, x in enumerate(world["joints"]) if x["follows"] is None]
        names = {x["name"]: self.q[k][i] for i, x in enumerate(world["joints"])} | world["held"]
        off = np.abs(self.q[k][lead] - target["joints"])
        for n, i in enumerate(lead):
            if (
                world["limits"]["position"][i] == [None, None]
                and world["joints"][i]["kind"] == "revolute"
                and end == "goal"
            ):
                off[n] = abs((off[n] + np.pi) % (2 * np.pi) - np.pi)
        return bool((off < 2 * SLACK).all()) and all(abs(names[x] - y) < 2 * SLACK for x, y in target["others"].items())

    def near(self, frame: pin.SE3, to: pin.SE3, off: float, angle: float, free: str) -> bool:
        """Whether a frame is at another one, within tolerances."""
        if np.linalg.norm(frame.translation - to.translation) > off + SLACK:
            return False
        if free == "none":
            return bool(np.linalg.norm(pin.log3(to.rotation.T @ frame.rotation)) <= angle + SLACK)
        if free == "all":
            return True
        i = "xyz".index(free)
        return bool(np.arccos(np.clip(frame.rotation[:, i] @ to.rotation[:, i], -1, 1)) <= angle + SLACK)

    def off_path(self) -> str:
        """A path constraint that is not kept."""
        for constraint in self.world["path"]:
            first = None
            for k in range(len(self.at)):
                frame = self.link(constraint["link"], k)
                if constraint["kind"] == "upright":
                    up = (frame.rotation @ np.array(constraint["axis"], dtype=float))[2]
                    good = np.arccos(np.clip(up, -1, 1)) <= constraint["tolerance"] + SLACK
                elif constraint["kind"] == "position":
                    inner = se3(constraint).actInv(frame.act(np.array(constraint["point"], dtype=float)))
                    good = all(
                        s is None or abs(x) <= s / 2 + SLACK for x, s in zip(inner, constraint["size"], strict=True)
                    )
                else:
                    relative = self.link(constraint["to"], k).actInv(frame)
                    first = first or (relative if constraint["frame"] is None else se3(constraint["frame"]))
                    good = self.near(
                        relative, first, constraint["position_tolerance"], constraint["orientation_tolerance"], "none"
                    )
                if not good:
                    return f"path.{constraint['kind']} at {self.at[k]}"
        return ""


def judged(world: World, head: World, whole: bool) -> str:
    """What is false of an accepted proof in a world; nothing for what is true."""
    judge = Judge(world)
    return judge.claimed(head, whole) or judge.too_close(head)


# --- proofs and worlds ------------------------------------------------------------------------------------------------


@dataclass
class Case:
    """A world and a proof in it, taken apart."""

    world: World
    head: World
    cuts: dict[str, Any]
    counts: Any  # of leaves, of each pair
    depths: Any
    normals: Any
    rows: Any  # of rays
    ways: Any

    @classmethod
    def of(cls, scene: str) -> Case:
        """Plan and prove a shipped scene, as it is or with SIZES of what is unknown."""
        with tempfile.TemporaryDirectory() as folder:
            name, _, more = scene.partition(", ")
            file, motion = find_scene(name), Path(folder) / "motion.json"
            if more:
                (Path(folder) / "scene.yaml").write_text(with_sizes(file))
                file = Path(folder) / "scene.yaml"
            hdplan.plan(hdplan.load_scene(file), time_limit=60).save(motion)
            data = hdplan.prove(file, motion).data
            world = check(file, motion, data)[1]
        first, _, rest = zlib.decompress(data[len(MAGIC) :]).split(b"\n", 2)
        head, at = json.loads(first), 0
        sizes = [*((x, "<u2") for x in head["cuts"].values()), (head["pairs"], "<u4"), (head["leaves"], "<u1")]
        sizes += [(3 * head["leaves"], "<i4"), (head["rays"], "<u4"), (3 * head["rays"], "<i4")]
        arrays = []
        for count, kind in sizes:
            arrays.append(np.frombuffer(rest, kind, count, at).astype(np.int64))
            at += count * int(kind[2])
        *groups, counts, depths, normals, rows, ways = arrays
        cuts = dict(zip(head["cuts"], groups, strict=True))
        return cls(
            *(json.loads(json.dumps(world, default=plain)), head, cuts, counts, depths),
            *(normals.reshape(-1, 3), rows, ways.reshape(-1, 3)),
        )

    def packed(self) -> bytes:
        """The proof's file, whose head counts what there is."""
        head = {**self.head, "cuts": {k: len(x) for k, x in self.cuts.items()}, "pairs": len(self.counts)}
        head |= {"leaves": len(self.depths), "rays": len(self.rows)}
        parts = [(x, "<u2") for x in self.cuts.values()]
        parts += [
            (self.counts, "<u4"),
            (self.depths, "<u1"),
            (self.normals, "<i4"),
            (self.rows, "<u4"),
            (self.ways, "<i4"),
        ]
        lines = f"{json.dumps(head)}\nnull\n".encode()
        return MAGIC + zlib.compress(lines + b"".join(x.astype(kind).tobytes() for x, kind in parts), 1)


def with_sizes(file: Path) -> str:
    """A scene with SIZES of what is unknown; its files are named from everywhere."""
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    content["robot"] |= SIZES["robot"]
    for key in {"urdf", "srdf"} & {*content["robot"]}:
        content["robot"][key] = str(file.parent / content["robot"][key])
    for each in content["obstacles"]:
        each["uncertainty"] = SIZES["obstacle"]
    return yaml.safe_dump(content, sort_keys=False)


Place = tuple[Any, Any, str]  # a list or mapping, a key of it, and the path to it


def places(value: Any, path: str = "") -> Iterator[Place]:
    """All entries of a world; of long lists of numbers some."""
    keys = [*value] if isinstance(value, dict) else list(range(len(value)))
    if isinstance(value, list) and len(keys) > 60:
        keys = keys[:: len(keys) // 30]
    for key in keys:
        yield value, key, f"{path}.{key}"
        if isinstance(value[key], (dict, list)):
            yield from places(value[key], f"{path}.{key}")


def chosen(rng: Random, world: World, kinds: tuple[type, ...], within: str = "") -> Place:
    """A random entry of some kinds: first of the world's keys, so that none is drowned."""
    for _ in range(100):
        top = str(rng.choice(within.split() or [*world]))
        found = [x for x in places({top: world[top]}) if type(x[0][x[1]]) in kinds]
        if found:
            holder, key, path = found[int(rng.integers(len(found)))]
            return (world, key, path) if holder is not world and path == f".{top}" else (holder, key, path)
    raise ValueError(within)


def number(case: Case, rng: Random) -> None:
    """Change a number, a little or a lot."""
    holder, key, _ = chosen(rng, case.world, (float,))
    scale = 10.0 ** rng.uniform(-12, 1)
    holder[key] += float(scale * rng.normal())


def geometry(case: Case, rng: Random) -> None:
    """Change a number of bodies, joints, motions or rows a little."""
    holder, key, _ = chosen(rng, case.world, (float,), "bodies bodies joints motion tracks")
    holder[key] += float(10.0 ** rng.uniform(-5, -1) * rng.choice([-1, 1]))


def moved(case: Case, rng: Random) -> None:
    """Move or turn a body, a link or a joint as a whole."""
    group = case.world[str(rng.choice(["bodies", "joints"]))]
    entry = group[int(rng.integers(len(group)))]
    step = 10.0 ** rng.uniform(-5, -0.3)
    turn = Rotation.from_rotvec(rng.normal(size=3) * step * rng.integers(2)).as_matrix()
    entry["rotation"] = (turn @ np.reshape(entry["rotation"], (3, 3))).ravel().tolist()
    entry["position"] = (np.array(entry["position"]) + rng.normal(size=3) * step).tolist()
    entry["off"] = max(entry["off"], 1e-14)


def resized(case: Case, rng: Random) -> None:
    """Make a shape larger or smaller."""
    shape = case.world["bodies"][int(rng.integers(len(case.world["bodies"])))]["shape"]
    factor = 1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-5, 0)
    for key in ("points", "sweep") if rng.random() < 0.7 else ("sweep",):
        if key in shape:
            shape[key] = (np.array(shape[key]) * factor).tolist()


def sign(case: Case, rng: Random) -> None:
    """Turn the sign of a number."""
    holder, key, _ = chosen(rng, case.world, (float,))
    holder[key] = -holder[key]


def signs(case: Case, rng: Random) -> None:
    """Turn an axis, a row of a rotation, a position or a velocity."""
    holder, key, _ = chosen(rng, case.world, (list,), "joints bodies tracks links path goal")
    if all(type(x) in (int, float) for x in holder[key]):
        holder[key] = [-x for x in holder[key]]


def index(case: Case, rng: Random) -> None:
    """Change a whole number: a parent, a carrier, a corner, a follower's leader."""
    holder, key, _ = chosen(rng, case.world, (int,))
    holder[key] += int(rng.choice([-2, -1, 1, 2]))


def word(case: Case, rng: Random) -> None:
    """Exchange a word for another one of the world."""
    holder, key, _ = chosen(rng, case.world, (str,))
    _, _, other = chosen(rng, case.world, (str,))
    words = [h[k] for h, k, _ in places(case.world) if type(h[k]) is str]
    holder[key] = str(rng.choice([*words, "prismatic", "revolute", "obstacle", "none", "linear", "", other]))


def drop(case: Case, rng: Random) -> None:
    """Leave out an entry of a list or mapping."""
    holder, key, _ = chosen(rng, case.world, (dict, list, str, float, int))
    del holder[key]


def double(case: Case, rng: Random) -> None:
    """Repeat an entry of a list, or another one's value."""
    holder, key, _ = chosen(rng, case.world, (dict, list, float, int))
    if isinstance(holder, list):
        holder.insert(int(rng.integers(len(holder) + 1)), copy.deepcopy(holder[key]))
    else:
        holder[str(rng.choice([*holder]))] = copy.deepcopy(holder[key])


def exchange(case: Case, rng: Random) -> None:
    """Exchange two entries of a list or mapping: joints, bodies, rows, numbers."""
    holder, key, _ = chosen(rng, case.world, (dict, list, float))
    other = [*holder][int(rng.integers(len(holder)))] if isinstance(holder, dict) else int(rng.integers(len(holder)))
    holder[key], holder[other] = holder[other], holder[key]


def limit(case: Case, rng: Random) -> None:
    """Narrow a limit, a tolerance, a range, a clearance or a size, or change a target."""
    keys = [x for x in ("limits", "path", "goal", "start", "clearances", "loads", "sizes") if case.world.get(x)]
    holder, key, _ = chosen(rng, case.world, (float,), " ".join(keys))
    holder[key] *= float(1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, 0))


def excused(case: Case, rng: Random) -> None:
    """Leave a pair out, or compare one more, with or without its leaves."""
    listed, names = case.world["not_compared"], [x["name"] for x in case.world["bodies"]]
    if listed and rng.random() < 0.5:
        del listed[int(rng.integers(len(listed)))]
    else:
        reasons = [x[2] for x in listed] + ["the SRDF", "neighbours", "moving as one"]
        listed.append([*sorted(rng.choice(names, 2).tolist()), str(rng.choice(reasons))])
    if rng.random() < 0.5:
        pair = int(rng.integers(len(case.counts)))
        first = int(case.counts[:pair].sum())
        gone = np.arange(first, first + int(case.counts[pair]))
        case.depths, case.normals = np.delete(case.depths, gone), np.delete(case.normals, gone, axis=0)
        case.counts = np.delete(case.counts, pair)


def wild(case: Case, rng: Random) -> None:
    """Replace a value by something else."""
    holder, key, _ = chosen(rng, case.world, (dict, list, str, float, int, bool))
    some: list[Any] = [
        None,
        True,
        False,
        0,
        1,
        -1,
        10**9,
        1e300,
        1e-320,
        "",
        "x",
        [],
        {},
        [[]],
        [0.0, 0.0, 0.0],
        float("nan"),
    ]
    holder[key] = some[int(rng.integers(len(some)))]


def clearance(case: Case, rng: Random) -> None:
    """Claim another clearance."""
    key = str(rng.choice(["clearance", "self_clearance"]))
    if case.head[key] is not None:
        case.head[key] *= float(1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-8, 0.5))


def claims(case: Case, rng: Random) -> None:
    """Claim something else, something more or less."""
    content = {*case.head["claims"]} ^ {*rng.choice(sorted(CLAIMS), int(rng.integers(1, 3))).tolist()}
    case.head["claims"] = sorted(content)


def head(case: Case, rng: Random) -> None:
    """Change a value of the head."""
    some: list[Any] = [None, True, 0, -1, 0.5, 1e-9, "x", [], {}, ["limits", "limits"]]
    case.head[str(rng.choice([*case.head]))] = some[int(rng.integers(len(some)))]


def direction(case: Case, rng: Random) -> None:
    """Turn directions of leaves, exchange or turn them round."""
    for _ in range(int(rng.integers(1, 4))):
        i, j = rng.integers(len(case.normals), size=2)
        size = np.linalg.norm(case.normals[i])
        match int(rng.integers(3)):
            case 0:
                case.normals[i] = np.rint(case.normals[i] + rng.normal(size=3) * size * 10.0 ** rng.uniform(-6, 0.5))
            case 1:
                case.normals[i] = -case.normals[i]
            case _:
                case.normals[[i, j]] = case.normals[[j, i]]
    case.normals = case.normals.clip(-(2**31), 2**31 - 1)


def leaf(case: Case, rng: Random) -> None:
    """Drop, repeat or unite leaves, or change their depths."""
    i = int(rng.integers(len(case.depths)))
    pair = int(np.searchsorted(np.cumsum(case.counts), i, side="right"))
    if (way := int(rng.integers(4))) == 0:
        case.depths, case.normals = np.delete(case.depths, i), np.delete(case.normals, i, axis=0)
        case.counts[pair] -= 1
    elif way == 1:
        case.depths = np.insert(case.depths, i, case.depths[i])
        case.normals = np.insert(case.normals, i, case.normals[i], axis=0)
        case.counts[pair] += 1
    elif way == 2 and i + 1 < len(case.depths) and case.depths[i] == case.depths[i + 1] > 0:  # two halves as one
        case.depths, case.normals = np.delete(case.depths, i), np.delete(case.normals, i, axis=0)
        case.depths[i] -= 1
        case.counts[pair] -= 1
    else:
        case.depths[i] = int(rng.integers(60))


def groups(case: Case, rng: Random) -> None:
    """Divide a mesh otherwise, or name another body; or other rays."""
    names = [*case.cuts]
    if names and rng.random() < 0.7:
        name = str(rng.choice(names))
        if rng.random() < 0.2:
            case.cuts[str(rng.integers(len(case.world["bodies"])))] = case.cuts.pop(name)
        else:
            text, labels = case.cuts[name], np.unique(case.cuts[name])
            if rng.random() < 0.3:  # other numbers of the same groups
                case.cuts[name] = rng.permutation(labels.max() + 3)[text]
            else:
                rows = rng.integers(len(text), size=int(rng.integers(1, 5)))
                text[rows] = rng.choice([*labels, labels.max() + int(rng.integers(2))], size=len(rows))
    elif len(case.rows):
        i = int(rng.integers(len(case.rows)))
        if rng.random() < 0.5:
            case.rows[i] = int(rng.integers(60))
        else:
            case.ways[i] = -case.ways[i]
    else:
        leaf(case, rng)


def order(case: Case, rng: Random) -> None:
    """Exchange the leaves of two pairs."""
    ends = np.cumsum(case.counts)
    i, j = rng.integers(len(ends), size=2)
    parts = [np.arange(e - n, e) for e, n in zip(ends, case.counts, strict=True)]
    parts[i], parts[j] = parts[j], parts[i]
    case.counts[[i, j]] = case.counts[[j, i]]
    rows = np.concatenate(parts)
    case.depths, case.normals = case.depths[rows], case.normals[rows]


CHANGES: dict[str, Callable[[Case, Random], None]] = {
    f"world: {x.__name__}": x
    for x in (number, geometry, moved, resized, sign, signs, index, word, drop, double, exchange, limit, excused, wild)
}
CHANGES |= {f"proof: {x.__name__}": x for x in (clearance, claims, head, direction, leaf, groups, order)}


def outcome(case: Case, known: dict[str, str]) -> str:
    """What the kernel says of a changed world and proof, and the judge of what it accepts."""
    try:
        _, whole = accept(case.world, case.packed())
    except RejectedError:
        return "rejected"
    content = [case.world, case.head["claims"], case.head["clearance"], case.head["self_clearance"], whole]
    key = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    if key not in known:
        known[key] = judged(case.world, case.head, whole)
    return f"false: {known[key]}" if known[key] else "true"


def main() -> None:
    """Run the campaign from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=np.inf, help="of a processor, after which no more is changed")
    parser.add_argument("--scene", action="append", help=f"by default {', '.join(SCENES)}")
    parser.add_argument("--state", type=Path, help="a file with what was found, to go on where it was ended")
    options = parser.parse_args()
    names, tally = options.scene or SCENES, Tally(options.seed, options.state)
    cases, known, began = [Case.of(x) for x in names], dict[str, str](), time.process_time()
    kept = [pickle.dumps(x) for x in cases]
    for case, name in zip(cases, names, strict=True):
        if (verdict := outcome(case, known)) != "true":
            sys.exit(f"{name}: unchanged, {verdict}")
    for n in tally.numbers(options.count):
        if time.process_time() - began > options.seconds:
            break
        rng = np.random.default_rng([options.seed, n])
        kind, i = list(CHANGES)[n % len(CHANGES)], int(rng.integers(len(cases)))
        case = pickle.loads(kept[i])
        try:
            CHANGES[kind](case, rng)
            if rng.random() < 0.2:  # and another one
                CHANGES[str(rng.choice([*CHANGES]))](case, rng)
            case.packed()
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError):
            tally.add(kind, "not made")
            continue
        try:
            verdict = outcome(case, known)
        except Exception as error:
            verdict = f"error: {type(error).__name__}: {error}"
        if verdict == "rejected" and n % 10 == 0:
            try:
                found = "false" if judged(case.world, case.head, False) else "true"
            except Exception:
                found = "no world"
            tally.add(TEETH, found)
        tally.add(kind, verdict.partition(":")[0])
        if ":" in verdict:
            print(n, kind, names[i], verdict, file=sys.stderr, flush=True)
    tally.save()
    teeth: dict[str, int] = tally.found.pop(TEETH, {})
    print(tally.table(("rejected", "true", "false", "error", "not made")))
    print(f"of those rejected, the judge finds: {dict(teeth)}")


if __name__ == "__main__":
    main()
