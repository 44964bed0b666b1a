"""Laws of the least time: a profile of that time exists and goes just as far, and none that is found is shorter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hdplan import Limits, Trajectory, load_scene, plan
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.least_time import least_times
from hdplan.planner.timing.retiming import Retimer

NAMES = ("velocity", "acceleration", "jerk")


def reached(time: float, v: float, a: float, j: float) -> float:
    """How far a symmetrical double S of this duration gets within limits of which it uses up at least one at any
    time."""
    a = min(a, np.sqrt(v * j), j * time / 4)  # the jerk alone takes four equal parts
    hold = min(v / a - a / j, time / 2 - 2 * a / j)  # at the acceleration
    top = a * (a / j + hold)
    return float(top * (time - (2 * a / j + hold)))


def test_the_profile_of_that_time_goes_just_as_far() -> None:
    rng = np.random.default_rng(6)
    for v, a, j, way in np.exp(rng.uniform(-4, 4, (2000, 4))).tolist():
        limits = {name: np.array([value]) for name, value in zip(NAMES, (v, a, j), strict=True)}
        (time,) = least_times(np.array([-way]), limits).tolist()
        assert reached(time, v, a, j) == pytest.approx(way, rel=1e-9)


def test_least_times_of_known_cases() -> None:
    way = np.array([2.0, 0.5, 0.0])
    velocity = {"velocity": np.full(3, 2.0)}
    np.testing.assert_allclose(least_times(way, velocity), [1.0, 0.25, 0.0], atol=1e-9)
    both = velocity | {"acceleration": np.full(3, 4.0)}
    np.testing.assert_allclose(least_times(way, both), [1.5, 2 * np.sqrt(0.5 / 4.0), 0.0], atol=1e-9)
    assert least_times(way, {"velocity": np.full(3, np.inf)}).max() < 1e-9


def test_tighter_limits_and_longer_ways_take_no_less() -> None:
    rng = np.random.default_rng(9)
    values = np.exp(rng.uniform(-3, 3, (3, 500)))
    way = rng.normal(size=500)
    before = least_times(way, dict(zip(NAMES, values, strict=True)))
    for row in range(3):
        tighter = values.copy()
        tighter[row] *= 0.9
        assert (least_times(way, dict(zip(NAMES, tighter, strict=True))) >= before * (1 - 1e-12)).all()
    assert (least_times(1.1 * way, dict(zip(NAMES, values, strict=True))) >= before).all()


@pytest.mark.parametrize("limits", [{"acceleration": 5.0}, {"acceleration": 15.0, "jerk": 500.0}])
def test_no_planned_motion_is_shorter(limits: dict[str, float]) -> None:
    scene = replace(load_scene("empty"), limits=Limits(velocity="urdf", **limits))
    result = plan(scene)
    problem_limits = {"velocity": np.array([2.175] * 4 + [2.61] * 3)} | {k: np.full(7, x) for k, x in limits.items()}
    way = result.trajectory.positions[-1] - result.trajectory.positions[0]
    least = least_times(way, problem_limits).max()
    assert least <= result.trajectory.duration <= 1.3 * least + 0.1


@pytest.mark.parametrize("seed", range(4))
def test_no_timing_of_a_path_undercuts_its_fastest_law(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = Limits(velocity="urdf", acceleration=15.0, jerk=500.0)
    retimer = Retimer(Setup.of(replace(load_scene("panda_bookshelf"), limits=limits)))
    robot = retimer.robot
    corners = robot.draw(rng, 3)
    path = np.stack([np.interp(np.linspace(0, 2, 32), [0, 1, 2], column) for column in corners.T], axis=1)
    motion = retimer(Trajectory(robot.joint_names, path, robot.locked)).trajectory
    assert motion.duration is not None
    assert 0.5 * motion.duration < retimer.quickest_along(path) <= motion.duration
