"""A body in a dent of a mesh, or in an open box, is proven not to lie within what its triangles enclose; what does
lie within has no proof, whatever rays a proof names."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.proof.rays import rays
from hdplan.scenes.array_types import Array
from hdplan.verify import RejectedError
from hdplan.verify.balls import HERE
from hdplan.verify.checking import check
from hdplan.verify.kernel import NARROWEST, Motion, check_outside
from hdplan.verify.scene import hull
from hdplan.verify.world import Piece, World

from .forging import files
from .worlds import bare, packed, unpacked

Random = np.random.Generator
Data = dict[str, Any]


def frame(turn: Rotation, at: Any, off: float) -> dict[str, Any]:
    return {"rotation": turn.as_matrix().ravel().tolist(), "position": np.asarray(at).tolist(), "off": off}


STILL = frame(Rotation.identity(), [0.0] * 3, 0.0)


def mesh(points: Any, triangles: Any, off: float = 0.0) -> Data:
    return {**hull(np.asarray(points, dtype=float).tolist()), "parts": np.asarray(triangles).tolist(), "off": off}


def body(name: str, kind: str, shape: Data, place: Data = STILL) -> Data:
    return {"name": name, "kind": kind, "joint": 0 if kind == "held" else -1, **place, "shape": shape}


def world(*bodies: Data, groups: int = 2) -> World:
    """Bodies of which the held ones slide a little, every mesh in several groups of triangles."""
    counts = {str(i): len(x["shape"]["parts"]) for i, x in enumerate(bodies) if x["shape"]["parts"]}
    cuts = {key: np.arange(count) % groups for key, count in counts.items()}
    return World(bare([*bodies], [[0.0], [2.0**-20]]), cuts)


def dot_at(point: Any) -> Data:
    """A small ball that is held."""
    return body("dot", "held", hull([[0.0] * 3], *[1e-4] * 3), frame(Rotation.identity(), point, 0.0))


def clear(found: World, ways: Any, row: int = 0) -> list[bool]:
    """True if rays of the first entry are shown to miss the mesh."""
    number, pieces = found.outside[0]
    joint = next(x.joint for x in found.pieces if x.body == number)
    motion = Motion(found, np.array([[row, row + NARROWEST]]))
    return [motion.outside(found.surfaces[number], joint, pieces, np.asarray(x, dtype=float)) for x in ways]


def proposed(found: World) -> list[bool]:
    """True if the writer finds rays, which the kernel takes."""
    made = [*rays(found)]
    if all(made):
        check_outside(found, np.array([x[0] for x in made if x]), np.array([x[1] for x in made if x]))
    return [x is not None for x in made]


def hit(p: list[int], n: list[int], triangle: list[list[int]]) -> bool:
    """True if p + t n, t >= 0, meets a triangle or its edge: in fractions, by the plane and three sides."""
    a, b, c = ([Fraction(x - y) for x, y in zip(corner, p, strict=True)] for corner in triangle)

    def cross(x: Any, y: Any) -> list[Fraction]:
        return [x[i - 2] * y[i - 1] - x[i - 1] * y[i - 2] for i in range(3)]

    def inner(x: Any, y: Any) -> Fraction:
        return sum((one * two for one, two in zip(x, y, strict=True)), Fraction(0))

    def less(x: Any, y: Any) -> list[Fraction]:
        return [one - two for one, two in zip(x, y, strict=True)]

    normal = cross(less(b, a), less(c, a))
    slope = inner(normal, n)
    if slope == 0:
        raise ValueError  # not generic
    t = inner(normal, a) / slope
    x = [t * Fraction(y) for y in n]
    sides = [inner(normal, cross(less(two, one), less(x, one))) for one, two in ((a, b), (b, c), (c, a))]
    return t >= 0 and min(sides) >= 0


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(3))
def test_a_ray_is_taken_only_where_it_misses_every_triangle(seed: int) -> None:
    """Random triangles, some of them slivers, in whole numbers; a ray is taken wherever it clearly misses."""
    rng = np.random.default_rng(seed)
    taken = refused = 0
    for _ in range(60):
        corners = rng.integers(-6, 7, (int(rng.integers(2, 6)), 3, 3))
        p = rng.integers(-6, 7, 3)
        shape = mesh(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3))
        found = world(dot_at(p), body("m", "obstacle", shape))
        ways = rng.integers(-9, 10, (8, 3))
        for way, good in zip(ways.tolist(), clear(found, ways), strict=True):
            try:
                met = any(hit(p.tolist(), way, x) for x in corners.tolist())
            except ValueError:
                continue
            assert not (good and met)
            taken, refused = taken + (good and not met), refused + (not good and not met)
    assert taken > 100
    assert refused < 0.15 * taken  # those that pass an edge or corner


def bumpy(rng: Random, level: int) -> tuple[Array, Any]:
    """A star about the origin, which is not convex."""
    ball = trimesh.creation.icosphere(level)
    return np.asarray(ball.vertices) * rng.uniform(0.4, 1.0, (len(ball.vertices), 1)), np.asarray(ball.faces)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(6))
def test_points_within_a_star_have_no_ray_and_those_outside_have_one(seed: int) -> None:
    """Turned and placed anyhow, of numbers that are off, held or an obstacle."""
    rng = np.random.default_rng(seed)
    points, triangles = bumpy(rng, int(rng.integers(1, 3)))
    turn, at = Rotation.random(rng=rng), rng.uniform(-2, 2, 3)
    star = mesh(points, triangles, 1e-12)
    place = frame(turn, at, 1e-12)
    way = rng.normal(size=3)
    shares = np.linalg.inv(points[triangles].transpose(0, 2, 1)) @ way
    surface = 1.0 / max(x.sum() for x in shares if x.min() >= 0)  # where the ray from the middle leaves it
    for share, outside in ((0.0, False), (0.97, False), (1.03, True), (3.0, True)):
        p = turn.apply(share * surface * way) + at
        other = {**dot_at(p), "name": "o", "kind": "obstacle", "joint": -1}
        for bodies in ((dot_at(p), body("m", "obstacle", star, place)), (body("m", "held", star, place), other)):
            found = world(*bodies)
            assert len(found.outside) == 1
            assert proposed(found) == [outside]
            ways = rng.normal(size=(40, 3))
            assert outside or not any(clear(found, [*ways, *points, *points[triangles].mean(axis=1), way]))
            assert not outside or any(clear(found, [turn.apply(way)]))


CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
FACES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
         [1, 5, 7], [1, 7, 3]]  # fmt: skip


def test_rays_through_edges_and_corners_are_not_taken() -> None:
    """Out of a closed cube, along whole numbers."""
    found = world(dot_at([0.0, 0.25, 0.5]), body("m", "obstacle", mesh(CUBE, FACES)))
    edges = [(CUBE[a] + CUBE[b]) / 2 for face in FACES for a, b in zip(face, np.roll(face, 1), strict=True)]
    ways = [4 * (x - [0.0, 0.25, 0.5]) for x in [*CUBE, *edges, *np.eye(3), *-np.eye(3)]]
    assert not any(clear(found, [*ways, [0, 0, 0]]))
    assert proposed(found) == [False]


@pytest.mark.parametrize("lacking", range(12))
def test_a_leak_is_the_only_way_out(lacking: int) -> None:
    """A mesh encloses nothing that a hole lets out, be it one triangle."""
    faces = [x for i, x in enumerate(FACES) if i != lacking]
    found, rng = world(dot_at([0.0] * 3), body("m", "obstacle", mesh(CUBE, faces))), np.random.default_rng(lacking)
    hole = CUBE[FACES[lacking]]
    weights = rng.dirichlet(np.ones(3), 30)
    inner = weights[weights.min(axis=1) > 1e-3]
    assert all(clear(found, inner @ hole))
    others = np.array([rng.dirichlet(np.ones(3)) @ CUBE[x] for x in faces for _ in range(3)])
    assert not any(clear(found, others))


def test_a_connected_part_is_outside_as_a_whole() -> None:
    """Two parts of one body, one of them within a closed cube; and one long part."""
    cube = mesh(CUBE, FACES)
    apart = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [5, 0, 0], [5.1, 0, 0], [5, 0.1, 0]]
    for kinds in (("held", "obstacle"), ("obstacle", "held")):
        two = body("two", kinds[0], mesh(apart, [[0, 1, 2], [3, 4, 5]]))
        bodies = sorted((two, body("m", kinds[1], cube)), key=lambda x: str(x["kind"]))
        found = world(*bodies, groups=12)
        numbers = [x["name"] for x in bodies]
        within = [len(pieces) for number, pieces in found.outside if number == numbers.index("m")]
        assert within == [1, 1]
        assert sorted(proposed(found)) == [False, True, True]  # the cube is outside of the triangles
    strip = mesh([*apart[:3], [0.1, 0.1, 0.05], [9, 9, 9]], [[0, 1, 2], [1, 2, 3], [2, 3, 4]])
    found = world(body("strip", "held", strip), body("m", "obstacle", cube), groups=12)
    assert [len(x) for _, x in found.outside] == [12, 3]
    corners = [[0, 0, 0], [1, 1, 1]], [[2, 2, 0.0], [5, 5, 5]], [[3, 3, 3]], [[1.0, 1, 1], [2, 2, -0.0]]
    found.pieces = [Piece("b", "obstacle", 0, "b", -1, HERE, np.array(x)) for x in corners]
    assert [[x.corners[0, 0] for x in each] for each in found.connected(0)] == [[0, 2, 1], [3]]


# --- whole proofs -----------------------------------------------------------------------------------------------------


def open_box(folder: Path, closed: bool = False) -> Path:
    """A box of 0.2 m with thin walls, open above."""
    outer, inner = CUBE * 0.1, np.column_stack([CUBE[:, :2] * 0.09, CUBE[:, 2] * 0.1 + 0.01 * (CUBE[:, 2] < 0)])
    top = (10, 11)
    faces = [x for i, x in enumerate(FACES) if closed or i not in top]
    ring = [] if closed else [(1, 5), (5, 7), (7, 3), (3, 1)]
    rim = [x for a, b in ring for x in ([a, b, b + 8], [a, b + 8, a + 8])]
    faces = [*faces, *([x + 8 for x in each[::-1]] for each in faces), *rim]
    trimesh.Trimesh(np.concatenate([outer, inner]), faces, process=False).export(folder / "box.obj")
    return folder / "box.obj"


ARM = """<robot name="r"><link name="base"/><link name="hand"/>
<joint name="a" type="revolute"><origin xyz="0 0 1"/><parent link="base"/><child link="hand"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1" effort="30"/></joint></robot>"""
SMALL: Data = {"joint_names": ["a"], "positions": [[0], [0.02], [-0.02]]}
BALL: Data = {"shape": {"type": "sphere", "radius": 0.03}}
BOX: Data = {"shape": {"type": "mesh", "file": "box.obj"}}
TASK: Data = {"robot": {"urdf": "r.urdf"}, "start": {"joints": [0]}, "goal": {"joints": [-0.02]}}
HANGING: Data = {**TASK, "robot": {"urdf": "r.urdf", "base": {"position": [0, 0, 2], "rpy": [3.141592653589793, 0, 0]}}}


def held(what: Data, *place: float) -> Data:
    return {"attached": [{"name": "tool", "link": "hand", "pose": {"position": [*place]}, **what}]}


def standing(what: Data, *place: float, **more: Any) -> Data:
    return {"obstacles": [{"name": "thing", "pose": {"position": [*place]}, **what, **more}]}


DRIFT: Data = {"velocity": [0.002, 0, 0.002], "spin": [0, 0, 0.1]}
CASES: dict[str, Data] = {
    "a held ball in an open box": {**TASK, **held(BALL, 0, 0, -0.5), **standing(BOX, 0, 0, 0.5)},
    "a held open box around a ball": {**TASK, **held(BOX, 0, 0, -0.5), **standing(BALL, 0, 0, 0.5)},
    "a held ball in an open box that moves": {
        **TASK, **held(BALL, 0, 0, -0.5), **standing(BOX, 0, 0, 0.5, motion=DRIFT), "timing": {"duration": 2.0},
    },
    "a base that hangs": {**HANGING, **held(BALL, 0, 0, -0.5), **standing(BOX, 0, 0, 1.5)},
    "a held open box under a base that hangs": {**HANGING, **held(BOX, 0, 0, -0.5), **standing(BALL, 0, 0, 1.5)},
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_body_in_a_dent_is_proven_and_other_rays_are_rejected(name: str, tmp_path: Path) -> None:
    """The hulls of the two are never apart."""
    open_box(tmp_path)
    timed = {"times": [0, 1, 2], "velocities": [[0]] * 3} if "timing" in CASES[name] else {}
    given = files(tmp_path, CASES[name], {**SMALL, **timed}, ARM)
    proof = hdplan.prove(*given)
    assert proof.text.startswith("accepted: over the whole motion")
    assert check(*given, proof.data)[0].text == proof.text
    head, world, rest = unpacked(proof.data)
    assert head["rays"] == 1
    found = np.frombuffer(rest[-12:], "<i4")
    for way in (*-np.eye(3)[:2], *np.eye(3)[:2], -found, [0, 0, 0], -np.eye(3)[2] * np.sign(found[2])):
        forged = rest[:-12] + (100 * np.asarray(way)).astype("<i4").tobytes()
        with pytest.raises(RejectedError, match="ray 0 may meet the mesh, at row"):
            check(*given, packed(head, world, forged))
    late = rest[:-16] + (2).to_bytes(4, "little") + rest[-12:]
    with pytest.raises(RejectedError, match="a ray begins after the motion"):
        check(*given, packed(head, world, late))
    with pytest.raises(RejectedError, match="1 rays are to miss meshes, the proof has 0"):
        check(*given, packed({**head, "rays": 0}, world, rest[:-16]))


def test_a_ball_in_a_closed_box_has_no_proof(tmp_path: Path) -> None:
    """The box has two walls, or one."""
    open_box(tmp_path, closed=True)
    for scene in (CASES["a held ball in an open box"], CASES["a held open box around a ball"]):
        given = files(tmp_path, scene, SMALL, ARM)
        with pytest.raises((hdplan.NotProvenError, hdplan.InputError)):
            hdplan.prove(*given)
