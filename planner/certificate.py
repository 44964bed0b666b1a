"""The certificate: a proof that a whole continuous motion is free, from the scene and the trajectory alone.

It shares nothing with the planner that made the trajectory: Pinocchio's own kinematics, the robot's real collision
geometry, the scene's own shapes (`proximity`), and bounds on the motion between samples (`motion_bounds`, `sweep`).
Distances are proven *lower bounds* in metres, positive = separated. Two bodies that do not move against each other (a
robot's base and the floor on which it stands) are no part of a motion and are not compared.
"""

from __future__ import annotations

import functools
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.intervals import Bodies, Body, Pairs
from hdplan.planner.motion_bounds import Chain
from hdplan.planner.path_check import PathCheck
from hdplan.planner.pose_goals import miss_of
from hdplan.planner.proximity import link_pieces, obstacle_pieces
from hdplan.planner.robot import Robot
from hdplan.planner.scene_robot import load_scene_robot
from hdplan.planner.sweep import Spot, Sweep
from hdplan.planner.trajectory import Trajectory
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.model import JointTarget, PoseTarget, Scene

Array = NDArray[np.float64]

AT_LIMIT = 1e-3  # [rad] or [m] by which an end may lie beyond a joint limit: scenes sit on limits to rounding
BEYOND_LIMIT = 1e-9  # the same for all other waypoints
SAME_END = 1e-6  # [rad] or [m] between an end of the trajectory and the scene's
FARTHEST = 1e6  # [rad] or [m] beyond which a waypoint drowns in rounding
NEAR = 0.15  # [m] within which the closest pair is looked for first
SAME_LOCKED = 1e-6  # [rad] or [m] between a locked joint's value in trajectory and scene


class Status(Enum):
    """What a certificate says; `remedy` says what to do about it."""

    CERTIFIED = "certified"
    WRONG_ENDS = "wrong_ends"
    OUTSIDE_LIMITS = "outside_limits"
    IN_CONTACT = "in_contact"
    TOO_CLOSE = "too_close"
    NOT_PROVEN = "not_proven"

    @property
    def remedy(self) -> str:
        """What a user can do."""
        return {
            Status.CERTIFIED: "none needed",
            Status.WRONG_ENDS: "plan from the scene's start to its goal, or check against the scene it was planned for",
            Status.OUTSIDE_LIMITS: "keep every waypoint within the robot's joint limits",
            Status.IN_CONTACT: "plan with more clearance, more waypoints or another seed",
            Status.TOO_CLOSE: "ask for less clearance, or plan with more",
            Status.NOT_PROVEN: "the motion grazes a body: plan with more clearance",
        }[self]


@dataclass(frozen=True)
class Place:
    """A place on the motion where two bodies are close."""

    interval: int  # between waypoints `interval` and `interval` + 1
    fraction: float  # of that interval, 0 to 1
    time: float  # path parameter of the whole motion, 0 to 1
    link: str
    other: str  # an obstacle or another link
    distance: float  # [m] met there, negative in contact (minus the depth, 0 if unknown)


@dataclass(frozen=True)
class Certificate:
    """A verdict on a continuous motion."""

    status: Status
    text: str  # one sentence: what was found, where, and what to do
    clearance: float | None  # [m] proven lower bound, robot to obstacles; None without obstacles or without proof
    self_clearance: float | None  # [m] the same between the links
    worst: Place | None  # the closest place met between robot and obstacles
    self_worst: Place | None  # the same between the links
    failures: tuple[Place, ...]  # every waypoint interval and pair that is not proven, the worst place met there
    configurations: int  # at which distances were computed
    exact_calls: int  # of the exact distance
    seconds: float  # spent

    @property
    def certified(self) -> bool:
        """Whether the motion is proven free."""
        return self.status is Status.CERTIFIED


@dataclass(frozen=True)
class Contact:
    """Two bodies that touch in one configuration."""

    link: str
    other: str  # an obstacle or another link
    depth: float  # [m] how far they overlap, 0 where only the contact is known


def certify(
    scene: Scene, trajectory: Trajectory, robot: Robot | None = None, *, required: float = 0.0, check_ends: bool = True
) -> Certificate:
    """Certify `trajectory` in `scene`: the verdict over the motion along straight lines between its waypoints.

    Args:
        scene: the scene; its own shapes count, not the planner's bodies.
        trajectory: joints by name, in any order.
        robot: the scene's robot, if it is loaded already.
        required: clearance [m] that must be proven between robot and obstacles; 0 means free.
        check_ends: whether the first and last waypoint must be the scene's start and goal.

    Raises:
        InputError: joints of the trajectory do not fit the robot; a mesh of the scene cannot be used.
    """
    return Certifier(scene, robot or load_scene_robot(scene)).certify(
        trajectory, required=required, check_ends=check_ends
    )


def check_configuration(scene: Scene, robot: Robot, q: ArrayLike) -> tuple[Contact, ...]:
    """Return the contacts of configuration `q` (n,), the deepest first: exact, robot with obstacles and with itself."""
    return Certifier(scene, robot).contacts(q)


@dataclass(frozen=True, eq=False)
class Closest:
    """Two bodies that are closest in one configuration."""

    link: str
    other: str  # an obstacle or another link
    distance: float  # [m] exact; negative in contact (then minus the depth, 0 if unknown)
    points: Array  # (2, 3) [m] where, on the link and on the other: for pictures, not proven


class Certifier:
    """A scene and its robot made ready once, to certify many trajectories."""

    def __init__(self, scene: Scene, robot: Robot) -> None:
        """Gather links, obstacles and the pairs to be kept apart. The robot holds what the scene attaches to it."""
        if robot.attached != scene.attached:
            raise InputError("the robot does not hold what the scene attaches: take the scene's own (load_scene_robot)")
        self.scene, self.robot = scene, robot
        bodies = list(_link_bodies(robot))
        links: dict[str, list[int]] = {link: [] for link in robot.links}
        for row, body in enumerate(bodies):
            links[body.name].append(row)
        count = len(bodies)
        for obstacle in scene.obstacles:
            with naming(scene.source):
                pieces = obstacle_pieces(obstacle)
            bodies.extend(Body(obstacle.name, piece, placement=obstacle.pose.matrix) for piece in pieces)
        rows = [(a, b, 0) for a in range(count) for b in range(count, len(bodies))]
        rows += [(a, b, 1) for first, second in robot.self_pairs for a in links[first] for b in links[second]]
        gathered = Bodies(_chain(robot), bodies, robot.pin_q)
        self.sweep = Sweep(gathered, Pairs.of(gathered, rows))
        self.path = PathCheck(scene, robot, gathered.chain)

    def certify(
        self,
        trajectory: Trajectory,
        *,
        required: float = 0.0,
        check_ends: bool = True,
        stop_at_contact: bool = False,
    ) -> Certificate:
        """Certify one trajectory; see `certify`. With `stop_at_contact` the first contact found ends the search, and
        there may be more than the failures tell."""
        began = time.perf_counter()
        waypoints = waypoints_of(self.robot, trajectory)
        proof = self.sweep.prove(waypoints, required, stop_at_contact)
        failures = tuple(self._place(spot, len(waypoints)) for spot in proof.failures)
        worst, self_worst = (self._place(spot, len(waypoints)) if spot else None for spot in proof.closest)
        unproven = {int(self.sweep.pairs.group[spot.pair]) for spot in proof.failures}
        clearance, self_clearance = (
            None if group in unproven or not np.isfinite(bound) else bound
            for group, bound in enumerate(proof.clearance)
        )
        ends = self._wrong_ends(waypoints) if check_ends else None
        limits = self._outside_limits(waypoints)
        touching = [place for place, spot in zip(failures, proof.failures, strict=True) if spot.touching]
        deepest = min(touching or failures, key=lambda place: place.distance, default=None)
        if ends:
            status, found = Status.WRONG_ENDS, ends
        elif limits:
            status, found = Status.OUTSIDE_LIMITS, limits
        elif deepest and touching and deepest.distance <= 0.0:
            status, found = Status.IN_CONTACT, f"{_words(deepest)}; {_others(failures)}"
        elif deepest and touching:
            status, found = (
                Status.TOO_CLOSE,
                f"{_words(deepest)}, {required * 1e3:g} mm are required; {_others(failures)}",
            )
        elif deepest:
            status, found = Status.NOT_PROVEN, f"{_where(deepest, 'cannot be told apart')}; {_others(failures)}"
        else:
            status, found = Status.CERTIFIED, _proven(clearance, self_clearance)
        text = f"{status.value.replace('_', ' ')}: {found}"
        return Certificate(
            status,
            text if status is Status.CERTIFIED else f"{text} ({status.remedy})",
            clearance,
            self_clearance,
            worst,
            self_worst,
            failures,
            proof.configurations,
            proof.exact_calls,
            time.perf_counter() - began,
        )

    def contacts(self, q: ArrayLike) -> tuple[Contact, ...]:
        """Return the contacts of one configuration; see `check_configuration`."""
        depths: dict[tuple[str, str], float] = {}
        for spot in self.sweep.distances(np.asarray(q, dtype=np.float64), within=0.0):
            if spot.touching:
                names = self._names(spot.pair)
                depths[names] = max(depths.get(names, 0.0), -spot.distance)
        return tuple(Contact(*names, depths[names]) for names in sorted(depths, key=lambda names: -depths[names]))

    def nearest(self, q: ArrayLike, within: float = np.inf) -> tuple[Place | None, Place | None]:
        """Return the closest places in one configuration, with exact distances: to an obstacle, between links; None
        where nothing is `within` [m]."""
        spots = self.sweep.nearest(np.asarray(q, dtype=np.float64), within)
        to_obstacle, between_links = (self._place(spot, 2) if spot else None for spot in spots)
        return to_obstacle, between_links

    def closest(self, q: ArrayLike) -> tuple[Closest | None, Closest | None]:
        """Return what is `nearest` in one configuration with the points between which it is."""
        configuration = np.asarray(q, dtype=np.float64)
        spots = self.sweep.nearest(configuration, NEAR)  # most often there is something, and little to compare
        if None in spots:
            spots = self.sweep.nearest(configuration)
        to_obstacle, between_links = (
            Closest(*self._names(spot.pair), spot.distance, self.sweep.witnesses(configuration, spot.pair))
            if spot
            else None
            for spot in spots
        )
        return to_obstacle, between_links

    def obstacle_within(self, q: ArrayLike, distance: float) -> Place | None:
        """Return the obstacle closest to the robot in one configuration, exactly; None if it is farther away than
        `distance` [m]."""
        return self.nearest(q, distance)[0]

    def _names(self, pair: int) -> tuple[str, str]:
        pairs, names = self.sweep.pairs, self.sweep.bodies.names
        return names[pairs.a[pair]], names[pairs.b[pair]]

    def _place(self, spot: Spot, count: int) -> Place:
        time_ = (spot.interval + spot.fraction) / (count - 1)
        return Place(spot.interval, spot.fraction, time_, *self._names(spot.pair), spot.distance)

    def _wrong_ends(self, waypoints: Array) -> str | None:
        with naming(self.scene.source):
            start = self.robot.configuration(self.scene.start, self.scene.from_request)
            at_start, at_goal = self._off("first", waypoints[0], start, "start"), self.off_goal(waypoints[-1])
        return at_start or at_goal

    def off_goal(self, q: Array) -> str | None:
        """Say how configuration q (n,) as the last waypoint misses the scene's goal, the first of several; None if it
        meets one."""
        goal = self.scene.goal
        if isinstance(goal, JointTarget):
            return self._off("last", q, self.robot.configuration(goal, self.scene.from_request), "goal")
        misses = [self._missing(q, target) for target in goal.targets]
        return misses[0] if all(misses) else None

    def _missing(self, q: Array, target: JointTarget | PoseTarget) -> str | None:
        if isinstance(target, JointTarget):
            return self._off("last", q, self.robot.configuration(target), target.field)
        miss = miss_of(self.robot, target, q)
        return None if miss.within(target) else f"the last waypoint has {target.link} {miss} away from {target.field}"

    def _off(self, word: str, row: Array, target: Array, field: str) -> str | None:
        """Say how a waypoint differs from the configuration of a field; None if it does not."""
        turning = np.isinf(self.robot.lower) & np.isinf(self.robot.upper)
        error = row - target
        error = np.where(turning, np.angle(np.exp(1j * error)), error)  # whole turns are the same place
        joint = int(np.abs(error).argmax())
        if abs(error[joint]) <= SAME_END:
            return None
        return (
            f"the {word} waypoint has joint '{self.robot.joint_names[joint]}' at {row[joint]:g}, "
            f"the scene's {field} at {target[joint]:g}"
        )

    def _outside_limits(self, waypoints: Array) -> str | None:
        """Look at the waypoints alone: a box is convex, so the lines between them stay within the same limits."""
        slack = np.full((len(waypoints), 1), BEYOND_LIMIT)
        slack[[0, -1]] = AT_LIMIT
        beyond = np.maximum(self.robot.lower - waypoints, waypoints - self.robot.upper) - slack
        row, joint = (int(i) for i in np.unravel_index(int(beyond.argmax()), beyond.shape))
        if beyond[row, joint] <= 0.0:
            return None
        low, high = self.robot.lower[joint], self.robot.upper[joint]
        return (
            f"waypoint {row} has joint '{self.robot.joint_names[joint]}' at {waypoints[row, joint]:g}, "
            f"its limits are [{low:g}, {high:g}]"
        )


@functools.lru_cache(maxsize=8)
def _chain(robot: Robot) -> Chain:
    return Chain.of(robot.model)


@functools.lru_cache(maxsize=8)
def _link_bodies(robot: Robot) -> tuple[Body, ...]:
    """Return the pieces of the links' collision geometry; once per robot, as meshes take their time."""
    items = [(link, robot.collision.geometryObjects[i]) for link, own in robot.link_geometry.items() for i in own]
    return tuple(
        Body(link, piece, int(item.parentJoint), item.placement.homogeneous)
        for link, item in items
        for piece in link_pieces(item.geometry, item.name)
    )


def waypoints_of(robot: Robot, trajectory: Trajectory) -> Array:
    """Return the trajectory's positions (N, n) in the order of the robot's planned joints.

    Columns of joints that the robot holds must stand still at the value at which it holds them. Raises InputError for
    joints that are missing, unknown or held elsewhere.
    """
    columns = dict(zip(trajectory.joint_names, trajectory.positions.T, strict=True))
    if missing := [name for name in robot.joint_names if name not in columns]:
        raise InputError(f"trajectory: joint '{missing[0]}' of {robot.name} is missing{nearest(missing[0], columns)}")
    held: Mapping[str, ArrayLike] = {name: column for name, column in columns.items() if name not in robot.joint_names}
    for name, values in {**trajectory.locked, **held}.items():
        if name not in robot.locked:
            known = (*robot.joint_names, *robot.locked)
            raise InputError(f"trajectory: joint '{name}' is not one of {robot.name}{nearest(name, known)}")
        away = np.asarray(values) - robot.locked[name]
        if np.abs(away).max() > SAME_LOCKED:
            found = np.asarray(values).flat[np.abs(away).argmax()]
            raise InputError(
                f"trajectory: joint '{name}' is at {found:g}, the scene holds it at {robot.locked[name]:g}"
            )
    positions = np.stack([columns[name] for name in robot.joint_names], axis=1)
    if np.abs(positions).max() > FARTHEST:
        row, joint = np.unravel_index(np.abs(positions).argmax(), positions.shape)
        raise InputError(
            f"trajectory: waypoint {row}, joint '{robot.joint_names[joint]}': {positions[row, joint]:g} is larger than "
            f"{FARTHEST:g}"
        )
    return positions


def _words(place: Place) -> str:
    if place.distance < 0.0:
        return _where(place, f"overlap by {-place.distance * 1e3:.3g} mm")
    return _where(place, f"come within {place.distance * 1e3:.3g} mm" if place.distance else "touch")


def _where(place: Place, what: str) -> str:
    return f"{place.link} and {place.other} {what} after waypoint {place.interval} (time {place.time:.3f})"


def _length(metres: float) -> str:
    return f"{metres * 1e3:.3g} mm" if metres < 1.0 else f"{metres:.3g} m"


def _others(failures: tuple[Place, ...]) -> str:
    pairs = Counter((place.link, place.other) for place in failures)
    intervals = len({place.interval for place in failures})
    return (
        f"{intervals} interval{'s' * (intervals != 1)} between waypoints, {len(pairs)} pair{'s' * (len(pairs) != 1)} "
        "of bodies not proven"
    )


def _proven(clearance: float | None, self_clearance: float | None) -> str:
    obstacles = "no obstacles to meet" if clearance is None else f"at least {_length(clearance)} to every obstacle"
    links = "" if self_clearance is None else f", {_length(self_clearance)} between links"
    return f"{obstacles}{links}, over the whole motion"
