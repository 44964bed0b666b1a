"""The law of derivatives where automatic ones fail: bodies along each other, parallel, touching, one in the other.

At such poses many vertices and axes tie, and D is smooth all the same. Value, gradient and Hessian of every witness and
of the planner's kernels equal the truth in 120 digits (``extended``), along a random twist of both bodies, to relative
errors of ``ROUNDING`` p² size/|D̃| (see ``test_hard_cases``).
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.poses import placement_rows
from hdplan.distance.studies.random_poses import AXIS_TURNS
from hdplan.distance.symbolic.box_kernel import box_distance
from hdplan.distance.symbolic.halfspaces import box_directions, halfspace_distance, swept_halfspace_distance
from tests.distance import extended
from tests.distance.conftest import BODIES
from tests.distance.witnesses import evaluator

ROUNDING = 32 * float(np.finfo(float).eps)
UNDERFLOW = 1e-250
CUBE = ConvexBody.box([1.0, 1.0, 1.0])
PAIRS = {
    "cubes": (CUBE, CUBE),
    "box and capsule": (BODIES["box"], BODIES["capsule"]),
    "boxes": (BODIES["box"], ConvexBody.box([0.5, 0.6, 0.4])),
    "box and tetrahedron": (BODIES["box"], BODIES["tetrahedron"]),
    "capsules": (BODIES["capsule"], BODIES["capsule"]),
}
SETTINGS: dict[str, dict[str, Any]] = {
    "cubes": {"gamma": 2},
    "box and capsule": {"gamma": 2, "normals": "paper+edges"},
    "boxes": {"gamma": 3, "shaping_length": 0.1, "normals": "paper+centre"},
    "box and tetrahedron": {"gamma": 4, "shaping_length": 0.02},
    "capsules": {"gamma": 2, "shaping_length": 0.01, "normals": "paper+centre+edges"},
}
WITNESSES = ("numpy", "casadi", "compiled", "graph", "jax", "grad")


def aligned_poses(body_a, body_b, rng, count):
    """Return poses (count, 4, 4) of both: axes along axes (half of them of the world), a third turned about one of
    them; offsets along each axis none, flush, touching, a little apart or anything."""
    world = np.where(rng.random((count, 1, 1)) < 0.5, np.eye(3), Rotation.random(count, rng).as_matrix())
    about = rng.uniform(-np.pi, np.pi, (count, 1)) * (rng.random((count, 1)) < 1 / 3)
    turn = Rotation.from_rotvec(about * np.eye(3)[rng.integers(0, 3, count)]).as_matrix()
    relative = np.where(about[..., None] == 0, np.eye(3), turn) @ AXIS_TURNS[rng.integers(0, 24, count)]
    half_a = 0.5 * np.ptp(body_a.vertices, axis=0) + body_a.radius
    corners = np.einsum("nij,mj->nmi", relative, body_b.vertices)
    half_b = 0.5 * np.ptp(corners, axis=1) + body_b.radius
    kinds = np.stack(
        [
            np.zeros_like(half_b),
            half_a - half_b,
            half_a + half_b,
            half_a + half_b + 10.0 ** rng.uniform(-3, 0, (count, 3)),
            rng.uniform(-1, 1, (count, 3)) * (half_a + half_b),
        ]
    )
    choice = rng.integers(0, len(kinds), (count, 3))
    offset = np.take_along_axis(kinds, choice[None], axis=0)[0] * rng.choice([-1.0, 1.0], (count, 3))
    pose_a, pose_b = (np.tile(np.eye(4), (count, 1, 1)) for _ in range(2))
    pose_a[:, :3, :3], pose_b[:, :3, :3] = world, world @ relative
    pose_b[:, :3, 3] = np.einsum("nij,nj->ni", world, offset)
    return pose_a, pose_b


def _hold(truths, found, size, gamma, what):
    """Hold (value, slope, curvature), a row for each pose, and the sizes of their parts, against truths."""
    for k, right in enumerate(truths):
        relative = ROUNDING * (gamma + 1) ** 2 * max(1.0, size[k] / max(abs(right.separation), 1e-300))
        value, slopes, curvatures = (part[k] for part in found)
        assert np.all(np.isfinite(value)) & np.all(np.isfinite(slopes)) & np.all(np.isfinite(curvatures)), what
        if relative >= 0.5:  # they just touch: D and all of its derivatives are 0 but for rounding
            assert abs(value) <= ROUNDING * size[k]
            continue
        scale = abs(right.value)
        assert abs(value - right.value) <= relative * scale + UNDERFLOW, (what, k)
        scale += np.abs(slopes).sum()
        assert abs(slopes.sum() - right.slope) <= relative * scale + UNDERFLOW, (what, k)
        scale += np.abs(curvatures).sum()
        assert abs(curvatures.sum() - right.curvature) <= relative * scale + UNDERFLOW, (what, k)


def _law(name, count, seed, witnesses):
    body_a, body_b = PAIRS[name]
    settings = SETTINGS[name]
    rng = np.random.default_rng(seed)
    a, b = aligned_poses(body_a, body_b, rng, count)
    twists = rng.normal(size=(count, 12))
    truths = [
        extended.truth(body_a, *both, twist, **settings)
        for both, twist in zip(((x, body_b, y) for x, y in zip(a, b, strict=True)), twists, strict=True)
    ]
    size = body_a.reach + body_b.reach + np.abs(b[:, :3, 3]).max(1)
    for witness in witnesses:
        found = evaluator(witness, body_a, body_b, **settings)(a, b)
        slopes = found.gradient * twists
        curvatures = twists[:, :, None] * found.hessian * twists[:, None]
        _hold(truths, (found.value, slopes, curvatures), size, settings["gamma"], f"{name}, {witness}")
        least = np.array([right.separation for right in truths])
        assert np.all(np.abs(found.separation - least) <= ROUNDING * size), f"{name}, {witness}"


@pytest.mark.parametrize("name", PAIRS)
def test_every_witness_has_the_true_derivatives(name):
    """Those that build in a moment at every pair, C's at the cubes; JAX's, which compile long, in the slow lane."""
    _law(name, 4, 0, WITNESSES[:4] if name == "cubes" else ("numpy", "graph"))


@pytest.mark.slow
@pytest.mark.parametrize("name", PAIRS)
def test_every_witness_has_the_true_derivatives_at_2000_poses(name):
    _law(name, 400, 1, WITNESSES)


# --- the planner's kernels, whose numbers are arguments ---------------------------------------------------------------

HALF = np.array([0.25, 0.3, 0.2])
PLANES = {"faces": np.vstack([np.eye(3), -np.eye(3)]), "26": box_directions()}


def _kernels(count, seed, planes):
    """Hold value and wrenches of both kernels, the body at one placement or swept between two, and the Hessian of the
    former, against the truth."""
    body = BODIES["box"] if seed % 2 else BODIES["capsule"]
    normals = PLANES[planes]
    supports = np.abs(normals) @ HALF
    rng = np.random.default_rng(seed)
    poses_b, first = aligned_poses(ConvexBody.box(2 * HALF), body, rng, count)
    moves = rng.choice([-0.3, 0.0, 0.2], (count, 3)) * rng.integers(0, 2, (count, 1))
    second = first.copy()
    second[:, :3, 3] += np.einsum("nij,nj->ni", poses_b[:, :3, :3], moves)
    number = len(body.vertices)
    row = np.concatenate([body.vertices.ravel(), np.ones(number), [body.radius]])
    table = np.append(normals.ravel(), supports)
    single = halfspace_distance(number, len(normals), 2, 0.01, order=2)
    swept = swept_halfspace_distance(number, len(normals), 2, 0.01)
    for one, other, b in zip(first, second, poses_b, strict=True):
        twists = rng.normal(size=(2, 6))
        outputs = [
            np.array(part).ravel()
            for part in swept(placement_rows(one), placement_rows(other), placement_rows(b), row, table)
        ]
        right = extended.swept_truth(body, one, other, normals, supports, b, twists, shaping_length=0.01)
        _check_slope(right, outputs[0], np.append(*outputs[1:3]) * twists.ravel())
        value, wrench, _, hessian = (
            np.array(part) for part in single(placement_rows(one), placement_rows(b), row, table)
        )
        right = extended.swept_truth(body, one, None, normals, supports, b, twists, shaping_length=0.01)
        _check_slope(right, value[0], wrench[:, 0] * twists[0], twists[0][:, None] * hessian * twists[0])


def _check_slope(right, value, slopes, curvatures=None):
    relative = ROUNDING * 9 * max(1.0, 3.0 / max(abs(right.separation), 1e-300))
    if relative < 0.5:
        assert abs(value - right.value) <= relative * abs(right.value) + UNDERFLOW
        scale = abs(right.value) + np.abs(slopes).sum()
        assert abs(slopes.sum() - right.slope) <= relative * scale + UNDERFLOW
        if curvatures is not None:
            scale += np.abs(curvatures).sum()
            assert abs(curvatures.sum() - right.curvature) <= relative * scale + UNDERFLOW


@pytest.mark.parametrize("planes", PLANES)
def test_planes_have_the_true_derivatives(planes):
    _kernels(4, 2, planes)
    _kernels(4, 3, planes)


@pytest.mark.slow
@pytest.mark.parametrize("planes", PLANES)
@pytest.mark.parametrize("seed", [4, 5])
def test_planes_have_the_true_derivatives_at_2000_poses(planes, seed):
    _kernels(500, seed, planes)


def test_boxes_have_the_true_wrenches():
    function = box_distance(2, 0.01, "paper")
    boxes = [np.concatenate([np.eye(3).ravel(), np.zeros(3), half]) for half in (HALF, [0.5, 0.3, 0.2])]
    bodies = [ConvexBody.box(2 * np.asarray(box[12:])) for box in boxes]
    rng = np.random.default_rng(6)
    for a, b in zip(*aligned_poses(bodies[0], bodies[1], rng, 12), strict=True):
        twist = rng.normal(size=12) * np.repeat([1.0, 0.0], 6)
        value, wrench, _ = (
            np.array(part).ravel() for part in function(placement_rows(a), placement_rows(b), *boxes, 0.0)
        )
        right = extended.truth(bodies[0], a, bodies[1], b, twist, gamma=2, shaping_length=0.01)
        force, torque = wrench[:3], wrench[3:] - np.cross(a[:3, 3], wrench[:3])  # about A's origin
        _check_slope(right, value[0], np.append(a[:3, :3].T @ force, a[:3, :3].T @ torque) * twist[:6])


def test_a_third_derivative_is_refused():
    """There is no closed form of it, and CasADi's own would be wrong."""
    from hdplan.distance.symbolic.graph_distance import hdsdf_function

    function = hdsdf_function(CUBE, CUBE)
    shift = ca.MX.sym("shift", 3)
    pose = ca.vertcat(ca.horzcat(ca.MX.eye(3), shift), ca.DM([[0, 0, 0, 1]]))
    hessian = ca.hessian(function(ca.MX.eye(4), pose), shift)[0]
    with pytest.raises(RuntimeError, match="jac_jac_hdsdf"):
        ca.jacobian(ca.vec(hessian), shift)
    for order in ("jac:distance:pose_b", "hess:distance:pose_b:pose_b", "grad:distance:pose_a"):
        assert function.factory("derived", function.name_in(), [order]).n_out() == 1
