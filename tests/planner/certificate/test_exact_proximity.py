"""Laws of exact proximity: pieces hold their surface, supports and directions are right, points keep their bounds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from hdplan import Box, Capsule, Cylinder, Ellipsoid, Obstacle, Points, RobotSpec, Sphere, load_robot
from hdplan.planner.certificate.exact_proximity import Piece, best_direction, link_pieces, mesh_pieces, obstacle_pieces
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.geometry.opened import with_content
from hdplan.planner.motion.motion_bounds import Chain, Motion

from ..urdf import write_robot
from .worlds import BRANCHED


def test_cut_pieces_hold_the_whole_surface() -> None:
    """Random points of a link's triangles lie in the hull of one of its pieces, to the rounding of the cuts."""
    robot = load_robot("ur5")
    item = robot.collision.geometryObjects[robot.link_geometry["forearm_link"][0]]
    pieces = link_pieces(item.geometry, "forearm_link")
    solid = pieces[0].surface.solid.mesh
    points, _ = trimesh.sample.sample_surface(trimesh.Trimesh(solid.vertices, solid.triangles), 2000, seed=3)
    hulls = [ConvexHull(piece.vertices).equations for piece in pieces]
    outside = np.min([(points @ hull[:, :3].T + hull[:, 3]).max(axis=1) for hull in hulls], axis=0)
    assert outside.max() < 1e-9
    area = sum(trimesh.Trimesh(p.surface.mesh.vertices, p.surface.mesh.triangles).area for p in pieces if p.surface)
    assert area == pytest.approx(trimesh.Trimesh(solid.vertices, solid.triangles).area, rel=1e-9)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("leaving", [0.0, 0.3], ids=["straight", "curved"])
@pytest.mark.parametrize("name", ["panda", "kinova", "branched"])
def test_no_point_moves_farther_than_its_bounds(name: str, leaving: float, tmp_path: Path) -> None:
    spec = RobotSpec(name) if name != "branched" else RobotSpec(urdf=write_robot(tmp_path / "b.urdf", *BRANCHED))
    robot = load_robot(spec)
    chain, rng = Chain.of(robot.model), np.random.default_rng(2)
    items = [item for item in robot.collision.geometryObjects if item.parentJoint]
    pieces = [link_pieces(item.geometry, item.name)[0] for item in items]
    places = [item.placement for item in items]
    points = [p.vertices @ at.rotation.T + at.translation for p, at in zip(pieces, places, strict=True)]
    joints = np.array([item.parentJoint for item in items])
    sharp = []
    for _ in range(40):
        middle = rng.uniform(np.clip(robot.lower, -3, 3), np.clip(robot.upper, -3, 3))
        delta = rng.normal(size=robot.n) * 10.0 ** rng.uniform(-2.5, 0)
        deviation = leaving * rng.uniform(size=robot.n) * np.abs(delta).max()
        most = np.abs(delta) + deviation
        travel = np.stack([middle - most, middle + most], axis=1)
        reaches = (chain.reach(int(j), cloud, 0.0, travel) for j, cloud in zip(joints, points, strict=True))
        rho = np.array([*reaches])
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


def test_loose_convex_parts_are_exact_and_walls_stay_whole() -> None:
    box = trimesh.creation.box((1, 1, 1))
    two = trimesh.util.concatenate([box, box.copy().apply_translation([3, 0, 0])])
    assert [p.surface for p in mesh_pieces(TriangleMesh.merged(two.vertices, two.faces))] == [None, None]
    inner = trimesh.creation.box((0.5, 0.5, 0.5))
    inner.invert()
    room = trimesh.util.concatenate([box, inner])
    (whole,) = mesh_pieces(TriangleMesh.merged(room.vertices, room.faces))
    assert whole.surface is not None
