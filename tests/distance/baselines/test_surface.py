"""Triangles close the surface they claim."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.distance.baselines.surface import triangles
from hdplan.distance.bodies import PLATONIC, ConvexBody

VOLUMES = {"box": 0.24, "plate": 0.8e-4, "triangle": 0.0, "segment": 0.0, "point": 0.0}


@pytest.mark.parametrize("name", VOLUMES)
def test_the_triangles_enclose_the_bodys_volume(name, bodies):
    corners = bodies[name].vertices[triangles(bodies[name])]
    volume = np.sum(np.linalg.det(corners)) / 6.0  # of the tetrahedra with the origin: positive if seen from outside
    assert volume == pytest.approx(VOLUMES[name], abs=1e-15)


@pytest.mark.parametrize("name", PLATONIC)
def test_every_edge_is_run_once_each_way(name):
    faces = triangles(ConvexBody.platonic(name))
    runs = [(face[k], face[(k + 1) % 3]) for face in faces.tolist() for k in range(3)]
    assert len(set(runs)) == len(runs)
    assert set(runs) == {(end, start) for start, end in runs}
    assert set(faces.ravel()) == set(range(len(ConvexBody.platonic(name).vertices)))
