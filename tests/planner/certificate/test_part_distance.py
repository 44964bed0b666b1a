"""Laws of distances by parts: never above the distance of the triangles, and equal to it, however they are arranged.

The judge compares every triangle with every other one, in NumPy, by vertices, faces and edges.
"""

from __future__ import annotations

import itertools
import time
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hdplan import Attached, Mesh, Obstacle, Pose, RobotSpec, Scene, SteadyMotion, Timing, Trajectory, certify
from hdplan.planner.certificate import parts_loop
from hdplan.planner.certificate.exact_proximity import Piece, Surface, box_piece, hull_piece
from hdplan.planner.certificate.part_distance import Placed, closest_parts, distance, part_distance
from hdplan.planner.certificate.parts import Parts
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.geometry.solids import Solid
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacle_motion import ObstacleMotion
from tests.loops import in_numpy

from ..urdf import joint_text, link_text, write_robot

SAME = 2e-6  # [m] as exact as coal's directions are


# --- the judge ------------------------------------------------------------------------------------


def to_segments(points: Array, a: Array, b: Array) -> Array:
    along = b - a
    square = np.einsum("...i,...i->...", along, along)
    share = np.einsum("...i,...i->...", points - a, along) / np.maximum(square, 1e-30)
    return np.linalg.norm(points - a - np.clip(share, 0.0, 1.0)[..., None] * along, axis=-1)


def to_triangles(points: Array, triangles: Array) -> Array:
    """The distance of each point (..., 3) to a triangle (..., 3, 3)."""
    a, b, c = np.moveaxis(triangles, -2, 0)
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.einsum("...i,...i->...", normal, normal), 1e-30)
    inside = np.ones(points.shape[:-1], dtype=bool)
    for one, other in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("...i,...i->...", np.cross(other - one, points - one), normal) >= 0.0
    flat = np.abs(np.einsum("...i,...i->...", points - a, normal)) / np.sqrt(area)
    sides = np.min([to_segments(points, *each) for each in ((a, b), (b, c), (c, a))], axis=0)
    return np.where(inside & (area > 1e-24), np.minimum(flat, sides), sides)


def pierced(a: Array, b: Array, triangles: Array) -> NDArray[np.bool_]:
    """True if segments from a to b (..., 3) go through triangles (..., 3, 3)."""
    corner, one, other = triangles[..., 0, :], *np.moveaxis(triangles[..., 1:, :] - triangles[..., :1, :], -2, 0)
    across = np.cross(b - a, other)
    scale = np.einsum("...i,...i->...", one, across)
    safe = np.where(np.abs(scale) > 1e-18, scale, 1.0)
    u = np.einsum("...i,...i->...", a - corner, across) / safe
    turned = np.cross(a - corner, one)
    v = np.einsum("...i,...i->...", b - a, turned) / safe
    t = np.einsum("...i,...i->...", other, turned) / safe
    return (np.abs(scale) > 1e-18) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)


def between_edges(a: Array, b: Array, c: Array, d: Array) -> Array:
    """The distance of lines a–b and c–d (..., 3) where both of their closest points are within the segments."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = (np.einsum("...i,...i->...", *each) for each in ((u, u), (u, v), (v, v)))
    uw, vw = np.einsum("...i,...i->...", u, w), np.einsum("...i,...i->...", v, w)
    scale = uu * vv - uv * uv
    safe = np.where(scale > 1e-30, scale, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    away = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    return np.where((scale > 1e-30) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1), away, np.inf)


def judged(one: Array, other: Array) -> float:
    """The distance of two sets of triangles (m, 3, 3), (n, 3, 3); 0 where two meet."""
    a, b = np.broadcast_arrays(one[:, None], other[None])
    least = np.inf
    for k in range(3):
        least = min(least, to_triangles(a[..., k, :], b).min(), to_triangles(b[..., k, :], a).min())
        if pierced(a[..., k, :], a[..., k - 1, :], b).any() or pierced(b[..., k, :], b[..., k - 1, :], a).any():
            return 0.0
        for j in range(3):
            sides = a[..., k, :], a[..., k - 1, :], b[..., j, :], b[..., j - 1, :]
            least = min(least, between_edges(*sides).min())
    return float(least)


# --- what is judged -------------------------------------------------------------------------------


def extruded(outline: list[tuple[float, float]], height: float) -> trimesh.Trimesh:
    """A wall along a line, and its upper rim: open, and not convex."""
    corners = np.array(outline)
    below, above = np.c_[corners, np.zeros(len(corners))], np.c_[corners, np.full(len(corners), height)]
    i, count = np.arange(len(corners)), len(corners)
    j = (i + 1) % count
    faces = np.concatenate([np.c_[i, j, count + j], np.c_[i, count + j, count + i]])
    return trimesh.Trimesh(np.r_[below, above], faces, process=False)


def meshes(rng: np.random.Generator) -> dict[str, trimesh.Trimesh]:
    """About 0.3 m large, of some tens to hundreds of triangles."""
    ball = trimesh.creation.icosphere(1)
    star = trimesh.Trimesh(ball.vertices * rng.uniform(0.1, 0.3, size=(len(ball.vertices), 1)), ball.faces)
    shell = trimesh.creation.icosphere(2, 0.25)
    shell.update_faces(shell.triangles_center[:, 2] < 0.0)
    nested = trimesh.util.concatenate([star, trimesh.Trimesh(0.4 * star.vertices, star.faces[:, ::-1])])
    line = np.linspace([-0.3, 0, 0], [0.3, 0.1, 0], 40)
    slivers = np.stack([line[:-1], line[1:], line[:-1] + rng.normal(0, [0.2, 1e-7, 0.1], size=(39, 3))], axis=1)
    return {
        "star": star,
        "L": extruded([(0, 0), (0.3, 0), (0.3, 0.05), (0.05, 0.05), (0.05, 0.3), (0, 0.3)], 0.1),
        "U": extruded(
            [(0, 0), (0.3, 0), (0.3, 0.3), (0.25, 0.3), (0.25, 0.05), (0.05, 0.05), (0.05, 0.3), (0, 0.3)], 0.2
        ),
        "torus": trimesh.creation.torus(0.2, 0.05, major_sections=12, minor_sections=8),
        "shell": shell,
        "nested": nested,
        "slivers": trimesh.Trimesh(slivers.reshape(-1, 3), np.arange(117).reshape(-1, 3), process=False),
        "soup": trimesh.Trimesh(rng.normal(0, 0.1, size=(90, 3)), np.arange(90).reshape(-1, 3), process=False),
    }


def surface(mesh: trimesh.Trimesh) -> Piece:
    kept = TriangleMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64))
    return hull_piece(kept.vertices, Surface(kept, Solid(kept)))


def pose(rng: np.random.Generator, away: float) -> Array:
    found = np.eye(4)
    found[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    direction = rng.normal(size=3)
    found[:3, 3] = away * direction / np.linalg.norm(direction)
    return found


def moved(mesh: trimesh.Trimesh, at: Array) -> Array:
    return np.asarray(mesh.triangles) @ at[:3, :3].T + at[:3, 3]


# --- the laws -------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_the_distance_is_that_of_the_closest_triangles(seed: int) -> None:
    rng, apart, met = np.random.default_rng(seed), 0, 0
    shapes = meshes(rng)
    pieces = {name: surface(mesh) for name, mesh in shapes.items()}
    pairs = list(itertools.combinations_with_replacement(shapes.items(), 2))
    for (one, mesh), (other, second) in pairs[seed::3]:
        at, there = pose(rng, 0.1), pose(rng, rng.uniform(0.0, 0.7))
        truth, found = judged(moved(mesh, at), moved(second, there)), distance(pieces[one], at, pieces[other], there)
        if truth == 0.0:
            assert found <= SAME, (one, other)
            met += 1
        else:
            assert truth - SAME <= found <= truth + 1e-9, (one, other)
            a, pose_a, b, pose_b = closest_parts(pieces[one], at, pieces[other], there)
            ends = [each.vertices @ place[:3, :3].T + place[:3, 3] for each, place in ((a, pose_a), (b, pose_b))]
            assert judged(*(corners[None, :3] for corners in ends)) == pytest.approx(truth, abs=SAME)
            apart += 1
    assert min(apart, met) > 2


@pytest.mark.parametrize("seed", range(3))
def test_the_distance_to_a_convex_body_is_exact_too(seed: int) -> None:
    rng = np.random.default_rng(seed)
    box, size = trimesh.creation.box((0.2, 0.1, 0.3)), np.array([0.2, 0.1, 0.3])
    for name, mesh in meshes(rng).items():
        at, there = pose(rng, 0.0), pose(rng, rng.uniform(0.1, 0.6))
        local = (moved(mesh, there) - at[:3, 3]) @ at[:3, :3]
        truth = 0.0 if (np.abs(local) <= size / 2).all(axis=2).any() else judged(local, np.asarray(box.triangles))
        found = distance(box_piece(size), at, surface(mesh), there)
        assert found <= truth + 1e-9, name
        assert truth == 0.0 or found >= truth - SAME, name


@pytest.mark.core
@pytest.mark.parametrize("compiled", [True, False])
def test_no_bound_is_above_the_distance_anywhere_on_the_interval(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two bodies that turn and slide: x(s) = R(s) x + s v, with a remainder of at most ½ angle² ‖x‖."""
    if not compiled:
        in_numpy(monkeypatch, parts_loop)
    rng, sharp = np.random.default_rng(4), []
    shapes = meshes(rng)
    for one, other in [("L", "torus"), ("U", "star"), ("shell", "U"), ("soup", "slivers")]:
        at, there, angle = pose(rng, 0.2), pose(rng, 0.7), 0.05
        sides, spins, slides = [], [], []
        for name, place in ((one, at), (other, there)):
            axis = rng.normal(size=3)
            spins.append(angle * axis / np.linalg.norm(axis))
            slides.append(rng.normal(0, 0.02, size=3))
            sides.append(Placed(surface(shapes[name]), place[:3, :3], place[:3, 3], spins[-1], slides[-1]))
        reach = [float(np.linalg.norm(moved(shapes[n], p), axis=2).max()) for n, p in ((one, at), (other, there))]
        first = sum(r * angle + float(np.linalg.norm(v)) for r, v in zip(reach, slides, strict=True))
        second = sum(0.5 * angle**2 * r for r in reach)
        found = part_distance(sides[0], sides[1], (first, second), enough=np.inf)
        least = np.inf
        for s in np.linspace(-1.0, 1.0, 9):
            ends = [
                moved(shapes[name], place) @ Rotation.from_rotvec(s * w).as_matrix().T + s * v
                for name, place, w, v in zip((one, other), (at, there), spins, slides, strict=True)
            ]
            least = min(least, judged(*ends))
        assert found.bound <= least
        assert found.bound >= found.distance - first - 1e-8
        sharp.append((least - found.bound) / first)
    assert np.median(sharp) < 0.3  # bounds that are true but useless would pass the law above


@pytest.mark.parametrize("compiled", [True, False])
def test_a_bound_that_need_not_be_exact_is_still_no_more_than_the_distance(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        in_numpy(monkeypatch, parts_loop)
    rng = np.random.default_rng(5)
    shapes = meshes(rng)
    a, b = surface(shapes["torus"]), surface(shapes["star"])
    for _ in range(2):
        at, there = pose(rng, 0.1), pose(rng, 0.6)
        one, other = Placed.at(a, at), Placed.at(b, there)
        truth = judged(moved(shapes["torus"], at), moved(shapes["star"], there))
        for within in (0.5 * truth, 0.99 * truth, 1.01 * truth, np.inf):
            found = part_distance(one, other, within=within).distance
            assert found <= truth + 1e-9
            assert found > within if within < truth else found >= truth - SAME
        enough = 0.7 * truth
        assert enough <= part_distance(one, other, within=-np.inf, enough=enough).bound <= truth


def test_the_loop_in_c_is_the_one_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(6)
    shapes = [surface(mesh) for mesh in meshes(rng).values()]
    places = [(a, pose(rng, 0.1), b, pose(rng, 0.6)) for a, b in itertools.combinations(shapes, 2)][:12]
    compiled = [distance(*each) for each in places]
    in_numpy(monkeypatch, parts_loop)
    np.testing.assert_allclose([distance(*each) for each in places], compiled, rtol=0, atol=SAME)


def test_threads_find_the_same_numbers() -> None:
    rng = np.random.default_rng(7)
    a, b = (surface(meshes(rng)[name]) for name in ("torus", "star"))
    places = [(a, pose(rng, 0.1), b, pose(rng, 0.5)) for _ in range(20)]
    alone = [distance(*each) for each in places]
    a, b = (Piece(piece.vertices, piece.shape, surface=piece.surface) for piece in (a, b))  # with parts to be built
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda each: distance(a, each[1], b, each[3]), places))
    assert together == alone


@pytest.mark.parametrize("count", [1, 2, 64, 65, 300])
@pytest.mark.parametrize("round_", [True, False])
def test_groups_contain_their_nodes_and_every_part_is_in_one(round_: bool, count: int) -> None:
    rng = np.random.default_rng(8)
    corners, radius = rng.normal(0, 0.1, size=(count, 1, 3)), rng.uniform(0.001, 0.02, size=count)
    if not round_:
        corners, radius = corners + rng.normal(0, 0.02, size=(count, 3, 3)), np.zeros(count)
    parts, along = Parts.of(corners, radius), rng.normal(size=(60, 3))
    reach = parts.support(np.arange(len(parts.first)), along)  # (60, nodes)
    seen = set[int]()
    for node in range(len(parts.first)):
        below = np.arange(parts.first[node], parts.last[node])
        assert (reach[:, below] <= reach[:, node, None]).all()
        if parts.first[node] != node:
            assert not seen & set(below.tolist())
            seen |= set(below.tolist())
    assert seen == set(range(len(parts.first) - 1))
    own = (along @ corners.reshape(-1, 3).T).reshape(60, count, -1).max(axis=2)
    own += np.linalg.norm(along, axis=1)[:, None] * radius
    np.testing.assert_allclose(np.sort(own, axis=1), np.sort(reach[:, :count], axis=1), rtol=0, atol=1e-12)


ARM = (
    *map(link_text, ("base", "elbow")),
    link_text("hand", mesh="L.stl"),
    joint_text("turn", "base", "elbow", limits=(-3, 3), velocity=2),
    joint_text("lift", "elbow", "hand", "0 1 0", limits=(-3, 3), velocity=2),
)


def test_a_hanging_arm_with_a_hollow_hand_and_object_beside_a_moving_ring(tmp_path: Path) -> None:
    """Certified where no two triangles ever meet, with nearly the least distance of any two."""
    rng = np.random.default_rng(9)
    shapes = {name: mesh for name, mesh in meshes(rng).items() if name in ("L", "U", "torus")}
    for name, mesh in shapes.items():
        mesh.export(tmp_path / f"{name}.stl")
    upside_down, grip = Pose((0.1, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0)), Pose((0.0, -0.1, 0.15))
    spec = RobotSpec(urdf=write_robot(tmp_path / "arm.urdf", *ARM), base=upside_down)
    held, times = Attached("fork", "hand", Mesh(tmp_path / "U.stl"), grip), np.linspace(0.0, 2.0, 9)
    statuses = list[Status]()
    for z in (-0.4, 0.1, 0.2):
        moves = SteadyMotion((0.05, -0.03, 0.02), (0.3, 0.1, 0.2))
        ring = Obstacle("ring", Mesh(tmp_path / "torus.stl"), Pose((0.4, 0.1, z)), motion=moves)
        ends = np.array([[-0.4, 0.1], [0.5, -0.3]])
        around = {"obstacles": [ring], "attached": [held], "timing": Timing(duration=2.0)}
        scene = Scene(robot=spec, start=ends[0], goal=ends[1], **around)
        motion = Trajectory(("turn", "lift"), np.linspace(*ends, 9), times=times)
        found, truth = certify(scene, motion, check_ends=False, required=0.0), np.inf
        for share in np.linspace(0.0, 1.0, 17):
            turn, lift = (1.0 - share) * ends[0] + share * ends[1]
            hand = upside_down.matrix.copy()
            hand[:3, :3] = hand[:3, :3] @ Rotation.from_euler("ZY", [turn, lift]).as_matrix()
            there = ObstacleMotion.of(ring).at(np.array([2.0 * share]))[0]
            for name, place in (("L", hand), ("U", hand @ grip.matrix)):
                truth = min(truth, judged(moved(shapes[name], place), moved(shapes["torus"], there)))
        statuses.append(found.status)
        assert found.certified == (truth > 0.0)
        if found.clearance is not None:
            assert truth - max(1e-3, 0.06 * truth) <= found.clearance <= truth
    assert set(statuses) == {Status.CERTIFIED, Status.IN_CONTACT}


def test_a_mesh_of_a_hundred_thousand_triangles_takes_bounded_time_and_memory() -> None:
    ring = trimesh.creation.torus(0.3, 0.1, major_sections=500, minor_sections=100)
    piece, (ball,) = surface(ring), [box_piece(np.array([0.1, 0.1, 0.1]))]
    tracemalloc.start()
    began = time.process_time()
    at = np.eye(4)
    values = []
    for x in np.linspace(-0.1, 0.1, 3):  # in the hole, which the hull does not know
        at[:3, 3] = x, 0.0, 0.0
        values.append(distance(ball, at, piece, np.eye(4)))
    took, (_, most) = time.process_time() - began, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    corner = np.hypot(0.05 + np.abs(np.linspace(-0.1, 0.1, 3)), 0.05)
    np.testing.assert_allclose(values, 0.2 - corner, atol=2e-4)
    assert took < 20.0
    assert most < 200e6
