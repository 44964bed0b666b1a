# ruff: noqa: D102
"""A world (`docs/world.md`) as the kernel holds it: pieces, pairs, and the joints' polynomials. No file is read here.

Obstacles that move do so by joints of their own, which follow the time. A mesh becomes the hull of its points, or the
hulls of groups of its triangles, which a proof chooses: whatever the groups, their hulls contain every triangle.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from .balls import CROSS, EPS, HERE, Ball, Pose, dot, inverse, joined, length, named, need, norm, stack, unit, up

VERSION = 3  # of the form
MOST_PAIRS = 1_000_000  # of pieces
LARGEST = 1e9  # of numbers
OFF = 1e-6  # most that a number of a world may be off
RULES, ROWS = ("linear", "cubic", "quintic"), ("positions", "velocities", "accelerations")  # of motions
REASONS = (  # for which pairs are not compared
    *("self_collision: false", "moving as one", "robot.ignore_pairs", "the SRDF", "neighbours", "touch_links"),
    "the MJCF",
)
KINDS = ("link", "held", "obstacle")
KINDS_OF_JOINTS = ("revolute", "prismatic")
FRAME = "rotation position off"
VALUES: dict[str, Any] = {  # of keys, wherever they stand: types, or how many numbers
    **dict.fromkeys(("name", "kind", "link", "to", "free"), str),
    **dict.fromkeys(("joint", "parent"), int),
    **dict.fromkeys(("off", "mass", "tolerance", "obstacles", "self"), float),
    **dict.fromkeys(("position_tolerance", "orientation_tolerance"), float),
    **dict.fromkeys(("axis", "way", "point", "moment"), (3,)),
    "inertia": (6,),
}


def numbers(value: Any, shape: tuple[int, ...], what: str) -> Any:
    """The finite numbers of a list of lists, as an array; -1 stands for any length."""
    try:
        found, flat = np.array(value, dtype=np.float64), value
        for _ in shape[1:] * (type(value) is list):
            flat = list(chain.from_iterable(flat))
        kinds = {value.dtype.type} if type(value) is np.ndarray else {*map(type, flat)}
        good = kinds <= {int, float, np.int64, np.float64} and found.ndim == len(shape)
        good = good and (found.shape == shape or all(b in (-1, a) for a, b in zip(found.shape, shape, strict=True)))
        good = good and bool(np.abs(found).max(initial=0.0) < LARGEST)
    except (TypeError, ValueError, OverflowError):  # of no numbers, or of rows of several lengths
        good = False
    need(good, f"{what}: {shape} finite numbers are expected")
    return found


def number(value: Any, what: str) -> float:
    """A finite number."""
    need(type(value) in (int, float) and abs(value) < LARGEST, f"{what}: a finite number is expected")
    return float(value)


def keys_of(value: Any, what: str, keys: str) -> list[Any]:
    """The values of a mapping that has just these keys, each of its kind."""
    names = keys.split()
    need(type(value) is dict and value.keys() == {*names}, f"{what}: a mapping with the keys {keys}")
    found = [value[name] for name in names]
    for i, kind in enumerate(map(VALUES.get, names)):
        if kind is float:
            found[i] = number(found[i], f"{what}.{names[i]}")
        elif type(kind) is tuple:
            found[i] = numbers(found[i], kind, f"{what}.{names[i]}")
        elif kind is not None:
            need(type(found[i]) is kind, f"{what}.{names[i]}: is of another kind")
    need("off" not in value or 0 <= value["off"] <= OFF, f"{what}.off: between 0 and {OFF:g} is expected")
    return found


def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A mapping in which no key appears twice."""
    need(len(pairs) == len({key for key, _ in pairs}), f"a key appears twice among {[key for key, _ in pairs][:9]}")
    return dict(pairs)


def loads(text: str | bytes) -> Any:
    """The content of JSON text without keys that stand twice."""

    def refuse(word: str) -> None:
        need(False, f"{word} is not a number")

    return json.loads(text, object_pairs_hook=unique, parse_constant=refuse)


def symmetric(six: Any) -> Any:
    """The symmetric matrix (3, 3) of xx, xy, xz, yy, yz, zz."""
    return six[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]


def unit_vector(axis: Any, off: float, what: str) -> Ball:
    """A direction: one of another length would be nearer to others, or farther from them, than it is turned."""
    way = Ball(axis, off)
    need(np.abs((way.mid * way.mid).sum() - 1) <= 8 * way.rad[0] + 1e-14, f"{what}: its axis must be a unit vector")
    return way


def placed(entries: list[tuple[str, Any]], keys: str = "") -> list[tuple[Any, ...]]:
    """The values of mappings with these keys and a frame, and their frames, which are examined all at once: each is a
    rotation but for its error, as what stretches would reach farther than it seems."""
    found = [keys_of(each, what, f"{keys} {FRAME}") for what, each in entries]
    if not found:
        return []
    turns, places, off = ([x[i] for x in found] for i in (-3, -2, -1))
    every = entries[0][0] if len(entries) == 1 else f"{entries[0][0]} to {entries[-1][0]}"
    r, at = numbers(turns, (-1, 9), f"{every}: rotation"), numbers(places, (-1, 3), f"{every}: position")
    r, rad = r.reshape(-1, 3, 3), np.zeros((len(r), 3, 3)) + np.array(off)[:, None, None]
    even = np.abs(np.einsum("kij,klj->kil", r, r) - HERE[0].mid) <= 20 * rad + 1e-14
    x, y, z = r.transpose(1, 2, 0)
    right = (x[1] * y[2] - x[2] * y[1]) * z[0] + (x[2] * y[0] - x[0] * y[2]) * z[1] + (x[0] * y[1] - x[1] * y[0]) * z[2]
    good = even.all(axis=(1, 2)) & (right > 0)
    need(good.all(), f"{entries[int(np.argmin(good))][0]}: must be a rotation")
    poses = ((Ball(r[i], rad[i]), Ball(at[i], rad[i, 0])) for i in range(len(found)))
    return [(*x[:-3], pose) for x, pose in zip(found, poses, strict=True)]


def shape_of(value: Any, what: str) -> tuple[Any, Any, Any, float]:
    """Points (m, 3), the numbers of those of each part (F, c), the semi-axes of the ellipsoids that sweep these (F, 3),
    or of one for all, and the points' error."""
    points, parts, sweep, off = keys_of(value, what, "points parts sweep off")
    points, sweep = (numbers(x, (-1, 3), f"{what}.{key}") for x, key in ((points, "points"), (sweep, "sweep")))
    found = np.arange(len(points))[None]
    if parts is not None:
        given = numbers(parts, (-1, -1), f"{what}.parts")
        found = given.astype(int)
        good = found.size and (found == given).all() and found.min() >= 0 and found.max() < len(points)
        need(good, f"{what}: has no parts, or one with a point that is not there")
    need(found.shape[1] != 3 or not sweep.any(), f"{what}: triangles are not swept")  # as more would be enclosed
    need(sweep.min(initial=0) >= 0 and len(sweep) in (1, len(found)), f"{what}: sizes for all, or each, of its parts")
    return points, found, sweep, off


@dataclass(eq=False)
class Joint:
    """A joint that moves; its pose is that of its frame at 0, in the frame of the joint before it (-1: the world)."""

    name: str
    parent: int
    pose: Pose
    axis: Ball
    turns: bool
    follows: tuple[int, float, float] | None = None  # another joint, at factor times its value + offset


@dataclass(eq=False)
class Piece:
    """The hull of corners, swept by an ellipsoid, in a frame that is fixed in that of a joint (-1: the world)."""

    name: str  # of the link, held object or obstacle
    kind: str  # which of the three: an obstacle may have the name of a link
    body: int  # the number of its body in the world, which several pieces may cover
    key: str  # what that is called
    joint: int
    pose: Pose
    corners: Any  # (m, 3)
    off: float = 0.0  # by how much the corners' numbers may be wrong
    sweep: Any = field(default_factory=lambda: np.zeros(3))  # (3,) semi-axes of the ellipsoid, along the frame's axes


@dataclass(eq=False)
class Bond:
    """Points (m, 3) in one joint's frame, or directions (`turns`), that are to be where others are in another's, off by
    at most `most`: the length of all differences as one vector, or of their parts `along` a direction."""

    what: str
    joint: int
    local: Ball
    other: int
    target: Ball
    most: float
    turns: bool = False
    along: Ball | None = None


def track(times: Any, values: Ball, now: Any) -> Ball:
    """A function of time, linear between `times` and constant outside of them."""
    i = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(times) - 2)
    share = (Ball(now) - times[i]) * inverse(Ball(times[i + 1]) - times[i])
    return values[i] + (values[i + 1] - values[i]) * Ball(np.clip(share.mid, 0.0, 1.0), share.rad)


def hermite(rows: list[Any], times: Any) -> Ball:
    """Control points (N - 1, d + 1, n) of the polynomials of degree d = 2 m - 1 that have m rows of values (N, n), and
    of their rates, at their ends: from either end, the i-th is the sum over k of binomials (i over k) times
    (d - k)! / d! width^k times the k-th rate, which backwards has the sign of (-1)^k."""
    degree, sides = 2 * len(rows) - 1, []
    for side, sign in ((slice(None, -1), 1.0), (slice(1, None), -1.0)):
        steps = [Ball(rows[0][side])]
        for k, rate in enumerate(rows[1:], 1):
            width = (Ball(times[1:]) - times[:-1])[:, None] * sign
            steps.append(rate[side] * math.prod([width] * k, start=Ball(1 / math.perm(degree, k), EPS)))
        for i in range(len(rows)):
            sides.append(sum((math.comb(i, k) * steps[k] for k in range(1, i + 1)), start=steps[0]))
    return stack([*sides[: len(rows)], *reversed(sides[len(rows) :])], 1)


def blossom(control: Ball, start: Any, end: Any) -> Ball:
    """Control points (k, d + 1, n) of parts of polynomials from `start` to `end` (k, 1, 1): the values of their
    blossoms."""
    made, degree = [], control.mid.shape[1] - 1
    for i in range(degree + 1):
        points = control
        for step in range(degree):
            cut = end if step < i else start
            points = points[:, :-1] * (1.0 - cut) + points[:, 1:] * cut
        made.append(points[:, 0])
    return stack(made, 1)


class World:
    """A world: pieces of the robot, of held objects and of obstacles, their pairs, and the motion."""

    def __init__(self, content: Any, cuts: dict[str, Any]) -> None:
        """Take the content of a world's file, and a proof's groups of the triangles of meshes."""
        keys = "joints held links bodies tracks not_compared clearances motion limits path start goal duration also"
        need(type(content) is dict, "the world: a mapping is expected")
        version, joints, self.held, links, bodies, tracks, apart, clearances, motion, *rest, self.loads, sizes = (
            keys_of({"loads": None, "sizes": None, **content}, "the world", f"hdplan_world {keys} loads sizes")
        )
        self.limits, self.path, self.start, self.goal, self.duration, self.also = rest  # which `effects` reads
        need(version == VERSION, f"the world is not of version {VERSION}")
        self.joints, self.cuts = list[Joint](), cuts
        read = placed([(f"joints[{i}]", x) for i, x in enumerate(joints)], "name parent kind axis follows")
        for i, each in enumerate(read):
            self.add_joint(f"joints[{i}]", len(read), *each)
        leaders = [x.follows[0] for x in self.joints if x.follows]
        need(all(self.joints[i].follows is None for i in leaders), "joints: one that is followed follows another one")
        self.own = len(self.joints)  # joints of the robot; the others follow the time
        numbers(list(self.held.values()), (-1,), "held")
        read = placed([(f"links.{name}", x) for name, x in links.items()], "joint")
        self.links = {
            name: (self.carrier(f"links.{name}", x), pose) for name, (x, pose) in zip(links, read, strict=True)
        }
        self.read_motion(motion)
        self.tracks = list[tuple[Any, Ball]]()  # of joints that follow the time: times, and values there
        for i, each in enumerate(tracks):
            self.add_track(f"tracks[{i}]", each)
        self.pieces, self.parts = list[Piece](), dict[str, Any]()  # parts: of each body, by the numbers of their points
        self.counts = dict[tuple[str, str], int]()  # of bodies of each name and kind
        self.surfaces = dict[int, tuple[Ball, Any]]()  # of divided meshes: points, and triangles by their numbers
        for i, each in enumerate(placed([(f"bodies[{i}]", x) for i, x in enumerate(bodies)], "name kind shape joint")):
            self.add_body(i, *each)
        self.lay_tracks()
        from .unknown import Unknown

        self.unknown = None if sizes is None else Unknown(self, sizes)
        self.pair_up(apart)
        self.stack_up()
        self.usual, own, self.among = keys_of(clearances, "clearances", "obstacles own self")
        self.clearances = {name: number(x, f"clearances.own.{name}") for name, x in own.items()}
        obstacles = {x.name for x in self.pieces if x.kind == "obstacle"}
        need({*own} <= obstacles, "clearances.own: of no obstacle")

    def add_joint(
        self, what: str, count: int, name: str, parent: int, kind: str, axis: Any, follows: Any, pose: Pose
    ) -> None:
        good = -1 <= parent < len(self.joints) and kind in KINDS_OF_JOINTS and name not in self.held
        need(good and name not in [x.name for x in self.joints], f"{what}: name, kind or parent")
        if follows is not None:
            need(type(follows) is list and len(follows) == 3 and type(follows[0]) is int, f"{what}.follows")
            factor, add = numbers(follows[1:], (2,), what).tolist()
            need(0 <= follows[0] < count and factor, f"{what}.follows: no joint of the world, or by the factor 0")
            follows = (follows[0], factor, add)
        way = unit_vector(axis, pose[1].rad, what)
        self.joints.append(Joint(name, parent, pose, way, kind == "revolute", follows))

    def carrier(self, what: str, joint: int, timed: bool = False) -> int:
        """The joint that carries a frame. Obstacles are carried by joints that follow the time (`timed`), and nothing
        else is."""
        good = joint == -1 or (0 <= joint < len(self.joints) and (joint >= self.own) == timed)
        need(good, f"{what}.joint: no joint that may carry it")
        return joint

    def add_body(self, number: int, name: str, kind: str, shape: Any, joint: int, pose: Pose) -> None:
        """Note a body as pieces: a mesh as its hull, or as the hulls of the groups of its triangles."""
        what = f"bodies[{number}]"
        need(kind in KINDS, f"{what}.kind: {', '.join(KINDS)}")
        last = KINDS.index(self.pieces[-1].kind) if self.pieces else 0
        need(KINDS.index(kind) >= last, f"{what}: links, held objects, obstacles, in order")
        consistent = kind == "obstacle" or (name in self.links) == (kind == "link")
        need(consistent, f"{what}: '{name}' is a link, or is to be one")
        before = self.counts.get((name, kind), 0)
        need(kind == "link" or not before, f"{what}: the name '{name}' is taken")
        self.carrier(what, joint, kind == "obstacle")
        called = f"{named(name)} {before}" if kind == "link" else f"{'obstacle ' * (kind == 'obstacle')}{named(name)}"
        own, key, self.counts[name, kind] = (name, kind, number, called, joint, pose), str(number), before + 1
        points, parts, sweep, off = shape_of(shape, what)
        self.parts[key], groups, used = parts, self.cuts.get(key), np.zeros(len(points), dtype=bool)
        used[parts] = True  # which is quicker than `unique`, once
        together: list[Any] = [(slice(None), used)]
        if groups is not None:
            need(groups.shape == parts.shape[:1], f"{what}: has {len(parts)} parts, not {len(groups)}")
            order = np.argsort(groups, kind="stable")
            split = np.split(order, np.flatnonzero(np.diff(groups[order])) + 1)
            together = [(rows, np.unique(parts[rows])) for rows in split]
        for rows, corners in together:
            size = (sweep[rows] if len(sweep) > 1 else sweep).max(axis=0)
            self.pieces.append(Piece(*own, points[corners], off, size))
        if parts.shape[1] == 3 and len(together) > 1:
            self.surfaces[number] = dot("ij,mj->mi", pose[0], Ball(points, off)) + pose[1], parts

    def read_motion(self, content: Any) -> None:
        """Make the control points (N - 1, d + 1, n) of the polynomial between each two rows, of all joints."""
        rule: Any = content.get("rule") if type(content) is dict else None
        need(rule in RULES, "motion.rule: linear, cubic or quintic")
        names = ROWS[: RULES.index(rule) + 1]
        times, *rows = keys_of(content, "motion", f"rule times {' '.join(names)}")[1:]
        lead = [i for i, x in enumerate(self.joints) if x.follows is None]
        given = [numbers(x, (-1, len(lead)), f"motion.{name}") for x, name in zip(rows, names, strict=True)]
        count, self.rows, self.lead, self.given = len(given[0]), given[0], lead, given
        good = count >= 2 and 1 <= len(lead) <= 60 and all(len(x) == count for x in given)
        need(good and (times or rule == "linear"), "motion: too few rows, or too many joints, or rates without times")
        self.times: Any = None
        if times is not None:
            self.times = numbers(times, (count,), "motion.times")
            need((np.diff(self.times) > 0).all(), "motion.times: must increase")
        made, columns = hermite(given, self.times), []
        for i, joint in enumerate(self.joints):
            other, factor, add = joint.follows or (i, 1.0, 0.0)
            column = made[:, :, lead.index(other)]
            columns.append(column * factor + add if joint.follows else column)
        self.curve = self.control = stack(columns, 2)  # of the robot alone
        self.clock: Any = self.times

    def add_track(self, what: str, each: Any) -> None:
        """Note a joint that follows the time: along or about `way`, by its length times values at times."""
        name, parent, kind, way, times, values, off = keys_of(each, what, "name parent kind way times values off")
        need(self.times is not None, f"{what}: moves, and the motion has no times")
        before = parent == -1 or self.own <= parent < len(self.joints)
        need(before and kind in KINDS_OF_JOINTS, f"{what}: kind or parent")
        at = numbers(times, (-1,), f"{what}.times")
        way, shares = Ball(way, off), Ball(numbers(values, at.shape, f"{what}.values"), off)
        need(len(at) > 1 and (np.diff(at) > 0).all(), f"{what}: times must increase")
        self.joints.append(Joint(name, parent, HERE, unit(way), kind == "revolute"))
        self.tracks.append((at, shares * length(way)))

    def lay_tracks(self) -> None:
        """Add what obstacles do to the motion, whose intervals end where that changes; note what each joint carries."""
        rows_at, degree = self.times, self.control.mid.shape[1] - 1
        if self.tracks:
            knots = np.concatenate([rows_at, *(span for span, _ in self.tracks)])
            self.times = times = np.unique(knots[(knots >= rows_at[0]) & (knots <= rows_at[-1])])
            row: Any = np.searchsorted(rows_at, times[:-1], side="right") - 1
            share = inverse(Ball(rows_at[row + 1]) - rows_at[row])
            start, end = ((Ball(x) - rows_at[row]) * share for x in (times[:-1], times[1:]))
            columns = [blossom(self.control[row], start[:, None, None], end[:, None, None])]
            for span, values in self.tracks:
                at = track(span, values, times)
                steps = [(at[1:] - at[:-1]) * (Ball(i) * Ball(1 / degree, EPS)) for i in range(degree + 1)]
                columns.append(stack([at[:-1] + step for step in steps], 1)[:, :, None])
            self.control = joined(columns, 2)
        count = len(self.joints)
        self.carried = np.zeros((count + 1, count), dtype=bool)  # by which joints; the last row: the world
        for i, each in enumerate(self.joints):
            self.carried[i] = self.carried[each.parent]
            self.carried[i, i] = True

    def pair_up(self, left_out: Any) -> None:
        """List the pairs of pieces to be kept apart (P, 2), and the pieces that are to be outside of divided meshes."""
        pieces, robot = self.pieces, [x for x in self.pieces if x.kind != "obstacle"]
        joint, own = {x.name: x.joint for x in robot}, len(robot)
        need(all(joint[x.name] == x.joint for x in robot), "bodies: those of one name are carried by one joint")
        self.left_out = dict[tuple[str, str], str]()
        for i, each in enumerate(left_out):
            good = type(each) is list and len(each) == 3 and {*each[:2]} <= {*joint} and each[2] in REASONS
            need(good and each[0] != each[1], f"not_compared[{i}]: two links or held objects, and a reason")
            one, two, why = each
            need(joint[one] == joint[two] or why != "moving as one", f"not_compared[{i}]: the two do move")
            self.left_out[one, two] = self.left_out[two, one] = why
        need(own * len(pieces) <= MOST_PAIRS, "there are more pairs of pieces than can be checked")
        self.leaving = np.zeros(len(pieces)) if self.unknown is None else self.unknown.speed  # of what may move away
        place, still = {name: i for i, name in enumerate(joint)}, np.array([x.joint for x in pieces]) == -1
        excused = np.eye(len(joint), dtype=bool)
        for one, two in self.left_out:
            excused[place[one], place[two]] = True
        robots = np.array([place[x.name] for x in robot], dtype=np.int64)
        apart = ~(still[:own, None] & still & (self.leaving == 0))
        apart[:, :own] = ~excused[robots[:, None], robots]
        self.pairs = np.argwhere(np.triu(apart, 1))
        met = [(pieces[a], pieces[b]) for a, b in self.pairs.tolist()] if self.surfaces else []
        near = sorted({(a.body, b.body) for a, b in met if not a.kind == b.kind == "link"})  # of links it is assumed
        ways = [way for a, b in near for way in ((a, b), (b, a)) if way[0] in self.surfaces]
        self.outside = [(mesh, each) for mesh, other in ways for each in self.connected(other)]
        self.within = self.pairs[:, 1] < own  # pairs of the robot with itself

    def stack_up(self) -> None:
        """Collect joints (n, ...) and pieces (g, ...) in arrays, with the centres of balls around the pieces, in the
        frames of their joints, and the balls' radii."""

        def of(each: Any, *shape: int) -> Any:
            return np.array([each(x) for x in self.pieces]).reshape(-1, *shape)

        def pose(i: int, *shape: int) -> Ball:
            return Ball(of(lambda x: x.pose[i].mid, *shape), of(lambda x: x.pose[i].rad, *shape))

        self.turning = np.array([x.turns for x in self.joints])
        self.axis = stack([x.axis for x in self.joints])
        self.origins, still = stack([x.pose[1] for x in self.joints]), stack([x.pose[0] for x in self.joints])
        about, along = dot("ijk,nk->nij", CROSS, self.axis), dot("nij,nj->ni", still, self.axis)
        once = dot("nij,njk->nik", still, about) * self.turning[:, None, None]
        self.turns = still, once, dot("nij,njk->nik", once, about)  # by a: still + sin a once + (1 - cos a) twice
        self.along = along * ~self.turning[:, None]
        self.joint, self.off = of(lambda x: x.joint).astype(int), of(lambda x: x.off)
        self.turn, self.at, self.sweep = pose(0, 3, 3), pose(1, 3), of(lambda x: x.sweep, 3)
        corners = np.concatenate([np.zeros((0, 3)), *(x.corners for x in self.pieces)])
        count = of(lambda x: len(x.corners)).astype(int)
        begins, piece = np.cumsum(count) - count, np.repeat(np.arange(len(count)), count)
        self.size = np.maximum.reduceat(np.abs(corners), begins)
        low, high = np.minimum.reduceat(corners, begins), np.maximum.reduceat(corners, begins)
        middle = (low + high) / 2  # of the box around the corners, nearly
        self.centers = dot("gij,gj->gi", self.turn, middle) + self.at
        away = norm(up(np.abs(corners - middle[piece]) + self.off[piece, None]))
        self.radii = up(np.maximum.reduceat(away, begins) + self.sweep.max(axis=1))
        self.movers = np.flatnonzero(self.joint >= 0)  # the pieces that move
        self.slot = np.cumsum(self.joint >= 0) - 1  # of each of these among them

    def connected(self, body: int) -> list[list[Piece]]:
        """The pieces of a body, those together that hang together, as they share corners."""
        own = [x for x in self.pieces if x.body == body]
        piece = np.repeat(np.arange(len(own)), [len(x.corners) for x in own])
        corner = np.unique(np.concatenate([x.corners for x in own]), axis=0, return_inverse=True)[1].ravel()
        label, last = np.arange(len(own)), np.array([-1])
        while (label != last).any():  # the least of all that share a corner
            last, least = label.copy(), np.full(len(corner), len(own))
            np.minimum.at(least, corner, label[piece])
            np.minimum.at(label, piece, least[corner])
        return [[x for x, y in zip(own, label, strict=True) if y == one] for one in np.unique(label)]
