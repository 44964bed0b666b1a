"""The list of what is in the scene, one line each: a click selects, an eye hides, a lock keeps from changes, a cross
deletes; with shift or ctrl a click selects one more. Obstacles of a group stand below its line, which acts on all of
them.

What is hidden is not drawn, and stays where it is: motions keep clear of it, and its line says so.
"""

from __future__ import annotations

import contextlib
import html
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from hdplan.planner.view import groups, scene_edits
from hdplan.planner.view.edit_steps import Editing
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.page_script import Handler, Message, Page, link, telling
from hdplan.planner.view.things import Thing, things
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

Act = Callable[[Sequence[str], Message], object]
"""Something that is done with some obstacles, as a page's message says."""


class Tree:
    """The lines, and what is hidden and locked."""

    def __init__(self, viewer: Viewer, page: Page, editing: Editing, handles: Handles) -> None:
        """Build it in the container at hand."""
        self._viewer, self._editing, self._handles = viewer, editing, handles
        self.html = viewer.server.gui.add_html("")
        self.hidden: set[str] = set()
        self._folded: set[str] = set()  # groups whose lines are not shown
        acts = {"eye": self._turn(self.hidden), "lock": self._turn(viewer.document.locked), "delete": self._delete}
        page.on("select thing", self._handler(self._select))
        for what, do in acts.items():
            page.on(f"{what} thing", self._handler(_alone(do)))
        whole = {"select": self._select_group, "fold": self._fold, "rename": self._rename_group}
        for what, do in (acts | whole).items():
            page.on(f"{what} group", self._group_handler(do))

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

    def follow(self, before: Scene) -> None:
        """Keep renamed obstacles hidden, whatever renamed them, and forget those that are gone: a new one may get such
        a name."""
        after = self._viewer.scene.obstacles
        pairs = zip(before.obstacles, after, strict=True) if len(before.obstacles) == len(after) else ()
        now = {old.name: new.name for old, new in pairs if old.name != new.name and replace(old, name=new.name) == new}
        hidden = {now.get(name, name) for name in self.hidden} & {each.name for each in after}
        self.hidden.clear()
        self.hidden |= hidden

    def update(self) -> None:
        """Write the lines, and hide what is hidden."""
        viewer = self._viewer
        for node in viewer.stage.obstacles:
            node.frame.visible = node.obstacle.name not in self.hidden
        lines: dict[str, list[str]] = {}  # by group; what is in none has a place of its own
        for thing in things(viewer.edited):
            group = groups.group_of(thing.name) if thing.kind == "obstacle" else ""
            mine = lines.setdefault(group or f"/{thing}", [self._group_line(group)] if group else [])
            if group not in self._folded:
                mine.append(self._line(thing, group))
        content = f'<div class="hd">{"".join(itertools.chain(*lines.values()))}</div>'
        self.html.content = content

    def _group_line(self, group: str) -> str:
        every = groups.members(self._viewer.edited, group)
        hidden, locked = self.hidden.issuperset(every), self._viewer.document.locked.issuperset(every)
        named, folded = {"name": group}, group in self._folded
        links = (
            link("▸" if folded else "▾", "fold group", "show or hide its obstacles in the list", **named)
            + link("✎", "rename group", "rename", ask="name of this group", answer=group, **named)
            + link("show" if hidden else "hide", "eye group", "in the picture only", **named)
            + link("unlock" if locked else "lock", "lock group", "protection from changes", **named)
            + link("✕", "delete group", "delete the whole group", **named)
        )
        text = f"<b>{html.escape(group)}</b> ({len(every)})"
        return _row(text, links, telling("select group", **named), set(every) <= set(self._handles.obstacles))

    def _line(self, thing: Thing, group: str) -> str:
        handles = self._handles
        selected = thing == handles.selected or (thing.kind == "obstacle" and thing.name in handles.obstacles)
        named = {"kind": thing.kind, "name": thing.name}
        text, links = html.escape(thing.name or f"the {thing.kind}"), ""
        if thing.kind == "obstacle":
            hidden, locked = thing.name in self.hidden, thing.name in self._viewer.document.locked
            bare = thing.name.rpartition(groups.BETWEEN)[2]
            text = ("&emsp;" if group else "") + html.escape(bare) + (" <i>hidden, still avoided</i>" if hidden else "")
            also = handles.obstacles and thing.name not in handles.obstacles
            links = (
                (link("+", "select thing", "add to the selection", more=True, **named) if also else "")
                + link("show" if hidden else "hide", "eye thing", "in the picture only", **named)
                + link("unlock" if locked else "lock", "lock thing", "protection from changes", **named)
                + link("✕", "delete thing", "delete", **named)
            )
        elif thing.name:
            text = f"the goal of {text}"
        return _row(text, links, telling("select thing", **named), selected)

    # --- what browsers ask for ------------------------------------------------------------------------------------

    def _handler(self, do: Callable[[Thing, Message], object]) -> Handler:
        """Return a handler that runs `do` on the named thing, if it exists."""

        def job(message: Message) -> None:
            thing = Thing(str(message.get("kind")), str(message.get("name", "")))
            if thing in things(self._viewer.edited):
                do(thing, message)
                self.update()

        return lambda _, message: self._editing.do(lambda: job(message))

    def _group_handler(self, do: Act) -> Handler:
        """Return a handler that runs `do` on the obstacles of the named group, if there are any."""

        def job(message: Message) -> None:
            names = groups.members(self._viewer.edited, str(message.get("name", "")))
            if names:
                do(names, message)
                self.update()

        return lambda _, message: self._editing.do(lambda: job(message))

    def _select(self, thing: Thing, message: Message) -> None:
        (self._handles.select_also if message.get("more") is True else self._handles.select)(thing)

    def _select_group(self, names: Sequence[str], message: Message) -> None:
        before = self._handles.obstacles if message.get("more") is True else ()
        self._handles.select_all(names, [name for name in before if name not in names])

    def _turn(self, names: set[str]) -> Act:
        def turn(every: Sequence[str], message: Message) -> None:
            if names.issuperset(every):
                names.difference_update(every)
            else:
                names.update(every)

        return turn

    def _fold(self, names: Sequence[str], message: Message) -> None:
        self._folded.symmetric_difference_update({str(message.get("name"))})

    def _rename_group(self, names: Sequence[str], message: Message) -> None:
        """Rename a group; an empty name dissolves it."""
        edited, _ = groups.grouped(self._viewer.edited, names, str(message.get("answer", "")))
        self._editing.apply("group", lambda _: edited)

    def _delete(self, names: Sequence[str], message: Message) -> None:
        self._editing.apply("delete", lambda edited: scene_edits.deleted(edited, *names))


def _alone(do: Act) -> Callable[[Thing, Message], object]:
    """Return what does something with a single obstacle, and nothing with start or goal."""
    return lambda thing, message: do((thing.name,), message) if thing.kind == "obstacle" else None


def _row(text: str, links: str, choose: str, selected: bool) -> str:
    """Return a line as HTML, that tells something when it is clicked."""
    return (
        f'<div class="hd-row{" hd-chosen" if selected else ""}" role="button" tabindex="0" data-do="{choose}">'
        f'<span class="hd-line" style="flex:1">{text}</span>{links}</div>'
    )
