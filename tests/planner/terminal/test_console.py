"""Messages of long steps: on a terminal in one line that changes, off it in a line for each, at once."""

from __future__ import annotations

import io
import re
import threading
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from hdplan.planner.search.search import Event
from hdplan.planner.solvers.solution import Iteration
from hdplan.planner.terminal import console
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.progress import tell
from tests.waiting import PATIENCE, until

BUILDING = "hdplan: building the problem (the first time with a robot takes some seconds) ..."


@pytest.fixture
def long_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "LONG_WAIT", 0.0)


def lines_with(printed: Callable[[], str], words: str) -> list[str]:
    """The lines that are there as soon as these words are."""
    until(lambda: words in printed(), words)
    return printed().splitlines()


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    stream = io.StringIO()
    monkeypatch.setattr(console, "sys", SimpleNamespace(stderr=stream))  # not the one that pytest takes for itself
    return stream


@pytest.mark.usefixtures("long_at_once")
def test_a_long_step_is_named_while_it_lasts(errors: io.StringIO) -> None:
    with console.waiting("following") as steps:
        assert lines_with(errors.getvalue, "following") == ["hdplan: following ..."]
        steps.detail("half of it")
        steps.begin("drawing")
        assert errors.getvalue().splitlines() == ["hdplan: following ...", "hdplan: drawing ..."]


@pytest.mark.usefixtures("long_at_once")
def test_the_place_of_a_step_is_named(errors: io.StringIO) -> None:
    with console.waiting("building"):
        lines_with(errors.getvalue, "building")
        tell("fitting bodies to arm_link")
        assert errors.getvalue().splitlines() == ["hdplan: building ...", "hdplan: fitting bodies to arm_link ..."]
    tell("nobody listens any more")
    assert len(errors.getvalue().splitlines()) == 2


def test_one_line_a_while_names_what_a_step_is_at(errors: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "LONG_WAIT", 0.01)
    with console.waiting("building"):
        lines_with(errors.getvalue, "building")
        monkeypatch.setattr(console, "LONG_WAIT", threading.TIMEOUT_MAX)
        for link in range(50):
            tell(f"fitting bodies to link {link}")
    assert errors.getvalue().splitlines() == ["hdplan: building ..."]


def test_a_quick_command_says_nothing(errors: io.StringIO) -> None:
    threads = threading.active_count()
    with console.waiting("following") as steps:
        steps.begin("drawing")
    with console.measuring() as (report, _):
        report(0, 3, "first")
    until(lambda: threading.active_count() <= threads, "the threads end")
    assert errors.getvalue() == ""


@pytest.mark.usefixtures("long_at_once")
def test_nothing_is_reported_where_nothing_is_to_be_shown(errors: io.StringIO) -> None:
    threads = threading.active_count()
    with console.waiting("following", shown=False) as steps:
        steps.begin("drawing")
        steps.detail("half of it")
    with console.progress(PlannerSettings(), shown=False) as (report, _):
        report(Event(1))
    until(lambda: threading.active_count() <= threads, "the threads end")
    assert errors.getvalue() == ""


@pytest.mark.usefixtures("long_at_once")
def test_a_search_says_that_it_builds_and_that_it_searches(errors: io.StringIO) -> None:
    with console.progress(PlannerSettings(), shown=True) as (report, stop):
        lines_with(errors.getvalue, "building")
        for k in range(3):
            report(Event(1, step=Iteration(k, 1.0, 0.0, 0.0, 0.0)))
        assert not stop()
    assert errors.getvalue().splitlines() == [BUILDING, "hdplan: searching for a motion ..."]


@pytest.mark.usefixtures("long_at_once")
@pytest.mark.parametrize("of", [1, 7, 10, 500_000])
def test_a_measurement_says_at_most_every_tenth(errors: io.StringIO, of: int) -> None:
    with console.measuring() as (report, _):
        lines_with(errors.getvalue, "measuring")
        for done in range(0, of + 1, max(of // 1000, 1)):
            report(done, of, f"case {done}")
    first, *lines = errors.getvalue().splitlines()
    assert first == "hdplan: measuring ..."
    assert len(lines) == min(of, 10)
    assert lines[0] == "hdplan: measuring, 0% done, next case 0 ..."


@pytest.mark.usefixtures("long_at_once")
def test_counts_add_up_and_an_estimate_waits(errors: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a run is resumed; the remaining time appears once it means something."""
    monkeypatch.setattr(console, "LINE_INTERVAL", 0.0)
    total, before, enough = 40, 7, 6
    with console.counting("certified", enough) as (report, _):
        for done in range(before + 1, total + 1):
            report(done, total, done % 3 != 0, "")
    lines = errors.getvalue().splitlines()
    assert len(lines) == total - before
    for line, done in zip(lines, range(before + 1, total + 1), strict=True):
        counted = re.fullmatch(r"hdplan: (\d+) of 40: (\d+) certified, (\d+) not, (\d+) done before(.*)", line)
        assert counted is not None, line
        at, good, bad, earlier = map(int, counted.groups()[:4])
        assert (at, good + bad + earlier, earlier) == (done, done, before)
        assert ("a second" in counted[5]) == (done - before >= enough)
        assert ("left" in counted[5]) == (enough <= done - before and done < total)
    errors.truncate(errors.seek(0))
    with console.counting("certified") as (report, _):
        report(1, 3, False, "")
    assert errors.getvalue() == "hdplan: 1 of 3: 0 certified, 1 not\n"


@pytest.mark.usefixtures("long_at_once")
def test_a_closed_reader_is_not_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = threading.Event()

    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            tried.set()
            raise BrokenPipeError

    monkeypatch.setattr(console, "sys", SimpleNamespace(stderr=Gone()))
    with console.waiting("following") as steps:
        assert tried.wait(PATIENCE)
        steps.begin("drawing")
