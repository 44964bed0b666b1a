"""hdplan: motion planning for robot arms with smooth signed distances, proven against the real meshes.

    import hdplan
    scene = hdplan.load_scene("panda_cage")
    result = hdplan.plan(scene)
    print(result.certificate.text)
    result.save("motion.json")

Names are imported when first used, so that `import hdplan` is quick. Everything may be called from several threads at
once, on objects that they share, and gives what it gives alone.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdplan import control
    from hdplan.distance.bodies import ConvexBody
    from hdplan.planner.build import build
    from hdplan.planner.certificate.certifier import certify, check_configuration
    from hdplan.planner.certificate.verdict import Certificate
    from hdplan.planner.motion.trajectory import Trajectory
    from hdplan.planner.plan import plan
    from hdplan.planner.problem.problem import Problem
    from hdplan.planner.result import PlanResult
    from hdplan.planner.robot.robot import Robot, load_robot
    from hdplan.planner.solvers import solve
    from hdplan.planner.solvers.solution import Solution
    from hdplan.scenes.errors import HdplanError, InputError
    from hdplan.scenes.model import Scene
    from hdplan.scenes.yaml_format.reader import load_scene

__version__ = "0.1.0"

_HOMES = {
    "Certificate": "hdplan.planner.certificate.verdict",
    "ConvexBody": "hdplan.distance.bodies",
    "HdplanError": "hdplan.scenes.errors",
    "InputError": "hdplan.scenes.errors",
    "PlanResult": "hdplan.planner.result",
    "Problem": "hdplan.planner.problem.problem",
    "Robot": "hdplan.planner.robot.robot",
    "Scene": "hdplan.scenes.model",
    "Solution": "hdplan.planner.solvers.solution",
    "Trajectory": "hdplan.planner.motion.trajectory",
    "build": "hdplan.planner.build",
    "certify": "hdplan.planner.certificate.certifier",
    "check_configuration": "hdplan.planner.certificate.certifier",
    "load_robot": "hdplan.planner.robot.robot",
    "load_scene": "hdplan.scenes.yaml_format.reader",
    "plan": "hdplan.planner.plan",
    "solve": "hdplan.planner.solvers",
}

__all__ = [
    "Certificate",
    "ConvexBody",
    "HdplanError",
    "InputError",
    "PlanResult",
    "Problem",
    "Robot",
    "Scene",
    "Solution",
    "Trajectory",
    "__version__",
    "build",
    "certify",
    "check_configuration",
    "control",
    "load_robot",
    "load_scene",
    "plan",
    "solve",
]


def __getattr__(name: str) -> Any:
    if name == "control":
        return importlib.import_module("hdplan.control")
    if name not in _HOMES:
        raise AttributeError(f"module 'hdplan' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
