"""Rates of joint torques along a curve: rigorous bounds on τ̈ over an interval of time.

Between two samples of a motion, h apart, a torque lies within h²/8 max|τ̈| of the straight line between its values
there (the error of linear interpolation). The bound on |τ̈| comes from the recursive Newton-Euler algorithm (R.
Featherstone, "Rigid body dynamics algorithms", 2008, table 5.1), with every vector and rotation replaced by bounds on
its norm and on the norms of its first two time derivatives, in the joint's own axes:

    |x y| ≤ |x||y|,   |(x y)˙| ≤ |ẋ||y| + |x||ẏ|,   |(x y)¨| ≤ |ẍ||y| + 2|ẋ||ẏ| + |x||ÿ|

for any product (of numbers, cross product, matrix and vector). The motion of a joint enters by bounds on |q̇| … |q⁗|.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hdplan.planner.motion.motion_bounds import Chain
from hdplan.scenes.array_types import Array


def torque_curvature(model: pin.Model, chain: Chain, rates: Array) -> Array:
    """Return bounds on |τ̈| (k, n) [Nm/s² or N/s²] over k intervals of time.

    Args:
        model: with all loads; fixed base, joints with one coordinate each.
        chain: its joints.
        rates: bounds (5, k, n) on |q|, |q̇|, |q̈|, |q⃛| and |q⁗| over each interval; |q| for prismatic joints only.
    """
    count = rates.shape[1]
    none = np.zeros((3, count))

    def constant(value: float) -> Array:
        return np.stack([np.full(count, value), none[1], none[2]])

    spin, spun, pushed = [none], [none], [constant(float(np.linalg.norm(model.gravity.linear)))]  # ω, ω̇, acceleration
    turns, levers = [none], [none]
    for index in range(1, model.njoints):
        parent, joint, lever = int(model.parents[index]), index - 1, float(np.linalg.norm(_offset(model, index)))
        angle, rate, push, jerk, snap = rates[:, :, joint]
        speed, thrust = np.stack([rate, push, jerk]), np.stack([push, jerk, snap])
        around = _product(spin[parent], spin[parent]) + spun[parent]
        if chain.revolute[joint]:
            turn, offset = np.stack([np.ones(count), rate, push + rate**2]), constant(lever)
            spin.append(_product(turn, spin[parent]) + speed)
            spun.append(_product(turn, spun[parent]) + thrust + _product(_product(turn, spin[parent]), speed))
            pushed.append(_product(turn, pushed[parent] + _product(around, offset)))
        else:
            turn, offset = constant(1.0), np.stack([lever + angle, rate, push])
            spin.append(spin[parent])
            spun.append(spun[parent])
            sliding = thrust + 2 * _product(spin[parent], speed)
            pushed.append(pushed[parent] + _product(around, offset) + sliding)
        turns.append(turn)
        levers.append(offset)

    forces, moments = [none], [none]
    for index in range(1, model.njoints):
        body = model.inertias[index]
        centre, about = float(np.linalg.norm(body.lever)), float(np.linalg.norm(body.inertia, 2))
        around = _product(spin[index], spin[index]) + spun[index]
        force = float(body.mass) * (pushed[index] + centre * around)
        forces.append(force)
        moments.append(about * around + centre * force)
    result = np.zeros((count, model.njoints - 1))
    for index in range(model.njoints - 1, 0, -1):
        parent, joint = int(model.parents[index]), index - 1
        held = moments[index] if chain.revolute[joint] else forces[index]
        result[:, joint] = held[2] + float(model.armature[joint]) * rates[4, :, joint]
        force = _product(turns[index], forces[index])
        forces[parent] = forces[parent] + force
        moments[parent] = moments[parent] + _product(turns[index], moments[index]) + _product(levers[index], force)
    return result


def _product(x: Array, y: Array) -> Array:
    """Bound a product and its first two derivatives: (3, k) each."""
    return np.stack([x[0] * y[0], x[1] * y[0] + x[0] * y[1], x[2] * y[0] + 2 * x[1] * y[1] + x[0] * y[2]])


def _offset(model: pin.Model, index: int) -> Array:
    return np.asarray(model.jointPlacements[index].translation, dtype=np.float64)
