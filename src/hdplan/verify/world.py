# ruff: noqa: D102
"""A world (`docs/world.md`) as the kernel holds it: pieces, pairs, and the joints' polynomials. No file is read here.

Obstacles that move do so by joints of their own, which follow the time. A mesh becomes the hull of its points, or the
hulls of groups of its triangles, which a proof chooses: whatever the groups, their hulls contain every triangle.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from .balls import EPS, HERE, Ball, Pose, compose, dot, inverse, length, named, need, norm, stack, turn_of, unit, up

MOST_PAIRS = 1_000_000  # of pieces
OFF = 1e-6  # most that a number of a world may be off
LEAST_TURN = 2e-6  # of an obstacle from one pose to the next; what turns less has a rotation that is off by as much
RATES = ("velocities", "accelerations")
RULES = {"linear": 0, "cubic": 1, "quintic": 2}  # of motions, by how many rates they have
REASONS = (  # for which pairs are not compared
    *("self_collision: false", "moving as one", "robot.ignore_pairs", "the SRDF", "neighbours", "touch_links"),
    "the MJCF",
)
KINDS = ("link", "held", "obstacle")
SHAPES = {  # and their sizes
    **{"box": "size", "sphere": "radius", "ellipsoid": "radii", "cylinder": "radius length"},
    **{"capsule": "radius length", "points": "points", "mesh": "points triangles off"},
    **{"balls": "points radii", "boxes": "low high"},
}
CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
CUBE.flags.writeable = False
FRAME = "joint rotation position off"


def numbers(value: Any, shape: tuple[int, ...], what: str) -> Any:
    """The finite numbers of a list of lists, as an array; -1 stands for any length."""
    try:
        found, flat = np.array(value, dtype=np.float64), value if shape else [value]
        for _ in shape[1:] * (type(value) is list):
            flat = list(chain.from_iterable(flat))
        kinds = {value.dtype.type} if type(value) is np.ndarray else {*map(type, flat)}
        good = kinds <= {int, float, np.int64, np.float64} and found.ndim == len(shape)
        good = good and (found.shape == shape or all(b in (-1, a) for a, b in zip(found.shape, shape, strict=True)))
        good = good and bool(np.abs(found).max(initial=0.0) < 1e9)
    except (TypeError, ValueError, OverflowError):  # of no numbers, or of rows of several lengths
        good = False
    need(good, f"{what}: {shape or 'one'} finite numbers are expected")
    return found


def number(value: Any, what: str) -> float:
    """A finite number."""
    need(type(value) in (int, float) and abs(value) < 1e9, f"{what}: one finite number is expected")
    return float(value)


def keys_of(value: Any, what: str, keys: str) -> list[Any]:
    """The values of a mapping that has just these keys."""
    names = keys.split()
    need(type(value) is dict and {*value} == {*names}, f"{what}: a mapping with the keys {', '.join(names)}")
    return [value[name] for name in names]


def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A mapping in which no key stands twice."""
    need(len(pairs) == len({key for key, _ in pairs}), f"a key stands twice among {[key for key, _ in pairs][:9]}")
    return dict(pairs)


def loads(text: str | bytes) -> Any:
    """The content of JSON text without keys that stand twice."""
    return json.loads(text, object_pairs_hook=unique, parse_constant=lambda word: need(False, f"{word} is no number"))


def symmetric(six: Any) -> Any:
    """The symmetric matrix (3, 3) of xx, xy, xz, yy, yz, zz."""
    return six[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]


def off_of(value: Any, what: str) -> float:
    """By how much numbers may be wrong."""
    off = number(value, f"{what}.off")
    need(0 <= off <= OFF, f"{what}.off: between 0 and {OFF:g} is expected")
    return off


def unit_vector(axis: Any, off: Any, what: str) -> Ball:
    """A direction: one of another length would be nearer to others, or farther from them, than it is turned."""
    way = Ball(numbers(axis, (3,), what), off_of(off, what))
    need(np.abs((way.mid * way.mid).sum() - 1) <= 8 * way.rad[0] + 1e-14, f"{what}: its axis is no unit vector")
    return way


def frame(place: list[Any], what: str) -> Pose:
    """A frame, which is a rotation but for its error: what stretches would reach farther than it seems."""
    rotation, position, off = place
    r, at, e = numbers(rotation, (9,), what).reshape(3, 3), numbers(position, (3,), what), off_of(off, what)
    x, y, z = r.tolist()
    right = (x[1] * y[2] - x[2] * y[1]) * z[0] + (x[2] * y[0] - x[0] * y[2]) * z[1] + (x[0] * y[1] - x[1] * y[0]) * z[2]
    need(np.abs(r @ r.T - HERE[0].mid).max() <= 20 * e + 1e-14 and right > 0, f"{what}: is no rotation")
    return Ball(r, np.full((3, 3), e)), Ball(at, np.full(3, e))


def shape_of(value: Any, what: str) -> tuple[Any, Any, float, Any]:
    """Points (m, 3), their error and the sweeping ellipsoid's semi-axes; of what may be divided, which points each part
    has (F, c): the corners of triangles and boxes, or the centres of balls, with an ellipsoid for each."""
    kind: Any = value.get("type") if type(value) is dict else None
    need(kind in SHAPES, f"{what}: a shape of a kind that is not known")
    _, first, *rest = keys_of(value, what, f"type {SHAPES[kind]}")
    none = np.zeros(3)
    if kind in ("points", "balls", "boxes", "mesh"):
        points = numbers(first, (-1, 3), what)
        every = np.arange(len(points))[:, None]
        need(len(points), f"{what}: has no points")
        if kind == "points":
            return points, None, 0.0, none
        if kind == "balls":
            radii = numbers(rest[0], (len(points),), what)
            need(radii.min() >= 0, f"{what}: a radius is negative")
            return points, every, 0.0, np.repeat(radii[:, None], 3, axis=1)
        if kind == "boxes":
            corners = np.where(CUBE > 0, numbers(rest[0], points.shape, what)[:, None], points[:, None])
            return corners.reshape(-1, 3), 8 * every + np.arange(8), 0.0, none
        faces = numbers(rest[0], (-1, 3), what)
        good = len(faces) and (faces % 1 == 0).all() and faces.min() >= 0 and faces.max() < len(points)
        need(good, f"{what}: has no triangles, or one with a point that is not there")
        return points, faces.astype(int), off_of(rest[1], what), none
    three = numbers(first if kind in ("box", "ellipsoid") else [first] * 3, (3,), what)
    length = number(rest[0], what) if rest else 0.0
    need(three.min() >= 0 <= length, f"{what}: a size is negative")
    if kind == "box":
        return CUBE * three, None, 0.0, none
    return CUBE[:2] * [0, 0, length], None, 0.0, three * [1, 1, kind != "cylinder"]


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


def track(times: list[float], values: list[Ball], now: float) -> Ball:
    """What is linear between times and constant outside of them."""
    if not times[0] < now < times[-1]:
        return values[0] if now <= times[0] else values[-1]
    i = max(k for k, x in enumerate(times) if x <= now)
    return values[i] + (values[i + 1] - values[i]) * ((Ball(now) - times[i]) * inverse(Ball(times[i + 1]) - times[i]))


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
    """What is to be kept apart: pieces of the robot, of what it holds and of obstacles, their pairs, and the motion."""

    def __init__(self, said: Any, cuts: dict[str, Any]) -> None:
        """Take the content of a world's file, and a proof's groups of the triangles of meshes."""
        keys = "joints held links bodies motions not_compared clearances motion limits path start goal duration also"
        need(type(said) is dict, "the world: a mapping is expected")
        version, joints, self.held, links, bodies, motions, apart, clearances, motion, *rest, self.loads = keys_of(
            {"loads": None, **said}, "the world", f"hdplan_world {keys} loads"
        )
        self.limits, self.path, self.start, self.goal, self.duration, self.also = rest  # what `effects` is about
        need(version == 2, "the world is not of version 2")
        self.joints, self.cuts = list[Joint](), cuts
        for i, each in enumerate(joints):
            self.add_joint(f"joints[{i}]", each, len(joints))
        leaders = [x.follows[0] for x in self.joints if x.follows]
        need(all(self.joints[i].follows is None for i in leaders), "joints: one that is followed follows another one")
        self.own = len(self.joints)  # joints of the robot; the others follow the time
        numbers(list(self.held.values()), (-1,), "held")
        self.links = {
            name: self.carried_frame(keys_of(x, f"links.{name}", FRAME), f"links.{name}") for name, x in links.items()
        }
        self.read_motion(motion)
        self.tracks = list[tuple[list[float], list[Ball]]]()  # of joints that follow the time: times and values there
        self.drifting = {name: self.drift(name, x) for name, x in motions.items()}
        self.pieces, self.parts = list[Piece](), dict[str, Any]()
        self.surfaces = dict[int, tuple[Ball, Any]]()  # of divided meshes: points, and triangles by their numbers
        for i, each in enumerate(bodies):
            self.add_body(i, each)
        self.lay_tracks()
        self.pair_up(apart)
        self.stack_up()
        usual, own, among = keys_of(clearances, "clearances", "obstacles own self")
        self.usual, self.among = (number(x, "clearances") for x in (usual, among))
        self.clearances = {name: number(x, f"clearances.own.{name}") for name, x in own.items()}
        obstacles = {x.name for x in self.pieces if x.kind == "obstacle"}
        need({*motions} | {*own} <= obstacles, "motions, clearances.own: of no obstacle")

    def add_joint(self, what: str, each: Any, count: int) -> None:
        name, parent, kind, rotation, position, axis, off, follows = keys_of(
            each, what, "name parent kind rotation position axis off follows"
        )
        good = type(name) is str and type(parent) is int and -1 <= parent < len(self.joints)
        good = good and kind in ("revolute", "prismatic") and name not in self.held
        need(good and name not in [x.name for x in self.joints], f"{what}: name, kind or parent")
        way = unit_vector(axis, off, what)
        if follows is not None:
            need(type(follows) is list and len(follows) == 3 and type(follows[0]) is int, f"{what}.follows")
            factor, add = numbers(follows[1:], (2,), what).tolist()
            need(0 <= follows[0] < count and factor, f"{what}.follows: no joint of the world, or by the factor 0")
            follows = (follows[0], factor, add)
        pose = frame([rotation, position, off], what)
        self.joints.append(Joint(name, parent, pose, way, kind == "revolute", follows))

    def carried_frame(self, values: list[Any], what: str) -> tuple[int, Pose]:
        """The joint that carries a frame, and the frame in the joint's, by the values of FRAME."""
        joint, *place = values
        need(type(joint) is int and -1 <= joint < self.own, f"{what}.joint: no joint of the world")
        return joint, frame(place, what)

    def add_body(self, number: int, each: Any) -> None:
        """Note a body as pieces: a mesh as its hull, or as the hulls of the groups of its triangles."""
        what = f"bodies[{number}]"
        name, kind, shape, *place = keys_of(each, what, f"name kind shape {FRAME}")
        need(type(name) is str and kind in KINDS, f"{what}: name or kind")
        last = KINDS.index(self.pieces[-1].kind) if self.pieces else 0
        need(KINDS.index(kind) >= last, f"{what}: links, held objects, obstacles, in order")
        as_said = kind == "obstacle" or (name in self.links) == (kind == "link")
        need(as_said, f"{what}: '{name}' is a link, or is to be one")
        taken = kind != "link" and (name, kind) in {(x.name, x.kind) for x in self.pieces}
        need(not taken, f"{what}: the name '{name}' is taken")
        joint, pose = self.carried_frame(place, what)
        if kind == "obstacle":
            need(joint == -1, f"{what}: an obstacle is carried by no joint")
            joint, turn = self.drifting.get(name, (-1, HERE[0]))
            pose = compose((turn, HERE[1]), pose) if joint >= 0 else pose
        called = f"{'obstacle ' * (kind == 'obstacle')}{named(name)}"
        if kind == "link":  # which may have several
            called += f" {len({x.body for x in self.pieces if x.name == name})}"
        own, key = (name, kind, number, called, joint, pose), str(number)
        points, parts, off, sweep = shape_of(shape, what)
        if parts is None:
            self.pieces.append(Piece(*own, points, off, sweep))
            return
        self.parts[key], groups = points[parts], self.cuts.get(key)
        divided: list[Any] = [slice(None)]
        if groups is not None:
            need(groups.shape == parts.shape[:1], f"{what}: has {len(parts)} parts, not {len(groups)}")
            order = np.argsort(groups, kind="stable")
            divided = np.split(order, np.flatnonzero(np.diff(groups[order])) + 1)
        for rows in divided:
            size = sweep[rows].max(axis=0) if sweep.ndim == 2 else sweep
            self.pieces.append(Piece(*own, points[np.unique(parts[rows])], off, size))
        if shape["type"] == "mesh" and len(divided) > 1:
            self.surfaces[number] = dot("ij,mj->mi", pose[0], Ball(points, off)) + pose[1], parts

    def read_motion(self, said: Any) -> None:
        """Make the control points (N - 1, d + 1, n) of the polynomial between each two rows, of all joints."""
        rule: Any = said.get("rule") if type(said) is dict else None
        need(rule in RULES, "motion.rule: linear, cubic or quintic")
        names = ("positions", *RATES[: RULES[rule]])
        times, *rows = keys_of(said, "motion", f"rule times {' '.join(names)}")[1:]
        lead = [i for i, x in enumerate(self.joints) if x.follows is None]
        given = [numbers(x, (-1, len(lead)), f"motion.{name}") for x, name in zip(rows, names, strict=True)]
        count = len(given[0])
        good = (
            count >= 2 and 1 <= len(lead) <= 60 and all(len(x) == count for x in given) and (times or rule == "linear")
        )
        need(good, "motion: too few rows, or too many joints, or rates without times")
        a, b = Ball(given[0][:-1]), Ball(given[0][1:])
        control, self.rows, self.lead = [a, b], given[0], lead
        self.times: Any = None
        if times is not None:
            self.times = numbers(times, (count,), "motion.times")
            need((np.diff(self.times) > 0).all(), "motion.times: must increase")
            width = (Ball(self.times[1:]) - self.times[:-1])[:, None]
        if len(given) == 2:
            v, w = (x * (width * Ball(1 / 3, EPS)) for x in (given[1][:-1], given[1][1:]))
            control = [a, a + v, b - w, b]
        if len(given) == 3:
            v, w = (x * (width * Ball(0.2, EPS)) for x in (given[1][:-1], given[1][1:]))
            x, y = (x * (width * width * Ball(0.05, EPS)) for x in (given[2][:-1], given[2][1:]))
            control = [a, a + v, a + 2.0 * v + x, b - 2.0 * w + y, b - w, b]
        made, columns = stack(control, 1), []
        for i, joint in enumerate(self.joints):
            other, factor, add = joint.follows or (i, 1.0, 0.0)
            column = made[:, :, lead.index(other)]
            columns.append(column * factor + add if joint.follows else column)
        self.curve = self.control = stack(columns, 2)  # of the robot alone
        self.clock: Any = self.times

    def drift(self, name: str, said: Any) -> tuple[int, Ball]:
        """Note how an obstacle moves, as joints that follow the time: three slide along the world's axes, and every
        turn has one of its own, the last turn first. Returns the last joint, and the obstacle's rotation in its
        frame."""
        what = f"motions.{name}"
        need(self.times is not None and type(said) is dict, f"{what}: moves, and the motion has no times")
        tracks: list[tuple[Ball, list[float], list[Ball]]] = []  # of the turns: axis, and angles at two times
        if "times" in said:
            stamps, frames = keys_of(said, what, "times frames")
            times = numbers(stamps, (-1,), what).tolist()
            poses = [frame(keys_of(x, what, "rotation position off"), what) for x in frames]
            need(len(poses) == len(times) > 1 and min(np.diff(times)) > 0, f"{what}: times must increase")
            places = stack([at for _, at in poses], 1)
            still = 0.0
            for i in range(len(times) - 1):
                change = dot("ij,kj->ik", poses[i + 1][0], poses[i][0])
                over = change - np.eye(3)  # of length 2 sqrt(2) sin(angle / 2): above the angle
                if norm(np.abs(over.mid).ravel()) <= LEAST_TURN:
                    still += float(norm(over.size.ravel()))
                else:
                    axis, angle = turn_of(change)
                    tracks.append((axis, times[i : i + 2], [Ball(0.0), angle]))
            first = Ball(poses[0][0].mid, up(poses[0][0].rad + still))
        else:
            velocity, spin, *place = keys_of(said, what, "velocity spin rotation position off")
            velocity, spin = (numbers(x, (3,), what) for x in (velocity, spin))
            times, (first, at) = [float(self.times[0]), float(self.times[-1])], frame(place, what)
            places = stack([at + Ball(velocity) * x for x in times], 1)
            if spin.any():
                tracks.append((unit(spin), times, [length(spin) * x for x in times]))
        self.tracks += [(times, [places[i, k] for k in range(len(times))]) for i in range(3)]
        ways = [(Ball(x), False) for x in np.eye(3)] + [(axis, True) for axis, _, _ in reversed(tracks)]
        for i, (axis, turns) in enumerate(ways):
            self.joints.append(Joint(f"{name} moves", len(self.joints) - 1 if i else -1, HERE, axis, turns))
        self.tracks += [(span, angles) for _, span, angles in reversed(tracks)]
        return len(self.joints) - 1, first

    def lay_tracks(self) -> None:
        """Add what obstacles do to the motion, whose intervals end where that changes; note what each joint carries."""
        knots = {x for span, _ in self.tracks for x in span}
        if self.tracks:
            degree, inside = self.control.mid.shape[1] - 1, {x for x in knots if self.times[0] < x < self.times[-1]}
            times, rows_at = np.array(sorted({*self.times.tolist(), *inside})), self.times
            row: Any = np.searchsorted(rows_at, times[:-1], side="right") - 1
            share = inverse(Ball(rows_at[row + 1]) - rows_at[row])
            start, end = ((Ball(x) - rows_at[row]) * share for x in (times[:-1], times[1:]))
            self.times = times
            columns = [blossom(self.control[row], start[:, None, None], end[:, None, None])]
            for span, values in self.tracks:
                at = [track(span, values, x) for x in times.tolist()]
                a, b = stack(at[:-1]), stack(at[1:])
                rows = [a + (b - a) * (Ball(i) * Ball(1 / degree, EPS)) for i in range(degree + 1)]
                columns.append(stack(rows, 1)[:, :, None])
            mid, rad = (np.concatenate(x, axis=2) for x in ([y.mid for y in columns], [y.rad for y in columns]))
            self.control = Ball(mid, rad)
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
        rows = list[tuple[int, int]]()
        for a, b in ((i, j) for i in range(own) for j in range(i + 1, len(pieces))):
            one, two = pieces[a], pieces[b]
            within = two.kind != "obstacle"
            excused = one.name == two.name or (one.name, two.name) in self.left_out
            if not (excused if within else one.joint == two.joint == -1):
                rows.append((a, b))
        self.pairs = np.array(rows, dtype=np.int64).reshape(-1, 2)
        number, links = np.array([[x.body, x.kind == "link"] for x in pieces], dtype=np.int64).reshape(-1, 2).T
        near = np.unique(number[self.pairs[links[self.pairs].sum(axis=1) < 2]], axis=0)  # of two links, ASSUMES has it
        ways = [way for a, b in near.tolist() for way in ((a, b), (b, a)) if way[0] in self.surfaces]
        self.outside = [(mesh, each) for mesh, other in ways for each in self.connected(other)]
        self.within = np.array([b < own for _, b in rows], dtype=bool)  # pairs of the robot with itself

    def stack_up(self) -> None:
        """Collect joints (n, ...) and pieces (g, ...) in arrays, with the centres of balls around the pieces, in the
        frames of their joints, and the balls' radii."""

        def of(each: Any, *shape: int) -> Any:
            return np.array([each(x) for x in self.pieces]).reshape(-1, *shape)

        def pose(i: int, *shape: int) -> Ball:
            return Ball(of(lambda x: x.pose[i].mid, *shape), of(lambda x: x.pose[i].rad, *shape))

        self.turning = np.array([x.turns for x in self.joints])
        self.axis = stack([x.axis for x in self.joints])
        self.frames = stack([x.pose[0] for x in self.joints]), stack([x.pose[1] for x in self.joints])
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
