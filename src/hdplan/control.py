"""Control that keeps clear of obstacles: velocity commands by a quadratic program with control barrier functions.

    from hdplan import control
    controller = control.Controller.of(hdplan.load_scene("panda_cage"))
    step = controller.step(q, control.PoseTask(controller.robot, target))

See `hdplan.planner.control.controller` for the equations, and `hdplan.planner.control.barrier_safety` for which
settings are safe.
"""

from __future__ import annotations

from hdplan.planner.control.barriers import Barriers, BarrierSettings, scene_barriers
from hdplan.planner.control.braking import Command
from hdplan.planner.control.controller import Controller, Step
from hdplan.planner.control.look_ahead import Mode
from hdplan.planner.control.rollout import Run, simulate
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.control.tasks import Damping, PoseTask, Ranked, Task, TrackTask, standing

__all__ = [
    "BarrierSettings",
    "Barriers",
    "Command",
    "ControlSettings",
    "Controller",
    "Damping",
    "Mode",
    "PoseTask",
    "Ranked",
    "Run",
    "Step",
    "Task",
    "TrackTask",
    "scene_barriers",
    "simulate",
    "standing",
]


def __dir__() -> list[str]:
    """Public names."""
    return sorted(__all__)
