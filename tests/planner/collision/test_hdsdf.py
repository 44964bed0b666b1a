"""Laws of the distance in C: CasADi's values and derivatives but for rounding, at every pose and order of smoothness,
and the derivative that differences of D show."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.symbolic import row_function
from hdplan.distance.symbolic.halfspaces import halfspace_distance
from hdplan.planner.collision import hdsdf
from hdplan.planner.collision.broad_phase import BodyPairs, body_pairs
from hdplan.planner.collision.halfspace_bodies import from_shape
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.shapes import Box, Cylinder, Points
from tests.loops import in_numpy, needs_loops

ORDERS = (1, 2, 3, 4, 5, 7, 12, 32)  # gamma; 2 is compiled as a constant, the root is found in four ways
ROUNDING = 1e-12
COUNT = 150  # poses

pytestmark = needs_loops


@pytest.fixture(scope="module")
def pairs() -> BodyPairs:
    """Three bodies of unequal numbers of vertices with three of 26, 50 and 50 planes."""
    rng = np.random.default_rng(3)
    rounded = ConvexBody.from_points(rng.normal(size=(4, 3)) * 0.1, 0.03)
    solids = (ConvexBody.box([0.2, 0.2, 0.2]), rounded, ConvexBody.capsule(0.05, 0.4))
    bodies = [LinkBody("link", 1, solid) for solid in solids]
    cloud = Points(tuple(map(tuple, (rng.normal(size=(9, 3)) * 0.1).tolist())))
    others = [from_shape("other", shape, np.eye(4)) for shape in (Box((0.2, 0.3, 0.4)), Cylinder(0.1, 0.2), cloud)]
    moves = np.array([[False], [True]])
    return body_pairs(bodies, others, [(a, b) for a in range(3) for b in range(3)], 0.01, moves)


def poses() -> KinematicsBatch:
    """The world, and a joint: at random places near it, and aligned with it, where many projections are the least."""
    rng = np.random.default_rng(5)
    placements = np.zeros((COUNT, 2, 12))
    placements[:, :, [0, 4, 8]] = 1.0
    for k in range(COUNT):
        if k % 2:
            placements[k, 1, :9] = pin.Quaternion(rng.normal(size=4)).normalized().toRotationMatrix().ravel()
        placements[k, 1, 9:] = rng.choice([-0.25, -0.1, 0.0, 0.2, 0.25], 3) if k % 4 < 2 else rng.normal(size=3) * 0.2
    return KinematicsBatch(placements, np.zeros((COUNT, 1, 6)))


def everywhere(pairs: BodyPairs) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return np.repeat(np.arange(COUNT), len(pairs)), np.tile(np.arange(len(pairs)), COUNT)


@pytest.mark.parametrize("gamma", ORDERS)
@pytest.mark.parametrize("length", [1e-4, 0.03])
def test_pair_distances_equal_casadis(
    pairs: BodyPairs, gamma: int, length: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinematics, rows = poses(), everywhere(pairs)
    found = HdsdfPairs(pairs, gamma, length)(kinematics, *rows)
    in_numpy(monkeypatch, hdsdf)
    monkeypatch.setattr(row_function, "_library", lambda _: None)  # the interpreter: to compile it takes seconds
    expected = HdsdfPairs(pairs, gamma, length)(kinematics, *rows)
    assert (expected[0] < 0).mean() > 0.2
    assert (expected[0] > 0).mean() > 0.2
    for one, other in zip(found, expected, strict=True):
        assert np.isfinite(one).all()
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=ROUNDING)


@pytest.mark.core
def test_the_wrench_is_the_derivative(pairs: BodyPairs) -> None:
    """Central differences along random twists agree where D is smooth: at order 3 all over but at D = 0."""
    distance, kinematics, step = HdsdfPairs(pairs, 3, 0.01), poses(), 1e-6
    rows, twist = everywhere(pairs), np.random.default_rng(7).normal(size=6)
    moved = []
    for sign in (1, -1):
        by = pin.exp6(pin.Motion(sign * step * twist))
        placements = kinematics.placements.copy()
        rotations = placements[:, 1, :9].reshape(-1, 3, 3)
        placements[:, 1, :9] = (by.rotation @ rotations).reshape(-1, 9)
        placements[:, 1, 9:] = placements[:, 1, 9:] @ by.rotation.T + by.translation
        moved.append(distance(KinematicsBatch(placements, kinematics.columns), *rows)[0])
    value, wrench, _ = distance(kinematics, *rows)
    smooth = np.abs(value) > 1e-3
    slope = (moved[0] - moved[1]) / (2 * step)
    assert smooth.mean() > 0.5
    np.testing.assert_allclose((wrench @ twist)[smooth], slope[smooth], rtol=1e-4, atol=1e-6)


def test_its_equations_are_casadi_functions(pairs: BodyPairs) -> None:
    functions = HdsdfPairs(pairs, 2, 1e-3).functions
    assert functions == {f"{count} planes": halfspace_distance(8, count, 2, 1e-3) for count in (26, 50)}
