"""Laws of polishing: what comes out is certified, no worse than the first certified motion, and the same each time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from hdplan import Event, Limits, PlanResult, PoseTarget, Scene, Trajectory, load_scene, plan
from hdplan.planner.problem.smoothness import Smoothness
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.retiming import Retimer, Timed
from hdplan.scenes.errors import HdplanError, InputError

from ..links import pose_of

ROUNDS = 6


def polished(scene: Scene, rounds: int) -> Scene:
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, polish=rounds))


def timed(name: str) -> Scene:
    return dataclasses.replace(load_scene(name), limits=Limits(velocity="urdf", acceleration=15.0, jerk=500.0))


def duration(result: PlanResult) -> float:
    assert result.trajectory.duration is not None
    return result.trajectory.duration


def smoothness(result: PlanResult) -> float:
    cost, _ = Smoothness(len(result.trajectory), 0.01).value(result.trajectory.positions)
    return cost


def test_only_the_improved_first_motion_is_certified_if_time_counts() -> None:
    events: list[Event] = []
    result = plan(polished(timed("panda_cage"), 1), report=events.append)
    first = plan(polished(timed("panda_cage"), 0))
    assert result.certified
    assert duration(result) < duration(first)
    assert sum(event.certificate is not None for event in events) == 1


def test_a_plan_from_the_last_one_ends_where_that_ended_if_it_may() -> None:
    setup = Setup.of(timed("panda_cage"))
    scene = setup.scene.with_goal(PoseTarget("panda_hand", pose_of(setup.robot, "panda_hand", setup.query.goal)))
    last = plan(scene)
    again = plan(scene, guess=last.trajectory)
    assert again.certified
    assert again.attempts == 1
    np.testing.assert_allclose(again.trajectory.positions[-1], last.trajectory.positions[-1], rtol=0, atol=1e-9)
    assert duration(again) <= 1.05 * duration(last)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("scene", "cost"),
    [
        (load_scene("panda_grasp"), smoothness),  # several goals
        (timed("panda_bookshelf"), duration),
        pytest.param(load_scene("panda_conveyor"), smoothness, marks=pytest.mark.slow),  # obstacles that move
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_a_polished_motion_is_certified_and_no_worse(scene: Scene, cost: Callable[[PlanResult], float]) -> None:
    first, better, again = (plan(polished(scene, rounds)) for rounds in (0, ROUNDS, ROUNDS))
    assert first.certified
    assert better.certified
    assert cost(better) <= cost(first)
    assert better.trajectory.positions.tobytes() == again.trajectory.positions.tobytes()


def test_a_motion_around_an_obstacle_gets_closer_and_shorter() -> None:
    first, better = (plan(polished(load_scene("panda_cage"), rounds)) for rounds in (0, ROUNDS))
    assert first.certified
    assert better.certified
    assert smoothness(better) < 0.99 * smoothness(first)
    lengths = [np.linalg.norm(np.diff(r.trajectory.positions, axis=0), axis=1).sum() for r in (first, better)]
    assert lengths[1] < lengths[0]


def test_the_required_clearance_is_kept() -> None:
    """Closer, but never closer than the scene allows."""
    scene = load_scene("panda_cage")
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, clearance=0.005, polish=ROUNDS))
    result = plan(scene)
    assert result.certified
    assert result.certificate.clearance is not None
    assert result.certificate.clearance >= 0.005


def test_stopped_within_it_the_best_so_far_is_returned() -> None:
    certified: list[bool] = []
    scene = polished(load_scene("panda_cage"), 1000)

    def stop() -> bool:
        return sum(certified) >= 2

    def report(event: object) -> None:
        certificate = getattr(event, "certificate", None)
        certified.append(certificate is not None and certificate.certified)

    result = plan(scene, report=report, stop=stop)
    assert result.certified
    assert sum(certified) == 2


@pytest.mark.parametrize("error", [HdplanError("no time law"), InputError("too many rows")])
@pytest.mark.parametrize("scene", [timed("panda_cage"), timed("panda_grasp")], ids=["one goal", "several"])
def test_a_motion_without_a_time_law_does_not_cost_the_certified_one(
    scene: Scene, error: HdplanError, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once a motion is certified, whatever cannot be timed is no better; before, it is refused in its own words."""
    certified: list[object] = []

    def report(event: Event) -> None:
        certified.extend([event.certificate] if event.certificate and event.certificate.certified else [])

    def only_before(retimer: Retimer, path: Trajectory, than: float = math.inf) -> Iterator[Timed]:
        if certified:
            raise error
        yield from timer(retimer, path, than)

    timer = Retimer.ways
    monkeypatch.setattr(Retimer, "ways", only_before)
    result = plan(scene, report=report)
    assert result.certified
    assert result.certificate == certified[0]
    with pytest.raises(type(error), match=str(error)):
        plan(scene)


def test_rounds_are_not_attempts() -> None:
    first, better = (plan(polished(timed("panda_cage"), rounds)) for rounds in (0, 3))
    assert better.attempts == first.attempts
    assert better.iterations > first.iterations


def test_nothing_is_tried_where_nothing_is_left_to_gain() -> None:
    """A straight line in free space is as quick as it gets."""
    certified: list[object] = []
    scene = dataclasses.replace(timed("panda_cage"), obstacles=())
    plan(
        polished(scene, ROUNDS), report=lambda event: certified.append(event.certificate) if event.certificate else None
    )
    assert len(certified) == 1
