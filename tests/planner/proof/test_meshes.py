"""Laws of how meshes are divided for a proof."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from hdplan.planner.proof.meshes import MOST_SURFACES, divided


def boxes(count: int) -> np.ndarray:
    """The triangles (12 count, 3, 3) of separate boxes, in any order."""
    rng = np.random.default_rng(count)
    found = [trimesh.creation.box(rng.uniform(0.1, 0.3, 3)).triangles + [2.0 * i, 0.0, 0.0] for i in range(count)]
    triangles = np.concatenate(found)
    return triangles[rng.permutation(len(triangles))]


@pytest.mark.parametrize("count", [2, 7, MOST_SURFACES])
def test_a_cage_is_divided_into_its_bars_which_stay_whole(count: int) -> None:
    triangles = boxes(count)
    groups = divided(np.zeros(len(triangles), dtype=np.int64), 0, triangles)
    assert sorted(np.unique(groups).tolist()) == list(range(count))
    for group in range(count):
        own = triangles[groups == group]
        assert len(own) == 12
        assert np.ptp(own.reshape(-1, 3), axis=0).max() < 0.31
        assert divided(groups, group, triangles) is None


def test_no_bar_of_a_larger_cage_is_cut() -> None:
    triangles = boxes(MOST_SURFACES + 20)
    groups = np.zeros(len(triangles), dtype=np.int64)
    while True:
        finer = [found for g in range(groups.max() + 1) if (found := divided(groups, g, triangles)) is not None]
        if not finer:
            break
        groups = finer[0]
    assert groups.max() + 1 == MOST_SURFACES + 20
    assert set(np.bincount(groups).tolist()) == {12}


def test_one_surface_is_cut_in_two_and_the_other_groups_stay() -> None:
    ball = trimesh.creation.icosphere(2).triangles
    bowl = ball[ball[:, :, 2].max(axis=1) < 0.1]
    groups = divided(np.zeros(len(bowl), dtype=np.int64), 0, bowl)
    assert groups is not None
    finer = divided(groups, 1, bowl)
    assert finer is not None
    assert np.bincount(groups).min() > 0.3 * len(bowl)
    np.testing.assert_array_equal(finer[groups == 0], 0)
    assert set(finer[groups == 1].tolist()) == {1, 2}
    assert divided(np.arange(len(bowl)), 3, bowl) is None  # a single triangle
