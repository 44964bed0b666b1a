"""The terminal: results go to the output stream; errors, one line each, and progress go to the error stream."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import IO, TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

from hdplan.planner.terminal.interrupts import noting
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    from hdplan.planner.search.search import Event
    from hdplan.scenes.model import PlannerSettings


def say(text: str, style: str) -> None:
    """Print one line, whatever names and values it repeats."""
    line = "".join(c if c.isprintable() else " " if c == "\n" else repr(c)[1:-1] for c in f"hdplan: {text}")
    PlainConsole(sys.stderr).print(Text(line, style=style), soft_wrap=True)


@contextlib.contextmanager
def waiting(text: str, shown: bool = True) -> Iterator[Any]:
    """Show what takes its time, on a terminal only; gives an object whose `update(text)` changes the line."""
    if not (shown and sys.stderr.isatty()):
        yield None
        return
    with PlainConsole(sys.stderr).status(Text(text)) as status:
        yield status


@contextlib.contextmanager
def progress(settings: PlannerSettings, shown: bool) -> Iterator[Any]:
    """Follow the solver in one line; gives the function that takes the events, and one that says whether to stop.

    From the first step on, Ctrl-C is noted and ends the search with the best motion so far.
    """
    verdict = ""
    margin = settings.clearance + settings.activation
    with waiting("building the problem (the first time with a robot takes minutes)", shown) as line, noting() as note:

        def report(event: Event) -> None:
            nonlocal verdict
            note()
            if event.certificate is not None:
                verdict = f" · last {event.certificate.status.value.replace('_', ' ')}"
            if event.step is not None and line is not None:
                step = event.step
                clearance = f"{'≈' if step.depth else '>'} {(margin - step.depth) * 1e3:.1f} mm"
                line.update(
                    Text(
                        f"attempt {event.attempt} · iteration {step.iteration} · cost {step.cost:.4g} · "
                        f"clearance {clearance}{verdict}"
                    )
                )

        yield report, note.pressed


@contextlib.contextmanager
def measuring() -> Iterator[Any]:
    """Show how far a measurement has come, on a terminal only; gives the function that takes the steps, and one that
    says whether to stop. Ctrl-C is noted as in `progress`."""
    with contextlib.ExitStack() as stack:
        note = stack.enter_context(noting())
        bar = None
        if sys.stderr.isatty():
            columns = (
                BarColumn(),
                TaskProgressColumn(),
                TimeRemainingColumn(),
                TextColumn("{task.description}", markup=False),
            )
            bar = stack.enter_context(Progress(*columns, console=PlainConsole(sys.stderr), transient=True))
            task = bar.add_task("starting", total=None)

        def report(done: int, of: int, what: str) -> None:
            note()
            if bar is not None:
                bar.update(task, completed=done, total=of, description=what)

        yield report, note.pressed


@contextlib.contextmanager
def printing() -> Iterator[Any]:
    """Give a function that prints. A reader who leaves early, as `| head` does, is no failure; a full disk is."""
    console = PlainConsole(sys.stdout)
    try:
        yield lambda text: console.print(text, soft_wrap=True)
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left unwritten must not fail again
        if not isinstance(error, BrokenPipeError):
            raise InputError(f"the output cannot be written ({error.strerror})") from None


class PlainConsole(Console):
    """Prints texts as they are, whatever names they hold."""

    def __init__(self, stream: IO[str]) -> None:
        """Print to a stream."""
        super().__init__(file=stream, highlight=False, markup=False, emoji=False)

    def on_broken_pipe(self) -> None:
        """Leave it to the caller, called while the error is handled; Rich would end with exit code 1."""
        raise
