"""The banded system: as dense algebra solves it, with and without the compiled loop."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.solvers import banded_system
from hdplan.planner.solvers.banded_system import solve_banded
from hdplan.scenes.array_types import Array


@pytest.fixture(params=["compiled", "interpreted"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "interpreted":
        monkeypatch.setattr(banded_system, "_library", lambda: None)
    return str(request.param)


def banded(rng: np.random.Generator, size: int, width: int, stiff: float) -> tuple[Array, Array]:
    """A random positive definite matrix (size, size) of this bandwidth, and its lower band."""
    lower = np.tril(rng.normal(size=(size, size)))
    lower = np.where(np.subtract.outer(np.arange(size), np.arange(size)) < width, lower, 0.0)
    dense = lower @ lower.T + np.diag(10.0 ** rng.uniform(-2, stiff, size))
    band = np.zeros((width, size))
    for offset in range(min(width, size)):
        band[offset, : size - offset] = np.diagonal(dense, -offset)
    return dense, band


@pytest.mark.parametrize(("size", "width"), [(1, 1), (1, 3), (2, 5), (7, 1), (40, 3), (210, 15), (420, 29)])
@pytest.mark.parametrize("stiff", [1.0, 15.0])  # joints at their limits are held by 1e15
def test_it_solves_what_dense_algebra_solves(way: str, size: int, width: int, stiff: float) -> None:
    rng = np.random.default_rng(size + width)
    dense, band = banded(rng, size, width, stiff)
    right, kept = rng.normal(size=size), band.copy()
    found = solve_banded(band, right)
    scale = np.abs(dense) @ np.abs(found) + np.abs(right)
    assert np.all(np.abs(dense @ found - right) <= 1e-12 * scale)  # backward error, as stiffness spoils the condition
    np.testing.assert_array_equal(band, kept)


def test_what_is_not_definite_is_refused(way: str) -> None:
    band = np.array([[1.0, 1.0, 1.0], [2.0, 0.0, 0.0]])
    with pytest.raises(np.linalg.LinAlgError):
        solve_banded(band, np.ones(3))
