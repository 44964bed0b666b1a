"""Laws of the time law and of the check on rates: limits hold everywhere on the executed curve, none is given away
without need, and messages name what breaks them."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import hdplan
from hdplan import HdplanError, InputError, Limits, Robot, Scene, Timing, Trajectory, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.rate_check import RateCheck
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.robot_curve import beyond_limits
from hdplan.planner.robot.joint_limits import DERIVATIVES, joint_limits
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.path_spline import smooth
from hdplan.planner.timing.retiming import Retimer
from hdplan.planner.timing.time_laws import Averaged, MinimumJerk, Stepwise

LIMITS = [Limits(acceleration=5.0), Limits(acceleration=5.0, jerk=40.0)]
LIMITS += [Limits(velocity=0.7, acceleration=3.0, jerk=400.0)]


def limited(limits: Limits, timing: Timing | None = None, name: str = "empty") -> tuple[Scene, Robot]:
    scene = dataclasses.replace(load_scene(name), limits=limits, timing=timing)
    return scene, load_scene_robot(scene)


def wild(robot: Robot, seed: int) -> Trajectory:
    """A polyline with sharp corners and uneven pieces."""
    rng = np.random.default_rng(seed)
    corners = robot.draw(rng, 4)
    pieces = [np.linspace(a, b, rng.integers(2, 14))[:-1] for a, b in itertools.pairwise(corners)]
    return Trajectory(robot.joint_names, np.vstack([*pieces, corners[-1:]]), robot.locked)


@pytest.mark.parametrize("limits", LIMITS, ids=["acceleration", "jerk", "all"])
@pytest.mark.parametrize("seed", range(3))
def test_limits_hold_everywhere_and_one_of_them_is_used(limits: Limits, seed: int) -> None:
    scene, robot = limited(limits)
    path = wild(robot, seed)
    trajectory, parameter = Retimer(Setup.of(scene, robot))(path)
    when = np.linspace(0.0, 1.0, 20_001)
    shares = []
    for quantity, limit in joint_limits(scene, robot).items():
        rate = trajectory.curve.over_time(DERIVATIVES[quantity]).at_parameter(when)
        shares.append(np.max(np.abs(rate) / limit))
    assert max(shares) <= 1.0
    assert max(shares) >= 0.93  # time is not given away: whole rows, and bounds a little above the values
    assert np.all(np.diff(parameter) >= 0)
    assert (parameter[0], parameter[-1]) == (0.0, 1.0)


@pytest.mark.parametrize("limits", LIMITS, ids=["acceleration", "jerk", "all"])
@pytest.mark.parametrize("timing", [None, Timing(scale=0.4)])
def test_a_motion_that_has_to_be_quicker_is_the_same_or_none(limits: Limits, timing: Timing | None) -> None:
    scene, robot = limited(limits, timing)
    retimer = Retimer(Setup.of(scene, robot))
    for seed in range(2):
        path = wild(robot, seed)
        motion = retimer(path).trajectory
        assert motion.duration is not None
        assert retimer.quickest_along(path.positions) <= motion.duration
        for than in (motion.duration, 0.9 * motion.duration, 0.1):
            assert next(retimer.ways(path, than), None) is None
        for than in (1.0001 * motion.duration, 1.3 * motion.duration):
            found = next(retimer.ways(path, than))
            np.testing.assert_array_equal(found.trajectory.positions, motion.positions)
            np.testing.assert_array_equal(found.trajectory.times, motion.times)


@pytest.mark.parametrize("timing", [None, Timing(duration=3.0), Timing(scale=0.4), Timing(rate=37.0)])
def test_a_motion_begins_and_ends_at_rest_where_the_path_does(timing: Timing | None) -> None:
    scene, robot = limited(LIMITS[1], timing)
    path = wild(robot, 7)
    trajectory, _ = Retimer(Setup.of(scene, robot))(path)
    assert trajectory.velocities is not None
    assert trajectory.accelerations is not None
    assert trajectory.times is not None
    np.testing.assert_allclose(trajectory.positions[[0, -1]], path.positions[[0, -1]], rtol=0, atol=1e-14)
    assert np.abs(trajectory.velocities[[0, -1]]).max() < 1e-9
    assert np.abs(trajectory.accelerations[[0, -1]]).max() < 1e-6
    assert np.diff(trajectory.times).max() <= 1.0 / (timing or Timing()).rate + 1e-12
    if timing and timing.duration:
        assert trajectory.times[-1] == timing.duration


def test_scale_slows_down_by_just_that_much() -> None:
    full, half = (
        Retimer(Setup(*limited(LIMITS[0], Timing(scale=scale))))(wild(limited(LIMITS[0])[1], 1)).trajectory
        for scale in (1.0, 0.5)
    )
    assert half.times is not None
    assert full.times is not None
    assert half.times[-1] == pytest.approx(2.0 * full.times[-1], rel=1e-9)
    assert half.curve.over_time(1).largest() == pytest.approx(0.5 * full.curve.over_time(1).largest(), rel=1e-3)


def test_each_stage_of_a_path_has_its_speed() -> None:
    """The next one's begins at its place, in a part of the path as in the whole."""
    retimer = Retimer(Setup.of(load_scene("planar_arm")))
    for first, last, change in ((0.0, 1.0, 0.5), (0.25, 0.75, 0.375)):
        shares = retimer.with_speeds(np.array([1.0, 0.5]), np.array([change]), first, last).shares
        at = first + (last - first) * np.linspace(0.0, 1.0, len(shares))
        np.testing.assert_array_equal(shares, np.where(at < change, 1.0, 0.5))


def test_a_straight_motion_takes_no_longer_than_it_must() -> None:
    """One joint, bang-bang: 2 √(way / acceleration), but for the averaging window and whole rows."""
    scene, robot = limited(Limits(velocity=100.0, acceleration=2.0))
    start = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
    goal = start.copy()
    goal[0] += 1.0
    path = Trajectory(robot.joint_names, np.linspace(start, goal, 20), robot.locked)
    trajectory, _ = Retimer(Setup.of(scene, robot))(path)
    assert trajectory.times is not None
    least = 2.0 * np.sqrt(1.0 / 2.0)
    assert least <= trajectory.times[-1] <= 1.05 * least


def test_the_smooth_path_stays_within_the_hull_of_the_polyline() -> None:
    """The path is within the limits wherever the waypoints are; on a straight line it is the line, as fast."""
    rng = np.random.default_rng(0)
    waypoints = np.clip(rng.normal(size=(12, 3)), -0.5, 0.5)  # many rest on a limit
    found = smooth(waypoints)(np.linspace(0, 1, 1001))
    assert np.abs(found).max() <= 0.5
    np.testing.assert_allclose(found[[0, -1]], waypoints[[0, -1]], rtol=0, atol=1e-15)
    line = np.linspace([0.0, 1.0], [1.0, -3.0], 9)
    np.testing.assert_allclose(smooth(line)(np.linspace(0, 1, 9)), line, rtol=0, atol=1e-14)
    for count in (2, 3, 4):
        ends = np.linspace([0.0], [1.0], count)
        np.testing.assert_allclose(smooth(ends)([0.0, 0.25, 1.0])[:, 0], [0.0, 0.25, 1.0], atol=1e-14)


def test_derivatives_of_minimum_jerk_are_those_of_its_values() -> None:
    found = MinimumJerk(1.7)
    times = np.linspace(0.01, found.duration - 0.01, 400)
    step = 1e-6
    at = found(times)
    for order in (1, 2, 3):
        slope = (found(times + step)[order - 1] - found(times - step)[order - 1]) / (2 * step)
        np.testing.assert_allclose(slope, at[order], rtol=0, atol=1e-4 * np.abs(at[order]).max())
    np.testing.assert_allclose(found(np.array([0.0, found.duration]))[:3], [[0, 1], [0, 0], [0, 0]], atol=1e-9)
    np.testing.assert_allclose(found(found.time_at(np.linspace(0, 1, 77)))[0], np.linspace(0, 1, 77), atol=1e-6)
    u, slopes, bends = found.rows(18)
    np.testing.assert_allclose(np.stack([u, slopes / 1.7, bends / 1.7**2]), found(0.1 * np.arange(18))[:3], atol=1e-12)


def any_law(rng: np.random.Generator) -> Stepwise:
    """From rest to rest over a way of 1, with jumps of acceleration."""
    knots, path_speeds = np.cumsum([0.0, *rng.uniform(0.1, 0.5, 5)]), np.array([0.0, *rng.uniform(0.2, 2.0, 4), 0.0])
    way = float(np.diff(knots) @ (path_speeds[1:] + path_speeds[:-1])) / 2
    return Stepwise(knots, path_speeds / way)


@pytest.mark.parametrize("count", [12, 150, 4000])
def test_the_rows_of_an_averaged_law_are_those_of_a_cubic_spline_from_rest_to_rest(count: int) -> None:
    rng = np.random.default_rng(count)
    for share in (1e-3, 0.05, 0.4, 0.7):
        u, slope, bend = Averaged(any_law(rng), share).rows(count)
        step = 1.0 / (count - 1)
        np.testing.assert_allclose([u[0], u[-1]], [0.0, 1.0], rtol=0, atol=1e-12)
        np.testing.assert_allclose([*slope[[0, -1]], *bend[[0, -1]]], 0.0, atol=1e-9)
        np.testing.assert_allclose(np.diff(slope), step / 2 * (bend[1:] + bend[:-1]), atol=1e-9)
        np.testing.assert_allclose(np.diff(u), step * slope[:-1] + step**2 / 6 * (2 * bend[:-1] + bend[1:]), atol=1e-9)


def test_an_averaged_law_keeps_what_the_law_keeps_and_is_its_average() -> None:
    """No faster than the law anywhere, nor more accelerated, nor with more jerk than a change of that within the
    window; with many rows, the mean over the window."""
    rng = np.random.default_rng(8)
    for count, share in ((9, 0.3), (60, 0.05), (300, 0.02), (20_001, 0.1)):
        law = any_law(rng)
        window = max(round(share * (count - 1)), 1)
        whole = law.duration * (count - 1) / (count - 1 - window)
        u, slope, bend = Averaged(law, share).rows(count)
        slope, bend, step = slope / whole, bend / whole**2, whole / (count - 1)
        off = 1.0 + 4.0 * (step / law.duration) ** 2 * np.ptp(np.diff(law.path_speeds) / np.diff(law.knots))
        accelerations = np.diff(law.path_speeds) / np.diff(law.knots)
        assert slope.max() <= law.path_speeds.max() * off
        assert np.abs(bend).max() <= np.abs(accelerations).max() * off
        jumps = np.ptp(np.append(accelerations, 0.0))
        assert np.abs(np.diff(bend)).max() / step <= jumps / (window * step) * off
        assert np.diff(u).min() >= -1e-9
        for row in (count // 3, count // 2):
            within = row * step - window * step * (np.arange(20_000) + 0.5) / 20_000
            mean = law.path_speeds_at(within).mean()
            assert slope[row] == pytest.approx(mean, rel=2.0 / window**2 + 1e-3)


@pytest.mark.parametrize("jerk", [0.5, 5.0, 60.0, 1e4, 1e6])
def test_any_limit_of_jerk_is_kept(jerk: float) -> None:
    """The jerk limit may take much more time than velocity and acceleration need; rows are few or many."""
    rng = np.random.default_rng(4)
    for rate in (3.0, 50.0, 400.0 if jerk > 10.0 else 20.0):
        scene, robot = limited(Limits(velocity=2.0, acceleration=15.0, jerk=jerk), Timing(rate=rate))
        near = robot.draw(rng, 1) + 1e-3 * rng.normal(size=(2, robot.n))
        for corners in (robot.draw(rng, 3), robot.draw(rng, 2), near):
            rows, fine = np.clip(corners, robot.lower, robot.upper), np.linspace(0, 1, 16)
            path = np.stack([np.interp(fine, np.linspace(0, 1, len(rows)), each) for each in rows.T], 1)
            motion = Retimer(Setup.of(scene, robot))(Trajectory(robot.joint_names, path, robot.locked)).trajectory
            assert motion.times is not None
            assert np.diff(motion.times).max() <= 1.0 / rate + 1e-9
            assert all(use.within for use in RateCheck(Setup.of(scene, robot)).check(motion.curve).uses)


@pytest.mark.parametrize("rate", [30.0, 100.0, 171.0])
def test_a_double_s_is_met_but_for_a_few_thousandths(rate: float) -> None:
    """One joint alone, far enough to reach its velocity and acceleration: the quickest motion is known."""
    scene, robot = limited(Limits(velocity=2.0, acceleration=15.0, jerk=500.0), Timing(rate=rate))
    start = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
    for way in (0.8, 1.3, 2.3):
        goal = start.copy()
        goal[0] += way
        retimer = Retimer(Setup.of(scene, robot))
        motion = retimer(Trajectory(robot.joint_names, np.linspace(start, goal, 20), robot.locked)).trajectory
        least = retimer.shortest(start, goal)
        assert motion.duration is not None
        assert least <= motion.duration <= 1.004 * (least + max(1.0 / rate - 15.0 / 500.0, 0.0))
        assert all(use.within for use in RateCheck(Setup.of(scene, robot)).check(motion.curve).uses)


# --- the check ----------------------------------------------------------------------------------------------------


def test_a_limit_that_breaks_only_between_the_rows_is_reported() -> None:
    """The velocity is 0 at every row: samples at the rows would find nothing."""
    scene, robot = limited(Limits(velocity=1.0, acceleration=1e3))
    rows = np.zeros((3, robot.n))
    rows[1, 2] = 0.8
    curve = Curve.through(rows, np.arange(3.0), np.zeros_like(rows), np.zeros_like(rows))
    use = {use.quantity: use for use in RateCheck(Setup.of(scene, robot)).check(curve).uses}
    assert use["velocity"].share == pytest.approx(0.8 * 1.875, rel=1e-2)
    assert (use["velocity"].joint, use["velocity"].within) == (robot.joint_names[2], False)
    assert use["acceleration"].within


def test_corners_have_infinite_acceleration_and_cubics_infinite_jerk() -> None:
    scene, robot = limited(Limits(velocity=10.0, acceleration=100.0, jerk=1e4))
    rows = np.linspace(np.zeros(robot.n), np.full(robot.n, 0.1), 5)
    times = np.arange(5.0)
    check = RateCheck(Setup.of(scene, robot))
    shares = {use.quantity: use.share for use in check.check(Curve.through(rows, times)).uses}
    assert shares["velocity"] < 1.0
    assert np.isinf(shares["acceleration"])  # it starts and ends with a jump
    velocities = np.zeros_like(rows)
    velocities[1:-1] = 0.05
    cubics = Curve.through(rows, times, velocities)
    shares = {use.quantity: use.share for use in check.check(cubics).uses}
    assert shares["acceleration"] < 1.0
    assert np.isinf(shares["jerk"])


@pytest.mark.core
def test_a_motion_too_fast_is_not_certified_and_one_without_times_is_refused() -> None:
    scene, robot = limited(LIMITS[0], name="panda_bookshelf")
    result = hdplan.plan(scene)
    assert result.certified, result.certificate.text
    certifier = Certifier(Setup.of(scene, robot))
    slow = result.trajectory
    assert slow.times is not None
    assert slow.velocities is not None
    assert slow.accelerations is not None
    fast = dataclasses.replace(
        slow, times=slow.times / 2, velocities=2 * slow.velocities, accelerations=4 * slow.accelerations
    )
    verdict = certifier.certify(fast)
    assert verdict.status is Status.TOO_FAST
    assert "acceleration" in verdict.text or "velocity" in verdict.text
    with pytest.raises(InputError, match="has no times, and the scene limits rates"):
        certifier.certify(Trajectory(slow.joint_names, slow.positions, slow.locked))


def test_the_pallets_motion_is_too_rough_without_its_limit_of_jerk() -> None:
    scene = load_scene("ur5_pallet")
    result = hdplan.plan(scene)
    assert result.certified, result.certificate.text
    assert [use.quantity for use in result.certificate.uses] == ["velocity", "acceleration", "jerk"]
    rough = hdplan.plan(dataclasses.replace(scene, limits=dataclasses.replace(scene.limits, jerk=None)))
    assert rough.certified
    verdict = Certifier(Setup.of(scene)).certify(rough.trajectory)
    assert verdict.status is Status.TOO_FAST
    assert "jerk" in verdict.text


def test_rates_that_the_scene_does_not_limit_are_not_checked() -> None:
    scene = load_scene("panda_bookshelf")
    assert hdplan.plan(scene).certificate.uses == ()


def test_a_duration_that_no_motion_can_keep_is_refused_by_name() -> None:
    scene = dataclasses.replace(load_scene("panda_bookshelf"), timing=Timing(duration=0.01))
    with pytest.raises(InputError, match=r"timing.duration: 0.01 s, but joint 'panda_joint\d' alone needs at least"):
        hdplan.plan(scene)


def test_a_duration_is_kept_by_the_fastest_law_where_that_of_minimum_jerk_is_too_fast() -> None:
    scene, robot = limited(Limits(acceleration=4.0))
    path = wild(robot, 2)
    fastest = Retimer(Setup.of(scene, robot))(path).trajectory
    assert fastest.times is not None
    for factor, within in ((0.9, False), (1.05, True), (4.0, True)):
        timing = Timing(duration=factor * float(fastest.times[-1]))
        timed = Retimer(Setup(*limited(Limits(acceleration=4.0), timing)))(path).trajectory
        assert timed.times is not None
        assert timed.times[-1] == timing.duration
        assert all(use.within for use in RateCheck(Setup.of(scene, robot)).check(timed.curve).uses) == within
    even = Retimer(Setup(*limited(Limits(), Timing(duration=timing.duration))))(path).trajectory
    np.testing.assert_array_equal(even.positions, timed.positions)  # minimum jerk, where there is time enough


@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
def test_a_path_along_a_joint_limit_stays_within_it(rate: float) -> None:
    """Between rows a quintic leaves the path a little: not beyond the limits, wherever waypoints rest on them."""
    scene, robot = limited(Limits(acceleration=5.0), Timing(rate=rate))
    rng = np.random.default_rng(0)
    for _ in range(4):
        drawn = robot.draw(rng, 1) + np.cumsum(rng.normal(scale=0.5, size=(32, robot.n)), axis=0)
        rows = np.clip(drawn, robot.lower, robot.upper)  # many rest on a limit
        trajectory, _ = Retimer(Setup.of(scene, robot))(Trajectory(robot.joint_names, rows, robot.locked))
        assert beyond_limits(trajectory.curve, robot) is None


@pytest.mark.parametrize("jerk", [1.0, 10.0, 1e3])
@pytest.mark.parametrize("joints", [1, 7])
def test_a_path_that_turns_back_finds_a_law_however_quick_it_may_be_there(jerk: float, joints: int) -> None:
    """Jumps of u̇ are possible there: jerk that no wider window lowers calls for a slower law, not none."""
    scene, robot = limited(Limits(velocity=50.0, acceleration=1e4, jerk=jerk))
    rng = np.random.default_rng([joints, round(jerk)])
    way = np.cumsum(np.where(np.arange(robot.n) < joints, rng.normal(scale=0.1, size=(8, robot.n)), 0.0), axis=0)
    path = np.clip(robot.configuration(scene.start) + way, robot.lower, robot.upper)
    ends = {"start": path[0].tolist(), "goal": path[-1].tolist()}
    setup = Setup.of(dataclasses.replace(scene, **ends), robot)
    timed = Retimer(setup)(Trajectory(robot.joint_names, path, robot.locked)).trajectory
    rests = sum(float((32.0 * np.abs(step).max() / jerk) ** (1.0 / 3.0)) for step in np.diff(path, axis=0))  # at each
    assert all(use.within for use in RateCheck(setup).check(timed.curve).uses)
    assert timed.times is not None
    assert timed.times[-1] <= rests


def crowded(seed: int, rate: float) -> tuple[Scene, Robot, Trajectory]:
    """A short way within a small limit of jerk, in so many rows that a position which is rounded by e makes a jerk of
    some 60 e/h³, which no stretch takes away."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-1.0, 1.0, 2)
    goal = start + rng.uniform(0.01, 0.03, 2)
    scene, robot = limited(Limits(velocity=2.0, acceleration=2.0, jerk=0.3), Timing(rate=rate), "planar_arm")
    scene = dataclasses.replace(scene, start=start, goal=goal, obstacles=())
    return scene, robot, Trajectory(robot.joint_names, np.linspace(start, goal, 8), {})


@pytest.mark.parametrize(("seed", "rate"), [(0, 1000.0), (1, 2000.0), (8, 5000.0), (3, 7000.0)])
def test_limits_hold_where_rows_are_so_close_that_their_rounding_is_seen(seed: int, rate: float) -> None:
    scene, robot, path = crowded(seed, rate)
    timed = Retimer(Setup.of(scene, robot))(path)
    assert hdplan.certify(scene, timed.trajectory, robot).certified
    assert (timed.trajectory.curve.over_time(3).largest() / 0.3).max() > 1.0 - 1e-3  # and no time is given away


def test_rows_whose_rounding_exceeds_a_limit_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hdplan.planner.timing.retiming.ROUNDINGS", 1)
    scene, robot, path = crowded(0, 1000.0)
    with pytest.raises(HdplanError, match=r"timing\.rate: 1000 rows a second are so close"):
        Retimer(Setup.of(scene, robot))(path)
