"""Rounding errors: the scenes and motions for which ROUNDING covers them all.

Every bound of the certificate is computed in double precision, with unit roundoff u = 2⁻⁵³, and has ROUNDING
subtracted. To first order in u, the computed position of a body's point differs from the one that the numbers of scene
and file define by at most

    u [ 64 (k + 1) M  +  64 Σ_j ρ_j Q_j  +  16 M Σ_j |δ_j|  +  16 S T ]

*Placement.* M [m] is the greatest coordinate: the sum of the offsets of the k joints that carry the body, of their
prismatic travel, and of the body's own placement and reach, or of the way of a moving obstacle. Each of these k + 1
rigid transforms costs 4u for an entry of the rotation (sine, cosine, two products) and 3u for each sum of three
products, in three coordinates: less than 16u M. Evaluating a support there, for both ends of the interval, and
subtracting two numbers makes that four times as much.
*Joints.* Q_j is the greatest |control point| of joint j. A part of the curve and its middle are computed by three
passes of de Casteljau's algorithm over at most five levels, with two roundings each, and two more for δ_j and ε_j:
32u Q_j, twice. The body is ρ_j away from the joint's axis (`motion_bounds`).
*Motion.* The second-order bound multiplies angles |δ_j|, half of the motion on an interval, by coordinates: cross
products of them, and their sum, at 16u of that.
*Time.* T [s] is the greatest |time| of a row or of an obstacle's motion, S [m/s] the greatest speed of a point of a
moving obstacle. The middle of an interval in time has an error of 3u T, the time since the last pose another 3u T; the
rotation angle and the travel have relative errors of 2u and are at most S T.

Each of the four may use a quarter of ROUNDING; a scene or a motion that needs more is refused by name, and so is
everything that is not a number. (Panda and its shipped scenes need less than a hundredth.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdplan.planner.certificate.intervals import Bodies
from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

ROUNDING = 1e-9  # [m] subtracted from every bound
MOST_TERM = 0.25 * ROUNDING / 2.0**-53  # [m] greatest value of each of the four terms, times u
PLACING, JOINTS, MOTION, TIME = 64.0, 64.0, 16.0, 16.0  # their factors


def refuse_far_bodies(bodies: Bodies, fields: Sequence[str]) -> None:
    """Raise InputError for a body so far away that rounding errors may exceed ROUNDING, with all joints at 0 at time 0.

    fields: the name of each body in messages.
    """
    with np.errstate(over="ignore"):
        _refuse_far(bodies, fields, np.zeros(len(bodies.chain.axes)), 0.0)


def refuse_large_motion(bodies: Bodies, fields: Sequence[str], curve: Curve, joint_names: Sequence[str]) -> None:
    """Raise InputError for a motion whose numbers are so large that rounding errors may exceed ROUNDING."""
    largest = np.abs(curve.control).max(axis=(0, 1))  # (n,) Q
    latest = 0.0 if curve.times is None else float(np.abs(curve.times).max())  # [s]
    with np.errstate(over="ignore"):
        _refuse_late(bodies, fields, latest)
        coordinates = _refuse_far(bodies, fields, largest, latest)
    costs = JOINTS * bodies.reach(curve).max(axis=0, initial=0.0) * largest
    if not costs.sum() <= MOST_TERM:
        joint = int(costs.argmax())
        allowed = largest[joint] * MOST_TERM / costs.sum()
        row = int(np.abs(curve.control[:, :, joint]).max(axis=1).argmax())
        raise InputError(
            f"trajectory: after waypoint {row}, joint '{joint_names[joint]}' is at {largest[joint]:g}, where the place "
            f"of what it moves is lost in rounding; at most {allowed:.3g} is allowed"
        )
    step = 0.5 * np.abs(np.diff(curve.control, axis=1)).sum(axis=1).max(axis=0)  # (n,) upper bound of |δ|
    reach = coordinates[bodies.joint > 0].max(initial=0.0)
    if not MOTION * reach * (step * bodies.chain.revolute).sum() <= MOST_TERM:
        joint = int((step * bodies.chain.revolute).argmax())
        raise InputError(
            f"trajectory: joint '{joint_names[joint]}' turns by {2 * step[joint]:g} rad between two waypoints, up to "
            f"{reach:g} m from the world's origin: too much for a proof; use more waypoints"
        )


def _refuse_late(bodies: Bodies, fields: Sequence[str], latest: float) -> None:
    """Refuse times at which the place of a moving obstacle is lost in rounding."""
    for g in np.flatnonzero(bodies.drifting).tolist():
        speed, anchored = bodies.speed(g), bodies.latest(g)
        time = max(latest, anchored)
        if not TIME * speed * time <= MOST_TERM:
            where = "trajectory: times" if latest >= anchored else fields[g]
            raise InputError(
                f"{where}: {time:g} s: {fields[g]} moves at up to {speed:.3g} m/s, so its place is lost in rounding "
                f"then; at most {MOST_TERM / TIME / speed:.3g} s are allowed"
            )


def _refuse_far(bodies: Bodies, fields: Sequence[str], largest: Array, latest: float) -> Array:
    """Refuse bodies with too large coordinates, for joint values up to `largest` (n,) and times up to `latest` [s];
    return the coordinates M (g,) [m]."""
    moves = bodies.chain.carried_by[bodies.joint].sum(axis=1) + 1
    coordinates = _coordinates(bodies, largest, latest)
    far = ~(PLACING * moves * coordinates <= MOST_TERM)
    if far.any():
        g = int(far.argmax())
        raise InputError(
            f"{fields[g]}: up to {coordinates[g]:g} m from the world's origin, where its place is lost in rounding; "
            f"at most {MOST_TERM / PLACING / moves[g]:.3g} m are allowed"
        )
    return coordinates


def _coordinates(bodies: Bodies, largest: Array, latest: float) -> Array:
    """Return M (g,) [m] of each body."""
    chain, model = bodies.chain, bodies.chain.model
    offset = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        slid = 0.0 if chain.revolute[joint - 1] else largest[joint - 1]
        placed = float(np.linalg.norm(model.jointPlacements[joint].translation))
        offset[joint] = offset[int(model.parents[joint])] + placed + slid
    lever = np.linalg.norm(bodies.center, axis=1) + bodies.radius
    found = offset[bodies.joint] + np.linalg.norm(bodies.origin, axis=1) + lever
    for g in np.flatnonzero(bodies.drifting).tolist():
        found[g] = bodies.farthest(g, latest + bodies.latest(g)) + lever[g]
    return np.asarray(found)
