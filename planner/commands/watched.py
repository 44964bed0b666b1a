"""Plans that browsers see while they are made, of one motion or a job: `hdplan plan --view`."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeVar

from hdplan.planner.terminal.console import say, waiting
from hdplan.planner.terminal.interrupts import until_ctrl_c

if TYPE_CHECKING:
    from hdplan.planner.search.search import Event
    from hdplan.planner.view.gate import Served

Result = TypeVar("Result")
Report = Callable[["Event"], None]
Stop = Callable[[], bool]


Viewer = TypeVar("Viewer", bound="Served")


@contextlib.contextmanager
def serving(wanted: bool) -> Iterator[contextlib.ExitStack | None]:
    """Yield what browsers are served in, until Ctrl-C once the block has ended; None if it is not wanted."""
    if not wanted:
        yield None
        return
    with contextlib.ExitStack() as served:
        yield served
        sys.stdout.flush()
        with until_ctrl_c():
            threading.Event().wait()


def opened(name: str, make: Callable[[], Viewer], served: contextlib.ExitStack) -> Viewer:
    """Return the viewer that is made, for as long as it is served, and say where a scene of this name is seen."""
    with waiting("loading the robot's meshes"):
        viewer = served.enter_context(contextlib.closing(make()))
    say(f"{name} at {viewer.address()}, until Ctrl-C", "bold")
    return viewer


def alone(run: Callable[[Report, Stop], Result]) -> Result:
    """Return a plan without a browser."""
    return run(lambda event: None, lambda: False)


def also_seen(make: Callable[[Report, Stop], Result], report: Report, stop: Stop) -> Callable[[Report, Stop], Result]:
    """Return a maker of plans that tells the terminal's `report`, too, and that the terminal's `stop` ends, too."""

    def run(seen: Report, stopped: Stop) -> Result:
        def both(event: Event) -> None:
            report(event)
            seen(event)

        return make(both, lambda: stop() or stopped())

    return run
