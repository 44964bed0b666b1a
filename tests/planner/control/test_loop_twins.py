"""The controller's loops of C against their twins in NumPy: braking to the last bit, the rest to rounding; with twins
instead of all loops, the controller commands the same."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdplan import Box, Capsule, Ellipsoid, Obstacle, Pose, Robot, RobotSpec, Scene, SteadyMotion
from hdplan.control import BarrierSettings, Controller, ControlSettings, standing
from hdplan.planner.control import barrier_safety, braking, lows, moment
from hdplan.planner.control.barrier_safety import straightened
from hdplan.planner.control.braking import Command, Rates
from hdplan.planner.control.lows import Floors, Lows, lows_among, lows_near, lows_of_hulls
from hdplan.planner.control.moment import NO_ROWS
from hdplan.scenes.array_types import Array
from tests.loops import in_numpy, needs_loops

from ..linkage import linkage_urdf
from .rooms import scene_of

pytestmark = needs_loops
EUCLIDEAN = ControlSettings(BarrierSettings("euclidean", growth=0.0, self_growth=0.0), 0.01, 0.005)


@contextmanager
def twins() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        in_numpy(patch, barrier_safety, braking, lows, moment)
        patch.setattr(lows, "_looped", lambda _: False)
        yield


def crowded() -> Scene:
    """A Panda among boxes that it often touches, one of which moves."""
    rng = np.random.default_rng(4)
    obstacles = [
        Obstacle(f"box{k}", Box(rng.uniform(0.05, 0.4, 3)), Pose(rng.uniform((-0.7, -0.7, 0.0), (0.7, 0.7, 1.0))))
        for k in range(6)
    ]
    motion = SteadyMotion((0.1, 0.2, 0.0), (0.0, 0.0, 1.0))
    obstacles.append(Obstacle("bar", Capsule(0.05, 0.3), Pose((0.4, 0.0, 0.5)), motion=motion))
    return scene_of(*obstacles)


def test_braking() -> None:
    rng = np.random.default_rng(3)
    for n in (1, 2, 7):
        for _ in range(12):
            acceleration = 10.0 ** rng.uniform(0.5, 3.0, n)
            rates = Rates(rng.uniform(0.1, 3.0, n), acceleration, acceleration * rng.uniform(2.0, 900.0, n), 0.004)
            last = Command(
                rates.velocity * rng.choice([0.0, 1e-9, 0.5, -1.2], n),
                rates.acceleration * rng.choice([0.0, 1e-9, 0.7, -1.1], n),
            )
            sides = rates.window(last)
            given = np.stack(sides), (np.stack(sides) - last.velocity) / rates.period
            found = rates.braked(last.velocity, last.acceleration), rates.braked(*given)
            with twins():
                np.testing.assert_array_equal(sides, rates.window(last))
                np.testing.assert_array_equal(found[0], rates.braked(last.velocity, last.acceleration))
                np.testing.assert_array_equal(found[1], rates.braked(*given))


@pytest.mark.parametrize("gamma", [1, 2, 9])
def test_straightened(gamma: int) -> None:
    rng = np.random.default_rng(gamma)
    distance = np.append(rng.normal(size=150) * 10.0 ** rng.uniform(-14, 2, 150), [0.0, -0.0, 5e-324, -1e-310])
    found = straightened(distance, gamma, 1e-3), straightened(-2e-4, gamma, 1e-3)
    with twins():
        np.testing.assert_allclose(found[0], straightened(distance, gamma, 1e-3), rtol=1e-12, atol=1e-300)
        np.testing.assert_allclose(found[1], straightened(-2e-4, gamma, 1e-3), rtol=1e-12, atol=1e-300)


def same(found: Lows, twin: Lows) -> None:
    """Check equal lows in any order; samples may differ where a pair is equally low."""
    one, other = np.argsort(found.pair), np.argsort(twin.pair)
    np.testing.assert_array_equal(found.pair[one], twin.pair[other])
    np.testing.assert_allclose(found.over[one], twin.over[other], rtol=0, atol=1e-9)
    agree = found.sample[one] == twin.sample[other]
    assert (~agree).sum() <= 0.1 * len(agree)
    left, right = found.gradient[one][agree], twin.gradient[other][agree]
    np.testing.assert_allclose(left, right, rtol=1e-4, atol=1e-4)


def every_low(controller: Controller, path: Array, floors: Floors) -> tuple[Lows, ...]:
    """The lows near their floors, of pairs inside their margins, and of hulls."""
    sight, some, inside = controller.sight, np.array([0, 3, 4, 19]), floors.inside
    at = controller.barriers.at(path, np.linspace(0.0, 1.0, len(path)))
    among = floors._replace(next=np.zeros_like(floors.next), lower=0.01)
    hulls = floors._replace(values=np.full_like(floors.values, 0.01), lower=0.0)
    return (
        lows_near(at, sight.needed, sight.shaping, floors),
        lows_among(at, some, inside, sight.shaping, among),
        lows_of_hulls(at, some, inside, hulls),
    )


@pytest.mark.parametrize("settings", [ControlSettings(), EUCLIDEAN], ids=["hdsdf", "euclidean"])
def test_lows(settings: ControlSettings, robot: Robot) -> None:
    """Random paths, with floors that many pairs fall below, of obstacles that stand and that move, and of links."""
    controller, rng = Controller.of(crowded(), settings, robot), np.random.default_rng(7)
    sight, barriers, low = controller.sight, controller.barriers, 0
    for _ in range(8):
        steps = rng.normal(size=(20, robot.n)) * 0.01
        path = np.clip(robot.draw(rng, 1) + steps.cumsum(axis=0), robot.lower, robot.upper)
        inside = np.flatnonzero(barriers.evaluate(path[0]).value < sight.margins)
        floors = Floors(sight.margins + rng.normal(size=barriers.count) * 1e-3, sight.next, inside, -1e-12)
        found = every_low(controller, path, floors)
        with twins():
            for one, twin in zip(found, every_low(controller, path, floors), strict=True):
                same(one, twin)
        low += sum(len(each.pair) for each in found)
    assert low > 20


@pytest.mark.parametrize("settings", [ControlSettings(), EUCLIDEAN], ids=["hdsdf", "euclidean"])
def test_commands(settings: ControlSettings, robot: Robot) -> None:
    """Random starts, many of them inside margins, with the last command of the loops."""
    controller, rng = Controller.of(crowded(), settings, robot), np.random.default_rng(8)
    modes = set()
    for q in robot.draw(rng, 4):
        last, task = Command.rest(robot.n), standing(robot.draw(rng, 1)[0], gain=4.0)
        for period in range(8):
            step = controller.step(q, task, 0.005 * period, last)
            with twins():
                twin = controller.step(q, task, 0.005 * period, last)
            assert step.mode is twin.mode
            np.testing.assert_allclose(step.velocity, twin.velocity, rtol=0, atol=1e-6)
            np.testing.assert_allclose(step.rows.value, twin.rows.value, rtol=0, atol=1e-12)
            assert step.proven == pytest.approx(twin.proven, abs=1e-8)
            q, last = q + settings.period * step.velocity, step.command
            modes.add(step.mode)
    assert len(modes) > 1


def test_joints_that_follow_others(tmp_path: Path) -> None:
    """The look-ahead knows the planned joints only, and corrects by their derivatives."""
    box = Obstacle("box", Box((0.3, 0.3, 0.3)), Pose((0.9, 0.0, 1.2)))
    zero, lifter = (0.0,) * 5, RobotSpec(urdf=linkage_urdf(tmp_path))
    controller = Controller.of(scene_of(box, robot=lifter, start=zero, goal=zero))
    at = controller.barriers.at(np.zeros((1, 5)), np.zeros(1))
    floors = Floors(np.full(controller.barriers.count, 0.5), controller.sight.next, NO_ROWS, 0.0)
    found = lows_near(at, (1.0, 1.0), None, floors)
    with twins():
        same(found, lows_near(at, (1.0, 1.0), None, floors))
    assert found.gradient.shape == (len(found.pair), 5)
    assert len(found.pair)


def test_depths_do_not_depend_on_the_samples_before(robot: Robot) -> None:
    """A robot that stands still on its whole way: no pair in contact falls: depths are exact to 1e-9 m only."""
    rng = np.random.default_rng(5)
    eggs = [
        Obstacle(f"egg{k}", Ellipsoid(rng.uniform(0.05, 0.3, 3)), Pose(rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.9))))
        for k in range(8)
    ]
    controller = Controller.of(replace(crowded(), obstacles=tuple(eggs)), EUCLIDEAN, robot)
    every, next_one = np.arange(controller.barriers.count), np.zeros(controller.barriers.count, np.int64)
    for q in robot.draw(rng, 12):
        path = np.vstack([q + rng.normal(size=(3, robot.n)) * 0.01, [q]])
        at = controller.barriers.at(path, np.zeros(len(path)))
        floors = Floors(np.full(len(every), 1.0), next_one, NO_ROWS, 0.0)
        alone = lows_of_hulls(at, np.array([3]), every, floors)
        floors.values[alone.pair] += alone.over
        after = lows_of_hulls(at, np.arange(4), every, floors._replace(lower=-1e-12))
        assert not (after.sample == 3).any()
