"""Why a problem has no certified motion, by experiment: the changes with which it would have one.

A problem that is refused says its cause itself. Where no certified motion was found, one thing after another is taken
away or made more generous, such as the clearance, and planned again: the first that leads to a certified motion is the
cause, and what was measured then is the advice. That is an experiment, not a proof: a longer search may find a motion
of the problem as it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hdplan.planner.causes import CAUSES, cause_of_refusal, cause_of_verdict
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.plan import plan
from hdplan.planner.result import CUT_SHORT, PlanResult
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import may_end
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.limits import QUANTITIES
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget
from hdplan.scenes.values import require_fields

MOST_SECONDS = 10.0  # for one trial
CLEARANCE_FACTORS = (0.9, 0.5, 0.0)  # times the clearance
SIZE_FACTORS = (0.5, 0.0)  # times what is unknown
DURATION_FACTORS = (1.2, 1.5, 2.0, 3.0, 5.0, 10.0)  # times the duration
MOST_TOGETHER = 240.0  # [s] for all of them
TIME_FACTOR, LONGEST_TRIAL = 5.0, 60.0  # times the time limit, up to so much [s]
DRAW_RANGES, DRAWS = (0.01, 0.03, 0.1, 0.3), 60  # [rad or m] about an end in which so many configurations are drawn
REFUSALS = ("too_hurried", "bad_input", "goal_not_reached", "internal")  # and what begins with `end_`
MEASURED = ("time", "disconnected")  # refusals of which a trial that helps tells more
NAMING = {Status.OFF_PATH, Status.TOO_FAST, Status.OVERLOADED}  # verdicts that name their cause

require_fields(
    Scene,
    "obstacles self_collision limits path timing planner goal "  # are loosened or left out on trial
    "robot attached payload start from_request name source notes "  # are what the problem is
    "job",  # is no single problem: `Setup` refuses it
)


@dataclass(frozen=True)
class Diagnosis:
    """Why a problem has no certified motion."""

    cause: str  # a code of `causes.CAUSES`
    text: str  # a sentence: what is wrong, and where
    advice: str  # what was tried and helps, with what came of it; or that nothing did


@dataclass(frozen=True)
class _Trial:
    """A problem that is easier in one thing."""

    cause: str  # if it helps
    setting: str  # in words
    scene: Scene
    seconds: float


def diagnose(
    scene: Scene,
    failure: PlanResult | HdplanError,
    *,
    solver: str = "gauss_newton",
    seed: int = 0,
    time_limit: float = 30.0,
) -> Diagnosis:
    """Find out why a problem has no certified motion, by trying what would help.

    Args:
        scene: the problem.
        failure: what `plan` returned, or the error that it raised.
        solver: that of the plan. seed: that of the plan.
        time_limit: [s] that of the plan; each trial takes at most MOST_SECONDS of it.

    Raises nothing of its own: a trial that is refused does not help.
    """
    if isinstance(failure, HdplanError):
        cause, text, blamed = cause_of_refusal(failure), str(failure), getattr(failure, "by", ())
    else:
        certificate = failure.certificate
        cause, text = cause_of_verdict(certificate, CUT_SHORT in failure.notes), certificate.text
        places = [each for each in (certificate.worst, certificate.self_worst) if each]
        blamed = tuple(each.other for each in sorted(places, key=lambda each: each.distance)[:1])
    named = failure.certificate.status in NAMING if isinstance(failure, PlanResult) else cause not in MEASURED
    if (near := _free_nearby(scene)) and cause in ("end_in_contact", "end_overloaded", "end_off_path"):
        return Diagnosis(cause, f"{CAUSES[cause]}: {text}", near)
    tried = []
    for trial in _trials(scene, cause, blamed, time_limit):
        tried.append(trial.setting)
        try:
            result = plan(trial.scene, solver=solver, seed=seed, time_limit=trial.seconds)
        except HdplanError:
            continue
        if result.certified:
            found = cause if named else trial.cause
            return Diagnosis(found, f"{CAUSES[found]}: {text}", f"{trial.setting}: {_measured(result)}")
    advice = f"none of these helps: {', '.join(tried)}" if tried else "no change is known that would help"
    return Diagnosis(cause, f"{CAUSES[cause]}: {text}", advice)


def _measured(result: PlanResult) -> str:
    """Return the outcome of a trial."""
    duration = result.trajectory.duration
    lasts = "" if duration is None else f", {duration:.3g} s long"
    return f"{result.certificate.text}{lasts}"


def _trials(scene: Scene, cause: str, blamed: Sequence[str], time_limit: float) -> Iterator[_Trial]:
    """Yield what may help, the most telling first: `blamed` is what stands in the way."""
    seconds = min(time_limit, MOST_SECONDS)
    searched = cause not in REFUSALS and not cause.startswith("end_")  # a motion was sought
    shut = cause == "disconnected"  # whatever time, torques and paths there are
    most = min(max(TIME_FACTOR * time_limit, MOST_SECONDS), LONGEST_TRIAL)
    longer = _Trial("time", f"a time limit of {most:g} s", scene, most)
    if cause == "time":
        yield longer
    if cause in ("too_hurried", "torque", "rates") and (timing := scene.timing) is not None and timing.duration:
        for share in DURATION_FACTORS:
            slower = dataclasses.replace(timing, duration=share * timing.duration)
            setting = f"timing.duration: {slower.duration:.4g}"
            yield _Trial("too_hurried", setting, dataclasses.replace(scene, timing=slower), seconds)
    for name in (name for name, quantity in QUANTITIES.items() if quantity.order is None):  # rates: with more time
        if searched and not shut and getattr(scene.limits, name) is not None:
            limits = dataclasses.replace(scene.limits, **{name: None})  # type: ignore[arg-type]
            yield _Trial("torque", f"without limits.{name}", dataclasses.replace(scene, limits=limits), seconds)
    if ((searched and not shut) or cause == "end_off_path") and scene.path != PathConstraints():
        yield _Trial("path_constraint", "without path", dataclasses.replace(scene, path=PathConstraints()), seconds)
    if searched or cause == "end_too_close":
        for share in CLEARANCE_FACTORS:
            if (closer := _closer(scene, share)) != scene:
                clearance = scene.planner.clearance
                own = f" (planner.clearance: {share * clearance:.4g})" if clearance else ""
                yield _Trial("clearance", f"{share:.0%} of the clearance{own}", closer, seconds)
        for share in SIZE_FACTORS:
            if (surer := _surer(scene, share)) != scene:
                setting = f"{share:.0%} of the uncertainty" if share else "no uncertainty"
                fields = "obstacles[].uncertainty, robot.tracking, robot.calibration"
                yield _Trial("clearance", f"{setting} ({fields})", surer, seconds)
    if (searched or cause in ("goal_not_reached", "end_beyond_limits")) and scene.limits.position:
        limits = dataclasses.replace(scene.limits, position={})
        setting = f"without limits.position ({', '.join(scene.limits.position)})"
        yield _Trial("joint_limit", setting, dataclasses.replace(scene, limits=limits), seconds)
    if cause == "goal_not_reached" and (turned := _turning(scene)) is not None:
        yield _Trial(cause, "goal.pose.free_rotation: all", turned, seconds)
    if searched and cause not in MEASURED:
        yield longer
    for name in blamed if searched else ():
        others = tuple(each for each in scene.obstacles if each.name != name)
        if len(others) < len(scene.obstacles):
            without = dataclasses.replace(scene, obstacles=others)
            yield _Trial("disconnected" if shut else "local_minimum", f"without obstacle {name}", without, seconds)


def _closer(scene: Scene, share: float) -> Scene:
    """Return the scene with a share of every clearance that it requires."""
    obstacles = tuple(
        each if each.clearance is None else dataclasses.replace(each, clearance=share * each.clearance)
        for each in scene.obstacles
    )
    own = dataclasses.replace(scene.self_collision, clearance=share * scene.self_collision.clearance)
    settings = dataclasses.replace(scene.planner, clearance=share * scene.planner.clearance)
    return dataclasses.replace(scene, obstacles=obstacles, self_collision=own, planner=settings)


def _surer(scene: Scene, share: float) -> Scene:
    """Return the scene with so much of every size of what it does not know."""
    obstacles = tuple(
        each if each.uncertainty is None else dataclasses.replace(each, uncertainty=each.uncertainty.times(share))
        for each in scene.obstacles
    )
    sizes = {key: getattr(scene.robot, key) for key in ("tracking", "calibration")}
    fewer = {key: size.times(share) for key, size in sizes.items() if size is not None}
    return dataclasses.replace(scene, obstacles=obstacles, robot=dataclasses.replace(scene.robot, **fewer))


def _turning(scene: Scene) -> Scene | None:
    """Return the scene with poses of the goal in any orientation; None if that is nothing new."""
    if not isinstance(scene.goal, Goals):
        return None
    poses = [each for each in scene.goal.targets if isinstance(each, PoseTarget)]
    if len(poses) < len(scene.goal.targets) or all(each.free_rotation == "all" for each in poses):
        return None
    return scene.with_goal([dataclasses.replace(each, free_rotation="all") for each in poses])


def _free_nearby(scene: Scene) -> str:
    """Return, in words, an allowed configuration near an end that is not allowed; empty if none is found, or if
    obstacles move."""
    if any(each.motion is not None for each in scene.obstacles):
        return ""
    drawn = np.random.default_rng(0)
    try:
        certifier = Certifier(Setup.of(scene))
        robot = certifier.robot
        ends = [each for each in (scene.start, scene.goal) if isinstance(each, JointTarget)]
        for end in ends:
            q = robot.configuration(end, scene.from_request)
            if may_end(certifier, q):
                continue
            for reach in DRAW_RANGES:
                for near in np.clip(q + drawn.uniform(-reach, reach, (DRAWS, len(q))), robot.lower, robot.upper):
                    if may_end(certifier, near):
                        joints = zip(robot.joint_names, near, strict=True)
                        values = ", ".join(f"{name} {value:.4g}" for name, value in joints)
                        return f"within {reach:g} rad of {end.field} is free: {values}"
    except HdplanError:
        pass
    return ""
