"""Poses: the laws of rotations, against SciPy's own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.scenes.poses import Pose, compose, from_rpy

EXACT = 1e-14  # a few roundings of numbers of order one
SEEDS = range(20)


def random_pose(rng: np.random.Generator) -> Pose:
    quaternion = rng.normal(size=4)
    x, y, z = rng.normal(size=3).tolist()
    qx, qy, qz, qw = (quaternion / np.linalg.norm(quaternion)).tolist()
    return Pose((x, y, z), (qx, qy, qz, qw))


@pytest.mark.parametrize("seed", SEEDS)
def test_matrix_is_that_of_the_quaternion(seed: int) -> None:
    pose = random_pose(np.random.default_rng(seed))
    np.testing.assert_allclose(pose.matrix[:3, :3], Rotation.from_quat(pose.quaternion_xyzw).as_matrix(), atol=EXACT)
    np.testing.assert_array_equal(pose.matrix[:, 3], [*pose.position, 1.0])


@pytest.mark.parametrize("seed", SEEDS)
def test_rpy_turns_about_fixed_axes(seed: int) -> None:
    angles = np.random.default_rng(seed).uniform(-np.pi, np.pi, size=3)
    ours = Pose(quaternion_xyzw=from_rpy(*angles)).matrix[:3, :3]
    np.testing.assert_allclose(ours, Rotation.from_euler("xyz", angles).as_matrix(), atol=EXACT)


@pytest.mark.parametrize("seed", SEEDS)
def test_compose_is_the_matrix_product(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outer, inner = random_pose(rng), random_pose(rng)
    np.testing.assert_allclose(compose(outer, inner).matrix, outer.matrix @ inner.matrix, atol=10 * EXACT)
