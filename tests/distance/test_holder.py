"""The paper's properties of the Hölder minimum and maximum and of the shaping function, in NumPy and in CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hdplan.distance import symbolic
from hdplan.distance.holder import holder_maximum, holder_minimum, resolve_shaping_length, shaping
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


@pytest.fixture(scope="module", params=GAMMAS)
def blocks(request):
    """Return gamma and a Function of the symbolic blocks: values, derivatives by hand and by CasADi, and Hessian."""
    gamma = request.param
    x = ca.SX.sym("x", 4)
    u, by_hand = symbolic.holder_minimum(ca.vertsplit(x), gamma, [1.0, 2.0, 3.0, 4.0])
    phi, slope = symbolic.shaping(u, gamma, LENGTH)
    gradient = slope * ca.vertcat(*by_hand)
    outputs = [u, ca.vertcat(*by_hand), ca.jacobian(u, x).T, phi, slope, gradient, ca.jacobian(gradient, x)]
    return gamma, ca.Function("blocks", [x], outputs)


@pytest.mark.parametrize("x", HARD, ids=str)
def test_symbolic_blocks_are_finite_and_right_at_hard_values(blocks, x, tolerance):
    gamma, function = blocks
    u, by_hand, automatic, phi, slope, gradient, hessian = (np.array(value) for value in function(x))
    for value in (u, by_hand, automatic, phi, slope, gradient, hessian):
        assert np.all(np.isfinite(value))
    truth = holder_minimum(x, gamma, [1, 2, 3, 4])
    np.testing.assert_allclose(u.item(), truth, rtol=tolerance["witness"], atol=symbolic.TINY)
    np.testing.assert_allclose(phi.item(), shaping(truth, gamma, LENGTH), rtol=tolerance["witness"], atol=symbolic.TINY)
    np.testing.assert_allclose(by_hand, automatic, rtol=tolerance["witness"], atol=tolerance["exact"])
    if u != 0:  # Euler's theorem: u is homogeneous of degree 1
        np.testing.assert_allclose(by_hand.T @ (np.array(x) / u.item()), 1.0, rtol=tolerance["witness"])


def test_symbolic_blocks_equal_numpy_at_random_values(blocks, tolerance):
    gamma, function = blocks
    for x in _random(50):
        u, _, _, phi, *_ = (np.array(value) for value in function(x))
        truth = holder_minimum(x, gamma, [1, 2, 3, 4])
        np.testing.assert_allclose(u.item(), truth, rtol=tolerance["witness"])
        np.testing.assert_allclose(phi.item(), shaping(truth, gamma, LENGTH), rtol=tolerance["witness"])


def test_symbolic_maximum_mirrors_the_minimum():
    x = ca.SX.sym("x", 3)
    value, derivatives = symbolic.holder_maximum(ca.vertsplit(x), 2)
    function = ca.Function("maximum", [x], [value, ca.vertcat(*derivatives) - ca.jacobian(value, x).T])
    for point in ([1.0, -2.0, 3.0], [-1.0, -2.0, -3.0]):
        found, difference = function(point)
        assert float(found) == pytest.approx(float(holder_maximum(point, 2)))
        np.testing.assert_allclose(np.array(difference), 0, atol=1e-14)
