"""Bodies, poses and tolerances that the tests of the distance share. Everything random is seeded."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.bodies import ConvexBody
from hdplan.scenes.array_types import Array
from tests.distance.hard_cases import HARD, Case, place

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


def _random_pose(rng: np.random.Generator, spread: float) -> Array:
    x, y, z = rng.uniform(-spread, spread, 3)
    return place(x, y, z, Rotation.from_quat(rng.normal(size=4)))


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


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give every test a cache of its own, empty."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("HDPLAN_CACHE", str(folder))
    return folder


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the runs of the compiler."""
    counted: list[int] = []
    run = subprocess.run

    def counting(*args: object, **kwargs: object) -> object:
        counted.append(1)
        return run(*args, **kwargs)

    monkeypatch.setattr(subprocess, "run", counting)
    return counted
