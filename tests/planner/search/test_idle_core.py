"""Laws of work ahead on an idle core: items and order are those of the iterator, and a search finds the same motion."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

import hdplan
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.outcome import Options, solve
from hdplan.planner.search import guesses as trying, idle_core
from hdplan.planner.search.guesses import Guess
from hdplan.planner.search.idle_core import IdleCore, one_core

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from narrow_places import places


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(idle_core, "usable_cores", lambda: 2)


def never() -> bool:
    return False


def ours() -> list[str]:
    return [each.name for each in threading.enumerate() if each.name.startswith("hdplan ahead")]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("alone", [False, True])
def test_items_come_in_order_whichever_is_ready_first(seed: int, alone: bool) -> None:
    rng = np.random.default_rng(seed)

    def items(over: Callable[[], bool]) -> Iterator[int | None]:
        for item in range(20):
            time.sleep(float(rng.uniform(0.0, 2e-3)))
            yield None if item % 3 == 1 else item

    pauses = np.random.default_rng((seed, 1)).uniform(0.0, 2e-3, 23)
    found = []
    with one_core() if alone else contextlib.nullcontext(), IdleCore(math.inf) as core:
        made = core.ahead(items, never)
        for turn, pause in enumerate(pauses):
            if turn == 2:
                made.begin()
            time.sleep(float(pause))
            found.append(made.take())
            assert bool(ours()) == (not alone)
    assert found == [None if item % 3 == 1 or item > 19 else item for item in range(23)]
    assert not ours()


def test_many_goals_share_one_thread_and_none_waits_for_another() -> None:
    """The goal whose turn it is makes its item itself where the thread works for another one."""
    free = threading.Event()

    def slow(over: Callable[[], bool]) -> Iterator[str]:
        while not over() and not free.is_set():
            time.sleep(1e-3)
        yield "slow"

    with IdleCore(math.inf) as core:
        first, second = core.ahead(slow, never), core.ahead(lambda over: iter(["quick"]), never)
        first.begin()
        second.begin()
        assert second.take() == "quick"
        free.set()
        assert first.take() == "slow"


def test_work_that_nobody_needs_ends_with_its_search_and_what_goes_wrong_is_raised() -> None:
    def endless(over: Callable[[], bool]) -> Iterator[int]:
        while not over():
            time.sleep(1e-3)
        yield 0

    def wrong(over: Callable[[], bool]) -> Iterator[int]:
        raise ArithmeticError("no such way")
        yield 0

    def interrupted() -> None:
        with IdleCore(math.inf) as core:
            core.ahead(endless, never).begin()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not ours()
    with IdleCore(math.inf) as core:
        made = core.ahead(endless, lambda: True)  # the search is over, while its thread waits
        made.begin()
        assert made.take() == 0
        wrongly = core.ahead(wrong, never)
        wrongly.begin()
        with pytest.raises(ArithmeticError, match="no such way"):
            wrongly.take()
    with IdleCore(time.perf_counter()) as core:  # past its deadline
        late = core.ahead(endless, never)
        late.begin()
        assert late.take() == 0


def test_a_search_finds_the_same_motion_with_and_without_an_idle_core(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a scene whose way trees of free lines find, as they have their turn early; and a batch leaves the other cores
    to its other problems."""
    monkeypatch.setattr(trying, "TREES_AFTER_LOOSE", 2)
    monkeypatch.setattr(trying, "AHEAD_AFTER", 1)
    begun = []
    real = idle_core.Ahead.begin

    def begin(made: idle_core.Ahead[Guess]) -> None:
        begun.append(made._pool)
        real(made)

    monkeypatch.setattr(idle_core.Ahead, "begin", begin)
    file = tmp_path / "two_doors.yaml"
    file.write_text(yaml.safe_dump(places()["two_doors"]))
    scene = hdplan.load_scene(file)
    with_it = hdplan.plan(scene)
    assert with_it.certified
    assert with_it.attempts > trying.TREES_AFTER_LOOSE
    assert any(pool is not None for pool in begun)
    begun.clear()
    with one_core():
        without = hdplan.plan(scene)
    assert begun
    assert all(pool is None for pool in begun)
    assert (with_it.attempts, with_it.iterations) == (without.attempts, without.iterations)
    np.testing.assert_array_equal(with_it.trajectory.positions, without.trajectory.positions)
    begun.clear()
    assert solve(Job("doors", "narrow", scene), Options()).certified
    assert all(pool is None for pool in begun)
