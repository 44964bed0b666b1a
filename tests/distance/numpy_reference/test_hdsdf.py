"""Laws of the reference: the equation by hand, sign safety, symmetry, rigid invariance, clearance, broadcasting."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from hdplan.distance.baselines.coal import signed_distance
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import candidate_normals, own_directions
from hdplan.distance.numpy_reference.hdsdf import hdsdf, separating_axis_distance
from hdplan.scenes.errors import InputError

CUBE = ConvexBody.box([1, 1, 1])


def _along_x(distance):
    pose = np.eye(4)
    pose[0, 3] = distance
    return pose


def _spread(body_a, body_b):
    """Return a spread of positions [m] at which about half of the random poses overlap."""
    return 1.2 * sum(np.linalg.norm(b.vertices, axis=1).max() + b.radius for b in (body_a, body_b))


def test_literal_equation_for_two_boxes(tolerance):
    """The paper's formula, term by term with scalar loops and the literal powers, on a pose without a zero."""
    gamma, epsilon = 2, 1e-4
    body_a, body_b = ConvexBody.box([1.0, 0.6, 0.4]), ConvexBody.box([0.3, 0.8, 0.5])
    pose_a, pose_b = np.eye(4), np.eye(4)
    angle = 0.3
    pose_b[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose_b[:3, 3] = [0.9, 0.4, 0.2]

    def shape(u):
        return u * abs(u) ** gamma / (abs(u) ** gamma + epsilon)

    def minimum(values):
        if min(values) > 0:
            return sum(v ** -(gamma + 1.0) for v in values) ** (-1 / (gamma + 1))
        return -(sum(max(-v, 0.0) ** (gamma + 1) for v in values) ** (1 / (gamma + 1)))

    corners_a = [pose_a[:3, :3] @ v + pose_a[:3, 3] for v in body_a.vertices]
    corners_b = [pose_b[:3, :3] @ v + pose_b[:3, 3] for v in body_b.vertices]
    normals = [s * pose[:3, :3] @ e for pose in (pose_a, pose_b) for e in np.eye(3) for s in (1, -1)]
    inner = [shape(minimum([n @ (a - b) for a, b in product(corners_a, corners_b)])) for n in normals]
    truth = shape(-minimum([-g for g in inner]))
    found = hdsdf(body_a, pose_a, body_b, pose_b, epsilon=epsilon)
    np.testing.assert_allclose(found, truth, rtol=tolerance["exact"])


@pytest.mark.parametrize(
    ("gap", "epsilon", "value"),
    [
        (0.5, 1e-6, 0.2435),  # per-body sets; merging A's normals with B's would give 0.1933
        (0.01, 1e-4, 3.1e-6),
        (0.02, 1e-4, 5.0e-4),
        (0.1, 1e-4, 0.045),
        (0.01, 1e-8, 0.005),
    ],
)
def test_parallel_boxes_read_as_measured(gap, epsilon, value):
    """The figures of the design for two parallel unit boxes; epsilon 1e-6 is a shaping length of 1 mm."""
    assert float(hdsdf(CUBE, _along_x(1 + gap), CUBE, np.eye(4), epsilon=epsilon)) == pytest.approx(value, rel=0.02)


def test_default_is_a_millimetre_of_shaping(tolerance):
    default = hdsdf(CUBE, _along_x(1.5), CUBE, np.eye(4))
    np.testing.assert_allclose(default, hdsdf(CUBE, _along_x(1.5), CUBE, np.eye(4), epsilon=1e-6), rtol=1e-9)


def test_edges_crossing_are_a_false_contact_for_the_papers_set():
    """The text's set has no edge-edge axis: at a true gap of 0.1 m the distance reads -0.28 (gamma 2)."""
    pose_a, pose_b = _along_x(np.sqrt(2) + 0.1), np.eye(4)
    half = np.sqrt(0.5)
    pose_a[:3, :3] = [[half, -half, 0], [half, half, 0], [0, 0, 1]]
    pose_b[:3, :3] = [[half, 0, half], [0, 1, 0], [-half, 0, half]]
    assert separating_axis_distance(CUBE, pose_a, CUBE, pose_b) == pytest.approx(0.1)
    assert float(hdsdf(CUBE, pose_a, CUBE, pose_b)) < 0


@pytest.mark.core
@pytest.mark.sampled(5)
def test_never_positive_in_contact(pair, random_poses):
    """d <= 0 => D <= 0, over every pair of bodies, overlapping and apart."""
    body_a, body_b = pair
    spread = _spread(body_a, body_b)
    poses_a, poses_b = random_poses(11, 40, 0.5 * spread), random_poses(12, 40, 0.5 * spread)
    values = hdsdf(body_a, poses_a, body_b, poses_b)
    exact = [signed_distance(body_a, a, body_b, b).distance for a, b in zip(poses_a, poses_b, strict=True)]
    assert not np.any((np.array(exact) <= 0) & (values > 0))
    assert np.any(values > 0), "some pose is seen as free"


def test_never_positive_in_contact_at_hard_poses(hard):
    size = max(np.abs(hard.body_a.vertices).max(), np.abs(hard.body_b.vertices).max(), 1e-6)
    rounding = 1e-15 * max(size, np.abs(hard.pose_a[:3, 3]).max())
    for gamma in (1, 2, 8):
        value = hdsdf(hard.body_a, hard.pose_a, hard.body_b, hard.pose_b, gamma=gamma)
        assert np.isfinite(value)
        if hard.distance <= 0:
            assert value <= rounding


@pytest.mark.sampled(5)
def test_clearance_is_a_larger_radius(pair, random_poses, tolerance):
    """D(A inflated by c, B) > 0 proves d(A, B) > c."""
    body_a, body_b = pair
    clearance = 0.07
    grown = body_a.inflated(clearance)
    for a, b in zip(random_poses(13, 15, 0.7), random_poses(14, 15, 0.7), strict=True):
        exact = signed_distance(body_a, a, body_b, b).distance
        assert abs(signed_distance(grown, a, body_b, b).distance - (exact - clearance)) <= tolerance["oracle"]
        if hdsdf(grown, a, body_b, b) > 0:
            assert exact > clearance


@pytest.mark.sampled(5)
def test_symmetric(pair, random_poses, tolerance):
    body_a, body_b = pair
    a, b = random_poses(15, 10, 0.7), random_poses(16, 10, 0.7)
    forward, backward = hdsdf(body_a, a, body_b, b), hdsdf(body_b, b, body_a, a)
    np.testing.assert_allclose(forward, backward, rtol=tolerance["witness"], atol=1e-15)


@pytest.mark.core
@pytest.mark.sampled(5)
def test_rigid_invariance(pair, random_poses, tolerance):
    body_a, body_b = pair
    a, b, motion = random_poses(17, 10, 0.7), random_poses(18, 10, 0.7), random_poses(19, 10, 3.0)
    here, there = hdsdf(body_a, a, body_b, b), hdsdf(body_a, motion @ a, body_b, motion @ b)
    np.testing.assert_allclose(here, there, rtol=tolerance["invariance"], atol=tolerance["exact"])


def test_poses_broadcast_and_a_batch_is_a_loop(random_poses):
    body_a, body_b = ConvexBody.capsule(0.1, 0.5), ConvexBody.platonic("octahedron", 0.5)
    a, b = random_poses(20, 3, 1.0), random_poses(21, 4, 1.0)
    table = hdsdf(body_a, a[:, None], body_b, b[None])
    assert table.shape == (3, 4)
    for i, j in product(range(3), range(4)):
        single = hdsdf(body_a, a[i], body_b, b[j])
        assert single.shape == ()
        np.testing.assert_allclose(table[i, j], single, rtol=1e-12)
    assert hdsdf(body_a, a[:0], body_b, b[0]).shape == (0,)


def test_large_gamma_and_short_shaping_tend_to_the_hard_minimum_and_maximum(random_poses):
    """The limit is D-tilde, max over the paper's set of the min over the vertices: at most the exact distance."""
    body_a, body_b = ConvexBody.box([1.0, 0.6, 0.4]), ConvexBody.platonic("tetrahedron", 0.7)
    for a, b in zip(random_poses(22, 10, 1.0), random_poses(23, 10, 1.0), strict=True):
        limit = float(hdsdf(body_a, a, body_b, b, gamma=2000, shaping_length=1e-9))
        exact = signed_distance(body_a, a, body_b, b).distance
        assert limit <= exact + 0.01
        assert limit <= separating_axis_distance(body_a, a, body_b, b) + 0.01


def test_directions_per_body():
    directions, counts = own_directions(CUBE)
    assert len(directions) == 3
    np.testing.assert_array_equal(counts, 5)  # in the multiset: one face up to sign, four edges
    assert len(own_directions(ConvexBody.platonic("icosahedron"))[0]) == 25
    aligned = candidate_normals("paper", CUBE, CUBE)
    assert len(aligned.in_a) == len(aligned.in_b) == 3
    for flat in (ConvexBody.sphere(0.1), ConvexBody.capsule(0.1, 0.5), ConvexBody.from_points([[0, 0, 0], [1, 2, 3]])):
        frame, _ = own_directions(flat)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)


def test_bad_arguments_are_refused():
    for words, match in [
        ({"normals": "papper"}, "did you mean 'paper'"),
        ({"gamma": 0}, "gamma"),
        ({"shaping_length": 0.0}, "shaping_length"),
        ({"epsilon": -1.0}, "epsilon"),
    ]:
        with pytest.raises(InputError, match=match):
            hdsdf(CUBE, np.eye(4), CUBE, np.eye(4), **words)
    with pytest.raises(InputError, match="pose_a"):
        hdsdf(CUBE, np.eye(3), CUBE, np.eye(4))
    with pytest.raises(InputError, match="pose_b"):
        hdsdf(CUBE, np.eye(4), CUBE, np.full((4, 4), np.nan))
