"""The place of start or goal in numbers: where the tip is, or the goal pose, its turn as roll, pitch and yaw and as a
quaternion, and snapped to whole centimetres and degrees.

An end by joint values follows as it does when it is dragged; a goal pose keeps its tolerances and free axis.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from hdplan.planner.view import scene_edits
from hdplan.planner.view.edit_steps import Editing, Fields, numbers_in, spaced
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.things import REACHED_DISTANCE, Thing, dragged, place_of, turns
from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

ARROW_STEP, TURN_STEP = 0.01, 1.0  # [m] and [°] of a press on a field's arrow
REACHED_TURN = 0.01  # [rad] by which the tip may be turned otherwise than a number says
OUT_OF_REACH = "{end}: from this posture the tip stays {off:.0f} mm and {turned:.1f}° away"
NO_END = "neither start nor goal is selected"


class EndFields:
    """The fields of the end that is selected."""

    def __init__(self, viewer: Viewer, editing: Editing, handles: Handles) -> None:
        """Build them in the container at hand."""
        self._viewer, self._editing, self._handles = viewer, editing, handles
        gui = viewer.server.gui
        self._folder = gui.add_folder("place of start or goal", visible=False)
        with self._folder:
            snap = gui.add_button("Snap", hint=scene_edits.SNAPS)
        snap.on_click(lambda _: editing.do(self.snap))
        self._fields = Fields(editing, lambda: handles.turn)
        self._turning: tuple[Any, ...] = ()  # the fields of its turn, once they are built

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def update(self) -> None:
        """Show the end that is selected, if one is."""
        thing = self._handles.selected
        shown = thing is not None and thing.kind != "obstacle"
        self._folder.visible = shown
        if thing is None or not shown:
            return
        if not self._turning:
            with self._folder:
                self._build()
        turning = turns(self._viewer.edited, thing)
        for field in self._turning:
            field.visible = turning
        self._fields.update()

    def snap(self) -> None:
        """Move the end to whole centimetres and degrees. Raises InputError if none is selected."""
        self._editing.apply("snap", lambda edited: self._moved(edited, scene_edits.pose_snapped(self._place(edited))))

    def _build(self) -> None:
        gui, none = self._viewer.server.gui, (0.0, 0.0, 0.0)
        position = gui.add_vector3(
            "at [m]", none, step=ARROW_STEP, hint="the tip, or the goal pose, in the world frame"
        )
        turn = gui.add_vector3("turned [°]", none, step=TURN_STEP, hint="roll, pitch, yaw, about the world's axes")
        quaternion = gui.add_text("x y z w", "", hint="its quaternion, normalized")
        self._add("at [m]", position, lambda pose: pose.position, lambda pose, new: replace(pose, position=new))
        self._add("turned [°]", turn, scene_edits.turn_of, scene_edits.pose_turned)
        self._add(
            "x y z w",
            quaternion,
            lambda pose: spaced(pose.quaternion_xyzw),
            lambda pose, text: scene_edits.pose_oriented(pose, numbers_in(text)),
        )
        self._turning = turn, quaternion

    def _add(self, field: str, handle: Any, shown: Any, edit: Any) -> None:
        """Let a field show something of the pose, and change it: `edit` takes the pose and the new value."""
        self._fields.add(
            field,
            handle,
            lambda: shown(self._place(self._viewer.edited)),
            lambda edited, new: self._moved(edited, edit(self._place(edited), new)),
        )

    @property
    def _end(self) -> Thing:
        thing = self._handles.selected
        if thing is None or thing.kind == "obstacle":
            raise InputError(NO_END)
        return thing

    def _place(self, edited: Edited) -> Pose:
        return place_of(edited, self._end, self._viewer.stage.tip)

    def _moved(self, edited: Edited, pose: Pose) -> Edited:
        """Return the scene with the end there. Raises InputError where the tip does not come there: a number that was
        typed is to be true, unlike the place of a hand that drags. A goal pose is there, reached or not."""
        end, tip = self._end, self._viewer.stage.tip
        found, _ = dragged(edited, end, pose, tip)
        left = pin.SE3(place_of(found, end, tip).matrix).actInv(pin.SE3(pose.matrix))
        off, turned = float(np.linalg.norm(left.translation)), float(np.linalg.norm(pin.log3(left.rotation)))
        if off > REACHED_DISTANCE or (turned > REACHED_TURN and turns(found, end)):
            raise InputError(OUT_OF_REACH.format(end=end, off=1e3 * off, turned=np.degrees(turned)))
        return found
