"""The paper's properties of the Hölder minimum and maximum and of the shaping function."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.distance.holder import holder_maximum, holder_minimum, resolve_shaping_length, shaped_minimum, shaping
from hdplan.scenes.errors import InputError

GAMMAS = (1, 2, 3, 4, 8, 16, 32)
LENGTH = 1e-3  # [m]
HARD = [
    [1.0, 2.0, 3.0, 4.0],
    [-1.0, 2.0, -3.0, 4.0],
    [-2.0, -2.0, -2.0, -2.0],
    [0.0, 1.0, 2.0, 0.0],
    [0.0, 0.0, 0.0, 0.0],
    [0.0, -1.0, 5.0, 0.0],
    [1e-300, 1e-300, 1.0, 1e300],
    [-1e-300, 1.0, 2.0, 3.0],
    [-1e300, -1e300, 1.0, 1e-310],
    [1e300, 1e300, 1e300, 1e300],
    [1e-310, -1e-310, 5.0, 5.0],
    [1e-140, 1e-140, 1e-140, 1e140],
    [-1e-7, 1e7, -1e7, 1e-7],
]


def _random(count=200):
    rng = np.random.default_rng(0)
    return rng.normal(size=(count, 4)) * 10.0 ** rng.integers(-4, 4, (count, 1)) + rng.choice([-1, 0, 1], (count, 1))


@pytest.mark.parametrize("gamma", GAMMAS)
def test_commutative_associative_and_sign_preserving(gamma, tolerance):
    x = _random()
    u = holder_minimum(x, gamma)
    np.testing.assert_allclose(holder_minimum(x[:, ::-1], gamma), u, rtol=tolerance["exact"])
    nested = np.stack([holder_minimum(x[:, :2], gamma), holder_minimum(x[:, 2:], gamma)], -1)
    np.testing.assert_allclose(holder_minimum(nested, gamma), u, rtol=tolerance["exact"])
    np.testing.assert_array_equal(np.sign(u), np.sign(x.min(1)))
    np.testing.assert_array_equal(holder_maximum(x, gamma), -holder_minimum(-x, gamma))


@pytest.mark.core
@pytest.mark.parametrize("gamma", GAMMAS)
def test_equals_the_definition(gamma, tolerance):
    x = _random()
    p = gamma + 1
    for row, u in zip(x, holder_minimum(x, gamma), strict=True):
        if row.min() > 0:
            truth = np.sum(row ** -float(p)) ** (-1 / p)
        else:
            truth = -(np.sum(np.maximum(-row, 0) ** p) ** (1 / p))
        np.testing.assert_allclose(u, truth, rtol=tolerance["exact"])


def test_large_gamma_is_the_minimum():
    x = _random()
    np.testing.assert_allclose(holder_minimum(x, 100_000), x.min(1), rtol=2e-5)


@pytest.mark.parametrize("gamma", GAMMAS)
def test_multiplicities_count_values(gamma, tolerance):
    x = _random()
    repeated = np.repeat(x, [1, 2, 3, 4], axis=1)
    weighted = holder_minimum(x, gamma, [1, 2, 3, 4])
    np.testing.assert_allclose(weighted, holder_minimum(repeated, gamma), rtol=tolerance["exact"])


@pytest.mark.parametrize("gamma", GAMMAS)
def test_shaping_is_odd_increasing_flat_at_zero_and_the_identity_far_away(gamma):
    u = np.concatenate([np.linspace(-5, 5, 1001) * LENGTH, [1e-300, 1.0, 1e6, 1e300]])
    phi = shaping(u, gamma, LENGTH)
    np.testing.assert_array_equal(shaping(-u, gamma, LENGTH), -phi)
    assert np.all(np.diff(phi[:1001][np.abs(u[:1001]) > 1e-4 * LENGTH]) > 0)
    np.testing.assert_allclose(phi[-2:], u[-2:], rtol=1e-8)
    assert shaping(LENGTH, gamma, LENGTH) == pytest.approx(0.5 * LENGTH)
    small = 1e-3 * LENGTH  # Phi(u) / u^(gamma+1) -> 1 / epsilon
    assert shaping(small, gamma, LENGTH) / small * 1e3**gamma == pytest.approx(1.0, rel=2e-3)


def test_epsilon_is_a_length_in_disguise():
    assert resolve_shaping_length(2, 1e-3, 1e-4) == pytest.approx(1e-2)
    assert resolve_shaping_length(2, 1e-3, None) == 1e-3
    for arguments in [(2, 0.0, None), (2, 1e-3, -1.0), (2, np.nan, None), (0, 1e-3, 1e-4), (1.5, 1e-3, 1e-4)]:
        with pytest.raises(InputError):
            resolve_shaping_length(*arguments)


@pytest.mark.parametrize("gamma", [0, -1, 2.0, True])
def test_gamma_is_a_positive_integer(gamma):
    with pytest.raises(InputError, match="gamma"):
        holder_minimum([1.0, 2.0], gamma)


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("x", HARD, ids=str)
def test_shaped_minimum_is_finite_and_the_derivative_of_itself(x, gamma, tolerance):
    """Euler's theorem at hard values: u is homogeneous of degree 1, and its gradient of degree 0."""
    counts = [1, 2, 3, 4]
    value, gradient, hessian = shaped_minimum(x, gamma, LENGTH, counts)
    u = holder_minimum(x, gamma, counts)
    np.testing.assert_allclose(value, shaping(u, gamma, LENGTH), rtol=tolerance["witness"])
    assert np.all(np.isfinite(gradient))
    assert np.all(np.isfinite(hessian))
    np.testing.assert_array_equal(hessian, hessian.T)
    near = min(abs(float(u)), LENGTH) / max(abs(float(u)), LENGTH)
    s = (near**gamma if abs(u) < LENGTH else 1.0) / (1.0 + near**gamma)
    np.testing.assert_allclose(gradient @ x, s * (1 + gamma * (1 - s)) * u, rtol=tolerance["witness"], atol=1e-300)


@pytest.mark.parametrize("gamma", [1, 2, 3, 4, 8])
def test_shaped_minimum_against_differences(gamma):
    rng = np.random.default_rng(3)
    for x in np.vstack([rng.uniform(0.5, 3, (5, 4)), rng.uniform(-3, 1, (5, 4))]) * LENGTH:
        _, gradient, hessian = shaped_minimum(x, gamma, LENGTH, [1, 2, 3, 4])
        h = 1e-5 * LENGTH
        ahead, behind = (shaped_minimum(x + s * np.eye(4), gamma, LENGTH, [1, 2, 3, 4]) for s in (h, -h))
        np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * h), gradient, atol=1e-7)
        if gamma > 1:  # else the second derivatives jump where an x crosses 0
            np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * h), hessian, atol=1e-5 / LENGTH)
