"""The viewer's one thread: the newest request of a kind counts, and a failure ends nothing."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from hdplan.planner.view.worker import Worker


@pytest.fixture
def complaints() -> list[Exception]:
    return []


@pytest.fixture
def worker(complaints: list[Exception]) -> Iterator[Worker]:
    worker = Worker(complaints.append)
    yield worker
    worker.end()


def test_of_jobs_that_wait_the_newest_of_each_kind_is_done(worker: Worker) -> None:
    done: list[str] = []
    gate = threading.Event()
    worker.ask("gate", lambda: gate.wait(5) and None)
    for k in range(50):
        worker.ask("time", lambda k=k: done.append(f"time {k}"))  # type: ignore[misc]
    worker.ask("layers", lambda: done.append("layers"))
    gate.set()
    assert worker.settle(5)
    assert done == ["time 49", "layers"]


def test_all_jobs_are_done_by_one_thread(worker: Worker) -> None:
    seen: list[int] = []
    for k in range(20):
        worker.ask(str(k), lambda: seen.append(threading.get_ident()))
    assert worker.settle(5)
    assert len(seen) == 20
    assert len(set(seen)) == 1


def test_a_job_that_fails_is_told_and_the_next_one_is_done(worker: Worker, complaints: list[Exception]) -> None:
    done: list[int] = []
    worker.ask("bad", lambda: done.append(1 // 0))
    worker.ask("good", lambda: done.append(1))
    assert worker.settle(5)
    assert done == [1]
    assert [type(error) for error in complaints] == [ZeroDivisionError]


def test_settling_gives_up_in_time(worker: Worker) -> None:
    gate = threading.Event()
    worker.ask("gate", lambda: gate.wait(5) and None)
    assert not worker.settle(0.05)
    gate.set()
    assert worker.settle(5)
