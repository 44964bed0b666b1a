"""Laws of halfspace bodies: exact supports of the shapes themselves, so that the planes hold the shape and touch it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.symbolic.halfspaces import FAR_OFFSET, box_directions
from hdplan.planner.collision.halfspace_bodies import (
    BODY_PLANES,
    BOX_PLANES,
    HalfspaceBody,
    from_link_body,
    from_obstacle,
    from_points,
    from_shape,
)
from hdplan.planner.geometry.meshes import ReadMesh, TriangleMesh
from hdplan.planner.geometry.opened import with_content
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Shape, Sphere

ROUNDING = 1e-12  # of the sizes here, about 1 m
TOUCH = 3e-3  # relative to the size: how far from a plane the densest sampled surface may stay
TETRAHEDRON = tuple(map(tuple, 0.3 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])))
CLOUD = tuple(map(tuple, np.random.default_rng(3).normal(size=(60, 3)).tolist()))
SLOTS = {
    "faces": (6, BODY_PLANES),
    "box": (BOX_PLANES, BODY_PLANES),
    "sphere": (BOX_PLANES + 96, BODY_PLANES + 96),
}  # of boxes and links, of the rest
BALL = tuple(map(tuple, trimesh.creation.icosphere(3, 0.4).vertices.tolist()))  # far more faces than planes
PRISM = tuple((x, y, z) for x, y in ((0, 0), (1, 0.1), (0.8, 0.7), (0.3, 0.9), (-0.2, 0.5)) for z in (0, 0.3))
FLAT = ((0.0, 0, 0), (1.0, 0, 0), (1.0, 0.5, 0), (0, 0.4, 0))
SHAPES: dict[str, Shape | Array] = {
    "box": Box((0.4, 1.0, 0.1)),
    "plate": Box((1.0, 2.0, 1e-3)),
    "sphere": Sphere(0.3),
    "cylinder": Cylinder(0.2, 0.7),
    "disc": Cylinder(0.5, 0.01),
    "capsule": Capsule(0.1, 0.8),
    "ellipsoid": Ellipsoid((0.1, 0.3, 0.02)),
    "capsule without length": Capsule(0.1, 1e-9),
    "tetrahedron": Points(TETRAHEDRON),
    "cloud": Points(CLOUD),
    "many faces": Points(BALL),
    "prism": Points(PRISM),
    "flat": np.array(FLAT),
    "segment": np.array([[0.0, 0, 0], [0.3, 0.4, 0.5]]),
    "point": np.array([[0.1, 0.2, 0.3]]),
}


def directions(count: int, seed: int) -> Array:
    rows = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def enclosed(name: str, shape: Shape | Array, placement: Array, normals: str = "box") -> HalfspaceBody:
    around = from_points if isinstance(shape, np.ndarray) else from_shape
    return around(name, shape, placement, normals)


def surface(shape: Shape | Array) -> Array:
    """Many points of the shape's surface (m, 3), corners and rims included, in its frame."""
    balls = np.vstack([directions(4000, 4), box_directions()])
    turn = np.linspace(0, 2 * np.pi, 721)[:-1]
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    match shape:
        case Box(size):
            grid = np.array(np.meshgrid(*[[-0.5, 0, 0.5]] * 3)).reshape(3, -1).T
            return grid * np.array(size)
        case Sphere(radius):
            return radius * balls
        case Ellipsoid(radii):
            return balls * radii
        case Cylinder(radius, length):
            return np.vstack([radius * ring + [0, 0, z] for z in (-length / 2, 0, length / 2)])
        case Capsule(radius, length):
            ends = [radius * np.vstack([balls, ring]) + [0, 0, z] for z in (-length / 2, length / 2)]
            return np.vstack(ends)
        case Points(points):
            return np.array(points)
        case np.ndarray():
            return shape
    raise TypeError(shape)


def placements() -> list[Array]:
    result = [np.eye(4)]
    for seed in range(3):
        rng = np.random.default_rng(seed)
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        pose[:3, 3] = rng.uniform(-2, 2, 3)
        result.append(pose)
    return result


def check(body: HalfspaceBody, points: Array, size: float, touches: bool = True, normals: str = "box") -> None:
    """The planes hold the points (m, 3), in the carrier's frame, and so does the box."""
    assert len(body.normals) == len(body.supports)
    assert len(body.supports) in SLOTS[normals]
    np.testing.assert_allclose(np.linalg.norm(body.normals, axis=1), 1, atol=ROUNDING)
    if len(body.supports) >= BOX_PLANES:
        np.testing.assert_allclose(body.normals[:26], box_directions() @ body.box[:3, :3].T, atol=ROUNDING)
    else:
        np.testing.assert_allclose(body.normals, [*body.box[:3, :3].T, *-body.box[:3, :3].T], atol=ROUNDING)
    np.testing.assert_allclose(body.box[:3, :3].T @ body.box[:3, :3], np.eye(3), atol=ROUNDING)
    assert np.linalg.det(body.box[:3, :3]) > 0
    reached = (body.normals @ points.T).max(axis=1)
    assert np.all(reached <= body.supports + ROUNDING * max(1.0, size))
    used = body.supports < FAR_OFFSET / 2
    assert used[:26].all()
    if touches:
        assert np.all(reached[used] >= body.supports[used] - TOUCH * size)
    local = (points - body.box[:3, 3]) @ body.box[:3, :3]
    assert np.all(np.abs(local) <= body.half_size + ROUNDING * max(1.0, size))
    if touches:
        np.testing.assert_allclose(np.abs(local).max(axis=0), body.half_size, atol=TOUCH * size)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("normals", SLOTS)
@pytest.mark.parametrize("name", SHAPES)
def test_supports_are_exact(name: str, normals: str) -> None:
    """No surface point is beyond a plane, and every plane that is used is touched."""
    points = surface(SHAPES[name])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for placement in placements():
        body = enclosed(name, SHAPES[name], placement, normals)
        assert (body.name, body.joint) == (name, 0)
        check(body, points @ placement[:3, :3].T + placement[:3, 3], size, normals=normals)


@pytest.mark.parametrize("name", ["cylinder", "disc", "capsule", "sphere", "ellipsoid"])
def test_round_shapes_are_themselves_and_no_polygons(name: str) -> None:
    """Supports in closed form, at a random pose: h(n) of the true round shape along every plane's normal."""
    shape, placement = SHAPES[name], placements()[2]
    body = enclosed(name, shape, placement)
    n = body.normals @ placement[:3, :3]
    match shape:
        case Sphere(radius):
            expected = np.full(BODY_PLANES, radius)
        case Ellipsoid(radii):
            expected = np.sqrt((n**2) @ np.square(radii))
        case Capsule(radius, length):
            expected = radius + length / 2 * np.abs(n[:, 2])
        case Cylinder(radius, length):
            expected = radius * np.linalg.norm(n[:, :2], axis=1) + length / 2 * np.abs(n[:, 2])
    np.testing.assert_allclose(body.supports - body.normals @ placement[:3, 3], expected, atol=ROUNDING)


def test_faces_of_a_polytope_are_among_its_planes() -> None:
    """The planes of a tetrahedron enclose nothing beside it: random points are inside all planes only if inside it."""
    body = from_shape("tetrahedron", SHAPES["tetrahedron"], np.eye(4))
    used = body.supports < FAR_OFFSET / 2
    points = np.random.default_rng(6).uniform(-0.3, 0.3, (5000, 3))
    planes = np.all(points @ body.normals[used].T <= body.supports[used], axis=1)
    corners = np.array(TETRAHEDRON)
    faces = -corners / np.linalg.norm(corners, axis=1, keepdims=True)
    inside = np.all(points @ faces.T <= (faces @ corners.T).max(axis=1), axis=1)
    assert inside.any()
    np.testing.assert_array_equal(planes, inside)


def test_spare_planes_never_cut_a_body_off() -> None:
    """Even one of many kilometres; and a body of the usual size is nowhere near them."""
    for scale in (1.0, 2e4):
        points = scale * np.array(PRISM)
        body = from_shape("prism", Points(tuple(map(tuple, points.tolist()))), np.eye(4))
        reached = (body.normals @ points.T).max(axis=1)
        spare = body.supports - reached > FAR_OFFSET / 2
        assert 0 < spare.sum() < BODY_PLANES - BOX_PLANES
        assert np.all(reached <= body.supports + ROUNDING * scale)


@pytest.mark.parametrize("halved", [4, pytest.param(5, marks=pytest.mark.slow)])
def test_a_dense_cloud_is_enclosed_in_a_moment(halved: int) -> None:
    """Thousands of points, in the slow run ten: memory and work grow with the points, not with their square."""
    cloud = trimesh.creation.icosphere(halved, 0.4).vertices
    body = from_shape("dense", Points(tuple(map(tuple, cloud.tolist()))), np.eye(4))
    check(body, np.asarray(cloud), 0.8)


@pytest.mark.parametrize(
    "body",
    [
        ConvexBody.sphere(0.1),
        ConvexBody.capsule(0.05, 0.4),
        ConvexBody.box([0.2, 0.3, 0.4]),
        ConvexBody.platonic("octahedron", 0.3).inflated(0.04),
        ConvexBody.from_points([[0, 0, 0], [0.4, 0.1, 0], [0.1, 0.3, 0.2]], radius=0.03),
    ],
    ids=["sphere", "capsule", "box", "swept octahedron", "swept triangle"],
)
def test_link_bodies_are_enclosed_exactly(body: ConvexBody) -> None:
    planes = from_link_body("forearm", 3, body)
    assert (planes.name, planes.joint, len(planes.supports)) == ("forearm", 3, BOX_PLANES)
    spheres = np.vstack([directions(4000, 7), planes.normals]) * body.radius
    points = (body.vertices[:, None] + spheres).reshape(-1, 3)
    check(planes, points, 1.0)


@pytest.mark.parametrize("shape", [name for name in SHAPES if name not in ("point", "segment", "flat")])
def test_an_obstacle_stands_at_its_pose(shape: str) -> None:
    quaternion = tuple(Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_quat().tolist())
    obstacle = Obstacle("thing", SHAPES[shape], Pose((0.4, -1.0, 0.2), quaternion))
    bodies, words = from_obstacle(with_content(obstacle, "obstacles"))
    assert len(bodies) == 1
    assert words == ()
    matrix = obstacle.pose.matrix
    points = surface(SHAPES[shape]) @ matrix[:3, :3].T + matrix[:3, 3]
    check(bodies[0], points, float(np.linalg.norm(np.ptp(points, axis=0))))


def test_pieces_of_a_mesh_cover_it(tmp_path: Path) -> None:
    """A mesh of two loose boxes, scaled and turned: two bodies of its name, and words on it."""
    left, right = trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.1, 0.3, 0.5))
    right.apply_translation([0.6, 0, 0])
    trimesh.util.concatenate([left, right]).export(tmp_path / "two.stl")
    pose = Pose((0.0, 0.5, 0.0), (0.0, 0.6, 0.0, 0.8))
    bodies, words = from_obstacle(
        with_content(Obstacle("two", Mesh(tmp_path / "two.stl", (1.0, 2.0, 1.0)), pose), "obstacles")
    )
    assert [body.name for body in bodies] == ["two", "two"]
    assert words == ("obstacle 'two': mesh two.stl split into 2 convex pieces",)
    for part in (left, right):
        points = np.asarray(part.vertices) * [1, 2, 1] @ pose.matrix[:3, :3].T + pose.matrix[:3, 3]
        holding = [
            body for body in bodies if np.all((body.normals @ points.T).max(axis=1) <= body.supports + 1e-6)
        ]  # STL stores single precision
        assert len(holding) == 1


def test_a_convex_mesh_is_one_piece_without_words(tmp_path: Path) -> None:
    trimesh.creation.icosphere(2, 0.3).export(tmp_path / "ball.stl")
    bodies, words = from_obstacle(with_content(Obstacle("ball", Mesh(tmp_path / "ball.stl")), "obstacles"))
    assert (len(bodies), words) == (1, ())


def test_a_mesh_is_no_shape_to_enclose_whole() -> None:
    shape = Mesh(Path("mesh.stl"))
    with pytest.raises(TypeError, match="unknown shape Mesh"):
        from_shape("mesh", shape, np.eye(4))
    read = ReadMesh(shape.file, mesh=TriangleMesh.hull(np.eye(4, 3)))
    with pytest.raises(TypeError, match="convex pieces"):
        from_shape("mesh", read, np.eye(4))
