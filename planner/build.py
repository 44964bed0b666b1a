"""Build: from a scene to the problem that a solver takes. The goal is settled first, then all is laid out."""

from __future__ import annotations

import math

from hdplan.planner.problem.lay_out import lay_out
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import check_robot, load_scene_robot, resolve_query
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
    robot = load_scene_robot(scene) if robot is None else robot
    instance(robot, Robot, "robot")
    check_robot(scene, robot)
    return lay_out(scene, robot, resolve_query(robot, _settled(scene, robot)), deadline)


def _settled(scene: Scene, robot: Robot) -> Scene:
    """Return the scene with one configuration as its goal."""
    if isinstance(scene.goal, JointTarget):
        return scene
    from hdplan.planner.search.goals import settled

    return settled(scene, robot)
