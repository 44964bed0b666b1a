"""Poses at every witness of the distance, against a separate implementation of the paper, in 80 bits where in doubt.

A case is one pair of bodies with one setting at `POSES` poses: random, aligned to the last digit or nearly, touching,
overlapping, far. Values of all, signs against contacts that the judge finds by itself, and along random twists slope
and curvature against differences.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hdplan import distance as library
from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.symbolic.halfspaces import halfspace_distance, swept_halfspace_distance
from hdplan.scenes.array_types import Array
from sieges import gjk, paper
from sieges.campaign import Outcome
from sieges.poses import turn

POSES = 4096
TWISTS = 60  # poses of a case at which derivatives are compared
ULP = float(np.finfo(float).eps)
STEP = 1e-6
EXACT = 5e-9  # of the size, of the exact distance; the library says about 1e-9
SETTINGS = (  # pairs, gamma, shaping length [m], normals
    ("cube", "cube", 2, 1e-3, "paper"),
    ("box", "cube", 2, 1e-2, "paper+edges"),
    ("tetrahedron", "octahedron", 3, 1e-3, "paper"),
    ("round box", "box", 2, 1e-2, "paper"),
    ("cube", "prism", 2, 1e-3, "paper+centre"),
    ("box", "box", 4, 1e-2, "paper"),
    ("icosahedron", "tetrahedron", 2, 1e-3, "paper"),
    ("round box", "round box", 1, 1e-3, "paper"),
)


def attack(rng: np.random.Generator, folder: Path, count: int = POSES, witnesses: tuple[str, ...] = ()) -> Outcome:
    """Compare every witness at poses of one pair."""
    setting = int(rng.integers(len(SETTINGS)))
    name_a, name_b, gamma, length, normals = SETTINGS[setting]
    a, b = (paper.solids()[name] for name in (name_a, name_b))
    pose_a, pose_b = some_poses(rng, a, b, count)
    size = a.reach + b.reach + np.abs(pose_a[:, :3, 3]).max(1) + np.abs(pose_b[:, :3, 3]).max(1)
    value, gap = paper.distance(paper.separations(a, pose_a, b, pose_b, normals), gamma, length)
    low, high = exact(a, pose_a, b, pose_b)
    noise = 64 * ULP * size
    wrong: list[str] = []
    notes: dict[str, int] = {}

    def compare(word: str, found: Array, found_gap: Array | None) -> None:
        notes[f"poses of {word}"] = len(found)
        if not np.isfinite(found).all() or (found_gap is not None and not np.isfinite(found_gap).all()):
            wrong.append(f"{word}: not finite at pose {int(np.argmin(np.isfinite(found)))}")
            return
        doubtful = np.flatnonzero(np.abs(found - value) > _allowed(value, gap, noise, gamma))
        if len(doubtful):
            rows = doubtful[:50]
            true, true_gap = _wide(a, pose_a[rows], b, pose_b[rows], gamma, length, normals)
            off = np.abs(found[rows] - true) > _allowed(true, true_gap, noise[rows], gamma)
            if off.any():
                k = int(np.argmax(off))
                wrong.append(f"{word}: D {found[rows[k]]!r} at pose {rows[k]}, {float(true[k])!r} in 80 bits")
        if found_gap is not None:
            plain = (gap > 0.0) | (normals == "paper")  # below contact, longer axes bound more than this number
            off = np.flatnonzero(((np.abs(found_gap - gap) > noise) & plain) | ((found_gap > noise) != (gap > noise)))
            if len(off):
                wrong.append(f"{word}: D-tilde {found_gap[off[0]]!r} at pose {off[0]}, the judge {gap[off[0]]!r}")
            touching = np.flatnonzero((high < 0.0) & ((found_gap > 16 * ULP * size) | (found > 16 * ULP * size)))
            if len(touching):
                wrong.append(f"{word}: D-tilde {found_gap[touching[0]]!r} in contact, pose {touching[0]}")
            above = np.flatnonzero(found_gap > high + noise)
            if len(above):
                wrong.append(f"{word}: D-tilde {found_gap[above[0]]!r} beyond the distance {high[above[0]]!r}")

    for word, evaluate in WITNESSES.items():
        if not witnesses or word in witnesses:
            compare(word, *evaluate(setting, pose_a, pose_b))
    if not witnesses or "signed_distance" in witnesses:
        found = signed_distances(_body(a), pose_a, _body(b), pose_b)
        notes["poses of signed_distance"] = len(found)
        off = np.flatnonzero((found > high + EXACT * size) | (found < low - EXACT * size))
        if len(off):
            k = off[0]
            wrong.append(f"signed_distance: {found[k]!r} at pose {k}, the judge {low[k]!r} to {high[k]!r}")
    if not witnesses or "halfspaces" in witnesses:
        wrong += _halfspaces(a, b, gamma, length, pose_a, pose_b, rng, notes)
    wrong += _derivatives(rng, setting, a, b, pose_a, pose_b, size, witnesses, notes)
    if wrong:
        np.savez(folder / "poses.npz", pose_a=pose_a, pose_b=pose_b)
    words = "; ".join(wrong)[:600]
    return Outcome("pairs of poses", words and f"setting {SETTINGS[setting]}: {words}", count, notes)


def some_poses(rng: np.random.Generator, a: paper.Polytope, b: paper.Polytope, count: int) -> tuple[Array, Array]:
    """Return poses of both (count, 4, 4) each."""
    pose_a, pose_b = (np.tile(np.eye(4), (count, 1, 1)) for _ in range(2))
    for k in range(count):
        turned = _turned(rng) if rng.random() < 0.6 else _quarter(rng)
        kind = rng.random()
        other = _turned(rng) if kind < 0.4 else turned @ _quarter(rng)
        if 0.4 <= kind < 0.7:
            axis = rng.normal(size=3)
            other = turn(axis / np.linalg.norm(axis), np.array([10.0 ** rng.uniform(-15, -2)]))[0] @ other
        way = rng.normal(size=3) if rng.random() < 0.5 else (turned @ a.faces[rng.integers(len(a.faces))])
        way = way / np.linalg.norm(way)
        reach = (b.points @ other.T @ way).max() - (a.points @ turned.T @ way).min() + a.radius + b.radius
        gap = float(rng.choice([0.0, 1e-12, -1e-12, 1e-9, 1e-6, -1e-6, 1e-3, -1e-3, 0.02, -0.05, 0.3, -0.3, 2.0, 50.0]))
        place = rng.uniform(-1, 1, 3) if rng.random() < 0.5 else np.zeros(3)
        aside = np.cross(way, rng.normal(size=3)) * (rng.uniform(0, 0.5) if rng.random() < 0.5 else 0.0)
        pose_a[k, :3, :3], pose_b[k, :3, :3], pose_b[k, :3, 3] = turned, other, place
        pose_a[k, :3, 3] = place + (reach + gap) * way + aside
    return pose_a, pose_b


def _turned(rng: np.random.Generator) -> Array:
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(frame * np.sign(np.linalg.det(frame)))


def _quarter(rng: np.random.Generator) -> Array:
    """Return a turn of the axes into each other."""
    frame = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)[:, None]
    frame[0] *= np.sign(np.linalg.det(frame))
    return np.asarray(frame)


def exact(a: paper.Polytope, pose_a: Array, b: paper.Polytope, pose_b: Array) -> tuple[Array, Array]:
    """Return lower and upper bounds of the signed distances, by the judge's own means."""
    pieces = gjk.Pieces.of([(0, a.points, 0.0, 0.0, np.eye(3)), (1, b.points, 0.0, 0.0, np.eye(3))])
    first, second = np.zeros(len(pose_a), dtype=np.int64), np.ones(len(pose_a), dtype=np.int64)
    low, high = gjk.distances(pieces, first, pose_a, second, pose_b)
    deep = paper.depth(a, pose_a, b, pose_b)  # below 0: they overlap, by as much; else a lower bound
    low, high = np.where(deep < 0.0, deep, np.maximum(low, deep)), np.where(deep < 0.0, deep, high)
    near = np.abs(deep) < 1e-7  # the two ways differ by rounding
    low, high = np.where(near, np.minimum(low, -1e-7), low), np.where(near, np.maximum(high, 1e-7), high)
    return low - a.radius - b.radius, high - a.radius - b.radius


def _allowed(value: Array, gap: Array, noise: Array, gamma: int) -> Array:
    share = (gamma + 1) ** 2 * noise / np.maximum(np.abs(gap), 1e-300)
    return np.where(share < 0.5, share * np.abs(value), np.abs(value) + noise) + 1e-290


def _wide(
    a: paper.Polytope, pose_a: Any, b: paper.Polytope, pose_b: Any, gamma: int, length: float, normals: str
) -> Any:
    x = paper.separations(a, pose_a.astype(np.longdouble), b, pose_b.astype(np.longdouble), normals)
    return paper.distance(x, gamma, np.longdouble(length))


def _derivatives(
    rng: np.random.Generator,
    setting: int,
    a: paper.Polytope,
    b: paper.Polytope,
    pose_a: Array,
    pose_b: Array,
    size: Array,
    witnesses: tuple[str, ...],
    notes: dict[str, int],
) -> list[str]:
    """Compare slope and curvature along a twist with differences in 80 bits."""
    _, _, gamma, length, normals = SETTINGS[setting]
    rows = rng.choice(len(pose_a), min(TWISTS, len(pose_a)), replace=False)
    twist = rng.normal(size=(len(rows), 12))
    values = []
    for h in (-STEP, 0.0, STEP):
        moved = (paper.moved(pose[rows], own, h) for pose, own in ((pose_a, twist[:, :6]), (pose_b, twist[:, 6:])))
        values.append(_wide(a, next(moved), b, next(moved), gamma, length, normals)[0])
    slope = ((values[2] - values[0]) / (2 * STEP)).astype(float)
    bend = ((values[2] - 2 * values[1] + values[0]) / STEP**2).astype(float)
    wrong = []
    for word, evaluate in DERIVATIVES.items():
        if witnesses and word not in witnesses:
            continue
        found_slope, found_bend = evaluate(setting, pose_a[rows], pose_b[rows], twist)
        notes[f"twists of {word}"] = len(rows)
        grown = 1.0 + size[rows]
        off = np.abs(found_slope - slope) > 1e-4 * grown * (1.0 + np.abs(slope)) + 10 * STEP * np.abs(bend)
        if off.any() or not np.isfinite(found_slope).all():
            k = int(np.argmax(off))
            wrong.append(f"{word}: slope {found_slope[k]:.9g} at pose {rows[k]}, by differences {slope[k]:.9g}")
        if gamma > 1 and found_bend is not None:
            off = np.abs(found_bend - bend) > 2e-2 * (grown**2 + np.abs(bend))
            if off.any() or not np.isfinite(found_bend).all():
                k = int(np.argmax(off))
                wrong.append(f"{word}: curvature {found_bend[k]:.9g} at pose {rows[k]}, by differences {bend[k]:.9g}")
    return wrong


# --- hdplan's side ----------------------------------------------------------------------------------------------------


@functools.cache
def _bodies(setting: int) -> tuple[Any, Any, dict[str, Any]]:
    name_a, name_b, gamma, length, normals = SETTINGS[setting]
    solids = paper.solids()
    keywords = {"gamma": gamma, "shaping_length": length, "normals": normals}
    return _body(solids[name_a]), _body(solids[name_b]), keywords


def _body(solid: paper.Polytope) -> Any:
    return library.ConvexBody.from_points(solid.points, solid.radius)


def _reference(setting: int, pose_a: Array, pose_b: Array) -> tuple[Array, Array | None]:
    a, b, keywords = _bodies(setting)
    value = library.hdsdf(a, pose_a, b, pose_b, **keywords)
    return value, library.separation(a, pose_a, b, pose_b, normals=keywords["normals"])


@functools.cache
def _compiled(setting: int) -> Any:
    a, b, keywords = _bodies(setting)
    return library.hdsdf_compiled(a, b, **keywords)


@functools.cache
def _jax(setting: int) -> Any:
    a, b, keywords = _bodies(setting)
    return library.hdsdf_batch(a, b, **keywords)


@functools.cache
def _function(setting: int) -> tuple[Any, Any]:
    """Return the CasADi function, and value, slope and curvature along a twist, by its own derivatives."""
    a, b, keywords = _bodies(setting)
    function = library.hdsdf_function(a, b, **keywords)
    pose_a, pose_b, twist, t = ca.MX.sym("a", 4, 4), ca.MX.sym("b", 4, 4), ca.MX.sym("xi", 12), ca.MX.sym("t")

    def after(pose: Any, v: Any) -> Any:
        x = ca.vertcat(ca.horzcat(ca.skew(v[3:]), v[:3]), ca.MX.zeros(1, 4)) * t
        return pose @ (ca.MX.eye(4) + x + x @ x / 2 + x @ x @ x / 6)

    value = function(after(pose_a, twist[:6]), after(pose_b, twist[6:]))
    slope = ca.gradient(value, t)
    bend = ca.gradient(slope, t)
    return function, ca.Function("along", [pose_a, pose_b, twist, t], [slope, bend])


def _through_casadi(setting: int, pose_a: Array, pose_b: Array) -> tuple[Array, Array | None]:
    function, _ = _function(setting)
    flat = [np.concatenate(list(pose), axis=1) for pose in (pose_a, pose_b)]
    return np.asarray(function(*flat)).ravel(), None


def _casadi_along(setting: int, pose_a: Array, pose_b: Array, twist: Array) -> tuple[Array, Array | None]:
    _, along = _function(setting)
    found = [along(x, y, xi, 0.0) for x, y, xi in zip(pose_a, pose_b, twist, strict=True)]
    return np.array([float(slope) for slope, _ in found]), np.array([float(bend) for _, bend in found])


def _reference_along(setting: int, pose_a: Array, pose_b: Array, twist: Array) -> tuple[Array, Array | None]:
    a, b, keywords = _bodies(setting)
    found = library.hdsdf_derivatives(a, pose_a, b, pose_b, **keywords)
    return _along((found.gradient, found.hessian), twist)


def _along(derivatives: Sequence[Any], twist: Array) -> tuple[Array, Array]:
    gradient, hessian = map(np.asarray, derivatives)
    return np.einsum("ni,ni->n", gradient, twist), np.einsum("nij,ni,nj->n", hessian, twist, twist)


def _halfspaces(
    a: paper.Polytope, b: paper.Polytope, gamma: int, length: float, pose_a: Array, pose_b: Array, rng: Any, notes: Any
) -> list[str]:
    """Compare the planner's distance: B by 26 planes with exact supports, A standing and swept."""
    ways = np.array([w for w in np.ndindex(3, 3, 3) if w != (1, 1, 1)]) - 1.0
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    levels = (b.points @ ways.T).max(axis=0) + b.radius
    points = len(a.points)
    body = np.concatenate([a.points.ravel(), np.ones(points), [a.radius]])
    planes = np.concatenate([ways.ravel(), levels])
    shifted = pose_a.copy()
    shifted[:, :3, 3] += rng.normal(size=(len(pose_a), 3)) * 0.05
    flat = [
        np.concatenate([pose[:, :3, :3].reshape(-1, 9), pose[:, :3, 3]], axis=1).T for pose in (pose_a, shifted, pose_b)
    ]
    wrong = []
    for word, function, inputs, places in (
        ("halfspaces", halfspace_distance, [flat[0], flat[2]], [pose_a]),
        ("swept halfspaces", swept_halfspace_distance, flat, [pose_a, shifted]),
    ):
        found = np.asarray(function(points, 26, gamma, length)(*inputs, ca.DM(body), ca.DM(planes))[0]).ravel()
        corners = [
            np.einsum("nij,mj->nmi", pose[:, :3, :3], a.points) + (pose[:, :3, 3] - pose_b[:, :3, 3])[:, None]
            for pose in places
        ]
        local = np.einsum("nij,nmi->nmj", pose_b[:, :3, :3], np.concatenate(corners, axis=1))
        x = np.einsum("ki,nmi->nkm", ways, local) - a.radius - levels[:, None]
        true, gap = paper.distance(x, gamma, length)
        size = a.reach + b.reach + np.abs(pose_a[:, :3, 3]).max(1) + np.abs(pose_b[:, :3, 3]).max(1)
        off = np.flatnonzero(~(np.abs(found - true) <= _allowed(true, gap, 256 * ULP * size, gamma)))
        notes[f"poses of {word}"] = len(found)
        if len(off):
            wrong.append(f"{word}: D {found[off[0]]!r} at pose {off[0]}, the judge {true[off[0]]!r}")
    return wrong


Evaluate = Callable[[int, Array, Array], tuple[Array, Array | None]]
Along = Callable[[int, Array, Array, Array], tuple[Array, Array | None]]

WITNESSES: dict[str, Evaluate] = {
    "reference": _reference,
    "compiled": lambda setting, *poses: _compiled(setting).value(*poses),
    "jax": lambda setting, *poses: tuple(np.asarray(part) for part in _jax(setting).value(*poses)),
    "function": _through_casadi,
}
DERIVATIVES: dict[str, Along] = {
    "reference": _reference_along,
    "compiled": lambda setting, x, y, twist: _along(_compiled(setting).hessian(x, y)[2:], twist),
    "jax": lambda setting, x, y, twist: _along(_jax(setting).hessian(x, y)[2:], twist),
    "function": _casadi_along,
}
