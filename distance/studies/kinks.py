"""Two squares moving past each other: where the Euclidean signed distance has kinks and the HD-SDF has none.

Out: both distances over time with their time derivatives, exact, not by differences (paper: Figure
1), and every jump of the Euclidean rate beside what the HD-SDF's does there.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.baselines.coal import signed_distance
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.numpy_reference.hdsdf import hdsdf_derivatives
from hdplan.scenes.array_types import Array

SIDE = 1.0  # [m] of both squares
DEPTH = 100.0  # [m] of the prisms whose exact distance is the squares': so long that the shortest way out is in plane
DURATION = 4.0  # [s]
START = (-1.4, 1.6, -0.65)  # [m, m, rad] where the moving square begins; the other one rests at the origin
VELOCITY = (0.98, -0.41)  # [m/s] along x and y
TURNING = 0.66  # [rad/s]
GAMMA = 2
SHAPING_LENGTHS = (1e-2, 1e-1)  # [m] the paper's epsilon = 1e-4, and a softer one
SUSPECT_CHANGE = 0.02  # [m/s] a rate that changes more than this from one sample to the next is examined closely
INSTANT = 1e-8  # [s] across which a change is called a jump
BESIDE_KINK = 1e-6  # [s] from a kink where its one-sided rates are taken: nearer, faces are parallel to the oracle
JUMP = 1e-3  # [m/s] least change across an instant that counts


@dataclass(frozen=True, eq=False)
class Curve:
    """A distance over time."""

    name: str
    value: Array  # (N,) [m]
    rate: Array  # (N,) [m/s]
    second: Array  # (N,) [m/s²]; not a number at a kink


@dataclass(frozen=True)
class Kink:
    """An instant at which the Euclidean distance's rate jumps."""

    time: float  # [s]
    distance: float  # [m] the Euclidean one
    before: float  # [m/s] the rate just before
    after: float  # [m/s] and just after


@dataclass(frozen=True, eq=False)
class Kinks:
    """Figures of ``kinks``."""

    times: Array  # (N,) [s]
    euclidean: Curve
    smooth: tuple[Curve, ...]  # the HD-SDF, one per shaping length
    kinks: tuple[Kink, ...]
    largest_jump: float  # [m/s] the largest change of any HD-SDF's rate across an instant, searched at its steepest


def kinks(samples: int = 1601) -> Kinks:
    """Return both distances of the squares at ``samples`` equal steps of time, and the kinks.

    Euclidean: exact, d' = n·(velocity of A's closest point) with the unit normal n. HD-SDF (gamma 2): D' = g·ξ and
    D'' = ξ·Hξ + g·ξ' with the gradient and Hessian by A's twist ξ in its own frame.
    """
    times = np.linspace(0.0, DURATION, samples)
    value, rate = _euclidean(times)
    instants, before, after = _narrowed(lambda t: _euclidean(t)[1], times, rate)
    real = np.abs(after - before) > JUMP
    instants = instants[real]
    sides = [_euclidean(instants + sign * BESIDE_KINK)[1] for sign in (-1.0, 1.0)]
    found = tuple(map(Kink, *np.stack([instants, _euclidean(instants)[0], *sides]).tolist()))
    second = _between_kinks(times, rate, instants)
    smooth, largest = [], 0.0
    for length in SHAPING_LENGTHS:
        curve = Curve(f"HD-SDF, shaping length {length * 100:g} cm", *_holder(times, length))
        _, before, after = _narrowed(functools.partial(_holder_rate, length=length), times, curve.rate)
        smooth.append(curve)
        largest = max(largest, float(np.max(np.abs(after - before), initial=0.0)))
    return Kinks(times, Curve("Euclidean", value, rate, second), tuple(smooth), found, largest)


def square(side: float = SIDE) -> ConvexBody:
    """Return a square in its own plane, z = 0, without the normals out of it: to the HD-SDF a two-dimensional body."""
    corners = 0.5 * side * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    return ConvexBody(corners, np.empty((0, 3)), np.eye(3)[:2], np.full(2, 2.0))


def pose(times: ArrayLike) -> Array:
    """Return the moving square's pose (..., 4, 4), world from body, at ``times`` (...) [s]."""
    t = np.asarray(times, dtype=float)
    x, y, angle = START[0] + VELOCITY[0] * t, START[1] + VELOCITY[1] * t, START[2] + TURNING * t
    placed = np.zeros((*t.shape, 4, 4))
    placed[..., 0, 0] = placed[..., 1, 1] = np.cos(angle)
    placed[..., 1, 0] = np.sin(angle)
    placed[..., 0, 1] = -placed[..., 1, 0]
    placed[..., 2, 2] = placed[..., 3, 3] = 1.0
    placed[..., 0, 3], placed[..., 1, 3] = x, y
    return placed


def _euclidean(times: Array) -> tuple[Array, Array]:
    """Return the exact signed distance [m] and its rate [m/s] at ``times`` (N,)."""
    prism, values, rates = ConvexBody.box([SIDE, SIDE, DEPTH]), [], []
    for at in pose(times):
        nearest = signed_distance(prism, at, prism, np.eye(4))
        arm = nearest.point_a - at[:3, 3]
        values.append(nearest.distance)
        rates.append(nearest.normal @ [VELOCITY[0] - TURNING * arm[1], VELOCITY[1] + TURNING * arm[0], 0.0])
    return np.array(values), np.array(rates)


def _holder(times: Array, length: float) -> tuple[Array, Array, Array]:
    """Return D [m], D' [m/s] and D'' [m/s²] at ``times`` (N,)."""
    placed = pose(times)
    d = hdsdf_derivatives(square(), placed, square(), np.eye(4), gamma=GAMMA, shaping_length=length)
    twist, change = np.zeros((len(times), 12)), np.zeros((len(times), 12))
    twist[:, :3] = np.einsum(
        "nij,i->nj", placed[:, :2, :3], VELOCITY
    )  # the velocity, constant in the world, in the body's own frame
    twist[:, 5] = TURNING
    change[:, 0], change[:, 1] = TURNING * twist[:, 1], -TURNING * twist[:, 0]
    first = np.einsum("ni,ni->n", d.gradient, twist)
    second = np.einsum("ni,nij,nj->n", twist, d.hessian, twist) + np.einsum("ni,ni->n", d.gradient, change)
    return d.value, first, second


def _holder_rate(times: Array, length: float) -> Array:
    return _holder(times, length)[1]


def _narrowed(rate: Callable[[Array], Array], times: Array, rates: Array) -> tuple[Array, Array, Array]:
    """Return, for every step across which ``rates`` change by more than SUSPECT_CHANGE, an instant in it and the rates
    on both sides, three arrays (K,): the step is halved, each time keeping the half with the larger change."""
    k = np.flatnonzero(np.abs(np.diff(rates)) > SUSPECT_CHANGE)
    left, right, before, after = times[k], times[k + 1], rates[k], rates[k + 1]
    while len(k) and right[0] - left[0] > INSTANT:
        middle = 0.5 * (left + right)
        between = rate(middle)
        earlier = np.abs(between - before) > np.abs(after - between)
        left, right = np.where(earlier, left, middle), np.where(earlier, middle, right)
        before, after = np.where(earlier, before, between), np.where(earlier, between, after)
    return 0.5 * (left + right), before, after


def _between_kinks(times: Array, rates: Array, instants: Array) -> Array:
    """Return the slopes (N,) of ``rates`` by differences, NaN where these would reach across a kink."""
    slopes = np.gradient(rates, times)
    for instant in instants:
        k = int(np.searchsorted(times, instant))
        slopes[max(k - 1, 0) : k + 1] = np.nan
    return np.asarray(slopes)
