"""Laws of the exact distance of body pairs: its value is the oracle's, its wrench its derivative, and it
always answers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import coal
import numpy as np
import pytest
from typer.testing import CliRunner

import hdplan
from hdplan.cli import app
from hdplan.distance.baselines.coal import signed_distance, signed_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.planner.collision.broad_phase import body_pairs
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.collision.euclidean import FclPairs
from hdplan.planner.collision.exact import ExactPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_link_body, from_shape
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.clearance import Clearance
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Points, Sphere
from hdplan.scenes.yaml_format.reader import load_scene

MARGIN = 0.02  # [m]
EXACT = 1e-6  # [m]
NO_JOINTS = np.zeros((2, 0), dtype=np.bool_)


def clutter(count: int, seed: int, spread: float = 1.0) -> tuple[HalfspaceBody, ...]:
    """Obstacles of all shapes, in turn."""
    rng = np.random.default_rng(seed)
    bodies = []
    for k in range(count):
        x, y, z = rng.uniform(0.02, 0.4, 3).tolist()
        hull = Points(tuple(map(tuple, (rng.normal(size=(9, 3)) * 0.1).tolist())))
        shape = (Box((x, y, z)), Sphere(x), Cylinder(x, y), Capsule(x / 2, y), hull, Ellipsoid((x, y, z)))[k % 6]
        bodies.append(from_shape(f"body {k}", shape, random_pose(rng, spread).matrix))
    return tuple(bodies)


def random_pose(rng: np.random.Generator, spread: float) -> Pose:
    quaternion = rng.normal(size=4)
    position = rng.uniform(-spread, spread, 3)
    return Pose(tuple(position.tolist()), tuple((quaternion / np.linalg.norm(quaternion)).tolist()))


def free_bodies(count: int, seed: int) -> tuple[LinkBody, ...]:
    """Points, segments, polygons and polytopes, swept by a ball or not, on joint 1."""
    rng = np.random.default_rng(seed)
    points = [rng.normal(size=(1 + k % 7, 3)) * 0.1 for k in range(count)]
    return tuple(
        LinkBody(f"link {k}", 1, ConvexBody.from_points(p, float(rng.choice([0.0, 0.05]) + (len(p) == 1) * 0.01)))
        for k, p in enumerate(points)
    )


def placed(poses: Array) -> KinematicsBatch:
    """A world in which joint 1 stands at poses (B, 4, 4) and moves freely, no coordinate moving it."""
    rows = np.zeros((len(poses), 2, 12))
    rows[:, :, [0, 4, 8]] = 1
    rows[:, 1, :9], rows[:, 1, 9:] = poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]
    return KinematicsBatch(rows, np.zeros((len(poses), 0, 6)))


def fcl(bodies: Sequence[LinkBody], others: Sequence[HalfspaceBody], margin: float = MARGIN) -> FclPairs:
    """Each body against the other of the same number."""
    pairs = body_pairs(bodies, others, [(k, k) for k in range(len(bodies))], margin, NO_JOINTS)
    return FclPairs(pairs, bodies, others)


def poses(count: int, seed: int, spread: float) -> Array:
    rng = np.random.default_rng(seed)
    return np.array([random_pose(rng, spread).matrix for _ in range(count)])


def everything(pairs: FclPairs, at: Array) -> tuple[Array, Array]:
    """D (B, P) and its wrench (B, P, 6) of all pairs at all poses (B, 4, 4)."""
    sample, pair = (index.ravel() for index in np.indices((len(at), len(pairs.pairs))))
    distance, wrench, separation = pairs(placed(at), sample, pair)
    np.testing.assert_array_equal(distance, separation)
    return distance.reshape(len(at), -1), wrench.reshape(len(at), -1, 6)


def convex(body: HalfspaceBody) -> ConvexBody | None:
    """The same body for the oracle; none for a cylinder, which is no swept polytope."""
    match body.shape:
        case Box(size):
            return ConvexBody.box(size)
        case Sphere(radius):
            return ConvexBody.sphere(radius)
        case Capsule(radius, length):
            return ConvexBody.capsule(radius, length)
        case Points(points):
            return ConvexBody.from_points(points)
        case ConvexBody() as shape:
            return shape
    return None


def test_the_value_is_the_exact_distance_less_the_margin() -> None:
    bodies, others, at = free_bodies(40, 1), clutter(40, 2, spread=0.2), poses(20, 3, spread=0.3)
    distance, _ = everything(fcl(bodies, others), at)
    compared = 0
    for k, (body, other) in enumerate(zip(bodies, others, strict=True)):
        if (shape := convex(other)) is not None:
            truth = signed_distances(body.body, at, shape, np.tile(other.placement, (len(at), 1, 1))) - MARGIN
            np.testing.assert_allclose(distance[:, k], truth, rtol=0, atol=EXACT)
            compared += 1
    assert compared > 20
    assert (distance < -MARGIN).any()
    assert (distance > 0).any()


def test_a_cylinder_is_round() -> None:
    """A ball beside, above and at the rim of a cylinder, and inside it."""
    cylinder = Cylinder(0.1, 0.4)
    pairs = fcl((LinkBody("ball", 1, ConvexBody.sphere(0.05)),), (from_shape("post", cylinder, np.eye(4)),), 0.0)
    at = np.tile(np.eye(4), (4, 1, 1))
    at[:, :3, 3] = [[0.18, 0.24, 0.1], [0.03, 0.04, 0.3], [0.4, 0.0, 0.6], [0.03, 0.04, 0.0]]
    distance, _ = everything(pairs, at)
    np.testing.assert_allclose(distance[:, 0], [0.15, 0.05, 0.45, -0.1], rtol=0, atol=EXACT)


def smooth_motions(pairs: ExactPairs | FclPairs, at: Array, step: float, close: float) -> Iterator[tuple[Array, Mask]]:
    """Six velocities of the first bodies, and where the distances have no kink, which shows as one-sided derivatives
    that differ: there the wrench is the derivative."""
    (middle, wrench), rng, checked = everything(pairs, at), np.random.default_rng(7), 0
    for _ in range(6):
        linear, angular = rng.normal(size=(2, 3))
        velocity = np.concatenate([linear, angular])
        ahead, behind = (everything(pairs, moved(at, linear, angular, sign * step))[0] for sign in (1, -1))
        forward, backward = (ahead - middle) / step, (middle - behind) / step
        smooth = np.abs(forward - backward) < close
        np.testing.assert_allclose((wrench @ velocity)[smooth], ((forward + backward) / 2)[smooth], atol=close)
        checked += int(smooth.sum())
        yield velocity, smooth
    assert checked > 0.7 * 6 * middle.size


def test_the_wrench_is_the_derivative_under_a_motion_of_the_first_body() -> None:
    bodies, others, at = free_bodies(40, 4), clutter(40, 5, spread=0.2), poses(10, 6, spread=0.4)
    assert len(list(smooth_motions(fcl(bodies, others), at, 1e-4, 1e-2))) == 6


def moved(at: Array, linear: Array, angular: Array, step: float) -> Array:
    """Poses moved by a twist about the world's origin for a time `step`."""
    angle = np.linalg.norm(angular) * step
    x, y, z = angular / np.linalg.norm(angular)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(4)
    turn[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    turn[:3, 3] = linear * step
    return np.asarray(turn @ at)


def test_the_sign_is_that_of_contact() -> None:
    bodies, others, at = free_bodies(30, 8), clutter(30, 9, spread=0.2), poses(20, 10, spread=0.3)
    pairs = fcl(bodies, others, 0.0)
    distance, _ = everything(pairs, at)
    for k, other in enumerate(others):
        for s, pose in enumerate(at):
            if abs(distance[s, k]) > EXACT:
                found = coal.CollisionResult()
                frames = (
                    coal.Transform3s(pose[:3, :3], pose[:3, 3]),
                    coal.Transform3s(other.placement[:3, :3], other.placement[:3, 3]),
                )
                shapes = pairs.first[k].shape, pairs.second[k].shape
                coal.collide(shapes[0], frames[0], shapes[1], frames[1], coal.CollisionRequest(), found)
                assert found.isCollision() == (distance[s, k] < 0)


def test_parallel_faces_and_common_centres_have_an_answer() -> None:
    """Boxes that touch, overlap or coincide, axes aligned: finite, a lower bound, unit normals; nearly always exact."""
    rng = np.random.default_rng(11)
    sizes = rng.choice([0.1, 0.2, 0.3], size=(60, 3))
    bodies = tuple(LinkBody("link", 1, ConvexBody.box(size)) for size in sizes)
    others = tuple(from_shape("box", Box(tuple(size)), np.eye(4)) for size in rng.permutation(sizes))
    at = np.tile(np.eye(4), (12, 1, 1))
    at[:, :3, 3] = rng.choice([0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3], size=(12, 3))
    distance, wrench = everything(fcl(bodies, others, 0.0), at)
    truth = np.array(
        [
            [signed_distance(a.body, pose, convex(b), np.eye(4)).distance for a, b in zip(bodies, others, strict=True)]
            for pose in at
        ]
    )
    assert np.isfinite(wrench).all()
    np.testing.assert_allclose(np.linalg.norm(wrench[..., :3], axis=-1), 1.0, atol=1e-9)
    assert np.all(distance <= truth + EXACT)
    assert np.mean(distance < truth - EXACT) < 0.01


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot(RobotSpec(name="panda", locked={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04}))


def test_links_among_each_other_and_the_gradient_in_joint_space(panda: Robot) -> None:
    """The chain to the joints holds where both bodies move; the value is the oracle's."""
    collision_model = collision_model_of(panda, "fitted", "box")
    joints = Kinematics(panda.model)
    pairs = body_pairs(collision_model.bodies, collision_model.planes, collision_model.self_pairs, 0.1, joints.supports)
    term = Clearance("self-collision", pairs, FclPairs(pairs, collision_model.bodies, collision_model.planes))
    positions = panda.draw(np.random.default_rng(12), 40)
    kinematics = joints.evaluate(positions)
    inside = term.inside(kinematics)
    assert len(inside.sample) > 50
    for s, p, found in zip(inside.sample, inside.pair, inside.distance, strict=True):
        a, b = collision_model.bodies[pairs.body[p]], collision_model.bodies[pairs.halfspace_body[p]]
        truth = signed_distance(a.body, pose_of(kinematics, s, a.joint), b.body, pose_of(kinematics, s, b.joint))
        assert found + 0.1 == pytest.approx(truth.distance, abs=EXACT)
    step, agree = 1e-5, []
    for j in range(panda.n):
        shift = step * np.eye(panda.n)[j]
        ahead, behind = (
            term.distance(joints.evaluate(q), inside.sample, inside.pair)[0]
            for q in (positions + shift, positions - shift)
        )
        agree.append(np.abs((ahead - behind) / (2 * step) - inside.gradient[:, j]) < 1e-3)
    assert np.mean(agree) > 0.97  # the others are at kinks


def pose_of(kinematics: KinematicsBatch, sample: int, joint: int) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = kinematics.rotations[sample, joint], kinematics.translations[sample, joint]
    return pose


def test_a_link_body_keeps_its_own_frame() -> None:
    body = ConvexBody.from_points(np.random.default_rng(15).normal(size=(6, 3)), 0.1)
    np.testing.assert_array_equal(from_link_body("link", 1, body).placement, np.eye(4))


def with_fcl(name: str) -> Scene:
    scene = load_scene(name)
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, distance="fcl"))


@pytest.mark.core
@pytest.mark.parametrize("name", ["planar_arm", "panda_cage"])
def test_a_plan_by_it_is_certified(name: str) -> None:
    assert hdplan.plan(with_fcl(name)).certified


def test_explain_names_it() -> None:
    done = CliRunner().invoke(app, ["explain", "planar_arm"])
    assert "hdsdf (default)" in done.output
    assert "HD-SDF" in done.output
    sections = explain(hdplan.build(with_fcl("planar_arm")))
    assert "FCL (coal" in dict(sections["size"])["distance"]
    assert dict(sections["settings"])["distance"] == "fcl (scene)"


def test_an_unknown_distance_is_refused_with_the_nearest() -> None:
    scene = load_scene("planar_arm")
    with pytest.raises(hdplan.InputError, match=r"distance: unknown value 'hdsd' \(did you mean 'hdsdf'\?\)"):
        dataclasses.replace(scene.planner, distance="hdsd")
