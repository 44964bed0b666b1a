"""Obstacles in the panel: added by a button or a mesh file, and the selected one's name, place, size, clearance and
speed."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, assert_never

from hdplan.planner.view import groups, scene_edits
from hdplan.planner.view.edit_steps import Editing, Fields, number_in, numbers_in, optional, spaced
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.page_script import LONGEST_TEXT
from hdplan.planner.view.things import Thing
from hdplan.planner.view.uploads import MESHES
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.shapes import Mesh, Shape
from hdplan.scenes.yaml_format.reader import read_obstacles
from hdplan.scenes.yaml_format.shape_fields import SHAPE_KEYS
from hdplan.scenes.yaml_format.writer import obstacle_text

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

PASTED = "pasted.yaml"
ARROW_STEP = 0.01  # [m], [m/s] or [rad/s] of a press on a field's arrow
GROUPS = "the part of a name before a slash is its group: a click on the group's line selects all of it"
NO_CHOICE = "no obstacle is selected: click on one, or choose it in the list"


class ObstacleFields:
    """The buttons, and the fields of the selected obstacle."""

    def __init__(self, viewer: Viewer, editing: Editing, handles: Handles) -> None:
        """Build them in the container at hand."""
        self._viewer, self._editing, self._handles = viewer, editing, handles
        gui = viewer.server.gui
        new = gui.add_button_group("add", tuple(scene_edits.NEW), hint="an obstacle, where there is room within reach")
        mesh = gui.add_upload_button("Add a mesh", mime_type=",".join(MESHES))
        ways, snaps = ("duplicate", "snap", "delete"), scene_edits.SNAPS
        self._buttons = gui.add_button_group("obstacle", ways, visible=False, hint=snaps)
        self._grouping = gui.add_button_group("group", ("group", "ungroup"), visible=False, hint=GROUPS)
        self._folder = gui.add_folder("obstacle", visible=False)
        new.on_click(lambda event: self._editing.do(partial(self.add, str(event.target.value))))
        mesh.on_upload(lambda event: self._editing.do(partial(self.add_mesh, event.target.value)))
        for buttons in (self._buttons, self._grouping):
            buttons.on_click(lambda event: self.ask(str(event.target.value)))
        self._fields = Fields(self._editing, lambda: handles.turn)
        self._kind: object = None  # of obstacle whose fields there are

    def ask(self, what: str) -> None:
        """Duplicate, snap, delete, group or ungroup the selected obstacles. By any thread."""
        ways: dict[str, Callable[[], None]] = {
            "duplicate": self.duplicate,
            "snap": self.snap,
            "delete": self.delete,
            "group": lambda: self.group(groups.free_group(self._viewer.edited)),
            "ungroup": lambda: self.group(""),
        }
        self._editing.do(ways.get(what, lambda: None))  # a browser may send anything

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def add(self, word: str) -> None:
        """Add an obstacle of a kind of shape, and select it."""
        self._put(word, scene_edits.NEW[word], word)

    def add_mesh(self, file: Any) -> None:
        """Add an obstacle of a mesh file that a browser sent, and select it. Raises InputError for a file that is no
        mesh."""
        path = self._viewer.uploads.take_mesh(file.name, file.content)
        self._put("mesh", Mesh(path), path.stem)

    def duplicate(self) -> None:
        """Put second ones beside the selected obstacles, and select them."""
        edited, added = scene_edits.duplicated(self._viewer.edited, *self._names)
        self._editing.apply("duplicate", lambda _: edited)
        self._handles.select(added[-1], added[:-1])

    def snap(self) -> None:
        """Move the selected obstacles to whole centimetres and degrees."""
        names = self._names
        self._editing.apply("snap", lambda edited: scene_edits.snapped(edited, *names))

    def paste(self, text: str) -> None:
        """Add obstacles that are written as in a scene, and select them. Raises InputError for any other text."""
        if len(text) > LONGEST_TEXT:
            raise InputError(f"the pasted text has more than {LONGEST_TEXT} characters: open it as a scene's file")
        file = self._viewer.uploads.take(PASTED, as_section(text).encode(), (PASTED,))
        edited, added = scene_edits.pasted(self._viewer.edited, read_obstacles(file))
        self._editing.apply("paste", lambda _: edited)
        self._handles.select(added[-1], added[:-1])

    def delete(self) -> None:
        """Delete the selected obstacles."""
        names = self._names
        self._editing.apply("delete", lambda edited: scene_edits.deleted(edited, *names))

    def group(self, group: str) -> None:
        """Let the selected obstacles be those of a group, or of none, and select them there."""
        edited, names = groups.grouped(self._viewer.edited, self._names, group)
        self._editing.apply("group", lambda _: edited)
        self._handles.select_all(names)

    def update(self) -> None:
        """Show the selected obstacle."""
        count = len(self._handles.obstacles)
        for part, shown in ((self._folder, count == 1), (self._buttons, count > 0), (self._grouping, count > 0)):
            part.visible = shown
        if count != 1:
            return
        obstacle = self._selected
        kind = type(obstacle.shape), type(obstacle.motion) is TimedPoses
        if kind != self._kind:
            self._kind = kind
            self._fields.clear()
            with self._folder:
                self._build(obstacle)
        self._fields.update()

    @property
    def text(self) -> str:
        """The selected obstacles as a scene writes them; "" if none is."""
        edited, names = self._viewer.edited, self._handles.obstacles
        return "".join(obstacle_text(edited.obstacle(name)) for name in names)

    @property
    def _selected(self) -> Obstacle:
        thing = self._handles.selected
        if thing is None or thing.kind != "obstacle":
            raise InputError(NO_CHOICE)
        return self._viewer.edited.obstacle(thing.name)

    @property
    def _names(self) -> tuple[str, ...]:
        """The names of the selected obstacles, at least one. Raises InputError if none is."""
        names = self._handles.obstacles
        if not names:
            raise InputError(NO_CHOICE)
        return names

    def _put(self, field: str, shape: Shape, stem: str) -> None:
        edited, thing = scene_edits.added(self._viewer.edited, shape, stem, self._viewer.panel.looking.eye)
        self._editing.apply(field, lambda _: edited)
        self._handles.select(thing)

    def _build(self, obstacle: Obstacle) -> None:
        """Build the fields of an obstacle of such a shape and such a motion."""
        gui = self._viewer.server.gui
        vector = (0.0, 0.0, 0.0)
        named = gui.add_text("name", "")
        self._fields.add("name", named, lambda: self._selected.name, self._renamed)
        self._vector("position [m]", lambda: self._selected.pose.position, scene_edits.placed)
        self._vector("turn [°]", lambda: scene_edits.turn_of(self._selected.pose), scene_edits.turned)
        quaternion = gui.add_text("quaternion", "", hint="x y z w, normalized")
        self._fields.add(
            "quaternion",
            quaternion,
            lambda: spaced(self._selected.pose.quaternion_xyzw),
            lambda edited, text: scene_edits.oriented(edited, self._selected.name, numbers_in(text)),
        )
        word = type(obstacle.shape).__name__.lower()
        for key in SHAPE_KEYS.get(word, ()):  # what was seen has no sizes
            if key == "file":
                continue
            value = getattr(obstacle.shape, key)
            if key == "points":
                points = gui.add_text("points [m]", "", multiline=True, hint="x y z, one point a line")
                self._fields.add(key, points, lambda: _lines(self._selected.shape), self._with_points)
                continue
            label = key if key == "scale" else f"{key} [m]"
            handle: Any = (
                gui.add_vector3(label, vector, step=ARROW_STEP)
                if isinstance(value, tuple)
                else gui.add_number(label, 0.0, step=ARROW_STEP)
            )
            self._fields.add(key, handle, partial(self._size, key), partial(self._resized, key))
        clearance = gui.add_text("clearance [m]", "", hint="to be proven around it; empty: the planner's")
        self._fields.add(
            "clearance",
            clearance,
            lambda: optional(self._selected.clearance),
            lambda edited, text: scene_edits.kept_clear(edited, self._selected.name, number_in(text)),
        )
        if isinstance(obstacle.motion, TimedPoses):
            passes = gui.add_number(
                "passes in [s]", 0.0, step=0.1, hint="from the first of its timed poses to the last"
            )
            self._fields.add(
                "passes in",
                passes,
                lambda: _duration(self._selected),
                lambda edited, new: scene_edits.passing(edited, self._selected.name, new),
            )
            return
        self._vector(
            "velocity [m/s]",
            lambda: _rates(self._selected)[0],
            lambda edited, name, new: scene_edits.moving(edited, name, new, _rates(self._selected)[1]),
        )
        self._vector(
            "spin [rad/s]",
            lambda: _rates(self._selected)[1],
            lambda edited, name, new: scene_edits.moving(edited, name, _rates(self._selected)[0], new),
        )

    def _vector(self, label: str, shown: Any, edit: Any) -> None:
        """Add a field of three numbers: `edit` takes the scene, the obstacle's name and the new value."""
        handle = self._viewer.server.gui.add_vector3(label, (0.0, 0.0, 0.0), step=ARROW_STEP)
        self._fields.add(label, handle, shown, lambda edited, new: edit(edited, self._selected.name, new))

    def _renamed(self, edited: Edited, new: str) -> Edited:
        renamed = scene_edits.renamed(edited, self._selected.name, new)
        _ = renamed.contacts  # refused before another one is selected
        self._handles.selected = Thing("obstacle", new)
        return renamed

    def _size(self, key: str) -> Any:
        return getattr(self._selected.shape, key)

    def _resized(self, key: str, edited: Edited, new: Any) -> Edited:
        return scene_edits.resized(edited, self._selected.name, **{key: new})

    def _with_points(self, edited: Edited, text: str) -> Edited:
        rows = [numbers_in(line) for line in text.splitlines() if line.strip()]
        return scene_edits.resized(edited, self._selected.name, points=rows)


def as_section(text: str) -> str:
    """Return obstacles that are written one below the other, or a single one, as a section of a scene, which they may
    be already."""
    lines = textwrap.dedent(text.replace("\r\n", "\n")).strip().splitlines()
    while lines and (not lines[0].strip() or lines[0].startswith("#")):
        del lines[0]
    bare = "\n".join(lines)
    if bare.startswith("obstacles:"):
        return f"{bare}\n"
    if not bare.startswith("-"):
        bare = "- " + bare.replace("\n", "\n  ")
    return f"obstacles:\n{bare}\n"


def _lines(shape: Any) -> str:
    return "\n".join(" ".join(f"{number:g}" for number in point) for point in shape.points)


def _duration(obstacle: Obstacle) -> float:
    assert isinstance(obstacle.motion, TimedPoses)
    return obstacle.motion.times[-1] - obstacle.motion.times[0]


def _rates(obstacle: Obstacle) -> tuple[Any, Any]:
    """Velocity [m/s] and spin [rad/s] of an obstacle that moves steadily, or not at all."""
    match motion := obstacle.motion:
        case SteadyMotion(velocity, spin):
            return velocity, spin
        case None | TimedPoses():
            return SteadyMotion.velocity, SteadyMotion.spin
        case _:
            assert_never(motion)
