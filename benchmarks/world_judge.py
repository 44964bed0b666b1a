"""A world as the checker of proofs has it, judged by Pinocchio and coal, without hdplan and without the kernel.

At MOMENTS of the motion bodies must be as far apart as stated, and limits, torques, path constraints, start, goal and
duration must be kept as claimed. Where a world has sizes of what is unknown, every unknown goes to the edge that brings
two bodies together.
"""

from __future__ import annotations

import itertools
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.interpolate import BPoly
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

World = dict[str, Any]

MOMENTS = 200
WORST = 4  # moments of a pair at which what is unknown goes to its edges
WAYS = ((0.6180339, 0.3247179, 0.7161573), (-0.7548776, 0.5698402, 0.2360679), (0.1415926, -0.7182818, -0.5772156))
SLACK = 1e-6  # [m, rad or of a limit]: coal's and Pinocchio's own errors, and what the kernel lets ends be off
BALL = Rotation.random(400, rng=np.random.default_rng(0)).apply([0.0, 0.0, 1.0])


def se3(frame: World) -> pin.SE3:
    return pin.SE3(np.reshape(frame["rotation"], (3, 3)).astype(float), np.array(frame["position"], dtype=float))


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
        size = parts.shape[1]
        ways = itertools.combinations_with_replacement(range(size), 3) if size != 3 else [range(3)]
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
    """True if rays from a point meet triangles (F, 3, 3) an odd number of times, whatever their way: of a surface that
    a change has opened, one way alone says nothing."""
    return all(odd(point, corners, np.array(way)) for way in WAYS)


def odd(point: Any, corners: Any, way: Any) -> bool:
    """True if a ray along a way meets triangles (F, 3, 3) an odd number of times."""
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
        found = (own[i] if i in own else abs(x["follows"][1]) * own[x["follows"][0]] for i, x in enumerate(joints))
        return np.fromiter(found, float)

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
            full = np.zeros((len(self.at), len(joints)))
            if order < curve.c.shape[0]:
                found = (curve.derivative(order) if order else curve)(self.at)
                for i, x in enumerate(joints):
                    j, factor, add = x["follows"] or (i, 1.0, 0.0)
                    full[:, i] = factor * found[:, column[j]] + (0.0 if order else add)
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
            rates = [np.where(self.turns, np.cross(axes, x - points), axes) @ way for x in (a, b)]
            pull = self.follow.T @ (rates[0] * moves[0] - rates[1] * moves[1])  # by how much a joint parts the two
            q = self.q[k] - self.follow @ (np.sign(pull) * self.off)
            pin.forwardKinematics(self.model, self.data, np.append(q, [x[k] for x in self.followed]))
            places = [self.data.oMi[x["joint"] + 1].homogeneous @ se3(x).homogeneous for x in (one, two)]
            places[0] = turned(places[0], about, -np.cross(a - about, way), base["turn"])
            places[1] = turned(places[1], origin, np.cross(b - origin, way), own["turn"])
        away, _, _ = apart(shape, places[0], other, places[1])
        return float(min(best, away - shift))

    def contained(self, i: int, j: int, places: list[Any], centers: Any) -> str:
        """True if one of two bodies is within the other: surfaces that never meet stay as they are at the beginning."""
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
            low, high = np.array(limits["position"], dtype=float).T  # None becomes NaN, which nothing is beyond
            if ((self.q - self.off < low - SLACK) | (self.q + self.off > high + SLACK)).any():
                return "position limits"
        for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
            most = np.array(limits.get(name, []), dtype=float)
            off = self.rates if name == "velocity" else 0.0
            if name in claims and (np.abs(self.values[order]) + off > most * (1 + SLACK) + SLACK).any():
                return name
        if "torque" in claims:
            most = np.array(limits["torque"], dtype=float)
            rest = np.zeros(len(world["tracks"]))  # which carry nothing
            for q, v, a in zip(*self.values[:3], strict=True):
                found = pin.rnea(self.model, self.data, *(np.append(x, rest) for x in (q, v, a)))
                if (np.abs(found[: len(q)]) > most * (1 + SLACK) + SLACK).any():
                    return "torque"
        times = world["motion"]["times"]
        if "duration" in claims and abs(times[-1] - times[0] - world["duration"]) > 2 * SLACK:
            return "duration"
        for end, k in (("start", 0), ("goal", -1)):
            if end in claims and not any(self.there(x, end, k) for x in world[end]):
                return end
        return self.off_path() if "path" in claims else ""

    def there(self, target: World, end: str, k: int) -> bool:
        """True if the motion is at a target at its end."""
        world = self.world
        if "poses" in target:
            tolerances = ("position_tolerance", "orientation_tolerance", "free")
            good = (self.near(self.link(x["link"], k), se3(x), *(x[y] for y in tolerances)) for x in target["poses"])
            return end == "goal" and all(good)
        lead = [i for i, x in enumerate(world["joints"]) if x["follows"] is None]
        names = {x["name"]: self.q[k][i] for i, x in enumerate(world["joints"])} | world["held"]
        off = np.abs(self.q[k][lead] - target["joints"])
        for n, i in enumerate(lead):
            turns = world["joints"][i]["kind"] == "revolute" and world["limits"]["position"][i] == [None, None]
            if turns and end == "goal":
                off[n] = abs((off[n] + np.pi) % (2 * np.pi) - np.pi)
        return bool((off < 2 * SLACK).all()) and all(abs(names[x] - y) < 2 * SLACK for x, y in target["others"].items())

    def near(self, frame: pin.SE3, to: pin.SE3, off: float, angle: float, free: str) -> bool:
        """True if a frame is at another one, within tolerances."""
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
                    size = np.array([np.inf if s is None else s for s in constraint["size"]])
                    good = (np.abs(inner) <= size / 2 + SLACK).all()
                else:
                    relative = self.link(constraint["to"], k).actInv(frame)
                    first = first or (relative if constraint["frame"] is None else se3(constraint["frame"]))
                    tolerances = constraint["position_tolerance"], constraint["orientation_tolerance"]
                    good = self.near(relative, first, *tolerances, "none")
                if not good:
                    return f"path.{constraint['kind']} at {self.at[k]}"
        return ""


def judged(world: World, head: World, whole: bool) -> str:
    """Claims of an accepted proof that are false in a world; none if all are true."""
    judge = Judge(world)
    return judge.claimed(head, whole) or judge.too_close(head)
