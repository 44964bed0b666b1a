"""The FCL baseline: right where FCL is, honest where it is not, and alive where it dies."""

from __future__ import annotations

import sys
from importlib.util import find_spec

import numpy as np
import pytest

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.baselines.fcl import FclPair, fcl_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.studies.random_poses import paper_poses, touching_poses
from hdplan.scenes.errors import InputError

needs_fcl = pytest.mark.skipif(find_spec("fcl") is None, reason="python-fcl is not installed")
CUBE = ConvexBody.box([1, 1, 1])

# FCL as the child process sees it: the distance is A's x, and A's y says how its process ends.
IMPOSTOR = """
import os

class CollisionObject:
    def __init__(self, shape, pose): pass
    def setRotation(self, rotation): pass
    def setTranslation(self, place): self.place = place

class DistanceResult:
    def __init__(self, nearest=0.0): pass

def distance(a, b, request, result):
    if a.place[1] == 1.0: os.abort()
    if a.place[1] == 2.0: raise ValueError("no such distance")
    result.nearest_points = a.place, b.place
    return a.place[0]

def Transform(): pass
def Convex(*arguments): pass
def DistanceRequest(**options): pass
"""


@pytest.fixture
def impostor(tmp_path, monkeypatch):
    (tmp_path / "fcl.py").write_text(IMPOSTOR, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "fcl", object())  # the parent needs no more than its presence


def _line_of_poses(ends):
    poses = np.tile(np.eye(4), (len(ends), 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.arange(1, len(ends) + 1), ends
    return poses


@needs_fcl
@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "names", [("dodecahedron", "icosahedron"), ("box", "triangle"), ("sphere", "capsule"), ("swept octahedron", "box")]
)
def test_right_at_random_poses(names, bodies):
    body_a, body_b = (bodies[name] if name in bodies else ConvexBody.platonic(name) for name in names)
    poses_a, poses_b = paper_poses(np.random.default_rng(1), 200)
    poses_a[:, :3, 3] *= 0.25 * (body_a.reach + body_b.reach)
    poses_b[:, :3, 3] *= 0.25 * (body_a.reach + body_b.reach)
    exact = signed_distances(body_a, poses_a, body_b, poses_b)
    assert 0.05 < np.mean(exact > 0) < 0.95
    found = fcl_distances(body_a, poses_a, body_b, poses_b)
    assert not found.aborted.any()
    np.testing.assert_allclose(found.distances, exact, rtol=0, atol=1e-6)
    assert np.median(np.abs(found.distances - exact)) < 1e-12
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0)
    from_b = found.points_a - found.points_b
    np.testing.assert_allclose(from_b, found.distances[:, None] * found.normals, atol=1e-9)
    pair = FclPair(body_a, body_b)
    here = [pair.distance(a, b) for a, b in zip(poses_a, poses_b, strict=True)]
    np.testing.assert_array_equal(here, found.distances)


@needs_fcl
def test_contacts_are_survived_and_reported(bodies):
    """Thin bodies in contact end FCL's process most often: about one pose in fifty."""
    plate, segment = bodies["plate"], bodies["segment"]
    poses_a, poses_b = touching_poses(plate, segment, np.random.default_rng(2), 200)
    found = fcl_distances(plate, poses_a, segment, poses_b)
    assert found.aborted.mean() < 0.1
    np.testing.assert_array_equal(np.isnan(found.distances), found.aborted)
    np.testing.assert_array_equal(np.isnan(found.points_a).any(axis=1), found.aborted)
    assert np.isnan(found.normals[found.aborted]).all()
    near = np.abs(found.distances - signed_distances(plate, poses_a, segment, poses_b)) < 1e-6
    assert near[~found.aborted].mean() > 0.9


def test_an_abort_is_marked_and_the_rest_answered(impostor):
    ends = [1, 0, 0, 1, 1]
    found = fcl_distances(CUBE, _line_of_poses(ends), CUBE, np.tile(np.eye(4), (5, 1, 1)))
    np.testing.assert_array_equal(found.aborted, np.array(ends, dtype=bool))
    np.testing.assert_array_equal(found.distances, [np.nan, 2, 3, np.nan, np.nan])
    np.testing.assert_array_equal(found.normals[1], [1, 0, 0])


def test_radii_come_off(impostor):
    swept = CUBE.inflated(0.25)
    found = fcl_distances(swept, _line_of_poses([0]), swept, np.eye(4)[None])
    assert found.distances[0] == 0.5
    np.testing.assert_array_equal(found.points_a[0], [0.75, 0, 0])
    np.testing.assert_array_equal(found.points_b[0], [0.25, 0, 0])


def test_another_end_of_the_process_is_an_error(impostor):
    with pytest.raises(RuntimeError, match="no such distance"):
        fcl_distances(CUBE, _line_of_poses([0, 2, 0]), CUBE, np.tile(np.eye(4), (3, 1, 1)))


@needs_fcl
def test_no_poses_give_no_answers():
    found = fcl_distances(CUBE, np.empty((0, 4, 4)), CUBE, np.empty((0, 4, 4)))
    assert found.distances.shape == found.aborted.shape == (0,)
    assert found.points_a.shape == (0, 3)


def test_without_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "fcl", None)
    missing = r"^needs python-fcl, which is not installed: pip install python-fcl$"
    with pytest.raises(InputError, match=missing):
        FclPair(CUBE, CUBE)
    with pytest.raises(InputError, match=missing):
        fcl_distances(CUBE, np.eye(4)[None], CUBE, np.eye(4)[None])


@needs_fcl
def test_bad_poses_are_refused():
    with pytest.raises(InputError, match="poses_b: found an array of shape"):
        fcl_distances(CUBE, np.eye(4)[None], CUBE, np.eye(3)[None])
