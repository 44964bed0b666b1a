"""The search over the choices of a job: stage after stage, each from the end of the last one, with another choice
further back where a stage fails.

A stage whose goal leaves a choice (a pose with several configurations, several grasps) is tried with one configuration
after the other, the most promising of each pose first. Before a motion to one is planned, the stages up to the next
move of the arm are tried from there, and whether that move has a goal from which it continues in the same way, as to
set down what was taken by this grasp: motions cost more. All are examined plainly first, with curves followed as
steadily as the joints go, and only then again with ways along curves, which are dear. The first choice that leads to
the end is taken. Lines, grips and waits leave no choice.

No choice takes all of the time: what is examined before a motion, the motion, and all that follows it have a share of
what is left then, where there are others to try. Postponed choices continue once the others have failed.

Some errors in the input show only where a choice has led: an object out of a hand's reach, a curve without a length.
They rule out that choice, and the next one is tried; one that alone ended what came farthest is raised.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from hdplan.planner.job.certain import Certain, StageFailedError
from hdplan.planner.job.changes import after
from hdplan.planner.job.following import NotFollowedError, is_along
from hdplan.planner.job.joining import Piece, exactly_timed
from hdplan.planner.job.stage_scenes import stage_certifier, stage_setup
from hdplan.planner.job.world import World
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.plan import plan
from hdplan.planner.search.goals import goals_in_turn
from hdplan.planner.search.search import Event
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import InputError, MisplacedError, TimeLimitError, UnsolvableError
from hdplan.scenes.job import Move, stage_name
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.targets import AllOf, JointTarget, PoseTarget

TIME_SHARE = 0.3  # of the time left, for one motion, or a look ahead, where there are others to try
FOLLOWING_SHARE = 0.5  # of the time left, for all that follows a motion to one of several goals
ROUNDS = ((True,), (True, False))  # for each look ahead: are curves behind the next move followed plainly
CONFIGURATIONS_PER_POSE = 3  # goal configurations of a move for every pose
BEGINNINGS = 4  # of a curve that are tried for each configuration of a move's goal


@dataclass(frozen=True)
class _Open:
    """Choices of a stage, and until when they and what follows them are tried."""

    choices: Iterator[tuple[Piece, bool] | None]
    until: float


class Aims:
    """Configurations to which a move may lead, the best of each of its goals first: searched on request, and kept."""

    def __init__(self, goals: Iterable[JointTarget]) -> None:
        self._found: list[JointTarget] = []
        self._left = iter(goals)

    def __iter__(self) -> Iterator[JointTarget]:
        """Yield the motions found so far, and seek more."""
        for i in itertools.count():
            if i == len(self._found):
                if (goal := next(self._left, None)) is None:
                    return
                self._found.append(goal)
            yield self._found[i]

    @property
    def several(self) -> bool:
        """True if there is more than one."""
        return len([*itertools.islice(self, 2)]) > 1


class Search:
    """Depth first over the choices of all stages, each within its share of the time."""

    def __init__(
        self, scene: Scene, seed: int, deadline: float, report: Callable[[Event], None], stop: Callable[[], bool]
    ) -> None:
        assert scene.job is not None
        self.scene, self.stages, self.seed, self.deadline = scene, scene.job.stages, seed, deadline
        self.report, self.stop = report, stop
        self.best: list[Piece] = []  # of the most stages that were done one after the other
        self.refused: list[tuple[int, str, str]] = []  # the stage, the goal if it has several, and why it was given up
        self.wrong: MisplacedError | None = None  # what alone ended what came farthest
        self._until = deadline  # of the share of what is tried now
        self._farthest = -1  # stage that was tried
        self._made: dict[int, list[tuple[World, bool, Piece | str]]] = {}  # what leaves no choice, by stage
        self._aims: dict[int, list[tuple[World, Aims | str]]] = {}  # of moves, by stage
        self.certain = Certain(self.stages, seed, self._late)

    def run(self, world: World) -> None:
        """Look for the pieces of all stages. The best are there at any time, however this ends."""
        pieces: list[Piece] = []
        open_ = [_Open(self._choices(world, 0), self.deadline)]
        put_off: list[tuple[list[Piece], list[_Open]]] = []
        while (open_ or put_off) and not self.over():
            if not open_:
                pieces, open_ = put_off.pop(0)
            self._until = open_[-1].until
            if self._late():
                kept = sum(time.perf_counter() < each.until for each in open_)
                behind = [_Open(each.choices, self.deadline) for each in open_[kept:]]
                put_off.append(([*pieces], [_Open(iter(()), self.deadline)] * kept + behind))
                del open_[kept:], pieces[max(0, kept - 1) :]
                continue
            try:
                found = next(open_[-1].choices)
            except (StopIteration, MisplacedError) as ended:
                if isinstance(ended, MisplacedError):
                    self._refuse(len(pieces), ended)
                open_.pop()
                if pieces:
                    pieces.pop()
                continue
            if found is None:
                continue
            piece, others = found
            pieces.append(piece)
            if len(pieces) > len(self.best):
                self.best = [*pieces]
            if len(pieces) == len(self.stages):
                return
            until = self._end_of(FOLLOWING_SHARE) if others else self._until
            open_.append(_Open(self._choices(piece.after, len(pieces)), until))

    def _refuse(
        self, number: int, error: str | StageFailedError | MisplacedError, goal: JointTarget | None = None
    ) -> None:
        """Note that a choice for a stage was given up, one of its goals if it has several, and why."""
        field = "" if goal is None else named(goal)
        refusal = number, field, self._failed(number, error)
        if refusal not in self.refused:
            self.refused.append(refusal)

    def _failed(self, number: int, error: str | StageFailedError | MisplacedError) -> str:
        """Note that a stage could not be done; return why."""
        if number >= self._farthest:
            alone = number > self._farthest or self.wrong is not None
            self.wrong = error if alone and isinstance(error, MisplacedError) else None
            self._farthest = number
        return str(error).removeprefix(f"{self.scene.source}: ")

    def over(self) -> bool:
        """True once all of the time is."""
        return time.perf_counter() >= self.deadline or self.stop()

    def _late(self) -> bool:
        return time.perf_counter() >= self._until or self.stop()

    def _end_of(self, share: float) -> float:
        """Return when a share of the time that is left ends."""
        now = time.perf_counter()
        return now + share * (self._until - now)

    @contextmanager
    def _one_of_several(self) -> Iterator[None]:
        """Give the block a share of the time that is left."""
        until, self._until = self._until, self._end_of(TIME_SHARE)
        try:
            yield
        finally:
            self._until = until

    def _choices(self, world: World, number: int) -> Iterator[tuple[Piece, bool] | None]:
        """Yield ways to do a stage, the most promising first, and whether there are others; None for one that failed,
        so that the time limit is checked."""
        stage = self.stages[number]
        if not isinstance(stage, Move):
            if isinstance(found := self._only(world, number), Piece):
                yield found, False
            else:
                self._refuse(number, found)
            return
        goals = self._goals(world, number)
        if isinstance(goals, str):
            self._refuse(number, goals)
            return
        several, tried = goals.several, set()
        for rounds in ROUNDS if several else ROUNDS[:1]:
            for goal, plainly in self._candidates(world, number, goals, plain=rounds[-1]):
                if goal.positions in tried:
                    continue
                try:
                    if several:
                        with self._one_of_several():
                            self._look_ahead(world, number, goal, plainly, rounds)
                        tried.add(goal.positions)
                    piece = self._moved(world, number, goal, several)
                except (StageFailedError, MisplacedError) as error:
                    self._refuse(number, error, goal if several else None)
                    yield None
                else:
                    yield piece, several

    def _goals(self, world: World, number: int) -> Aims | str:
        """Return the configurations to which a move may lead, the best of each of its goals first, or the reason why
        there are none; results are kept."""
        kept = self._aims.setdefault(number, [])
        for before, found in kept:
            if before == world:
                return found
        setup = stage_setup(world, number)
        made: Aims | str
        if isinstance(setup.scene.goal, JointTarget):
            made = Aims([setup.scene.goal])
        else:
            made = Aims(goals_in_turn(stage_certifier(world, number), self.seed, CONFIGURATIONS_PER_POSE))
            try:
                next(iter(made))
            except UnsolvableError as error:
                made = _cause(error, setup.requested)
        kept.append((world, made))
        return made

    def _candidates(self, world: World, number: int, goals: Aims, plain: bool) -> Iterator[tuple[JointTarget, bool]]:
        """Yield goals of a move, and whether curves behind it are only followed as steadily as the joints go. Where one
        comes next, and not all is to be `plain`, there are further configurations of the same poses, from which it can
        be followed to its end: one of each goal in turn."""
        follows = number + 1 < len(self.stages) and isinstance(self.stages[number + 1], Curve)
        opened = follows and not plain and goals.several
        yield from ((goal, plain or opened) for goal in goals)
        if not opened:
            return
        here = stage_setup(world, number)
        robot, start = here.robot, here.robot.configuration(here.requested.start)
        beginnings, curves = [], list[Follow]()
        for goal in goals:
            assert goal.positions is not None
            q = np.array(goal.positions)
            try:
                setup = stage_setup(after(world, number, robot, q), number + 1)
            except MisplacedError:
                continue  # reported already, when the stage was followed plainly
            follow = setup.scene.path.follow
            assert follow is not None
            if any(is_along(follow, each) for each in curves):
                continue  # the same poses, and so the same ways
            curves.append(follow)
            beginnings.append((goal, itertools.islice(self.certain.ways_along(setup, q, None), BEGINNINGS)))
        while beginnings:
            goal, ways = beginnings.pop(0)
            try:
                with self._one_of_several():
                    way = next(ways, None)
            except NotFollowedError as error:
                name, why = stage_name(self.stages[number + 1], number + 1), self._failed(number + 1, str(error))
                why_not = f"rejected, as stage '{name}' cannot follow it from wherever it begins: {why}"
                self._refuse(number, why_not, goal)
                continue
            if way is None:
                continue
            way = way + (robot.nearest_turn(way[0], start) - way[0])  # as the move will lead there
            if (key := (number + 1, way[0].tobytes())) in self.certain.ways:
                continue
            self.certain.ways[key] = way
            yield JointTarget(goal.field, positions=tuple(way[0].tolist())), False
            beginnings.append((goal, ways))

    def _look_ahead(
        self, world: World, number: int, goal: JointTarget, plainly: bool, rounds: Sequence[bool] = ()
    ) -> None:
        """Try the stages up to the next move of the arm from a configuration, and, in rounds, whether that move has
        a goal from which they can be tried in the same way. Raises StageFailedError."""
        assert goal.positions is not None
        there = after(world, number, stage_setup(world, number).robot, np.array(goal.positions))
        for following in range(number + 1, len(self.stages)):
            found: Piece | str | MisplacedError | None
            try:
                if isinstance(self.stages[following], Move):
                    found = self._leads_on(there, following, rounds) if rounds else None
                else:
                    found = self._only(there, following, plainly)
            except MisplacedError as error:
                found = error
            if isinstance(found, str | MisplacedError):
                name, why = stage_name(self.stages[following], following), self._failed(following, found)
                raise StageFailedError(f"rejected, as stage '{name}' cannot follow it: {why}")
            if found is None:
                return
            there = found.after

    def _leads_on(self, world: World, number: int, rounds: Sequence[bool]) -> str | None:
        """Return the reason why no goal of a move continues to the next one; None if one does."""
        goals, why = self._goals(world, number), ""
        if isinstance(goals, str):
            return goals
        for plain in rounds:
            for goal, plainly in self._candidates(world, number, goals, plain):
                if self._late():
                    return why or "its share of the time is over"
                try:
                    self._look_ahead(world, number, goal, plainly)
                    return None
                except StageFailedError as failed:
                    why = str(failed)
        return why

    def _moved(self, world: World, number: int, goal: JointTarget, others: bool) -> Piece:
        """Plan a move of the arm to one configuration. Raises StageFailedError."""
        setup = stage_setup(world, number)
        scene, robot = setup.requested, setup.robot
        left = max(0.0, self._until - time.perf_counter()) * (TIME_SHARE if others else 1.0)
        try:
            aimed = derived(scene, goal=goal)
            result = plan(aimed, seed=self.seed, time_limit=left, report=self.report, stop=self.stop)
        except (UnsolvableError, TimeLimitError) as error:
            raise StageFailedError(_cause(error, scene)) from None
        if not result.certified:
            raise StageFailedError("interrupted" if self.stop() else result.certificate.text)
        rows = curve_of(robot, result.trajectory).rows
        return Piece(exactly_timed(result.trajectory), after(world, number, robot, rows[-1]), result.notes)

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
        if isinstance(made, Piece) or not self._late():
            kept.append((world, plainly, made))
        return made


def named(target: JointTarget | PoseTarget | AllOf) -> str:
    """Return the name of a goal within its move, such as "poses[2]"."""
    return target.field.rpartition("move.")[2]


def _cause(error: InputError | TimeLimitError, scene: Scene) -> str:
    return str(error).removeprefix(f"{scene.source}: ")
