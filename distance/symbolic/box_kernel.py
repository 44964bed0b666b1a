"""The paper's HD-SDF of two boxes whose sizes and poses are all arguments: one compiled kernel for every pair of them.

D of Definition III.2 with the paper's own normals Ñ of both boxes, as the NumPy reference
has them under "paper" and "paper-multiset". A lower bound in sign, an approximation in value.
"""

from __future__ import annotations

import functools
import itertools

import casadi as ca
import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import candidate_normals
from hdplan.distance.symbolic.all_axes import Axes, combined
from hdplan.distance.symbolic.axis_wrenches import fixed_in_a, fixed_in_b
from hdplan.distance.symbolic.graph_poses import rigid_or_nan
from hdplan.scenes.once import read_only

CORNERS = read_only(np.array(list(itertools.product((-1.0, 1.0), repeat=3))).T)  # (3, 8)


def axis_count(normals: str) -> int:
    """Return the multiplicity of each of a box's three axes in the maximum, in either direction."""
    cube = ConvexBody.box([1.0, 1.0, 1.0])
    return int(candidate_normals(normals, cube, cube).counts_a[0])


@functools.cache
def box_distance(gamma: int, shaping_length: float, normals: str) -> ca.Function:
    """Build D of two boxes as a CasADi function; ``normals`` is "paper" or "paper-multiset".

    Inputs (flat, row-major): placement_a (12) and placement_b (12), each [R (9) | t (3)], world from the frame that
    carries the box [m]; box_a and box_b (15), each [R (9) | t (3)], the box's frame in that frame, and half its sides
    (3); margin (1) [m] that is subtracted from every separation, as if the boxes were grown by that radius.

    Outputs: distance () [m]; wrench (6) = [F | T], the derivative of D under a motion of A: dD = F·v + T·ω for the
    velocity v of the point of A at the world's origin and angular velocity ω (B's wrench is the opposite); separation
    () [m], D̃ of eq. (5), never more than the true signed distance of the boxes less the margin. At placements that are
    not rigid D and D̃ are NaN, as a graph cannot raise an error.
    """
    placements = [ca.MX.sym(f"placement_{name}", 12) for name in "ab"]
    boxes = [ca.MX.sym(f"box_{name}", 15) for name in "ab"]
    margin = ca.MX.sym("margin")
    rotations, origins, corners = [], [], []
    for placement, box in zip(placements, boxes, strict=True):
        turn = ca.reshape(placement[:9], 3, 3).T
        rotations.append(turn @ ca.reshape(box[:9], 3, 3).T)
        origins.append(turn @ box[9:12] + placement[9:])
        corners.append(ca.repmat(box[12:], 1, 8) * ca.DM(CORNERS))
    rotation = rotations[0].T @ rotations[1]
    position = rotations[0].T @ (origins[1] - origins[0])
    in_a = rotation @ corners[1] + ca.repmat(position, 1, 8)  # B's corners in A's frame
    in_b = rotation.T @ (corners[0] - ca.repmat(position, 1, 8))
    counts = np.full(3, float(axis_count(normals)))
    groups = [
        Axes(
            motion,
            [normal],
            ca.vertcat(box[12:].T, -box[12:].T),  # a box's own corners project to two heights on each axis
            ca.MX(4.0 * ca.DM.ones(2, 3)),
            seen.T,
            ca.MX.ones(8, 3),
            margin * ca.MX.ones(1, 3),
            counts,
            ca.repmat(points, 1, 3),
        )
        for motion, normal, box, seen, points in (
            (fixed_in_a, ca.MX.eye(3), boxes[0], in_a, in_a),
            (fixed_in_b, rotation, boxes[1], in_b, corners[0]),
        )
    ]
    distance, separation, gradient = combined(groups, gamma, 1, ca.MX(shaping_length))
    mark = rigid_or_nan(*(ca.reshape(part[:9], 3, 3).T for part in (*placements, *boxes)))
    force = -rotations[0] @ gradient[:3]  # the gradient is by the motion of B as seen from A
    torque = -rotations[0] @ gradient[3:] + ca.cross(origins[0], force)
    return ca.Function(
        f"hdsdf_boxes_{gamma}_{normals.replace('-', '_')}",
        [*placements, *boxes, margin],
        [ca.densify(distance + mark), ca.densify(ca.vertcat(force, torque)), ca.densify(separation + mark)],
        ["placement_a", "placement_b", "box_a", "box_b", "margin"],
        ["distance", "wrench", "separation"],
    )
