"""Laws of the last touches: a path is never worse for them, and never less proven."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from hdplan import Box, HdplanError, Limits, Obstacle, Pose, Scene, certify, plan
from hdplan.planner.search import search as searching, touches
from hdplan.planner.search.search import Search
from hdplan.planner.solvers.methods import chomp
from hdplan.planner.solvers.solution import Solution, SolverStatus
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

SAME = 5e-3  # [–] within which two solvers stop, in one minimum


def plain(scene: Scene) -> Scene:
    """The same, with the first motion that is certified."""
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, polish=0))


QUICKLY = ("panda_cage", "panda_carry", "ur5_table")  # the others in the slow lane


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=() if each in QUICKLY else pytest.mark.slow) for each in shipped_scenes()]
)
def test_no_shipped_scene_is_solved_worse_than_by_the_first_motion_or_chomp(name: str) -> None:
    """Than by CHOMP with its own last touches, too, where both end in the same way around: but for where each stops."""
    scene = load_scene(name)
    touched = plan(scene)
    first, gentle = plan(plain(scene)), plan(plain(scene), solver="chomp")
    assert touched.certified
    assert touched.objective.value <= min(first.objective.value, gentle.objective.value)
    assert touched.objective.value <= (1.0 + SAME) * plan(scene, solver="chomp").objective.value
    assert certify(scene, touched.trajectory).certified


@pytest.mark.parametrize("seed", range(3))
def test_among_random_boxes_too(seed: int) -> None:
    rng, scene = np.random.default_rng(seed), load_scene("empty")
    boxes = [
        Obstacle(f"box{i}", Box(rng.uniform(0.05, 0.15, 3)), Pose(rng.uniform([0.3, -0.5, 0.1], [0.7, 0.5, 0.9])))
        for i in range(3)
    ]
    for box in boxes:  # those that touch an end are left out
        tried = dataclasses.replace(scene, obstacles=(*scene.obstacles, box))
        if _ends_free(tried):
            scene = tried
    touched, first = plan(scene, seed=seed), plan(plain(scene), seed=seed)
    assert touched.certified
    assert touched.certified >= first.certified
    assert touched.objective.value <= first.objective.value + 1e-12


def _ends_free(scene: Scene) -> bool:
    try:
        return plan(plain(scene), time_limit=5.0).certified
    except HdplanError:
        return False


def test_the_first_motion_is_taken_where_the_better_one_is_not_proven(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene("panda_cage")

    def through_bars(search: Search, solution: Solution) -> list[Solution]:
        line = search.problem.polyline(search.problem.start[None] + 1.0)
        return [dataclasses.replace(solution, trajectory=dataclasses.replace(solution.trajectory, positions=line))]

    monkeypatch.setattr(searching, "touched", through_bars)
    monkeypatch.setattr("hdplan.planner.plan.polish", lambda *_: None)
    result, first = plan(scene), plan(plain(scene))
    assert result.certified
    assert result.trajectory.positions.tobytes() == first.trajectory.positions.tobytes()


def test_a_straight_motion_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("nothing is left to gain")

    monkeypatch.setattr(touches, "closer", never)
    result = plan(load_scene("empty"))
    assert result.certified
    assert result.trajectory.positions.tobytes() == plan(plain(load_scene("empty"))).trajectory.positions.tobytes()


def test_the_straight_line_has_one_second_opinion(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, steps = [], chomp.solve

    def counted(*given: Any) -> Solution:
        calls.append(given)
        return steps(*given)

    monkeypatch.setattr(chomp, "solve", counted)
    assert plan(load_scene("panda_corridor")).certified
    assert len(calls) == 1


def test_an_interrupt_within_them_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = chomp.solve

    def interrupted(*given: Any) -> Solution:
        return dataclasses.replace(steps(*given), status=SolverStatus.INTERRUPTED)

    monkeypatch.setattr(chomp, "solve", interrupted)
    monkeypatch.setattr("hdplan.planner.plan.polish", _never)
    result = plan(load_scene("panda_corridor"))
    assert result.certified
    assert result.attempts == 1


def test_a_warm_start_is_followed_without_further_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths and timed motions alike; the result is proven and costs as much."""
    for limits in (Limits(), Limits(velocity="urdf", acceleration=15.0, jerk=500.0)):
        scene = dataclasses.replace(load_scene("panda_bookshelf"), limits=limits)
        last = plan(scene)
        with monkeypatch.context() as patched:
            patched.setattr("hdplan.planner.plan.polish", _never)
            again = plan(scene, guess=last.trajectory)
        assert again.certified
        assert again.attempts == 1
        assert again.objective.value == pytest.approx(last.objective.value, rel=searching.LITTLE_CHANGE)
        assert certify(scene, again.trajectory).certified


def test_a_crude_guess_is_bettered_as_any_first_motion() -> None:
    scene = load_scene("panda_carry")
    corners = plan(scene).trajectory.positions[[0, 8, 16, 24, 31]]
    bent = corners + np.array([0.0, 0.2, -0.2, 0.2, 0.0])[:, None]
    warm, first = plan(scene, guess=bent), plan(plain(scene), guess=bent)
    assert warm.certified
    assert warm.objective.value <= first.objective.value


def test_a_warm_start_is_not_trusted() -> None:
    """A last motion through what stands there now is left."""
    scene = load_scene("panda_carry")
    last = plan(dataclasses.replace(scene, obstacles=()))
    again = plan(scene, guess=last.trajectory)
    assert again.certified
    assert certify(scene, again.trajectory).certified


def _never(*_: object) -> None:
    raise AssertionError("a warm start that holds is not bettered in rounds")
