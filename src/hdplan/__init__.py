"""hdplan: motion planning for robot arms with smooth signed distances, proven against the real meshes.

    import hdplan
    scene = hdplan.load_scene("panda_cage")
    result = hdplan.plan(scene)
    print(result.certificate.text)
    result.save("motion.json")

A scene can also be made without a file:

    box = hdplan.Box([0.1, 0.1, 0.6], pose=[0.6, 0.0, 0.3])
    scene = hdplan.Scene(robot="panda", obstacles=[box], start="default", goal=[0.6, -0.3, 0, -2, 0, 1.8, 0.785])

The public interface is listed in `__all__`, here, in `hdplan.distance`, `hdplan.control` and `hdplan.symbolic`;
everything else may change from one version to the next. All input is checked, and refused with an `InputError` of one
line. All results can be pickled.

Names are imported on first use, so that `import hdplan` is fast. Everything may be called from several threads at once,
also on shared objects, with the same results.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

# In a checkout planner/, distance/, scenes/ and cli.py lie at its top, and are imported from there: the links beside
# this file are for type checkers, which run nothing.
_checkout = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
if os.path.isfile(os.path.join(_checkout, "hatch_build.py")):
    __path__.insert(0, _checkout)

from hdplan.scenes.lazy_imports import lazy_imports  # noqa: E402

if TYPE_CHECKING:
    from hdplan import control, distance, symbolic
    from hdplan.distance.bodies import ConvexBody
    from hdplan.planner.batch.many import plan_many
    from hdplan.planner.batch.outcome import Outcome
    from hdplan.planner.build import build
    from hdplan.planner.certificate.certifier import certify, check_configuration
    from hdplan.planner.certificate.verdict import Certificate
    from hdplan.planner.job.certify import JobCertificate, StageCertificate, certify_job
    from hdplan.planner.job.planning import plan_job
    from hdplan.planner.job.result import JobResult
    from hdplan.planner.motion.samples import Samples
    from hdplan.planner.motion.trajectory import StageMark, Trajectory
    from hdplan.planner.plan import plan
    from hdplan.planner.problem.own_term import OwnTerm
    from hdplan.planner.problem.problem import Problem
    from hdplan.planner.proof.proof import NotProvenError, Proof, prove
    from hdplan.planner.replanning.command import Command
    from hdplan.planner.replanning.replanner import Replanner
    from hdplan.planner.result import PlanResult
    from hdplan.planner.robot.robot import Robot, load_robot
    from hdplan.planner.search.inverse_kinematics import inverse_kinematics
    from hdplan.planner.search.search import Event
    from hdplan.planner.solvers import solve
    from hdplan.planner.solvers.solution import Budget, Solution
    from hdplan.scenes.attached import Attached, Payload
    from hdplan.scenes.clouds import Cloud, Ignored
    from hdplan.scenes.curve_stages import Along, Circle, Line
    from hdplan.scenes.depth_images import DepthImage
    from hdplan.scenes.errors import HdplanError, InputError, TimeLimitError, UnsolvableError
    from hdplan.scenes.job import Grip, Job, Move, Release, Set, Wait
    from hdplan.scenes.limits import Limits
    from hdplan.scenes.obstacles import Obstacle, SelfCollision, SteadyMotion, TimedPoses
    from hdplan.scenes.path_constraints import Follow, PathConstraints, Relative, Upright, Within
    from hdplan.scenes.planner_settings import PlannerSettings
    from hdplan.scenes.poses import Pose
    from hdplan.scenes.robot_spec import RobotSpec
    from hdplan.scenes.scene import Scene
    from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Sphere
    from hdplan.scenes.sizes import Calibration, Tracking, Uncertainty
    from hdplan.scenes.targets import AllOf, PoseTarget, State
    from hdplan.scenes.timing import Timing
    from hdplan.scenes.voxel_grids import OctoMap, Voxels
    from hdplan.scenes.yaml_format.reader import load_scene

__version__ = "0.1.0"

_HOMES = {  # of names, below hdplan
    "AllOf": "scenes.targets",
    "Along": "scenes.curve_stages",
    "Attached": "scenes.attached",
    "Box": "scenes.shapes",
    "Budget": "planner.solvers.solution",
    "Calibration": "scenes.sizes",
    "Capsule": "scenes.shapes",
    "Certificate": "planner.certificate.verdict",
    "Circle": "scenes.curve_stages",
    "Cloud": "scenes.clouds",
    "Command": "planner.replanning.command",
    "ConvexBody": "distance.bodies",
    "Cylinder": "scenes.shapes",
    "DepthImage": "scenes.depth_images",
    "Ellipsoid": "scenes.shapes",
    "Event": "planner.search.search",
    "Follow": "scenes.path_constraints",
    "Grip": "scenes.job",
    "HdplanError": "scenes.errors",
    "Ignored": "scenes.clouds",
    "InputError": "scenes.errors",
    "Job": "scenes.job",
    "JobCertificate": "planner.job.certify",
    "JobResult": "planner.job.result",
    "Limits": "scenes.limits",
    "Line": "scenes.curve_stages",
    "Mesh": "scenes.shapes",
    "Move": "scenes.job",
    "NotProvenError": "planner.proof.proof",
    "Obstacle": "scenes.obstacles",
    "OctoMap": "scenes.voxel_grids",
    "Outcome": "planner.batch.outcome",
    "OwnTerm": "planner.problem.own_term",
    "PathConstraints": "scenes.path_constraints",
    "Payload": "scenes.attached",
    "PlanResult": "planner.result",
    "PlannerSettings": "scenes.planner_settings",
    "Points": "scenes.shapes",
    "Pose": "scenes.poses",
    "PoseTarget": "scenes.targets",
    "Problem": "planner.problem.problem",
    "Proof": "planner.proof.proof",
    "Relative": "scenes.path_constraints",
    "Release": "scenes.job",
    "Replanner": "planner.replanning.replanner",
    "Robot": "planner.robot.robot",
    "RobotSpec": "scenes.robot_spec",
    "Samples": "planner.motion.samples",
    "Scene": "scenes.scene",
    "SelfCollision": "scenes.obstacles",
    "Set": "scenes.job",
    "Solution": "planner.solvers.solution",
    "Sphere": "scenes.shapes",
    "StageCertificate": "planner.job.certify",
    "StageMark": "planner.motion.trajectory",
    "State": "scenes.targets",
    "SteadyMotion": "scenes.obstacles",
    "TimeLimitError": "scenes.errors",
    "TimedPoses": "scenes.obstacles",
    "Timing": "scenes.timing",
    "Tracking": "scenes.sizes",
    "Trajectory": "planner.motion.trajectory",
    "Uncertainty": "scenes.sizes",
    "UnsolvableError": "scenes.errors",
    "Upright": "scenes.path_constraints",
    "Voxels": "scenes.voxel_grids",
    "Wait": "scenes.job",
    "Within": "scenes.path_constraints",
    "build": "planner.build",
    "certify": "planner.certificate.certifier",
    "certify_job": "planner.job.certify",
    "check_configuration": "planner.certificate.certifier",
    "inverse_kinematics": "planner.search.inverse_kinematics",
    "load_robot": "planner.robot.robot",
    "load_scene": "scenes.yaml_format.reader",
    "plan": "planner.plan",
    "plan_job": "planner.job.planning",
    "plan_many": "planner.batch.many",
    "prove": "planner.proof.proof",
    "solve": "planner.solvers",
}

__all__ = [
    "AllOf",
    "Along",
    "Attached",
    "Box",
    "Budget",
    "Calibration",
    "Capsule",
    "Certificate",
    "Circle",
    "Cloud",
    "Command",
    "ConvexBody",
    "Cylinder",
    "DepthImage",
    "Ellipsoid",
    "Event",
    "Follow",
    "Grip",
    "HdplanError",
    "Ignored",
    "InputError",
    "Job",
    "JobCertificate",
    "JobResult",
    "Limits",
    "Line",
    "Mesh",
    "Move",
    "NotProvenError",
    "Obstacle",
    "OctoMap",
    "Outcome",
    "OwnTerm",
    "PathConstraints",
    "Payload",
    "PlanResult",
    "PlannerSettings",
    "Points",
    "Pose",
    "PoseTarget",
    "Problem",
    "Proof",
    "Relative",
    "Release",
    "Replanner",
    "Robot",
    "RobotSpec",
    "Samples",
    "Scene",
    "SelfCollision",
    "Set",
    "Solution",
    "Sphere",
    "StageCertificate",
    "StageMark",
    "State",
    "SteadyMotion",
    "TimeLimitError",
    "TimedPoses",
    "Timing",
    "Tracking",
    "Trajectory",
    "Uncertainty",
    "UnsolvableError",
    "Upright",
    "Voxels",
    "Wait",
    "Within",
    "__version__",
    "build",
    "certify",
    "certify_job",
    "check_configuration",
    "control",
    "distance",
    "inverse_kinematics",
    "load_robot",
    "load_scene",
    "plan",
    "plan_job",
    "plan_many",
    "prove",
    "solve",
    "symbolic",
]


_find = lazy_imports(__name__, _HOMES)


def __getattr__(name: str) -> Any:
    if name in ("control", "distance", "symbolic"):
        return importlib.import_module(f"hdplan.{name}")
    return _find(name)


def __dir__() -> list[str]:
    return sorted(__all__)
