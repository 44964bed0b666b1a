"""Build: from a scene to the problem for a solver. The goal is chosen first, then the problem is assembled."""

from __future__ import annotations

import math

from hdplan.planner.problem.assemble import assemble
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import naming
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import instance


def build(scene: Scene, robot: Robot | None = None, deadline: float = math.inf) -> Problem:
    """Return the problem of a scene. If its goal leaves a choice, the most promising configuration is taken: inverse
    kinematics finds the candidates, and the certificate checks them. Raises InputError for errors in the scene or its
    robot, and for a start or goal through which the robot moves.

    Optional steps end at `deadline` (time.perf_counter()): meshes that are not split into convex pieces by then are
    enclosed by boxes around their surfaces, with a note.
    """
    instance(scene, Scene, "scene")
    with naming(scene.source):
        scene.check_effects()
    setup = Setup.of(scene, robot)
    setup.refuse_moving_ends("the path of a problem knows no velocities: hdplan.plan plans such motions")
    return problem_of(setup, deadline)


def problem_of(setup: Setup, deadline: float = math.inf) -> Problem:
    """Return the problem of a path between the configurations of start and goal, regardless of their velocities;
    otherwise as `build`."""
    if isinstance(setup.scene.goal, JointTarget):
        return assemble(setup, setup.query, deadline)
    from hdplan.planner.search.goals import settled

    return assemble(setup, settled(setup).query, deadline)
