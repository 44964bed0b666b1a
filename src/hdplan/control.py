"""Control that keeps clear of obstacles: velocity commands by a quadratic program with control barrier functions.

    from hdplan import control
    controller = control.Controller.of(hdplan.load_scene("panda_cage"))
    step = controller.step(q, control.PoseTask(controller.robot, target))

See `hdplan.planner.control.controller` for the equations, and `hdplan.planner.control.barrier_safety` for which
settings are safe.
"""

from __future__ import annotations

from hdplan.scenes.lazy_imports import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
