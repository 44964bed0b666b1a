"""Bodies, poses and tolerances that the tests of the distance share. Everything random is seeded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hdplan.distance.bodies import ConvexBody

Array = NDArray[np.float64]

TOLERANCES = {
    "exact": 1e-12,  # two ways of computing one number in float64, relative to the size of the numbers
    "witness": 1e-10,  # NumPy reference against CasADi, relative: sums in another order, constants merged
    "invariance": 1e-9,  # the same pair seen from a frame metres away: rounding of the positions, amplified by Phi
    "difference": 2e-6,  # central differences with steps of 1e-5 of the shaping length that the test uses, relative
    "oracle": 2e-9,  # coal's accepted answers: the guard's own bound (1e-9 of the size), on both sides
}

BODIES = {
    "box": ConvexBody.box([1.0, 0.6, 0.4]),
    "plate": ConvexBody.box([1.0, 0.8, 1e-4]),
    "sphere": ConvexBody.sphere(0.3),
    "capsule": ConvexBody.capsule(0.15, 0.8),
    "cylinder": ConvexBody.cylinder(0.3, 0.7, sides=6),
    "tetrahedron": ConvexBody.platonic("tetrahedron", 0.7),
    "swept octahedron": ConvexBody.platonic("octahedron", 0.5).inflated(0.05),
    "point": ConvexBody.from_points([[0.1, 0.0, 0.0]]),
    "segment": ConvexBody.from_points([[0.0, 0.0, 0.0], [0.3, 0.4, 0.5]]),
    "triangle": ConvexBody.from_points([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0], [0.1, 0.6, 0.2]]),
    "swept triangle": ConvexBody.from_points([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0], [0.1, 0.6, 0.2]], radius=0.1),
}
PAIRS = list(combinations_with_replacement(BODIES, 2))


@dataclass(frozen=True)
class Case:
    """A hard pose whose signed distance has a closed form."""

    name: str
    body_a: ConvexBody
    pose_a: Array
    body_b: ConvexBody
    pose_b: Array
    distance: float  # [m]


def place(x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation: Rotation | None = None) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3) if rotation is None else rotation.as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def _turn(axis: str, degrees: float) -> Rotation:
    return Rotation.from_euler(axis, degrees, degrees=True)


def _hard_cases() -> list[Case]:
    cube, big = ConvexBody.box([1, 1, 1]), ConvexBody.box([4, 4, 4])
    ball, capsule = ConvexBody.sphere(0.3), ConvexBody.capsule(0.1, 1.0)
    bar = ConvexBody.from_points([[0, 0, -0.5], [0, 0, 0.5]])
    flat = ConvexBody.from_points([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    needle, plate = ConvexBody.box([1, 1e-6, 1e-6]), ConvexBody.box([1, 1, 1e-6])
    edge_z, edge_y = _turn("z", 45), _turn("y", 45)
    corner = Rotation.align_vectors([[1, 0, 0]], [[1, 1, 1]])[0]
    half, root = np.sqrt(0.5), np.sqrt(0.75)
    origin = place()
    cases = [
        ("faces touch", cube, place(1), cube, origin, 0.0),
        ("faces, gap 1e-9", cube, place(1 + 1e-9), cube, origin, 1e-9),
        ("faces, depth 1e-9", cube, place(1 - 1e-9), cube, origin, -1e-9),
        ("faces, shifted along themselves", cube, place(1.25, 0.3, 0.2), cube, origin, 0.25),
        ("parallel boxes 0.5 m apart", cube, place(1.5), cube, origin, 0.5),
        ("aligned edges touch", cube, place(1, 1), cube, origin, 0.0),
        ("aligned corners touch", cube, place(1, 1, 1), cube, origin, 0.0),
        ("identical", cube, origin, cube, origin, -1.0),
        ("one inside the other", cube, origin, big, origin, -2.5),
        ("one inside the other, off centre", cube, place(1.0, 0.2), big, origin, -1.5),
        ("crossed edges touch", cube, place(2 * half, 0, 0, edge_z), cube, place(0, 0, 0, edge_y), 0.0),
        ("crossed edges, 0.1 m apart", cube, place(2 * half + 0.1, 0, 0, edge_z), cube, place(0, 0, 0, edge_y), 0.1),
        ("parallel edges touch", cube, place(2 * half, 0, 0, edge_z), cube, place(0, 0, 0, edge_z), 0.0),
        ("edge on face", cube, place(half + 0.5, 0, 0, edge_z), cube, origin, 0.0),
        ("corner on face", cube, place(root + 0.5, 0, 0, corner), cube, origin, 0.0),
        ("corner on face, gap 1e-9", cube, place(root + 0.5 + 1e-9, 0, 0, corner), cube, origin, 1e-9),
        ("corners touch", cube, place(2 * root, 0, 0, corner), cube, place(0, 0, 0, corner), 0.0),
        ("far away", cube, place(1e6), cube, origin, 1e6 - 1),
        ("micrometres", ConvexBody.box([1e-6] * 3), place(1.5e-6), ConvexBody.box([1e-6] * 3), origin, 0.5e-6),
        ("megametres", ConvexBody.box([1e6] * 3), place(1.5e6), ConvexBody.box([1e6] * 3), origin, 0.5e6),
        ("megametres touch", ConvexBody.box([1e6] * 3), place(1e6), ConvexBody.box([1e6] * 3), origin, 0.0),
        ("needle on box", needle, place(1), cube, origin, 0.0),
        ("needles crossed", needle, place(0, 0, 1.1e-6), needle, place(0, 0, 0, _turn("z", 90)), 1e-7),
        ("plate in box", plate, origin, cube, origin, -0.5 - 0.5e-6),
        ("plates on each other", plate, place(0, 0, 1e-6), plate, origin, 0.0),
        ("balls touch", ball, place(0.6), ball, origin, 0.0),
        ("balls with one centre", ball, origin, ball, origin, -0.6),
        ("balls apart", ball, place(0, 1), ball, origin, 0.4),
        ("ball on a face's centre line, touching", ball, place(0.8), cube, origin, 0.0),
        ("ball's centre on a face", ball, place(0.5), cube, origin, -0.3),
        ("ball's centre on a corner", ball, place(0.5, 0.5, 0.5), cube, origin, -0.3),
        ("ball in the box", ball, origin, cube, origin, -0.8),
        ("ball off a corner", ball, place(1, 1, 1), cube, origin, root - 0.3),
        ("capsules side by side", capsule, place(0.5), capsule, origin, 0.3),
        ("capsules touch along a line", capsule, place(0.2), capsule, origin, 0.0),
        ("capsules on one axis, apart", capsule, place(0, 0, 1.5), capsule, origin, 0.3),
        ("capsules on one axis, overlapping", capsule, place(0, 0, 0.5), capsule, origin, -0.2),
        ("capsules crossed", capsule, place(0.5, 0, 0, _turn("y", 0)), capsule, place(0, 0, 0, _turn("x", 90)), 0.3),
        ("capsules crossed through each other", capsule, origin, capsule, place(0, 0, 0, _turn("x", 90)), -0.2),
        ("capsule along an edge", capsule, place(0.6, 0.6), cube, origin, np.sqrt(0.02) - 0.1),
        ("segments cross", bar, origin, bar, place(0, 0, 0, _turn("x", 30)), 0.0),
        ("segments on one line overlap", bar, place(0, 0, 0.2), bar, origin, 0.0),
        ("segment through a triangle", bar, place(0.2, 0.3), flat, origin, -0.2),
        ("coplanar triangles overlap", flat, place(0.1, 0.1), flat, origin, 0.0),
        ("coplanar triangles apart", flat, place(1.5), flat, origin, 0.5),
        ("triangle in a box", flat, origin, big, origin, -2.0),
        ("equal points", ConvexBody.from_points([[0, 0, 0]]), origin, ConvexBody.from_points([[0, 0, 0]]), origin, 0.0),
    ]
    for angle in (1e-15, 1e-12, 1e-8, 1e-3):  # [rad] nearly parallel faces; the lower edge comes nearest
        turned = Rotation.from_rotvec([0, 0, angle])
        reach = 0.5 * (np.cos(angle) + np.sin(angle))
        cases.append((f"faces {angle} rad from parallel", cube, place(1.5, 0, 0, turned), cube, origin, 1 - reach))
        cases.append(
            (f"touching, {angle} rad from parallel", cube, place(0.5 + reach, 0, 0, turned), cube, origin, 0.0)
        )
    return [Case(*case) for case in cases]


HARD = _hard_cases()


def _random_pose(rng: np.random.Generator, spread: float) -> Array:
    return place(*rng.uniform(-spread, spread, 3), Rotation.from_quat(rng.normal(size=4)))


@pytest.fixture
def random_poses() -> Callable[[int, int, float], Array]:
    """Return ``(seed, count, spread)`` -> (count, 4, 4) poses, each coordinate uniform within ``spread`` [m]."""

    def draw(seed: int, count: int, spread: float) -> Array:
        rng = np.random.default_rng(seed)
        return np.array([_random_pose(rng, spread) for _ in range(count)])

    return draw


@pytest.fixture(params=PAIRS, ids=lambda pair: "-".join(pair))
def pair(request: pytest.FixtureRequest) -> tuple[ConvexBody, ConvexBody]:
    """Return every unordered pair of the bodies."""
    first, second = request.param
    return BODIES[first], BODIES[second]


@pytest.fixture(params=HARD, ids=lambda case: case.name)
def hard(request: pytest.FixtureRequest) -> Case:
    """Return every hard case."""
    case: Case = request.param
    return case


@pytest.fixture(scope="session")
def bodies() -> dict[str, ConvexBody]:
    return BODIES


@pytest.fixture(scope="session")
def tolerance() -> dict[str, float]:
    return TOLERANCES
