"""Which settings of a control barrier are safe: what Δ ≥ δ guarantees of the true clearance, and what it cannot.

The obstacles are grown by g, and the controller keeps h = Δ − δ ≥ 0. What that means for the true signed distance d of
the bodies (which the outer bodies contain, so d only gains):

* exact distance: Δ = d − g, so d ≥ g + δ.
* HD-SDF: let D̃ = max_n min_ij x_ij be the plain maximum over its K unit normals; D̃ ≤ d − g, apart and in overlap
  (sets with shorter axes too, as `normals` defines it). With p = γ+1, N_in the least number of vertex pairs that
  project alike (4 for two boxes: a box's corners on its own axes; else 1), and Φ the shaping, the norms' inequalities
  give |⊕| ≥ N_in^(1/p) |min| below contact, ⊕ ≤ N_in^(−1/p) min above, and the
  opposite for ⊞, which moves the maximum by up to K^(1/p), always upward. Hence

      D ≥ δ < 0   ⇒   D̃ ≥ −N_in^(−1/p) Φ⁻¹(K^(1/p) Φ⁻¹(|δ|))
      D ≥ δ ≥ 0   ⇒   D̃ ≥  N_in^(1/p) Φ⁻¹(K^(−1/p) Φ⁻¹(δ)),

  and d ≥ g + that bound. It is attained only where all K normals read alike; a proof has to allow for it where nothing
  is known of them. Unit normals n_k that are known cannot read alike: of bodies apart, with witness points at distance
  d along m, each x_k ≤ d n_k·m − g, so that

      D ≥ δ > 0   ⇒   Φ⁻¹(δ) ≤ max_m ‖(d n_k·m − g)_k₊‖_p,

  whose right side grows with d: the d where it is equal is proven (`least_distance`).
* GDF: an approximation, whose derivative is exact only where its iteration has converged; nothing is guaranteed.

Time: commands are held over a period T, so h is kept at the samples (η T ≤ 1: a linear barrier does not cross zero; the
controller's look-ahead makes sure of the curved ones), and between two samples no two points approach by more than
V T / 2 from the nearer one, V the largest speed of a point of the robot, relative to the obstacle. So

    d ≥ clearance(δ, g) − V T / 2                                                             at every time.

A setting is *safe* if this is positive. It is *refused* if it is provably not: if bodies that touch satisfy Δ ≥ δ; if
∇Δ vanishes on the barrier's own boundary (δ at the flat spot), where no motion at all is forbidden; if η T > 1, where
the barrier overshoots by its own law. In between nothing is proven, and the controller says so.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hdplan.distance.symbolic.boxes import axis_count
from hdplan.planner.collision.halfspace_bodies import plane_counts
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import made_once, read_only

Floats = NDArray[np.float64]

FLAT = 1e-3  # a barrier whose slope by the separation is less on its own boundary forbids nothing there
GRID = 24  # cells along an edge of the cube whose grid covers all directions
FINE = 1e-9  # [m] and [1]: resolution of least distances and of their normals


def shaped(value: float, gamma: int, length: float) -> float:
    """Return Phi(u) = u |u|^gamma/(|u|^gamma + length^gamma), as `holder.shaping`, of one number."""
    return value * _share(abs(value), gamma, length)


def _share(size: float, gamma: int, length: float) -> float:
    """Return size^gamma/(size^gamma + length^gamma), which is 0 where that is less than a number can be."""
    if size >= length:
        return 1.0 / (1.0 + (length / size) ** gamma)
    less = (size / length) ** gamma
    return less / (1.0 + less)


def unshaped(value: float, gamma: int, length: float) -> float:
    """Return the u > 0 with Phi(u) = value, for value > 0; 0 for 0."""
    if value == 0.0:
        return 0.0
    high = 2.0 * value + 2.0 * value ** (1.0 / (gamma + 1)) * length ** (gamma / (gamma + 1))
    return float(brentq(lambda u: shaped(u, gamma, length) - value, value, high, xtol=1e-300, rtol=1e-12))


def counts(distance: str, normals: str) -> tuple[int, int, int]:
    """Return K, N_in and how often one and the same normal counts, for "hdsdf" (planes of the obstacle's side) and
    "hdsdf-boxes" (the paper's set of both boxes)."""
    if distance == "hdsdf-boxes":
        alike = axis_count(normals)
        return 12 * alike, 4, alike
    return max(plane_counts(normals)), 1, 1


def separation_bound(delta: float, gamma: int, length: float, count: int, inner: int) -> float:
    """Return the least D̃ [m] that D ≥ delta [m] leaves possible: the equations above."""
    p = gamma + 1
    if delta < 0:
        return -float(inner ** (-1 / p)) * unshaped(count ** (1 / p) * unshaped(-delta, gamma, length), gamma, length)
    return float(inner ** (1 / p)) * unshaped(count ** (-1 / p) * unshaped(delta, gamma, length), gamma, length)


def least_distance(normals: Floats, delta: float, growth: float, gamma: int, length: float) -> float:
    """Return the least true distance [m] that D ≥ delta [m] leaves possible for a body of these unit normals (K, 3), in
    any frame, grown by `growth` [m]: a lower bound, never less than that of `separation_bound`."""
    alike = growth + separation_bound(delta, gamma, length, len(normals), 1)
    if delta <= 0.0:
        return alike
    return max(alike, _least_distance(np.round(normals, 9).tobytes(), delta, growth, gamma, length))


@made_once(1024)
def _least_distance(normals: bytes, delta: float, growth: float, gamma: int, length: float) -> float:
    """Solve the equation of `least_distance`. Its right side is convex in m, so that it is greatest over the unit ball
    at a corner of a polytope around that."""
    wanted = unshaped(delta, gamma, length)
    along = _around_the_ball() @ np.frombuffer(normals).reshape(-1, 3).T
    power = gamma + 1

    def above(distance: float) -> float:
        read = np.maximum(distance * (along + FINE) - growth, 0.0) / wanted
        return float((read**power).sum(axis=1).max()) - 1.0

    return float(brentq(above, 0.0, 2.0 * (growth + wanted), xtol=FINE)) - 2 * FINE


@functools.cache
def _around_the_ball() -> Floats:
    """Corners (M, 3) whose hull holds the unit ball: a grid of GRID cells along a cube's edges, seen from its centre.
    Every direction is within the diagonal of a cell, √2 · 2/GRID, of one of them on the cube, less on the ball: their
    cosine is 1 − half of its square or more."""
    ticks = np.linspace(-1.0, 1.0, GRID + 1)
    u, v = (part.ravel() for part in np.meshgrid(ticks, ticks))
    face = np.stack([u, v, np.ones_like(u)], axis=1)
    corners = np.vstack([np.roll(face * [1, 1, sign], turn, axis=1) for turn in range(3) for sign in (1, -1)])
    return read_only(corners / np.linalg.norm(corners, axis=1, keepdims=True) / (1.0 - (2.0 / GRID) ** 2))


def sufficient_separation(delta: float, gamma: int, length: float, corners: int) -> float:
    """Return a D̃ [m] that proves D ≥ delta for a link body of so many corners: N_out^(1/p) Φ⁻¹(Φ⁻¹(δ)), as
    ⊕ ≥ N_out^(−1/p) min and more normals only raise D; 0 for a delta of 0 or less."""
    if delta <= 0.0:
        return 0.0
    return float(corners ** (1 / (gamma + 1)) * unshaped(unshaped(delta, gamma, length), gamma, length))


def guaranteed_clearance(
    distance: str, delta: float, growth: float, gamma: int, length: float, normals: str
) -> float | None:
    """Return the true clearance [m] that Δ ≥ delta proves at that instant (a lower bound); None if nothing is proven.

    It may be negative: then the proof does not reach, which is no proof of contact.
    """
    if distance == "gdf":
        return None
    if distance == "euclidean":
        return growth + delta
    count, inner, _ = counts(distance, normals)
    return growth + separation_bound(delta, gamma, length, count, inner)


def touching_value(growth: float, gamma: int, length: float, inner: int, alike: int) -> float:
    """Return a Δ [m] that is not less where one vertex touches the face of the true body: D̃ = −growth along that
    face's normal, all others deeper. Other normals only raise it."""
    p = gamma + 1
    return -shaped(alike ** (-1 / p) * shaped(inner ** (1 / p) * growth, gamma, length), gamma, length)


def straightened(distance: float, gamma: int, length: float) -> tuple[float, float]:
    """Return the separation u [m] of one normal and one pair of vertices that reads D = Φ(Φ(u)), without the flat spot,
    and dD/du there: 0 and 0 for 0."""
    slope, value = 1.0, abs(distance)
    for _ in range(2):
        value = unshaped(value, gamma, length)
        if value == 0.0:
            return 0.0, 0.0
        share = _share(value, gamma, length)
        slope *= share * (1.0 + gamma * (1.0 - share))
    return math.copysign(value, distance), slope


def refuse_unsafe(
    distance: str, delta: float, growth: float, gamma: int, length: float, normals: str, rate: float, period: float
) -> None:
    """Raise InputError, by the name of the setting, for settings that are provably not safe: the rules above."""
    if rate * period > 1.0:
        raise InputError(
            f"control.rate: {rate:g} /s at a period of {period:g} s overshoots its own barrier (rate x period is "
            f"{rate * period:.3g}), allowed is up to {1.0 / period:g} /s"
        )
    if distance == "gdf":
        return
    if distance == "euclidean":
        if growth + delta <= 0.0:
            raise InputError(
                f"control.margin: {delta:g} m with growth {growth:g} m puts the barrier's zero inside the true body, "
                f"allowed is more than {-growth:g} m"
            )
        return
    if straightened(delta, gamma, length)[1] < FLAT:
        raise InputError(
            f"control.margin: {delta:g} m lies on the flat spot of the HD-SDF (shaping length {length:g} m): its "
            "gradient vanishes on the barrier's own boundary, so that it forbids nothing there; "
            f"allowed is for instance {-length / 4:g} m"
        )
    _, inner, alike = counts(distance, normals)
    touching = touching_value(growth, gamma, length, inner, alike)
    if touching >= delta:
        raise InputError(
            f"control.margin: {delta:g} m with growth {growth:g} m and shaping length {length:g} m lets bodies touch: "
            f"a vertex on a face reads {touching:.3g} m or more; allowed is a margin above that, or more growth"
        )
