"""Safety of the settings of a control barrier: what Δ ≥ δ guarantees for the true clearance, and what it does not.

The obstacles are grown by g, and the controller keeps h = Δ − δ ≥ 0. This is what follows for the signed distance d of
the outer bodies; the true distance is no less, as they contain the real ones:

* exact distance: Δ = d − g, so d ≥ g + δ.
* HD-SDF: let D̃ = max_n min_ij x_ij be the plain maximum over its K unit normals; D̃ ≤ d − g, both separated and in
  overlap (also for sets with shorter axes, as `normals` defines it). With p = γ+1, N_in the least number of vertex
  pairs with equal projections (4 for two boxes: a box's corners on its own axes; otherwise 1), and Φ the shaping, the
  inequalities between norms give |⊕| ≥ N_in^(1/p) |min| in overlap, ⊕ ≤ N_in^(−1/p) min when separated, and the
  opposite for ⊞, which changes the maximum by a factor of up to K^(1/p), always upward. Hence

      D ≥ δ < 0   ⇒   D̃ ≥ −N_in^(−1/p) Φ⁻¹(K^(1/p) Φ⁻¹(|δ|))
      D ≥ δ ≥ 0   ⇒   D̃ ≥  N_in^(1/p) Φ⁻¹(K^(−1/p) Φ⁻¹(δ)),

  and d ≥ g + that bound. It is attained only if all K normals give the same value; a proof has to allow for that if
  nothing is known about them. Known unit normals n_k cannot all give the same value: for separated bodies, with witness
  points at distance d along m, each x_k ≤ d n_k·m − g, so that

      D ≥ δ > 0   ⇒   Φ⁻¹(δ) ≤ max_m ‖(d n_k·m − g)_k₊‖_p,

  whose right side grows with d: the d at which both sides are equal is proven (`least_distance`).
* GDF: an approximation, whose derivative is exact only where its iteration has converged; nothing is guaranteed.

Time: commands are held over a period T, so h is kept at the samples (η T ≤ 1: a linear barrier does not cross zero; the
controller's look-ahead checks curved ones), and between two samples no two points approach by more than V T / 2 from
the nearer sample, with V the largest speed of a point of the robot relative to the obstacle. So

    d ≥ clearance(δ, g) − V T / 2                                                             at every time.

A setting is *safe* if this is positive. It is *refused* if it is provably unsafe: if touching bodies satisfy Δ ≥ δ; if
∇Δ vanishes on the barrier's own boundary (δ at the flat spot), where no motion at all is forbidden; or if η T > 1, when
the barrier condition itself lets h overshoot zero. In between nothing is proven, and the controller says so.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit

from hdplan.distance.compiled.loops import C, twin_of
from hdplan.distance.symbolic.box_kernel import axis_count
from hdplan.planner.collision.halfspace_bodies import plane_counts
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import made_once, read_only

LEAST_SLOPE = 1e-3  # a barrier with a smaller slope over the separation on its own boundary forbids nothing there
DIRECTION_CELLS = 24  # cells along an edge of the cube whose grid covers all directions
NEWTON_STEPS = 8  # iterations: from at most ln 2 away, each squares what is left
RESOLUTION = 1e-9  # [m] and [1]: resolution of least distances, and of their normals


def shaped(value: float, gamma: int, length: float) -> float:
    """Return Phi(u) = u |u|^gamma/(|u|^gamma + length^gamma) of one number; see `holder.shaping`."""
    return value * _share(abs(value), gamma, length)


def _share(size: float, gamma: int, length: float) -> float:
    """Return size^gamma/(size^gamma + length^gamma), or 0 if that underflows."""
    if size >= length:
        return 1.0 / (1.0 + (length / size) ** gamma)
    less = (size / length) ** gamma
    return less / (1.0 + less)


def unshaped(value: Array | float, gamma: int, length: float) -> Array:
    """Return the u ≥ 0 with Phi(u) = value, for values (...) ≥ 0.

    Of x = ln(u/length): (γ + 1) x − ln(1 + exp(γ x)) = ln(value/length), by Newton's method from the left, which never
    passes the root of a concave function that grows.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = np.log(np.asarray(value) / length)
        x = np.where(wanted > 0.0, wanted, wanted / (gamma + 1))
        for _ in range(NEWTON_STEPS):
            x = x - ((gamma + 1) * x - np.logaddexp(0.0, gamma * x) - wanted) / (1.0 + gamma * expit(-gamma * x))
        return np.where(np.asarray(value) > 0.0, length * np.exp(x), 0.0)


def counts(distance: str, normals: str) -> tuple[int, int, int]:
    """Return K, N_in and the multiplicity of a normal, for "hdsdf" (the obstacle's planes) and "hdsdf-boxes" (the
    paper's set for both boxes)."""
    if distance == "hdsdf-boxes":
        alike = axis_count(normals)
        return 12 * alike, 4, alike
    return max(plane_counts(normals)), 1, 1


@functools.lru_cache(maxsize=1024)
def separation_bound(delta: float, gamma: int, length: float, count: int, inner: int) -> float:
    """Return the least D̃ [m] possible with D ≥ delta [m], by the module's equations."""
    p = gamma + 1
    if delta < 0:
        return -float(inner ** (-1 / p) * unshaped(count ** (1 / p) * unshaped(-delta, gamma, length), gamma, length))
    return float(inner ** (1 / p) * unshaped(count ** (-1 / p) * unshaped(delta, gamma, length), gamma, length))


def least_distance(normals: Array, delta: float, growth: float, gamma: int, length: float) -> float:
    """Return the least true distance [m] possible with D ≥ delta [m] for a body with these unit normals (K, 3), in any
    frame, grown by `growth` [m]: a lower bound, never less than that of `separation_bound`."""
    alike = growth + separation_bound(delta, gamma, length, len(normals), 1)
    if delta <= 0.0:
        return alike
    rounded = np.round(normals, 9) + 0.0  # no -0, whose bytes differ from those of 0
    return max(alike, _least_distance(rounded.tobytes(), delta, growth, gamma, length))


@made_once(1024)
def _least_distance(normals: bytes, delta: float, growth: float, gamma: int, length: float) -> float:
    """Solve the equation of `least_distance`. Its right side is convex in m, so that its maximum over a polytope around
    the unit ball, a bound for the ball, is at a vertex."""
    wanted = float(unshaped(delta, gamma, length))
    along = _around_the_ball() @ np.frombuffer(normals).reshape(-1, 3).T
    power = gamma + 1

    def above(distance: float) -> float:
        read = np.maximum(distance * (along + RESOLUTION) - growth, 0.0) / wanted
        return float((read**power).sum(axis=1).max()) - 1.0

    return float(brentq(above, 0.0, 2.0 * (growth + wanted), xtol=RESOLUTION)) - 2 * RESOLUTION


@functools.cache
def _around_the_ball() -> Array:
    """Return vertices (M, 3) whose hull contains the unit ball: a grid of DIRECTION_CELLS cells along a cube's edges,
    projected from its centre. Every direction is within the diagonal of a cell, √2 · 2/DIRECTION_CELLS, of one of them
    on the cube, and closer on the ball: the cosine between the two is at least 1 − half the square of that."""
    ticks = np.linspace(-1.0, 1.0, DIRECTION_CELLS + 1)
    u, v = (part.ravel() for part in np.meshgrid(ticks, ticks))
    face = np.stack([u, v, np.ones_like(u)], axis=1)
    corners = np.vstack([np.roll(face * [1, 1, sign], turn, axis=1) for turn in range(3) for sign in (1, -1)])
    return read_only(corners / np.linalg.norm(corners, axis=1, keepdims=True) / (1.0 - (2.0 / DIRECTION_CELLS) ** 2))


def sufficient_separation(delta: float, gamma: int, length: float, corners: int) -> float:
    """Return a D̃ [m] that proves D ≥ delta for a link body with so many vertices: N_out^(1/p) Φ⁻¹(Φ⁻¹(δ)), as
    ⊕ ≥ N_out^(−1/p) min and more normals only raise D; 0 for a delta of 0 or less."""
    if delta <= 0.0:
        return 0.0
    return float(corners ** (1 / (gamma + 1)) * unshaped(unshaped(delta, gamma, length), gamma, length))


def guaranteed_clearance(
    distance: str, delta: float, growth: float, gamma: int, length: float, normals: str
) -> float | None:
    """Return the true clearance [m] that Δ ≥ delta proves at that instant (a lower bound); None if nothing is proven.

    It may be negative: then the proof is not sufficient, which is no proof of contact.
    """
    if distance == "gdf":
        return None
    if distance == "euclidean":
        return growth + delta
    count, inner, _ = counts(distance, normals)
    return growth + separation_bound(delta, gamma, length, count, inner)


def touching_value(growth: float, gamma: int, length: float, inner: int, alike: int) -> float:
    """Return a lower bound of Δ [m] where one vertex touches a face of the true body: D̃ = −growth along that face's
    normal, with all other vertices deeper. Other normals only raise it."""
    p = gamma + 1
    return -shaped(alike ** (-1 / p) * shaped(inner ** (1 / p) * growth, gamma, length), gamma, length)


def _straightened(distance: Array | float, gamma: int, length: float) -> tuple[Array, Array]:
    given = np.asarray(distance, np.float64)
    found = np.empty((2, *given.shape))
    C.straightened(gamma, length, np.ascontiguousarray(given).reshape(-1), *found.reshape(2, -1))
    return found[0], found[1]


@twin_of(_straightened)
def straightened(distance: Array | float, gamma: int, length: float) -> tuple[Array, Array]:
    """Return the separations u (...) [m] with D = Φ(Φ(u)), those of one normal and one pair of vertices without the
    flat spot, and dD/du there: 0 and 0 for 0."""
    value, slope = np.abs(np.asarray(distance)), np.where(np.asarray(distance) != 0.0, 1.0, 0.0)
    for _ in range(2):
        value = unshaped(value, gamma, length)
        with np.errstate(divide="ignore"):
            share = expit(gamma * np.log(value / length))
        slope = slope * share * (1.0 + gamma * (1.0 - share))
    return np.copysign(value, distance), slope


def refuse_unsafe(
    distance: str, delta: float, growth: float, gamma: int, length: float, normals: str, rate: float, period: float
) -> None:
    """Raise InputError, naming the setting, for settings that are provably not safe by the rules of the module."""
    if rate * period > 1.0:
        raise InputError(
            f"control.rate: {rate:g} /s at a period of {period:g} s overshoots its own barrier (rate x period is "
            f"{rate * period:.3g}), at most {1.0 / period:g} /s is allowed"
        )
    if distance == "gdf":
        return
    if distance == "euclidean":
        if growth + delta <= 0.0:
            raise InputError(
                f"control.margin: {delta:g} m with growth {growth:g} m puts the barrier's zero inside the true body, "
                f"more than {-growth:g} m is needed"
            )
        return
    if straightened(delta, gamma, length)[1] < LEAST_SLOPE:
        raise InputError(
            f"control.margin: {delta:g} m lies on the flat spot of the HD-SDF (shaping length {length:g} m): its "
            "gradient vanishes on the barrier's own boundary, so that it forbids nothing there; "
            f"{-length / 4:g} m is allowed, for instance"
        )
    _, inner, alike = counts(distance, normals)
    touching = touching_value(growth, gamma, length, inner, alike)
    if touching >= delta:
        raise InputError(
            f"control.margin: {delta:g} m with growth {growth:g} m and shaping length {length:g} m lets bodies touch: "
            f"a vertex on a face has a distance of {touching:.3g} m or more; use a margin above that, or more growth"
        )
