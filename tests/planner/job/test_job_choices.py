"""Laws of the search over choices: what is dear comes last, and none takes all of the time."""

from __future__ import annotations

import re
import time
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.job.certain import Certain, StageFailedError
from hdplan.planner.job.choices import Aims, Search
from hdplan.scenes.targets import JointTarget

DOWN, ACROSS = [np.pi, 0.0, 0.0], [np.pi, 0.0, np.pi / 2]
FINGERS = ["panda_leftfinger", "panda_rightfinger"]


def above(place: list[float], turn: list[float]) -> hdplan.PoseTarget:
    return hdplan.PoseTarget("panda_hand_tcp", hdplan.Pose.from_rpy(place, turn))


def test_all_grasps_are_tried_plainly_before_ways_along_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar does not fit into its slot by the nearer grasp, whichever way a redundant arm takes: the other grasp needs
    no search along a curve."""
    sides = [hdplan.Box([0.3, 0.02, 0.08], name=f"side{y}", pose=[0.5, y, 0.06]) for y in (-0.36, -0.24)]
    floor = hdplan.Box([0.6, 1.2, 0.02], name="floor", pose=[0.5, 0.0, 0.01])
    bar = hdplan.Box([0.24, 0.04, 0.04], name="bar", pose=[0.5, 0.3, 0.041])
    job = hdplan.Job([
        hdplan.Move([above([0.5, 0.3, 0.25], turn) for turn in (DOWN, ACROSS)], name="above"),
        hdplan.Line(to=[0.5, 0.3, 0.0645], touch=[["bar", FINGERS]], name="down"),
        hdplan.Grip(object="bar", link="panda_hand", touch=[["bar", FINGERS]], name="take"),
        hdplan.Line(to=[0.5, 0.3, 0.25], touch=[["bar", "floor"]], name="lift"),
        hdplan.Move(above([0.5, -0.3, 0.25], ACROSS), name="carry"),
        hdplan.Line(to=[0.5, -0.3, 0.066], touch=[["bar", "floor"]], name="lower"),
    ])  # fmt: skip
    looked_for: list[object] = []
    monkeypatch.setattr(Certain, "ways_along", lambda *arguments: iter(looked_for.append(arguments) or ()))
    limits = hdplan.Limits(acceleration=4.0)
    scene = hdplan.Scene(robot="panda", obstacles=[floor, bar, *sides], start="default", limits=limits, job=job)
    result = hdplan.plan_job(scene)
    assert result.certified, result.text
    rejected = re.compile(r"above: goal\[\d\]: rejected, as stage 'carry' cannot follow it")
    assert any(map(rejected.match, result.notes))
    assert not looked_for


class Slow(Search):
    """A search over three moves, the first to A or B, on a clock of its own. After A the second takes all the time that
    it gets."""

    def __init__(self, clock: list[float], fails: str) -> None:
        moves = hdplan.Job([hdplan.Move([float(i)]) for i in range(3)])
        scene = hdplan.Scene(robot="panda", start="default", limits=hdplan.Limits(acceleration=1.0), job=moves)
        super().__init__(scene, 0, 100.0, lambda event: None, lambda: False)
        self.clock, self.fails = clock, fails

    def _goals(self, world: Any, number: int) -> Aims:
        return Aims(JointTarget(name, (float(i),)) for i, name in enumerate("AB" if number != 2 else "C"))

    def _look_ahead(self, *arguments: Any) -> None:
        """Refuse nothing."""

    def _moved(self, world: Any, number: int, goal: JointTarget, others: bool) -> Any:
        chosen = goal.field if number == 0 else world.chosen
        self.clock[0] += 1.0 if number != 1 or chosen == "B" else self._until - self.clock[0]
        if number == 2 and chosen in self.fails:
            raise StageFailedError("cannot be done")
        return Done(chosen)


class Done:
    """A piece, and the world after it."""

    def __init__(self, chosen: str) -> None:
        self.chosen, self.after = chosen, self


@pytest.mark.parametrize("pressed", [False, True])
def test_an_interrupted_job_says_so_and_keeps_what_is_planned(monkeypatch: pytest.MonkeyPatch, pressed: bool) -> None:
    """The interruption is `stop`, or Ctrl-C, in the second stage."""
    stopped = False
    plainly = Certain.done

    def done(self: Certain, world: Any, number: int, plain: bool = False) -> Any:
        nonlocal stopped
        if number == 1:
            stopped = True
            if pressed:
                raise KeyboardInterrupt
            raise StageFailedError("stopped in the middle")
        return plainly(self, world, number, plain)

    monkeypatch.setattr(Certain, "done", done)
    job = hdplan.Job([hdplan.Wait(0.1), hdplan.Line(by=[0.0, 0.0, -0.02], name="down")])
    scene = hdplan.Scene(robot="panda", start="default", limits=hdplan.Limits(acceleration=4.0), job=job)
    result = hdplan.plan_job(scene, stop=lambda: stopped and not pressed)
    assert result.failure == "interrupted before stage 'down' was planned"
    assert len(result.certificate.stages) == 1
    assert not result.certified


@pytest.mark.parametrize(("fails", "found"), [("", "B"), ("B", "A"), ("AB", "A")])
def test_no_choice_takes_all_of_the_time(monkeypatch: pytest.MonkeyPatch, fails: str, found: str) -> None:
    """The good one gets its turn; where it fails, the postponed ones continue."""
    clock = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    search = Slow(clock, fails)
    search.run(Done(""))
    pieces: list[Any] = search.best
    assert (len(pieces) == 3) == (fails != "AB")
    assert pieces[-1].chosen == found
    assert clock[0] < 100.0 or fails == "AB"
    assert search.refused == ([(2, "", "cannot be done")] if fails else [])


def test_without_a_grasp_that_works_each_says_why() -> None:
    """Two grasps lead to a line out of reach; the third one is inside the floor."""
    floor = hdplan.Box([0.6, 1.2, 0.2], name="floor", pose=[0.5, 0.0, -0.1])
    poses = [above([0.5, 0.2, 0.3], DOWN), above([0.5, 0.2, 0.3], ACROSS), above([0.5, 0.2, -0.1], DOWN)]
    job = hdplan.Job([hdplan.Move(poses, name="above"), hdplan.Line(by=[0.0, 0.0, 2.0], name="up")])
    limits = hdplan.Limits(acceleration=4.0)
    scene = hdplan.Scene(robot="panda", start="default", obstacles=[floor], limits=limits, job=job)
    with pytest.raises(hdplan.UnsolvableError, match=r"job\[0\] \(above\): .*goal\[2\]: not reached") as refused:
        hdplan.plan_job(scene, time_limit=120.0)
    assert "goal[0], goal[1]: rejected, as stage 'up' cannot follow it" in str(refused.value)
