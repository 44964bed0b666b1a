"""Proofs that no motion exists: never where one does, and always where a ball is clearly shut off."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

import hdplan
from hdplan import Scene
from hdplan.planner.causes import CAUSES, cause_of_refusal
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.exact_proximity import mesh_pieces
from hdplan.planner.certificate.inscribed_balls import inscribed_ball
from hdplan.planner.certificate.seals import Barrier
from hdplan.planner.geometry.meshes import load_mesh
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.infeasible import InfeasibilityCheck
from hdplan.scenes.array_types import Array
from hdplan.scenes.targets import JointTarget
from tests.planner.certificate.rooms import RADIUS, SPAN, crated, proven, sliders

from ..urdf import joint_text, link_text, write_robot

AXIS = np.linspace(-SPAN, SPAN, 51)
GRID_STEP = float(AXIS[1] - AXIS[0])
PLACES = np.stack(np.meshgrid(AXIS, AXIS, AXIS, indexing="ij"), axis=-1).reshape(-1, 3)


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sliders(tmp_path_factory.mktemp("sliders"))


def swapped(scene: Scene) -> Scene:
    return scene.with_start(scene.goal.positions).with_goal(scene.start.positions)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("seed", range(16))
def test_a_window_lets_a_ball_through_or_does_not(urdf: Path, seed: int) -> None:
    widths = ((0.0, 2.4), (1.9, 2.01))[seed % 2]
    shut, open_ = (crated(urdf, seed, width * RADIUS) for width in widths)
    verdict = proven(swapped(shut) if seed % 4 > 1 else shut)
    assert verdict.startswith("a ball 100 mm across inside tool cannot get from start to goal, shut off by ")
    assert "reach" not in verdict
    assert not proven(swapped(open_) if seed % 4 > 1 else open_)


def test_a_plan_ends_with_the_proof(urdf: Path) -> None:
    with pytest.raises(hdplan.UnsolvableError, match=r"^crate: no motion exists: a ball 100 mm") as no:
        hdplan.plan(crated(urdf, 0, 1.9 * RADIUS), time_limit=4.0)
    assert cause_of_refusal(no.value) == "disconnected"
    assert "disconnected" in CAUSES
    assert hdplan.plan(crated(urdf, 0, 2.4 * RADIUS)).certified


def test_a_look_ends_between_its_parts_where_the_search_is_over(urdf: Path) -> None:
    """The search continues there when there is time again: the proof is the same."""
    scene, ended = crated(urdf, 0, 1.9 * RADIUS), [False, True, True]
    search: Any = Ending(Certifier(Setup.of(scene)), lambda: ended.pop(0) if ended else False)
    assert isinstance(scene.goal, JointTarget)
    check = InfeasibilityCheck([search], [scene.goal])
    check._began -= 60.0  # of guesses
    check.refuse()
    assert not ended
    with pytest.raises(hdplan.UnsolvableError, match="no motion exists: a ball 100 mm"):
        check.refuse()


@dataclasses.dataclass
class Ending:
    """A search without a motion or time, which ends on request."""

    certifier: Certifier
    ends: Callable[[], bool]
    required = 0.0
    best = None
    deadline = -np.inf

    @property
    def over(self) -> bool:
        return self.ends()


def test_the_required_clearance_counts_in_proofs_of_infeasibility(urdf: Path) -> None:
    scene = crated(urdf, 1, 2.1 * RADIUS)
    assert not proven(scene, 0.002)
    assert ", with the clearance that it must keep, cannot get" in proven(scene, 0.004)


def test_moving_obstacles_shut_nothing_off(urdf: Path) -> None:
    scene = crated(urdf, 2, 0.0)
    roof = scene.obstacles[3]
    moving = hdplan.SteadyMotion(velocity=[0.0, 0.0, 0.1])
    walls = tuple(dataclasses.replace(each, motion=moving if each is roof else None) for each in scene.obstacles)
    assert proven(scene)
    assert not proven(dataclasses.replace(scene, obstacles=walls, timing=hdplan.Timing()))


def test_a_ball_that_is_held_does_not_fit(urdf: Path, tmp_path: Path) -> None:
    slim = sliders(tmp_path, cylinder=(0.01, 0.4))
    scene = crated(slim, 0, 2.4 * RADIUS)
    held = hdplan.Attached("melon", "tool", hdplan.Sphere(1.3 * RADIUS))
    assert not proven(scene)
    assert "inside melon cannot get" in proven(dataclasses.replace(scene, attached=(held,)))


def test_the_end_of_the_reach_shuts_off() -> None:
    """A beam across the plane of the arm, too low for its tip; and one that leaves it a way."""
    arm = hdplan.load_scene("planar_arm")
    for across, shut in ((2.4, True), (1.2, False)):
        beam = hdplan.Obstacle("beam", hdplan.Box([across, 0.05, 0.1]), hdplan.Pose([0.0, 0.0, 0.18]))
        scene = dataclasses.replace(arm, obstacles=(beam,), start=[0.9, 0.3], goal=[-0.9, -0.3])
        assert ("the end of its reach" in proven(scene)) == shut


@pytest.mark.parametrize(("mouth", "shut"), [(0.97 * RADIUS, True), (1.03 * RADIUS, False)])
def test_a_cup_with_a_mouth(urdf: Path, tmp_path: Path, mouth: float, shut: bool) -> None:
    profile = [(0.0, 0.0), (0.15, 0.0), (0.15, 0.3), (mouth, 0.3), (mouth, 0.29), (0.14, 0.29), (0.14, 0.01), (0, 0.01)]
    cup = hdplan.Obstacle("cup", hdplan.Mesh(str(lathed(tmp_path, profile))), hdplan.Pose([0.0, 0.0, -0.2]))
    robot = hdplan.RobotSpec(urdf=urdf)
    scene = Scene(robot=robot, obstacles=[cup], start=[0.0, 0.0, 0.3], goal=[0, 0, -0.1])
    assert bool(proven(scene)) == shut
    assert bool(proven(swapped(scene))) == shut


def lathed(folder: Path, profile: list[tuple[float, float]]) -> Path:
    """Write the mesh of a profile (radius, height) that is turned about z."""
    turns, lines = 64, list[str]()
    for radius, height in profile:
        for i in range(turns):
            angle = 2.0 * np.pi * i / turns
            lines.append(f"v {radius * np.cos(angle)} {radius * np.sin(angle)} {height}")
    for k in range(len(profile) - 1):
        for i in range(turns):
            a, b = k * turns + i + 1, k * turns + (i + 1) % turns + 1
            lines += [f"f {a} {b} {b + turns}", f"f {a} {b + turns} {a + turns}"]
    file = folder / "lathed.obj"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def test_goals_that_leave_a_choice(urdf: Path) -> None:
    """All goals must be shut off, and of a pose the ball's place must be known."""
    scene = crated(urdf, 3, 0.0)
    inside, outside = scene.goal.positions, scene.start.positions
    pose = hdplan.PoseTarget("tool", hdplan.Pose(inside), free_rotation="all")
    assert "goal[0], shut off by" in proven(scene.with_goal([pose]))
    assert proven(scene.with_goal([pose, hdplan.PoseTarget("tool", hdplan.Pose(inside), position_tolerance=0.01)]))
    assert not proven(scene.with_goal([pose, hdplan.PoseTarget("tool", hdplan.Pose(outside))]))
    assert not proven(scene.with_goal([dataclasses.replace(pose, position_tolerance=0.3)]))


@pytest.mark.sampled(7)
@pytest.mark.parametrize("seed", range(14))
def test_random_walls_are_as_a_dense_grid_says(urdf: Path, seed: int) -> None:
    """Nothing is proven where a grid of places joins start and goal with room to spare; where it does not join them
    even with less room than the ball needs, something is."""
    rng = np.random.default_rng(seed)
    boxes = partition(rng, rng.uniform(1.0, 1.9) if seed % 2 else rng.uniform(3.0, 4.0))
    away = distance_on_grid(boxes)
    rooms = [np.flatnonzero((away.ravel() > RADIUS + GRID_STEP) & (side * PLACES[:, 0] > 0.3)) for side in (1, -1)]
    start, goal = (int(rng.choice(room)) for room in rooms)
    obstacles = tuple(
        hdplan.Obstacle(f"slab{i}", hdplan.Box(size.tolist()), hdplan.Pose(at.tolist(), quaternion.tolist()))
        for i, (at, size, quaternion) in enumerate(boxes)
    )
    ends = {"start": PLACES[start].tolist(), "goal": PLACES[goal].tolist()}
    verdict = proven(Scene(name="room", robot=hdplan.RobotSpec(urdf=str(urdf)), obstacles=obstacles, **ends))
    assert joined(away > RADIUS + 0.5 * GRID_STEP, start, goal) == (not verdict) == (seed % 2 == 0)


def partition(rng: np.random.Generator, width: float) -> list[tuple[Array, Array, Array]]:
    """Four boxes (centre, size, quaternion) of a wall that ends beyond all reach, tilted, with a window, so many radii
    wide."""
    half, tilt = 0.5 * width * RADIUS, rng.uniform(-0.1, 0.1, 3)
    quaternion = np.append(tilt, 1.0) / np.linalg.norm(np.append(tilt, 1.0))
    rotation = hdplan.Pose([0, 0, 0], quaternion.tolist()).matrix[:3, :3]
    y, z = rng.uniform(-0.3, 0.3, 2)
    parts = [(y + half + 0.7, z, 1.4, 2 * half), (y - half - 0.7, z, 1.4, 2 * half)]
    parts += [(y, z + half + 0.7, 3.0, 1.4), (y, z - half - 0.7, 3.0, 1.4)]
    return [(rotation @ [0.0, v, w], np.array([0.01, a, b]), quaternion) for v, w, a, b in parts]


def distance_on_grid(boxes: list[tuple[Array, Array, Array]]) -> Array:
    """How far the places of the grid are from all boxes (k, k, k) [m]."""
    found = np.full(len(PLACES), np.inf)
    for at, size, quaternion in boxes:
        rotation = hdplan.Pose([0, 0, 0], quaternion.tolist()).matrix[:3, :3]
        beyond = np.maximum(np.abs((PLACES - at) @ rotation) - 0.5 * size, 0.0)
        found = np.minimum(found, np.linalg.norm(beyond, axis=1))
    return found.reshape(3 * [len(AXIS)])


def joined(free: Array, start: int, goal: int) -> bool:
    """True if steps along the axes lead from one place of the grid to another."""
    parts, _ = ndimage.label(free)
    return bool(parts.ravel()[start] == parts.ravel()[goal] != 0)


def test_a_ball_is_inside_its_link(tmp_path: Path) -> None:
    """Random points of the ball are inside a jar's thick wall by its winding number, not in what the jar holds."""
    jar = [(0.0, 0.0), (0.15, 0.0), (0.15, 0.3), (0.04, 0.3), (0.04, 0.25), (0.12, 0.25), (0.12, 0.08), (0.0, 0.08)]
    mesh = load_mesh(hdplan.Mesh(str(lathed(tmp_path, jar))), "mesh")
    (piece,) = {piece.surface.solid: piece for piece in mesh_pieces(mesh)}.values()
    center, radius = inscribed_ball(piece)
    assert 0.036 < radius < 0.041
    inward = np.random.default_rng(0).normal(size=(100, 3))
    for point in center + radius * inward / np.linalg.norm(inward, axis=1)[:, None]:
        assert abs(abs(mesh.winding_number(point)) - 1.0) < 1e-6


def test_an_open_mesh_has_no_ball_inside(tmp_path: Path) -> None:
    mesh = load_mesh(hdplan.Mesh(str(lathed(tmp_path, [(0.0, 0.0), (0.15, 0.0), (0.15, 0.3)]))), "mesh")
    assert [inscribed_ball(piece) for piece in mesh_pieces(mesh)] == [None] * len(mesh_pieces(mesh))


def test_a_shut_triangle_is_covered() -> None:
    """Every point of a triangle that counts as shut is within the radius of a corner; one whose circumcentre is inside
    it and farther off is not shut."""
    rng = np.random.default_rng(1)
    points, radii = rng.normal(size=(900, 3)), rng.uniform(0.2, 2.0, 900)
    barrier, triangles = Barrier(points, radii), np.arange(900).reshape(-1, 3)
    shut = barrier.shut(triangles)
    assert 30 < shut.sum() < 270
    shares = rng.dirichlet([0.7, 0.7, 0.7], 300)
    for triangle in triangles[shut]:
        away = np.linalg.norm((shares @ points[triangle])[:, None] - points[triangle], axis=2)
        assert (away <= radii[triangle]).any(axis=1).all()
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    corners = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    for radius, covered in ((0.999, False), (1.001, True)):
        assert Barrier(corners, np.full(3, radius)).shut(np.array([[0, 1, 2]]))[0] == covered


def test_a_forged_seal_is_refused() -> None:
    """A shut octahedron separates its middle from what is outside; with a hole, larger openings, or both ends on one
    side it separates nothing."""
    points = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    middle, outside = np.zeros(3), np.array([3.0, 0.0, 0.0])
    barrier = Barrier(points, np.full(6, 0.9))
    assert barrier.separates(faces, middle, outside, 0.0)
    assert barrier.seal(middle, outside, 0.0) is not None
    assert barrier.seal(outside, middle, 0.0) is not None
    assert not barrier.separates(faces[1:], middle, outside, 0.0)
    assert not barrier.separates(np.concatenate([faces, faces[:, ::-1]]), middle, outside, 0.0)
    assert not barrier.separates(faces, middle, np.array([0.05, 0.0, 0.0]), 0.0)
    assert not barrier.separates(faces, middle, outside, 0.2)
    wide = Barrier(points, np.full(6, 0.8))
    assert not wide.separates(faces, middle, outside, 0.0)
    assert wide.seal(middle, outside, 0.0) is None


def test_few_points_seal_nothing() -> None:
    for points in (np.zeros((1, 3)), np.eye(3), np.eye(3)[[0, 1, 2, 0, 1, 2]] * np.arange(6)[:, None]):
        ends = np.full(3, -1.0), np.full(3, 2.0)
        assert Barrier(points, np.ones(len(points))).seal(*ends, 0.0) is None


def test_a_ball_that_stays_in_place_proves_nothing(tmp_path: Path) -> None:
    """A hub that turns about its own axis, close to a box that its arm can go around."""
    urdf = write_robot(
        tmp_path / "crane.urdf",
        link_text("root"),
        link_text("hub", cylinder=(0.05, 0.2)),
        link_text("arm", box="0.6 0.06 0.06", at="0.3 0 0.2"),
        joint_text("turn", "root", "hub", kind="continuous"),
        joint_text("tilt", "hub", "arm", "0 1 0"),
    )
    box = hdplan.Obstacle("box", hdplan.Box([0.05, 0.05, 0.05]), hdplan.Pose([0.1, 0.0, 0.0]))
    robot = hdplan.RobotSpec(urdf=urdf)
    assert not proven(Scene(robot=robot, obstacles=[box], start=[1.5, 0.0], goal=[-1.5, 0.0]))
