"""`hdplan plan`: find a motion, write and draw it, print its verdict."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdplan.planner.causes import CAUSES
from hdplan.planner.commands.watched import alone, also_seen, opened, serving
from hdplan.planner.motion.curve import row_count
from hdplan.planner.plan import plan
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.solvers import DEFAULT, solver_named
from hdplan.planner.terminal.arguments import SEARCH_TIME
from hdplan.planner.terminal.console import printing, progress, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.session import complain
from hdplan.planner.terminal.tables import result_rows, table, verdict_text
from hdplan.scenes.deadline import time_limit as limited
from hdplan.scenes.errors import HdplanError, InputError, TimeLimitError
from hdplan.scenes.planner_settings import DISTANCES
from hdplan.scenes.scene import derived
from hdplan.scenes.values import Choice, checked

if TYPE_CHECKING:
    from hdplan.planner.commands.watched import Report, Stop
    from hdplan.planner.diagnosis import Diagnosis
    from hdplan.planner.result import PlanResult
    from hdplan.scenes.scene import Scene

    Run = Callable[[Report, Stop], PlanResult]


def run_plan(scene: GivenScene, *, watched: bool, **options: Any) -> int:
    """Plan as `planned`; browsers that see it are served until Ctrl-C."""
    with serving(watched) as served:
        return planned(scene, served=served, **options)


def planned(
    scene: GivenScene,
    *,
    output: Path | None,
    plot: Path | None,
    proof: Path | None,
    diagnosed: bool,
    solver: str,
    distance: str | None,
    seed: int,
    time_limit: float | None,
    as_json: bool,
    quiet: bool,
    served: contextlib.ExitStack | None,
) -> int:
    """Plan within a `time_limit` [s] for everything; without one, solving and certifying take at most SEARCH_TIME
    seconds. Browsers see it that are `served`.

    Returns the exit code: 0 if the motion is certified, else 1.
    """
    solver_named(solver)
    if served is not None:
        from hdplan.planner.view.front import check_installed

        check_installed()
    if distance is not None:
        checked(Choice(DISTANCES), distance, "distance")
    if output is not None:
        from hdplan.planner.motion.trajectory_files import check_length, check_output

        check_output(output)
    if plot is not None:
        from hdplan.planner.pictures.plot import check_picture

        check_picture(plot)
    if proof is not None:
        from hdplan.planner.commands.prove import check_proof_of_plan

        check_proof_of_plan(proof, output, scene.robot)
    longest = SEARCH_TIME if time_limit is None else time_limit
    options = {"solver": solver, "seed": seed, "time_limit": longest}
    problem, found = None, None
    try:
        with limited(time_limit):
            problem = scene.load()
            if distance is not None:
                problem = derived(problem, planner=replace(problem.planner, distance=distance))
            if problem.job is not None:
                from hdplan.planner.commands.job import Written, refuse_options, run_plan_job

                refuse_options({"--diagnose": diagnosed, "--solver": "" if solver == DEFAULT else solver})
                files = Written(scene, output, plot, proof)
                return run_plan_job(
                    problem, files, seed=seed, time_limit=longest, as_json=as_json, quiet=quiet, served=served
                )
            timing = problem.timing
            if output is not None and timing is not None and timing.duration is not None:
                check_length(output, row_count(timing.duration, timing.rate), load_scene_robot(problem).n)
            follow = alone if served is None else _in_browsers(problem, served)
            with progress(problem.planner, shown=not quiet and not as_json) as (report, stop):
                result = follow(
                    also_seen(
                        lambda report, stop: plan(
                            problem, solver=solver, seed=seed, time_limit=longest, report=report, stop=stop
                        ),
                        report,
                        stop,
                    )
                )
    except HdplanError as error:
        if not diagnosed or problem is None or problem.job is not None:
            raise
        kind = TimeLimitError if isinstance(error, TimeLimitError) else InputError
        raise kind(f"{error}; what helps: {_diagnosis(problem, error, options).advice}") from None
    if diagnosed and not result.certified:
        with waiting("finding out why", shown=not quiet and not as_json):
            found = _diagnosis(problem, result, options)
    if output is not None:
        result.save(output)
    if plot is not None:
        from hdplan.planner.pictures.plot import Subject, plot as draw

        draw(Subject.planned(Setup.of(problem), result), plot)
    proven = result.certified
    if proof is not None and output is not None and result.certified:
        from hdplan.planner.commands.prove import written
        from hdplan.planner.proof.proof import prove_planned

        names = scene.scene, output, scene.request, scene.robot_file
        proven = written(lambda: prove_planned(result, *names), proof) is not None
    if not quiet:
        with printing() as show:
            if as_json:
                why = {"diagnosis": {"cause": found.cause, "advice": found.advice}} if found else {}
                show(json.dumps({**result.summary(), **why}))
            else:
                paths = [output, plot, proof if proven else None]
                show(verdict_text(result.certificate))
                rows = result_rows(result, [str(file) for file in paths if file is not None])
                show(table([*rows, *([("cause", CAUSES[found.cause]), ("helps", found.advice)] if found else [])]))
    return 0 if proven else 1


def _in_browsers(scene: Scene, served: contextlib.ExitStack) -> Callable[[Run], PlanResult]:
    """Serve a scene, say where, and return what makes a plan that browsers see."""
    from hdplan.planner.view.server import open_viewer

    viewer = opened(scene.name, lambda: open_viewer(scene, complain=complain), served)
    return lambda run: viewer.panel.planning.follow(scene, run)


def _diagnosis(scene: Scene, failure: PlanResult | HdplanError, options: dict[str, Any]) -> Diagnosis:
    from hdplan.planner.diagnosis import diagnose

    return diagnose(scene, failure, **options)
