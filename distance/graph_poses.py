"""Poses in CasADi graphs: the relative one, and a mark for those that are not rigid.

A graph cannot refuse a number with a word, as ``poses`` does for arrays; so what it reads at such a pose is NaN.
"""

from __future__ import annotations

import functools
import math

import casadi as ca

from hdplan.distance.poses import RIGID


def relative_pose(pose_a: ca.MX, pose_b: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return rotation (3, 3) and position (3) of B in A's frame; the positions are subtracted first."""
    turned = pose_a[:3, :3].T
    return turned @ pose_b[:3, :3], turned @ (pose_b[:3, 3] - pose_a[:3, 3])


def rigid_or_nan(*rotations: ca.MX) -> ca.MX:
    """Return 0 where all are rotations (3, 3), to ``poses.RIGID``, else NaN: a summand of what they lead to."""
    return _mark(len(rotations))(*rotations)


@functools.cache
def _mark(count: int) -> ca.Function:
    rotations = [ca.SX.sym("rotation", 3, 3) for _ in range(count)]
    amiss = ca.SX(0)  # the sum of squares is the cheapest to ask once
    for rotation in rotations:
        x, y, z = ca.horzsplit(rotation)
        amiss += (ca.dot(x, x) - 1) ** 2 + (ca.dot(y, y) - 1) ** 2 + ca.dot(x, y) ** 2
        amiss += ca.sumsqr(ca.cross(x, y) - z)  # right-handed
    return ca.Function("rigid_or_nan", rotations, [ca.if_else(amiss <= RIGID**2, 0, math.nan)])
