"""The cost of quality in time: how good the best certified motion is during a plan.

In: scenes. Out: one `AnytimeCurve` for each, from the motion that `polish: 0` gives through ROUNDS rounds of it. What
counts is the time of the motion, so every scene is planned within limits of rates, LIMITS where it has none of its own.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.search import Event
from hdplan.planner.studies.planning_runs import path_length
from hdplan.planner.studies.report import Cell, Reporter, Stopper
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import Limits
from hdplan.scenes.scene import Scene

POLISH_ROUNDS, QUICK_POLISH_ROUNDS = 16, 4  # of polish
LIMITS = Limits(velocity="urdf", acceleration=15.0, jerk=500.0)  # those with which cuRobo's results are published
TIME_LIMIT = 30.0  # [s] for a plan
ACCELERATION_SAMPLES = 8  # points between two rows at which the acceleration is taken
SPENT = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0)  # multiples of the time to the first motion in the table


@dataclass(frozen=True)
class Moment:
    """A better motion, and when it was found."""

    seconds: float  # processor time since the plan began, warm [s]
    duration: float  # of the motion [s]
    length: float  # of its path in joint space [rad]
    acceleration: float  # ∫ |q̈|² dt [rad²/s³]


@dataclass(frozen=True)
class AnytimeCurve:
    """The best motions of one plan, in the order in which they were found; the first is the first certified one."""

    scene: str
    moments: tuple[Moment, ...]

    def best_at(self, seconds: float) -> Moment:
        """The best motion by a time [s]; the first one before there is any."""
        found = [moment for moment in self.moments if moment.seconds <= seconds]
        return found[-1] if found else self.moments[0]


def anytime_curves(
    scenes: Sequence[Scene],
    quick: bool,
    *,
    report: Reporter = lambda *_: None,
    stop: Stopper = lambda: False,
) -> tuple[list[AnytimeCurve], list[str]]:
    """Measure on all scenes, or on those before `stop` says so; also say which are left out, and why."""
    curves: list[AnytimeCurve] = []
    refused: list[str] = []
    for k, scene in enumerate(scenes):
        report(k, len(scenes), f"quality over time {scene.name}")
        if stop():
            break
        timed = _in_time(scene, QUICK_POLISH_ROUNDS if quick else POLISH_ROUNDS)
        if timed.objective != "time":
            refused.append(f"{scene.name}: its duration is given")
            continue
        try:
            robot = Setup.of(timed).robot
            first = replace(timed, planner=replace(timed.planner, polish=0))
            plan(first, robot=robot, stop=stop)  # compiles and fits
            curve = _curve((first, timed), robot, stop)
        except InputError as error:
            refused.append(str(error))
            continue
        if curve.moments:
            curves.append(curve)
        else:
            refused.append(f"{scene.name}: no certified motion within {TIME_LIMIT:g} s")
    return curves, refused


def shares(curves: Sequence[AnytimeCurve]) -> list[dict[str, Cell]]:
    """Return the table: what is left of the first motion's time, path and acceleration, geometric mean over the scenes
    [%], after multiples of the time that the first motion took."""
    rows: list[dict[str, Cell]] = []
    for factor in SPENT:
        reached = [(curve.best_at(factor * curve.moments[0].seconds), curve.moments[0]) for curve in curves]
        rows.append(
            {
                "time spent [first motion = 1]": factor,
                "processor time, median [ms]": 1e3 * factor * float(np.median([one.seconds for _, one in reached])),
                "motion time [%]": _mean([now.duration / one.duration for now, one in reached]),
                "path [%]": _mean([now.length / one.length for now, one in reached]),
                "∫acceleration² [%]": _mean([now.acceleration / one.acceleration for now, one in reached]),
            }
        )
    return rows


def anytime_rows(curves: Sequence[AnytimeCurve]) -> list[dict[str, Cell]]:
    """Return every better motion of every scene, for a CSV file."""
    return [
        {
            "scene": curve.scene,
            "processor time [s]": moment.seconds,
            "motion time [s]": moment.duration,
            "path [rad]": moment.length,
            "integrated squared acceleration [rad²/s³]": moment.acceleration,
        }
        for curve in curves
        for moment in curve.moments
    ]


def _mean(ratios: Sequence[float]) -> float:
    return 100.0 * float(np.exp(np.mean(np.log(ratios))))


def _in_time(scene: Scene, rounds: int) -> Scene:
    limits = LIMITS if scene.limits.acceleration is None else scene.limits
    return replace(scene, limits=limits, planner=replace(scene.planner, polish=rounds, objective=None))


def _curve(plans: Sequence[Scene], robot: Robot, stop: Stopper) -> AnytimeCurve:
    """Plan the same, one after the other, each with more rounds of polish than the last."""
    moments: list[Moment] = []
    for scene in plans:
        begin = time.process_time()

        def note(event: Event, begin: float = begin) -> None:
            motion = event.motion
            if motion is None or event.certificate is None or not event.certificate.certified:
                return
            assert motion.duration is not None
            if not moments or motion.duration < moments[-1].duration:
                seconds = time.process_time() - begin
                while moments and moments[-1].seconds >= seconds:  # it was better at once
                    moments.pop()
                moments.append(Moment(seconds, motion.duration, *_measures(robot, motion)))

        plan(scene, time_limit=TIME_LIMIT, robot=robot, report=note, stop=stop)
    return AnytimeCurve(scene.name, tuple(moments))


def _measures(robot: Robot, motion: Trajectory) -> tuple[float, float]:
    """Return the length of a motion's path [rad], and ∫ |q̈|² dt [rad²/s³] of the executed curve by the midpoint
    rule."""
    curve = curve_of(robot, motion)
    interval = np.repeat(np.arange(len(curve.widths)), ACCELERATION_SAMPLES)
    fraction = (np.tile(np.arange(ACCELERATION_SAMPLES), len(curve.widths)) + 0.5) / ACCELERATION_SAMPLES
    acceleration = curve.over_time(2).at(interval, fraction)
    squared = float((acceleration**2).sum(axis=1) @ (curve.widths[interval] / ACCELERATION_SAMPLES))
    return path_length(motion), squared
