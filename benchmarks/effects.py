"""The cost of each effect: the same scene with and without its section, in build, evaluation, solve and certificate.

    python benchmarks/effects.py [--picture FILE.png] [--repeat R]

One process, warm: every scene is planned once before it is measured. Given is the median of R runs, all of which do
the same. An evaluation is one call of `Problem.evaluate` at the straight line. Solve includes the timing. Without
its section a scene is another problem, often an easier one: where the iterations differ, so does the solve, whatever an
iteration costs.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import hdplan
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.studies.report import Cell, markdown_text
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import SelfCollision
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene

WEIGHT = 1e5  # [1/m²] of the penalty in an evaluation
LOOKS = 5  # evaluations in a run
PHASES = ("evaluation", "build", "solve", "certificate")


@dataclass(frozen=True)
class Effect:
    """A section, a shipped scene, and the scene with and without it."""

    section: str
    scene: str
    without: Callable[[Scene], Scene]
    given: Callable[[Scene], Scene] = lambda scene: scene


@dataclass(frozen=True)
class Cost:
    """One scene, measured."""

    status: str  # of the certificate
    terms: tuple[str, ...]
    pairs: int  # in all terms
    iterations: int
    seconds: tuple[float, ...]  # by phase


def standing(scene: Scene) -> Scene:
    """Return the scene without obstacles that move."""
    return replace(scene, obstacles=scene.standing)


def one_clearance(scene: Scene) -> Scene:
    """Return the scene with no obstacle's own clearance."""
    return replace(scene, obstacles=tuple(replace(obstacle, clearance=None) for obstacle in scene.obstacles))


def one_goal(scene: Scene) -> Scene:
    """Return the scene with the last configuration of its plan as its goal."""
    goal = hdplan.plan(scene).goal
    assert goal is not None
    return replace(scene, goal=goal)


EFFECTS = (
    Effect("obstacles[]", "panda_bookshelf", lambda scene: replace(scene, obstacles=())),
    Effect("obstacles[].clearance", "panda_vase", one_clearance),
    Effect("obstacles[].motion", "panda_conveyor", standing),
    Effect("self_collision", "panda_fold", lambda scene: replace(scene, self_collision=SelfCollision(False))),
    Effect("attached[]", "panda_carry", lambda scene: replace(scene, attached=())),
    Effect("goal.pose", "panda_grasp", one_goal),
    Effect("path.upright", "panda_cup", lambda scene: replace(scene, path=PathConstraints())),
    Effect("path.position", "ur5_scan", lambda scene: replace(scene, path=PathConstraints())),
    Effect("path.relative", "baxter_bimanual_carry", lambda scene: replace(scene, path=PathConstraints())),
    Effect("limits.position", "panda_cable", lambda scene: replace(scene, limits=Limits())),
    Effect("timing.duration", "panda_conveyor", lambda scene: replace(standing(scene), timing=None), standing),
    Effect("limits of rates", "ur5_pallet", lambda scene: replace(scene, limits=Limits(), timing=None)),
    Effect("limits.torque", "panda_heavy", lambda scene: replace(scene, limits=replace(scene.limits, torque=None))),
    Effect("payload", "ur5_payload", lambda scene: replace(scene, payload=None)),
)


def measure(scenes: tuple[Scene, ...], repeat: int) -> list[Cost]:
    """Plan scenes in turn, again and again, so that all of them meet the same machine; what each took: medians."""
    robots = [load_scene_robot(scene) for scene in scenes]
    problems = [hdplan.build(scene, robot) for scene, robot in zip(scenes, robots, strict=True)]
    phases: list[list[tuple[float, ...]]] = [[] for _ in scenes]
    results = []
    for _ in range(1 + repeat):
        results = [hdplan.plan(scene, robot=robot) for scene, robot in zip(scenes, robots, strict=True)]
        for taken, problem, result in zip(phases, problems, results, strict=True):
            times = result.times
            taken.append((look(problem), times.build + times.compile, times.solve, times.certify))
    return [
        Cost(
            result.certificate.status.value,
            tuple(term.name for term in problem.terms),
            sum(len(term.pairs) for term in problem.terms.pairs),
            result.iterations,
            tuple(np.median(taken[1:], axis=0).tolist()),
        )
        for taken, problem, result in zip(phases, problems, results, strict=True)
    ]


def look(problem: hdplan.Problem) -> float:
    """Return the time of an evaluation at the straight line [s], the median of a few."""
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    taken = []
    for _ in range(LOOKS):
        began = time.perf_counter()
        problem.evaluate(line, WEIGHT)
        taken.append(time.perf_counter() - began)
    return float(np.median(taken))


def row(effect: Effect, off: Cost, on: Cost) -> dict[str, Cell]:
    """Return one line of the table: without → with."""
    both = zip(PHASES, off.seconds, on.seconds, strict=True)
    times = {f"{phase} [ms]": f"{1e3 * before:.3g} → {1e3 * after:.3g}" for phase, before, after in both}
    return {
        "section": f"`{effect.section}`",
        "scene": effect.scene,
        "pairs": f"{off.pairs} → {on.pairs}",
        "iterations": f"{off.iterations} → {on.iterations}",
        **times,
        "verdict": off.status if off.status == on.status else f"{off.status} → {on.status}",
    }


def draw(costs: list[tuple[Effect, Cost, Cost]], file: Path) -> None:
    """Draw one panel for each phase: without and with, joined by a line."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullLocator

    from hdplan.planner.pictures.style import FRAME, GOAL, RC, START

    names = [f"{effect.section} · {effect.scene}" for effect, _, _ in costs]
    sides = [off for _, off, _ in costs], [on for _, _, on in costs]
    with plt.rc_context(RC):
        figure, panels = plt.subplots(1, len(PHASES), figsize=(11.5, 4.6), sharey=True, layout="constrained")
        for phase, (panel, title) in enumerate(zip(panels, PHASES, strict=True)):
            rows = np.arange(len(costs))[::-1]
            off, on = (1e3 * np.array([cost.seconds[phase] for cost in side]) for side in sides)
            panel.hlines(rows, off, on, color=FRAME, linewidth=2.5, zorder=1)
            panel.scatter(off, rows, color="white", edgecolor=START, s=28, label="without the section", zorder=2)
            panel.scatter(on, rows, color=GOAL, s=28, label="with it", zorder=3)
            panel.set(title=title.capitalize(), xlabel="[ms]", xscale="log")
            wide = max(off.max(), on.max()) > 200.0 * min(off.min(), on.min())  # too many numbers for the width
            panel.xaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
            panel.xaxis.set_major_formatter("{x:g}")
            panel.xaxis.set_minor_locator(NullLocator())
            panel.set_yticks(rows, names)
            panel.grid(axis="x", color=FRAME, linewidth=0.4)
            panel.tick_params(axis="y", length=0)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
        figure.suptitle("What a section of the scene costs, by itself", fontsize=12, weight="bold")
        figure.savefig(file, dpi=160)
        plt.close(figure)


def main() -> None:
    """Measure every effect, and say it as a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--repeat", type=int, default=15)
    options = parser.parse_args()

    costs = []
    for effect in EFFECTS:
        scene = effect.given(load_scene(effect.scene))
        off, on = measure((effect.without(scene), scene), options.repeat)
        costs.append((effect, off, on))
        print(*row(effect, off, on).values(), file=sys.stderr)
    print(markdown_text([row(*cost) for cost in costs]))
    if options.picture is not None:
        draw(costs, options.picture)


if __name__ == "__main__":
    main()
