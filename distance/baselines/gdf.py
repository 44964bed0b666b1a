"""The GDF baseline: the generalized distance function, smooth, unsigned and found by iteration.

In: two solid polytopes and their poses (4, 4), world from body [m]. Out: ``GdfProximity``, 0 where the bodies meet. It
is the differentiable metric that the paper compares with (V. M. Gonçalves et al., 2026, cited there). Each body has a
smooth function E of a point q, 0 in the body and growing away from it: with its planes' unit rows A_i, b_i, and the
centre c and full size l of its bounding box, all in its own frame,

    s(x) = x²/2 - h/(h-1) {h/(2h-1) [(1+x)^(2-1/h) - 1] - x} for x > 0, else 0 G(q) = Σ_i s(A_i·q - b_i) / N N = 1 for a
    box, else half the number of faces, plus 1 F(q) = ε/2 (|q - c|² - 0.3 |l|²) ε makes flat parts bulge E(q) = F + √(F²
    + max(1-2ε, 0) G²) Π(q) = q - ∇E(q), a smooth projection

The pair a = Π_A(b), b = Π_B(a) is found by alternating projections, and then (as the iteration ends at a tolerance, the
derivative has an error of first order in what remains, the value one of second order)

    D² = 2 E_A(b) + 2 E_B(a) - |a - b|²                        ∂D/∂(translation of A) = (a - b)/D

An approximation: the Euclidean distance for boxes as h and ε go to 0, another metric for other bodies.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.bodies import ConvexBody, check_bodies
from hdplan.distance.poses import check_pose
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

Energy = Callable[[Array], tuple[float, Array]]  # q (3,) -> E [m²] and ∇E (3,) [m]

RIGHT_ANGLE = 1e-9  # the cosine of a box's right angles is this close to 0


@dataclass(frozen=True, eq=False)
class GdfProximity:
    """The result of the iteration."""

    distance: float  # [m] D >= 0; 0 = the bodies meet
    point_a: Array  # (3,) [m] the pair's point of A, in the world
    point_b: Array  # (3,) [m] and of B
    gradient_a: Array  # (3,) derivative of D by A's translation; zero where D is 0, and D has no derivative
    iterations: int  # pairs of projections made
    converged: bool  # whether the last of them moved point_a by less than the tolerance


def gdf(
    body_a: ConvexBody,
    pose_a: ArrayLike,
    body_b: ConvexBody,
    pose_b: ArrayLike,
    *,
    h: float = 0.1,
    bulging: float = 0.01,
    tolerance: float = 1e-3,
    iterations: int = 1000,
    start: ArrayLike | None = None,
) -> GdfProximity:
    """Return the generalized distance of A and B.

    An unsigned approximation, and not sign-safe: before convergence D may be anything. Defaults: the paper's h and the
    middle of its range of ε (section IV), and the tolerance of its authors' package uaibot, with which D is accurate to
    about 1 cm for solids of 1 m (uaibot also stops after 20 iterations, but starts from the closest points).

    Args:
        body_a, body_b: solid polytopes without a radius, each in its own frame.
        pose_a, pose_b: (4, 4) rigid transforms from body to world [m].
        h: smoothing, > 0, neither 1/2 nor 1.
        bulging: ε >= 0.
        tolerance: the iteration ends when A's point moves by less [m].
        iterations: the most pairs of projections.
        start: (3,) a first point of A in the world [m]; None takes the centre of A's bounding box.

    Raises InputError for flat and for swept bodies, for unions, for poses that are not finite, not rigid or of another
    shape, and for parameters out of range.
    """
    check_bodies(body_a, body_b)
    if not (np.isfinite(h) and h > 0) or h in (0.5, 1.0):
        raise InputError(f"h: found {h}, allowed are positive numbers but 0.5 and 1, where the metric is singular")
    for name, number in (("bulging", bulging), ("tolerance", tolerance)):
        if not (np.isfinite(number) and number >= 0):
            raise InputError(f"{name}: found {number}, allowed is a number >= 0")
    if iterations < 1:
        raise InputError(f"iterations: found {iterations}, allowed are 1 or more")
    place_a, place_b = check_pose("pose_a", pose_a), check_pose("pose_b", pose_b)
    solid_a, solid_b = _solid(body_a), _solid(body_b)
    energy_a, energy_b = _energy(solid_a, place_a, h, bulging), _energy(solid_b, place_b, h, bulging)
    a = place_a[:3, :3] @ solid_a.centre + place_a[:3, 3] if start is None else np.asarray(start, dtype=float)
    if a.shape != (3,) or not np.isfinite(a).all():
        raise InputError(f"start: found {a.tolist()}, allowed is a finite point (3,)")
    count, step = 0, math.inf
    while step >= tolerance and count < iterations:
        b = a - energy_b(a)[1]
        outside_a, slope = energy_a(b)
        before, a = a, b - slope
        count, step = count + 1, math.dist(before, a)
    apart = a - b
    distance = math.sqrt(max(2.0 * outside_a + 2.0 * energy_b(a)[0] - float(apart @ apart), 0.0))
    gradient = apart / distance if distance > 0 else np.zeros(3)
    return GdfProximity(distance, a, b, gradient, count, step < tolerance)


class _Solid(NamedTuple):
    """Constants of a body."""

    rows: Array  # (K, 3) unit, A_i
    offsets: Array  # (K,) [m] b_i
    share: float  # 1/N
    centre: Array  # (3,) [m] c
    bound: float  # [m²] 0.3 |l|²


@functools.lru_cache(maxsize=4096)
def _solid(body: ConvexBody) -> _Solid:
    if body.radius > 0:
        raise InputError(f"GDF: found a body swept by {body.radius} m, allowed are bodies of radius 0: it has no sweep")
    if len(body.faces) < 4:
        raise InputError(f"GDF: found a body with {len(body.faces)} faces, allowed are solid ones")
    cosines = np.abs(body.faces @ body.faces.T)
    is_box = len(body.faces) == 6 and bool(np.all(np.minimum(cosines, np.abs(1.0 - cosines)) < RIGHT_ANGLE))
    low, high = body.vertices.min(0), body.vertices.max(0)
    size = high - low
    return _Solid(
        body.faces,
        np.max(body.faces @ body.vertices.T, axis=1),
        1.0 if is_box else 1.0 / (len(body.faces) // 2 + 1),
        0.5 * (low + high),
        0.3 * float(size @ size),
    )


def _energy(solid: _Solid, pose: Array, h: float, bulging: float) -> Energy:
    """Return E and its gradient as a function of a point in the world."""
    rows = solid.rows @ pose[:3, :3].T
    offsets = solid.offsets + rows @ pose[:3, 3]
    centre = pose[:3, :3] @ solid.centre + pose[:3, 3]
    kept, power, other = max(1.0 - 2.0 * bulging, 0.0), 1.0 - 1.0 / h, 2.0 - 1.0 / h

    def at(q: Array) -> tuple[float, Array]:
        x = np.maximum(rows @ q - offsets, 0.0)
        grown = np.expm1(power * np.log1p(x))  # (1+x)^power - 1, to full precision near the body
        g = solid.share * float((0.5 * x * x - ((grown + x + x * grown) / other - x) / power).sum())
        out = q - centre
        f = 0.5 * bulging * (float(out @ out) - solid.bound)
        root = math.sqrt(f * f + kept * g * g)
        if root == 0.0:
            return 0.0, np.zeros(3)
        energy = f + root if f > 0 else kept * g * g / (root - f)  # the same, without cancellation
        along = (x - grown / power) @ rows  # ∇G = share * along
        return energy, (energy * bulging * out + kept * g * solid.share * along) / root

    return at
