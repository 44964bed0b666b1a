"""The list of what is in the scene, one line each: a click selects, an eye hides, a lock keeps from changes, a cross
deletes.

What is hidden is not drawn, and stays where it is: motions keep clear of it, and its line says so.
"""

from __future__ import annotations

import contextlib
import html
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import viser

from hdplan.planner.view import scene_edits
from hdplan.planner.view.edit_steps import Editing
from hdplan.planner.view.page_script import Page, Told, link, telling
from hdplan.planner.view.things import Thing, things
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer


class Tree:
    """The lines, and what is hidden and locked."""

    def __init__(self, viewer: Viewer, page: Page, editing: Editing) -> None:
        """Build it in the container at hand."""
        self._viewer, self._editing = viewer, editing
        self._html = viewer.server.gui.add_html("")
        self.hidden: set[str] = set()
        for what, do in (
            ("select", self._select),
            ("eye", self._turn(self.hidden)),
            ("lock", self._turn(viewer.document.locked)),
            ("delete", self._delete),
        ):
            page.on(f"{what} thing", self._asked(do))

    @property
    def content(self) -> str:
        """The text, as HTML."""
        return str(self._html.content)

    # --- by the worker's thread -----------------------------------------------------------------------------------

    @contextlib.contextmanager
    def replaced(self) -> Iterator[None]:
        """Lock and hide nothing, as another scene is opened in this block, unless that is refused."""
        locked = self._viewer.document.locked
        before = set(self.hidden), set(locked)
        self.hidden.clear()
        locked.clear()
        try:
            yield
        except InputError:
            self.hidden |= before[0]
            locked |= before[1]
            raise

    def update(self) -> None:
        """Write the lines, and hide what is hidden."""
        viewer = self._viewer
        for node in viewer.stage.obstacles:
            if node.frame.visible == (node.obstacle.name in self.hidden):
                node.frame.visible = node.obstacle.name not in self.hidden
        lines = "".join(self._line(thing) for thing in things(viewer.edited))
        content = f'<div class="hd">{lines}</div>'
        if self._html.content != content:
            self._html.content = content

    def _line(self, thing: Thing) -> str:
        selected = " hd-chosen" if thing == self._viewer.panel.handles.selected else ""
        named = {"kind": thing.kind, "name": thing.name}
        text, links = html.escape(thing.name or f"the {thing.kind}"), ""
        if thing.kind == "obstacle":
            hidden, locked = thing.name in self.hidden, thing.name in self._viewer.document.locked
            text += " <i>hidden, kept clear of</i>" if hidden else ""
            links = (
                link("show" if hidden else "hide", "eye thing", "of the picture alone", **named)
                + link("unlock" if locked else "lock", "lock thing", "against changes", **named)
                + link("✕", "delete thing", "delete", **named)
            )
        elif thing.name:
            text = f"the goal of {text}"
        choose = telling("select thing", **named)
        return (
            f'<div class="hd-row{selected}" role="button" tabindex="0" data-do="{choose}">'
            f'<span class="hd-line" style="flex:1">{text}</span>{links}</div>'
        )

    # --- what browsers ask for ------------------------------------------------------------------------------------

    def _asked(self, do: Callable[[Thing], object]) -> Callable[[viser.ClientHandle, Told], object]:
        """Have something done with the thing that is told, if it is there."""

        def job(told: Told) -> None:
            thing = Thing(str(told.get("kind")), str(told.get("name", "")))
            if thing in things(self._viewer.edited):
                do(thing)
                self.update()

        return lambda _, told: self._editing.do(lambda: job(told))

    def _select(self, thing: Thing) -> None:
        self._viewer.panel.handles.select(thing)

    def _turn(self, names: set[str]) -> Callable[[Thing], None]:
        return lambda thing: names.symmetric_difference_update({thing.name} if thing.kind == "obstacle" else ())

    def _delete(self, thing: Thing) -> None:
        if thing.kind == "obstacle":
            self._editing.apply("delete", lambda edited: scene_edits.deleted(edited, thing.name))
