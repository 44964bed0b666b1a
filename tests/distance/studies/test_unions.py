"""The study of unions: its bodies are what they say, and its numbers what they must be."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.distance import ConvexBody, signed_distances
from hdplan.distance.studies.unions import PIECES, cut, cut_bodies, study_unions


@pytest.mark.core
@pytest.mark.parametrize("pieces", PIECES)
def test_a_cut_box_is_the_box(pieces, random_poses):
    finest, box = cut_bodies()["box"], ConvexBody.box([0.6, 0.3, 0.2])
    body, ball = cut(finest, pieces), ConvexBody.sphere(0.05)
    assert len(body.pieces) == pieces
    poses = random_poses(1, 20, 0.8), random_poses(2, 20, 0.8)
    exact = signed_distances(box, poses[0], ball, poses[1])
    found = signed_distances(body, poses[0], ball, poses[1])
    np.testing.assert_allclose(found[exact > 0], exact[exact > 0], atol=1e-9)
    assert np.all(found[exact <= 0] >= exact[exact <= 0] - 1e-9)


def test_a_ring_of_fewer_hulls_contains_that_of_more(random_poses):
    finest = cut_bodies()["ring"]
    poses = random_poses(3, 20, 0.5), random_poses(4, 20, 0.5)
    ball = ConvexBody.sphere(0.02)
    found = np.maximum([signed_distances(cut(finest, n), poses[0], ball, poses[1]) for n in PIECES], 0.0)
    assert np.all(np.diff(found, axis=0) >= -1e-9)
    inside = [float(signed_distances(cut(finest, n), np.eye(4)[None], ball, np.eye(4)[None])[0]) for n in (1, 32)]
    assert inside[0] < 0 < inside[1]


def test_the_study_counts_and_times():
    calls = []
    small = {"random": 64, "close": 64, "bodies": ("box",), "orders": ("value",)}
    found = study_unions(**small, pieces=(1, 2), report=lambda *step: calls.append(step))
    assert [(one.body, one.pieces, one.missed) for one in found] == [("box", 1, 0), ("box", 2, 0)]
    assert found[1].ratio < found[0].ratio < 1.0
    assert all(second > 0 for one in found for second in one.seconds.values())
    assert calls[-1][:2] == (2, 2)
