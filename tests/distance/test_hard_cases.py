"""Hard poses, for each witness: all finite, all right as far as the truth in many digits says, the sign always right.

How right: relative errors of ``ROUNDING`` p² size/|D-tilde|. D grows as the (p²)-th power of the gap near contact, so
the rounding of coordinates of that size shows p² size/gap times in D, in its gradient and in its Hessian.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import mpmath
import numpy as np
import pytest

from hdplan.distance.baselines.coal import signed_distance
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.numpy_reference.hdsdf import separation
from tests.distance.extended import truth
from tests.distance.hard_cases import HARD, place
from tests.distance.witnesses import evaluator

GAMMAS = (1, 2, 3, 4, 8, 16, 32)
LENGTHS = (1e-9, 1e-6, 1e-3, 1.0)  # [m]
SETS = ("paper", "paper+edges", "paper+centre", "paper-multiset", "paper+sphere-8")
EVERY = [  # of the 140 combinations those whose numbers differ; each gamma, length and set in turn with the others
    {"gamma": GAMMAS[k % 7], "shaping_length": LENGTHS[(k + 2) % 4], "normals": SETS[k % 5]} for k in range(1, 141)
]

ROUNDING = 16 * float(np.finfo(float).eps)
ROUNDING32 = 16 * float(np.finfo(np.float32).eps)
UNDERFLOW, UNDERFLOW32 = 1e-280, 1e-28  # below these digits are lost on the way
BLIND = {  # just touching or apart, and the paper's set sees no plane between them
    "crossed edges touch": "edges",
    "crossed edges, 0.1 m apart": "edges",
    "capsule along an edge": "nothing but more directions",
}


def _kind(case):
    """Return the key by which JAX compiles: how many vertices both bodies have."""
    return len(case.body_a.vertices), len(case.body_b.vertices)


KINDS = list(dict.fromkeys(map(_kind, HARD)))
QUICK = {"float64": [(8, 8)], "float32": []}  # the others build for seconds each; float32 is finite in `batch`
BATCH = [
    pytest.param(case, dtype, id=f"{case.name}-{dtype}", marks=[] if _kind(case) in QUICK[dtype] else pytest.mark.slow)
    for dtype in QUICK
    for case in HARD
]


def _batch_settings(case):
    """Return settings that differ as far as they can where JAX compiles once for bodies of a kind."""
    number = KINDS.index(_kind(case))
    return {
        "gamma": GAMMAS[(number + 1) % len(GAMMAS)],
        "shaping_length": LENGTHS[HARD.index(case) % len(LENGTHS)],
        "normals": SETS[(number + 1) % len(SETS)],
    }


def _size(case):
    """Return the size of the coordinates that are subtracted from each other [m]."""
    offset = np.abs(case.pose_a[:3, 3] - case.pose_b[:3, 3]).max()
    return float(max(offset, *(np.abs(b.vertices).max() + b.radius for b in (case.body_a, case.body_b))))


def _twist(case):
    """Return a random twist: translations of the size of the case, rotations of a radian."""
    return np.random.default_rng(1).normal(size=12) * np.repeat([_size(case), 1.0, _size(case), 1.0], 3)


@cache
def _truth(case, **settings):
    tiny = max(0, -int(np.log10(abs(case.distance)))) if case.held else 0  # the differences' steps are smaller yet
    digits = max(120, 3 * (tiny + 20))
    return truth(case.body_a, case.pose_a, case.body_b, case.pose_b, _twist(case), digits=digits, **settings)


def _check(case, found, gamma, rounding=ROUNDING, underflow=UNDERFLOW, **settings):
    """Hold value, separation, and the derivatives along a twist against the truth."""
    for part in found:
        assert np.all(np.isfinite(part))
    np.testing.assert_allclose(found.hessian, found.hessian.T, atol=rounding * np.abs(found.hessian).max())
    right, twist, size = _truth(case, gamma=gamma, **settings), _twist(case), _size(case)
    noise = rounding * size + underflow
    assert abs(found.separation - right.separation) <= noise
    if case.held or abs(right.separation) > noise:
        assert np.sign(found.separation) == np.sign(right.separation)
    if found.value != 0:  # it may underflow; its sign may not differ
        assert np.sign(found.value) == np.sign(found.separation)
    slopes, curvatures = found.gradient * twist, twist[:, None] * found.hessian * twist
    value_scale = abs(right.value)
    slope_scale = value_scale + np.abs(slopes).sum()
    curvature_scale = slope_scale + np.abs(curvatures).sum()
    relative = rounding * (gamma + 1) ** 2 * (1.0 if case.held else max(1.0, size / max(abs(right.separation), 1e-300)))
    assert abs(found.value) <= noise or relative < 0.5
    if relative >= 0.5:  # the gap is nothing but rounding: D and its derivatives have no digit to hold
        return
    assert abs(found.value - right.value) <= relative * value_scale + underflow
    assert abs(slopes.sum() - right.slope) <= relative * slope_scale + underflow * size
    if gamma > 1:  # for gamma = 1 it may be another one-sided value
        assert abs(curvatures.sum() - right.curvature) <= relative * curvature_scale + underflow * size**2


def _check_sign(case, found, normals, rounding=ROUNDING, underflow=UNDERFLOW):
    """Positive exactly where the bodies are apart, if a plane of the set tells; never where they share a point."""
    noise = 0.0 if case.held else rounding * _size(case) + underflow
    if case.distance <= 0:
        assert found.separation <= noise
    elif case.distance > noise and (case.name not in BLIND or BLIND[case.name] in normals):
        assert found.separation > 0
    if case.distance < -noise and "centre" not in normals:  # at one centre that axis reads no depth
        assert found.separation < 0


@pytest.mark.sampled(17)
@pytest.mark.parametrize("name", ["numpy", "casadi"])
def test_finite_and_right(hard, name):
    settings = EVERY[HARD.index(hard)]
    found = evaluator(name, hard.body_a, hard.body_b, **settings)(hard.pose_a, hard.pose_b)
    _check(hard, found, **settings)
    _check_sign(hard, found, settings["normals"])


@pytest.mark.sampled(5)
@pytest.mark.parametrize(("case", "dtype"), BATCH)
def test_batch_is_finite_and_right(case, dtype):
    """Float32 agrees as far as its digits go."""
    settings = _batch_settings(case)
    found = evaluator("jax", case.body_a, case.body_b, dtype=dtype, **settings)(case.pose_a, case.pose_b)
    if dtype == "float32" and 0 < abs(case.distance) < 1e-30:
        case = replace(case, held=False)  # not in so few digits
    limits = {"rounding": ROUNDING32, "underflow": UNDERFLOW32} if dtype == "float32" else {}
    _check(case, found, **limits, **settings)
    _check_sign(case, found, settings["normals"], **limits)


@pytest.mark.sampled(9)
def test_exact_normal_makes_separation_exact(hard):
    """The oracle's normal as a witness makes any set see."""
    exact = signed_distance(hard.body_a, hard.pose_a, hard.body_b, hard.pose_b)
    normal = hard.pose_b[:3, :3].T @ exact.normal
    found = separation(hard.body_a, hard.pose_a, hard.body_b, hard.pose_b, witnesses=normal[None])
    assert abs(found - hard.distance) <= 1e-12 * _size(hard)


@pytest.mark.parametrize("gamma", [1, 2, 3, 8, 32])
@pytest.mark.parametrize("gap", [1e-300, 1e-30, 1e-9, 1e-3, 0.7, 1e6])
def test_two_points_have_a_closed_form(gap, gamma):
    """Both points' axes along the gap see it, all others see 0: D = Phi(2^(1/p) Phi(gap))."""
    point, length = ConvexBody.from_points([[0, 0, 0]]), 1e-3

    def shape(u):
        return u ** (gamma + 1) / (u**gamma + mpmath.mpf(length) ** gamma)

    with mpmath.workdps(50):
        right = float(shape(mpmath.mpf(2) ** (mpmath.mpf(1) / (gamma + 1)) * shape(mpmath.mpf(gap))))
    found = evaluator("numpy", point, point, gamma=gamma, shaping_length=length)(place(gap), place())
    np.testing.assert_allclose(found.value, right, rtol=ROUNDING * (gamma + 1) ** 2, atol=UNDERFLOW)
    assert found.separation == gap


def test_a_hundred_digits_are_enough():
    """The truth does not change with its digits: the differences behind its derivatives have converged."""
    for case in HARD[1:60:7]:
        settings = {"gamma": 2, "shaping_length": 1e-6}
        once, again = (
            truth(case.body_a, case.pose_a, case.body_b, case.pose_b, _twist(case), digits=digits, **settings)
            for digits in (120, 180)
        )
        np.testing.assert_allclose(once, again, rtol=1e-14, atol=1e-30 * max(1.0, abs(once.curvature)))
