"""Laws of what lies inside what: random solids, hollow, nested, inside out, scrambled, in every role.

The judge knows the solids by how they are made (a ray from the middle meets each wall once), and shares no code with
the certificate.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from hdplan import Attached, Mesh, Obstacle, Pose, RobotSpec, Scene, Sphere, SteadyMotion, Trajectory
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.exact_proximity import link_pieces, mesh_pieces
from hdplan.planner.certificate.part_distance import distance
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.geometry.solids import Solid
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array

from ..urdf import joint_text, link_text, write_robot

# --- solids, and the judge --------------------------------------------------------------------------


@dataclass(frozen=True)
class Star:
    """A star-shaped wall around the origin and its copies, each smaller: solid between every other two."""

    vertices: Array
    faces: NDArray[np.int64]
    scales: tuple[float, ...] = (1.0,)  # of the walls, from outside to inside

    def walls(self, points: Array) -> Array:
        """Places of points (k, 3), as a share of the outermost wall in its direction: by the one triangle that a ray
        from the origin meets."""
        shares = np.empty(len(points))
        corners = self.vertices[self.faces].transpose(0, 2, 1)
        for row, point in enumerate(points):
            weights = np.linalg.solve(corners, np.tile(point, (len(corners), 1))[..., None])[..., 0]
            shares[row] = weights[np.all(weights >= -1e-9, axis=1)].sum(axis=1).max()
        return shares

    def inside(self, points: Array) -> NDArray[np.bool_]:
        """True if points (k, 3) are in the material."""
        shares = self.walls(points)
        return np.asarray(sum((shares < scale).astype(int) for scale in self.scales) % 2 == 1)

    def mesh(self) -> TriangleMesh:
        """The walls as one mesh, each other one turned inward."""
        count, parts = len(self.vertices), range(len(self.scales))
        faces = [(self.faces if i % 2 == 0 else self.faces[:, ::-1]) + i * count for i in parts]
        return TriangleMesh(np.vstack([self.vertices * scale for scale in self.scales]), np.vstack(faces))


def star(rng: np.random.Generator, size: float = 0.2, scales: tuple[float, ...] = (1.0,), spikes: float = 0.6) -> Star:
    ball = trimesh.creation.icosphere(1)
    radii = size * rng.uniform(1.0 - spikes, 1.0, size=(len(ball.vertices), 1))
    return Star(np.asarray(ball.vertices) * radii, np.asarray(ball.faces, dtype=np.int64), scales)


def upset(mesh: TriangleMesh, how: str, rng: np.random.Generator) -> TriangleMesh:
    """The same triangles, badly kept."""
    triangles = mesh.triangles
    if how == "inside out":
        triangles = triangles[:, ::-1]
    elif how == "scrambled":
        turned = rng.uniform(size=len(triangles)) < 0.4
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    elif how == "both ways":
        triangles = np.vstack([triangles, triangles[:, ::-1]])
    elif how == "torn":  # every triangle with corners of its own, rounded as files round, some turned
        corners = mesh.vertices[triangles] * (1.0 + 1e-8 * rng.uniform(-1, 1, size=(len(triangles), 3, 1)))
        turned = rng.uniform(size=len(triangles)) < 0.3
        corners = np.where(turned[:, None, None], corners[:, ::-1], corners)
        return TriangleMesh(corners.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    elif how == "twice":
        triangles = np.vstack([triangles, triangles])
    return TriangleMesh(mesh.vertices, rng.permutation(triangles))


def to_file(mesh: TriangleMesh, path: Path) -> Path:
    trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(path)
    return path


# --- the solid by itself ----------------------------------------------------------------------------


@pytest.mark.core
@pytest.mark.parametrize("how", ["as it is", "inside out", "scrambled", "both ways", "torn", "twice"])
@pytest.mark.parametrize("scales", [(1.0,), (1.0, 0.8), (1.0, 0.8, 0.6)], ids=["solid", "hollow", "nested"])
def test_a_body_inside_another_counts_as_inside(how: str, scales: tuple[float, ...]) -> None:
    """A body in a cavity counts as free, where the wall tells that it is one."""
    rng = np.random.default_rng(7)
    filled = how in ("as it is", "inside out", "twice")
    for _ in range(3):
        body = star(rng, 1.0, scales)
        solid = Solid(upset(body.mesh(), how, rng))
        points = rng.uniform(-1.0, 1.0, size=(60, 3))
        points = points[np.abs(body.walls(points)[:, None] - scales).min(axis=1) > 0.01]
        found = np.array([solid.holds(point) for point in points])
        inside, outside = body.inside(points), body.walls(points) > 1.0
        assert found[inside].all()
        assert not found[outside].any()
        if filled:
            assert np.array_equal(found, inside)


def test_a_rigid_move_changes_nothing_and_open_meshes_count_from_half() -> None:
    rng = np.random.default_rng(8)
    body = star(rng, 1.0)
    mesh = body.mesh()
    gone = TriangleMesh(mesh.vertices, mesh.triangles[4:])
    assert not Solid(mesh).open
    assert Solid(gone).open
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    moved = Solid(TriangleMesh(mesh.vertices @ turn.T + shift, mesh.triangles))
    points = rng.uniform(-0.7, 0.7, size=(200, 3))
    points = points[np.abs(body.walls(points) - 1.0) > 1e-3]
    assert [moved.holds(turn @ p + shift) for p in points] == body.inside(points).tolist()
    assert Solid(gone).holds(np.zeros(3))
    bowl = TriangleMesh(mesh.vertices, mesh.triangles[mesh.vertices[mesh.triangles].mean(axis=1)[:, 2] < 0.0])
    assert not Solid(bowl).holds(np.array([0.0, 0.0, 0.9]))


def two_cubes(apart: tuple[float, ...], inverted: bool) -> Solid:
    """A cube and its copy, moved so far, and maybe inside out."""
    one, other = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1))
    other.apply_translation(apart)
    if inverted:
        other.invert()
    both = trimesh.util.concatenate([one, other])
    return Solid(TriangleMesh.merged(both.vertices, both.faces))


def test_two_that_overlap_do_not_cancel_where_one_is_inside_out() -> None:
    points = [0.25, 0.1, 0.05], [-0.4, 0.0, 0.0], [0.9, 0.2, 0.1], [0.0, 0.6, 0.0]  # at the first all wind 0 times
    solid = two_cubes((0.5, 0.2, 0.1), inverted=True)
    assert [solid.holds(np.array(point)) for point in points] == [True, True, True, False]


def test_cubes_that_share_an_edge_are_closed() -> None:
    solid = two_cubes((1.0, 1.0, 0.0), inverted=False)
    assert not solid.open
    points = [0.1, 0.2, 0.3], [1.1, 1.2, 0.3], [0.1, 1.2, 0.3]
    assert [solid.holds(np.array(point)) for point in points] == [True, True, False]


# --- in every role ----------------------------------------------------------------------------------


def write_arm(file: Path, arm: str = link_text("arm"), hand: str = link_text("hand")) -> Path:
    """Write an arm of three joints in one point, with these two links."""
    reach: dict[str, Any] = {"limits": (-3, 3), "velocity": 2}
    joints = (
        joint_text("turn", "base", "arm", **reach),
        joint_text("lift", "arm", "elbow", "0 1 0", **reach),
        joint_text("nod", "elbow", "hand", "1 0 0", **reach),
    )
    return write_robot(file, link_text("base"), arm, link_text("elbow"), hand, *joints)


ROLES = (
    "link, obstacle", "obstacle, link", "held, obstacle", "obstacle, held", "held, mover", "link, link", "held, link"
)  # fmt: skip


def rotation(axis: int, angle: float) -> Array:
    turn, (i, j) = np.eye(3), [(1, 2), (2, 0), (0, 1)][axis]
    turn[[i, j], [i, j]], turn[i, j], turn[j, i] = np.cos(angle), -np.sin(angle), np.sin(angle)
    return turn


def scene_with(role: str, outer: Path, radius: float, at: Array, drift: Array, ends: Array, folder: Path) -> Scene:
    """A solid in one role, a ball at `at` (in the solid's frame for ends at rest) in the other."""
    first, second = role.split(", ")
    ball: dict[str, Any] = {"sphere": radius, "at": " ".join(map(str, at))}
    hand: dict[str, Any] = {"mesh": outer} if first == "link" else ball if role == "obstacle, link" else {}
    arm = ball if role in ("link, link", "held, link") else {}
    urdf = write_arm(folder / f"{role.replace(', ', '_')}.urdf", link_text("arm", **arm), link_text("hand", **hand))
    shapes = {first: (Mesh(outer), Pose()), second: (Sphere(radius), Pose(at))}
    attached = [Attached("held", "hand", *shapes["held"])] if "held" in shapes else []
    obstacles = [Obstacle("thing", *shapes["obstacle"])] if "obstacle" in shapes else []
    if "mover" in shapes:
        obstacles.append(Obstacle("mover", *shapes["mover"], motion=SteadyMotion(drift)))
    around = {"obstacles": obstacles, "attached": attached}
    return Scene(robot=RobotSpec(urdf=urdf), start=ends[0], goal=ends[1], **around)


def in_the_solid(role: str, at: Array, drift: Array, q: Array, seconds: float) -> Array:
    """The ball's centre in the solid's frame: kinematics of three joints in one point, by hand."""
    arm = rotation(2, q[0])
    hand = arm @ rotation(1, q[1]) @ rotation(0, q[2])
    return {
        "link, obstacle": lambda: hand.T @ at,
        "obstacle, link": lambda: hand @ at,
        "held, obstacle": lambda: hand.T @ at,
        "obstacle, held": lambda: hand @ at,
        "held, mover": lambda: hand.T @ (at + drift * seconds),
        "link, link": lambda: hand.T @ arm @ at,
        "held, link": lambda: hand.T @ arm @ at,
    }[role]()


@pytest.mark.parametrize("role", ROLES)
def test_no_ball_in_the_material_is_free_in_any_role(role: str, tmp_path: Path) -> None:
    """No ball that keeps well away from every wall is refused, in cavities too."""
    rng = np.random.default_rng(len(role))
    found: dict[tuple[bool, bool], int] = {}
    for trial in range(8):
        scales = [(1.0,), (1.0, 0.75), (1.0, 0.8, 0.6)][trial % 3]
        how = ["as it is", "inside out", "scrambled", "both ways"][trial // 2 % 4]
        body = star(rng, 0.5, scales, 0.3)
        outer = to_file(upset(body.mesh(), how, rng), tmp_path / f"{trial}.stl")
        radius, drift = 0.005, rng.normal(size=3) * 0.1
        ends = np.stack([rng.uniform(-1, 1, size=3)] * 2)
        ends[1] += rng.normal(size=3) * 0.1
        direction = rng.normal(size=3)
        at = direction / np.linalg.norm(direction) * rng.uniform(0.05, 0.6)
        scene = scene_with(role, outer, radius, at, drift, ends, tmp_path)
        robot = load_scene_robot(scene)
        motion = Trajectory(robot.joint_names, ends, times=np.array([0.0, 1.0]))
        verdict = certify(scene, motion, robot)
        times = np.linspace(0.0, 1.0, 60)
        places = np.array([in_the_solid(role, at, drift, ends[0] + t * (ends[1] - ends[0]), t) for t in times])
        inside = bool(body.inside(places).any())
        away = np.abs(body.walls(places)[:, None] - scales).min() * 0.5
        if inside:
            assert verdict.status is Status.IN_CONTACT, (role, trial, how)
            assert verdict.clearance is None or verdict.self_clearance is None
        elif away > 0.08 and (how in ("as it is", "inside out") or body.walls(places).min() > 1.0):
            assert verdict.certified, (role, trial, how, verdict.text)
        found[inside, verdict.certified] = found.get((inside, verdict.certified), 0) + 1
        # one configuration says the same as the whole motion
        certifier = Certifier(Setup.of(scene, robot))
        if body.inside(places[:1])[0]:
            assert certifier.contacts(ends[0])
            assert certifier.too_close(ends[0], 0.0)[0][0].distance < 0.0
            assert min(place.distance for place in certifier.nearest(ends[0], 0.01) if place) < 0.0
    assert found.get((True, True), 0) == 0
    assert found.get((True, False), 0) > 0


def test_an_obstacle_is_distinguished_from_its_twin_in_the_robot(tmp_path: Path) -> None:
    """The obstacle has the name, the mesh and, at first, the place of a link; later it is around another link."""
    body = to_file(star(np.random.default_rng(0), 1.0, spikes=0.3).mesh(), tmp_path / "body.stl")
    slide = joint_text("slide", "base", "hand", "1 0 0", kind="prismatic", at="3 0 0")
    links = link_text("base", mesh=body), link_text("hand", sphere=0.05)
    robot = RobotSpec(urdf=write_robot(tmp_path / "arm.urdf", *links, slide))
    for name in ("base", "other"):
        mover = Obstacle(name, Mesh(body), motion=SteadyMotion((1.0, 0.0, 0.0)))
        certifier = Certifier(Setup.of(Scene(robot=robot, obstacles=[mover], start=[0.0], goal=[0.1])))
        assert not certifier.is_clear([0.0], 0.0, time=3.0)
        assert certifier.is_clear([0.0], 0.0, time=6.0)


def test_slivers_are_no_contact() -> None:
    """A mesh that is cut along its own vertices gets triangles without width, which coal would find anywhere."""
    ring = trimesh.creation.torus(0.3, 0.1, major_sections=24, minor_sections=12)
    corners, count = np.asarray(ring.vertices).copy(), len(ring.vertices)
    rows = np.flatnonzero(np.abs(corners[:, 1]) < 1e-9)
    corners[rows, 1] = 0.0
    beside = [corners[rows] + [0.0, shift, 0.0] for shift in (4.6e-19, -4.6e-19)]
    slivers = np.stack([rows, count + np.arange(len(rows)), count + len(rows) + np.arange(len(rows))], axis=1)
    pieces = mesh_pieces(TriangleMesh(np.vstack([corners, *beside]), np.vstack([ring.faces, slivers])))
    small, place = link_pieces(coal.Sphere(0.01), "ball")[0], np.eye(4)
    for x, y, z in np.random.default_rng(2).uniform(-0.5, 0.5, size=(40, 3)):
        place[:3, 3] = x, y, z
        found = min(distance(piece, np.eye(4), small, place) for piece in pieces)
        nearest = trimesh.triangles.closest_point(ring.triangles, np.tile(place[:3, 3], (len(ring.faces), 1)))
        assert found == pytest.approx(max(np.linalg.norm(nearest - place[:3, 3], axis=1).min() - 0.01, 0.0), abs=1e-6)


@pytest.mark.parametrize("outer", ["obstacle", "held"])
def test_a_solid_within_a_solid(outer: str, tmp_path: Path) -> None:
    """Two that are not convex, either way round: one in the other's material, in its cavity, half in and half out."""
    rng = np.random.default_rng(5)
    big, small = star(rng, 0.6, (1.0, 0.8), 0.2), star(rng, 0.02)
    dumbbell = TriangleMesh(  # two parts that nothing joins
        np.vstack([small.vertices, small.vertices + [0.0, 0.0, 1.0]]),
        np.vstack([small.faces, small.faces + len(small.vertices)]),
    )
    full = Star(big.vertices, big.faces).mesh()
    cases = (
        ("hollow", big.mesh(), small.mesh(), True),
        ("full", full, small.mesh(), False),
        ("one part in", full, dumbbell, False),
        ("one part in a cavity", big.mesh(), dumbbell, True),
    )
    for name, around, within, free in cases:
        for mesh, file in ((around, "around.stl"), (within, "within.stl")):
            to_file(mesh, tmp_path / file)
        robot = RobotSpec(urdf=write_arm(tmp_path / "arm.urdf"))
        files = ("within.stl", "around.stl") if outer == "obstacle" else ("around.stl", "within.stl")
        held, standing = (Mesh(tmp_path / file) for file in files)
        attached, ends = [Attached("held", "hand", held)], np.array([[0.0, 0.0, 0.0], [0.3, 0.1, 0.05]])
        scene = Scene(robot=robot, obstacles=[standing], attached=attached, start=ends[0], goal=ends[1])
        verdict = certify(scene, Trajectory(("turn", "lift", "nod"), ends))
        assert verdict.certified is free, (name, verdict.text)


def test_a_robot_in_a_room_of_one_mesh_is_free(tmp_path: Path) -> None:
    room, wall = trimesh.creation.box((4, 4, 4)), trimesh.creation.box((4.2, 4.2, 4.2))
    room.invert()
    for name, mesh, free in (("hollow", [wall, room], True), ("solid", [wall], False), ("bare", [room], False)):
        torus = trimesh.creation.torus(6.0, 0.1, major_sections=8, minor_sections=4)
        trimesh.util.concatenate([*mesh, torus]).export(tmp_path / f"{name}.stl")
        ends = np.array([[turn, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785] for turn in (0.0, 0.2)])
        scene = Scene(robot="panda", obstacles=[Mesh(tmp_path / f"{name}.stl")], start=ends[0], goal=ends[1])
        verdict = certify(scene, Trajectory(load_scene_robot(scene).joint_names, ends))
        assert verdict.certified is free, (name, verdict.text)


def test_a_body_that_comes_in_by_the_hole_of_an_open_mesh_is_met_at_the_next_waypoint(tmp_path: Path) -> None:
    """A bottle without a bottom is entered without touching a triangle: containment is checked again at every row."""
    bottle = trimesh.creation.icosphere(3, 0.5)
    middle = bottle.triangles_center
    bottle.update_faces(~((middle[:, 0] > 0.0) & (np.hypot(middle[:, 1], middle[:, 2]) < 0.2)))
    bottle.export(tmp_path / "bottle.stl")
    slide = joint_text("along", "base", "tip", "1 0 0", kind="prismatic")
    urdf = write_robot(tmp_path / "slide.urdf", link_text("base"), link_text("tip", sphere=0.02), slide)
    around = {"robot": RobotSpec(urdf=urdf), "obstacles": [Mesh(tmp_path / "bottle.stl")]}
    for rows, met in (([0.8, 0.0], 1.0), ([0.8, 0.0, 0.8], 0.5), ([0.8, 0.6], None)):
        scene = Scene(start=rows[:1], goal=rows[-1:], **around)
        verdict = certify(scene, Trajectory(("along",), np.array(rows)[:, None]))
        assert verdict.status is (Status.CERTIFIED if met is None else Status.IN_CONTACT)
        assert met is None or verdict.failures[0].parameter == pytest.approx(met)
