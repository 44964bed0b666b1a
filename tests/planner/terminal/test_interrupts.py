"""Ctrl-C and `kill` end what is being done, soon and in order, wherever Python or a library drops them."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import signal
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from hdplan.planner.solvers.interior_point import _interrupts_noted
from hdplan.planner.terminal.interrupts import INTERRUPTED, TERMINATED, ended_by_signals, noting, until_ctrl_c

SOON = 5.0  # [s]; a wish that stays lost is one that is not heard by then


pytestmark = pytest.mark.usefixtures("ctrl_c_is_heard")


class Last:
    """Sends a signal when it is taken away."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


def in_a_destructor(number: int) -> None:
    Last(number)


def in_a_circle(number: int) -> None:
    last = Last(number)
    last.itself = last  # type: ignore[attr-defined]
    del last
    gc.collect()


def in_a_callback_of_c(number: int) -> None:
    callback = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(
        lambda a, b: signal.raise_signal(number) or 0
    )
    numbers = (ctypes.c_int * 2)(2, 1)
    ctypes.CDLL(None).qsort(numbers, 2, ctypes.sizeof(ctypes.c_int), callback)


def in_silence(number: int) -> None:
    """As a library does that tries one way to read its arguments after another."""
    with contextlib.suppress(BaseException):
        signal.raise_signal(number)


LOSSES = (in_a_destructor, in_a_circle, in_a_callback_of_c, in_silence)
ENDS = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: SystemExit}


def work_on(seconds: float = SOON) -> None:
    """Go on as a long computation does, which nobody asks to stop."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        sum(range(100))


@pytest.mark.parametrize("number", ENDS)
@pytest.mark.parametrize("lose", LOSSES)
def test_a_lost_ctrl_c_is_raised_again_and_nothing_is_printed(
    lose: Callable[[int], None], number: signal.Signals, capfd: pytest.CaptureFixture[str]
) -> None:
    def command() -> None:
        lose(number)
        work_on()

    began = time.monotonic()
    with pytest.raises(ENDS[number]) as caught, ended_by_signals():
        command()
    assert time.monotonic() - began < SOON
    assert number == signal.SIGINT or getattr(caught.value, "code", None) == TERMINATED
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("lose", LOSSES)
def test_a_lost_ctrl_c_is_raised_again(lose: Callable[[int], None]) -> None:
    lost = []

    def swallow() -> None:
        try:
            work_on()
        except KeyboardInterrupt:
            lost.append(None)

    def command() -> None:
        lose(signal.SIGINT)
        for _ in range(3):
            swallow()
        work_on()

    with pytest.raises(KeyboardInterrupt), ended_by_signals():
        command()
    assert len(lost) == 3


@pytest.mark.parametrize("number", ENDS)
def test_cleanup_is_not_interrupted(number: signal.Signals) -> None:
    """However deep it lies, and whatever errors it meets itself."""
    done = []

    @contextlib.contextmanager
    def tidy() -> Iterator[None]:
        try:
            yield
        finally:
            for _ in range(3):
                try:
                    raise ValueError
                except ValueError:
                    work_on(0.15)
            done.append(None)

    with pytest.raises(ENDS[number]), ended_by_signals(), tidy(), tidy():
        signal.raise_signal(number)
    assert len(done) == 2


def test_an_error_that_a_library_makes_of_it_is_ctrl_c() -> None:
    def library() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise RuntimeError("evaluation failed") from None

    with pytest.raises(KeyboardInterrupt), ended_by_signals():
        library()
    with pytest.raises(RuntimeError), ended_by_signals():
        raise RuntimeError  # without a signal


def test_a_wait_for_ctrl_c_ends_with_the_first_one() -> None:
    with ended_by_signals():
        with until_ctrl_c():
            in_a_destructor(signal.SIGINT)
            work_on()
            pytest.fail("the work ran to its end")
        work_on(0.35)


@pytest.mark.core
def test_a_note_ends_nothing_and_the_second_ctrl_c_ends_at_once() -> None:
    with ended_by_signals(), noting() as note:
        note()
        in_a_destructor(signal.SIGINT)
        work_on(0.35)
        assert note.pressed()
        in_a_destructor(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            work_on(SOON)


def test_a_note_taken_during_an_interior_point_run_outlives_it() -> None:
    """Between two runs there is a best motion to save, although the run has put its own handler in place."""
    with ended_by_signals(), noting() as note:
        with _interrupts_noted() as pressed:
            note()  # as the solver's first report does
            signal.raise_signal(signal.SIGINT)
            assert note.pressed()
            assert not pressed.is_set()  # the run ends by its budget, which asks the note
        work_on(0.1)
    with ended_by_signals(), noting() as note:
        with _interrupts_noted():
            note()
        signal.raise_signal(signal.SIGINT)  # before the next report
        assert note.pressed()
    with ended_by_signals():
        with _interrupts_noted() as pressed:
            signal.raise_signal(signal.SIGINT)
            assert pressed.is_set()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_signal_handlers_are_restored() -> None:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [*map(signal.getsignal, numbers), sys.unraisablehook]
    with ended_by_signals():
        pass
    with contextlib.suppress(KeyboardInterrupt), ended_by_signals():
        in_a_destructor(signal.SIGINT)
        time.sleep(SOON)
        pytest.fail("nothing ended the wait")
    assert [*map(signal.getsignal, numbers), sys.unraisablehook] == before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert (INTERRUPTED, TERMINATED) == (128 + signal.SIGINT, 128 + signal.SIGTERM)


def test_ignored_signals_stay_ignored_and_destructors_errors_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    errors: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: errors.append(lost.exc_type))

    class Broken:
        def __del__(self) -> None:
            raise ZeroDivisionError

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with ended_by_signals():
        signal.raise_signal(signal.SIGINT)
        Broken()
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)  # nothing will be raised again
    assert errors == [ZeroDivisionError]
