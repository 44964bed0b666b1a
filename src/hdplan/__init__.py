"""hdplan: motion planning for robot arms with smooth signed distances, proven against the real meshes.

    import hdplan
    scene = hdplan.load_scene("panda_cage")
    result = hdplan.plan(scene)
    print(result.certificate.text)
    result.save("motion.json")

A scene may be made without a file:

    box = hdplan.Box([0.1, 0.1, 0.6], pose=[0.6, 0.0, 0.3])
    scene = hdplan.Scene(robot="panda", obstacles=[box], start="default", goal=[0.6, -0.3, 0, -2, 0, 1.8, 0.785])

What is for use is listed in `__all__`, here, in `hdplan.distance` and in `hdplan.control`; all else may change from one
version to the next. Whatever goes in is checked, and refused by an `InputError` of one line. All that comes out can be
pickled.

Names are imported when first used, so that `import hdplan` is quick. Everything may be called from several threads at
once, on objects that they share, and gives what it gives alone.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdplan import control, distance
    from hdplan.distance.bodies import ConvexBody
    from hdplan.planner.build import build
    from hdplan.planner.certificate.certifier import certify, check_configuration
    from hdplan.planner.certificate.verdict import Certificate
    from hdplan.planner.motion.trajectory import Trajectory
    from hdplan.planner.plan import plan
    from hdplan.planner.problem.problem import Problem
    from hdplan.planner.result import PlanResult
    from hdplan.planner.robot.robot import Robot, load_robot
    from hdplan.planner.search.inverse_kinematics import inverse_kinematics
    from hdplan.planner.search.search import Event
    from hdplan.planner.solvers import solve
    from hdplan.planner.solvers.solution import Budget, Solution
    from hdplan.scenes.attached import Attached, Payload
    from hdplan.scenes.errors import HdplanError, InputError, OutOfTime
    from hdplan.scenes.limits import Limits
    from hdplan.scenes.obstacles import Obstacle, SelfCollision, SteadyMotion, TimedPoses
    from hdplan.scenes.path_constraints import PathConstraints, Upright, Within
    from hdplan.scenes.planner_settings import PlannerSettings
    from hdplan.scenes.poses import Pose
    from hdplan.scenes.robot_spec import RobotSpec
    from hdplan.scenes.scene import Scene
    from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Sphere
    from hdplan.scenes.targets import PoseTarget
    from hdplan.scenes.timing import Timing
    from hdplan.scenes.yaml_format.reader import load_scene

__version__ = "0.1.0"

_HOMES = {
    "Attached": "hdplan.scenes.attached",
    "Box": "hdplan.scenes.shapes",
    "Budget": "hdplan.planner.solvers.solution",
    "Capsule": "hdplan.scenes.shapes",
    "Certificate": "hdplan.planner.certificate.verdict",
    "ConvexBody": "hdplan.distance.bodies",
    "Cylinder": "hdplan.scenes.shapes",
    "Ellipsoid": "hdplan.scenes.shapes",
    "Event": "hdplan.planner.search.search",
    "HdplanError": "hdplan.scenes.errors",
    "InputError": "hdplan.scenes.errors",
    "Limits": "hdplan.scenes.limits",
    "Mesh": "hdplan.scenes.shapes",
    "Obstacle": "hdplan.scenes.obstacles",
    "OutOfTime": "hdplan.scenes.errors",
    "PathConstraints": "hdplan.scenes.path_constraints",
    "Payload": "hdplan.scenes.attached",
    "PlanResult": "hdplan.planner.result",
    "PlannerSettings": "hdplan.scenes.planner_settings",
    "Points": "hdplan.scenes.shapes",
    "Pose": "hdplan.scenes.poses",
    "PoseTarget": "hdplan.scenes.targets",
    "Problem": "hdplan.planner.problem.problem",
    "Robot": "hdplan.planner.robot.robot",
    "RobotSpec": "hdplan.scenes.robot_spec",
    "Scene": "hdplan.scenes.scene",
    "SelfCollision": "hdplan.scenes.obstacles",
    "Solution": "hdplan.planner.solvers.solution",
    "Sphere": "hdplan.scenes.shapes",
    "SteadyMotion": "hdplan.scenes.obstacles",
    "TimedPoses": "hdplan.scenes.obstacles",
    "Timing": "hdplan.scenes.timing",
    "Trajectory": "hdplan.planner.motion.trajectory",
    "Upright": "hdplan.scenes.path_constraints",
    "Within": "hdplan.scenes.path_constraints",
    "build": "hdplan.planner.build",
    "certify": "hdplan.planner.certificate.certifier",
    "check_configuration": "hdplan.planner.certificate.certifier",
    "inverse_kinematics": "hdplan.planner.search.inverse_kinematics",
    "load_robot": "hdplan.planner.robot.robot",
    "load_scene": "hdplan.scenes.yaml_format.reader",
    "plan": "hdplan.planner.plan",
    "solve": "hdplan.planner.solvers",
}

__all__ = [
    "Attached",
    "Box",
    "Budget",
    "Capsule",
    "Certificate",
    "ConvexBody",
    "Cylinder",
    "Ellipsoid",
    "Event",
    "HdplanError",
    "InputError",
    "Limits",
    "Mesh",
    "Obstacle",
    "OutOfTime",
    "PathConstraints",
    "Payload",
    "PlanResult",
    "PlannerSettings",
    "Points",
    "Pose",
    "PoseTarget",
    "Problem",
    "Robot",
    "RobotSpec",
    "Scene",
    "SelfCollision",
    "Solution",
    "Sphere",
    "SteadyMotion",
    "TimedPoses",
    "Timing",
    "Trajectory",
    "Upright",
    "Within",
    "__version__",
    "build",
    "certify",
    "check_configuration",
    "control",
    "distance",
    "inverse_kinematics",
    "load_robot",
    "load_scene",
    "plan",
    "solve",
]


def __getattr__(name: str) -> Any:
    if name in ("control", "distance"):
        return importlib.import_module(f"hdplan.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'hdplan' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
