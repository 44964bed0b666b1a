"""Laws of the samples: on the motion, weights that sum to one, gradients and curvatures carried back exactly."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.problem.samples import MOST_SAMPLES, Samples

EXACT = 1e-13  # relative: sums of a few dozen products
COUNTS = [(4, 4, 4), (1, 5, 2, 8), (3,), (32, 1)]


@pytest.fixture(params=COUNTS, ids=str)
def samples(request: pytest.FixtureRequest) -> Samples:
    return Samples(request.param)


def test_midpoints_of_equal_parts(samples: Samples) -> None:
    for k, count in enumerate(samples.counts):
        here = samples.fraction[samples.interval == k]
        np.testing.assert_allclose(here, [(2 * i + 1) / (2 * count) for i in range(count)], rtol=EXACT)
    assert np.all(np.diff(samples.interval + samples.fraction) > 0)


def test_weights_share_the_duration(samples: Samples) -> None:
    assert samples.weight.sum() == pytest.approx(1, rel=EXACT)
    shares = np.bincount(samples.interval, samples.weight)
    np.testing.assert_allclose(shares, 1 / len(samples.counts), rtol=EXACT)


def test_configurations_lie_on_the_motion(samples: Samples) -> None:
    """A motion that is linear in time is met exactly where its samples are in time."""
    count = len(samples.counts) + 1
    slope, offset = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.1, -4.0])
    positions = np.arange(count)[:, None] * slope + offset
    expected = (samples.interval + samples.fraction)[:, None] * slope + offset
    np.testing.assert_allclose(samples.configurations(positions), expected, rtol=EXACT, atol=EXACT)


def test_gradients_go_back_by_the_transpose(samples: Samples) -> None:
    """⟨g, samples(q)⟩ = ⟨to_waypoints(g), q⟩ for all g and q."""
    rng = np.random.default_rng(1)
    positions = rng.normal(size=(len(samples.counts) + 1, 3))
    gradient = rng.normal(size=(len(samples.weight), 3))
    there = np.sum(gradient * samples.configurations(positions))
    slope, _, _ = samples.to_waypoints(gradient, np.zeros((len(gradient), 3, 3)))
    back = np.sum(slope * positions)
    assert there == pytest.approx(back, rel=EXACT, abs=EXACT)


def test_curvatures_go_back_as_quadratic_forms(samples: Samples) -> None:
    """Σ_s x_sᵀ C_s x_s over samples x = samples(q) is the quadratic form of the waypoints' blocks."""
    rng = np.random.default_rng(2)
    n, count = 3, len(samples.counts) + 1
    half = rng.normal(size=(len(samples.weight), n, n))
    curvature = half @ half.transpose(0, 2, 1)
    q = rng.normal(size=(count, n))
    x = samples.configurations(q)
    _, diagonal, coupling = samples.to_waypoints(np.zeros((len(curvature), n)), curvature)
    blocks = np.einsum("ki,kij,kj->", q, diagonal, q) + 2 * np.einsum("ki,kij,kj->", q[:-1], coupling, q[1:])
    assert blocks == pytest.approx(np.einsum("si,sij,sj->", x, curvature, x), rel=EXACT)


def test_raised_has_at_least_the_counts_never_fewer_and_at_most_the_most() -> None:
    samples = Samples((4, 4, 4, 4))
    assert samples.raised(np.array([1, 4, 7, 1000])).counts == (4, 4, 7, MOST_SAMPLES)
    assert samples.raised(np.zeros(4, np.int64)) == samples
    assert samples.counts == (4, 4, 4, 4)
