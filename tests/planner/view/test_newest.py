"""The thread that works on the newest wish: outdated work is dropped, and its owner hears of it."""

from __future__ import annotations

import threading

from hdplan.planner.view.newest import Newest
from tests.waiting import until


def test_only_the_first_and_the_newest_are_worked_on() -> None:
    begun, go_on = threading.Event(), threading.Event()
    done: list[int] = []

    def work(wish: int, turn: int) -> None:
        begun.set()
        assert go_on.wait(20)
        done.append(wish)

    newest = Newest("test", work)
    newest.ask(0)
    assert begun.wait(20)
    for wish in range(1, 9):
        newest.ask(wish)
    assert newest.waits
    go_on.set()
    assert newest.settle(20)
    assert done == [0, 8]
    newest.end()
    newest.ask(9)
    assert done == [0, 8]


def test_work_given_up_is_notified_and_later_work_is_not() -> None:
    begun = threading.Event()
    given_up: list[int] = []

    def work(wish: int, turn: int) -> None:
        begun.set()
        if wish == 0:
            until(lambda: newest.given_up(turn), "it is not given up")
            given_up.append(wish)
        else:
            assert not newest.given_up(turn)

    newest = Newest("test", work)
    newest.ask(0)
    assert begun.wait(20)
    newest.ask(1)
    newest.give_up()  # drops the one that waits, too
    assert newest.settle(20)
    newest.ask(2)
    assert newest.settle(20)
    assert given_up == [0]
    newest.end()


def test_the_follow_up_is_called_once_the_work_has_ended() -> None:
    """So that a listener to a result does not find the thread at work on it."""
    ran: list[bool] = []
    newest: Newest[int] = Newest("test", lambda wish, turn: lambda: ran.append(newest.running))
    newest.ask(0)
    until(lambda: ran, "nothing is called")
    assert ran == [False]
    newest.end()
