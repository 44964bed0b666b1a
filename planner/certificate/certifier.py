"""The certificate: a proof that a whole continuous motion is free, from the scene and the trajectory alone.

It shares nothing with the planner that made the trajectory: it uses Pinocchio's own kinematics, the robot's real
collision geometry, the scene's own shapes (`exact_proximity`), and bounds on the executed curve between samples
(`curve`, `motion_bounds`, `collision_proof`). Where the scene has them, it covers moving obstacles, joint limits
(`limit_checks`) and path constraints (`path_check`); at the end, what was checked is compared with what the scene
requires (`coverage`).
Distances are proven *lower bounds* in metres, positive = separated. Two bodies that do not move relative to each other
(a robot's base and the floor on which it stands) are not compared.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Collection, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.certificate.collision_proof import SHORTEST_INTERVAL, Proof
from hdplan.planner.certificate.coverage import compared, ends_of, refuse_gaps, required_of
from hdplan.planner.certificate.end_check import EndCheck
from hdplan.planner.certificate.intervals import Bodies, Pairs
from hdplan.planner.certificate.limit_checks import limit_checks
from hdplan.planner.certificate.placed_pairs import Spot
from hdplan.planner.certificate.rounding import refuse_far_bodies, refuse_large_motion
from hdplan.planner.certificate.sizes import FIELDS, Sizes
from hdplan.planner.certificate.solids import link_bodies, obstacle_bodies
from hdplan.planner.certificate.sweep import Sweep
from hdplan.planner.certificate.verdict import (
    Certificate,
    Closest,
    Contact,
    Findings,
    Place,
    Status,
    complaints,
    proven,
)
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.motion.robot_curve import beyond_limits, curve_of, unfolded_curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.as_loaded import check_as_loaded
from hdplan.planner.robot.link_frame import links_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.arrays import joint_numbers
from hdplan.scenes.deadline import check_time
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.once import made_once
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import Number, boolean, checked, instance

if TYPE_CHECKING:
    from hdplan.planner.certificate.path_check import Departure

ENDS_KEEP = 0.75  # share of the clearance at start or goal that is required where it is below planner.clearance


def certify(
    scene: Scene,
    trajectory: Trajectory,
    robot: Robot | None = None,
    *,
    required: float | None = None,
    check_ends: bool = True,
) -> Certificate:
    """Certify `trajectory` in `scene`: return the verdict on its whole curve (`Trajectory.curve`).

    Args:
        scene: the scene; the check uses its own shapes, not the planner's bodies.
        trajectory: joints by name, in any order.
        robot: the scene's robot, if it is already loaded.
        required: clearance [m] that must be proven between the robot and obstacles without a clearance of their own; 0
            means free of contact; None means the scene's value, `Certifier.required`.
        check_ends: whether the first and last waypoints must be the scene's start and goal.

    Raises:
        InputError: the trajectory's joints do not match the robot's; a mesh of the scene cannot be used; the robot
            was changed after it was loaded.
        UncheckedError: a requirement of the scene was not checked, a fault of hdplan (`coverage`).
    """
    return Certifier(Setup.of(scene, robot)).certify(trajectory, required=required, check_ends=check_ends)


def check_configuration(scene: Scene, robot: Robot, q: ArrayLike) -> tuple[Contact, ...]:
    """Return the contacts at configuration `q` (n,) [rad or m], the deepest first: exact, of the scene's robot with
    itself and with the obstacles at their nominal poses at time 0, regardless of the scene's sizes.

    Raises InputError for a wrong number of values, or one that is not finite.
    """
    return Certifier(Setup.of(scene, robot)).contacts(q)


class Certifier:
    """A scene and its robot, prepared once to certify many trajectories."""

    def __init__(self, setup: Setup) -> None:
        """Collect the links, the obstacles and the pairs to be kept apart."""
        scene, robot = setup.scene, setup.robot
        self.setup, self.scene, self.robot = setup, scene, robot
        bodies = list(link_bodies(robot))
        links: dict[str, list[int]] = {link: [] for link in robot.links}
        for row, body in enumerate(bodies):
            links[body.name].append(row)
        count = len(bodies)
        for obstacle in scene.obstacles:
            check_time("reading the scene's shapes for the certificate")
            with naming(scene.source):
                bodies.extend(obstacle_bodies(obstacle))
        obstacles = len(bodies) - count
        rows = np.zeros((count * obstacles, 3), dtype=np.int64)
        rows[:, 0], rows[:, 1] = np.repeat(np.arange(count), obstacles), np.tile(np.arange(obstacles), count) + count
        # those that never touch need no proof, but how close they come counts in what is claimed
        pairs = (*robot.self_pairs, *(robot.never_touching if scene.self_collision.checked else ()))
        own = [(a, b, 1) for first, second in pairs for a in links[first] for b in links[second]]
        gathered = Bodies(_chain(robot), bodies, robot.unfolded.pin_q, Sizes.of(setup, bodies, count))
        self._fields = [f"robot: '{body.name}'" for body in bodies[:count]]
        self._fields += [f"obstacles.{body.name}" for body in bodies[count:]]
        with naming(scene.source):
            refuse_far_bodies(gathered, self._fields)
        self.sweep = Sweep(gathered, Pairs.of(gathered, np.concatenate([rows, np.array(own, np.int64).reshape(-1, 3)])))
        self._ends_at(setup)
        self._lenient = {obstacle.name for obstacle in scene.obstacles if obstacle.clearance is None}
        kept = {obstacle.name: obstacle.clearance for obstacle in scene.obstacles if obstacle.clearance is not None}
        self._kept = np.array([kept.get(body.name, np.nan) for body in bodies])  # (bodies,) [m] where it has its own
        self._compared = compared(scene, robot, gathered, self.sweep.pairs, self.floor(0.0), count)
        check_as_loaded(robot)  # as what was read of it is kept

    def _ends_at(self, setup: Setup) -> None:
        """Set the fields that depend on the scene's ends."""
        self.setup, self.scene = setup, setup.scene
        self.ends = EndCheck(setup.scene, setup.robot, setup.rates)
        self.path = None
        if setup.scene.path != PathConstraints():
            from hdplan.planner.certificate.path_check import PathCheck

            self.path = PathCheck(setup, self.sweep.bodies.chain)
        self.limits = tuple(limit_checks(setup))
        self._required = required_of(setup.scene, setup.robot)

    def between(self, start: JointTarget, goal: JointTarget) -> Certifier:
        """Return this certifier for another start and goal, with the same bodies. Raises InputError for ends
        that do not fit the robot."""
        found = copy.copy(self)
        found._ends_at(self.setup.changed(start=start, goal=goal))
        return found

    @cached_property
    def holes(self) -> tuple[str, ...]:
        """A note on meshes with holes; empty if there are none."""
        surfaces = [(body.name, body.piece.surface) for body in self.sweep.bodies.bodies]
        names = dict.fromkeys(name for name, surface in surfaces if surface is not None and surface.solid.open)
        if not names:
            return ()
        return (f"meshes with holes: {', '.join(names)}: points that they surround by more than half count as inside",)

    @cached_property
    def weightless(self) -> tuple[str, ...]:
        """A note on held objects without a mass, where torques are limited; empty if there are none."""
        if self.scene.limits.torque is None:
            return ()
        links, frames = links_of(self.robot), self.robot.model.frames
        carried = [each for each in self.scene.attached if frames[links[each.link]].parentJoint]
        names = ", ".join(each.name for each in carried if each.mass is None)
        return (f"torques do not include a mass of {names}, as none is given",) if names else ()

    def certify(
        self,
        trajectory: Trajectory,
        *,
        required: float | None = None,
        check_ends: bool = True,
        suspect: tuple[int, float] | None = None,
        passing: Collection[str] = (),
        shortest: float = SHORTEST_INTERVAL,
        measured: bool = True,
    ) -> Certificate:
        """Certify one trajectory; see `certify`. A `suspect`, a place where contact is likely (a waypoint interval and
        a fraction of it), is examined first, and the first contact found anywhere ends the search, so that the
        failures are not complete, nor is the cost of the unknown then given. At ends that are `passing` the robot does
        not stop: the motion itself defines these ends, so that no lesser clearance is required for them. A pair neither
        proven nor refuted on the `shortest` part of a waypoint interval counts as not proven. Without `measured`, the
        proven clearance may be far less than the distance of the bodies."""
        began = time.perf_counter()
        check_as_loaded(self.robot, shapes=False)
        instance(trajectory, Trajectory, "trajectory")
        check_ends = checked(boolean, check_ends, "check_ends")
        if required is not None:
            required = checked(Number(low=0.0, unit="m"), required, "required")
        curve = curve_of(self.robot, trajectory)
        moved = unfolded_curve(self.robot, curve)  # what follows, moves
        beyond = beyond_limits(curve, self.robot)  # nothing else is checked then: it could be anywhere
        if not beyond:
            refuse_large_motion(self.sweep.bodies, self._fields, moved, self.robot.unfolded.joint_names)
        self._check_times(curve)
        limits = () if beyond else tuple(check.check(curve) for check in self.limits)
        required, reductions = self.required(curve, passing) if required is None else (required, ())
        floor = self.floor(required)
        proof = Proof() if beyond else self.sweep.prove(moved, floor, suspect, shortest, measured)
        path = None if self.path is None or beyond else self.path.prove(moved)
        kept, departures = (path.kept, path.departures) if path else ((), ())
        failures = tuple(self._place(spot, curve) for spot in proof.failures)
        worst, self_worst = (self._place(spot, curve) if spot else None for spot in proof.closest)
        unproven = {int(self.sweep.pairs.group[spot.pair]) for spot in proof.failures}
        clearance, self_clearance = (
            None if group in unproven or not np.isfinite(bound) else bound
            for group, bound in enumerate(proof.clearance)
        )
        ends = self.ends.misses(curve) if check_ends else {}
        if not beyond:
            covered = {name for finding in limits for name in finding.covered}
            covered |= self._compared if proof.whole else set()
            covered |= ends.keys() | (path.covered if path else set())
            refuse_gaps(self._required | (ends_of(self.scene) if check_ends else set()), frozenset(covered))
        check_as_loaded(self.robot)  # at the end: another thread may have changed it meanwhile
        found = Findings(
            curve,
            next(filter(None, ends.values()), None),
            beyond,
            failures,
            tuple(spot.touching for spot in proof.failures),
            tuple(float(floor[spot.pair]) for spot in proof.failures),
            departures,
            limits,
        )
        certified = (
            Status.CERTIFIED,
            proven(clearance, self_clearance, limits, kept, self.sweep.bodies.sizes is not None),
        )
        status, message = next(complaints(found), certified)
        remedy = "" if status is Status.CERTIFIED else f" ({status.remedy})"
        return Certificate(
            status=status,
            text=f"{status.value.replace('_', ' ')}: {message}{remedy}",
            clearance=clearance,
            self_clearance=self_clearance,
            worst=worst,
            self_worst=self_worst,
            failures=failures,
            uses=tuple(use for found in limits for use in found.uses),
            path=kept,
            departures=departures,
            overloaded=tuple(sorted({interval for found in limits for interval in found.unfixable})),
            configurations=proof.configurations + (path.configurations if path else 0),
            exact_calls=proof.exact_calls,
            seconds=time.perf_counter() - began,
            required=required,
            notes=(
                *reductions,
                *(self._unknown(moved, proof) if suspect is None else ()),
                *self.holes,
                *self.weightless,
                *self.setup.units,
                *self.setup.ignored,
            ),
        )

    def required(self, curve: Curve, passing: Collection[str] = ()) -> tuple[float, tuple[str, ...]]:
        """Return the clearance [m] that the scene requires of a motion, for obstacles without a clearance of their own:
        planner.clearance, or less, with a note, where the scene's own start or goal is closer. Of several goals the one
        that the motion reaches counts; ends that are `passing` do not."""
        required, notes = self.scene.planner.clearance, []
        for field, q, seconds in self.ends.placed(curve) if required > 0.0 else ():
            if field in passing:
                continue
            required, note = self.allowed(field, self.too_close(q, required, seconds), required)
            notes += [note] if note else []
        return required, tuple(notes)

    def allowed(self, field: str, close: Sequence[tuple[Place, float]], required: float) -> tuple[float, str]:
        """Return the clearance [m] that can be required where the scene starts or ends, where it is `too_close` at
        these places: `required`, or, with a note, a share of the clearance there, to an obstacle without a clearance of
        its own."""
        for place, _ in close:
            if place.other in self._lenient:
                less, clearance = ENDS_KEEP * max(place.distance, 0.0), self.scene.planner.clearance
                return less, (
                    f"{field} is {place.words} from {place.other}: {less * 1e3:.3g} mm are required "
                    f"over the whole motion instead of the {clearance * 1e3:g} mm of planner.clearance"
                )
        return required, ""

    def _unknown(self, moved: Curve, proof: Proof) -> tuple[str, ...]:
        """A note on what is unknown where robot and obstacles come closest; empty where nothing is."""
        spot = proof.closest[0]
        if spot is None or not spot.unknown:
            return ()
        costs = zip(FIELDS, self.sweep.shares(moved, spot).tolist(), strict=True)
        text = ", ".join(f"{1e3 * cost:.3g} mm for {field}" for field, cost in costs if cost)
        whose = " and ".join(self._names(spot.pair))
        return (f"the uncertainty takes {1e3 * spot.unknown:.3g} mm where {whose} are closest: {text}",)

    def _check_times(self, curve: Curve) -> None:
        """Raise InputError if the scene needs times and the curve has none."""
        moving = self.scene.moving
        if curve.times is None and (moving or self.scene.timed):
            why = f"obstacle '{moving[0].name}' moves" if moving else "the scene limits rates (limits, timing)"
            raise InputError(f"trajectory: has no times, and {why}")

    def floor(self, required: float) -> Array:
        """Return the clearance that each pair must keep (P,) [m]."""
        pairs = self.sweep.pairs
        kept = self._kept[pairs.b]
        clearances = np.where(np.isnan(kept), required, kept)
        return np.where(pairs.group == 0, clearances, self.scene.self_collision.clearance)

    def contacts(self, q: ArrayLike, time: float = 0.0) -> tuple[Contact, ...]:
        """Return the contacts at one configuration and time [s]; see `check_configuration`."""
        depths: dict[tuple[str, str], float] = {}
        for spot in self.sweep.distances(self._configuration(q), 0.0, time):
            if spot.touching:
                names = self._names(spot.pair)
                depths[names] = max(depths.get(names, 0.0), -spot.distance)
        return tuple(Contact(*names, depths[names]) for names in sorted(depths, key=lambda names: -depths[names]))

    def _configuration(self, q: ArrayLike) -> Array:
        """Return the values (m,) of all joints of the model at a valid configuration (n,), as a NaN would be far from
        everything. Raises InputError."""
        return self.robot.expand(joint_numbers("q", q, self.robot.joint_names))

    def off_path(self, q: Array) -> tuple[Departure, ...]:
        """Return the path constraints that configuration q (n,) violates; exact up to rounding."""
        return () if self.path is None else self.path.at(self.robot.expand(q))

    def overload(self, q: ArrayLike) -> str | None:
        """Return the limit, in words, that the robot exceeds even at rest at q (n,), where gravity overloads a joint;
        None if it exceeds none."""
        values = np.asarray(q, dtype=np.float64)
        return next((message for check in self.limits if (message := check.overload(values))), None)

    def too_close(self, q: ArrayLike, required: float, time: float = 0.0) -> tuple[tuple[Place, float], ...]:
        """Return the places where one configuration, at a time [s], is closer to obstacles or itself than it must keep,
        less what is unknown, each with that clearance [m]; the closest first."""
        floor = self.floor(required)
        found = []
        within = float(floor.max(initial=0.0))
        for spot in self.sweep.distances(self._configuration(q), within, time, surfaces=True, unknown=True):
            if spot.touching or spot.distance < floor[spot.pair]:
                found.append((self._standing(spot), float(floor[spot.pair])))
        return tuple(sorted(found, key=lambda each: each[0].distance))

    def is_clear(self, q: ArrayLike, required: float, time: float = 0.0) -> bool:
        """True if nothing is `too_close` at a configuration."""
        return bool(self.are_clear(self._configuration(q)[None], required, time)[0])

    def are_clear(self, values: Array, required: float, time: float = 0.0) -> Mask:
        """True (B,) where nothing is `too_close`, of values (B, m) of all joints of the model."""
        return self.sweep.are_clear(values, self.floor(required), time)

    def hull_gap(self, q: ArrayLike, within: float, time: float = 0.0) -> float:
        """Return a lower bound of the distance to obstacles at one configuration and time [s], at most `within` [m]."""
        return self.sweep.hull_gap(self._configuration(q), within, time)

    def nearest(self, q: ArrayLike, within: float = np.inf, time: float = 0.0) -> tuple[Place | None, Place | None]:
        """Return the closest places at one configuration and time [s], with exact distances: to an obstacle, and
        between links; None where nothing is `within` [m]."""
        (spots,) = self.sweep.nearest(self._configuration(q)[None], np.array([time]), within)
        return self._places(spots)

    def nearest_along(
        self, configurations: Array, times: Array, within: float = np.inf
    ) -> list[tuple[Place | None, Place | None]]:
        """Return the `nearest` places at each of the configurations (k, n) and times (k,) [s]."""
        return [self._places(spots) for spots in self.sweep.nearest(self.robot.expand(configurations), times, within)]

    def _places(self, spots: tuple[Spot | None, Spot | None]) -> tuple[Place | None, Place | None]:
        to_obstacle, between_links = (self._standing(spot) if spot else None for spot in spots)
        return to_obstacle, between_links

    def closest(self, q: ArrayLike, time: float = 0.0) -> tuple[Closest | None, Closest | None]:
        """Return the `nearest` places at one configuration and time [s], with the closest points of the two bodies."""
        configuration = self._configuration(q)
        (spots,) = self.sweep.nearest(configuration[None], np.array([time]))
        to_obstacle, between_links = (
            Closest(*self._names(spot.pair), kind, spot.distance, self.sweep.witnesses(configuration, spot.pair, time))
            if spot
            else None
            for spot, kind in zip(spots, (True, False), strict=True)
        )
        return to_obstacle, between_links

    def _names(self, pair: int) -> tuple[str, str]:
        pairs, names = self.sweep.pairs, self.sweep.bodies.names
        return names[pairs.a[pair]], names[pairs.b[pair]]

    def _place(self, spot: Spot, curve: Curve) -> Place:
        parameter = (spot.interval + spot.fraction) / (len(curve) - 1)
        seconds = None if curve.times is None else float(curve.time_of(parameter))
        names = self._names(spot.pair)
        return Place(spot.interval, spot.fraction, parameter, seconds, *names, spot.distance, spot.unknown)

    def _standing(self, spot: Spot) -> Place:
        """Name the bodies of a place at a single configuration, without a motion."""
        return Place(0, spot.fraction, spot.fraction, None, *self._names(spot.pair), spot.distance, spot.unknown)


@made_once(8)
def _chain(robot: Robot) -> Chain:
    return Chain.of(robot.model)
