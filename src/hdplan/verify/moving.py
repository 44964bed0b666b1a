"""Obstacles that move, as a world has them: a chain of joints that follow the time.

Three slide along the world's axes, and every turn from one pose to the next has one of its own, the last turn first:
what was turned before is turned on by it.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from .balls import CROSS, Ball, Pose, cos_sin, dot, need, norm, stack, unit, up

LEAST_TURN = 1e-9  # from one pose to the next; what turns less has a rotation that is off by as much
NEARLY_HALF = 7e-5  # [rad] by which a turn must be less than half a turn


def joints_of(motion: dict[str, Any], rows: Any, name: str) -> tuple[list[Any], Pose]:
    """The joints that carry an obstacle, numbered from 0, and its frame in that of the last one. `motion`: its poses at
    `times`, or its pose at time 0, `velocity` and `spin`; `rows`: the times of the robot's motion."""
    need(rows, f"{name}: moves, and the motion has no times")
    if "times" in motion:
        times, poses = motion["times"], motion["poses"]
        need(len(poses) == len(times) > 1 and min(np.diff(times)) > 0, f"{name}: motion: times must increase")
        found = [turn_between(a[0], b[0], name) for a, b in itertools.pairwise(poses)]
        still = sum(float(over) for _, over in found)
        turns = [(way, times[i : i + 2], [0.0, 1.0]) for i, (way, _) in enumerate(found) if way is not None]
        places, first = stack([at for _, at in poses]), poses[0][0]
        first = Ball(first.mid, up(first.rad + still))
    else:
        times, (first, at) = [rows[0], rows[-1]], motion["pose"]
        places = stack([at + Ball(motion["velocity"]) * x for x in times])
        turns = [(Ball(motion["spin"]), times, times)] if any(motion["spin"]) else []
    ways: list[Any] = [("prismatic", Ball(np.eye(3)[i]), times, places[:, i]) for i in range(3)]
    ways += [("revolute", way, span, Ball(values)) for way, span, values in reversed(turns)]
    joints = []
    for i, (kind, way, span, values) in enumerate(ways):
        off = float(max(way.rad.max(), values.rad.max()))
        law = {"way": way.mid.tolist(), "times": span, "values": values.mid.tolist(), "off": off}
        joints.append({"name": name, "parent": i - 1, "kind": kind, **law})
    return joints, (first, Ball(np.zeros(3)))


def turn_between(one: Ball, two: Ball, name: str) -> tuple[Ball | None, float]:
    """The turn from a rotation to another one, as axis times angle; None for hardly any, with a bound of what it does
    to a rotation's numbers."""
    change = dot("ij,kj->ik", two, one)
    over = change - np.eye(3)  # of length 2 sqrt(2) sin(angle / 2): above the angle
    if norm(np.abs(over.mid).ravel()) <= LEAST_TURN:
        return None, float(norm(over.size.ravel()))
    return turn_of(change, name), 0.0


def turn_of(matrix: Ball, name: str) -> Ball:
    """Axis times angle of a rotation M that is not near a half turn. M - M^T is 2 sin(angle) times the cross product's
    matrix of the axis, and its trace 1 + 2 cos(angle). With w near the angle, e = sin(angle) cos w - cos(angle) sin w
    is sin(angle - w), so that |angle - w| <= 1.01 |e| where |e| <= 0.1. A direction v off by r is off by at most
    2 r / |v| once it has length 1."""
    v = dot("ijk,ij->k", CROSS, matrix) * 0.5
    m = float(np.sqrt((v.mid * v.mid).sum()))
    cos = (dot("ij,ij->", np.eye(3), matrix) - 1.0) * 0.5
    r = norm(v.rad)
    w = float(np.arctan2(m, cos.mid))
    one, two = cos_sin(w)
    e, near = (Ball(m, r) * one - cos * two).size, (cos * one + Ball(m, r) * two).mid > 0.9
    far = cos.mid > 0 or m > NEARLY_HALF  # nearer to half a turn the axis is hardly known
    need(far and m > 1e3 * r and e < 0.1 and near, f"{name}: turns by half a turn, or by less than its numbers are off")
    axis = unit(v.mid / m)
    return Ball(axis.mid, up(axis.rad + 2 * r / m)) * Ball(w, up(1.01 * e))
