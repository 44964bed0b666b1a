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
        worker.ask("time", lambda k=k: done.append(f"time {k}"))
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


def test_a_job_that_fails_is_reported_and_the_next_one_is_done(worker: Worker, complaints: list[Exception]) -> None:
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


def held(worker: Worker) -> threading.Event:
    """Keep the worker busy until the event that is returned is set."""
    began, gate = threading.Event(), threading.Event()
    worker.ask("held", lambda: (began.set(), gate.wait(5), None)[2])
    assert began.wait(5)
    return gate


def test_urgent_jobs_go_first_and_are_waited_for_alone(worker: Worker) -> None:
    done: list[str] = []
    slow = threading.Event()
    gate = held(worker)
    worker.ask("slow", lambda: (slow.wait(5), done.append("slow"))[1])
    worker.ask("frame", lambda: done.append("frame"), urgent=True)
    gate.set()
    assert worker.done("frame", 5)
    assert done == ["frame"]
    assert not worker.done("slow", 0.05)
    slow.set()
    assert worker.settle(5)
    assert done == ["frame", "slow"]


def test_urgent_jobs_keep_no_others_waiting(worker: Worker) -> None:
    """Not even those that are requested again at once."""
    done: list[str] = []

    def frame() -> None:
        done.append("frame")
        if "last" not in done:
            worker.ask("frame", frame, urgent=True)

    gate = held(worker)
    worker.ask("frame", frame, urgent=True)
    for kind in ("a", "b", "last"):
        worker.ask(kind, lambda kind=kind: done.append(kind))
    gate.set()
    assert worker.settle(5)
    assert done == ["frame", "a", "frame", "b", "frame", "last", "frame"]
