"""Laws of what is left out: the broad phase drops no pair with D < 0, reach rules out only what never comes near."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
import pytest

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.loops import C
from hdplan.planner.collision import broad_phase
from hdplan.planner.collision.broad_phase import BodyPairs, body_pairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_link_body, from_shape
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.link_bodies import LinkBody, link_bodies
from hdplan.planner.collision.reach import reach_of
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.clearance import Clearance
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Points, Shape, Sphere
from hdplan.scenes.yaml_format.reader import load_scene
from tests.loops import in_numpy, needs_loops

from ..urdf import joint_text, link_text, write_robot
from .test_euclidean import random_pose

MARGIN = 0.02  # [m]
ROUNDING = 1e-9  # [m] by which a body may leave its ball: kinematics to 1e-12, amplified by nothing


def random_shape(rng: np.random.Generator) -> Shape:
    size = rng.uniform(0.02, 0.4, 3)
    match rng.integers(5):
        case 0:
            return Box(tuple(size.tolist()))
        case 1:
            return Sphere(float(size[0]))
        case 2:
            return Cylinder(float(size[0]), float(size[1]))
        case 3:
            return Capsule(float(size[0]) / 2, float(size[1]))
    return Points(tuple(map(tuple, (rng.normal(size=(9, 3)) * size / 2).tolist())))


def clutter(count: int, seed: int, spread: float = 1.0, normals: str = "box") -> tuple[HalfspaceBody, ...]:
    rng = np.random.default_rng(seed)
    return tuple(
        from_shape(f"body {k}", random_shape(rng), random_pose(rng, spread).matrix, normals) for k in range(count)
    )


def hdsdf(pairs: BodyPairs) -> HdsdfPairs:
    return HdsdfPairs(pairs, 2, 1e-3)


def open_wide(pairs: BodyPairs) -> BodyPairs:
    """The same pairs, with boxes so large that the broad phase drops none."""
    return dataclasses.replace(pairs, half_sizes=pairs.half_sizes + 1e3)


def configurations(robot: Robot, count: int, seed: int) -> Array:
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    return np.random.default_rng(seed).uniform(low, high, (count, robot.n))


def assert_nothing_dropped(pairs: BodyPairs, kinematics: KinematicsBatch) -> int:
    """Compare with the evaluation of all pairs at all samples; return how many of them are inside their margin."""
    quick = Clearance("quick", pairs, hdsdf(pairs)).inside(kinematics)
    whole = Clearance("whole", open_wide(pairs), hdsdf(pairs)).inside(kinematics)
    for name in ("sample", "pair", "distance", "separation", "gradient"):
        np.testing.assert_array_equal(getattr(quick, name), getattr(whole, name))
    assert np.all(np.diff(quick.sample) >= 0)
    return len(quick.sample)


@pytest.fixture(params=["compiled", "without a compiler"])
def loops(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The broad phase in both its forms."""
    if request.param == "compiled":
        if C is None:
            pytest.skip("built without a C compiler")
    else:
        in_numpy(monkeypatch, broad_phase)


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot(load_scene("panda_corridor").robot)


@pytest.mark.usefixtures("loops")
def test_nothing_dropped_among_clutter(panda: Robot) -> None:
    """A Panda among 40 bodies of all shapes, at random configurations."""
    bodies, planes = link_bodies(panda), clutter(40, 11)
    kinematics = Kinematics(panda.model)
    every = [(a, b) for a in range(len(bodies)) for b in range(len(planes))]
    pairs = body_pairs(bodies, planes, every, MARGIN, kinematics.supports)
    batch = kinematics.evaluate(configurations(panda, 40, 12))
    inside = assert_nothing_dropped(pairs, batch)
    sample, _ = pairs.close(batch)
    assert 100 < inside <= len(sample) < 0.5 * 40 * len(every)  # and it does leave much out


@pytest.mark.usefixtures("loops")
def test_nothing_dropped_between_links(panda: Robot) -> None:
    """Moving bodies on both sides; base and tip included."""
    bodies = link_bodies(panda)
    planes = [from_link_body(body.link, body.joint, body.body) for body in bodies]
    kinematics = Kinematics(panda.model)
    every = [(a, b) for a in range(len(bodies)) for b in range(len(bodies)) if bodies[a].joint != bodies[b].joint]
    pairs = body_pairs(bodies, planes, every, 0.005, kinematics.supports)
    assert assert_nothing_dropped(pairs, kinematics.evaluate(configurations(panda, 40, 13))) > 100


def still(count: int) -> KinematicsBatch:
    """Nothing but the world, `count` times."""
    return KinematicsBatch(np.tile(np.append(np.eye(3), np.zeros(3)), (count, 1, 1)), np.zeros((count, 1, 6)))


HALF = np.array([0.2, 0.1, 0.3])  # of a box, which stands somewhere
STANDING = random_pose(np.random.default_rng(14), 0.5).matrix


@functools.cache
def probes(radius: float, margin: float) -> tuple[LinkBody, ...]:
    """Small balls around the box at the distance where D changes its sign: in the directions farthest from all
    planes."""
    between = np.array([1, np.sqrt(2) - 1, np.sqrt(3) - np.sqrt(2)])  # equally far from face, edge and corner: 27.6°
    directions = np.array(
        [np.roll(between[list(order)], shift) for order in ([0, 1, 2], [0, 2, 1]) for shift in range(3)]
    )
    directions = np.vstack(
        [directions, np.sqrt([[1, 1, 0]]) @ np.diag([1, np.tan(np.pi / 8), 1]), np.eye(3), np.ones((1, 3))]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    edges = np.array([1 / np.cos(np.radians(27.6)), np.sqrt(3)])[:, None]  # where box and faces alone begin to separate
    shares = np.concatenate([np.linspace(0.8, 1.8, 41), (edges + np.linspace(-1e-3, 1e-3, 11)).ravel()])
    reach = (radius + margin) * shares
    corners = HALF * signs[:, None, None] + signs[:, None, None] * directions[:, None] * reach[:, None]
    middles = corners.copy()
    middles[..., 2] *= 0.3  # beside edges and faces
    places = np.concatenate([corners.reshape(-1, 3), middles.reshape(-1, 3)]) @ STANDING[:3, :3].T + STANDING[:3, 3]
    return tuple(LinkBody("probe", 0, ConvexBody.from_points([place], radius)) for place in places)


def assert_probes_kept(bodies: Sequence[LinkBody], plane: HalfspaceBody, margin: float) -> int:
    every = [(a, 0) for a in range(len(bodies))]
    return assert_nothing_dropped(body_pairs(bodies, [plane], every, margin, np.zeros((1, 1), np.bool_)), still(1))


@pytest.mark.sampled(5)
@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("normals", ["faces", "box", "sphere"])
@pytest.mark.parametrize(("radius", "margin"), [(1e-4, 0.0), (1e-4, 0.02), (0.01, 0.0), (0.3, 0.02)])
def test_nothing_dropped_near_corners_and_edges(radius: float, margin: float, normals: str) -> None:
    """Small balls around a box, where D changes its sign."""
    plane = from_shape("box", Box(tuple((2 * HALF).tolist())), STANDING, normals)
    bodies = probes(radius, margin)
    inside = assert_probes_kept(bodies, plane, margin)
    assert 0 < inside < len(bodies)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("normals", ["faces", "box", "sphere"])
@pytest.mark.parametrize("seed", range(4))
def test_nothing_dropped_around_any_shape(seed: int, normals: str) -> None:
    """Small bodies scattered over the rim of bodies of all shapes, where the decision is close."""
    rng = np.random.default_rng(20 + seed)
    found = 0
    for plane in clutter(6, 30 + seed, 0.3, normals):
        local = rng.uniform(-1.3, 1.3, (400, 3)) * (plane.half_size + 0.02)
        bodies = [
            LinkBody("probe", 0, ConvexBody.from_points(place + rng.uniform(-0.02, 0.02, (2, 3)), 0.005))
            for place in local @ plane.box[:3, :3].T + plane.box[:3, 3]
        ]
        found += assert_probes_kept(bodies, plane, 0.005)
    assert found > 100


@needs_loops
def test_pairs_that_the_compiled_loops_leave_are_inside_their_margin(panda: Robot) -> None:
    """Planes decide as the distance's sign does: but for rounding, nothing is evaluated that does not count."""
    bodies = link_bodies(panda)
    planes = [*clutter(30, 17), *(from_link_body(body.link, body.joint, body.body) for body in bodies)]
    kinematics = Kinematics(panda.model)
    every = [
        (a, b) for a in range(len(bodies)) for b in range(len(planes)) if b < 30 or planes[b].joint != bodies[a].joint
    ]
    pairs = body_pairs(bodies, planes, every, MARGIN, kinematics.supports)
    batch = kinematics.evaluate(configurations(panda, 60, 18))
    sample, pair = pairs.close(batch)
    distance, _, separation = hdsdf(pairs)(batch, sample, pair)
    assert len(sample) > 1000
    assert (separation < 2e-9).all()
    assert (distance < 2e-9).all()


def test_tables_say_what_the_pairs_are(panda: Robot) -> None:
    """Rows, joints, signs of motion and the margin, pair by pair, for halfspace bodies of both sizes."""
    bodies, kinematics = link_bodies(panda), Kinematics(panda.model)
    planes = [*clutter(5, 15), from_link_body(bodies[2].link, bodies[2].joint, bodies[2].body)]
    some = [(a, b) for a in range(0, len(bodies), 2) for b in range(len(planes)) if (a + b) % 3]
    pairs = body_pairs(bodies, planes, some, MARGIN, kinematics.supports)
    assert len(pairs) == len(some)
    for row, (a, b) in enumerate(some):
        body, plane, slots = bodies[a], planes[b], int(pairs.plane_slots[row])
        numbers = pairs.plane_tables[slots][pairs.plane_row[row]]
        np.testing.assert_array_equal(numbers[: 3 * slots].reshape(-1, 3), plane.normals)
        np.testing.assert_array_equal(numbers[3 * slots :], plane.supports + MARGIN)
        values, count = pairs.body_table[pairs.body[row]], len(body.body.vertices)
        m = (len(values) - 1) // 4
        np.testing.assert_array_equal(values[: 3 * count].reshape(-1, 3), body.body.vertices)
        np.testing.assert_array_equal(values[3 * m : 4 * m], np.arange(m) < count)
        assert values[-1] == body.body.radius
        assert (pairs.joint_a[row], pairs.joint_b[row]) == (body.joint, plane.joint)
        moves = kinematics.supports[body.joint].astype(int) - kinematics.supports[plane.joint].astype(int)
        np.testing.assert_array_equal(pairs.moves[row], moves)


ARMS = ["planar_arm", "panda_corridor", "ur5_table", "kinova_shelf", "sliding"]
SLIDING = (
    link_text("base"),
    link_text("cart", box="0.2 0.1 0.1"),
    link_text("arm", box="0.1 0.1 0.6", at="0 0 0.3"),
    link_text("tool", sphere=0.05, at="0.1 0 0"),
    joint_text(
        "rail", "base", "cart", "0 0.6 0.8", kind="prismatic", at="0.3 0 0.1", rpy="0 0.4 0", limits=(-1.2, 0.4)
    ),
    joint_text("turn", "cart", "arm", "1 0 0", kind="continuous", at="0 0 0.1"),
    joint_text("out", "arm", "tool", kind="prismatic", at="0 0 0.5", limits=(0, 0.7)),
)


@pytest.fixture(scope="module", params=ARMS)
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    base = Pose((0.4, -0.3, 0.7), (0.0, 0.6, 0.0, 0.8))
    if request.param == "sliding":
        urdf = write_robot(tmp_path_factory.mktemp("robot") / "sliding.urdf", *SLIDING)
        return load_robot(RobotSpec(urdf=urdf, base=base))
    return load_robot(dataclasses.replace(load_scene(request.param).robot, base=base))


def extremes(robot: Robot, count: int, seed: int) -> Array:
    """Random configurations, half of them with every joint at one of its limits or stretched out."""
    rng = np.random.default_rng(seed)
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    limits = np.where(rng.random((count // 2, robot.n)) < 0.5, low, high)
    return np.vstack([configurations(robot, count - count // 2, seed), limits, np.clip(np.zeros(robot.n), low, high)])


def test_no_body_leaves_its_reach(arm: Robot) -> None:
    bodies, kinematics = link_bodies(arm), Kinematics(arm.model)
    batch = kinematics.evaluate(extremes(arm, 400, 16))
    for body in bodies:
        if body.joint == 0:
            continue
        reach = reach_of(arm, body.joint, body.body)
        points = np.einsum("bij,vj->bvi", batch.rotations[:, body.joint], body.body.vertices)
        points += batch.translations[:, body.joint, None]
        farthest = np.linalg.norm(points - reach.centre, axis=2).max() + body.body.radius
        assert farthest <= reach.radius + ROUNDING
