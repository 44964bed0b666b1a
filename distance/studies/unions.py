"""What unions cost: how conservative the HD-SDF of a body is, and how long it takes, cut into more and more pieces.

Two bodies are cut into 1 to 32 hulls beside each other. A box is the same however it is cut, so what it loses is lost
by the Hölder minimum; a ring is enclosed the better, the more hulls there are. Both are held against the exact distance
of the finest cut.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.studies.stopwatch import seconds_per_query
from hdplan.distance.studies.study_poses import Poses, study_poses
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled
from hdplan.distance.unions import BodyUnion
from hdplan.scenes.array_types import Array

BODIES = ("box", "ring")
PIECES = (1, 2, 4, 8, 16, 32)
GAMMA, SHAPING_LENGTH, NORMALS = 2, 1e-3, "paper+edges"
GAPS = (1e-3, 1e-2, 1e-1)  # [m] at which false positives are counted
NEAR_GAP = 0.05  # [m] gap up to which a pose is near contact
RANDOM, CLOSE = 8192, 4096  # poses drawn at random, and moved close to contact
BLOCK = 2048  # poses at once
ORDERS = ("value", "gradient", "hessian")


@dataclass(frozen=True)
class Cut:
    """What a body cut into some pieces gives."""

    body: str
    pieces: int
    false_positives: Mapping[float, float]  # per gap: part of the random poses with d >= gap where D <= 0
    missed: int  # poses where D > 0 in contact: none
    ratio: float  # median of D/d beyond NEAR_GAP
    near_error: float  # [m] median of d - D for gaps up to NEAR_GAP
    seconds: Mapping[str, float]  # per query, by order


def cut_bodies() -> Mapping[str, tuple[Array, ...]]:
    """Return the corners of the pieces of the finest cut by name: a box in slices, and a ring with a square section."""
    edges = np.linspace(-0.3, 0.3, PIECES[-1] + 1)
    slices = tuple(
        np.array([[x, y, z] for x in pair for y in (-0.15, 0.15) for z in (-0.1, 0.1)]) for pair in pairwise(edges)
    )
    angles = np.linspace(0.0, 2.0 * np.pi, PIECES[-1] + 1)
    ring = tuple(
        np.array([[r * np.cos(a), r * np.sin(a), z] for a in pair for r in (0.22, 0.3) for z in (-0.04, 0.04)])
        for pair in pairwise(angles)
    )
    return {"box": slices, "ring": ring}


def cut(finest: tuple[Array, ...], pieces: int) -> BodyUnion:
    """Return the hulls of equally many neighbours each of the finest cut."""
    return ConvexBody.union(
        ConvexBody.from_points(points.reshape(-1, 3)) for points in np.split(np.array(finest), pieces)
    )


def study_unions(
    *,
    random: int = RANDOM,
    close: int = CLOSE,
    bodies: tuple[str, ...] = BODIES,
    pieces: tuple[int, ...] = PIECES,
    orders: tuple[str, ...] = ORDERS,
    seed: int = 0,
    report: Callable[[int, int, str], None] = lambda done, of, what: None,
    stop: Callable[[], bool] = lambda: False,
) -> list[Cut]:
    """Measure every cut of both bodies against a box, as ``accuracy.study`` does its settings."""
    other = ConvexBody.box([0.3, 0.2, 0.15])
    found: list[Cut] = []
    for name in bodies:
        finest = cut_bodies()[name]
        poses = study_poses(cut(finest, len(finest)), other, random, close, np.random.default_rng(seed))
        for count in pieces:
            report(len(found), len(bodies) * len(pieces), f"{name}, {count} pieces")
            measured = _measured(name, cut(finest, count), other, poses, orders)
            if stop():
                return found
            found.append(measured)
    report(len(found), len(found), "")
    return found


def _measured(name: str, body: BodyUnion, other: ConvexBody, poses: Poses, orders: tuple[str, ...]) -> Cut:
    distance = hdsdf_compiled(body, other, gamma=GAMMA, shaping_length=SHAPING_LENGTH, normals=NORMALS)
    value, _ = distance.value(poses.poses_a, poses.poses_b)
    exact, drawn = poses.distances, slice(poses.drawn)
    far, near = exact > NEAR_GAP, (exact > 0) & (exact <= NEAR_GAP)
    block = poses.of(slice(max(poses.drawn - BLOCK // 2, 0), poses.drawn + BLOCK // 2))  # half of them near contact

    def rate(gap: float) -> float:
        apart = exact[drawn] >= gap
        return float(np.sum(apart & (value[drawn] <= 0)) / max(int(apart.sum()), 1))

    return Cut(
        name,
        len(body.pieces),
        {gap: rate(gap) for gap in GAPS},
        int(np.sum((value > 0) & (exact <= 0))),
        float(np.median(value[far] / exact[far])),
        float(np.median(exact[near] - value[near])),
        {order: seconds_per_query(partial(getattr(distance, order), *block), len(block[0])) for order in orders},
    )
