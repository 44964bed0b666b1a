"""Closed forms of inverse kinematics: the arms that have one, and the joints that must be held for it.

Six turning joints are solved where, from one end or the other, the last two axes meet: all three of a wrist in a
point, or three others parallel, without a search; or else by a search along one angle (`closed_form_loop`). Of a chain
with more joints the others are held; which, the arm's geometry decides, by numbers alone: axes and points of its joints
where all are at 0. Free rotation about an axis is one more joint of the chain, beyond the link.

Elias & Wen, "IK-Geo: Unified robot inverse kinematics using subproblem decomposition", 2025; Ostermeier, Külz &
Althoff, "Automatic geometric decomposition for analytical inverse kinematics", 2025.
"""

from __future__ import annotations

import enum
import functools
import itertools
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hdplan.distance.compiled.loops import C, Record
from hdplan.distance.poses import placement_rows
from hdplan.planner.kinematics import closed_form_loop
from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.planner.robot.pin_model import motion_axes
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.once import made_once, read_only
from hdplan.scenes.targets import PoseTarget

SOLVED = 6  # joints
MOST_HELD = 3  # of the others
AXIS_TOLERANCE = 1e-3  # [m] or sine by which axes may miss each other, or be out of parallel; last steps make up for it
LEAST_DETERMINANT = 1e-6  # [m³] of the Jacobian's determinant, below which what is solved cannot place a link
SAME_ANGLE = 1e-6  # [rad] between configurations that are one
PLACES = 5  # random places of an arm where its geometry is examined
PER_HELD = 16  # values of held joints that are tried


class Kind(enum.IntEnum):
    """The geometry by which six joints are solved."""

    WRIST = 0  # its last three axes meet in a point
    PARALLEL = 1  # its last two axes meet, and those of joints 2 to 4 are parallel
    MEETING = 2  # its last two axes meet


WORDS = {
    Kind.WRIST: "by three axes that meet in a point",
    Kind.PARALLEL: "by three parallel axes",
    Kind.MEETING: "by two axes that meet, along one angle by search",
}


class Joints(NamedTuple):
    """A chain of k joints, all at 0, and the link at its end."""

    planned: NDArray[np.int64]  # (k,) which planned joint each is; -1 for the free rotation
    turns: NDArray[np.int64]  # (k,) 1 for those that turn
    directions: Array  # (k, 3) of their axes
    points: Array  # (k, 3) on them [m]
    tip: Array  # (4, 4) of the link

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Return directions and points of the axes where the joints are at q (k,)."""
        place, directions, points = np.eye(4), self.directions.copy(), self.points.copy()
        for joint, (turns, value) in enumerate(zip(self.turns, q, strict=True)):
            directions[joint] = place[:3, :3] @ directions[joint]
            points[joint] = place[:3, :3] @ points[joint] + place[:3, 3]
            motion = np.eye(4)
            if turns:
                motion[:3, :3] = pin.exp3(value * self.directions[joint])
                motion[:3, 3] = self.points[joint] - motion[:3, :3] @ self.points[joint]
            else:
                motion[:3, 3] = value * self.directions[joint]
            place = place @ motion
        return directions, points


class Way(NamedTuple):
    """Method by which a chain is solved."""

    kind: Kind
    held: tuple[int, ...]  # joints of the chain
    first: int  # of the six others, from which on they are solved
    backwards: bool
    searched: int  # the joint along which a search is, if it is one

    def chain(self, joints: Joints, lower: Array, upper: Array) -> Record:
        """Return the chain for the loop, with limits (k,)."""
        solved = np.setdiff1d(np.arange(len(joints.turns)), self.held)
        tip = placement_rows(joints.tip)
        places = (joints.turns, solved, joints.directions, joints.points, tip, lower, upper)
        return Record("six_joints", len(joints.turns), int(self.kind), self.first, int(self.backwards), *places)


class ClosedForm(NamedTuple):
    """Closed form for the configurations of a chain."""

    ways: tuple[Way, ...]
    planned: NDArray[np.int64]  # of each of the chain's joints, as in `Joints`
    lower: Array  # (k,) of the chain's joints
    upper: Array  # (k,)
    chains: tuple[Record, ...]

    @property
    def redundant(self) -> bool:
        """True if joints are held: the arm has families of configurations."""
        return bool(self.ways[0].held)

    def words(self, robot: Robot) -> str:
        """Return the method of the closed form in words."""
        way = self.ways[0]
        names = " and ".join(robot.joint_names[self.planned[joint]] for joint in way.held)
        return f"in closed form, {WORDS[way.kind]}" + f"; {names} at values around the seed's" * bool(names)

    def branches(self, robot: Robot, target: PoseTarget, seed: Array, count: int = 0) -> Array:
        """Return configurations (K, n) that bring the link to the target: all there are where nothing is held, else
        all with the held joints as in the seed (n,), and with others of `count` values (by default PER_HELD for each)
        that lie evenly within the limits. Joints that do not move the link are as in the seed, within the limits."""
        return self.branches_at(robot, target, seed, self.values(seed, count))

    def branches_at(self, robot: Robot, target: PoseTarget, seed: Array, values: Array) -> Array:
        """Return all configurations (K, n) that bring the link to the target with the held joints at values (B, m), the
        others as in `branches`."""
        own = self.planned >= 0
        start = np.where(own, seed[self.planned], 0.0)
        wanted = placement_rows(target.pose.matrix)
        each = [closed_form_loop.branches(chain, wanted, values, start) for chain in self.chains]
        rows = each[0]
        for more in each[1:]:
            apart = np.abs(rows[:, None] - more[None]).max(axis=2, initial=0.0)
            rows = np.concatenate([rows, more[(apart > SAME_ANGLE).all(axis=0)]])
        found = np.repeat(np.minimum(np.maximum(seed, robot.lower), robot.upper)[None], len(rows), axis=0)
        found[:, self.planned[own]] = rows[:, own]
        return found

    def values(self, seed: Array, count: int = 0) -> Array:
        """Values (B, m) of held joints: those of a seed (n,) first, then a lattice that is even in m dimensions."""
        held = list(self.ways[0].held)
        start = np.where(self.planned >= 0, seed[self.planned], 0.0)[held]
        low, high = self.lower[held], self.upper[held]
        wide = ~(high - low < 2 * np.pi)
        low = np.where(wide, start - np.pi, low)
        span = np.where(wide, 2 * np.pi, high - low)
        count = (count or PER_HELD * len(held)) if held else 1
        first = (np.clip(start, low, low + span) - low) / np.maximum(span, 1e-300)
        values: Array = low + span * ((first + _lattice(count, len(held))) % 1.0)
        values[0] = start
        return values


@functools.cache
def _lattice(count: int, m: int) -> Array:
    """Points (count, m) that lie evenly in a unit cube, modulo 1, the first at 0."""
    ratio = 2.0
    for _ in range(32):  # xᵐ⁺¹ = x + 1 (the golden ratio for m = 1)
        ratio = (1.0 + ratio) ** (1.0 / (m + 1.0))
    return read_only(np.arange(count)[:, None] * ratio ** -np.arange(1.0, m + 1.0))


def closed_form(robot: Robot, target: PoseTarget) -> ClosedForm | None:
    """Return the closed form of a link's inverse kinematics; None where there is none: of another geometry, where
    joints that follow others move the link, any rotation is free, or hdplan was built without a C compiler. Raises
    InputError as `link_frame`."""
    if C is None or target.free_rotation == "all":
        return None
    return _closed_form(robot, link_frame(robot, target.link, target.field), target.free_rotation)


@made_once(64)
def _closed_form(robot: Robot, frame: int, free_rotation: str) -> ClosedForm | None:
    joints = joints_to(robot, frame, free_rotation)
    if joints is None or not SOLVED <= len(joints.turns) <= SOLVED + MOST_HELD:
        return None
    ways = choice(joints)
    if not ways:
        return None
    own = joints.planned >= 0
    lower = np.where(own, robot.lower[joints.planned], -np.inf)
    upper = np.where(own, robot.upper[joints.planned], np.inf)
    chains = tuple(way.chain(joints, lower, upper) for way in ways)
    return ClosedForm(ways, joints.planned, lower, upper, chains)


def joints_to(robot: Robot, frame: int, free_rotation: str = "none") -> Joints | None:
    """Return the chain of joints that moves a frame of the model; None where one of them follows another."""
    model, data = robot.model, robot.model.createData()
    along = [joint for joint in model.supports[model.frames[frame].parentJoint] if joint > 0]
    columns = [int(model.joints[joint].idx_v) for joint in along]
    place = {int(column): planned for planned, column in enumerate(robot.coordinates)}
    if not set(columns) <= set(place):
        return None
    pin.framesForwardKinematics(model, data, robot.pin_q(np.zeros(robot.n)))
    turns, directions, points = [], [], []
    for joint in along:
        slide, axis = motion_axes(model.joints[joint])
        turns.append(bool(np.any(axis)))
        directions.append(data.oMi[joint].rotation @ (axis if turns[-1] else slide))
        points.append(data.oMi[joint].translation.copy())
    planned, tip = [place[column] for column in columns], data.oMf[frame].homogeneous
    if free_rotation in AXES:
        planned.append(-1)
        turns.append(True)
        directions.append(tip[:3, AXES.index(free_rotation)])
        points.append(tip[:3, 3])
    return Joints(np.array(planned), np.array(turns, np.int64), np.array(directions), np.array(points), tip)


def choice(joints: Joints) -> tuple[Way, ...]:
    """Return the solution method of a chain: without a search if it can be, and of such ways the one that is furthest
    from singular. Searches that hold nothing are two, along different joints, as one may miss what the other finds.
    None where the geometry allows none."""
    k = len(joints.turns)
    drawn = np.random.default_rng(0).uniform(-np.pi, np.pi, size=(PLACES, k)) * np.where(joints.turns, 1.0, 0.1)
    places = [joints.moved(q) for q in drawn]
    axes = _Axes.of(np.array([directions for directions, _ in places]), np.array([points for _, points in places]))
    found: list[tuple[bool, float, Way]] = []
    for held in itertools.combinations(range(k), k - SOLVED):
        solved = np.setdiff1d(np.arange(k), held)
        if not joints.turns[solved].all() or axes.determinant(solved) < LEAST_DETERMINANT:
            continue
        for first, backwards in itertools.product(range(SOLVED), (False, True)):
            order = np.roll(solved, -first)[:: -1 if backwards else 1]
            kind = axes.kind(order)
            if kind is None:
                continue
            way = Way(kind, held, first, backwards, int(order[3]))
            regular = float(f"{axes.first_determinant(order):.9g}")  # so that no rounding decides between equal ones
            found.append((kind == Kind.MEETING, -regular, way))
    found.sort()
    if not found:
        return ()
    best = found[0][2]
    if best.kind != Kind.MEETING or best.held:
        return (best,)
    return best, *[way for _, _, way in found if way.searched != best.searched][:1]


class _Axes(NamedTuple):
    """The axes of a chain's k joints at some places of it, and how any two of them lie, each pair once."""

    directions: Array  # (PLACES, k, 3)
    points: Array  # (PLACES, k, 3)
    parallel: Mask  # (PLACES, k, k)
    meeting: Mask  # (PLACES, k, k) that are not parallel, and meet
    nearest: Array  # (PLACES, k, k, 3) the point of the first axis that is nearest to the second

    @classmethod
    def of(cls, directions: Array, points: Array) -> _Axes:
        """Look at every pair."""
        one, other = directions[:, :, None], directions[:, None]
        across = np.cross(one, other)
        sine = np.linalg.norm(across, axis=3)
        between = points[:, None] - points[:, :, None]
        parallel = sine <= AXIS_TOLERANCE
        square = np.where(parallel, 1.0, sine**2)
        gap = np.abs((across * between).sum(axis=3)) / np.sqrt(square)
        along = (np.cross(between, other) * across).sum(axis=3) / square
        nearest = points[:, :, None] + along[..., None] * one
        return cls(directions, points, parallel, ~parallel & (gap <= AXIS_TOLERANCE), nearest)

    def determinant(self, solved: NDArray[np.int64]) -> float:
        """The size [m³] of the determinant of six turning joints' Jacobian; no point of the link matters."""
        directions, points = self.directions[:, solved], self.points[:, solved]
        jacobian = np.concatenate([np.cross(points, directions), directions], axis=2)
        return float(np.median(np.abs(np.linalg.det(jacobian))))

    def first_determinant(self, order: NDArray[np.int64]) -> float:
        """The size [m³] of the determinant of how the first three joints move the point where the last two meet."""
        arms = self.nearest[:, order[4], None, order[5]] - self.points[:, order[:3]]
        return float(np.median(np.abs(np.linalg.det(np.cross(self.directions[:, order[:3]], arms)))))

    def kind(self, order: NDArray[np.int64]) -> Kind | None:
        """The geometry by which six axes in this order are solved; None if there is none at every place."""
        _, one, two, three, four, five = order
        if not self.meeting[:, four, five].all():
            return None
        arm = self.nearest[:, four, five] - self.points[:, three]
        through = np.linalg.norm(np.cross(self.directions[:, three], arm), axis=1) <= AXIS_TOLERANCE
        wrist = through & ~self.parallel[:, three, four]
        middle = self.parallel[:, one, two] & self.parallel[:, two, three]
        kinds = np.where(wrist, Kind.WRIST, np.where(middle, Kind.PARALLEL, Kind.MEETING))
        return Kind(kinds[0]) if (kinds == kinds[0]).all() else None
