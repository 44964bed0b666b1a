"""Random poses are what they claim: the paper's ranges, and bodies that touch."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.distance.baselines import coal as oracle
from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.studies.random_poses import BLOCK, PLATONIC_PAIRS, paper_poses, touching_poses


def _check_rigid(poses, count):
    assert poses.shape == (count, 4, 4)
    turns = poses[:, :3, :3]
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (count, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0, atol=1e-14)
    np.testing.assert_array_equal(poses[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))


def test_pairs_of_platonic_solids():
    assert len(PLATONIC_PAIRS) == len({frozenset(pair) for pair in PLATONIC_PAIRS}) == 15


def test_paper_poses_fill_the_papers_ranges():
    for poses in paper_poses(np.random.default_rng(1), 4000):
        _check_rigid(poses, 4000)
        assert np.abs(poses[:, :3, 3]).max() <= 2.0
        np.testing.assert_allclose(poses[:, :3, 3].std(0), 4.0 / np.sqrt(12.0), rtol=0.05)
        np.testing.assert_allclose(poses.mean(0)[:3, :3], 0.0, atol=0.05)


@pytest.mark.parametrize("count", [0, 1, BLOCK + 1])
def test_any_number_of_touching_poses_is_made(count):
    for poses in touching_poses(ConvexBody.box([1, 1, 1]), ConvexBody.sphere(0.1), np.random.default_rng(2), count):
        _check_rigid(poses, count)


def test_a_seed_gives_the_same_poses():
    body = ConvexBody.platonic("cube")
    one, other = (touching_poses(body, body, np.random.default_rng(3), 50) for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.sampled(5)
def test_touching_poses_touch(pair, tolerance):
    body_a, body_b = pair
    poses_a, poses_b = touching_poses(body_a, body_b, np.random.default_rng(4), 100)
    distances = signed_distances(body_a, poses_a, body_b, poses_b)
    assert distances.max() <= tolerance["oracle"]
    assert np.mean(np.abs(distances) <= tolerance["oracle"]) > 0.4, "about half of them just touch"


@pytest.mark.sampled(5)
def test_touching_poses_touch_up_to_rounding(pair, monkeypatch):
    monkeypatch.setattr(oracle, "_proven", lambda *arguments: np.zeros(len(arguments[-1].distances), dtype=bool))
    body_a, body_b = pair
    poses_a, poses_b = touching_poses(body_a, body_b, np.random.default_rng(5), 15)
    assert signed_distances(body_a, poses_a, body_b, poses_b).max() <= 1e-14


def test_deep_and_shallow_aligned_and_tilted():
    cube = ConvexBody.box([1, 1, 1])
    poses_a, poses_b = touching_poses(cube, cube, np.random.default_rng(6), 2000)
    distances = signed_distances(cube, poses_a, cube, poses_b)
    assert np.mean(distances < -0.1) > 0.1
    relative = np.abs(poses_a[:, :3, :3].transpose(0, 2, 1) @ poses_b[:, :3, :3])
    from_axes = np.minimum(relative, np.abs(1.0 - relative)).max((1, 2))  # 0 where the axes lie along each other's
    assert np.mean(from_axes == 0.0) > 0.05
    for low, high in ((1e-16, 1e-13), (1e-13, 1e-9), (1e-9, 1e-3)):
        assert np.mean((low < from_axes) & (from_axes <= high)) > 0.01
    assert np.mean(from_axes > 0.1) > 0.3
