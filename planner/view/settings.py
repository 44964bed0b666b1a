"""The planner's settings in the panel: those of the scene, which are edits of it, and those of a plan alone."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from hdplan.planner.solvers import DEFAULT, SOLVERS
from hdplan.planner.view import scene_edits
from hdplan.planner.view.edit_steps import Editing, Fields, number_in, optional
from hdplan.planner.view.edited_scene import Edited
from hdplan.scenes.planner_settings import DISTANCES, OBJECTIVES, PlannerSettings

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

TIME_LIMIT = 30.0  # [s] for planning
USUAL = "usual"  # objective of a scene that names none


class Settings:
    """The inputs."""

    def __init__(self, viewer: Viewer, editing: Editing) -> None:
        """Build them in the container at hand."""
        self._viewer = viewer
        gui = viewer.server.gui
        self.solver = gui.add_dropdown("solver", list(SOLVERS), initial_value=DEFAULT)
        self._fields = Fields(editing)
        self._add("distance", gui.add_dropdown("distance", DISTANCES, hint="in the obstacle penalty; fcl is exact"))
        self._add("clearance", gui.add_number("clearance [m]", 0.0, step=0.005, hint="to be proven around the robot"))
        self._add("waypoints", gui.add_number("waypoints", 0, step=1))
        objective = gui.add_dropdown("objective", (USUAL, *OBJECTIVES), hint="by which certified motions are compared")
        self._fields.add(
            "objective",
            objective,
            lambda: viewer.scene.planner.objective or USUAL,
            lambda edited, word: scene_edits.planned_by(edited, objective=None if word == USUAL else word),
        )
        polish = gui.add_text("polish", "", hint="rounds that improve the first certified motion; empty: the default")
        self._fields.add(
            "polish",
            polish,
            lambda: optional(viewer.scene.planner.polish),
            lambda edited, text: scene_edits.planned_by(edited, polish=number_in(text, int)),
        )
        duration = gui.add_text("duration [s]", "", hint="duration of the motion; empty: chosen by the planner")
        self._fields.add(
            "duration",
            duration,
            lambda: optional(viewer.scene.end_time or None),
            lambda edited, text: scene_edits.lasting(edited, number_in(text)),
        )
        self.seed = gui.add_number("seed", 0, step=1, hint="seed of the random guesses")
        self.time_limit = gui.add_number("time limit [s]", TIME_LIMIT, step=1.0, hint="limit on the time to plan")

    def update(self) -> None:
        """Show the settings of the scene as it is now. By the worker's thread."""
        self._fields.update()

    def _add(self, name: str, handle: Any) -> None:
        """Let an input show and set a field of `PlannerSettings`."""
        assert name in {field.name for field in fields(PlannerSettings)}

        def shown() -> Any:
            return getattr(self._viewer.scene.planner, name)

        def edit(edited: Edited, value: Any) -> Edited:
            return scene_edits.planned_by(edited, **{name: value})

        self._fields.add(f"planner's {name}", handle, shown, edit)  # obstacles have a clearance, too
