"""Laws of the certificate: never optimistic, close to the truth, and no way through a plate, a link or a hollow."""

from __future__ import annotations

import gc
import math
import weakref
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.interpolate import make_interp_spline

from hdplan import Obstacle, Pose, Robot, RobotSpec, Scene, Trajectory, load_robot
from hdplan.planner.certificate import collision_proof, intervals, solids
from hdplan.planner.certificate.certifier import Certifier, certify, check_configuration
from hdplan.planner.certificate.exact_proximity import link_pieces
from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import time_limit
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Sphere

from ..urdf import joint_text, link_text, robot_text, write_robot
from .rooms import turned
from .worlds import BRANCHED, coal_shape


def scene_of(spec: RobotSpec, start: Array, goal: Array, *obstacles: Obstacle) -> Scene:
    return Scene(robot=spec, obstacles=obstacles, start=start, goal=goal)


def certificate(spec: RobotSpec, waypoints: Array, *obstacles: Obstacle, required: float = 0.0) -> Certificate:
    scene, robot = scene_of(spec, waypoints[0], waypoints[-1], *obstacles), load_robot(spec)
    return certify(scene, Trajectory(robot.joint_names, waypoints), robot, required=required)


def random_obstacles(rng: np.random.Generator, count: int, folder: Path, reach: float = 0.9) -> tuple[Obstacle, ...]:
    sizes = rng.uniform(0.05, 0.25, size=(count, 3)).tolist()
    torus = folder / "torus.stl"
    trimesh.creation.torus(0.2, 0.05, major_sections=16, minor_sections=8).export(torus)
    found = []
    for i, (x, y, z) in enumerate(sizes):
        shapes = Box((x, y, z)), Sphere(x), Cylinder(x / 2, z), Capsule(x / 3, z), Points(rng.normal(0, 0.08, (12, 3)))
        shape = (*shapes, Mesh(torus), Ellipsoid((x, y / 2, z / 3)))[i % 7]
        place = rng.uniform(-reach, reach, size=3) + [0.0, 0.0, 0.4]
        found.append(Obstacle(f"thing{i}", shape, Pose(place, turned(rng))))
    return tuple(found)


def random_waypoints(rng: np.random.Generator, robot: Robot, rows: int, step: float) -> Array:
    low, high = np.clip(robot.lower, -3, 3), np.clip(robot.upper, -3, 3)
    walk = rng.uniform(low, high) + step * rng.normal(size=(rows, robot.n)).cumsum(axis=0)
    return np.clip(walk, low, high)


def sampled(robot: Robot, obstacles: tuple[Obstacle, ...], q: Array) -> tuple[dict[tuple[str, str], float], ...]:
    """Distances of all pairs in one configuration by plain coal on the robot's own geometry: obstacles, then links."""
    model, geometry = robot.model, robot.collision
    placed = geometry.createData()
    pin.updateGeometryPlacements(model, model.createData(), geometry, placed, robot.pin_q(q))
    places, items = [coal.Transform3s(x.rotation, x.translation) for x in placed.oMg], geometry.geometryObjects
    links = [(link, items[i].geometry, places[i]) for link, own in robot.link_geometry.items() for i in own]
    stand = [coal.Transform3s(x.pose.matrix[:3, :3], x.pose.matrix[:3, 3]) for x in obstacles]
    things = [(x.name, coal_shape(x.shape), place) for x, place in zip(obstacles, stand, strict=True)]
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
def test_dense_sampling_never_refutes_it_and_it_is_tight(name: str, count: int, looks: int, tmp_path: Path) -> None:
    spec = RobotSpec(name) if name != "branched" else RobotSpec(urdf=write_robot(tmp_path / "b.urdf", *BRANCHED))
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
            assert proven is None or 0.0 < proven <= least + 1e-6
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


def test_kept_knowledge_of_a_body_goes_with_it() -> None:
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
    """The proven clearance is no more than samples find, and every contact is found, whatever the parts are."""
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
    """Contact is found all the same, wherever it is, and a free motion is certified with what it keeps."""
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
    arm, joint = link_text("arm", box="0.3 0.1 0.1", at="0.1 0 0"), joint_text("turn", "base", "arm", kind="continuous")
    short = RobotSpec(urdf=write_robot(tmp_path / "short.urdf", link_text("base"), arm, joint))
    turn = np.array([[0.0], [1.0], [2.0]])
    hollow, solid = (ball_of(tmp_path, filled) for filled in (False, True))
    assert certificate(short, turn, hollow).certified
    assert certificate(short, turn, solid).status is Status.IN_CONTACT
    open_ball = trimesh.creation.icosphere(2, 0.5)
    open_ball.faces = open_ball.faces[1:]  # not closed: only its triangles and the winding number tell
    open_ball.export(tmp_path / "open.stl")
    leaky = Obstacle("ball", Mesh(tmp_path / "open.stl"))
    assert certificate(short, turn, leaky).status is Status.IN_CONTACT
    assert check_configuration(scene_of(short, turn[0], turn[0], leaky), load_robot(short), turn[0])


def test_a_ball_inside_a_link_that_is_not_convex() -> None:
    robot = load_robot("ur5")
    q, data = np.zeros(robot.n), robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.pin_q(q))
    item = robot.collision.geometryObjects[robot.link_geometry["forearm_link"][0]]
    pieces = link_pieces(item.geometry, "forearm_link")
    assert len(pieces) > 1  # cut, and each piece still knows its solid
    solid = pieces[0].surface.solid.mesh
    placement = data.oMi[item.parentJoint] * item.placement
    mesh = trimesh.Trimesh(solid.vertices, solid.triangles)
    inside = next(p for p in mesh.triangles_center - 0.01 * mesh.face_normals if abs(solid.winding_number(p)) > 0.9)
    ball = Obstacle("ball", Sphere(1e-3), Pose(tuple((placement * inside).tolist())))
    found = certificate(RobotSpec("ur5"), np.stack([q, q]), ball)
    assert found.status is Status.IN_CONTACT
    assert "forearm_link" in {place.link for place in found.failures}


def test_hulls_that_keep_apart_are_no_contact_where_coal_is_in_doubt(
    planar: RobotSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Directions for triangles that separate nothing prove nothing: the hulls' own distance is still proven."""
    ring = trimesh.creation.annulus(0.4, 0.5, 0.2)
    ring.export(tmp_path / "ring.stl")
    far = Obstacle("ring", Mesh(tmp_path / "ring.stl"), Pose((5.0, 0.0, 0.0)))
    exact, parts = swing(planar, 0.3, far), "hdplan.planner.certificate.part_distance"
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
