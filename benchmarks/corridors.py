"""The cause of the HD-SDF's smooth commands: random corridors, parallel and not, at equal clearance.

    python benchmarks/corridors.py [--corridors 8]

In half of the corridors walls and roof are parallel, in the other half each is turned by up to 0.15 rad about each
axis. The paper's Panda of boxes enters under the paper's own controller (`corridor_experiment.py`), fitted bodies under
ours: with its defaults, with one rate and without limits of acceleration as in the paper, and with grown obstacles. The
exact distance then enters under the same controller with the same settings, but for the margin with which it keeps the
same least exact clearance (5 s, sampled 50 times a second). The table shows the HD-SDF's total variation, and its
total variation and energy above 5 Hz over the exact distance's, of all joints once the arm is under way: below 1 the
HD-SDF is smoother.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from hdplan.control import Barriers, BarrierSettings, Controller, ControlSettings, Step, scene_barriers, simulate
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_obstacle
from hdplan.planner.control.rollout import fast_energy, total_variation
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.studies import corridor_experiment as published
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box

Made = Callable[[Robot, Scene, ControlSettings], Controller]

TURN = 0.15  # [rad] at most, about each axis
MATCHES, CLOSE = 3, 1e-3  # times that the exact distance's margin is corrected by the clearance that it missed [m]
UNDER_WAY = 0.25  # [s] after which commands count: limits of acceleration let the arm start slowly
EXACT = BarrierSettings("euclidean", growth=0.0, self_growth=0.0)


def corridor(seed: int, parallel: bool) -> Scene:
    """Return a corridor like the paper's, its walls up to 3 cm farther out."""
    rng = np.random.default_rng(seed)
    obstacles = []
    for name, (centre, sides) in published.WALLS.items():
        turn = Rotation.from_rotvec(np.zeros(3) if parallel else rng.uniform(-TURN, TURN, 3)).as_quat()
        where = np.array(centre) + rng.uniform(0.0, 0.03) * np.sign(np.array(centre)) * (0.0, 1.0, 1.0)
        obstacles.append(Obstacle(name, Box(sides), Pose(tuple(where.tolist()), tuple(turn.tolist()))))
    return replace(published.corridor_scene(), obstacles=tuple(obstacles))


def paper(robot: Robot, scene: Scene, settings: ControlSettings) -> Controller:
    """Return the paper's controller, of boxes alone, in a corridor whose boxes are grown on every side."""
    growth = settings.barriers.growth
    grown: list[HalfspaceBody] = []
    for obstacle in scene.obstacles:
        assert isinstance(obstacle.shape, Box)
        sides = tuple(side + 2 * growth for side in obstacle.shape.size)
        grown += from_obstacle(replace(obstacle, shape=Box(sides)))[0]
    bare = replace(settings.barriers, growth=0.0)
    barriers = Barriers(robot, kinematics_of(robot), published.link_boxes(), published.link_box_pairs(), grown, bare)
    return Controller(robot, barriers, replace(settings, barriers=bare))


def ours(robot: Robot, scene: Scene, settings: ControlSettings) -> Controller:
    """Return our controller, of fitted bodies."""
    return Controller(robot, scene_barriers(scene, robot, settings.barriers), settings)


def measured(make: Made, robot: Robot, scene: Scene, settings: ControlSettings) -> tuple[float, float, float]:
    """Return the total variation [rad/s] and the energy above 5 Hz [rad²/s] of the commands, and the least exact
    clearance of the bodies [m]."""
    exact = make(robot, scene, replace(settings, barriers=EXACT, as_published=True)).barriers
    every, clearances = round(published.EXACT_EVERY / settings.period), []

    def watch(time: float, q: Array, step: Step) -> None:
        if round(time / settings.period) % every == 0:
            clearances.append(float(exact.evaluate(q).value[: exact.obstacle_pairs].min()))

    controller, begin, task = make(robot, scene, settings), np.array(published.START), published.tool_task(robot)
    run = simulate(controller, begin, task, published.CRITICAL_PHASE, until_met=False, watch=watch)
    commands = run.velocities[round(UNDER_WAY / settings.period) :]
    return total_variation(commands), fast_energy(commands, settings.period), min(clearances)


def compared(make: Made, robot: Robot, scene: Scene, settings: ControlSettings) -> tuple[float, ...]:
    """Return the variation [rad/s], variation and energy over those of the exact distance at the same clearance, that
    [m], and by how much it was missed [m]."""
    variation, energy, clearance = measured(make, robot, scene, settings)
    margin = clearance - 0.005
    for _ in range(MATCHES + 1):
        same = replace(settings, barriers=EXACT, margin=margin, self_margin=1e-4)
        other = measured(make, robot, scene, same)
        if abs(other[2] - clearance) < CLOSE:
            break
        margin += clearance - other[2]
    return variation, variation / other[0], energy / other[1], clearance, other[2] - clearance


def cases() -> dict[str, tuple[Made, ControlSettings]]:
    """Return the cases: bodies and controller, by name."""
    as_safe = published.VARIANTS[published.NAMES.index(published.AS_SAFE)]
    grown = replace(as_safe.settings, barriers=replace(as_safe.settings.barriers, growth=as_safe.growth))
    return {
        "the paper's boxes, its controller as safe": (paper, grown),
        "fitted bodies, our defaults": (ours, ControlSettings()),
        "the same, one rate and no limits of acceleration": (ours, ControlSettings(as_published=True)),
        "fitted bodies, growth 20 mm, margin −0.25 mm": (
            ours,
            ControlSettings(BarrierSettings(growth=0.02), margin=-2.5e-4),
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corridors", type=int, default=8)
    given = parser.parse_args()
    rows, count, robot = [], given.corridors // 2, load_scene_robot(published.corridor_scene())
    for words, (make, settings) in cases().items():
        for parallel in (True, False):
            found = np.array([compared(make, robot, corridor(seed, parallel), settings) for seed in range(count)])
            variation, ratio, energy, clearance = map(_spread, (found[:, :4] * (1.0, 1.0, 1.0, 1e3)).T)
            row = {
                "bodies and barrier": words,
                "corridors": f"{count} {'parallel' if parallel else 'turned'}",
                "total variation [rad/s]": variation,
                "over the exact distance's": ratio,
                "energy above 5 Hz over its": energy,
                "rougher in": int((found[:, 1] > 1.0).sum()),
                "clearance [mm]": clearance,
                "matched to [mm]": f"{1e3 * np.abs(found[:, 4]).max():.2g}",
            }
            rows.append(row)
    print(markdown_text(rows))


def _spread(values: Array) -> str:
    return f"{np.median(values):.2g} ({values.min():.2g} to {values.max():.2g})"


if __name__ == "__main__":
    main()
