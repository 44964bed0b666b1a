"""Laws of curves that are followed: bounds hold at every instant, and what does not follow is not certified."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation, Slerp

import hdplan
from hdplan import InputError, PlanarBase, Trajectory
from hdplan.planner.certificate import pose_curve, tool_rates
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.followed_curve import OnCurve, TurnedAlong
from hdplan.planner.certificate.path_check import PathCheck
from hdplan.planner.certificate.path_parts import Part
from hdplan.planner.certificate.pose_curve import PoseCurve
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.robot.setup import Setup
from tests.loops import in_numpy, needs_loops

LIMITS = hdplan.Limits(velocity=50.0, acceleration=1e5)
TOOLS = {"panda": "panda_hand_tcp", "wheeled": "panda_hand_tcp", "ur5": "ee_link"}
ANYWHERE = [hdplan.Pose([0, 0, 0]), hdplan.Pose([1, 0, 0])]  # of a robot alone
READY = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.7])  # of a Panda


def tool_poses(robot: hdplan.Robot, rows: Any, link: str) -> tuple[Any, Any]:
    """Positions (k, 3) and rotations (k, 3, 3) of a link, by Pinocchio."""
    data, frame = robot.model.createData(), robot.model.getFrameId(link)
    places, turns = [], []
    for q in rows:
        pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
        places.append(data.oMf[frame].translation.copy())
        turns.append(data.oMf[frame].rotation.copy())
    return np.array(places), np.array(turns)


def poses_of(places: Any, turns: Any) -> list[hdplan.Pose]:
    quaternions = Rotation.from_matrix(turns).as_quat()
    return [hdplan.Pose(place, turn) for place, turn in zip(places.tolist(), quaternions.tolist(), strict=True)]


def setup_of(name: str, poses: list[hdplan.Pose], **more: Any) -> Setup:
    follow = hdplan.Follow(TOOLS[name], poses, **more)
    base = hdplan.Pose.from_rpy([0.2, -0.4, 1.9], [2.8, 0.3, 1.1])  # hanging, slanted
    wheels = PlanarBase(x=(-3, 3), y=(-3, 3), yaw=(-3, 3)) if name == "wheeled" else None
    robot = hdplan.RobotSpec(name="ur5" if name == "ur5" else "panda", base=base, base_joints=wheels)
    count = {"panda": 7, "wheeled": 10, "ur5": 6}[name]
    at = np.concatenate([np.zeros(3), READY])[-count:]
    path = hdplan.PathConstraints(follow=follow)
    return Setup.of(hdplan.Scene(robot=robot, start=at, goal=at, limits=LIMITS, path=path))


def random_motion(rng: Any, n: int, rows: int = 5, span: float = 0.4) -> Curve:
    middle = rng.uniform(-1.0, 1.0, n)
    positions = middle + rng.uniform(-span, span, (rows, n))
    times = np.cumsum(rng.uniform(0.05, 0.4, rows))
    return Curve.through(positions, times, rng.uniform(-1, 1, (rows, n)), rng.uniform(-5, 5, (rows, n)))


def values(check: PathCheck, held: Any, curve: Curve, spans: tuple[Any, Any, Any]) -> tuple[Any, Any]:
    middle, delta, off = curve.part(*spans)
    frames = check.chain.frames(check.robot.pin_q(middle))
    low, high = curve.bounds()
    travel = np.stack([low.min(axis=0), high.max(axis=0)], axis=1)
    valued = held.on(*spans)
    found = valued.found(*frames)
    return found, valued.bound(Part(check.chain, *frames, delta, off, travel), found)


@pytest.mark.parametrize("name", TOOLS)
@pytest.mark.parametrize("free", ["none", "y"])
def test_bounds_hold_within_parts(name: str, free: str) -> None:
    """Random motions have nothing to do with the curves: no value within a random part of a motion exceeds
    the part's bound; it is taken at the place at which u(t) is then."""
    rng = np.random.default_rng([3, len(name), len(free)])
    for _ in range(2):
        turns = Rotation.random(4, random_state=int(rng.integers(1 << 30)))
        turns = Rotation.from_rotvec(0.4 * turns.as_rotvec())
        poses = [hdplan.Pose(rng.uniform(-1, 1, 3), turn) for turn in turns.as_quat()]
        setup = setup_of(name, poses, free_rotation=free, speed=1.0, acceleration=1.0)
        check = PathCheck(setup, Chain.of(setup.robot.unfolded.model))
        motion = random_motion(rng, setup.robot.n)
        helds = list(check._along(motion, 4))
        assert [type(each) for each in helds] == [OnCurve, TurnedAlong, tool_rates.ToolRate, tool_rates.ToolRate]
        for held in helds:
            interval, start, width = held.spans
            chosen = rng.integers(len(interval), size=20)
            share = rng.uniform(0.02, 1.0, 20)
            begins = start[chosen] + rng.uniform(0, 1, 20) * (1.0 - share) * width[chosen]
            spans = interval[chosen], begins, share * width[chosen]
            _, bound = values(check, held, motion, spans)
            for _ in range(6):
                at = spans[1] + rng.uniform(0.0, 1.0, 20) * spans[2]
                inside, _ = values(check, held, motion, (spans[0], at, np.zeros(20)))
                assert (inside <= bound + 1e-9).all()


@pytest.mark.parametrize("name", TOOLS)
def test_rates_are_those_of_the_tool(name: str) -> None:
    rng = np.random.default_rng([5, len(name)])
    setup = setup_of(name, ANYWHERE, speed=1.0, acceleration=1.0)
    check = PathCheck(setup, Chain.of(setup.robot.unfolded.model))
    motion = random_motion(rng, setup.robot.n)
    assert motion.times is not None
    speed, acceleration = list(check._along(motion, 4))[2:]
    middle = np.full(len(motion) - 1, 0.43)
    spans = np.arange(len(motion) - 1), middle, np.zeros(len(middle))
    when, tick = motion.times[:-1] + 0.43 * motion.widths, 1e-4
    places = [tool_poses(setup.robot, motion.at_time(when + k * tick), TOOLS[name])[0] for k in (-1, 0, 1)]
    by_steps = np.linalg.norm(places[2] - places[0], axis=1) / (2 * tick)
    np.testing.assert_allclose(values(check, speed, motion, spans)[0], by_steps, rtol=1e-5)
    twice = np.linalg.norm(places[2] - 2 * places[1] + places[0], axis=1) / tick**2
    np.testing.assert_allclose(values(check, acceleration, motion, spans)[0], twice, rtol=1e-4)


def along(robot: hdplan.Robot, rng: Any, count: int = 41) -> tuple[Any, Any]:
    """A smooth motion, and dense poses that it passes."""
    start, way = READY + rng.uniform(-0.3, 0.3, robot.n), rng.uniform(-0.4, 0.4, robot.n)
    share = np.linspace(0, 1, count)
    rows = start + np.outer(share, way) + 0.1 * np.outer(np.sin(3 * share), rng.uniform(-1, 1, robot.n))
    return rows, share


def rated(rows: Any, times: Any) -> tuple[Any, Any, Any, Any]:
    """The rows of a motion at rest at both ends: positions, times, velocities by differences, no accelerations."""
    speeds = np.gradient(rows, times, axis=0)
    speeds[[0, -1]] = 0.0
    return rows, times, speeds, np.zeros_like(rows)


def certified(setup: Setup, rows: Any, times: Any) -> hdplan.Certificate:
    motion = Trajectory(setup.robot.joint_names, rows, setup.robot.locked, *rated(rows, times)[1:])
    return Certifier(setup).certify(motion, check_ends=False)


def test_only_a_motion_that_follows_is_certified() -> None:
    """The same curve there, backwards, back and forth, left out in the middle, only half, off it in one row, turned in
    one row: only the first follows."""
    rng = np.random.default_rng(8)
    robot = setup_of("panda", ANYWHERE).robot
    rows, _ = along(robot, rng)
    dense = np.array([np.interp(np.linspace(0, 40, 401), np.arange(41), column) for column in rows.T]).T
    poses = poses_of(*tool_poses(robot, dense, TOOLS["panda"]))
    setup = setup_of("panda", poses, position_tolerance=2e-3, orientation_tolerance=2e-2)
    times = np.linspace(0.0, 8.0, len(rows))
    there = certified(setup, rows, times)
    assert there.certified, there.text
    fields = {each.field for each in there.path}
    assert fields == {"path.follow.position_tolerance", "path.follow.orientation_tolerance"}
    bad = {"backwards": rows[::-1], "half": rows[:21], "begins late": rows[5:]}
    bad["back and forth"] = np.concatenate([rows[:25], rows[24:9:-1], rows[10:]])
    bad["left out"] = np.concatenate([rows[:10], rows[30:]])
    for what, forged in bad.items():
        found = certified(setup, forged, np.linspace(0.0, 8.0, len(forged)))
        assert found.status is Status.OFF_PATH, what
    for joint in (0, 3, 5):
        forged = rows.copy()
        forged[17, joint] += 0.03
        assert not certified(setup, forged, times).certified


def test_a_closed_curve_is_not_followed_by_standing_still() -> None:
    robot = setup_of("panda", ANYWHERE).robot
    q = READY
    (place,), (turn,) = tool_poses(robot, q[None], TOOLS["panda"])
    ring = [place + [0.05 * np.sin(a), 0.05 * (1 - np.cos(a)), 0.0] for a in np.linspace(0, 2 * np.pi, 101)]
    setup = setup_of("panda", poses_of(np.array(ring), np.tile(turn, (101, 1, 1))), position_tolerance=5e-3)
    found = certified(setup, np.tile(q, (5, 1)), np.arange(5.0))
    assert found.status is Status.OFF_PATH
    turning = [Rotation.from_rotvec([0, 0, a]).as_matrix() @ turn for a in np.linspace(0, 2 * np.pi, 9)]
    setup = setup_of("panda", poses_of(np.tile(place, (9, 1)), np.array(turning)))
    assert certified(setup, np.tile(q, (5, 1)), np.arange(5.0)).status is Status.OFF_PATH


@pytest.mark.parametrize("seed", range(2))
def test_certified_means_near_the_curve_all_along(seed: int) -> None:
    """Motions that are more and more off their curve: those that are certified are near it at 4,000 instants, at places
    that never go back, by a search of its own (the discrete Fréchet distance)."""
    rng = np.random.default_rng([seed, 77])
    free = ["none", "z"][seed % 2]
    robot = setup_of("panda", ANYWHERE).robot
    rows, _ = along(robot, rng)
    places, turns = tool_poses(robot, rows, TOOLS["panda"])
    far, angle = 3e-3, 0.03
    within = {"position_tolerance": far, "orientation_tolerance": angle, "free_rotation": free}
    setup = setup_of("panda", poses_of(places, turns), **within)
    times, verdicts = np.linspace(0.0, 8.0, len(rows)), []
    slerp = Slerp(np.arange(len(rows)), Rotation.from_matrix(turns))
    fine = np.linspace(0, len(rows) - 1, 4001)
    line = np.array([np.interp(fine, np.arange(len(rows)), column) for column in places.T]).T
    for size in np.geomspace(1e-5, 3e-2, 6):
        moved = rows + size * rng.uniform(-1, 1, rows.shape)
        found = certified(setup, moved, times)
        verdicts.append(found.certified)
        if not found.certified:
            continue
        curve = Curve.through(*rated(moved, times))
        at, turned = tool_poses(robot, curve.at_time(np.linspace(0.0, 8.0, 1001)), TOOLS["panda"])
        near = np.linalg.norm(at[:, None] - line[None], axis=2) <= far + 1e-5
        if free == "none":
            wanted = slerp(fine)
            for k in range(0, 1001, 50):
                near[k] &= (Rotation.from_matrix(turned[k]).inv() * wanted).magnitude() <= angle + 1e-4
        assert near[0, 0]
        assert near[-1, -1]
        first = 0
        for k in range(1001):  # the least place that does, and none before it: if there is a way, there is this one
            there = np.flatnonzero(near[k, first:])
            assert len(there)
            first += int(there[0])
    assert verdicts[0]
    assert not verdicts[-1]


def test_a_free_axis_leaves_that_turn_and_no_other() -> None:
    robot = setup_of("panda", ANYWHERE).robot
    q = READY
    rows = np.tile(q, (31, 1))
    rows[:, 6] += np.linspace(0.0, 1.5, 31)  # about the hand's z axis, through the tool
    (place,), (turn,) = tool_poses(robot, q[None], TOOLS["panda"])
    poses, times = poses_of(np.array([place, place + 1e-5]), np.array([turn, turn])), np.linspace(0, 6, 31)
    assert certified(setup_of("panda", poses, free_rotation="z"), rows, times).certified
    for free in ("none", "x", "y"):
        assert certified(setup_of("panda", poses, free_rotation=free), rows, times).status is Status.OFF_PATH


def test_speeds_of_a_tool_are_kept_or_refused() -> None:
    rng = np.random.default_rng(12)
    robot = setup_of("panda", ANYWHERE).robot
    rows, _ = along(robot, rng)
    poses = poses_of(*tool_poses(robot, rows, TOOLS["panda"]))
    times = np.linspace(0.0, 8.0, len(rows))
    loose = {"position_tolerance": 0.05, "orientation_tolerance": 0.5}
    curve = Curve.through(*rated(rows, times))
    clock = np.linspace(0.0, 8.0, 20001)
    places, _ = tool_poses(robot, curve.at_time(clock), TOOLS["panda"])
    v = np.gradient(places, clock, axis=0)
    fastest = np.linalg.norm(v, axis=1).max()
    hardest = np.linalg.norm(np.gradient(v, clock, axis=0)[2:-2], axis=1).max()
    for name, value in (("speed", fastest), ("acceleration", hardest)):
        kept = certified(setup_of("panda", poses, **loose, **{name: 1.03 * value}), rows, times)
        assert kept.certified, kept.text
        broken = certified(setup_of("panda", poses, **loose, **{name: 0.99 * value}), rows, times)
        assert broken.status is Status.OFF_PATH
        assert f"path.follow.{name}" in broken.text


def test_a_way_beyond_the_radius_between_two_looks_has_its_speed_limited() -> None:
    """The base leaves the radius of its goal, and returns, between two of the places that are checked."""
    rows, rates, second = np.zeros((4, 10)), np.zeros((4, 10)), np.zeros((4, 10))
    rows[:, 3:] = READY
    rows[:, 0], rates[1, 0], second[1, 0] = [0.0, 0.0375, 0.0, 0.2], 2.54, -150.0
    times = np.array([0.0, 0.1, 0.3, 2.3])
    motion = Curve.through(rows, times, rates, second)
    looks, fine = (
        np.abs(np.concatenate([motion.at_time(np.linspace(*span, count))[:, 0] for span in ((0, 0.1), (0.1, 0.3))]))
        for count in (5, 501)
    )
    assert looks.max() < 0.05
    assert fine.max() > 0.06
    robot = setup_of("wheeled", ANYWHERE).robot
    dense = motion.at_time(np.concatenate([np.linspace(0.0, 0.3, 601), np.linspace(0.3, 2.3, 41)[1:]]))
    poses = poses_of(*tool_poses(robot, dense, TOOLS["wheeled"]))
    setup = setup_of("wheeled", poses, position_tolerance=0.04, begin_tolerance=0.05, speed=0.2)
    for slower in (1.0, 100.0):
        own = rates / slower, second / slower**2
        driven = Trajectory(setup.robot.joint_names, rows, setup.robot.locked, times * slower, *own)
        found = Certifier(setup).certify(driven, check_ends=False)
        assert {each.field for each in found.departures} == ({"path.follow.speed"} if slower == 1.0 else set())


def test_bad_curves_are_refused() -> None:
    one, half = ANYWHERE[0], hdplan.Pose.from_rpy([0, 0, 0], [3.1, 0, 0])
    for poses, words in (
        ([one], "must be 2 to 20000 poses, found 1"),
        ([one, half], "turns by 3.1 rad from the pose before"),
        ([one, one.position], "must be a Pose"),
    ):
        with pytest.raises(InputError, match=words):
            hdplan.Follow("tool", poses)
    setup = setup_of("panda", ANYWHERE, speed=0.1)
    slow = setup.changed(limits=hdplan.Limits(velocity=1.0))
    with pytest.raises(InputError, match=r"need limits\.acceleration"):
        Certifier(slow)
    with pytest.raises(InputError, match="a single motion is not planned along a curve"):
        hdplan.plan(setup.requested)


@needs_loops
@pytest.mark.parametrize("axis", ["none", "z"])
def test_places_in_c_are_those_in_numpy(axis: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Poses of the random curves repeat or turn back; places are near them and anywhere else."""
    robot, rng = hdplan.load_robot("panda"), np.random.default_rng(len(axis))
    for count in (2, 3, 40):
        turns = Rotation.from_rotvec(np.cumsum(rng.normal(scale=0.05, size=(count, 3)), axis=0))
        origins = np.cumsum(rng.normal(scale=0.01, size=(count, 3)), axis=0)
        kept = np.sort(rng.integers(count, size=count - 2)) if count > 3 else np.arange(count)
        poses = poses_of(origins[kept], turns.as_matrix()[kept])
        curve = PoseCurve.of(robot, hdplan.Follow("panda_hand", poses, 1e-3, 1e-2, axis))
        along = np.sort(rng.uniform(0.0, len(kept) - 1.0, 120))
        segment = np.minimum(along.astype(int), len(kept) - 2)
        rotations, places = curve.at(segment, along - segment)
        rotations = Rotation.from_rotvec(rng.normal(scale=1e-3, size=(120, 3))).as_matrix() @ rotations
        for off in (1e-4, 0.3):
            near = places + rng.normal(scale=off, size=places.shape)
            found = []
            for begins in (0.0, 0.7):
                given = rotations, near, begins, len(kept) - 1.0
                found.append(curve.places(*given))
                with monkeypatch.context() as without:
                    in_numpy(without, pose_curve)
                    np.testing.assert_allclose(found[-1], curve.places(*given), rtol=0, atol=1e-9)
                assert (np.diff(found[-1]) >= 0.0).all()
                assert found[-1][0] == begins
    nowhere = curve.places(np.full_like(rotations, np.nan), near, 0.0, len(kept) - 1.0)
    assert (nowhere[:-1] == 0.0).all()  # what is not a number leads nowhere


def test_few_nodes_prove_what_many_do_and_more_are_taken_where_they_do_not() -> None:
    """A tool that wheels bring along a line from rest to rest, in one interval, is not where it would be evenly."""
    begins = np.concatenate([np.zeros(3), READY])
    rows = np.stack([begins, begins + 0.2 * np.eye(10)[0]])
    robot = setup_of("wheeled", ANYWHERE).robot
    line = poses_of(*tool_poses(robot, rows, TOOLS["wheeled"]))
    setup = setup_of("wheeled", line, position_tolerance=0.012, orientation_tolerance=1e-2)
    check, still = PathCheck(setup, Chain.of(setup.robot.model)), np.zeros((2, 10))
    motion = Curve.through(rows, np.array([0.0, 1.0]), still, still)
    few, many = ([check._prove(held, held.spans, held.on, motion) for held in check._along(motion, n)] for n in (1, 4))
    assert any(departures for _, departures, _ in few)
    assert not any(departures for _, departures, _ in many)
    assert not check.prove(motion).departures
    assert check.prove(Curve.through(rows + 0.02 * np.eye(10)[1], motion.times, still, still)).departures


@pytest.mark.parametrize("fastest", [0.01, 0.03])
def test_the_end_of_a_curve_that_turns_back_is_not_skipped(fastest: float) -> None:
    """A link that turns to an angle and back is as near to the way back as to the way there, all along."""
    angles = np.concatenate([np.linspace(0.0, 0.5, 30), np.linspace(0.5, 0.0, 30)[1:]])
    turn = [Rotation.from_euler("z", angle) for angle in angles]
    poses = [hdplan.Pose([0.4, 0.0, 0.4], each.as_quat()) for each in turn]
    follow = hdplan.Follow("panda_hand", poses, position_tolerance=1e-4, orientation_tolerance=2e-3)
    curve = PoseCurve.of(hdplan.load_robot("panda"), follow)
    pace = np.clip(np.concatenate([np.linspace(0.0, 1.0, 20), np.ones(10), np.linspace(1.0, 0.0, 20)]), 0.02, 1.0)
    there = np.concatenate([[0.0], np.cumsum(np.tile(pace, 20))])
    there = 0.5 * there[there * fastest <= 0.5] / there[there * fastest <= 0.5][-1]
    driven = np.concatenate([there, there[::-1][1:]]) + 2e-4 * np.sin(np.arange(2 * len(there) - 1))
    rotations = Rotation.from_euler("z", driven[:, None]).as_matrix().reshape(-1, 3, 3)
    places = curve.places(rotations, np.tile([0.4, 0.0, 0.4], (len(driven), 1)), 0.0, float(len(poses) - 1))
    assert (np.diff(places) >= 0.0).all()
    assert np.abs(np.interp(places, np.arange(len(angles)), angles) - driven).max() <= 2e-3
