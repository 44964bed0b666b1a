"""Poses in CasADi graphs: the relative one, and a mark for those that are not rigid.

A graph cannot refuse a number with a word, as ``poses`` does for arrays; so what it reads at such a pose is NaN.
"""

from __future__ import annotations

import math

import casadi as ca

from hdplan.distance.poses import RIGID


def relative_pose(pose_a: ca.MX, pose_b: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return rotation (3, 3) and position (3) of B in A's frame; the positions are subtracted first."""
    turned = pose_a[:3, :3].T
    return turned @ pose_b[:3, :3], turned @ (pose_b[:3, 3] - pose_a[:3, 3])


def rigid_or_nan(*rotations: ca.MX) -> ca.MX:
    """Return 0 where all are rotations (3, 3), to ``poses.RIGID``, else NaN: a summand of what they lead to."""
    marks = [_mark()(rotation) for rotation in rotations]
    return ca.sum1(ca.vertcat(*marks))


def _mark() -> ca.Function:
    rotation = ca.SX.sym("rotation", 3, 3)
    x, y, z = ca.horzsplit(rotation)
    misses = [ca.fabs(ca.dot(axis, axis) - 1) for axis in (x, y, z)]
    misses += [ca.fabs(part) for part in ca.vertsplit(ca.cross(x, y) - z)]  # right-handed
    rigid = misses[0] <= RIGID
    for miss in misses[1:]:
        rigid = ca.logic_and(rigid, miss <= RIGID)
    return ca.Function("rigid_or_nan", [rotation], [ca.if_else(rigid, 0, math.nan)])
