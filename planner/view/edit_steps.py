"""Edits from the panel: each is one step that can be undone, or is refused in one line and changes nothing.

The same field edited again at once (a slider dragged) belongs to the same step, as does more of a value that is typed,
however long the hand rests, until another field is entered. A value that is typed is taken digit by digit; where more
of it is refused, what was taken of it goes, too. Motions are checked and planned
live after each edit, and measured when edits pause.
"""

from __future__ import annotations

import html
import itertools
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.things import Thing
from hdplan.planner.view.words import small
from hdplan.scenes.errors import HdplanError, InputError

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

PAUSE = 1.0  # [s] after which an edit of the same field is another step
LINGERS = 1.5  # [s] for which a value that was refused stays in its field
REST = 0.3  # [s] without edits after which motions are measured
DIGITS = 4  # after the point, of numbers in fields

Edit = Callable[[Edited], Edited]


@dataclass(frozen=True)
class Step:
    """The last step, to which more of the same field belongs for a while."""

    field: str = ""
    when: float = 0.0  # [s] its last edit
    edited: Edited | None = None  # what came of it
    typed: tuple[str, ...] = ()  # what the field held then; nothing for what is not typed
    selected: Thing | None = None  # before it: a new name is another thing

    def goes_on(self, field: str, now: Edited, when: float | None, typed: tuple[str, ...]) -> bool:
        """True if an edit that was requested at a moment [s], if it was, belongs to it."""
        if field != self.field or now is not self.edited or when is None:
            return False
        return when < self.when + PAUSE or self.begins(typed)

    def begins(self, typed: tuple[str, ...]) -> bool:
        """True if it took the beginning of what is typed."""
        return len(typed) == len(self.typed) > 0 and all(map(str.startswith, typed, self.typed))


class Editing:
    """The way back and forth, and what was refused."""

    def __init__(self, viewer: Viewer, handles: Handles) -> None:
        """Build it in the container at hand."""
        self._viewer, self._handles = viewer, handles
        gui = viewer.server.gui
        self.buttons = gui.add_button_group(
            "history", ("undo", "redo", "reset"), hint="changes of scene and motions; reset: the original scene"
        )
        self.text = gui.add_html("")
        self.buttons.on_click(lambda event: self.ask(str(event.target.value)))
        self._numbers = itertools.count()
        self._typed: set[str] = set()  # the fields whose new values wait
        self._doing = ""  # the field that is edited at this moment
        self._last = Step()
        self._timers: dict[str, threading.Timer] = {}  # by what is to be done

    def ask(self, way: str) -> None:
        """Request "undo", "redo" or "reset"; each press counts. By any thread."""
        self.do(lambda: self._back(way))

    def do(self, job: Callable[[], object]) -> None:
        """Request something that counts each time; what is refused is reported. By any thread."""
        self._viewer.worker.ask(f"do {next(self._numbers)}", lambda: (self.guarded(job), None)[1])

    def edit(self, field: str, edit: Edit, typed: tuple[str, ...] = ()) -> None:
        """Request an edit of a field, in which that is `typed`; of several values that wait, only the newest counts. By
        any thread."""
        moment = time.monotonic()

        def job() -> None:
            self._typed.discard(field)
            if not self.guarded(lambda: self.apply(field, edit, moment, typed)):
                self._later("values", LINGERS, self._viewer.panel.show_values)

        self._typed.add(field)
        self._viewer.worker.ask(f"edit {field}", job)

    def refuse(self, words: str) -> None:
        """Refuse what is being typed, whose beginning may have been taken. By any thread."""

        def job() -> None:
            if self._last.typed and self._viewer.edited is self._last.edited:
                self._forget()
            raise InputError(words)

        self.do(job)

    def fail(self, error: HdplanError) -> None:
        """Report what went wrong elsewhere. By any thread."""

        def job() -> None:
            raise error

        self.do(job)

    def enter(self) -> None:
        """Let what is edited next be another step, as another field is entered. By any thread."""
        self._viewer.worker.ask("enter", self._end)

    def is_edited(self, field: str) -> bool:
        """True if a field holds what somebody has just typed, which nothing else may replace."""
        return field == self._doing or field in self._typed

    def end(self) -> None:
        """Drop what is still to be done."""
        for timer in self._timers.values():
            timer.cancel()

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def apply(self, field: str, edit: Edit, moment: float | None = None, typed: tuple[str, ...] = ()) -> None:
        """Show what an edit makes of the scene at a `moment` [s]; without one, it is a step of its
        own. Raises InputError, and changes nothing, for what it does not allow; what was taken of the same that is
        `typed` goes, too."""
        viewer, last, handles = self._viewer, self._last, self._handles
        together, selected = last.goes_on(field, viewer.edited, moment, typed), handles.selected
        self._doing = field
        try:
            edited = edit(viewer.edited)
            viewer.document.change(edited, step=not together, check=True)
        except HdplanError:
            handles.selected = selected
            if together and last.begins(typed):
                self._forget()
            raise
        finally:
            self._doing = ""
        self._last = Step(field, time.monotonic(), edited, typed, last.selected if together else selected)
        viewer.panel.live.follow()
        self._later("measure", REST, viewer.document.measure)

    def _end(self) -> None:
        self._last = Step()

    def _forget(self) -> None:
        """Leave the last step as if there had been none."""
        self._handles.selected, self._last = self._last.selected, Step()
        self._viewer.document.forget()

    def _later(self, what: str, seconds: float, job: Callable[[], None]) -> None:
        """Request a job after a pause; another request of its kind restarts the pause."""
        if what in self._timers:
            self._timers[what].cancel()
        timer = self._timers[what] = threading.Timer(seconds, lambda: self._viewer.worker.ask(what, job))
        timer.daemon = True
        timer.start()

    def say(self, text: str) -> None:
        """Say something that was done, or nothing."""
        self.text.content = small(html.escape(text))

    def _back(self, way: str) -> None:
        viewer, history = self._viewer, self._viewer.document.history
        possible = {
            "undo": history.can_undo,
            "redo": history.can_redo,
            "reset": viewer.edited is not viewer.document.first,
        }
        if not possible[way]:
            raise InputError(f"there is nothing to {way}")
        {"undo": viewer.document.undo, "redo": viewer.document.redo, "reset": viewer.document.reset}[way]()
        if way == "reset":
            viewer.panel.live.follow()

    def guarded(self, job: Callable[[], object]) -> bool:
        """Do it, or say in a line why not; whether it was done."""
        source, folder = f"{self._viewer.scene.source}: ", f"{self._viewer.uploads.folder}/"
        self.say("")
        try:
            job()
        except HdplanError as error:
            words = str(error).removeprefix(source).replace(folder, "")
            self.text.content = small(f'<span class="hd-bad">not done: {html.escape(words)}</span>')
            return False
        return True


class Fields:
    """Inputs of the panel that show a value of the scene and edit it."""

    def __init__(self, editing: Editing, turn: Callable[[], int] = lambda: 0) -> None:
        """Start without any. They are about what is selected at a `turn`: what was typed in another one is refused."""
        self._editing, self._turn = editing, turn
        self._fields: list[tuple[Any, str, Callable[[], Any]]] = []

    def add(self, field: str, handle: Any, value: Callable[[], Any], edit: Callable[[Edited, Any], Edited]) -> None:
        """Let an input of viser show a value, and edit the scene when a browser changes it; `field` names it."""
        self._fields.append((handle, field, value))
        handle.value = rounded(value())
        if hasattr(handle, "precision"):
            handle.precision = DIGITS if isinstance(handle.value, float | tuple) else 0

        async def changed(event: Any) -> None:  # at once, before the worker shows what is older
            if event.client is not None:
                found, turn = handle.value, self._turn()

                def exact(edited: Edited) -> Edited:
                    if turn != self._turn():
                        raise InputError(f"{field}: the selection has changed meanwhile")
                    return edit(edited, exactly(found, value()))

                self._editing.edit(field, exact, digits(found))

        handle.on_update(changed)

    def update(self) -> None:
        """Show the values of the scene as it is now, but for those that are being edited. By the worker's thread."""
        for handle, field, value in self._fields:
            if not self._editing.is_edited(field):
                handle.value = rounded(value())

    def clear(self) -> None:
        """Remove them."""
        for handle, _, _ in self._fields:
            handle.remove()
        self._fields.clear()


def rounded(value: Any) -> Any:
    """Return a value as a field shows it: fewer digits of a number, or of several."""
    if isinstance(value, tuple):
        return tuple(map(rounded, value))
    return round(value, DIGITS) if isinstance(value, float) else value


def digits(value: Any) -> tuple[str, ...]:
    """Return each number of a field as it was typed."""
    if isinstance(value, tuple):
        return tuple(text for each in value for text in digits(each))
    return (value if isinstance(value, str) else f"{value:.{DIGITS}f}".rstrip("0").rstrip("."),)


def exactly(found: Any, value: Any) -> Any:
    """Return a field's numbers, with all digits of those of `value` that it still shows."""
    if isinstance(value, tuple):
        return tuple(map(exactly, found, value))
    return value if found == rounded(value) else found


def optional(value: float | None) -> str:
    """Return the text of a field for a number that may be missing."""
    return "" if value is None else f"{value:g}"


def spaced(numbers: Sequence[float]) -> str:
    """Return the text of a field for several numbers."""
    return " ".join(f"{number:.6g}" for number in numbers)


def numbers_in(text: str) -> list[float]:
    """Return the numbers that a field holds, with spaces or commas between them. Raises InputError for any other
    text."""
    return [number_in(word) for word in text.replace(",", " ").split()]


def number_in(text: str, kind: type[float] | type[int] = float) -> Any:
    """Return the number that a field holds, None for an empty one. Raises InputError for any other text."""
    if not text.strip():
        return None
    try:
        return kind(text)
    except ValueError:
        whole = "whole " * (kind is int)
        raise InputError(f"must be a {whole}number, or empty, found {text!r}") from None
