"""Laws of braking: limits of velocity, acceleration and jerk are kept for ever, whatever is commanded; rest is reached;
who brakes for one period brakes on as before; and an arm driven at walls and joint limits keeps them all."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from hdplan import Box, InputError, Limits, Obstacle, Pose, Robot
from hdplan.control import Controller, ControlSettings, Run, simulate, standing
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.control.braking import Command, Rates
from hdplan.planner.control.window import Window
from hdplan.planner.robot.setup import Setup

from .rooms import READY, scene_of

LIMITS = Limits(acceleration=5.0, jerk=200.0)


def random_rates(rng: np.random.Generator, n: int = 7) -> Rates:
    """Limits over many orders of magnitude, slow and fast controllers."""
    limits = {
        "velocity": rng.uniform(0.1, 3.0, n),
        "acceleration": 10.0 ** rng.uniform(-1.0, 3.0, n),
        "jerk": 10.0 ** rng.uniform(0.0, 6.0, n),
    }
    named = {name: value for name, value in limits.items() if name == "velocity" or rng.random() < 0.7}
    return Rates.of(named, float(rng.choice([0.001, 0.005, 0.02])), float(rng.choice([0.0, 0.2])), np.full(n, 3.0))


@pytest.mark.core
def test_every_command_within_the_window_keeps_all_limits_and_can_come_to_rest() -> None:
    rng = np.random.default_rng(0)
    for _ in range(60):
        rates, last = random_rates(rng), Command.rest(7)
        for _ in range(30):
            low, high = rates.window(last)
            brake = rates.braked(last.velocity, last.acceleration)
            assert (brake[-1] == 0.0).all()
            assert ((brake[0] >= low - 1e-9) & (brake[0] <= high + 1e-9)).all()
            pushed = np.diff(brake, axis=0, prepend=last.velocity[None]) / rates.period
            jerks = np.diff(pushed, axis=0, prepend=last.acceleration[None]) / rates.period
            assert (np.abs(brake) <= rates.velocity + 1e-9).all()
            assert (np.abs(pushed) <= rates.acceleration * (1 + 1e-9) + 1e-9).all()
            assert (np.abs(jerks) <= rates.jerk * (1 + 1e-6) + 1e-5).all()
            on = rates.braked(brake[0], pushed[0])  # Bellman: braking goes on as it began
            shared = min(len(on), len(brake) - 1)
            np.testing.assert_allclose(on[:shared], brake[1 : shared + 1], atol=1e-12)
            velocity = np.where(rng.random(7) < 0.5, low, np.where(rng.random(7) < 0.5, high, rng.uniform(low, high)))
            last = Command(velocity, (velocity - last.velocity) / rates.period)
            assert (np.abs(last.velocity) <= rates.velocity + 1e-9).all()


def test_joints_driven_at_their_limits_stop_before_them() -> None:
    """The farthest command that the window allows is sent in every period, at random to either side."""
    rng = np.random.default_rng(1)
    near = 0
    for _ in range(25):
        rates = random_rates(rng)
        upper = rng.uniform(0.0, 0.5, 7)
        q, last, rate = np.zeros(7), Command.rest(7), float(rng.uniform(0.02, 0.5)) / rates.period
        side = rng.random(7) < 0.5
        for _ in range(150):
            window = Window(q, last, rates, -upper, upper, rate)
            low, high = window.box
            assert ((low <= window.brake[0]) & (window.brake[0] <= high)).all()
            side = side ^ (rng.random(7) < 0.02)
            velocity = np.where(side, low, high)
            q, last = q + rates.period * velocity, Command(velocity, (velocity - last.velocity) / rates.period)
            assert (np.abs(q) <= upper + 1e-9).all()
        near += int((np.abs(q) > 0.98 * upper).sum())
    assert near > 10


def test_without_limits_of_acceleration_the_box_is_the_papers() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        rates = Rates.of({"velocity": rng.uniform(0.5, 3.0, 5)}, 0.01, 0.0, np.zeros(5))
        q, last = rng.uniform(-1.0, 1.0, 5), Command(*rng.uniform(-0.5, 0.5, (2, 5)))
        window = Window(q, last, rates, -np.ones(5), np.ones(5), 5.0)
        np.testing.assert_array_equal(window.stopping, q[None])
        np.testing.assert_allclose(window.box[0], np.maximum(5.0 * (-1.0 - q), -rates.velocity), atol=1e-12)
        np.testing.assert_allclose(window.box[1], np.minimum(5.0 * (1.0 - q), rates.velocity), atol=1e-12)
        np.testing.assert_allclose(window.gains, 1.0)


def test_an_arm_at_full_speed_brakes_before_walls_within_its_limits(robot: Robot) -> None:
    """Walls on both sides and targets behind them: nothing falls below its margin, the executed motion is certified
    with its limits of acceleration and jerk, and the arm comes near."""
    scene = scene_of(
        Obstacle("left", Box((0.6, 0.02, 1.0)), Pose((0.4, 0.35, 0.5))),
        Obstacle("front", Box((0.02, 1.0, 1.0)), Pose((0.75, 0.0, 0.5))),
        limits=LIMITS,
    )
    controller = Controller.of(scene, ControlSettings(rate=20.0), robot)
    for turn in ((1.5, 0.0), (0.0, 1.2)):
        goal = READY + [turn[0], turn[1], 0.0, turn[1], 0.0, 0.0, 0.0]
        run = simulate(controller, READY, standing(goal, gain=20.0), 1.2, until_met=False)
        assert run.slacks.min() >= -1e-9
        assert run.slacks.min() < 0.02
        assert np.abs(run.velocities).max() > 1.0
        executed = run.executed(robot.joint_names, robot.locked)
        verdict = Certifier(Setup.of(scene, robot)).certify(executed, check_ends=False)
        assert verdict.certified, verdict.text
        assert {use.quantity: use.share > 0.9 for use in verdict.uses}["acceleration"]
        assert run.proven is not None


def test_a_robot_that_moves_already_is_braked_from_there(robot: Robot) -> None:
    """A measured velocity is an argument: toward a wall the first command is one that still can stop."""
    wall = Obstacle("front", Box((0.02, 1.0, 1.0)), Pose((0.80, 0.0, 0.5)))
    controller = Controller.of(scene_of(wall, limits=LIMITS), ControlSettings(rate=20.0), robot)
    q, last = READY, Command(np.array([0.0, 0.6, 0.0, 0.6, 0.0, 0.0, 0.0]), np.zeros(7))
    goal, most = q + [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0], controller.rates.acceleration
    for _ in range(150):
        step = controller.step(q, standing(goal, gain=20.0), 0.0, last)
        assert (np.abs(step.velocity - last.velocity) <= 0.005 * most + 1e-9).all()
        assert step.slack >= -1e-9
        q, last = q + 0.005 * step.velocity, step.command


@pytest.mark.parametrize("seed", range(12))
def test_an_executed_motion_at_the_limits_keeps_them_however_close_its_rows(seed: int) -> None:
    """Commands at the ends of their windows, 1,000 to 10,000 a second, as the file has them and the certificate."""
    rng = np.random.default_rng(seed)
    period, far = float(10.0 ** -rng.uniform(3.0, 4.0)), np.array([3.0, 1.5, 7.9])
    limits = {"velocity": rng.uniform(0.5, 3.0, 3), "acceleration": rng.uniform(1.0, 10.0, 3)}
    limits["jerk"] = 10.0 ** rng.uniform(-0.5, 3.0, 3)
    rates = Rates.of(limits, period, 0.2, far)
    q, last = rng.uniform(-0.3, 0.3, 3) * far, Command.rest(3)
    positions, turns, begin = [q], rng.uniform(0.5, 3.0, 3), float(rng.choice([0.0, 0.1, 7.3]))
    for k in range(1500):
        low, high = rates.window(last)
        u = np.where(np.sin(2 * np.pi * k * period * turns) * -np.sign(q) > 0.0, high, low)
        last, q = Command(u, (u - last.velocity) / period), q + period * u
        positions.append(q)
    after = q + period * rates.braked(last.velocity, last.acceleration).cumsum(axis=0)
    nothing = np.zeros((1, 3)), (), np.zeros(1), None, np.zeros(1), np.zeros(1), None, Counter[tuple[str, str]]()
    executed = Run(period, np.array(positions), *nothing, begin, after).executed(("a", "b", "c"), {})
    assert (np.abs(executed.positions) <= far).all()
    for order, name in enumerate(limits, 1):
        assert (executed.curve.over_time(order).largest() <= limits[name] * (1.0 + 1e-9)).all(), name
    assert not executed.curve.over_time(1).jumps().any()
    assert executed.curve.over_time(2).jumps().max() < 1e-6
    assert executed.times is not None
    assert np.ptp(np.diff(executed.times)) == 0.0
    assert executed.times[-1] - begin == pytest.approx((len(executed.times) - 1) * period, rel=1e-9)


def test_braking_that_would_take_too_long_is_refused(robot: Robot) -> None:
    """A measured velocity that is no robot's gives one line, not a step of minutes; so do periods that are too short,
    before the robot moves."""
    controller, q = Controller.of(scene_of(limits=LIMITS), robot=robot), READY
    for last in (Command(np.full(7, 1e3), np.zeros(7)), Command(np.zeros(7), np.full(7, 1e5))):
        with pytest.raises(InputError, match=r"^last: .* periods, at most 10000 are allowed$"):
            controller.step(q, standing(q), last=last)
    with pytest.raises(InputError, match=r"^control.period: 1e-06 s is too short"):
        Controller.of(controller.setup.scene, ControlSettings(period=1e-6), robot)
