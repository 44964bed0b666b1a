"""Laws of what takes the place of SciPy where motions are planned: rotations, splines, cheapest ways; of clearance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.geometry.rotations import matrices_of, quaternions_of, turn_of, vectors_of
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.roadmap import cheapest_way
from hdplan.planner.timing.path_spline import PathSpline
from hdplan.scenes.yaml_format.reader import load_scene


def test_rotations_are_those_of_scipy() -> None:
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(600, 3))
    small, near_half = 10.0 ** rng.uniform(-14, 0.4, 300), np.pi - 10.0 ** rng.uniform(-15, -1, 300)
    vectors = ways / np.linalg.norm(ways, axis=1)[:, None] * np.concatenate([small, near_half])[:, None]
    vectors[0] = 0.0
    matrices = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(matrices_of(vectors), matrices, rtol=0, atol=1e-15)
    np.testing.assert_allclose(vectors_of(matrices)[:300], vectors[:300], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(matrices_of(vectors_of(matrices)), matrices, rtol=0, atol=3e-15)
    ours, theirs = quaternions_of(matrices), Rotation.from_matrix(matrices).as_quat()
    assert (np.minimum(np.abs(ours - theirs).max(axis=1), np.abs(ours + theirs).max(axis=1)) < 1e-15).all()
    assert turn_of(matrices[1]) == pytest.approx(np.linalg.norm(vectors[1]), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
def test_splines_are_those_of_scipy_and_end_where_their_control_points_do(count: int) -> None:
    rng, degree = np.random.default_rng(count), min(3, count - 1)
    inner = np.linspace(0.0, 1.0, count - degree + 1)
    knots, control = np.concatenate([np.zeros(degree), inner, np.ones(degree)]), rng.normal(size=(count, 7))
    ours, theirs, u = PathSpline(knots, control, degree), BSpline(knots, control, degree), rng.uniform(size=300)
    for order in range(4):
        found = theirs(u, order)
        np.testing.assert_allclose(ours(u, order), found, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(found).max()))
    assert np.array_equal(ours(0.0), control[0])
    assert np.array_equal(ours(1.0), control[-1])


def test_the_cheapest_way_is_that_of_every_order_of_relaxation() -> None:
    """Floyd and Warshall's rule is the judge, on small graphs, some of which have parts that nothing connects."""
    rng = np.random.default_rng(3)
    for count in range(2, 40):
        pairs = np.array([(i, j) for i in range(count) for j in range(i) if rng.uniform() < 0.3 or (i, j) == (1, 0)])
        edges, costs = np.sort(pairs, axis=1), rng.uniform(0.1, 5.0, len(pairs))
        far = np.full((count, count), np.inf)
        far[edges[:, 0], edges[:, 1]] = far[edges[:, 1], edges[:, 0]] = costs
        price = far.copy()
        for k in range(count):
            far = np.minimum(far, far[:, k : k + 1] + far[k : k + 1])
        way = cheapest_way(edges, costs, count)
        assert (way[0], way[-1]) == (1, 0)
        assert price[way[:-1], way[1:]].sum() == pytest.approx(far[0, 1])


@pytest.mark.parametrize("name", ["ur5_table", "panda_person", "panda_camera"])
def test_clear_is_what_has_nothing_too_close(name: str) -> None:
    """Meshes, a person of uncertain place, and a cloud; some configurations random, some near the start."""
    setup = Setup.of(load_scene(name))
    certifier, rng = Certifier(setup), np.random.default_rng(1)
    start, found = setup.robot.configuration(setup.scene.start), set()
    for q in np.vstack([setup.robot.draw(rng, 12), start + 0.1 * rng.normal(size=(12, setup.robot.n))]):
        for required in (0.0, 0.03):
            clear = certifier.is_clear(q, required)
            assert clear == (not certifier.too_close(q, required))
            found.add(clear)
    assert found == {True, False}
