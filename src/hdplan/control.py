"""Control that keeps clear of obstacles: velocity commands by a quadratic program with control barrier functions.

    from hdplan import control
    controller = control.Controller.of(hdplan.load_scene("panda_cage"))
    step = controller.step(q, control.PoseTask(controller.robot, target))

See `hdplan.planner.control` for the equations, and `hdplan.planner.barrier_rules` for which settings are safe.
"""

from __future__ import annotations

from hdplan.planner.barriers import Barriers, BarrierSettings, scene_barriers
from hdplan.planner.control import Controller, Mode, Step
from hdplan.planner.control_run import Run, simulate
from hdplan.planner.control_settings import ControlSettings
from hdplan.planner.control_tasks import PoseTask, Task, TrackTask, standing

__all__ = [
    "BarrierSettings",
    "Barriers",
    "ControlSettings",
    "Controller",
    "Mode",
    "PoseTask",
    "Run",
    "Step",
    "Task",
    "TrackTask",
    "scene_barriers",
    "simulate",
    "standing",
]
