"""The HD-SDF as in the paper, to any number of digits: the truth for small pairs.

Literal powers and plain loops in mpmath; derivatives by central differences, which lose nothing that matters at 120
digits. Shares only the bodies and their candidate normals with the library.
"""

from __future__ import annotations

from typing import NamedTuple

import mpmath as mp
import numpy as np

from hdplan.distance.normals import candidate_normals
from hdplan.distance.unions import pieces_of


class Truth(NamedTuple):
    """D and D-tilde at a pose, and D's first and second derivative along one twist of both bodies."""

    value: float
    separation: float
    slope: float
    curvature: float


def truth(body_a, pose_a, body_b, pose_b, twist, *, digits=120, **settings) -> Truth:
    """Return the truth along ``twist`` (12,) = [v_a, w_a, v_b, w_b], each in its body's own frame."""
    with mp.workdps(digits):
        step = mp.mpf(10) ** -(digits // 3)
        before, here, after = (
            hdsdf(body_a, _moved(pose_a, twist[:6], h), body_b, _moved(pose_b, twist[6:], h), **settings)
            for h in (-step, mp.mpf(0), step)
        )
        slope = (after[0] - before[0]) / (2 * step)
        return Truth(*map(float, (*here, slope, (after[0] - 2 * here[0] + before[0]) / step**2)))


def swept_truth(
    body, first, second, normals, supports, pose_b, twists, *, digits=120, gamma=2, shaping_length
) -> Truth:
    """Return the same of the planner's distance of a body, swept between two poses, to the planes (n, h) of B.

    ``twists`` (2, 6): motions [v, w] of the world that move the body at either pose; ``second`` may be None.
    """
    with mp.workdps(digits):
        step = mp.mpf(10) ** -(digits // 3)
        found = []
        for h in (-step, mp.mpf(0), step):
            poses = [_moved_by_the_world(first, twists[0], h)]
            if second is not None:
                poses.append(_moved_by_the_world(second, twists[1], h))
            points = [point for pose in poses for point in _placed(pose, body.vertices)]
            origin, shaped, least = [mp.mpf(float(row[3])) for row in pose_b[:3]], [], []
            for normal, support in zip(normals, supports, strict=True):
                n = _turned([[mp.mpf(float(x)) for x in row] for row in pose_b[:3]], normal)
                x = [_dot(n, _minus(point, origin)) - mp.mpf(body.radius) - mp.mpf(float(support)) for point in points]
                shaped.append(_shaping(_minimum(x, [1] * len(x), gamma), gamma, shaping_length))
                least.append(min(x))
            value = _shaping(-_minimum([-g for g in shaped], [1] * len(shaped), gamma), gamma, shaping_length)
            found.append((value, max(least)))
        before, here, after = found
        slope = (after[0] - before[0]) / (2 * step)
        return Truth(*map(float, (*here, slope, (after[0] - 2 * here[0] + before[0]) / step**2)))


def hdsdf(body_a, pose_a, body_b, pose_b, *, gamma=2, **settings):
    """Return D and D-tilde of two bodies or unions at poses as rows of numbers, in the digits of the context."""
    found = [
        _of_pair(a, pose_a, b, pose_b, gamma=gamma, **settings) for a in pieces_of(body_a) for b in pieces_of(body_b)
    ]
    values, separations = zip(*found, strict=True)
    return values[0] if len(values) == 1 else _minimum(values, [1] * len(values), gamma), min(separations)


def _of_pair(body_a, pose_a, body_b, pose_b, *, gamma, shaping_length=1e-3, normals="paper", witnesses=()):
    radii = mp.mpf(body_a.radius) + mp.mpf(body_b.radius)
    corners_a, corners_b = _placed(pose_a, body_a.vertices), _placed(pose_b, body_b.vertices)
    shaped, counts, least = [], [], []
    for w, fade, count, unit in _axes(candidate_normals(normals, body_a, body_b), pose_a, pose_b, witnesses):
        along_a, along_b = [_dot(w, a) for a in corners_a], [_dot(w, b) for b in corners_b]
        for sign in (1, -1):
            x = [sign * (a - b) - radii - fade for a in along_a for b in along_b]
            shaped.append(_shaping(_minimum(x, [1] * len(x), gamma), gamma, shaping_length))
            counts.append(int(count))
            least.append(_bound(min(sign * (a - b) for a in along_a for b in along_b), w, radii + fade, unit))
    return _shaping(-_minimum([-g for g in shaped], counts, gamma), gamma, shaping_length), max(least)


def _axes(normals, pose_a, pose_b, witnesses):
    """Yield every axis in the world, what it is faded by, how often it counts, and whether it is a unit vector."""
    for pose, directions, counts in (
        (pose_a, normals.in_a, normals.counts_a),
        (pose_b, normals.in_b, normals.counts_b),
        (pose_b, witnesses, np.ones(len(witnesses))),
    ):
        for direction, count in zip(directions, counts, strict=True):
            yield _turned(pose, direction), mp.mpf(0), count, True
    if (centre := normals.centre) is not None:
        t = _minus(_placed(pose_a, [centre.point_a])[0], _placed(pose_b, [centre.point_b])[0])
        yield _over(t, mp.sqrt(_dot(t, t) + mp.mpf(centre.softness) ** 2)), mp.mpf(0), 1, False
    if (edges := normals.edges) is not None:
        soft = mp.mpf(edges.sine) ** 2
        for u in (_turned(pose_a, edge) for edge in edges.along_a):
            for v in (_turned(pose_b, edge) for edge in edges.along_b):
                w = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
                square = _dot(w, w)
                fade = mp.mpf(edges.fade) * soft * (1 - square) / (square + soft)
                yield _over(w, mp.sqrt(square + soft)), fade, 1, False


def _bound(least, w, drop, unit):
    """Return what an axis says of the signed distance, from the least w·(a - b): see ``normals``."""
    if unit or least > 0:
        return least - drop
    square = _dot(w, w)
    return least / square - drop if square > 0 else mp.mpf("-inf")


def _minimum(x, counts, gamma):
    """Return the Hölder minimum (paper: Lemma A.1)."""
    p, least = gamma + 1, min(x)
    if least > 0:
        return sum(n * value**-p for value, n in zip(x, counts, strict=True)) ** (mp.mpf(-1) / p)
    return -(
        (sum((n * (-value) ** p for value, n in zip(x, counts, strict=True) if value < 0), mp.mpf(0)))
        ** (mp.mpf(1) / p)
    )


def _shaping(u, gamma, length):
    return u * abs(u) ** gamma / (abs(u) ** gamma + mp.mpf(length) ** gamma)


def _moved(pose, twist, h):
    """Return pose·exp(h ξ) to the second order in h, as rows of numbers."""
    return (mp.matrix(np.asarray(pose).tolist()) * _motion(twist, h)).tolist()


def _moved_by_the_world(pose, twist, h):
    """Return exp(h ξ)·pose likewise."""
    return (_motion(twist, h) * mp.matrix(np.asarray(pose).tolist())).tolist()


def _motion(twist, h):
    (x, y, z), (a, b, c) = (list(map(mp.mpf, map(float, part))) for part in (twist[:3], twist[3:]))
    xi = mp.matrix([[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z], [0, 0, 0, 0]])
    return mp.eye(4) + h * xi + h**2 * xi * xi / 2


def _placed(pose, points):
    return [[_dot(row[:3], point) + row[3] for row in pose[:3]] for point in points]


def _turned(pose, direction):
    return [_dot(row[:3], direction) for row in pose[:3]]


def _dot(a, b):
    return sum(x * (y if isinstance(y, mp.mpf) else float(y)) for x, y in zip(a, b, strict=True))


def _minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def _over(a, divisor):
    return [x / divisor for x in a]
