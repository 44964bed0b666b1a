"""Laws of the certificate: never optimistic, close to the truth, and no way through a plate, a link or a hollow."""

from __future__ import annotations

import dataclasses
import gc
import math
import weakref
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.interpolate import make_interp_spline
from scipy.spatial import ConvexHull

import hdplan
from hdplan import InputError, Obstacle, Pose, Robot, RobotSpec, Scene, Trajectory, build, load_robot, load_scene
from hdplan.planner.certificate import collision_proof, intervals, solids
from hdplan.planner.certificate.certifier import Certifier, certify, check_configuration
from hdplan.planner.certificate.exact_proximity import Piece, best_direction, link_pieces, mesh_pieces, obstacle_pieces
from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.control.controller import Controller
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.geometry.opened import with_content
from hdplan.planner.motion.motion_bounds import Chain, Motion
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import time_limit
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Shape, Sphere
from hdplan.scenes.targets import JointTarget

from ..urdf import joint_text, link_text, robot_text, write_robot

BRANCHED = (
    link_text("base"),
    link_text("turret", box="0.3 0.2 0.1"),
    link_text("mast", cylinder=(0.05, 0.4), at="0 0 0.3", rpy="0.3 0 0"),
    link_text("left", box="0.4 0.06 0.08", at="0.2 0 0"),
    link_text("right", sphere=0.1, at="0.2 0 0"),
    joint_text("turn", "base", "turret", at="0.1 0 0.2", rpy="0.1 0.2 0", limits=(-3, 3)),
    joint_text("lift", "turret", "mast", "0.1 0 1", kind="prismatic", at="0 0 0.1", rpy="0.2 0 0.4", limits=(-0.5, 1)),
    joint_text("swing", "mast", "left", "1 1 0", kind="continuous", at="0 0.2 0.5", rpy="0 0.5 0"),
    joint_text("nod", "mast", "right", "0 1 0.2", at="0 -0.2 0.5", limits=(-2, 2)),
)


@pytest.fixture(scope="module")
def branched_urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("robot") / "branched.urdf", *BRANCHED)


def scene_of(spec: RobotSpec, start: Array, goal: Array, *obstacles: Obstacle) -> Scene:
    ends = (JointTarget(f, tuple(q.tolist())) for f, q in (("start", start), ("goal", goal)))
    return Scene("test", Path("test.yaml"), spec, obstacles, *ends)


def certificate(spec: RobotSpec, waypoints: Array, *obstacles: Obstacle, required: float = 0.0) -> Certificate:
    scene, robot = scene_of(spec, waypoints[0], waypoints[-1], *obstacles), load_robot(spec)
    return certify(scene, Trajectory(robot.joint_names, waypoints), robot, required=required)


def random_pose(rng: np.random.Generator, reach: float) -> Pose:
    quaternion = rng.normal(size=4)
    position = rng.uniform(-reach, reach, size=3) + [0.0, 0.0, 0.4]
    return Pose(tuple(position.tolist()), tuple((quaternion / np.linalg.norm(quaternion)).tolist()))


def random_obstacles(rng: np.random.Generator, count: int, folder: Path, reach: float = 0.9) -> tuple[Obstacle, ...]:
    sizes = rng.uniform(0.05, 0.25, size=(count, 3)).tolist()
    torus = folder / "torus.stl"
    trimesh.creation.torus(0.2, 0.05, major_sections=16, minor_sections=8).export(torus)
    kinds: list[Shape] = []
    for i, (x, y, z) in enumerate(sizes):
        cloud = tuple(tuple(p) for p in rng.normal(0, 0.08, size=(12, 3)).tolist())
        kinds.append(
            (
                *(Box((x, y, z)), Sphere(x), Cylinder(x / 2, z), Capsule(x / 3, z), Points(cloud), Mesh(torus)),
                Ellipsoid((x, y / 2, z / 3)),
            )[i % 7]
        )
    return tuple(Obstacle(f"thing{i}", shape, random_pose(rng, reach)) for i, shape in enumerate(kinds))


def random_waypoints(rng: np.random.Generator, robot: Robot, rows: int, step: float) -> Array:
    low, high = np.clip(robot.lower, -3, 3), np.clip(robot.upper, -3, 3)
    walk = rng.uniform(low, high) + step * rng.normal(size=(rows, robot.n)).cumsum(axis=0)
    return np.clip(walk, low, high)


def plain(shape: Shape) -> coal.CollisionGeometry:
    """The obstacle for coal, built here, not by the code under test."""
    match shape:
        case Box(size):
            return coal.Box(*size)
        case Sphere(radius):
            return coal.Sphere(radius)
        case Ellipsoid(radii):
            return coal.Ellipsoid(*radii)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case Capsule(radius, length):
            return coal.Capsule(radius, length)
        case Points(points):
            cloud = coal.StdVec_Vec3s()
            cloud.extend([np.array(point) for point in points])
            return coal.Convex.convexHull(cloud, True, "Qt")
        case Mesh(file):
            return coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(file), np.ones(3))


def sampled(robot: Robot, obstacles: tuple[Obstacle, ...], q: Array) -> tuple[dict[tuple[str, str], float], ...]:
    """Distances of all pairs in one configuration by plain coal on the robot's own geometry: obstacles, then links."""
    model, geometry = robot.model, robot.collision
    placed = geometry.createData()
    pin.updateGeometryPlacements(model, model.createData(), geometry, placed, robot.pin_q(q))
    links = [
        (
            link,
            geometry.geometryObjects[i].geometry,
            coal.Transform3s(placed.oMg[i].rotation, placed.oMg[i].translation),
        )
        for link, indices in robot.link_geometry.items()
        for i in indices
    ]
    things = [
        (o.name, plain(o.shape), coal.Transform3s(o.pose.matrix[:3, :3], o.pose.matrix[:3, 3])) for o in obstacles
    ]
    found: tuple[dict[tuple[str, str], float], ...] = ({}, {})
    together = {frozenset(pair) for pair in robot.self_pairs}
    wanted = [(0, a, b) for a in links if robot.link_joint[a[0]] for b in things]
    wanted += [(1, a, b) for a in links for b in links if a[0] != b[0] and frozenset((a[0], b[0])) in together]
    for group, (a, shape_a, pose_a), (b, shape_b, pose_b) in wanted:
        distance = coal.distance(shape_a, pose_a, shape_b, pose_b, coal.DistanceRequest(), coal.DistanceResult())
        found[group][a, b] = min(found[group].get((a, b), np.inf), distance)
    return found


# --- never optimistic -----------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize(  # sampling the meshes of xarm7, of 5000 triangles each, takes seconds
    ("name", "count", "looks"),
    [("panda", 3, 25), ("ur5", 3, 25), ("branched", 6, 25), ("xarm7", 1, 25)]
    + [pytest.param(name, 8, 60, marks=pytest.mark.slow) for name in ("panda", "ur5", "branched", "xarm7")],
)
def test_dense_sampling_never_refutes_it_and_it_is_tight(
    name: str, count: int, looks: int, branched_urdf: Path, tmp_path: Path
) -> None:
    spec = RobotSpec(urdf=branched_urdf) if name == "branched" else RobotSpec(name=name)
    robot = load_robot(spec)
    rng = np.random.default_rng(len(name))
    verdicts = []
    for _ in range(count):
        waypoints = random_waypoints(rng, robot, 4, 0.15)
        obstacles = random_obstacles(rng, 6, tmp_path)
        found = certificate(spec, waypoints, *obstacles)
        path = Trajectory(robot.joint_names, waypoints)
        failed = {(place.interval, frozenset((place.link, place.other))) for place in found.failures}
        smallest = [np.inf, np.inf]
        for time in rng.uniform(size=looks):
            for group, distances in enumerate(sampled(robot, obstacles, path.at(time))):
                for pair, distance in distances.items():
                    if (int(time * 3), frozenset(pair)) not in failed:
                        assert distance > 0.0, f"{pair} touch at {time}, and the certificate does not say so"
                        smallest[group] = min(smallest[group], distance)
        for proven, least in zip((found.clearance, found.self_clearance), smallest, strict=True):
            if proven is not None:
                assert 0.0 < proven <= least + 1e-6
        if found.clearance is not None and found.worst is not None:
            tolerance = max(5e-4, 0.05 * found.worst.distance)
            assert found.worst.distance - tolerance <= found.clearance <= found.worst.distance
        verdicts.append(found.status)
    assert {Status.CERTIFIED, Status.IN_CONTACT} & set(verdicts)


def test_every_contact_found_is_one(tmp_path: Path) -> None:
    spec = RobotSpec(name="panda")
    robot, rng = load_robot(spec), np.random.default_rng(3)
    waypoints, obstacles = random_waypoints(rng, robot, 4, 0.3), random_obstacles(rng, 12, tmp_path, 0.5)
    found = certificate(spec, waypoints, *obstacles)
    assert found.status is Status.IN_CONTACT
    path = Trajectory(robot.joint_names, waypoints)
    for place in found.failures:
        env, own = sampled(robot, obstacles, path.at(place.parameter))
        either = {frozenset(pair): value for pair, value in {**env, **own}.items()}
        assert either[frozenset((place.link, place.other))] <= 1e-6


def test_what_is_known_of_a_body_goes_with_it() -> None:
    """A robot that is loaded again and again leaves nothing behind but what its cache keeps."""
    robot = load_robot(RobotSpec("ur5"))
    chain, bodies = Chain.of(robot.model), solids.link_bodies.__wrapped__(robot)  # type: ignore[attr-defined]
    about = [intervals._around(chain, body) for body in bodies]
    assert about == [body.around(chain) for body in bodies]
    left = [weakref.ref(each) for each in (chain, *bodies)]
    del chain, bodies
    gc.collect()
    assert [each() for each in left] == [None] * len(left)


def test_long_motions_bounded_in_few_parts_first_have_the_same_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the parts are, what is proven is no more than what samples find, and all that touches is found."""
    rng, verdicts = np.random.default_rng(17), []
    spec = RobotSpec(name="panda")
    robot = load_robot(spec)
    for count in (0, 1, 12):
        obstacles, rows = random_obstacles(rng, count, tmp_path, 0.5), random_waypoints(rng, robot, 6, 0.1)
        motion = Trajectory(robot.joint_names, make_interp_spline(np.arange(6.0), rows)(np.linspace(0.0, 5.0, 44)))
        certifier = Certifier(Setup.of(scene_of(spec, motion.positions[0], motion.positions[-1], *obstacles)))
        found = []
        for roots in (1000, 2):  # of one interval, and of up to 16
            monkeypatch.setattr(collision_proof, "ROOTS", roots)
            found.append(certifier.certify(motion, check_ends=False))
        fine, coarse = found
        touching = {(place.link, place.other) for place in fine.failures}
        least = [math.inf, math.inf]
        for time in np.linspace(0.0, 1.0, 61) if fine.certified else ():
            for group, place in enumerate(certifier.nearest(motion.at(float(time)))):
                least[group] = min(least[group], math.inf if place is None else place.distance)
        assert coarse.status is fine.status
        assert {(place.link, place.other) for place in coarse.failures} == touching
        assert {place.interval for place in coarse.failures} == {place.interval for place in fine.failures}
        for proven, sampled_least in zip((coarse.clearance, coarse.self_clearance), least, strict=True):
            assert proven is None or proven <= sampled_least + 1e-9
        verdicts.append(fine.certified)
    assert {True, False} == set(verdicts)


# --- what must not pass ---------------------------------------------------------------------------

PLANAR = robot_text(
    link_text("base"),
    link_text("arm", box="1 0.02 0.02", at="0.5 0 0"),
    link_text("fore", box="0.7 0.02 0.02", at="0.4 0 0.05"),
    link_text("hand", box="0.9 0.02 0.02", at="0.5 0 -0.05"),
    joint_text("shoulder", "base", "arm", kind="continuous"),
    joint_text("elbow", "arm", "fore", at="1 0 0", limits=(-4, 4)),
    joint_text("wrist", "fore", "hand", at="0.8 0 0.05", limits=(-4, 4)),
    name="planar",
)


def test_a_place_looked_at_first_changes_no_verdict(tmp_path: Path) -> None:
    """Wherever it is: contact is found all the same, and what is free is certified with what it keeps."""
    rng, verdicts = np.random.default_rng(31), []
    spec = RobotSpec(name="panda")
    robot = load_robot(spec)
    for _ in range(12):
        obstacles, waypoints = random_obstacles(rng, 3, tmp_path), random_waypoints(rng, robot, 5, 0.3)
        certifier = Certifier(Setup.of(scene_of(spec, waypoints[0], waypoints[-1], *obstacles)))
        motion = Trajectory(robot.joint_names, waypoints)
        whole = certifier.certify(motion, check_ends=False)
        for suspect in ((0, 0.0), (int(rng.integers(4)), float(rng.uniform())), (3, 1.0)):
            first = certifier.certify(motion, check_ends=False, suspect=suspect)
            assert first.status is whole.status
            if first.certified:
                assert first.clearance == pytest.approx(whole.clearance, rel=0.1, abs=1e-3)  # within the tolerances
        verdicts.append(whole.certified)
    assert {True, False} == set(verdicts)


@pytest.fixture(scope="module")
def planar(tmp_path_factory: pytest.TempPathFactory) -> RobotSpec:
    path = tmp_path_factory.mktemp("robot") / "planar.urdf"
    path.write_text(PLANAR)
    return RobotSpec(urdf=path)


def swing(spec: RobotSpec, angle: float, *obstacles: Obstacle, required: float = 0.0) -> Certificate:
    return certificate(spec, np.array([[-angle, 0.0, 0.0], [angle, 0.0, 0.0]]), *obstacles, required=required)


def test_a_thin_plate_between_two_free_waypoints(planar: RobotSpec) -> None:
    for angle in (0.001, 0.2):  # the first plate is thinner than the arm is from both ends of the motion
        plate = Obstacle("plate", Box((0.1, 1e-4, 0.5)), Pose((0.7, 0.05 * angle, 0.0)))
        found = swing(planar, angle if angle > 0.1 else 0.05, plate)
        assert found.status is Status.IN_CONTACT
        assert (found.failures[0].link, found.failures[0].other) == ("arm", "plate")
        assert found.failures[0].distance < 0.0
        assert found.clearance is None
        assert "arm and plate overlap" in found.text


@pytest.mark.parametrize(("gap", "status"), [(1e-3, "certified"), (1e-5, "certified"), (0.0, "not"), (-1e-5, "not")])
def test_grazing(planar: RobotSpec, gap: float, status: str) -> None:
    """The hand's tip, 2.25 m out, passes a ball on the circle that it draws: tangent to it, from outside."""
    tip = np.hypot(2.75, 0.01)
    ball = Obstacle("ball", Sphere(0.1), Pose((tip + 0.1 + gap, 0.0, 0.0)))
    found = swing(planar, 0.3, ball)
    assert (found.status is Status.CERTIFIED) == (status == "certified")
    if found.clearance is not None:
        assert 0.5 * gap <= found.clearance <= gap


def test_required_clearance(planar: RobotSpec) -> None:
    ball = Obstacle("ball", Sphere(0.1), Pose((np.hypot(2.75, 0.01) + 0.11, 0.0, 0.0)))
    assert swing(planar, 0.3, ball, required=0.009).certified
    found = swing(planar, 0.3, ball, required=0.0105)
    assert found.status is Status.TOO_CLOSE
    assert found.failures[0].distance == pytest.approx(0.01, abs=5e-4)


def test_self_collision(planar: RobotSpec) -> None:
    folded = np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 3.0]])  # the hand swings across the arm, at its height or below it
    below = Path(str(planar.urdf)).with_name("below.urdf")
    below.write_text(PLANAR.replace('xyz="0.5 0 -0.05"', 'xyz="0.5 0 -0.1"'))
    assert certificate(RobotSpec(urdf=below), folded).certified
    found = certificate(planar, folded)
    assert found.status is Status.IN_CONTACT
    assert {found.failures[0].link, found.failures[0].other} == {"arm", "hand"}
    assert found.self_clearance is None


def ball_of(folder: Path, solid: bool) -> Obstacle:
    """A hollow ball of 0.5 m, wall 0.05 m: closed, or filled up."""
    ball = trimesh.creation.icosphere(2, 0.5)
    if not solid:
        inner = trimesh.creation.icosphere(2, 0.45)
        inner.invert()
        ball = trimesh.util.concatenate([ball, inner])
    torus = trimesh.creation.torus(3.0, 0.1, major_sections=12, minor_sections=6)  # keeps the whole from being convex
    mesh = trimesh.util.concatenate([ball, torus])
    mesh.export(folder / f"ball{solid}.stl")
    return Obstacle("ball", Mesh(folder / f"ball{solid}.stl"))


def test_inside_a_mesh_and_inside_its_cavity(planar: RobotSpec, tmp_path: Path) -> None:
    """An arm that turns within a ball never meets its surface: it collides with a solid one, not with a hollow."""
    arm, joint_ = (
        link_text("arm", box="0.3 0.1 0.1", at="0.1 0 0"),
        joint_text("turn", "base", "arm", kind="continuous"),
    )
    short = write_robot(tmp_path / "short.urdf", link_text("base"), arm, joint_)
    turn = np.array([[0.0], [1.0], [2.0]])
    hollow, solid = (ball_of(tmp_path, filled) for filled in (False, True))
    assert certificate(RobotSpec(urdf=short), turn, hollow).certified
    assert certificate(RobotSpec(urdf=short), turn, solid).status is Status.IN_CONTACT
    open_ball = trimesh.creation.icosphere(2, 0.5)
    open_ball.faces = open_ball.faces[1:]  # not closed: only its triangles and the winding number tell
    open_ball.export(tmp_path / "open.stl")
    leaky = Obstacle("ball", Mesh(tmp_path / "open.stl"))
    found = certificate(RobotSpec(urdf=short), turn, leaky)
    assert found.status is Status.IN_CONTACT
    assert check_configuration(
        scene_of(RobotSpec(urdf=short), turn[0], turn[0], leaky), load_robot(RobotSpec(urdf=short)), turn[0]
    )


def test_a_ball_inside_a_link_that_is_not_convex() -> None:
    spec = RobotSpec(name="ur5")
    robot = load_robot(spec)
    q = np.zeros(robot.n)
    placement = pin.SE3(np.eye(3), np.zeros(3))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.pin_q(q))
    item = robot.collision.geometryObjects[robot.link_geometry["forearm_link"][0]]
    pieces = link_pieces(item.geometry, "forearm_link")
    assert len(pieces) > 1  # cut, and each piece still knows its solid
    solid = pieces[0].surface.solid.mesh
    placement = data.oMi[item.parentJoint] * item.placement
    mesh = trimesh.Trimesh(solid.vertices, solid.triangles)
    inside = next(p for p in mesh.triangles_center - 0.01 * mesh.face_normals if abs(solid.winding_number(p)) > 0.9)
    ball = Obstacle("ball", Sphere(1e-3), Pose(tuple((placement * inside).tolist())))
    found = certificate(spec, np.stack([q, q]), ball)
    assert found.status is Status.IN_CONTACT
    assert "forearm_link" in {place.link for place in found.failures}


def test_cut_pieces_hold_the_whole_surface() -> None:
    """Random points of a link's triangles lie in the hull of one of its pieces, to the rounding of the cuts."""
    robot = load_robot(RobotSpec(name="ur5"))
    item = robot.collision.geometryObjects[robot.link_geometry["forearm_link"][0]]
    pieces = link_pieces(item.geometry, "forearm_link")
    solid = pieces[0].surface.solid.mesh
    points, _ = trimesh.sample.sample_surface(trimesh.Trimesh(solid.vertices, solid.triangles), 2000, seed=3)
    hulls = [ConvexHull(piece.vertices).equations for piece in pieces]
    outside = np.min([(points @ hull[:, :3].T + hull[:, 3]).max(axis=1) for hull in hulls], axis=0)
    assert outside.max() < 1e-9
    area = sum(trimesh.Trimesh(p.surface.mesh.vertices, p.surface.mesh.triangles).area for p in pieces if p.surface)
    assert area == pytest.approx(trimesh.Trimesh(solid.vertices, solid.triangles).area, rel=1e-9)


# --- the motion bounds ----------------------------------------------------------------------------


@pytest.mark.sampled(5)
@pytest.mark.parametrize("leaving", [0.0, 0.3], ids=["straight", "curved"])
@pytest.mark.parametrize("name", ["panda", "kinova", "branched"])
def test_no_point_moves_farther_than_its_bounds(name: str, leaving: float, branched_urdf: Path) -> None:
    robot = load_robot(RobotSpec(urdf=branched_urdf) if name == "branched" else RobotSpec(name=name))
    chain, rng = Chain.of(robot.model), np.random.default_rng(2)
    items = [item for item in robot.collision.geometryObjects if item.parentJoint]
    pieces = [link_pieces(item.geometry, item.name)[0] for item in items]
    points = [
        p.vertices @ item.placement.rotation.T + item.placement.translation
        for p, item in zip(pieces, items, strict=True)
    ]
    joints = np.array([item.parentJoint for item in items])
    sharp = []
    for _ in range(40):
        middle = rng.uniform(np.clip(robot.lower, -3, 3), np.clip(robot.upper, -3, 3))
        delta = rng.normal(size=robot.n) * 10.0 ** rng.uniform(-2.5, 0)
        deviation = leaving * rng.uniform(size=robot.n) * np.abs(delta).max()
        most = np.abs(delta) + deviation
        travel = np.stack([middle - most, middle + most], axis=1)
        rho = np.array(
            [chain.reach(int(joint), cloud, 0.0, travel) for joint, cloud in zip(joints, points, strict=True)]
        )
        turned, moved = chain.frames(robot.pin_q(middle)[None])
        axes, origins = np.einsum("nij,nj->ni", turned[0, 1:], chain.axes), moved[0, 1:]
        centers = np.array([turned[0, j] @ c.mean(axis=0) + moved[0, j] for j, c in zip(joints, points, strict=True)])
        radii = np.array([np.linalg.norm(c - c.mean(axis=0), axis=1).max() for c in points])
        local = chain.local_reach(rho, joints, centers[None], radii, axes[None], origins[None], most[None])[0]
        count = len(items)
        masked, left = delta * chain.carried_by[joints], deviation * chain.carried_by[joints]
        bounds = [
            Motion.of(chain, masked, left, np.tile(axes, (count, 1, 1)), np.tile(origins, (count, 1, 1)), reach)
            for reach in (rho, local)
        ]
        for s in (*rng.uniform(-1, 1, size=3), 1.0, -1.0):
            away = deviation * rng.choice([-1.0, 1.0], size=robot.n)
            turned_s, moved_s = chain.frames(robot.pin_q(middle + s * delta + away)[None])
            for i, (joint, cloud) in enumerate(zip(joints, points, strict=True)):
                before = cloud @ turned[0, joint].T + moved[0, joint]
                after = cloud @ turned_s[0, joint].T + moved_s[0, joint]
                for motion in bounds:
                    linear = np.cross(motion.omega[i], before) + motion.velocity[i]
                    assert np.linalg.norm(after - before, axis=1).max() <= motion.first[i] + 1e-12
                    assert np.linalg.norm(after - before - s * linear, axis=1).max() <= motion.second[i] + 1e-12
                if abs(s) == 1.0:
                    sharp.append(np.linalg.norm(after - before, axis=1).max() / bounds[1].first[i])
    assert np.median(sharp) > 0.2  # bounds that are true but useless would pass the law above


# --- exact proximity ------------------------------------------------------------------------------


def random_pieces(rng: np.random.Generator) -> list[Piece]:
    flat = tuple((x, y, 1e-6 * x * y) for x, y in rng.normal(size=(5, 2)).tolist())
    cloud = tuple(tuple(p) for p in rng.normal(size=(20, 3)).tolist())
    shapes = [Box((1.0, 0.5, 0.2)), Sphere(0.4), Cylinder(0.3, 0.8), Capsule(0.2, 0.7), Points(cloud), Points(flat)]
    shapes.append(Ellipsoid((0.1, 0.5, 1.0)))
    return [obstacle_pieces(with_content(Obstacle("x", shape), "obstacles"))[0] for shape in shapes]


def test_support_bounds_hold_for_the_points_of_each_shape() -> None:
    """max d·x over points of the shape stays below the support and comes close to it; box and ball enclose them."""
    rng = np.random.default_rng(5)
    for piece in random_pieces(rng):
        weights = rng.dirichlet(np.full(len(piece.vertices), 0.2), size=4000)
        ball = rng.normal(size=(4000, 3))
        angle = rng.uniform(0, 2 * np.pi, size=4000)
        inside = weights @ piece.vertices
        inside = inside + piece.ball * ball / np.linalg.norm(ball, axis=1, keepdims=True)
        if piece.radii is not None:
            inside = inside + piece.radii * ball / np.linalg.norm(ball, axis=1, keepdims=True)
        inside = inside + piece.disc * np.c_[np.cos(angle), np.sin(angle), np.zeros(4000)]
        directions = rng.normal(size=(50, 3)) * 3
        largest = (directions @ inside.T).max(axis=1)
        support = piece.support(directions)
        assert np.all(largest <= support + 1e-12)
        assert np.all(support - largest <= 0.25 * np.linalg.norm(directions, axis=1))
        assert np.all((inside >= piece.low - 1e-12) & (inside <= piece.high + 1e-12))
        assert np.linalg.norm(inside - piece.center, axis=1).max() <= piece.radius + 1e-12


def test_directions_are_right_in_parallel_and_random_poses() -> None:
    rng = np.random.default_rng(6)
    box = obstacle_pieces(Obstacle("x", Box((1.0, 1.0, 1.0))))[0]
    for gap in (0.3, 1e-3, 1e-6, -1e-6, -0.1):
        for offset in rng.uniform(-0.4, 0.4, size=(10, 2)).round(1):  # faces exactly parallel, edges often aligned
            pose = np.eye(4)
            pose[:3, 3] = (*offset, 1.0 + gap)
            _, value = best_direction(box, pose, box, np.eye(4))
            assert value == pytest.approx(gap, abs=1e-9)
    for first in random_pieces(rng):
        for second in random_pieces(rng):
            pose = np.eye(4)
            pose[:3, 3] = rng.normal(size=3) * 2
            pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            pose[:3, 0] *= np.linalg.det(pose[:3, :3])
            value = best_direction(first, pose, second, np.eye(4))[1]
            turned = best_direction(second, np.eye(4), first, pose)[1]
            assert value == pytest.approx(turned, abs=2e-5)


def test_where_coal_is_in_doubt_hulls_that_keep_apart_are_no_contact(
    planar: RobotSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Directions for triangles that separate nothing prove nothing: the hulls' own distance is still proven."""
    ring = trimesh.creation.annulus(0.4, 0.5, 0.2)
    ring.export(tmp_path / "ring.stl")
    far = Obstacle("ring", Mesh(tmp_path / "ring.stl"), Pose((5.0, 0.0, 0.0)))
    exact = swing(planar, 0.3, far)
    parts = "hdplan.planner.certificate.part_distance"
    monkeypatch.setattr(f"{parts}.directions", lambda pairs: (np.array([[0.0, 1.0, 0.0] for _ in pairs]), np.zeros(1)))
    found = swing(planar, 0.3, far)
    assert found.certified
    assert exact.clearance is not None
    assert found.clearance is not None
    assert 1.0 < found.clearance <= exact.clearance * 1.1


def test_parts_cut_off_by_the_time_limit_are_not_proven(planar: RobotSpec, tmp_path: Path) -> None:
    """Not in contact either, although the hulls meet."""
    ring = trimesh.creation.annulus(3.0, 3.1, 0.2)
    ring.export(tmp_path / "ring.stl")
    around = Obstacle("ring", Mesh(tmp_path / "ring.stl"))
    waypoints = np.array([[-0.3, 0.0, 0.0], [0.3, 0.0, 0.0]])
    certifier = Certifier(Setup.of(scene_of(planar, *waypoints, around)))
    motion = Trajectory(load_robot(planar).joint_names, waypoints)
    assert certifier.certify(motion, required=0.0).certified
    with time_limit(1e-9):
        assert certifier.certify(motion, required=0.0).status is Status.NOT_PROVEN


def test_loose_convex_parts_are_exact_and_walls_stay_whole() -> None:
    box = trimesh.creation.box((1, 1, 1))
    two = trimesh.util.concatenate([box, box.copy().apply_translation([3, 0, 0])])
    assert [p.surface for p in mesh_pieces(TriangleMesh.merged(two.vertices, two.faces))] == [None, None]
    inner = trimesh.creation.box((0.5, 0.5, 0.5))
    inner.invert()
    room = trimesh.util.concatenate([box, inner])
    (whole,) = mesh_pieces(TriangleMesh.merged(room.vertices, room.faces))
    assert whole.surface is not None


# --- requirements on the trajectory ---------------------------------------------------------------


def test_ends_limits_and_names() -> None:
    spec = RobotSpec(name="panda", locked={"panda_finger_joint1": 0.03})
    robot = load_robot(spec)
    start, goal = np.array([0, -0.7, 0, -2.3, 0, 1.5, 0.7]), np.array([0.5, -0.5, 0, -2.0, 0, 1.6, 0.7])
    scene = scene_of(spec, start, goal)
    line = np.linspace(start, goal, 5)
    assert certify(scene, Trajectory(robot.joint_names, line)).certified

    back = certify(scene, Trajectory(robot.joint_names, line[::-1]))
    assert back.status is Status.WRONG_ENDS
    assert "first waypoint has joint" in back.text
    assert certify(scene, Trajectory(robot.joint_names, line[::-1]), check_ends=False).certified

    beyond = line.copy()
    beyond[2, 3] = robot.upper[3] + 1e-6
    found = certify(scene, Trajectory(robot.joint_names, beyond))
    assert found.status is Status.OUTSIDE_LIMITS
    assert "waypoint 2 has joint 'panda_joint4'" in found.text

    names = robot.joint_names[::-1] + ("panda_finger_joint1",)
    columns = np.c_[line[:, ::-1], np.full(5, 0.03)]
    assert certify(scene, Trajectory(names, columns)).certified
    with pytest.raises(InputError, match=r"the scene holds it at 0\.03"):
        certify(scene, Trajectory(names, columns + 0.01))
    with pytest.raises(InputError, match="joint 'panda_joint7' of panda is missing"):
        certify(scene, Trajectory(robot.joint_names[:6], line[:, :6]))
    with pytest.raises(InputError, match="did you mean 'panda_joint1'"):
        certify(scene, Trajectory((*robot.joint_names, "panda_joint11"), np.c_[line, line[:, 0]]))
    with pytest.raises(InputError, match=r"the scene holds it at 0\.03"):
        certify(scene, Trajectory(robot.joint_names, line, {"panda_finger_joint1": 0.0}))


def test_contacts_of_a_configuration(planar: RobotSpec) -> None:
    robot, q = load_robot(planar), np.zeros(3)
    block = Obstacle("block", Box((0.1, 0.1, 0.1)), Pose((0.5, 0.05, 0.0)))
    post = Obstacle("post", Cylinder(0.05, 2.0), Pose((2.0, 0.055, 0.0)))
    contacts = check_configuration(scene_of(planar, q, q, block, post), robot, q)
    assert [(contact.link, contact.other) for contact in contacts] == [("arm", "block"), ("hand", "post")]
    assert [contact.depth for contact in contacts] == pytest.approx([0.01, 0.005], abs=1e-6)
    assert check_configuration(scene_of(planar, q, q), robot, q) == ()


def test_a_certifier_is_reusable_and_says_the_same(planar: RobotSpec) -> None:
    robot = load_robot(planar)
    waypoints = np.array([[0.0, 0.1, 0.2], [0.4, -0.5, 0.3]])
    scene = scene_of(planar, waypoints[0], waypoints[1], Obstacle("ball", Sphere(0.2), Pose((1.5, 1.5, 0.0))))
    certifier, path = Certifier(Setup.of(scene, robot)), Trajectory(robot.joint_names, waypoints)
    first, again = certifier.certify(path), certifier.certify(path)
    assert first.certified
    assert (first.clearance, first.worst, first.exact_calls) == (again.clearance, again.worst, again.exact_calls)


def test_a_robot_whose_links_are_not_checked_certifies_no_scene_in_which_they_are() -> None:
    scene = load_scene("panda_fold")
    blind = dataclasses.replace(scene, self_collision=hdplan.SelfCollision(checked=False))
    assert Certifier(Setup.of(blind)).sweep.pairs.group.max(initial=0) == 0
    with pytest.raises(InputError, match="are not checked against each other, the scene's are"):
        Certifier(Setup.of(scene, load_scene_robot(blind)))


FINGERS = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}
ELSEWHERE: dict[str, dict[str, Any]] = {
    "its base is not where": {"base": Pose()},
    "is not held": {"locked": {"panda_finger_joint1": 0.0}},
    "are not checked against each other": {"ignore_pairs": (("panda_link0", "panda_hand"),)},
    "other joints of it are planned": {"locked": {**FINGERS, "panda_joint7": 0.785}},
    "read from other files": {"name": "ur5", "locked": {}},
}


@pytest.mark.parametrize("words", ELSEWHERE)
def test_a_robot_for_which_less_is_proven_is_not_the_scenes(words: str) -> None:
    """A proof for it would be none for the scene's; the message names the difference."""
    scene = load_scene("panda_cage")
    spec = dataclasses.replace(scene.robot, base=Pose((0.0, 0.0, 0.1)), locked=FINGERS)
    scene = dataclasses.replace(scene, robot=spec)
    Certifier(Setup.of(scene, load_robot(spec)))
    other = load_robot(dataclasses.replace(spec, **ELSEWHERE[words]))
    for made in (Setup.of, build, lambda scene, robot: Controller.of(scene, robot=robot)):
        with pytest.raises(InputError, match=f"robot: .*{words}.*; the scene's own is hdplan.build"):
            made(scene, other)


def test_a_robot_within_less_than_the_scenes_will_do_and_one_within_more_will_not() -> None:
    """Limits of position are the scene's: what the robot alone is within counts for nothing."""
    scene = load_scene("panda_cage")
    narrow = dataclasses.replace(scene, limits=hdplan.Limits(position={"panda_joint2": (-0.5, 0.5)}))
    assert Setup.of(scene, load_scene_robot(narrow)).robot.upper[1] == 0.5
    for made in (Setup.of, build, lambda scene, robot: Controller.of(scene, robot=robot)):
        with pytest.raises(InputError, match="its joint 'panda_joint2' may go beyond the limits of the scene's"):
            made(narrow, load_robot(scene.robot))
