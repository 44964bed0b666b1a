"""Random motions with a load: the share that can be driven, planned with and without torque limits.

Between random configurations that are free and that every joint can hold, in the scenes of `SCENES`, with each mass on
the tool. Each motion is planned twice, with `limits.torque` and without it and the load, and judged by the same
certificate, which knows both; those certified are executed as by `hdplan simulate`. One core; times are of planning,
certificates included.

    python benchmarks/torques.py [--motions N]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.control.simulation import replay
from hdplan.planner.plan import plan
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.report import Cell, markdown_text
from hdplan.scenes.attached import Payload
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget

SCENES = {"panda_heavy": "panda_hand", "ur5_payload": "tool0"}  # and the link that bears the load
MASSES = (3.0, 6.0)  # [kg]
MOTIONS, TIME_LIMIT = 12, 8.0


class Outcome(NamedTuple):
    """Outcome of one motion, planned one way."""

    driven: bool  # certified with torques
    heavy: bool  # gravity alone was too much somewhere
    tracked: bool  # in simulation
    seconds: float


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=MOTIONS, help="for each scene and mass")
    count, rows = parser.parse_args().motions, []
    totals = np.zeros(4, dtype=int)
    for name, link in SCENES.items():
        for mass in MASSES:
            scene = replace(hdplan.load_scene(name), attached=(), payload=Payload(link, mass, (0.0, 0.0, 0.1)))
            robot = load_scene_robot(scene)
            certifier = Certifier(Setup.of(scene, robot))
            without, using = [], []
            for start, goal in ends(certifier, robot, count):
                task = replace(scene, start=JointTarget("start", start), goal=JointTarget("goal", goal))
                blind = replace(task, payload=None, limits=replace(task.limits, torque=None))
                without.append(outcome(blind, task, robot))
                using.append(outcome(task, task, robot))
            found = (sum(o.driven for o in without), sum(o.heavy for o in without))
            kept = (sum(o.driven for o in using), sum(o.tracked for o in using))
            totals += (*found, *kept)
            medians = (float(np.median([o.seconds for o in each])) for each in (without, using))
            times = " / ".join(f"{median:.2f}" for median in medians)
            rows.append((f"{name}, {mass:g} kg", count, *found, *kept, times))
    rows.append(("all", count * len(rows), *totals, ""))
    print(markdown_text([row(*each) for each in rows]))


def row(
    words: str, motions: int, driven: int, heavy: int, certified: int, tracked: int, seconds: str
) -> dict[str, Cell]:
    return {
        "scene, load": words,
        "motions": motions,
        "without: can be driven / heavy": f"{driven} / {heavy}",
        "with: certified / tracked": f"{certified} / {tracked}",
        "plan without / with [s]": seconds,
    }


def ends(certifier: Certifier, robot: Robot, count: int) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    rng = np.random.default_rng(7)
    found: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    while len(found) < count:
        start, goal = robot.draw(rng, 2)
        if holds(certifier, start) and holds(certifier, goal):
            found.append((tuple(start.tolist()), tuple(goal.tolist())))
    return found


def holds(certifier: Certifier, q: NDArray[np.float64]) -> bool:
    return not certifier.too_close(q, 0.0) and certifier.overload(q) is None


def outcome(requested: Scene, judged: Scene, robot: Robot) -> Outcome:
    began = time.perf_counter()
    result = plan(requested, robot=robot, time_limit=TIME_LIMIT)
    seconds = time.perf_counter() - began
    certificate = Certifier(Setup.of(judged, robot)).certify(result.trajectory)
    tracked = certificate.certified and replay(Setup.of(judged, robot), result.trajectory).succeeded
    return Outcome(certificate.certified, bool(certificate.overloaded), tracked, seconds)


if __name__ == "__main__":
    main()
