"""Two squares passing: rates are derivatives, the Euclidean one jumps, the HD-SDF's does not."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.distance.studies.kinks import Kinks, kinks


@pytest.fixture(scope="module")
def found() -> Kinks:
    return kinks(samples=401)


def test_rates_are_the_derivatives(found: Kinks) -> None:
    step = found.times[1]
    for curve in found.smooth:
        for value, slope, tolerance in ((curve.value, curve.rate, 2e-3), (curve.rate, curve.second, 0.1)):
            misses = np.abs(np.diff(value) / step - 0.5 * (slope[1:] + slope[:-1]))
            assert np.quantile(misses, 0.9) < tolerance  # the rest is where the flat spot is passed in a few steps


def test_the_euclidean_rate_jumps_apart_and_overlapping_and_ours_nowhere(found: Kinks) -> None:
    assert {kink.distance > 0 for kink in found.kinks} == {True, False}
    assert all(abs(kink.after - kink.before) > 0.2 for kink in found.kinks)
    assert found.largest_jump < 1e-5


def test_rates_at_a_kink_are_those_beside_it(found: Kinks) -> None:
    for kink in found.kinks:
        k = int(np.searchsorted(found.times, kink.time))
        assert found.euclidean.rate[k - 1] == pytest.approx(kink.before, abs=0.02)
        assert found.euclidean.rate[k] == pytest.approx(kink.after, abs=0.02)


def test_never_a_false_separation(found: Kinks) -> None:
    overlapping = found.euclidean.value <= 0
    assert overlapping.any()
    for curve in found.smooth:
        assert np.all(curve.value[overlapping] <= 0)
        assert np.all(curve.value[~overlapping] > 0)  # in the plane the set of normals is complete
