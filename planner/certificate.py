"""The certificate: a proof that a whole continuous motion is free, from the scene and the trajectory alone.

It shares nothing with the planner that made the trajectory: Pinocchio's own kinematics, the robot's real collision
geometry, the scene's own shapes (`proximity`), and bounds on the executed curve between samples (`curve`,
`motion_bounds`, `sweep`). Where the scene says so, it covers moving obstacles, limits of the joints (`rate_check`) and
what is to hold all along the way (`path_check`).
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
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.curve import Curve
from hdplan.planner.intervals import Bodies, Body, Pairs
from hdplan.planner.motion_bounds import Chain
from hdplan.planner.path_check import Departure, Kept, PathCheck
from hdplan.planner.pose_goals import miss_of
from hdplan.planner.proximity import link_pieces, obstacle_pieces
from hdplan.planner.rate_check import Use, rates
from hdplan.planner.robot import Robot
from hdplan.planner.scene_robot import load_scene_robot
from hdplan.planner.sweep import Spot, Sweep
from hdplan.planner.trajectory import Trajectory
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.model import JointTarget, Obstacle, PoseTarget, Scene

if TYPE_CHECKING:
    from hdplan.planner.torque_check import Overload, TorqueCheck, TorqueLimits
    from hdplan.scenes.moving import Passages

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
    OFF_PATH = "off_path"
    TOO_FAST = "too_fast"
    OVERLOADED = "overloaded"
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
            Status.OFF_PATH: "allow more (path), or plan it with this constraint in the scene, or with more waypoints",
            Status.TOO_FAST: "give it more time (timing), or plan it with these limits in the scene",
            Status.OVERLOADED: "carry less, give it more time (timing), or plan it with limits.torque in the scene",
            Status.NOT_PROVEN: "the motion grazes a body: plan with more clearance",
        }[self]


@dataclass(frozen=True)
class Place:
    """A place on the motion where two bodies are close."""

    interval: int  # between waypoints `interval` and `interval` + 1
    fraction: float  # of that interval, 0 to 1
    time: float  # path parameter of the whole motion, 0 to 1
    seconds: float | None  # when; None for a path without times
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
    uses: tuple[Use, ...]  # of the joints' limits on rates and torques, where the scene has any
    path: tuple[Kept, ...]  # how well the scene's path constraints are kept, where it has any
    departures: tuple[Departure, ...]  # every waypoint interval and path constraint that is not proven
    overloaded: tuple[int, ...]  # every waypoint interval in which gravity alone is too much for a joint
    configurations: int  # at which distances were computed
    exact_calls: int  # of the exact distance
    seconds: float  # spent

    @property
    def unproven(self) -> tuple[int, ...]:
        """The waypoint intervals in which something about places is not proven or cannot be, in order."""
        places = {place.interval for place in self.failures} | {place.interval for place in self.departures}
        return tuple(sorted(places | set(self.overloaded)))

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
        required: clearance [m] that must be proven between robot and obstacles that have no own; 0 means free.
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
            passages = _passages(obstacle)
            bodies.extend(Body(obstacle.name, piece, 0, obstacle.pose.matrix, passages) for piece in pieces)
        rows = [(a, b, 0) for a in range(count) for b in range(count, len(bodies))]
        rows += [(a, b, 1) for first, second in robot.self_pairs for a in links[first] for b in links[second]]
        gathered = Bodies(_chain(robot), bodies, robot.pin_q)
        self.sweep = Sweep(gathered, Pairs.of(gathered, rows))
        self.path = PathCheck(scene, robot, gathered.chain)
        self.torques = _torque_limits(scene, robot)

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
        curve = curve_of(self.robot, trajectory)
        uses = self._uses(curve)
        torques = None if self.torques is None else self.torques.check(curve)
        floor = self._floor(required)
        proof = self.sweep.prove(curve, floor, stop_at_contact)
        path = self.path.prove(curve)
        failures = tuple(self._place(spot, curve) for spot in proof.failures)
        worst, self_worst = (self._place(spot, curve) if spot else None for spot in proof.closest)
        unproven = {int(self.sweep.pairs.group[spot.pair]) for spot in proof.failures}
        clearance, self_clearance = (
            None if group in unproven or not np.isfinite(bound) else bound
            for group, bound in enumerate(proof.clearance)
        )
        ends = self._wrong_ends(curve.rows) if check_ends else None
        limits = self._outside_limits(curve)
        too_fast = next((use for use in uses if not use.within), None)
        asked = {place: floor[spot.pair] for place, spot in zip(failures, proof.failures, strict=True)}
        off_path = max(path.departures, key=lambda place: place.excess, default=None)
        touching = [place for place, spot in zip(failures, proof.failures, strict=True) if spot.touching]
        deepest = min(
            touching or failures, key=lambda place: (place.distance > 0.0, place.distance - asked[place]), default=None
        )
        if ends:
            status, found = Status.WRONG_ENDS, ends
        elif limits:
            status, found = Status.OUTSIDE_LIMITS, limits
        elif deepest and touching and deepest.distance <= 0.0:
            status, found = Status.IN_CONTACT, f"{_words(deepest)}; {_others(failures)}"
        elif deepest and touching:
            status, found = (
                Status.TOO_CLOSE,
                f"{_words(deepest)}, {asked[deepest] * 1e3:g} mm are required; {_others(failures)}",
            )
        elif off_path and off_path.violated:
            status, found = Status.OFF_PATH, _departure(off_path, path.departures, curve)
        elif off_path:
            status, found = Status.NOT_PROVEN, _departure(off_path, path.departures, curve)
        elif deepest:
            status, found = Status.NOT_PROVEN, f"{_where(deepest, 'cannot be told apart')}; {_others(failures)}"
        elif too_fast:
            status, found = Status.TOO_FAST, _exceeded(too_fast, curve)
        elif torques and not torques.within:
            status, found = (Status.OVERLOADED if torques.exceeded else Status.NOT_PROVEN), torques.text
        else:
            status, found = Status.CERTIFIED, _proven(clearance, self_clearance, uses, path.kept)
            if torques:
                found = f"{found}; {torques.text}"
        if torques:
            uses = (*uses, _use_of(torques, curve))
        text = f"{status.value.replace('_', ' ')}: {found}"
        return Certificate(
            status,
            text if status is Status.CERTIFIED else f"{text} ({status.remedy})",
            clearance,
            self_clearance,
            worst,
            self_worst,
            failures,
            uses,
            path.kept,
            path.departures,
            torques.overloaded if torques and torques.exceeded else (),
            proof.configurations + path.configurations,
            proof.exact_calls,
            time.perf_counter() - began,
        )

    def _uses(self, curve: Curve) -> tuple[Use, ...]:
        """Look at the rates, where the scene limits any. Raises InputError where the scene needs times and there are
        none."""
        moving = [obstacle.name for obstacle in self.scene.obstacles if obstacle.motion is not None]
        if curve.times is None and (moving or self.scene.timed):
            why = f"obstacle '{moving[0]}' moves" if moving else "the scene limits rates (limits, timing)"
            raise InputError(f"trajectory: has no times, and {why}")
        if not self.scene.timed:
            return ()
        with naming(self.scene.source):
            return rates(curve, self.scene, self.robot)

    def _floor(self, required: float) -> Array:
        """Return what each pair must keep (P,) [m]."""
        own = {obstacle.name: obstacle.clearance for obstacle in self.scene.obstacles if obstacle.clearance is not None}
        between_links, pairs = self.scene.self_collision.clearance, self.sweep.pairs
        asked = [own.get(self.sweep.bodies.names[b], required) for b in pairs.b.tolist()]
        return np.where(pairs.group == 0, asked, between_links)

    def overload(self, q: ArrayLike) -> Overload | None:
        """Return the joint that gravity overloads in one configuration; None if there is none, or no torque limit."""
        return None if self.torques is None else self.torques.overload(np.asarray(q, dtype=np.float64))

    def contacts(self, q: ArrayLike, time: float = 0.0) -> tuple[Contact, ...]:
        """Return the contacts of one configuration at a time [s]; see `check_configuration`."""
        depths: dict[tuple[str, str], float] = {}
        for spot in self.sweep.distances(np.asarray(q, dtype=np.float64), 0.0, time):
            if spot.touching:
                names = self._names(spot.pair)
                depths[names] = max(depths.get(names, 0.0), -spot.distance)
        return tuple(Contact(*names, depths[names]) for names in sorted(depths, key=lambda names: -depths[names]))

    def too_close(self, q: ArrayLike, required: float, time: float = 0.0) -> tuple[tuple[Place, float], ...]:
        """Return where one configuration, at a time [s], falls short of what its obstacles and links must keep, with
        that [m]; the closest first."""
        floor = self._floor(required)
        found = []
        within = float(floor.max(initial=0.0))
        for spot in self.sweep.distances(np.asarray(q, dtype=np.float64), within, time, surfaces=True):
            if spot.touching or spot.distance < floor[spot.pair]:
                found.append((self._standing(spot), float(floor[spot.pair])))
        return tuple(sorted(found, key=lambda each: each[0].distance))

    def nearest(self, q: ArrayLike, within: float = np.inf, time: float = 0.0) -> tuple[Place | None, Place | None]:
        """Return the closest places in one configuration at a time [s], with exact distances: to an obstacle, between
        links; None where nothing is `within` [m]."""
        spots = self.sweep.nearest(np.asarray(q, dtype=np.float64), within, time)
        to_obstacle, between_links = (self._standing(spot) if spot else None for spot in spots)
        return to_obstacle, between_links

    def closest(self, q: ArrayLike, time: float = 0.0) -> tuple[Closest | None, Closest | None]:
        """Return what is `nearest` in one configuration at a time [s] with the points between which it is."""
        configuration = np.asarray(q, dtype=np.float64)
        spots = self.sweep.nearest(configuration, NEAR, time)  # most often there is something, and little to compare
        if None in spots:
            spots = self.sweep.nearest(configuration, time=time)
        to_obstacle, between_links = (
            Closest(*self._names(spot.pair), spot.distance, self.sweep.witnesses(configuration, spot.pair, time))
            if spot
            else None
            for spot in spots
        )
        return to_obstacle, between_links

    def _names(self, pair: int) -> tuple[str, str]:
        pairs, names = self.sweep.pairs, self.sweep.bodies.names
        return names[pairs.a[pair]], names[pairs.b[pair]]

    def _place(self, spot: Spot, curve: Curve) -> Place:
        parameter = (spot.interval + spot.fraction) / (len(curve) - 1)
        seconds = None if curve.times is None else float(curve.time_of(parameter))
        return Place(spot.interval, spot.fraction, parameter, seconds, *self._names(spot.pair), spot.distance)

    def _standing(self, spot: Spot) -> Place:
        """Name a place of a configuration that is no part of a motion."""
        return Place(0, spot.fraction, spot.fraction, None, *self._names(spot.pair), spot.distance)

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

    def _outside_limits(self, curve: Curve) -> str | None:
        """Look at the waypoints alone where straight lines join them: a box is convex, so they stay within the limits,
        too; or else at bounds of the curve after each."""
        straight = curve.degree == 1
        low, high = (curve.rows, curve.rows) if straight else curve.bounds()
        slack = np.full((len(low), 1), BEYOND_LIMIT)
        slack[[0, -1]] = AT_LIMIT
        below, above = self.robot.lower - low, high - self.robot.upper
        beyond = np.maximum(below, above) - slack
        row, joint = (int(i) for i in np.unravel_index(int(beyond.argmax()), beyond.shape))
        if beyond[row, joint] <= 0.0:
            return None
        found = low[row, joint] if below[row, joint] > above[row, joint] else high[row, joint]
        return (
            f"{'' if straight else 'the curve after '}waypoint {row} has joint '{self.robot.joint_names[joint]}' at "
            f"{found:g}, its limits are [{self.robot.lower[joint]:g}, {self.robot.upper[joint]:g}]"
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


def _torque_limits(scene: Scene, robot: Robot) -> TorqueLimits | None:
    """Return what the joints can drive; None if the scene limits no torque."""
    if scene.limits.torque is None:
        return None
    from hdplan.planner.torque_check import TorqueLimits

    return TorqueLimits.of(scene, robot)


def _passages(obstacle: Obstacle) -> Passages | None:
    """Return how an obstacle moves; None if it stands."""
    if obstacle.motion is None:
        return None
    from hdplan.scenes.moving import Passages

    return Passages.of(obstacle)


def curve_of(robot: Robot, trajectory: Trajectory) -> Curve:
    """Return the trajectory's curve, its joints in the order of the robot's planned ones.

    Joints that the robot holds must stand still at the value at which it holds them. Raises InputError for joints that
    are missing, unknown or held elsewhere.
    """
    names, curve = trajectory.joint_names, trajectory.curve
    if missing := [name for name in robot.joint_names if name not in names]:
        raise InputError(f"trajectory: joint '{missing[0]}' of {robot.name} is missing{nearest(missing[0], names)}")
    held: Mapping[str, ArrayLike] = {
        name: curve.control[:, :, column] for column, name in enumerate(names) if name not in robot.joint_names
    }
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
    curve = curve.columns([names.index(name) for name in robot.joint_names])
    far = np.abs(curve.control).max(axis=1)
    if far.max() > FARTHEST:
        row, joint = np.unravel_index(far.argmax(), far.shape)
        raise InputError(
            f"trajectory: waypoint {row}, joint '{robot.joint_names[joint]}': {far[row, joint]:g} is larger than "
            f"{FARTHEST:g}"
        )
    return curve


def _words(place: Place) -> str:
    if place.distance < 0.0:
        return _where(place, f"overlap by {-place.distance * 1e3:.3g} mm")
    return _where(place, f"come within {place.distance * 1e3:.3g} mm" if place.distance else "touch")


def _where(place: Place, what: str) -> str:
    when = f"time {place.time:.3f}" if place.seconds is None else f"{place.seconds:.3f} s"
    return f"{place.link} and {place.other} {what} after waypoint {place.interval} ({when})"


def _length(metres: float) -> str:
    return f"{metres * 1e3:.3g} mm" if metres < 1.0 else f"{metres:.3g} m"


def _others(failures: tuple[Place, ...]) -> str:
    pairs = Counter((place.link, place.other) for place in failures)
    intervals = len({place.interval for place in failures})
    return (
        f"{intervals} interval{'s' * (intervals != 1)} between waypoints, {len(pairs)} pair{'s' * (len(pairs) != 1)} "
        "of bodies not proven"
    )


def _departure(worst: Departure, departures: tuple[Departure, ...], curve: Curve) -> str:
    when = f"time {worst.time:.3f}" if curve.times is None else f"{float(curve.time_of(worst.time)):.3f} s"
    intervals = len({place.interval for place in departures})
    return (
        f"{worst.words}{'' if worst.violated else ', too close to tell'} after waypoint {worst.interval} ({when}); "
        f"{intervals} interval{'s' * (intervals != 1)} between waypoints not proven"
    )


def _use_of(torques: TorqueCheck, curve: Curve) -> Use:
    joint, last = torques.worst, len(curve) - 2
    interval = min(int(curve.parameter_of(torques.times[joint]) * (last + 1)), last)
    share = float(torques.proven[joint] / torques.limits[joint])
    return Use("torque", share, torques.joint_names[joint], interval, float(torques.limits[joint]))


def _exceeded(use: Use, curve: Curve) -> str:
    began = curve.time_of(use.interval / (len(curve) - 1))
    after = f"after waypoint {use.interval} ({began:.3f} s)"
    if np.isinf(use.share):
        return f"joint '{use.joint}': {use.quantity} is infinite {after}, as what it is the change of jumps there"
    return f"joint '{use.joint}': {use.quantity} up to {use.share:.1%} of its limit {use.limit:g} {after}"


def _proven(
    clearance: float | None, self_clearance: float | None, uses: tuple[Use, ...], path: tuple[Kept, ...]
) -> str:
    obstacles = "no obstacles to meet" if clearance is None else f"at least {_length(clearance)} to every obstacle"
    links = "" if self_clearance is None else f", {_length(self_clearance)} between links"
    taken = "".join(f", {use.quantity} up to {use.share:.0%} of the limits" for use in uses)
    kept = "".join(f", {constraint.words}" for constraint in path)
    return f"{obstacles}{links}{taken}{kept}, over the whole motion"
