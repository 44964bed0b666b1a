"""Hölder minimum and maximum and the shaping function, in NumPy (paper, section II).

In: arrays (..., n), the operators act along the last axis. Out: arrays (...,). The formulas never overflow: every ratio
lies in [0, 1], for any gamma and any scale.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.values import Number, Whole, checked

HIGHEST_GAMMA = 1_000_000  # of gamma: far above, 1/gamma and powers of it are nothing but rounding


def holder_minimum(values: ArrayLike, gamma: int, multiplicities: ArrayLike | None = None) -> Array:
    """Return the gamma-Hölder minimum of ``values`` (..., n) along the last axis, shape (...,).

    With p = gamma + 1 (paper: Lemma A.1): ||x||_{-p} where min x > 0; 0 where min x = 0; -||(-x)_+||_p where min x < 0;
    each is scaled by its extreme m = min x. ``multiplicities`` (n,) says how often each value counts.

    It has the sign of the minimum and never exceeds it: min x >= u > 0, or u <= min x < 0. Raises InputError unless
    gamma is an integer >= 1.
    """
    p = check_gamma(gamma) + 1
    x = _values("values", values)
    if not x.ndim or not x.shape[-1]:
        raise InputError(f"values: found an array of shape {x.shape}, allowed is (..., n) with n >= 1")
    weights = np.ones(x.shape[-1]) if multiplicities is None else _values("multiplicities", multiplicities)
    if weights.shape != x.shape[-1:]:
        raise InputError(f"multiplicities: found an array of shape {weights.shape}, allowed is {x.shape[-1:]}")
    m = x.min(axis=-1, keepdims=True)
    above = np.where(m > 0, m / np.where(m > 0, x, 1.0), 0.0)  # m / x_i
    below = np.where(m < 0, np.minimum(x, 0.0) / np.where(m < 0, m, 1.0), 0.0)  # (-x_i)_+ / (-m)
    m = m[..., 0]
    norm_above = np.sum(weights * above**p, axis=-1, where=m[..., None] > 0, initial=0.0)
    norm_below = np.sum(weights * below**p, axis=-1)
    return np.asarray(np.where(m > 0, m * np.where(m > 0, norm_above, 1.0) ** (-1.0 / p), m * norm_below ** (1.0 / p)))


def holder_maximum(values: ArrayLike, gamma: int, multiplicities: ArrayLike | None = None) -> Array:
    """Return the gamma-Hölder maximum, -min(-x), along the last axis (paper: Definition II.4).

    Arguments and errors as ``holder_minimum``.
    """
    return -holder_minimum(-_values("values", values), gamma, multiplicities)


def shaping(values: ArrayLike, gamma: int, shaping_length: float) -> Array:
    """Return Phi(u) = u |u|^gamma / (|u|^gamma + delta^gamma) for ``values`` of any shape (paper: eq. (1)).

    delta = ``shaping_length`` [m], the height at which Phi halves its argument; epsilon = delta^gamma.
    Raises InputError unless gamma is an integer >= 1, delta is positive and finite, and no value is NaN.
    """
    shaping_length = resolve_shaping_length(check_gamma(gamma), shaping_length, None)
    u = _values("values", values)
    size = np.abs(u)
    power = (np.minimum(size, shaping_length) / np.maximum(size, shaping_length)) ** gamma
    return np.asarray(u * np.where(size > shaping_length, 1.0, power) / (1.0 + power))


def shaped_minimum(
    values: ArrayLike, gamma: int, shaping_length: float, multiplicities: ArrayLike | None = None
) -> tuple[Array, Array, Array]:
    """Return g = Phi(u), u the Hölder minimum of ``values`` (..., n), with its gradient (..., n) and Hessian (..., n,
    n).

    With p = gamma + 1, m = min x, q = du/dx and s = t^gamma/(1 + t^gamma), t = |u|/delta:

        m > 0:  r_i = m/x_i,        q_i = w_i (r_i u/m)^(p+1),  u d²u = (p+1) (q qᵀ - diag(w_i (r_i u/m)^(p+2)))
        m < 0:  r_i = (x_i)_-/m,    q_i = w_i (r_i m/u)^(p-1),  u d²u = (p-1) (diag(w_i (r_i m/u)^(p-2)) - q qᵀ)

        dg = s (1 + gamma (1 - s)) q
        d²g = (s/u) (gamma (1 - s) (1 + gamma (1 - 2 s)) q qᵀ + (1 + gamma (1 - s)) u d²u)

    Every ratio lies in [0, 1] and s/u -> 0 with u (gamma > 1), so everything is finite even where u is too small to
    square. At u = 0 all derivatives are 0; for gamma = 1 the second ones jump there.
    """
    p = check_gamma(gamma) + 1
    x = np.asarray(values, dtype=float)
    w = np.ones(x.shape[-1]) if multiplicities is None else np.asarray(multiplicities, dtype=float)
    m = x.min(axis=-1, keepdims=True)
    above, below = m > 0, m < 0
    r = np.where(above, m / np.where(above, x, 1.0), np.where(below, np.minimum(x, 0.0) / np.where(below, m, 1.0), 0.0))
    root = np.sum(w * r**p, axis=-1, keepdims=True, where=m != 0, initial=0.0) ** (1.0 / p)
    root = np.where(m == 0, 1.0, root)
    u = np.where(above, m / root, m * root)
    q = w * np.where(above, (r / root) ** (p + 1), (r / root) ** (p - 1))
    sharp = w * np.where(above, (r / root) ** (p + 2), np.where(r > 0, (r / root) ** (p - 2), 0.0))
    low = np.minimum(np.abs(u), shaping_length)
    power = (low / np.maximum(np.abs(u), shaping_length)) ** gamma
    near = np.abs(u) < shaping_length
    s, rest = np.where(near, power, 1.0) / (1.0 + power), np.where(near, 1.0, power) / (1.0 + power)
    outer, diagonal = q[..., :, None] * q[..., None, :], sharp[..., None] * np.eye(x.shape[-1])
    order = np.where(above, p + 1, 1 - p)[..., None]
    curved = gamma * rest * (1.0 + gamma * (rest - s))
    slope = 1.0 + gamma * rest
    bracket = curved[..., None] * outer + (slope[..., None] * order) * (outer - diagonal)
    short = np.sign(u) * (low / shaping_length) ** (gamma - 1) / shaping_length / (1.0 + power)
    s_by_u = np.where(near, short, 1.0 / (np.where(near, 1.0, u) * (1.0 + power)))
    live = m != 0
    return (
        (u * s)[..., 0],
        np.where(live, s * slope * q, 0.0),
        np.where(live[..., None], s_by_u[..., None] * bracket, 0.0),
    )


def minimum_shares(values: ArrayLike, gamma: int) -> tuple[Array, Array]:
    """Return the Hölder minimum u (...,) of ``values`` (..., n), and the share (..., n) that each value has in it.

    With p = gamma + 1: (u/x_i)^p for u > 0; (x_i/u)^p for u < 0 and x_i < 0; else 0. They sum to 1 where u is not 0,
    and du/u = Σ share_i dx_i/x_i.
    """
    x, u = _values("values", values), holder_minimum(values, gamma)
    least = u[..., None]
    apart, in_contact = least > 0, (least < 0) & (x < 0)
    ratio = np.where(apart, least, x) / np.where(apart, x, np.where(in_contact, least, 1.0))
    return u, np.where(apart | in_contact, ratio, 0.0) ** (gamma + 1)


def check_gamma(gamma: int) -> int:
    """Return ``gamma`` if it is a whole number from 1 to HIGHEST_GAMMA, else raise InputError."""
    return int(checked(Whole(1, HIGHEST_GAMMA), gamma, "gamma"))


def _values(name: str, values: ArrayLike) -> Array:
    """Return an array of numbers without NaN, which would make any minimum NaN."""
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: not an array of numbers ({error})") from None
    if np.isnan(found).any():
        raise InputError(f"{name}: found NaN, allowed are numbers")
    return found


def resolve_shaping_length(gamma: int, shaping_length: float, epsilon: float | None) -> float:
    """Return the shaping length delta [m]: ``shaping_length``, or epsilon^(1/gamma) where the paper's epsilon is given.

    Raises InputError unless the one that is used is positive and finite.
    """
    name, value = ("shaping_length", shaping_length) if epsilon is None else ("epsilon", epsilon)
    length = float(checked(Number(above=0.0), value, name))
    return length if epsilon is None else length ** (1.0 / check_gamma(gamma))
