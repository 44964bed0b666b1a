"""The GDF baseline keeps the laws of its theory, and gives the numbers of its authors' package."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.studies.random_poses import PLATONIC_PAIRS, paper_poses
from hdplan.scenes.errors import InputError
from tests.distance.hard_cases import place

BOX, SOLID = ConvexBody.box([1.0, 0.6, 0.4]), ConvexBody.platonic("dodecahedron", 0.5)
TIGHT = {"tolerance": 1e-12, "iterations": 20000}
ROUNDING = 1e-6  # what the tight tolerance leaves: the last step is a small part of the way that remains


def _apart(body_a, body_b, seed, count, gap=0.2):
    """Return the first ``count`` of the paper's poses with a gap."""
    poses_a, poses_b = paper_poses(np.random.default_rng(seed), 6 * count)
    distances = signed_distances(body_a, poses_a, body_b, poses_b)
    chosen = np.flatnonzero(distances > gap)[:count]
    return [(poses_a[k], poses_b[k], distances[k]) for k in chosen]


@pytest.mark.parametrize("bodies", [(BOX, BOX), (BOX, SOLID), (SOLID, SOLID)], ids=["boxes", "mixed", "solids"])
def test_symmetric(bodies):
    body_a, body_b = bodies
    for pose_a, pose_b, _ in _apart(body_a, body_b, 1, 5):
        one, other = gdf(body_a, pose_a, body_b, pose_b, **TIGHT), gdf(body_b, pose_b, body_a, pose_a, **TIGHT)
        assert one.converged
        assert one.distance == pytest.approx(other.distance, abs=ROUNDING)
        np.testing.assert_allclose(one.gradient_a, -other.gradient_a, atol=1e-4)


def test_rigid_motions_change_nothing(random_poses):
    move = random_poses(2, 1, 3.0)[0]
    for pose_a, pose_b, _ in _apart(BOX, SOLID, 3, 5):
        here = gdf(BOX, pose_a, SOLID, pose_b, **TIGHT)
        there = gdf(BOX, move @ pose_a, SOLID, move @ pose_b, **TIGHT)
        assert here.distance == pytest.approx(there.distance, abs=ROUNDING)
        np.testing.assert_allclose(move[:3, :3] @ here.gradient_a, there.gradient_a, atol=1e-4)


def test_euclidean_for_boxes_in_the_limit():
    errors = []
    for smoothing in (0.1, 1e-2, 1e-4):
        found = [
            gdf(BOX, a, BOX, b, h=smoothing, bulging=smoothing / 10, **TIGHT).distance - exact
            for a, b, exact in _apart(BOX, BOX, 4, 10)
        ]
        errors.append(np.max(np.abs(found)))
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < 1e-3


def test_the_gradient_is_the_derivative_by_as_translation():
    step = 1e-5
    for pose_a, pose_b, _ in _apart(SOLID, BOX, 5, 3):
        found = gdf(SOLID, pose_a, BOX, pose_b, **TIGHT)
        for axis in range(3):
            moved = [pose_a.copy(), pose_a.copy()]
            moved[0][axis, 3] += step
            moved[1][axis, 3] -= step
            ahead, behind = (gdf(SOLID, pose, BOX, pose_b, start=found.point_a, **TIGHT).distance for pose in moved)
            assert (ahead - behind) / (2 * step) == pytest.approx(found.gradient_a[axis], abs=1e-4)


@pytest.mark.parametrize("names", PLATONIC_PAIRS, ids="-".join)
def test_zero_where_the_bodies_overlap(names, random_poses):
    """The iteration creeps from outside towards the common part, where both functions are flat; in it, it stays."""
    body_a, body_b = map(ConvexBody.platonic, names)
    pose_a, pose_b = random_poses(6, 2, 0.1)  # the smallest inscribed ball has a radius of 1/3 m
    inside = 0.5 * (pose_a + pose_b)[:3, 3]
    assert gdf(body_a, pose_a, body_b, pose_b, start=inside).distance == 0
    found = gdf(body_a, pose_a, body_b, pose_b, start=inside + [2.0, 1.0, -1.0], tolerance=1e-5, iterations=5000)
    assert found.converged
    assert found.distance < 5e-3


def test_no_gradient_at_distance_zero():
    found = gdf(BOX, np.eye(4), BOX, np.eye(4))
    assert found.distance == 0
    assert found.iterations == 1
    np.testing.assert_array_equal(found.gradient_a, np.zeros(3))
    np.testing.assert_array_equal(found.point_a, found.point_b)


def test_an_iteration_cut_short_says_so():
    pose_a, pose_b, _ = _apart(SOLID, SOLID, 7, 1)[0]
    assert not gdf(SOLID, pose_a, SOLID, pose_b, iterations=1).converged
    found = gdf(SOLID, pose_a, SOLID, pose_b)
    assert found.converged
    assert found.iterations > 1
    again = gdf(SOLID, pose_a, SOLID, pose_b, start=found.point_a)
    assert again.iterations < found.iterations


def test_large_and_small_arguments_of_the_smoothing():
    pose_a, pose_b, _ = _apart(BOX, SOLID, 8, 1)[0]
    for h in (1e-6, 0.3, 0.7, 2.0, 1e3):
        for bulging in (0.0, 0.1, 0.5, 1.0):
            found = gdf(BOX, pose_a, SOLID, pose_b, h=h, bulging=bulging)
            assert np.isfinite([found.distance, *found.point_a, *found.point_b, *found.gradient_a]).all()


# What uaibot 1.2.7 (float32) answers for h = 0.1, eps = 0.01, tol = 1e-9, B at the origin and A turned and moved:
TURN, PLACE = [0.3, -0.5, 0.7], [1.6, 0.9, -1.1]
UAIBOT = [
    ("tetrahedron", "tetrahedron", 0.3417538),
    ("tetrahedron", "cube", 0.3636508),
    ("tetrahedron", "octahedron", 0.2154269),
    ("tetrahedron", "icosahedron", 0.1637527),
    ("tetrahedron", "dodecahedron", 0.1473617),
    ("cube", "cube", 0.1774606),
    ("cube", "octahedron", 0.2115389),
    ("cube", "icosahedron", 0.0851292),
    ("cube", "dodecahedron", 0.0460953),
    ("octahedron", "octahedron", 0.0687565),
    ("octahedron", "icosahedron", 0.0441866),
    ("octahedron", "dodecahedron", 0.0355276),
    ("icosahedron", "icosahedron", 0.0241788),
    ("icosahedron", "dodecahedron", 0.0137431),
    ("dodecahedron", "dodecahedron", 0.0088223),
]


@pytest.mark.parametrize(("one", "other", "distance"), UAIBOT)
def test_the_numbers_of_the_authors_package(one, other, distance):
    x, y, z = PLACE
    pose = place(x, y, z, Rotation.from_rotvec(TURN))
    found = gdf(ConvexBody.platonic(one), pose, ConvexBody.platonic(other), np.eye(4), **TIGHT)
    assert found.distance == pytest.approx(distance, abs=5e-7)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"h": 1.0}, "h: found 1.0"),
        ({"h": 0.5}, "h: found 0.5"),
        ({"h": 0.0}, "h: found 0.0"),
        ({"h": np.nan}, "h: found nan"),
        ({"bulging": -0.1}, "bulging: found -0.1"),
        ({"tolerance": np.inf}, "tolerance: found inf"),
        ({"iterations": 0}, "iterations: found 0"),
        ({"start": [1.0, 2.0]}, "start: found"),
    ],
)
def test_bad_parameters_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        gdf(BOX, np.eye(4), BOX, np.eye(4), **options)


def test_bodies_without_volume_or_with_a_radius_are_refused(bodies):
    with pytest.raises(InputError, match=r"swept by 0\.1 m"):
        gdf(BOX.inflated(0.1), np.eye(4), BOX, np.eye(4))
    with pytest.raises(InputError, match="2 faces"):
        gdf(BOX, np.eye(4), bodies["triangle"], np.eye(4))
    with pytest.raises(InputError, match="pose_b"):
        gdf(BOX, np.eye(4), BOX, np.eye(3))
