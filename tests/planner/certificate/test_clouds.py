"""Laws of the certificate around clouds: every single ball counts, whatever the cells, and nothing is made larger."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import hdplan
from hdplan import Attached, Box, Cloud, Obstacle, Pose, Robot, RobotSpec, Scene, Timing, Trajectory, load_robot
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.cloud_pieces import moving_pieces, standing_pieces
from hdplan.planner.certificate.exact_proximity import Piece, hull_piece, link_pieces
from hdplan.planner.certificate.part_distance import closest_parts, distance
from hdplan.planner.certificate.solids import obstacle_bodies
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.obstacle_motion import ObstacleMotion

from ..urdf import joint_text, link_text, write_robot
from .rooms import turned

TURNED = Pose((0.1, -0.2, 0.05), (0.1, 0.3, -0.3, 0.9))


def cloud_around(rng: np.random.Generator, count: int) -> Array:
    """Patches of surfaces, a line, and single points, around a robot's arm."""
    patches = []
    for _ in range(4):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        flat = rng.uniform(-0.1, 0.1, size=(count // 5, 3)) * [1.0, 1.0, 0.02]
        patches.append(flat @ turn.T + rng.uniform([-0.7, -0.7, 0.0], [0.7, 0.7, 1.0]))
    line = np.linspace([0.4, -0.4, 0.2], [0.5, 0.5, 0.9], count // 10)
    return np.concatenate([*patches, line, rng.uniform(-1.0, 1.0, size=(20, 3))])


def scene_of(robot: str | RobotSpec, obstacle: Obstacle, start: Array, goal: Array, **more: object) -> Scene:
    given = {"self_collision": hdplan.SelfCollision(checked=False), **more}
    return Scene(robot=robot, obstacles=[obstacle], start=start, goal=goal, **given)


def least(robot: Robot, obstacle: Obstacle, trajectory: Trajectory, samples: int) -> float:
    """The least distance at samples of a motion, of every link that moves to every ball, one by one."""
    cloud = obstacle.shape
    assert isinstance(cloud, Cloud)
    assert isinstance(cloud.points, FixedArray)
    data, geometry = robot.model.createData(), robot.collision.createData()
    curve, result = trajectory.curve, coal.DistanceResult()
    smallest = np.inf
    for parameter in np.linspace(0.0, 1.0, samples):
        interval = min(int(parameter * (len(curve) - 1)), len(curve) - 2)
        q = curve.at(np.array([interval]), np.array([parameter * (len(curve) - 1) - interval]))[0]
        pose = obstacle.pose.matrix
        if obstacle.motion is not None:
            pose = ObstacleMotion.of(obstacle).at(np.array([float(curve.time_of(parameter))]))[0]
        points = cloud.points.array @ pose[:3, :3].T + pose[:3, 3]
        pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry, robot.pin_q(q))
        for index, item in enumerate(robot.collision.geometryObjects):
            if item.parentJoint == 0:
                continue
            item.geometry.computeLocalAABB()
            center = geometry.oMg[index].act(item.geometry.aabb_center)
            away = np.linalg.norm(points - center, axis=1) - item.geometry.aabb_radius - cloud.radius
            for row in np.flatnonzero(away < smallest).tolist():
                result.clear()
                place = coal.Transform3s(np.eye(3), points[row])
                at = coal.Transform3s(geometry.oMg[index].rotation, geometry.oMg[index].translation)
                request = coal.DistanceRequest()
                value = coal.distance(item.geometry, at, coal.Sphere(1e-9), place, request, result)
                smallest = min(smallest, value - cloud.radius)
    return smallest


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(4))
def test_the_proof_is_never_above_the_least_distance_to_any_ball_and_close_to_it(seed: int) -> None:
    rng, robot = np.random.default_rng(seed), load_robot("panda")
    points, radius = cloud_around(rng, 600), 0.004
    start, goal = 0.5 * robot.draw(rng, 2) + 0.25 * (robot.lower + robot.upper)
    obstacle = Obstacle("view", Cloud(points, radius), TURNED)
    scene = scene_of("panda", obstacle, start, goal)
    trajectory = Trajectory(robot.joint_names, np.linspace(start, goal, 20))
    truth = least(robot, obstacle, trajectory, 400)
    found = certify(scene, trajectory, check_ends=False, required=0.0)
    assert (found.clearance is not None) == (found.status is Status.CERTIFIED)
    if found.clearance is not None:
        assert truth > 0.0
        assert found.clearance <= truth + 1e-6
        assert found.clearance >= truth - max(1e-3, 0.06 * truth)
        assert found.worst.distance == pytest.approx(truth, abs=max(2e-3, 0.05 * truth))
    else:
        assert truth < 1e-3


def test_both_verdicts_occur_above() -> None:
    """The seeds hold motions that are free, and motions in contact, or the law would say little."""
    rng, robot, verdicts = np.random.default_rng(0), load_robot("panda"), set()
    for _ in range(12):
        start, goal = 0.5 * robot.draw(rng, 2) + 0.25 * (robot.lower + robot.upper)
        scene = scene_of("panda", Obstacle("view", Cloud(cloud_around(rng, 300), 0.004), TURNED), start, goal)
        motion = Trajectory(robot.joint_names, np.linspace(start, goal, 20))
        verdicts.add(certify(scene, motion, check_ends=False, required=0.0).status)
    assert verdicts == {Status.CERTIFIED, Status.IN_CONTACT}


def test_one_ball_in_the_way_is_enough() -> None:
    robot = load_robot("panda")
    start = np.array([-0.5, 0.3, 0.0, -1.8, 0.0, 2.1, 0.785])
    goal = start + [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    data, geometry = robot.model.createData(), robot.collision.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry, robot.pin_q(0.5 * (start + goal)))
    hand = robot.link_geometry["panda_hand"][0]
    robot.collision.geometryObjects[hand].geometry.computeLocalAABB()
    middle = geometry.oMg[hand].act(robot.collision.geometryObjects[hand].geometry.aabb_center)
    far = np.random.default_rng(0).uniform([-1.0, -1.0, 1.6], [1.0, 1.0, 2.0], size=(5000, 3))
    motion = Trajectory(robot.joint_names, np.linspace(start, goal, 30))
    for points, status in ((far, Status.CERTIFIED), (np.vstack([far, middle]), Status.IN_CONTACT)):
        scene = scene_of("panda", Obstacle("view", Cloud(points, 1e-4)), start, goal)
        assert certify(scene, motion, required=0.0).status is status


def test_a_moving_cloud_and_a_held_object() -> None:
    rng, robot = np.random.default_rng(5), load_robot("panda")
    start = np.array([-0.5, 0.3, 0.0, -1.8, 0.0, 2.1, 0.785])
    goal = start + [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    held = Attached("bar", "panda_hand", Box((0.02, 0.3, 0.02)), Pose((0.0, 0.0, 0.12)))
    motion = Trajectory(robot.joint_names, np.linspace(start, goal, 30), times=np.linspace(0.0, 2.0, 30))
    patch = rng.uniform(-0.1, 0.1, size=(200, 3)) * [1.0, 1.0, 0.05]
    statuses = set()
    for height in (0.2, 0.5):
        moves = hdplan.SteadyMotion((-0.1, 0.05, 0.02), (0.2, 0.1, 0.3))
        obstacle = Obstacle("view", Cloud(patch, 0.005), Pose((0.6, 0.0, height)), motion=moves)
        scene = scene_of("panda", obstacle, start, goal, attached=(held,), timing=Timing(duration=2.0))
        setup = Setup.of(scene)
        truth = least(setup.robot, obstacle, motion, 300)
        found = Certifier(setup).certify(motion, required=0.0)
        statuses.add(found.status)
        if found.clearance is None:
            assert truth < 1e-3
        else:
            assert truth - max(1e-3, 0.06 * truth) <= found.clearance <= truth + 1e-6
    assert statuses == {Status.CERTIFIED, Status.IN_CONTACT}


def test_a_ball_inside_a_hollow_link_is_in_contact(tmp_path: Path) -> None:
    """No triangle of the link is near it: only its place inside the closed mesh tells."""
    outside = trimesh.creation.icosphere(subdivisions=2, radius=0.2)
    bent = outside.vertices * [1.0, 1.0, 0.4] + np.array([0.0, 0.0, 4.0]) * outside.vertices[:, :1] ** 2
    trimesh.Trimesh(bent, outside.faces).export(tmp_path / "bowl.stl")
    turn = joint_text("turn", "base", "bowl", limits=(-2, 2))
    links = link_text("base"), link_text("bowl", mesh="bowl.stl")
    spec = RobotSpec(urdf=write_robot(tmp_path / "arm.urdf", *links, turn))
    start, goal = np.array([-0.1]), np.array([0.1])
    robot = load_robot(spec)
    motion = Trajectory(robot.joint_names, np.linspace(start, goal, 5))
    for one, other, free in ((0.0, 2.0, False), (2.0, 2.0, True), (0.002, 0.0, False)):
        dust = Cloud([[one, 0.0, 0.0], [other, 0.0, 0.0]], 0.002)
        found = certify(scene_of(spec, Obstacle("dust", dust), start, goal), motion, required=0.0)
        assert found.status is (Status.CERTIFIED if free else Status.IN_CONTACT)
    assert any(piece.surface for item in robot.collision.geometryObjects for piece in link_pieces(item.geometry, ""))


@pytest.mark.parametrize("seed", range(5))
def test_the_distance_to_balls_is_that_of_the_closest_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    link = hull_piece(rng.normal(size=(12, 3)) * [0.1, 0.05, 0.2])
    for spread in (0.05, 0.3):
        grains = np.column_stack([rng.uniform(-spread, spread, (60, 3)), rng.uniform(0.001, 0.01, 60)])
        balls = FixedArray(grains)
        pose = Pose(tuple(rng.normal(size=3) * 0.4), turned(rng)).matrix
        truth = min(coal_distance(link, pose, grain) for grain in grains)
        found = []
        for piece, frame in zip(*standing_pieces(balls), strict=True):
            value = distance(link, pose, piece, frame)
            _, _, nearest, place = closest_parts(link, pose, piece, frame)
            grain = np.append(place[:3, :3] @ nearest.vertices[0] + place[:3, 3], nearest.ball)
            away = coal_distance(link, pose, grain)
            assert value == pytest.approx(away, abs=1e-5)
            found.append(value)
        assert min(found) <= truth + 1e-9
        assert min(found) == pytest.approx(truth, abs=1e-5)


def test_the_pieces_of_a_cloud_are_made_once_wherever_it_stands() -> None:
    """A drag in a scene with a large cloud waits for nothing that stays as it was."""
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (400, 3))
    clouds = (Obstacle("seen", Cloud(points.copy(), radius=0.01), Pose((x, 0.0, 0.0))) for x in (0.0, 1.0))
    here, there = map(obstacle_bodies, clouds)
    assert [body.piece for body in here] == [body.piece for body in there]
    assert all(abs(b.placement[0, 3] - a.placement[0, 3] - 1.0) < 1e-12 for a, b in zip(here, there, strict=True))


@pytest.mark.parametrize("count", [1, 2, 3, 500])
@pytest.mark.parametrize("kind", ["anywhere", "plane", "line", "same"])
def test_pieces_contain_their_balls_and_all_balls_are_in_pieces(count: int, kind: str) -> None:
    rng = np.random.default_rng(count)
    flat = {"anywhere": [1, 1, 1], "plane": [1, 1, 0], "line": [1, 0, 0], "same": [0, 0, 0]}[kind]
    points = rng.uniform(-0.2, 0.2, size=(count, 3)) * flat + [0.3, -0.2, 0.7]
    balls = FixedArray(np.column_stack([points, rng.uniform(0.001, 0.02, count)]))
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    standing, moving = zip(*standing_pieces(balls), strict=True), ((piece, np.eye(4)) for piece in moving_pieces(balls))
    for pieces in (standing, moving):
        seen = []
        for piece, frame in pieces:
            assert piece.grains is not None
            local = directions @ frame[:3, :3]
            reach = (piece.grains[:, :3] @ local.T + piece.grains[:, 3:]).max(axis=0)
            assert (piece.support(local) >= reach - 1e-12).all()
            assert (np.linalg.norm(piece.grains[:, :3] - piece.center, axis=1) <= piece.radius + 1e-12).all()
            seen.append(np.column_stack([piece.grains[:, :3] @ frame[:3, :3].T + frame[:3, 3], piece.grains[:, 3]]))
        every = np.concatenate(seen)
        assert every.shape == balls.array.shape
        order, given = np.lexsort(every.round(9).T), np.lexsort(balls.array.round(9).T)
        np.testing.assert_allclose(every[order], balls.array[given], atol=1e-9)


def coal_distance(link: Piece, pose: Array, grain: Array) -> float:
    result = coal.DistanceResult()
    at, place = coal.Transform3s(pose[:3, :3], pose[:3, 3]), coal.Transform3s(np.eye(3), grain[:3])
    return float(coal.distance(link.shape, at, coal.Sphere(grain[3]), place, coal.DistanceRequest(), result))


def test_groups_of_cells_settle_nothing_that_is_not_settled_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Balls around groups of bodies change no verdict, and hardly any bound."""
    rng, robot = np.random.default_rng(3), load_robot("panda")
    statuses = set()
    for _ in range(6):
        start, goal = 0.4 * robot.draw(rng, 2) + 0.3 * (robot.lower + robot.upper)
        points = np.concatenate([cloud_around(rng, 300), rng.uniform([-1, -1, -0.3], [1, 1, -0.2], size=(6000, 3))])
        scene = scene_of("panda", Obstacle("view", Cloud(points, 0.004), TURNED), start, goal)
        motion = Trajectory(robot.joint_names, np.linspace(start, goal, 20))
        certifier = Certifier(Setup.of(scene))
        nodes_bounds = certifier.sweep.bounds
        assert nodes_bounds._grouped is not None
        found = certifier.certify(motion, check_ends=False, required=0.0)
        monkeypatch.setattr("hdplan.planner.certificate.interval_bounds.GROUPED_FROM", 10**9)
        alone = Certifier(Setup.of(scene)).certify(motion, check_ends=False, required=0.0)
        monkeypatch.undo()
        statuses.add(found.status)
        assert found.status is alone.status
        if found.clearance is not None:
            assert found.clearance == pytest.approx(alone.clearance, rel=0.1, abs=1e-3)
            truth = least(robot, scene.obstacles[0], motion, 100)
            assert found.clearance <= truth + 1e-6
    assert len(statuses) == 2
