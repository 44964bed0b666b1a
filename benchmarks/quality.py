"""How good motions are under limits of rates: their time, length, jerk and energy, on MotionBenchMaker's problems.

    python benchmarks/quality.py DIR [--robot panda] [--every K] [--goals pose joints] [--polish N ...]
    [--payload KG ...]

Limits are cuRobo's: the URDF's velocities, 15 rad/s², 500 rad/s³; with a payload, a mass GRASP before the hand, the
URDF's torques are limits too. With `pose`, the goal is the pose to which the request's joints bring the hand. Prints a
row for every kind of goal, every number of rounds of polishing (the scene's default without --polish) and every
payload: certified problems; mean time of the motion and mean length of its path; the largest
jerk of all, as proven; the mean energy ∫ Σ|τ q̇| dt, where the robot has masses; what planning and proving took by the
clock; and both together in processor time, which tells more on a machine that others use too. One core.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
import time
from pathlib import Path

import numpy as np
from cells import milliseconds
from problems import HANDS, LIMITS, RealProblem, real_problems, with_pose_goal
from threadpoolctl import threadpool_limits

import hdplan
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.objective import Energy
from hdplan.planner.studies.planning_runs import path_length
from hdplan.planner.studies.report import Cell, markdown_text

GRASP = (0.0, 0.0, 0.1)  # [m] a payload's centre of mass, in the hand's frame


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One problem; figures of the motion are NaN where there is none."""

    robot: str
    goals: str
    rounds: int
    payload: float  # [kg]
    set: str
    problem: str
    verdict: str  # "certified", or why not
    motion: float  # [s]
    length: float  # Σ |q_(i+1) − q_i| [rad]
    jerk: float  # [rad/s³] the largest of all joints, as proven
    energy: float  # [J]; NaN for a robot without masses
    plan: float  # [s] by the clock, without the proofs
    proofs: float  # [s]
    processor: float  # [s] of planning and proving

    @property
    def certified(self) -> bool:
        """True if the motion is proven."""
        return self.verdict == "certified"


# --- planning ---------------------------------------------------------------------------------------------------------


def posed(problem: RealProblem, goals: str, rounds: int | None, payload: float) -> hdplan.Scene:
    """The problem with the limits, the kind of goal, the payload and the rounds of polishing; None: the scene's
    default."""
    scene = dataclasses.replace(problem.load(), limits=LIMITS)
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, polish=rounds))
    if payload:
        held = hdplan.Payload(HANDS[problem.robot], payload, GRASP)
        scene = dataclasses.replace(scene, limits=dataclasses.replace(LIMITS, torque="urdf"), payload=held)
    return with_pose_goal(scene, HANDS[problem.robot]) if goals == "pose" else scene


def run(problem: RealProblem, goals: str, rounds: int, payload: float, limit: float) -> Outcome:
    """Plan one problem and measure its motion."""
    what = (problem.robot, goals, rounds, payload, problem.set, problem.number)
    try:
        scene = posed(problem, goals, rounds, payload)
        began, used = time.perf_counter(), time.process_time()
        result = hdplan.plan(scene, time_limit=limit)
        wall, processor = time.perf_counter() - began, time.process_time() - used
    except hdplan.InputError as error:
        return Outcome(*what, f"refused: {error}", *[np.nan] * 7)
    took = (wall - result.times.certify, result.times.certify, processor)
    if not result.certified:
        return Outcome(*what, result.certificate.text, np.nan, np.nan, np.nan, np.nan, *took)
    motion = result.trajectory
    assert motion.duration is not None
    length = path_length(motion)
    jerk = next(use.share * use.limit for use in result.certificate.uses if use.quantity == "jerk")
    return Outcome(*what, "certified", motion.duration, length, jerk, energy(scene, motion), *took)


def energy(scene: hdplan.Scene, motion: hdplan.Trajectory) -> float:
    """The mechanical work of the joints [J]; NaN for a robot without masses."""
    try:
        return Energy(Setup.of(scene)).value(motion.positions, motion)
    except hdplan.InputError:
        return np.nan


# --- what was measured ------------------------------------------------------------------------------------------------


def line(o: Outcome) -> str:
    """One line for a person."""
    figures = f"{o.motion:.3f} s, {o.length:.2f} rad, {o.jerk:.0f} rad/s³, {o.energy:.1f} J"
    took = f"{1e3 * (o.plan + o.proofs):.0f} ms, processor {1e3 * o.processor:.0f} ms"
    return f"{o.robot} {o.goals}, {o.rounds}: {o.set} {o.problem}: {figures if o.certified else o.verdict}, {took}"


def row(outcomes: list[Outcome]) -> dict[str, Cell]:
    """Sum up the outcomes of one kind of goal and number of rounds; means over the certified motions."""
    good = [outcome for outcome in outcomes if outcome.certified]
    ran = [outcome for outcome in outcomes if np.isfinite(outcome.plan)]
    processor = [outcome.processor for outcome in ran]
    return {
        "goals, rounds": f"{outcomes[0].goals}, {outcomes[0].rounds}",
        "payload [kg]": f"{outcomes[0].payload:g}",
        "problems": len(outcomes),
        "certified": len(good),
        "motion time mean [s]": f"{_mean([o.motion for o in good]):.3f}",
        "path mean [rad]": f"{_mean([o.length for o in good]):.2f}",
        "largest jerk [rad/s³]": f"{max((o.jerk for o in good), default=np.nan):.0f}",
        "energy mean [J]": f"{_mean([o.energy for o in good]):.1f}",
        "plan median / p95 [ms]": milliseconds([o.plan for o in ran]),
        "proofs median / p95 [ms]": milliseconds([o.proofs for o in ran]),
        "both, processor time mean / median / p95 [ms]": f"{1e3 * _mean(processor):.0f} / {milliseconds(processor)}",
    }


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else np.nan


# --- command line -----------------------------------------------------------------------------------------------------


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", choices=sorted(HANDS), default="panda")
    parser.add_argument("--every", type=int, default=1, help="take every K-th problem of a set")
    parser.add_argument("--goals", nargs="*", choices=("pose", "joints"), default=["pose", "joints"])
    parser.add_argument("--polish", nargs="*", type=int, help="rounds; the default's without it")
    parser.add_argument(
        "--payload", nargs="*", type=float, default=[0.0], help="[kg] in the hand, with the URDF's torques as limits"
    )
    parser.add_argument("--time-limit", type=float, default=30.0)
    options = parser.parse_args()
    problems = real_problems(options.folder, options.robot, options.every)
    if not problems:
        sys.exit(f"no problems found below {options.folder}")
    polish, rows = options.polish or [posed(problems[0], "joints", None, 0.0).polish], []
    with threadpool_limits(1):
        for kind in itertools.product(options.goals, polish, options.payload):
            run(problems[0], *kind, options.time_limit)  # warm
            outcomes = []
            for problem in problems:
                outcomes.append(run(problem, *kind, options.time_limit))
                print(line(outcomes[-1]), file=sys.stderr)
            rows.append(row(outcomes))
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
