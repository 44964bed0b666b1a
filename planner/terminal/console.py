"""The terminal: results go to standard output; errors (one line each) and progress go to standard error."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import IO, TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from hdplan.planner.terminal.interrupts import noting
from hdplan.scenes.errors import InputError, one_line
from hdplan.scenes.progress import listening

if TYPE_CHECKING:
    from rich.status import Status

    from hdplan.planner.search.search import Event
    from hdplan.scenes.planner_settings import PlannerSettings

LINE_INTERVAL = 10.0  # [s] between lines of a long run
LONG_WAIT = 1.0  # [s] after which a command says what it is doing


def say(text: str, style: str) -> None:
    """Print one line to standard error, with any names and values."""
    line = one_line(f"hdplan: {text}".replace("\n", " "))
    PlainConsole(sys.stderr).print(Text(line, style=style), soft_wrap=True)


class Steps:
    """The steps of a command, shown on the terminal; this base class shows nothing."""

    def begin(self, step: str) -> None:
        """Begin the next step."""

    def detail(self, text: str) -> None:
        """Report the progress of the current step."""

    def at(self, doing: str) -> None:
        """Name what the current step is at, one of many short things."""


class _OneLine(Steps):
    """On a terminal: one line, updated in place."""

    def __init__(self, status: Status) -> None:
        self.status = status

    def begin(self, step: str) -> None:
        self.status.update(Text(step))

    def detail(self, text: str) -> None:
        self.status.update(Text(text))

    def at(self, doing: str) -> None:
        self.detail(doing)


class _Lines(Steps):
    """Off a terminal: a line for each step as it begins, once the command has run for LONG_WAIT; a quick one is
    silent."""

    def __init__(self, step: str) -> None:
        self._step, self._long, self._lock = step, False, threading.Lock()
        self._last_line = -math.inf  # when the last line was printed: time.monotonic()
        self._timer = threading.Timer(LONG_WAIT, self._begin_to_say)
        self._timer.daemon = True
        self._timer.start()

    def begin(self, step: str) -> None:
        with self._lock:
            self._step = step
            self._say()

    def at(self, doing: str) -> None:
        with self._lock:
            if time.monotonic() - self._last_line >= LONG_WAIT:  # a line for each would be too many
                self._step = doing
                self._say()

    def close(self) -> None:
        """Print no further lines."""
        with self._lock:
            self._timer.cancel()

    def _begin_to_say(self) -> None:
        with self._lock:
            if not self._timer.finished.is_set():  # not closed in the meantime
                self._long = True
                self._say()

    def _say(self) -> None:
        if self._long:
            self._last_line = time.monotonic()
            with contextlib.suppress(OSError):  # the stream is closed
                say(f"{self._step} ...", "dim")


@contextlib.contextmanager
def waiting(step: str, shown: bool = True) -> Iterator[Steps]:
    """Show what takes time, beginning with `step`; yields the object that takes the further steps."""
    if not shown:
        yield Steps()
    elif sys.stderr.isatty():
        with PlainConsole(sys.stderr).status(Text(step)) as status:
            line = _OneLine(status)
            with listening(line.at):
                yield line
    else:
        with contextlib.closing(_Lines(step)) as lines, listening(lines.at):
            yield lines


@contextlib.contextmanager
def progress(settings: PlannerSettings, shown: bool) -> Iterator[Any]:
    """Show the solver's progress; yields the function that takes its events, and one that tells whether to stop.

    From the first event on, Ctrl-C is noted and ends the search with the best motion so far.
    """
    verdict, searching = "", False
    margin = settings.clearance + settings.activation
    building = "building the problem (the first time with a robot takes some seconds)"
    with waiting(building, shown) as steps, noting() as note:

        def report(event: Event) -> None:
            nonlocal verdict, searching
            note()
            if not searching:
                steps.begin("searching for a motion")
                searching = True
            if event.certificate is not None:
                verdict = f" · last {event.certificate.status.value.replace('_', ' ')}"
            if event.step is not None:
                step = event.step
                clearance = f"{'≈' if step.depth else '>'} {(margin - step.depth) * 1e3:.1f} mm"
                steps.detail(
                    f"attempt {event.attempt} · iteration {step.iteration} · cost {step.cost:.4g} · "
                    f"clearance {clearance}{verdict}"
                )

        yield report, note.pressed


@contextlib.contextmanager
def measuring() -> Iterator[Any]:
    """Show how far a measurement has come: a bar on a terminal, else a line for each tenth of it. Yields the function
    that takes the steps, and one that tells whether to stop. Ctrl-C is noted as in `progress`."""
    with noting() as note, _bar() if sys.stderr.isatty() else _tenths() as show:

        def report(done: int, of: int, what: str) -> None:
            note()
            show(done, of, what)

        yield report, note.pressed


@contextlib.contextmanager
def counting(word: str, enough: int = 10) -> Iterator[Any]:
    """Show how many of many are done: a bar on a terminal, with the rate and the last failure; else a line every
    LINE_INTERVAL seconds. The remaining time is shown once `enough` are done for it to mean something. Yields the
    function that takes the number done, of all, whether the last one is good, and what it says; and one that tells
    whether to stop. Ctrl-C is noted as in `progress`."""
    good, before, began = 0, -1, 0.0

    with noting() as note, _counts() if sys.stderr.isatty() else _lines_between() as show:

        def report(done: int, of: int, well: bool, words: str) -> None:
            nonlocal good, before, began
            note()
            if before < 0:
                before, began = done - 1, time.monotonic()  # those of the continued earlier run
            good += well
            found = done - before
            text = f"{good} {word}, {found - good} not" + f", {before} done before" * (before > 0)
            if found >= max(enough, 2):
                rate = (found - 1) / max(time.monotonic() - began, 1e-9)  # the first one waits for the workers, too
                text += f", {rate:.3g} a second" + f", about {_duration((of - done) / rate)} left" * (done < of)
            show(done, of, text, words)

        yield report, note.pressed


def _duration(seconds: float) -> str:
    """Return a duration in words, rounded as an estimate is."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


@contextlib.contextmanager
def _counts() -> Iterator[Callable[[int, int, str, str], None]]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}", markup=False))
    last = ""
    with Progress(*columns, console=PlainConsole(sys.stderr), transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def show(done: int, of: int, text: str, words: str) -> None:
            nonlocal last
            last = words or last
            bar.update(task, completed=done, total=of, description=one_line(f"{text}  {last}"))

        yield show


@contextlib.contextmanager
def _lines_between() -> Iterator[Callable[[int, int, str, str], None]]:
    last = time.monotonic()

    def show(done: int, of: int, text: str, words: str) -> None:
        nonlocal last
        if time.monotonic() - last >= LINE_INTERVAL:
            last = time.monotonic()
            say(f"{done} of {of}: {text}", "dim")

    yield show


@contextlib.contextmanager
def _bar() -> Iterator[Callable[[int, int, str], None]]:
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (BarColumn(), TaskProgressColumn(), TimeRemainingColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=PlainConsole(sys.stderr), transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda done, of, what: bar.update(task, completed=done, total=of, description=what)


@contextlib.contextmanager
def _tenths() -> Iterator[Callable[[int, int, str], None]]:
    reached = -1
    with contextlib.closing(_Lines("measuring")) as lines:

        def show(done: int, of: int, what: str) -> None:
            nonlocal reached
            if done < of and (tenth := 10 * done // of) > reached:
                reached = tenth
                lines.begin(f"measuring, {done / of:.0%} done, next {what}")

        yield show


@contextlib.contextmanager
def printing() -> Iterator[Any]:
    """Yield a function that prints. A reader that closes early, as `| head` does, is no error; a full disk is."""
    console = PlainConsole(sys.stdout)
    try:
        yield lambda text: console.print(text, soft_wrap=True)
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is still buffered must not fail again
        if not isinstance(error, BrokenPipeError):
            raise InputError(f"the output cannot be written ({error.strerror})") from None


class PlainConsole(Console):
    """Prints text as it is, without markup or highlighting."""

    def __init__(self, stream: IO[str]) -> None:
        """Print to a stream."""
        super().__init__(file=stream, highlight=False, markup=False, emoji=False)

    def on_broken_pipe(self) -> None:
        """Re-raise the error being handled, for the caller; Rich would end with exit code 1."""
        raise
