"""Laws of the checker's arithmetic and kinematics: what it encloses is inside, to the last bit."""

from __future__ import annotations

import ast
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import coal
import mpmath
import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify import RejectedError, balls
from hdplan.verify.balls import Ball
from hdplan.verify.effects import check_limit
from hdplan.verify.kernel import Motion
from hdplan.verify.moving import turn_of
from hdplan.verify.turns import rotation
from hdplan.verify.world import World

from .worlds import read_and_planned, rejects_unless, saved

SOURCE = Path(balls.__file__).parent
KERNEL = ("balls", "bounds", "world", "kernel", "unknown", "effects", "follow", "turns", "verdict")


def imported(module: Path) -> set[str]:
    """The modules that one imports; those of its own folder with a dot."""
    nodes = [*ast.walk(ast.parse(module.read_text(encoding="utf-8")))]
    named = {alias.name for x in nodes if isinstance(x, ast.Import) for alias in x.names}
    parts = ((x, alias.name) for x in nodes if isinstance(x, ast.ImportFrom) for alias in x.names)
    return named | {"." * x.level + (x.module or name) for x, name in parts}


def test_the_checker_imports_nothing_of_hdplan_and_its_kernel_numpy_alone() -> None:
    every = {x.stem for x in SOURCE.glob("*.py")}
    for module in SOURCE.glob("*.py"):
        found = imported(module)
        outside = {name.split(".")[0] for name in found if not name.startswith(".")} - sys.stdlib_module_names
        own = {name[1:] for name in found if name.startswith(".")}
        assert outside <= ({"numpy"} if module.stem in KERNEL else {"numpy", "yaml"})
        assert own <= ({*KERNEL} if module.stem in KERNEL else every)
        assert "yaml" not in outside or module.stem == "text"  # one home


def ball(rng: np.random.Generator, shape: tuple[int, ...]) -> Ball:
    mid = rng.normal(size=shape) * 10.0 ** rng.uniform(-9, 3, shape)
    return Ball(mid, np.abs(mid) * 10.0 ** rng.uniform(-18, -1, shape) * (rng.random(shape) < 0.7))


def corners(x: Ball, rng: np.random.Generator) -> list[Fraction]:
    """Exact numbers that each ball contains, at an end of it."""
    sign = rng.choice([-1, 1], size=x.mid.shape)
    return [Fraction(m) + int(s) * Fraction(r) for m, s, r in zip(x.mid.flat, sign.flat, x.rad.flat, strict=True)]


def inside(x: Ball, exact: list[Fraction]) -> bool:
    return all(abs(Fraction(m) - e) <= Fraction(r) for m, r, e in zip(x.mid.flat, x.rad.flat, exact, strict=True))


@pytest.mark.parametrize("seed", range(20))
def test_balls_contain_exact_results(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = ball(rng, (40,)), ball(rng, (40,))
    x, y = corners(a, rng), corners(b, rng)
    assert inside(a + b, [p + q for p, q in zip(x, y, strict=True)])
    assert inside(a - b, [p - q for p, q in zip(x, y, strict=True)])
    assert inside(a * b, [p * q for p, q in zip(x, y, strict=True)])
    m, n = ball(rng, (5, 9)), ball(rng, (9, 4))
    u, v = np.array(corners(m, rng)).reshape(5, 9), np.array(corners(n, rng)).reshape(9, 4)
    assert inside(balls.dot("ij,jk->ik", m, n), list((u @ v).flat))
    one, two = ball(rng, (3,)), ball(rng, (3,))
    (p, q, r), (s, t, w) = corners(one, rng), corners(two, rng)
    assert inside(balls.cross(one, two), [q * w - r * t, r * s - p * w, p * t - q * s])
    assert all(abs(e) <= Fraction(z) for e, z in zip(x, a.size, strict=True))
    square = sum(e * e for e in x)
    assert square <= Fraction(float(balls.norm(a.size))) ** 2


def test_units_contain_the_exact_direction() -> None:
    rng = np.random.default_rng(0)
    with mpmath.workprec(300):
        for count in (3, 4):
            for v in rng.normal(size=(200, count)) * 10.0 ** rng.uniform(-4, 4, (200, 1)):
                length = mpmath.sqrt(sum(mpmath.mpf(float(e)) ** 2 for e in v))
                found = balls.unit(v)
                for m, r, e in zip(found.mid, found.rad, v, strict=True):
                    assert abs(mpmath.mpf(float(e)) / length - mpmath.mpf(float(m))) <= mpmath.mpf(float(r)) < 1e-13


def test_sines_and_cosines_are_enclosed() -> None:
    rng = np.random.default_rng(1)
    wild = rng.normal(size=3000) * 10.0 ** rng.uniform(-12, 5, 3000)
    near = np.arange(-40, 41) * np.pi / 4
    x = np.concatenate([np.clip(wild, -1e6, 1e6), near, np.nextafter(near, 9), [0.0, -0.0, 5e-324, 1e6, -1e6]])
    cos, sin = balls.cos_sin(x)
    assert max(cos.rad[np.abs(x) < 10].max(), sin.rad[np.abs(x) < 10].max()) < 5e-15
    with mpmath.workprec(200):
        for i, angle in enumerate(x):
            exact = mpmath.mpf(float(angle))
            assert abs(mpmath.cos(exact) - mpmath.mpf(float(cos.mid[i]))) <= mpmath.mpf(float(cos.rad[i]))
            assert abs(mpmath.sin(exact) - mpmath.mpf(float(sin.mid[i]))) <= mpmath.mpf(float(sin.rad[i]))


@pytest.mark.parametrize("x", [1.1e6, np.inf, np.nan])
def test_angles_out_of_reach_are_refused(x: float) -> None:
    with pytest.raises(balls.RejectedError):
        balls.cos_sin([0.0, x])


def test_inverses_contain_the_exact_result() -> None:
    rng = np.random.default_rng(4)
    x = ball(rng, (200,))
    x = balls.Ball(np.abs(x.mid), np.minimum(x.rad, 0.3 * np.abs(x.mid)))
    assert inside(balls.inverse(x), [1 / each for each in corners(x, rng)])
    with pytest.raises(balls.RejectedError):
        balls.inverse(balls.Ball([1.0, 1e-3], [0.0, 1e-2]))


def test_axis_and_angle_of_a_rotation_are_enclosed() -> None:
    rng = np.random.default_rng(6)
    for angle in (1e-5, 0.01, 0.5, np.pi / 2, 2.0, 3.0, 3.1415):
        axis = balls.unit(rng.normal(size=3))
        way = turn_of(rotation(axis, angle), "o")
        assert (np.abs(way.mid - angle * axis.mid) <= way.rad + axis.rad).all()
        assert way.rad.max() < 1e-12 * angle / np.sin(angle)
    for angle in (1e-13, np.pi):
        with pytest.raises(balls.RejectedError, match="turns by"):
            turn_of(rotation(axis, angle), "o")


def motions() -> list[tuple[str, str]]:
    return [(scene, kind) for scene in ("panda_carry", "ur5_table") for kind in ("linear", "cubic", "quintic")]


def random_motion(scene: str, kind: str, folder: Path) -> tuple[World, Curve, Setup]:
    """A random motion of a shipped scene's robot, as the checker and as hdplan read it."""
    rng, setup = np.random.default_rng(len(kind)), Setup.of(hdplan.load_scene(scene))
    n = setup.robot.n
    rates = {"linear": (), "cubic": ("velocities",), "quintic": ("velocities", "accelerations")}[kind]
    rows = setup.query.start + np.cumsum(0.1 * rng.normal(size=(6, n)), axis=0)
    times = None if kind == "linear" else np.cumsum(rng.uniform(0.1, 0.4, 6))
    more = {name: rng.normal(size=(6, n)) for name in rates}
    motion = hdplan.Trajectory(setup.robot.joint_names, rows, dict(setup.robot.locked), times, **more)
    motion.save(folder / "m.json")
    world = read_and_planned(setup, find_scene(scene), folder / "m.json")
    return world, motion.curve, setup


@pytest.mark.parametrize(("scene", "kind"), motions())
def test_intervals_enclose_curve_and_frames(scene: str, kind: str, tmp_path: Path) -> None:
    """Random intervals span many rows, or parts of one: the curve is near the checker's straight line, and its
    frames are Pinocchio's."""
    world, curve, setup = random_motion(scene, kind, tmp_path)
    rng = np.random.default_rng(3)
    wide = [(0.0, 5.0), (0.0, 2.0), (2.0, 5.0), (1.0, 2.0)]
    spans = np.array(wide + [(row + k / 8, row + (k + 1) / 8) for row in range(5) for k in rng.permutation(8)[:3]])
    motion, data = Motion(world, spans), setup.robot.model.createData()
    for k, (low, high) in enumerate(spans):
        for s in (-1.0, 1.0, *rng.uniform(-1, 1, 20)):
            q = curve.at_parameter((low + (high - low) * (s + 1) / 2) / 5)
            assert (np.abs(q - motion.middle[k] - s * motion.step[k]) <= motion.off[k] + 1e-14).all()
        pin.forwardKinematics(setup.robot.model, data, setup.robot.pin_q(motion.middle[k]))
        for j in range(setup.robot.n):
            assert np.abs(motion.turn.mid[k, j] - data.oMi[j + 1].rotation).max() < 1e-13
            assert np.abs(motion.at.mid[k, j] - data.oMi[j + 1].translation).max() < 1e-13
    assert motion.off[:1].max() > 1e-3 > 1e-14 > motion.off[-1].max() or kind != "linear"


@pytest.mark.parametrize(("scene", "kind"), motions())
def test_points_are_seen_from_other_links_where_they_are(scene: str, kind: str, tmp_path: Path) -> None:
    """The point at which a ray begins is enclosed whichever of the two links moves, and hardly
    more is enclosed than that."""
    world, curve, setup = random_motion(scene, kind, tmp_path)
    rng, n, data = np.random.default_rng(4), setup.robot.n, setup.robot.model.createData()
    for _ in range(40):
        low = rng.uniform(0.0, 4.9)
        width = min(10.0 ** rng.uniform(-6, 0), np.floor(low) + 1.0 - low)
        motion, (one, other) = Motion(world, np.array([[low, low + width]])), rng.integers(-1, n, 2).tolist()
        local = rng.normal(size=3)
        found = motion.seen(one, Ball(local), other)
        for s in (0.0, 1.0, *rng.random(8)):
            pin.forwardKinematics(setup.robot.model, data, setup.robot.pin_q(curve.at_parameter((low + width * s) / 5)))
            place = data.oMi[other + 1].actInv(data.oMi[one + 1].act(local))
            assert (np.abs(place - found.mid) <= found.rad + 1e-12).all()
        assert found.rad.max() < 60.0 * motion.most.sum() + 1e-9


@pytest.mark.parametrize(("name", "order"), [("velocity", 1), ("acceleration", 2), ("jerk", 3)])
def test_rates_are_accepted_just_above_their_greatest_value_and_never_below(
    name: str, order: int, tmp_path: Path
) -> None:
    """Random quintics that begin and end at rest, or do not."""
    rng = np.random.default_rng(order)
    _, curve, setup = random_motion("panda_carry", "quintic", tmp_path)
    n = setup.robot.n
    for trial in range(4):
        rates = [rng.normal(size=(6, n)) for _ in range(2)]
        for rate in rates:
            rate[[0, -1]] = 0.0
        times = np.cumsum(rng.uniform(0.1, 0.4, 6))
        motion = hdplan.Trajectory(setup.robot.joint_names, curve.rows, dict(setup.robot.locked), times, *rates)
        motion.save(tmp_path / "m.json")
        world = read_and_planned(setup, find_scene("panda_carry"), tmp_path / "m.json")
        found = motion.curve.at_time(np.linspace(times[0], times[-1], 4001), order)
        greatest = np.abs(found).max(axis=0)
        for factor, good in ((1.03, True), (0.999, False)):
            world.limits = {name: (factor * greatest).tolist()}
            with rejects_unless(good, f"limits.{name}: joint .* is beyond it"):
                check_limit(world, name)
        with pytest.raises(RejectedError, match=r"limits.position: one for every joint"):  # which a world always has
            check_limit(world, "position")
        if order > 1 and trial == 0:
            world.limits = {name: [1e6] * n}
            check_limit(world, name)
            rates[order - 2][-1, 2] = 1e-3
            hdplan.Trajectory(setup.robot.joint_names, curve.rows, dict(setup.robot.locked), times, *rates).save(
                tmp_path / "m.json"
            )
            world = read_and_planned(setup, find_scene("panda_carry"), tmp_path / "m.json")
            world.limits = {name: [1e6] * n}
            with pytest.raises(RejectedError, match="jump"):
                check_limit(world, name)


@pytest.mark.core
@pytest.mark.parametrize(("scene", "kind"), motions())
def test_no_bound_exceeds_the_distance_anywhere_on_its_interval(scene: str, kind: str, tmp_path: Path) -> None:
    """Pairs, intervals and directions are random; the distance is coal's, the bodies those of the loaded robot."""
    world, curve, setup = random_motion(scene, kind, tmp_path)
    robot, rng = setup.robot, np.random.default_rng(5)
    items = {item.name: item for item in robot.collision.geometryObjects}
    solids = {each.name: each for each in setup.scene.obstacles}
    picked = rng.permutation(len(world.pairs))[:40]
    width = 2.0 ** -rng.integers(0, 7, len(picked))
    low = np.floor(rng.random(len(picked)) * 5 / width) * width
    motion = Motion(world, np.stack([low, low + width], axis=1))
    data, placed = robot.model.createData(), pin.GeometryData(robot.collision)
    close = 0
    for k, p in enumerate(picked.tolist()):
        q = curve.at_parameter((low[k] + width[k] * np.linspace(0, 1, 9)) / 5)
        least, best = np.inf, np.zeros(3)
        for each in q:
            pin.updateGeometryPlacements(robot.model, data, robot.collision, placed, robot.pin_q(each))
            ends = []
            for i in world.pairs[p].tolist():
                key, name = world.pieces[i].key, world.pieces[i].name
                if world.pieces[i].kind == "obstacle":
                    pose = solids[name].pose.matrix
                    shape = operations(solids[name].shape).coal(solids[name].shape, name)
                    ends += [shape, coal.Transform3s(pose[:3, :3], pose[:3, 3])]
                    continue
                name = key if key in items else key.replace(" ", "_")
                pose = placed.oMg[robot.collision.getGeometryId(name)]
                ends += [items[name].geometry, coal.Transform3s(pose.rotation, pose.translation)]
            result = coal.DistanceResult()
            distance = coal.distance(*ends, coal.DistanceRequest(), result)
            if distance < least:
                least, best = distance, -np.array(result.normal)
        ways = np.concatenate([[best], best + 0.3 * rng.normal(size=(3, 3)), rng.normal(size=(3, 3))])
        count = len(ways)
        bounds = motion.gaps(np.full(count, k), np.tile(world.pairs[p], (count, 1)), 100 * ways)
        assert (bounds <= max(least, 0.0) + 1e-7).all()
        close += bounds[0] > 0.8 * least > 0
    assert close >= 10  # and many are tight


def test_moving_obstacles_are_where_the_scene_says(tmp_path: Path) -> None:
    """Steady motions and timed poses, against hdplan's own; their times fall between the motion's rows."""
    rng = np.random.default_rng(8)
    pose = hdplan.Pose.from_rpy((2.0, 0.3, 0.5), (0.1, -0.4, 0.9))
    poses = [hdplan.Pose.from_rpy(rng.uniform(2, 3, 3).tolist(), rng.uniform(-1, 1, 3).tolist()) for _ in range(4)]
    poses.insert(2, hdplan.Pose(rng.uniform(2, 3, 3).tolist(), poses[1].quaternion_xyzw))
    motions_ = (hdplan.SteadyMotion((0.1, -0.2, 0.05), (0.3, 0.9, -0.4)), hdplan.SteadyMotion((0.0, 0.1, 0.0)))
    obstacles = [hdplan.Obstacle(f"o{i}", hdplan.Box([0.1, 0.2, 0.3]), pose, None, m) for i, m in enumerate(motions_)]
    timed = hdplan.TimedPoses((0.35, 0.8, 1.1, 1.9, 3.0), tuple(poses))
    obstacles.append(hdplan.Obstacle("timed", hdplan.Sphere(0.1), motion=timed))
    start = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    given = {"obstacles": obstacles, "timing": hdplan.Timing(duration=2.5)}
    file, motion_file, setup, still = saved(hdplan.Scene(robot="panda", start=start, goal=start, **given), tmp_path)
    rows, rates = setup.query.start + 0.1 * rng.normal(size=(6, 7)), rng.normal(size=(6, 7))
    times = np.array([0.0, 0.4, 0.9, 1.3, 2.0, 2.5])
    trajectory = replace(still, positions=rows, times=times, velocities=rates)
    trajectory.save(motion_file)
    world = read_and_planned(setup, file, motion_file)
    refined = np.array(sorted({*times.tolist(), 0.35, 0.8, 1.1, 1.9}))
    assert len(world.control.mid) == len(refined) - 1
    share = rng.random(60)
    low = np.concatenate([np.floor(rng.random(60) * (len(refined) - 1) * 64) / 64, [0.0]])
    motion = Motion(world, np.stack([low, low + 1 / 64], axis=1))
    for piece in [x for x in world.pieces if x.kind == "obstacle"]:
        exact = ObstacleMotion.of(next(each for each in setup.scene.obstacles if each.name == piece.name))
        for k, s in enumerate([*(2 * share - 1), 0.0]):
            now = float(np.interp(low[k] + (s + 1) / 128, np.arange(len(refined)), refined))
            away = np.abs(trajectory.curve.at_time(now) - motion.middle[k, :7] - s * motion.step[k, :7])
            assert away.max() <= motion.off[k, :7].max() + 1e-13
            turn, at = np.eye(3), np.zeros(3)
            chain, joint = [], piece.joint
            while joint >= 0:
                chain, joint = [joint, *chain], world.joints[joint].parent
            for j in chain:
                value = motion.middle[k, j] + s * motion.step[k, j]
                # an axis is known less well where it turns by nearly half a turn, as one of these does
                assert motion.off[k, j] < (1e-11 if world.joints[j].turns else 1e-12)
                if world.joints[j].turns:
                    turn = turn @ rotation(world.joints[j].axis, value).mid
                else:
                    at = at + turn @ world.joints[j].axis.mid * value
            expected = exact.at(np.array([now]))[0]
            assert np.abs(turn @ piece.pose[0].mid - expected[:3, :3]).max() < 1e-12
            assert np.abs(at - expected[:3, 3]).max() < 1e-12
