"""Planning of a job: stage after stage, each from where the last one ended, with another choice further back where one
cannot be done.

A stage whose goal leaves a choice (a pose with several configurations, several grasps) is tried with one configuration
after the other, the most promising first; before a motion to one is planned, the stages up to the next move of the arm
are tried from there, which costs little. The first choice that leads to the end is taken. Lines, grips and waits leave
no choice.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.job.certify import certified_stage, certify_job, standing
from hdplan.planner.job.changes import after
from hdplan.planner.job.following import NotFollowedError, along_poses, smooth_parts
from hdplan.planner.job.places import link_pose, pose_of
from hdplan.planner.job.result import JobResult
from hdplan.planner.job.stage_scenes import stage_setup
from hdplan.planner.job.world import World
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import StageMark, Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import goal_choice
from hdplan.planner.search.search import Event
from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import InputError, TimeLimitError, UnsolvableError, naming
from hdplan.scenes.job import Grip, Job, Move, Release, Set, Wait, stage_name
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import Number, Whole, checked, instance

PLACES = (48, 192)  # along a line: more of them where the motion between them leaves its tolerance
SHARE = 0.3  # of the time left, for one motion where there are others to try
HAND_PLACES = 5


@dataclass(frozen=True)
class Piece:
    """The motion of one stage, and what there is after it."""

    motion: Trajectory
    after: World
    notes: tuple[str, ...] = ()


class _StageFailedError(Exception):
    """A stage that cannot be done, and why."""


def plan_job(
    scene: Scene,
    *,
    seed: int = 0,
    time_limit: float = 60.0,
    report: Callable[[Event], None] = lambda event: None,
    stop: Callable[[], bool] = lambda: False,
) -> JobResult:
    """Plan a job: find motions for all its stages, and certify each as it was driven.

    Args:
        scene: one with a job.
        seed: of random first guesses and configurations; the same seed gives the same result, as far as the time limit
            allows.
        time_limit: [s] for everything. What was planned by then comes back, and says which stage is missing, and why.
        report: called with every step and every certificate of the motions that are planned.
        stop: called at every step; once it returns True, what was planned so far comes back.

    Raises:
        InputError: for a scene without a job, and for errors in the scene, its robot or a stage, which it names.
        TimeLimitError: a `deadline.time_limit` passed before there was a motion.
    """
    instance(scene, Scene, "scene")
    seed = checked(Whole(0, 2**63 - 1), seed, "seed")
    time_limit = checked(Number(low=0.0, unit="s"), time_limit, "time_limit")
    began = time.perf_counter()
    first = World.at_first(scene)
    search = _Search(scene, seed, began + time_limit, report, stop)
    pieces = search.run(first)
    assert scene.job is not None
    names = scene.job.names
    refused = tuple(f"{names[number]}: {why}" for number, why in search.refused)
    if not pieces and not search.refused:
        ended = f"the time limit of {time_limit:g} s passed, or it was stopped, before the first stage was planned"
        raise TimeLimitError(f"{scene.source}: {ended}")
    if not pieces:
        number, why = search.refused[0]
        raise UnsolvableError(f"{scene.source}: job[{number}] ({names[number]}): {why}", "stage_failed")
    trajectory = joined(pieces, scene.job)
    certificate = certify_job(scene, trajectory)
    failure = "" if len(pieces) == len(names) else _failure(search, names, len(pieces))
    said = (
        *(note for piece in pieces for note in piece.notes),
        *certificate.notes,
    )
    notes = tuple(dict.fromkeys((*scene.notes, *said, *refused)))
    return JobResult(scene, trajectory, certificate, failure, seed, notes, time.perf_counter() - began)


def _failure(search: _Search, names: Sequence[str], done: int) -> str:
    """Say which stage stopped the job, why, and what would help."""
    found = [why for number, why in search.refused if number == done]
    if not found:
        return f"stage '{names[done]}' was not reached within the time limit; more time may help"
    times = f" (the last of {len(found)} tries)" if len(found) > 1 else ""
    return f"stage '{names[done]}'{times}: {found[-1]}"


class _Search:
    """Depth first over the choices of all stages."""

    def __init__(
        self, scene: Scene, seed: int, deadline: float, report: Callable[[Event], None], stop: Callable[[], bool]
    ) -> None:
        assert scene.job is not None
        self.stages, self.seed, self.deadline = scene.job.stages, seed, deadline
        self.report, self.stop = report, stop
        self.refused: list[tuple[int, str]] = []  # the stage, and why a choice for it was given up
        self._made: dict[int, list[tuple[World, Piece | str]]] = {}  # what leaves no choice, by stage

    def run(self, world: World) -> list[Piece]:
        """Return the pieces of all stages, or of the most that were done one after the other."""
        best: list[Piece] = []
        pieces: list[Piece] = []
        open_ = [self._choices(world, 0)]
        while open_ and not self._late():
            piece = next(open_[-1], None)
            if piece is None:
                open_.pop()
                if pieces:
                    pieces.pop()
                continue
            pieces.append(piece)
            if len(pieces) > len(best):
                best = [*pieces]
            if len(pieces) == len(self.stages):
                return pieces
            open_.append(self._choices(piece.after, len(pieces)))
        return best

    def _late(self) -> bool:
        return time.perf_counter() >= self.deadline or self.stop()

    def _choices(self, world: World, number: int) -> Iterator[Piece]:
        """Yield ways to do a stage, the most promising first."""
        stage = self.stages[number]
        if not isinstance(stage, Move):
            if isinstance(found := self._only(world, number), Piece):
                yield found
            else:
                self.refused.append((number, found))
            return
        setup = stage_setup(world, number)
        scene = setup.asked
        try:
            goals = self._goals(setup)
        except UnsolvableError as error:
            self.refused.append((number, _cause(error, scene)))
            return
        for goal in goals:
            if self._late():
                return
            try:
                if len(goals) > 1:
                    self._look_ahead(world, number, goal)
                yield self._moved(world, number, scene, goal, len(goals) > 1)
            except _StageFailedError as failed:
                self.refused.append((number, str(failed)))

    def _goals(self, setup: Setup) -> tuple[JointTarget, ...]:
        """Return the configurations to which a stage may lead."""
        if isinstance(setup.scene.goal, JointTarget):
            return (setup.scene.goal,)
        return goal_choice(Certifier(setup), self.seed).goals

    def _look_ahead(self, world: World, number: int, goal: JointTarget) -> None:
        """Try the stages up to the next move of the arm from a configuration. Raises _StageFailedError."""
        assert goal.positions is not None
        there = after(world, number, stage_setup(world, number).robot, np.array(goal.positions))
        for following in range(number + 1, len(self.stages)):
            if isinstance(self.stages[following], Move):
                return
            found = self._only(there, following)
            if isinstance(found, str):
                name = stage_name(self.stages[following], following)
                raise _StageFailedError(f"given up, as stage '{name}' cannot follow it: {found}")
            there = found.after

    def _moved(self, world: World, number: int, scene: Scene, goal: JointTarget, others: bool) -> Piece:
        """Plan a move of the arm to one configuration. Raises _StageFailedError."""
        left = max(0.0, self.deadline - time.perf_counter())
        aimed = derived(scene, goal=goal)
        try:
            result = plan(
                aimed, seed=self.seed, time_limit=left * (SHARE if others else 1.0), report=self.report, stop=self.stop
            )
        except (UnsolvableError, TimeLimitError) as error:
            raise _StageFailedError(_cause(error, scene)) from None
        if not result.certified:
            raise _StageFailedError(result.certificate.text)
        robot = stage_setup(world, number).robot
        rows = curve_of(robot, result.trajectory).rows
        return Piece(result.trajectory, after(world, number, robot, rows[-1]), result.notes)

    def _only(self, world: World, number: int) -> Piece | str:
        """Do a stage that leaves no choice, or say why it cannot be done; what was found once is kept."""
        kept = self._made.setdefault(number, [])
        for before, found in kept:
            if before == world:
                return found
        try:
            made: Piece | str = self._done(world, number)
        except _StageFailedError as failed:
            made = str(failed)
        kept.append((world, made))
        return made

    def _done(self, world: World, number: int) -> Piece:
        stage, setup = self.stages[number], stage_setup(world, number)
        scene, robot = setup.asked, setup.robot
        with naming(scene.source):  # values that the stage's own limits do not allow
            start = robot.configuration(scene.start)
            goal = robot.configuration(scene.goal) if isinstance(scene.goal, JointTarget) else start
        match stage:
            case Curve():
                return self._followed(world, number, start)
            case Grip() | Release() if stage.joints:
                motion = self._timed(setup, np.linspace(start, goal, HAND_PLACES))
            case Grip() | Release() | Set():
                motion = standing(robot, start, 1.0 / (scene.timing or Timing()).rate)
            case Wait():
                motion = standing(robot, start, stage.seconds)
            case _:
                raise TypeError(f"{stage.kind} leaves a choice")
        found, there = certified_stage(world, number, motion)
        if not found.certificate.certified:
            raise _StageFailedError(found.certificate.text)
        return Piece(motion, there, found.certificate.notes)

    def _followed(self, world: World, number: int, start: Array) -> Piece:
        """Follow the curve of a stage. Raises _StageFailedError."""
        setup = stage_setup(world, number)
        follow = setup.scene.path.follow or _straight(setup, start)
        for count in PLACES:
            motions: list[Trajectory] = []
            for part in smooth_parts(follow):
                begins = motions[-1].positions[-1] if motions else start
                try:
                    motions.append(self._timed(setup, along_poses(setup.robot, begins, part, count)))
                except NotFollowedError as error:
                    raise _StageFailedError(str(error)) from None
            motion = one_after_other(motions)
            found, there = certified_stage(world, number, motion)
            if found.certificate.certified:
                return Piece(motion, there, found.certificate.notes)
            if found.certificate.status is not Status.OFF_PATH:
                break
        raise _StageFailedError(found.certificate.text)

    def _timed(self, setup: Setup, waypoints: Array) -> Trajectory:
        from hdplan.planner.timing.retiming import Retimer

        path = Trajectory(setup.robot.joint_names, waypoints, setup.robot.locked)
        return Retimer(setup)(path).trajectory


def _straight(setup: Setup, start: Array) -> Follow:
    """Return the line of a stage along which nothing turns."""
    assert isinstance(setup.scene.goal, Goals)
    (target,) = setup.scene.goal.targets
    assert isinstance(target, PoseTarget)
    assert target.link is not None
    return Follow(target.link, (pose_of(link_pose(setup.robot, start, target.link)), target.pose))


def one_after_other(motions: Sequence[Trajectory]) -> Trajectory:
    """Return motions of the same joints, each of which begins with the row with which the last one ended, as one."""
    rows: list[list[Array]] = [[], [], [], []]
    begins = 0.0
    for i, motion in enumerate(motions):
        assert motion.times is not None
        assert motion.velocities is not None
        assert motion.accelerations is not None
        times = begins + (motion.times - motion.times[0])
        for kept, given in zip(rows, (motion.positions, times, motion.velocities, motion.accelerations), strict=True):
            kept.append(given[min(i, 1) :])
        begins = float(times[-1])
    positions, times, velocities, accelerations = (np.concatenate(each) for each in rows)
    return Trajectory(motions[0].joint_names, positions, motions[0].locked, times, velocities, accelerations)


def _cause(error: InputError | TimeLimitError, scene: Scene) -> str:
    return str(error).removeprefix(f"{scene.source}: ")


def joined(pieces: Sequence[Piece], job: Job) -> Trajectory:
    """Return one motion of all joints that the pieces move, one piece after the other, with marks where they begin. A
    piece begins with the row with which the last one ended; there everything rests."""
    joints = tuple(dict.fromkeys(joint for piece in pieces for joint in piece.motion.joint_names))
    held = [piece.motion.locked for piece in pieces]
    at = {
        joint: next(each[joint] for each in held if joint in each)
        for joint in joints
        if joint not in pieces[0].motion.joint_names
    }
    blocks, marks, times, begins, row = [], [], [], 0.0, 0
    for i, (piece, name, stage) in enumerate(zip(pieces, job.names, job.stages, strict=False)):
        motion = piece.motion
        assert motion.times is not None
        rows = np.zeros((3, len(motion), len(joints)))
        for column, joint in enumerate(joints):
            if joint in motion.joint_names:
                own = motion.joint_names.index(joint)
                values = (motion.positions, motion.velocities, motion.accelerations)
                for block, given in zip(rows, values, strict=True):
                    block[:, column] = 0.0 if given is None else given[:, own]
                at[joint] = float(motion.positions[-1, own])
            else:
                rows[0, :, column] = at[joint]
        rows[1:, [0, -1]] = 0.0  # at rest: what is left there is rounding
        first = 0 if i == 0 else 1
        blocks.append(rows[:, first:])
        times.append((begins + (motion.times - motion.times[0]))[first:])
        marks.append(StageMark(name, row, stage.outputs if isinstance(stage, Set) else {}))
        row += len(motion) - 1
        begins = float(times[-1][-1])
    positions, velocities, accelerations = np.concatenate(blocks, axis=1)
    last = {joint: value for joint, value in held[-1].items() if joint not in joints}
    steady = {joint: value for joint, value in last.items() if all(each.get(joint) == value for each in held)}
    return Trajectory(joints, positions, steady, np.concatenate(times), velocities, accelerations, stages=tuple(marks))
