"""Planning of a job: a search for motions of all its stages, which are blended, joined and certified as executed."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from hdplan.planner.job.blending import INTERRUPTED, blended
from hdplan.planner.job.certify import certified_job
from hdplan.planner.job.choices import Search, named
from hdplan.planner.job.curves import turns_with_tool
from hdplan.planner.job.joining import joined
from hdplan.planner.job.result import JobResult
from hdplan.planner.job.world import World
from hdplan.planner.search.search import Event
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.deadline import no_limit, seconds_left
from hdplan.scenes.errors import TimeLimitError, UnsolvableError
from hdplan.scenes.job import Job, Move
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.stage import ArmStage
from hdplan.scenes.targets import Goals
from hdplan.scenes.values import Number, Whole, checked, functions, instance


def plan_job(
    scene: Scene,
    *,
    seed: int = 0,
    time_limit: float = 60.0,
    report: Callable[[Event], None] = lambda event: None,
    stop: Callable[[], bool] = lambda: False,
) -> JobResult:
    """Plan a job: find motions for all its stages, and certify each as executed.

    Args:
        scene: one with a job.
        seed: of random guesses and configurations; the same seed gives the same result, as far as the time limit
            allows.
        time_limit: [s] for everything but the certificate, which an earlier `deadline.time_limit` does not cut short,
            either. The planned stages are returned, with the first missing stage and the reason.
        report: called with every step and every certificate of the motions that are planned.
        stop: called at every step; once it returns True, the stages planned so far are returned.

    Raises:
        InputError: for a scene without a job, and for errors in the scene, its robot or a stage, which the message
            names.
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
    ends = min(began + time_limit, time.perf_counter() + seconds_left())
    search = Search(rested, seed, ends, report, stop)
    interrupted = False
    try:
        search.run(replace(first, scene=rested))
    except KeyboardInterrupt:
        if not search.best:
            raise
        interrupted = True
    except TimeLimitError:
        if not search.best:
            raise
    pieces = search.best
    interrupted = len(pieces) < len(names) and (interrupted or stop())
    if len(pieces) < len(names) and search.wrong is not None and not (interrupted or search.over()):
        raise search.wrong
    refused = tuple(": ".join(filter(None, (names[number], goal, why))) for number, goal, why in search.refused)
    if not pieces and (interrupted or not search.refused):
        ended = "interrupted" if interrupted else f"the time limit of {time_limit:g} s passed"
        raise TimeLimitError(f"{scene.source}: {ended} before the first stage was planned")
    if not pieces:
        raise UnsolvableError(f"{scene.source}: job[0] ({names[0]}){_last(search, 0)}", "stage_failed")
    failure = "" if len(pieces) == len(names) else _failure(search, names, len(pieces), interrupted)

    def late() -> str:
        """Return the reason why no more stages are blended, if so."""
        if interrupted or stop():
            return INTERRUPTED
        return f"the time limit of {time_limit:g} s passed before that was tried" if search.over() else ""

    with no_limit():
        pieces, unblended = blended(first, pieces, late)
        trajectory = joined(pieces, scene.job)
        certificate = certified_job(scene, trajectory, [piece.proven for piece in pieces])
    noted = itertools.chain(*(piece.notes for piece in pieces), certificate.notes)
    notes = tuple(dict.fromkeys((*scene.notes, *noted, *unblended, *refused)))
    return JobResult(scene, trajectory, certificate, failure, seed, notes, time.perf_counter() - began)


def _failure(search: Search, names: Sequence[str], done: int, interrupted: bool) -> str:
    """Return the stage that stopped the job, in words, with the reason and a remedy."""
    if interrupted:
        return f"interrupted before stage '{names[done]}' was planned"
    if done not in {number for number, *_ in search.refused}:
        return f"stage '{names[done]}' was not reached within the time limit; more time may help"
    return f"stage '{names[done]}'{_last(search, done)}"


def _last(search: Search, done: int) -> str:
    """Return the reason why a stage could not be done: at last, of every goal that it has."""
    last = {goal: why for number, goal, why in search.refused if number == done}
    stage, goals_by = search.stages[done], dict[str, list[str]]()
    if isinstance(stage, Move) and isinstance(stage.goal, Goals) and any(last) and not search.over():
        for target in stage.goal.targets:
            last.setdefault(named(target), "not reached without contact")
    for goal, why in last.items():
        goals_by.setdefault(why, []).append(goal)
    return ": " + "; ".join(": ".join(filter(None, (", ".join(goals), why))) for why, goals in goals_by.items())


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
