"""Build: from a scene to the problem that a solver takes. The goal is settled first, then all is laid out."""

from __future__ import annotations

import math

from hdplan.planner.problem.lay_out import lay_out
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import naming
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import instance


def build(scene: Scene, robot: Robot | None = None, deadline: float = math.inf) -> Problem:
    """Return the problem of a scene. Where its goal leaves a choice, the likely best configuration is taken, which
    inverse kinematics and the certificate's look at it decide. Raises InputError for what the scene or its robot gets
    wrong.

    What can be done without waits no longer than `deadline` (time.perf_counter()): meshes that are not split into
    convex pieces by then are planned around as their hulls, with a note.
    """
    instance(scene, Scene, "scene")
    with naming(scene.source):
        scene.check_effects()
    setup = Setup.of(scene, robot)
    if isinstance(scene.goal, JointTarget):
        return lay_out(setup, setup.query, deadline)
    from hdplan.planner.search.goals import settled

    return lay_out(setup, settled(setup).query, deadline)
