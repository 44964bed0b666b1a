"""The oracle is exact: closed forms, ground truth, and its own proof (supporting planes and witness points)."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.baselines import coal as oracle
from hdplan.distance.baselines.coal import CoalPair, signed_distance, signed_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.numpy_reference.hdsdf import separating_axis_distance
from hdplan.distance.studies.random_poses import touching_poses
from hdplan.scenes.errors import InputError
from tests.distance.hard_cases import place


def _nothing_proven(*arguments):
    return np.zeros(len(arguments[-1].distances), dtype=bool)


def _gap(body, pose, direction):
    """Return the extent of a swept body along a unit direction, (min, max)."""
    along = (body.vertices @ pose[:3, :3].T + pose[:3, 3]) @ direction
    return along.min() - body.radius, along.max() + body.radius


def _check_proof(found, body_a, pose_a, body_b, pose_b, bound):
    np.testing.assert_allclose(np.linalg.norm(found.normal), 1.0, rtol=1e-9)
    np.testing.assert_allclose(found.point_a - found.point_b, found.distance * found.normal, atol=bound)
    gap = _gap(body_a, pose_a, found.normal)[0] - _gap(body_b, pose_b, found.normal)[1]
    assert abs(gap - found.distance) <= bound, "the gap along the normal is the distance"


def test_closed_forms(hard, tolerance):
    size = max(1.0, abs(hard.distance))
    if hard.name == "micrometres":
        size = 1e-6
    found = signed_distance(hard.body_a, hard.pose_a, hard.body_b, hard.pose_b)
    bound = tolerance["oracle"] * size
    assert abs(found.distance - hard.distance) <= bound
    _check_proof(found, hard.body_a, hard.pose_a, hard.body_b, hard.pose_b, bound)
    bulk = signed_distances(hard.body_a, [hard.pose_a] * 3, hard.body_b, [hard.pose_b] * 3)
    np.testing.assert_allclose(bulk, hard.distance, rtol=0, atol=bound)


@pytest.mark.sampled(5)
def test_ground_truth_has_the_closed_forms(hard, tolerance, monkeypatch):
    monkeypatch.setattr(oracle, "_proven", _nothing_proven)
    size = max(1.0, abs(hard.distance), np.abs(hard.body_a.vertices).max())
    found = signed_distance(hard.body_a, hard.pose_a, hard.body_b, hard.pose_b)
    assert abs(found.distance - hard.distance) <= tolerance["exact"] * size
    _check_proof(found, hard.body_a, hard.pose_a, hard.body_b, hard.pose_b, tolerance["exact"] * size)


@pytest.mark.sampled(5)
def test_coal_and_ground_truth_agree(pair, random_poses, tolerance, monkeypatch):
    body_a, body_b = pair
    signs = set()
    for pose_a, pose_b in zip(random_poses(1, 12, 0.5), random_poses(2, 12, 0.5), strict=True):
        fast = signed_distance(body_a, pose_a, body_b, pose_b)
        _check_proof(fast, body_a, pose_a, body_b, pose_b, tolerance["oracle"])
        with monkeypatch.context() as patch:
            patch.setattr(oracle, "_proven", _nothing_proven)
            slow = signed_distance(body_a, pose_a, body_b, pose_b)
        assert abs(fast.distance - slow.distance) <= tolerance["oracle"]
        _check_proof(slow, body_a, pose_a, body_b, pose_b, tolerance["exact"])
        signs.add(slow.distance > 0)
    assert True in signs


@pytest.mark.core
@pytest.mark.sampled(5)
def test_separating_axes_are_exact_in_contact_and_a_lower_bound_apart(pair, random_poses, tolerance):
    body_a, body_b = pair
    for pose_a, pose_b in zip(random_poses(3, 12, 0.4), random_poses(4, 12, 0.4), strict=True):
        exact = signed_distance(body_a, pose_a, body_b, pose_b).distance
        sat = separating_axis_distance(body_a, pose_a, body_b, pose_b)
        assert sat <= exact + tolerance["oracle"]
        if exact + body_a.radius + body_b.radius <= 0:
            assert abs(sat - exact) <= tolerance["oracle"]


def test_swapping_the_bodies_turns_the_normal(pair, random_poses, tolerance):
    body_a, body_b = pair
    for pose_a, pose_b in zip(random_poses(5, 5, 1.0), random_poses(6, 5, 1.0), strict=True):
        one = signed_distance(body_a, pose_a, body_b, pose_b)
        other = signed_distance(body_b, pose_b, body_a, pose_a)
        assert abs(one.distance - other.distance) <= tolerance["oracle"]


@pytest.mark.parametrize("garbage", [-1.7976931348623157e308, np.inf, np.nan, -1.0, 0.4])
def test_garbage_from_coal_is_refused(garbage, monkeypatch):
    cube = ConvexBody.box([1, 1, 1])
    pose_a, pose_b = np.eye(4), np.eye(4)
    pose_a[0, 3] = 1.5

    def wrong(*arguments):
        arguments[-1].normal = np.array([0.0, 1.0, 0.0])
        return garbage

    monkeypatch.setattr(coal, "ComputeDistance", lambda *_: wrong)
    assert signed_distance(cube, pose_a, cube, pose_b).distance == pytest.approx(0.5, abs=1e-12)
    assert signed_distances(cube, [pose_a] * 3, cube, [pose_b] * 3) == pytest.approx(0.5, abs=1e-12)


def test_exactly_parallel_contacts_of_boxes(tolerance):
    """Boxes on a grid of exact contacts: the poses where coal alone returns garbage now and then."""
    rng = np.random.default_rng(7)
    for _ in range(300):
        size_a, size_b = rng.integers(1, 5, (2, 3)) / 4
        offset = rng.integers(-8, 9, 3) / 8
        pose = np.eye(4)
        pose[:3, 3] = offset
        apart = np.abs(offset) - 0.5 * (size_a + size_b)
        truth = np.linalg.norm(np.maximum(apart, 0)) if apart.max() > 0 else apart.max()
        found = signed_distance(ConvexBody.box(size_a), pose, ConvexBody.box(size_b), np.eye(4))
        assert abs(found.distance - truth) <= tolerance["oracle"]


@pytest.mark.sampled(5)
def test_bulk_is_the_loop(pair, random_poses, tolerance, monkeypatch):
    body_a, body_b = pair
    rng = np.random.default_rng(8)
    touching = touching_poses(body_a, body_b, rng, 10)
    poses_a = np.concatenate([random_poses(9, 10, 0.5), touching[0]])
    poses_b = np.concatenate([random_poses(10, 10, 0.5), touching[1]])
    loop = [signed_distance(body_a, a, body_b, b).distance for a, b in zip(poses_a, poses_b, strict=True)]
    bulk = signed_distances(body_a, poses_a, body_b, poses_b)
    np.testing.assert_allclose(bulk, loop, rtol=0, atol=tolerance["oracle"])
    monkeypatch.setattr(oracle, "BLOCK", 1)
    np.testing.assert_allclose(signed_distances(body_a, poses_a, body_b, poses_b), bulk, rtol=0, atol=1e-15)


def test_a_depth_that_is_not_the_least_is_refused():
    """EPA stops at a face of the difference that is not the nearest: consistent in itself, and wrong."""
    cube, half = ConvexBody.box([1, 1, 1]), np.sqrt(0.5)
    turns = Rotation.from_euler("z", 45, degrees=True), Rotation.from_euler("y", 45, degrees=True)
    pose_a, pose_b = place(2 * half - 0.05, rotation=turns[0]), place(rotation=turns[1])  # edges crossed, 5 cm deep
    places = oracle._Placements(pose_a[None, :3, :3], pose_a[None, :3, 3], pose_b[None, :3, :3], 0)
    right = signed_distance(cube, pose_a, cube, pose_b)
    assert right.distance == pytest.approx(-0.05, abs=1e-9)
    normal = pose_b[:3, 0]  # of the face of B towards A: deeper, so no largest gap
    depth = _gap(cube, pose_a, normal)[0] - _gap(cube, pose_b, normal)[1]
    assert depth < -0.3
    corner = np.array([half - 0.05, 0.0, 0.4])  # of A's leading edge
    corner = corner - normal * (normal @ corner - _gap(cube, pose_a, normal)[0])
    answers = [(right.distance, right.point_a, right.point_b, right.normal)]
    answers.append((depth, corner, corner - depth * normal, normal))
    for answer, accepted in zip(answers, (True, False), strict=True):
        found = oracle._Answers(*(np.array([column]) for column in answer))
        assert oracle._proven(cube, cube, places, found)[0] == accepted


def test_coal_alone_is_right_at_random_poses(pair, random_poses):
    body_a, body_b = pair
    poses_a, poses_b = random_poses(11, 10, 1.0), random_poses(12, 10, 1.0)
    coal_pair = CoalPair(body_a, body_b)
    alone = [coal_pair.distance(a, b) for a, b in zip(poses_a, poses_b, strict=True)]
    np.testing.assert_allclose(alone, signed_distances(body_a, poses_a, body_b, poses_b), rtol=0, atol=1e-6)


def test_bad_poses_are_refused():
    cube = ConvexBody.box([1, 1, 1])
    with pytest.raises(InputError, match="pose_a"):
        signed_distance(cube, np.eye(3), cube, np.eye(4))
    with pytest.raises(InputError, match="pose_b"):
        signed_distance(cube, np.eye(4), cube, np.full((4, 4), np.nan))
    with pytest.raises(InputError, match="poses_a: found an array of shape"):
        signed_distances(cube, np.eye(4), cube, np.eye(4)[None])
    with pytest.raises(InputError, match="poses_b: found 2 poses, allowed are as many as poses_a has: 3"):
        signed_distances(cube, [np.eye(4)] * 3, cube, [np.eye(4)] * 2)


def test_no_poses_give_no_distances():
    cube = ConvexBody.box([1, 1, 1])
    assert signed_distances(cube, np.empty((0, 4, 4)), cube, np.empty((0, 4, 4))).shape == (0,)
