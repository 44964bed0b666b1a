"""Planning of a job: stage after stage, each from where the last one ended, with another choice further back where one
cannot be done.

A stage whose goal leaves a choice (a pose with several configurations, several grasps) is tried with one configuration
after the other, the most promising of each pose first. Before a motion to one is planned, the stages up to the next
move of the arm are tried from there, and whether that move has a goal from which it goes on in the same way, as to set
down what was taken by this grasp: motions cost more. The first choice that leads to the end is taken. Lines, grips and
waits leave no choice.

Some errors in the input show only where a choice has led: an object out of a hand's reach, a curve without a length.
They rule out that choice, and the next one is tried; one that alone ended what came farthest is raised.
"""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.job.blending import NotBlendedError, blended
from hdplan.planner.job.certain import Certain, StageFailedError
from hdplan.planner.job.certify import certify_job
from hdplan.planner.job.changes import after
from hdplan.planner.job.curves import turns_with_tool
from hdplan.planner.job.joining import Piece, joined
from hdplan.planner.job.result import JobResult
from hdplan.planner.job.stage_scenes import stage_setup
from hdplan.planner.job.world import World
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.plan import plan
from hdplan.planner.search.goals import goal_choice
from hdplan.planner.search.search import Event
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import InputError, MisplacedError, TimeLimitError, UnsolvableError
from hdplan.scenes.job import Job, Move, stage_name
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.stage import ArmStage
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import Number, Whole, checked, functions, instance

SHARE = 0.3  # of the time left, for one motion where there are others to try
EACH = 3  # configurations of every pose that a move may lead to
BEGINNINGS = 4  # of a curve that are tried for each configuration of a move's goal


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
    functions(report=report, stop=stop)
    began = time.perf_counter()
    first = World.at_first(scene)
    assert scene.job is not None
    names = scene.job.names
    rested = at_rest(scene)
    search = _Search(rested, seed, began + time_limit, report, stop)
    pieces = search.run(replace(first, scene=rested))
    if len(pieces) < len(names) and search.wrong is not None and not search.late():
        raise search.wrong
    refused = tuple(f"{names[number]}: {why}" for number, why in search.refused)
    if not pieces and not search.refused:
        ended = f"the time limit of {time_limit:g} s passed, or it was stopped, before the first stage was planned"
        raise TimeLimitError(f"{scene.source}: {ended}")
    if not pieces:
        number, why = search.refused[0]
        raise UnsolvableError(f"{scene.source}: job[{number}] ({names[number]}): {why}", "stage_failed")
    failure = "" if len(pieces) == len(names) else _failure(search, names, len(pieces))
    try:
        pieces = blended(first, pieces)
    except NotBlendedError as error:
        pieces = pieces[: error.number]
        failure = f"stage '{names[error.number]}': cannot be blended into the next one: {error}"
    if not pieces:
        raise UnsolvableError(f"{scene.source}: job[0] ({names[0]}): {failure}", "stage_failed")
    trajectory = joined(pieces, scene.job)
    certificate = certify_job(scene, trajectory)
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


def at_rest(scene: Scene) -> Scene:
    """Return a scene whose job's stages all end at rest: so they are planned, before they are blended. A curve that
    leads elsewhere with each turn of the tool where it begins, and begins in a blend, keeps that turn: from it the
    certificate tells where the curve leads."""
    assert scene.job is not None
    stages = [replace(stage, blend=0.0) if isinstance(stage, ArmStage) else stage for stage in scene.job.stages]
    for k, (before, stage) in enumerate(itertools.pairwise(scene.job.stages), 1):
        if isinstance(before, Move) and before.blend and isinstance(stage, Curve) and turns_with_tool(stage):
            stages[k] = replace(stage, blend=0.0, free_rotation="none")
    return derived(scene, job=Job(stages))


class _Search:
    """Depth first over the choices of all stages."""

    def __init__(
        self, scene: Scene, seed: int, deadline: float, report: Callable[[Event], None], stop: Callable[[], bool]
    ) -> None:
        assert scene.job is not None
        self.scene, self.stages, self.seed, self.deadline = scene, scene.job.stages, seed, deadline
        self.report, self.stop = report, stop
        self.refused: list[tuple[int, str]] = []  # the stage, and why a choice for it was given up
        self.wrong: MisplacedError | None = None  # what alone ended what came farthest
        self._farthest = -1  # stage that was tried
        self._made: dict[int, list[tuple[World, bool, Piece | str]]] = {}  # what leaves no choice, by stage
        self._aims: dict[int, list[tuple[World, tuple[JointTarget, ...] | str]]] = {}  # of moves, by stage
        self.certain = Certain(self.stages, seed, self.late)

    def run(self, world: World) -> list[Piece]:
        """Return the pieces of all stages, or of the most that were done one after the other."""
        best: list[Piece] = []
        pieces: list[Piece] = []
        open_ = [self._choices(world, 0)]
        while open_ and not self.late():
            try:
                piece = next(open_[-1], None)
            except MisplacedError as error:
                self.refused.append((len(pieces), self._failed(len(pieces), error)))
                piece = None
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

    def _failed(self, number: int, error: str | StageFailedError | MisplacedError) -> str:
        """Note that a stage could not be done; return why."""
        if number >= self._farthest:
            alone = number > self._farthest or self.wrong is not None
            self.wrong = error if alone and isinstance(error, MisplacedError) else None
            self._farthest = number
        return str(error).removeprefix(f"{self.scene.source}: ")

    def late(self) -> bool:
        return time.perf_counter() >= self.deadline or self.stop()

    def _choices(self, world: World, number: int) -> Iterator[Piece]:
        """Yield ways to do a stage, the most promising first."""
        stage = self.stages[number]
        if not isinstance(stage, Move):
            if isinstance(found := self._only(world, number), Piece):
                yield found
            else:
                self.refused.append((number, self._failed(number, found)))
            return
        goals = self._goals(world, number)
        if isinstance(goals, str):
            self.refused.append((number, self._failed(number, goals)))
            return
        for goal, plainly in self._with_beginnings(world, number, goals):
            if self.late():
                return
            try:
                if len(goals) > 1:
                    self._look_ahead(world, number, goal, plainly)
                piece = self._moved(world, number, goal, len(goals) > 1)
            except (StageFailedError, MisplacedError) as error:
                self.refused.append((number, self._failed(number, error)))
            else:
                yield piece

    def _goals(self, world: World, number: int) -> tuple[JointTarget, ...] | str:
        """Return the configurations to which a move may lead, the best of each of its goals first, or say why there
        are none; what was found once is kept."""
        kept = self._aims.setdefault(number, [])
        for before, found in kept:
            if before == world:
                return found
        setup = stage_setup(world, number)
        made: tuple[JointTarget, ...] | str
        if isinstance(setup.scene.goal, JointTarget):
            made = (setup.scene.goal,)
        else:
            try:
                made = _each_in_turn(goal_choice(Certifier(setup), self.seed, EACH).goals)
            except UnsolvableError as error:
                made = _cause(error, setup.asked)
        kept.append((world, made))
        return made

    def _with_beginnings(
        self, world: World, number: int, goals: Sequence[JointTarget]
    ) -> Iterator[tuple[JointTarget, bool]]:
        """Yield goals of a move, and whether curves behind it are only tried as steadily as the joints go; where a
        curve follows that none of them begins, other configurations of the same poses from which it can be followed to
        its end."""
        follows = number + 1 < len(self.stages) and isinstance(self.stages[number + 1], Curve)
        choice = follows and len(goals) > 1
        yield from ((goal, choice) for goal in goals)
        robot = stage_setup(world, number).robot
        for goal in goals if choice else ():
            assert goal.positions is not None
            q = np.array(goal.positions)
            setup = stage_setup(after(world, number, robot, q), number + 1)
            for way in itertools.islice(self.certain.ways_along(setup, q, None), BEGINNINGS):
                if (number + 1, way[0].tobytes()) in self.certain.ways:  # the same poses, and so the same ways
                    break
                self.certain.ways[number + 1, way[0].tobytes()] = way
                yield JointTarget(goal.field, positions=tuple(way[0].tolist())), False

    def _look_ahead(self, world: World, number: int, goal: JointTarget, plainly: bool, further: bool = True) -> None:
        """Try the stages up to the next move of the arm from a configuration, and, `further`, whether that move has a
        goal from which they can be tried in the same way. Raises StageFailedError."""
        assert goal.positions is not None
        there = after(world, number, stage_setup(world, number).robot, np.array(goal.positions))
        for following in range(number + 1, len(self.stages)):
            found: Piece | str | MisplacedError | None
            try:
                if isinstance(self.stages[following], Move):
                    found = self._leads_on(there, following) if further else None
                else:
                    found = self._only(there, following, plainly)
            except MisplacedError as error:
                found = error
            if isinstance(found, str | MisplacedError):
                name, why = stage_name(self.stages[following], following), self._failed(following, found)
                raise StageFailedError(f"given up, as stage '{name}' cannot follow it: {why}")
            if found is None:
                return
            there = found.after

    def _leads_on(self, world: World, number: int) -> str | None:
        """Say why no goal of a move goes on to the next one; None if one does, or time is up."""
        goals, why = self._goals(world, number), ""
        if isinstance(goals, str):
            return goals
        for goal, plainly in self._with_beginnings(world, number, goals):
            if self.late():
                return None
            try:
                self._look_ahead(world, number, goal, plainly, further=False)
                return None
            except StageFailedError as failed:
                why = str(failed)
        return why

    def _moved(self, world: World, number: int, goal: JointTarget, others: bool) -> Piece:
        """Plan a move of the arm to one configuration. Raises StageFailedError."""
        scene = stage_setup(world, number).asked
        left = max(0.0, self.deadline - time.perf_counter())
        aimed = derived(scene, goal=goal)
        try:
            result = plan(
                aimed, seed=self.seed, time_limit=left * (SHARE if others else 1.0), report=self.report, stop=self.stop
            )
        except (UnsolvableError, TimeLimitError) as error:
            raise StageFailedError(_cause(error, scene)) from None
        if not result.certified:
            raise StageFailedError(result.certificate.text)
        robot = stage_setup(world, number).robot
        rows = curve_of(robot, result.trajectory).rows
        return Piece(result.trajectory, after(world, number, robot, rows[-1]), result.notes)

    def _only(self, world: World, number: int, plainly: bool = False) -> Piece | str:
        """Do a stage that leaves no choice, or say why it cannot be done; what was found once is kept."""
        kept = self._made.setdefault(number, [])
        for before, plain, found in kept:
            if before == world and (isinstance(found, Piece) or plainly or not plain):
                return found
        try:
            made: Piece | str = self.certain.done(world, number, plainly)
        except StageFailedError as failed:
            made = str(failed)
        kept.append((world, plainly, made))
        return made


def _each_in_turn(goals: Sequence[JointTarget]) -> tuple[JointTarget, ...]:
    """Return configurations in the same order, but the first ones of all targets before the second ones."""
    before: Counter[str] = Counter()
    ranked = []
    for goal in goals:
        ranked.append((before[goal.field], goal))
        before[goal.field] += 1
    return tuple(goal for _, goal in sorted(ranked, key=lambda each: each[0]))


def _cause(error: InputError | TimeLimitError, scene: Scene) -> str:
    return str(error).removeprefix(f"{scene.source}: ")
