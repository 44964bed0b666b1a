"""The motions of stages without a choice, except for a redundant arm's way along a curve: lines and other curves,
fingers, outputs and waits."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.job.certify import Proven, certified_stage, standing
from hdplan.planner.job.following import (
    NotFollowedError,
    along_poses,
    drawn_off,
    drawn_through,
    length_of,
    near_guide,
    smooth_parts,
)
from hdplan.planner.job.joining import Piece, exactly_timed, one_after_other
from hdplan.planner.job.redundancy import ways_along
from hdplan.planner.job.stage_scenes import stage_certifier, stage_setup
from hdplan.planner.job.world import World
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.path_spline import smooth
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import HdplanError, InputError, naming
from hdplan.scenes.job import Grip, Release, Set, Stage, Wait
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.timing import Timing

STEADY_PLACES = 48  # places along a curve that is followed as steadily as the joints go
PLACES = (12, 24, 48, 96, 192, 384, 768, 1536)  # along it, as many as its tolerances need
ORDER = 4  # of what the motion between places is off, in their distance (`drawn_through`)
GAP_SHARE = 0.5  # share of the tolerances that the motion between places may take
HAND_PLACES = 5  # rows of a straight motion of the fingers
POSE_COORDINATES = 6  # coordinates of a pose
LOOKED_FOR = ((0.02, 1, False), (0.004, 1, True), (0.004, 3, True))  # ways along a curve: [m] beyond planner.clearance
# that their configurations keep, how many times as many of these, and whether they are close to each other everywhere


class StageFailedError(Exception):
    """A stage that cannot be done, and why."""


class _LateError(Exception):
    """The time limit passed during the search for ways along a curve."""


@dataclass(eq=False)
class Certain:
    """Makes such motions for the stages of one job."""

    stages: Sequence[Stage]
    seed: int
    late: Callable[[], bool]
    ways: dict[tuple[int, bytes], Array] = field(default_factory=dict)
    """Along the curve of a stage, by its number, from a configuration."""

    def done(self, world: World, number: int, plainly: bool = False) -> Piece:
        """Do a stage, and certify it; a curve only as steadily as the joints go, if `plainly`. Raises
        StageFailedError."""
        stage, setup = self.stages[number], stage_setup(world, number)
        scene, robot = setup.requested, setup.robot
        with naming(scene.source):  # values that the stage's own limits do not allow
            start = robot.configuration(scene.start)
            goal = robot.configuration(scene.goal) if isinstance(scene.goal, JointTarget) else start
        match stage:
            case Curve():
                return self._followed(world, number, start, plainly)
            case Grip() | Release() if stage.joints:
                motion = self._timed(setup, np.linspace(start, goal, HAND_PLACES))
            case Grip() | Release() | Set():
                motion = standing(robot, start, 1.0 / (scene.timing or Timing()).rate)
            case Wait():
                motion = standing(robot, start, stage.seconds)
            case _:
                raise TypeError(f"{stage.kind} leaves a choice")
        motion = exactly_timed(motion)
        found, there = certified_stage(world, number, motion)
        if not found.certificate.certified:
            raise StageFailedError(found.certificate.text)
        return Piece(motion, there, found.certificate.notes, proven=Proven(world, found, there))

    def _followed(self, world: World, number: int, start: Array, plainly: bool) -> Piece:
        """Follow the curve of a stage: as steadily as the joints go, or else on a way that leads to the end. Raises
        StageFailedError."""
        way = self.ways.get((number, start.tobytes()))
        if way is not None:
            return self._guided(world, number, start, way)
        try:
            return self._guided(world, number, start, None)
        except StageFailedError as failed:
            if plainly or self.late():
                raise
            try:
                way = next(self.ways_along(stage_setup(world, number), start, start), None)
            except NotFollowedError as error:
                raise StageFailedError(f"{failed}; {error}") from None
            if way is None:
                raise
        return self._guided(world, number, start, way)

    def ways_along(self, setup: Setup, at: Array, start: Array | None) -> Iterator[Array]:
        """Yield ways along the curve of a stage that begins at joint values `at` (n,), from there or from wherever its
        first pose is reached: well away from what stands around first. Ends where time is up. Raises
        NotFollowedError, which says how far one gets, where there is none."""
        follow, certifier = setup.scene.path.follow, Certifier(setup)
        assert follow is not None
        if setup.robot.n <= (POSE_COORDINATES if follow.free_rotation == "none" else POSE_COORDINATES - 1):
            return  # nothing is left open along the curve
        quick = setup.limits.get("velocity", np.ones(setup.robot.n))
        found, nowhere = False, None
        for beside, finer, close in LOOKED_FOR:
            free = functools.partial(self._are_free, certifier, setup.scene.planner.clearance + beside)
            try:
                for way in ways_along(
                    setup.robot, start, follow, length_of(follow), quick, self.seed, free, finer, close
                ):
                    yield way
                    found = True
            except NotFollowedError as error:
                nowhere = error
            except _LateError:
                return
        if nowhere is not None and not found:
            raise nowhere

    def _are_free(self, certifier: Certifier, clearance: float, rows: Array) -> Mask:
        if self.late():
            raise _LateError
        return certifier.are_clear(certifier.robot.expand(rows), clearance)

    def _guided(self, world: World, number: int, start: Array, way: Array | None) -> Piece:
        """Follow a curve near a way along it, or as steadily as the joints go: through ever more places, until the
        motion keeps to its tolerances between them. Raises StageFailedError."""
        setup = stage_setup(world, number)
        follow = setup.scene.path.follow
        assert follow is not None
        parts = smooth_parts(follow)
        shares = np.cumsum([0.0, *map(length_of, parts)]) / length_of(follow)
        spline = None if way is None else smooth(drawn_through(way))
        least = 0
        while least < len(PLACES):
            motions: list[Trajectory] = []
            used = least
            for part, first, last in zip(parts, shares[:-1].tolist(), shares[1:].tolist(), strict=True):
                begins = motions[-1].positions[-1] if motions else start
                guide = None if spline is None else functools.partial(_between, spline, first, last)
                try:
                    rows, finer = _drawn(setup.robot, begins, part, follow, guide, least)
                except NotFollowedError as error:
                    raise StageFailedError(str(error)) from None
                used = max(used, finer)
                self._check_contact(world, number, rows)
                try:
                    motions.append(self._timed(setup, drawn_through(rows)))
                except InputError:
                    raise
                except HdplanError as error:
                    raise StageFailedError(
                        f"{error}: the curve runs through a singularity faster than the joints can"
                    ) from None
            motion = exactly_timed(one_after_other(motions))
            found, there = certified_stage(world, number, motion)
            if found.certificate.certified:
                return Piece(motion, there, found.certificate.notes, proven=Proven(world, found, there))
            if found.certificate.status is not Status.OFF_PATH:
                break
            least = used + 1
        raise StageFailedError(found.certificate.text)

    def _check_contact(self, world: World, number: int, rows: Array) -> None:
        """Refuse configurations (N, n) evenly along a curve of which one is in contact: that takes a fraction of the
        time of a motion and its certificate, which would say the same. Raises StageFailedError."""
        certifier = stage_certifier(world, number)
        if certifier.scene.moving:
            return
        for row in np.flatnonzero(~certifier.are_clear(certifier.robot.expand(rows), 0.0)).tolist():
            if contacts := certifier.contacts(rows[row]):
                one, other, deep = contacts[0].link, contacts[0].other, contacts[0].depth
                meet = f"overlap by {deep * 1e3:.3g} mm" if deep else "touch"
                raise StageFailedError(
                    f"in contact: {one} and {other} {meet} at {row / (len(rows) - 1):.0%} of the way"
                )

    def _timed(self, setup: Setup, waypoints: Array) -> Trajectory:
        path = Trajectory(setup.robot.joint_names, waypoints, setup.robot.locked)
        try:
            return Retimer(setup)(path).trajectory
        except InputError:
            raise
        except HdplanError as error:
            raise StageFailedError(str(error)) from None


def _drawn(
    robot: Robot, begins: Array, part: Follow, whole: Follow, guide: Callable[[Array], Array] | None, least: int
) -> tuple[Array, int]:
    """Return configurations evenly along a part of a curve, near a guide, or as steadily as they go, and which number
    of PLACES that is: the first one, from the least on, for which the motion between them keeps to the tolerances.
    Raises NotFollowedError."""
    if guide is None:
        guide = smooth(drawn_through(along_poses(robot, begins, part, STEADY_PLACES)))
    number, last = least, len(PLACES) - 1
    while True:
        rows = near_guide(robot, begins, part, PLACES[number], guide)
        off, turned = drawn_off(robot, part, rows)
        beyond = max(off / whole.position_tolerance, turned / whole.orientation_tolerance) / GAP_SHARE
        if beyond <= 1.0 or number == last:
            return rows, number
        number = min(number + max(1, int(math.log2(beyond) / ORDER)), last)


def _between(way: Callable[[Array], Array], first: float, last: float, shares: Array) -> Array:
    """Return joint values (k, n) at shares (k,) of the part of a way from one share of it to another."""
    return way((1.0 - shares) * first + shares * last)
