"""Goal configurations where the goal leaves a choice: configurations that reach it (`inverse_kinematics`) and are free,
best first. Arms whose every branch a closed form gives are not searched, but where none of these is free.

They are ordered by joint-space distance from the start, or by the time that it takes where time is the objective, times
up to 2 where obstacles are close. The planner's
kinematics finds them, the certificate checks them with its own. One seeded generator makes all random draws: the same
seed gives the same goals.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.pose_goals import Miss
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.kinematics.inverse import Aim
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.inverse_kinematics import STARTS, every_branch, reaching
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.errors import UnsolvableError, naming
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.targets import AllOf, JointTarget, PoseTarget

if TYPE_CHECKING:
    from hdplan.planner.problem.path_terms import PathTerm


DRAW_ROUNDS = 10  # rounds of draws at most, where a pose can be reached but not freely
CHECKED_TOGETHER = 16  # configurations in one collision check
COMPARED_GOALS = 12  # free configurations of a pose that are compared, those nearest to the start
CLOSE_GOAL = 0.03  # [m] to an obstacle below which a goal is penalized
FEWEST_STARTS = 16  # of inverse kinematics, where there are many targets
PLANNED_GOALS = 4  # goals to which motions are planned, over all targets; at least one of each


class Choice(NamedTuple):
    """The goals for plans."""

    goals: tuple[JointTarget, ...]  # best first; the scene's own alone where it leaves no choice
    words: tuple[str, ...]  # notes for the user


def goal_choice(certifier: Certifier, seed: int = 0, each: int = 1) -> Choice:
    """Return the configurations in which a motion of this scene may end, the most promising first: PLANNED_GOALS of
    them over all targets, but at least `each` of every one that is reached freely. Of many targets each is examined
    less; where some are reached freely, the others are not examined again.

    Raises:
        InputError: an unknown link, joint values that do not fit, or no target that can be reached without contact; the
        message says how close the link came, or what it touches.
    """
    scene, robot = certifier.scene, certifier.robot
    if isinstance(scene.goal, JointTarget):
        return Choice((scene.goal,), ())
    rng = np.random.default_rng(seed)
    most = max(each, PLANNED_GOALS // len(scene.goal.targets))
    found: list[tuple[float, JointTarget]] = []
    refused, words, causes = [], [], []
    path = _path(certifier.setup)
    with naming(scene.source):
        start = robot.configuration(scene.start, scene.from_request)
        looked: dict[int, _Reached] = {}
        before = 0
        for drawn in range(DRAW_ROUNDS):
            starts = STARTS if drawn else _starts(len(scene.goal.targets))
            for i, target in enumerate(scene.goal.targets):
                if i not in looked or starts > before or len(looked[i].reached):
                    draws = DRAW_ROUNDS if drawn or len(scene.goal.targets) == 1 else 1
                    looked[i] = _looked_for(certifier, target, start, rng, path, starts, draws)
            before, none = starts, not any(len(each.reached) for each in looked.values())
            if any(each.free for each in looked.values()) or (none and starts == STARTS):
                break
        for i, target in enumerate(scene.goal.targets):
            reached, nearest, free = looked[i].reached, looked[i].nearest, looked[i].free
            if free and nearest is not None:
                words.append(f"{target.field}: {_configurations(len(reached))} found; free and compared: {len(free)}")
            elif not free:
                cause, why = _refusal(target, certifier, reached, nearest)
                refused.append(f"{target.field}: {why}")
                causes.append(cause)
            found += [(score, JointTarget(target.field, tuple(q.tolist()))) for score, q in free[:most]]
        if not found:
            raise UnsolvableError("; ".join(refused), causes[0])
    return Choice(tuple(goal for _, goal in sorted(found, key=lambda each: each[0])), (*words, *refused))


def goals_in_turn(certifier: Certifier, seed: int = 0, each: int = 1) -> Iterator[JointTarget]:
    """Yield the goals of `goal_choice`, the best of each target first, in their order, then the second ones. Of several
    targets, one is tested whether it is reached freely only when it may be the next one: no score is less than how far
    it is at least. Raises errors as `goal_choice`."""
    scene, robot = certifier.scene, certifier.robot
    looked: list[_Reached] = []
    if not isinstance(scene.goal, JointTarget) and len(scene.goal.targets) > 1:
        rng, path, starts = np.random.default_rng(seed), _path(certifier.setup), _starts(len(scene.goal.targets))
        with naming(scene.source):
            start = robot.configuration(scene.start, scene.from_request)
            looked = [_looked_for(certifier, each, start, rng, path, starts, 1) for each in scene.goal.targets]
    waiting = [(one.least, False, i) for i, one in enumerate(looked) if len(one.reached)]
    heapify(waiting)
    none = True
    while waiting:
        _, checked, i = heappop(waiting)
        if checked:
            none = False
            yield looked[i].goals[0]
        elif looked[i].free:
            heappush(waiting, (looked[i].free[0][0], True, i))
    most = max(each, PLANNED_GOALS // max(1, len(looked)))
    for rank in range(1, most):
        others = [(one.free[rank][0], i) for i, one in enumerate(looked) if len(one.free) > rank]
        yield from (looked[i].goals[rank] for _, i in sorted(others))
    if none:
        yield from _each_in_turn(goal_choice(certifier, seed, each).goals)


def _each_in_turn(goals: Sequence[JointTarget]) -> tuple[JointTarget, ...]:
    """Return configurations in the same order, but the first ones of all targets before the second ones."""
    before: Counter[str] = Counter()
    ranked = []
    for goal in goals:
        ranked.append((before[goal.field], goal))
        before[goal.field] += 1
    return tuple(goal for _, goal in sorted(ranked, key=lambda each: each[0]))


def _starts(targets: int) -> int:
    """Return from how many configurations each of some targets is sought at first."""
    return max(FEWEST_STARTS, min(STARTS, STARTS * PLANNED_GOALS // targets))


@dataclass(frozen=True, eq=False)
class _Reached:
    """Configurations that reach a target, and which of them are free."""

    certifier: Certifier
    target: JointTarget | PoseTarget | AllOf
    start: Array  # (n,)
    reached: Array  # (B, n)
    nearest: tuple[Miss, ...] | None  # by how much a pose was missed at least; None of joint values

    @cached_property
    def families(self) -> Array:
        """The configurations (k, m, n), those that are nearest first; where time counts, each after one that the
        slowest joint reaches sooner."""
        scene, setup = self.certifier.scene, self.certifier.setup
        timed = scene.objective == "time" and scene.path == PathConstraints()
        if isinstance(self.target, JointTarget) or not len(self.reached) or not timed:
            return self.reached[:, None]
        from hdplan.planner.search.sooner import sooner

        better = sooner(Aim.at(setup.robot, self.target), self.reached, self.start, setup.limits)
        families = np.stack([better, self.reached], axis=1)
        return families[np.argsort([_length(setup, q - self.start) for q in better], kind="stable")]

    @property
    def least(self) -> float:
        """A bound below which no score is."""
        setup = self.certifier.setup
        return min(_length(setup, q - self.start) for q in self.families.reshape(-1, len(self.start)))

    @cached_property
    def free(self) -> list[tuple[float, Array]]:
        """The nearest configurations without contact that satisfy the path constraints, each with its score."""
        return _free(self.certifier, self.families, self.start)

    @property
    def goals(self) -> list[JointTarget]:
        """The configurations as goals."""
        return [JointTarget(self.target.field, tuple(q.tolist())) for _, q in self.free]


def _looked_for(
    certifier: Certifier,
    target: JointTarget | PoseTarget | AllOf,
    start: Array,
    rng: np.random.Generator,
    path: tuple[PathTerm, ...],
    starts: int,
    draws: int,
) -> _Reached:
    """Look for configurations that reach a target; they are drawn again, up to so many `draws`, where none is free."""
    robot = certifier.robot
    if isinstance(target, JointTarget):
        reached = robot.nearest_turn(robot.configuration(target)[None], start)
        return _Reached(certifier, target, start, reached, None)
    for drawn in range(draws):
        reached, nearest = every_branch(robot, target, start) if not (drawn or path) else (np.empty(0), ())
        if not len(reached):
            reached, nearest = reaching(robot, target, start, rng, path, starts)
        if path and not len(reached):  # to say whether the pose or the path is to blame
            reached, nearest = reaching(robot, target, start, rng, starts=starts)
        found = _Reached(certifier, target, start, robot.nearest_turn(reached, start), nearest)
        if drawn == draws - 1 or found.free or not len(reached):
            break
    return found


def _path(setup: Setup) -> tuple[PathTerm, ...]:
    """Return the scene's path constraints, which hold at the end too."""
    if setup.scene.path == PathConstraints():
        return ()
    from hdplan.planner.problem.path_terms import path_terms

    return path_terms(setup, kinematics_of(setup.robot).supports)


def settled(setup: Setup, motion: Trajectory | None = None) -> Setup:
    """Return a copy with one configuration as its goal: where `motion` ends, if the goal is met there, or else the
    most promising one. Itself if its goal leaves no choice. Raises InputError as `goal_choice`."""
    scene = setup.scene
    if isinstance(scene.goal, JointTarget):
        return setup
    certifier = Certifier(setup)
    if motion is not None:
        end = curve_of(setup.robot, motion).rows[-1]
        with naming(scene.source):
            met = certifier.ends.off_goal(end) is None
        if met:
            return setup.aiming_at(JointTarget(scene.goal.field, tuple(end.tolist())))
    return setup.aiming_at(goal_choice(certifier).goals[0])


def may_end(certifier: Certifier, q: Array, required: float = 0.0) -> bool:
    """True if a motion may end in a configuration (n,): with the clearance required [m], on the path constraints, and
    with torques that the joints can bear."""
    return bool(may_end_each(certifier, q[None], required)[0])


def may_end_each(certifier: Certifier, rows: Array, required: float = 0.0) -> Mask:
    """True (B,) where a motion `may_end`, of configurations (B, n)."""
    may = certifier.are_clear(certifier.robot.expand(rows), required, certifier.scene.end_time)
    may[may] = [not (certifier.off_path(q) or certifier.overload(q)) for q in rows[may]]
    return may


def _free(certifier: Certifier, families: Array, start: Array) -> list[tuple[float, Array]]:
    """The COMPARED_GOALS first ones of families (k, m, n) that have one in which a motion may end, each with its score,
    best first."""
    scored = []
    together = (families[first : first + CHECKED_TOGETHER] for first in range(0, len(families), CHECKED_TOGETHER))
    for q in itertools.islice((q for some in together for q in _fitting(certifier, some)), COMPARED_GOALS):
        crowded = 1.0 - max(0.0, certifier.hull_gap(q, CLOSE_GOAL, certifier.scene.end_time)) / CLOSE_GOAL
        scored.append((_length(certifier.setup, q - start) * (1.0 + crowded), q))
    return sorted(scored, key=lambda each: each[0])


def _fitting(certifier: Certifier, families: Array) -> list[Array]:
    """Return the first one of each family (k, m, n) in which a motion may end, where there is one: tested together."""
    found: dict[int, Array] = {}
    for member in np.moveaxis(families, 1, 0):
        left = [i for i in range(len(families)) if i not in found]
        if left:
            ends = may_end_each(certifier, member[left])
            found |= {i: member[i] for i, may in zip(left, ends.tolist(), strict=True) if may}
    return [found[i] for i in sorted(found)]


def _length(setup: Setup, way: Array) -> float:
    """Lower bound on the length of a way (n,): the least time [s] of its slowest joint where time is the objective,
    else its length in joint space."""
    if setup.scene.objective == "time":
        from hdplan.planner.timing.least_time import least_time

        return least_time(way, setup.limits)
    return float(np.linalg.norm(way))


def _refusal(
    target: JointTarget | PoseTarget | AllOf, certifier: Certifier, reached: Array, nearest: tuple[Miss, ...] | None
) -> tuple[str, str]:
    """Return the reason why no motion may end in a target: the cause, and a sentence."""
    if not isinstance(target, JointTarget) and nearest is not None and not len(reached):
        names = " and ".join(f"'{pose.link}'" for pose in target.poses)
        several = len(target.poses) > 1
        cannot = f"link{'s' * several} {names} cannot be brought there{' together' * several}"
        off, allowed = _listed(nearest), _listed(_tolerances(target))
        return "goal_not_reached", f"{cannot}: the best of {STARTS} tries is off by {off}, allowed are {allowed}"
    cause, fault = _fault(certifier, reached[0])
    found = "" if nearest is None else f"none of {_configurations(len(reached))} found is valid; the nearest: "
    return cause, found + fault


def _tolerances(target: PoseTarget | AllOf) -> tuple[Miss, ...]:
    return tuple(
        Miss(pose.position_tolerance, 0.0 if pose.free_rotation == "all" else pose.orientation_tolerance)
        for pose in target.poses
    )


def _listed(misses: tuple[Miss, ...]) -> str:
    return "; ".join(str(miss) for miss in misses)


def _fault(certifier: Certifier, q: Array) -> tuple[str, str]:
    """Return the reason why a motion may not end in a configuration: the cause, and a sentence."""
    if departures := certifier.off_path(q):
        return "end_off_path", f"breaks a path constraint: {departures[0].words}"
    if overload := certifier.overload(q):
        return "end_overloaded", f"overloads a joint: {overload}"
    place, required = certifier.too_close(q, 0.0, certifier.scene.end_time)[0]
    if place.distance > 0.0:
        found = f"{place.distance * 1e3:.3g} mm, {required * 1e3:g} mm are required"
        return "end_too_close", f"too close: from {place.link} to {place.other} {found}"
    depth = f"overlap by {-place.distance * 1e3:.3g} mm" if place.distance else "touch"
    doubt = certifier.robot.doubt([(place.link, place.other)])
    return "end_in_contact", f"in collision: {place.link} and {place.other} {depth}{doubt}"


def _configurations(count: int) -> str:
    return f"{count} configuration" + "s" * (count != 1)
