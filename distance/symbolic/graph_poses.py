"""Poses in CasADi graphs: the relative pose, and NaN for poses that are not rigid.

A graph cannot raise an error, as ``poses`` does for arrays; so its results at such a pose are NaN.
"""

from __future__ import annotations

import functools
import math

import casadi as ca

from hdplan.distance.poses import RIGID_ERROR


def relative_pose(pose_a: ca.MX, pose_b: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return rotation (3, 3) and position (3) of B in A's frame; the positions are subtracted first."""
    turned = pose_a[:3, :3].T
    return turned @ pose_b[:3, :3], turned @ (pose_b[:3, 3] - pose_a[:3, 3])


def rigid_or_nan(*matrices: ca.MX) -> ca.MX:
    """Return 0 where all are rotations (3, 3) or rigid transforms (4, 4), including the last row, to ``poses.RIGID``,
    else NaN: to be added to results."""
    return _mark(tuple(matrix.shape[0] for matrix in matrices))(*matrices)


@functools.cache
def _mark(sizes: tuple[int, ...]) -> ca.Function:
    matrices = [ca.SX.sym("matrix", size, size) for size in sizes]
    amiss = ca.SX(0)  # one sum of squares is the cheapest test
    for matrix in matrices:
        x, y, z = ca.horzsplit(matrix[:3, :3])
        amiss += (ca.dot(x, x) - 1) ** 2 + (ca.dot(y, y) - 1) ** 2 + ca.dot(x, y) ** 2
        amiss += ca.sumsqr(ca.cross(x, y) - z)  # right-handed
        if matrix.shape[0] == 4:  # a transposed pose has a rotation too
            amiss += ca.sumsqr(matrix[3, :] - ca.DM([[0, 0, 0, 1]]))
    return ca.Function("rigid_or_nan", matrices, [ca.if_else(amiss <= RIGID_ERROR**2, 0, math.nan)])
