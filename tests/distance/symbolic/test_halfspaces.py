"""Laws of the planner's distance: positive only where bodies are apart, the wrench its derivative, idle slots idle.

Held against the exact oracle, central differences, and a NumPy form of the module's equation.
"""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance import holder
from hdplan.distance.baselines.coal import signed_distance
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.poses import placement_rows
from hdplan.distance.symbolic.halfspaces import FAR_OFFSET, box_directions, halfspace_distance
from hdplan.scenes.array_types import Array

SLOTS, PLANES = 12, 48  # one function serves all bodies here: the rest are slots without effect
LENGTH = 1e-3  # [m] shaping length, the default

# Each relative to the size of the numbers unless it has a unit.
WITNESS = 1e-12  # NumPy against CasADi: rounding of a projection (1e-16 m), times p² where D is above a mm
NEGLIGIBLE = 1e-15  # [m] of D: what remains near contact, where D ~ u^9 makes relative errors meaningless
ROUNDING = 1e-12  # of the bodies' size [m]: by which a signed distance that is 0 may be read as positive
ORACLE = 4e-9  # [m] the oracle's own bound
INVARIANCE = 1e-8  # the same pair seen from 10 m away: rounding of the positions, amplified near contact
DIFFERENCE = 2e-6  # central differences with steps of 1e-5 of the shaping length that the test uses
PADDING = 1e-15  # slots of weight 0: products with 0


def planes_of(body: ConvexBody) -> tuple[Array, Array]:
    """Unit normals (K, 3), at most PLANES, and exact supports (K,): the body's faces, a box's directions, random."""
    random = np.random.default_rng(5).normal(size=(PLANES, 3))
    normals = np.vstack([body.faces[:20], box_directions(), random / np.linalg.norm(random, axis=1, keepdims=True)])
    normals = normals[:PLANES]
    return normals, (normals @ body.vertices.T).max(axis=1) + body.radius


def body_row(body: ConvexBody, slots: int = SLOTS) -> Array:
    """Vertices, weights and radius; slots that are not needed repeat the first vertex with weight 0."""
    count = len(body.vertices)
    spare = slots - count
    vertices = np.vstack([body.vertices, np.tile(body.vertices[0], (spare, 1))])
    return np.concatenate([vertices.ravel(), np.ones(count), np.zeros(spare), [body.radius]])


@functools.cache
def mapped(vertices: int, planes: int, gamma: int, length: float, count: int) -> ca.Function:
    return halfspace_distance(vertices, planes, gamma, length).map(count)


def evaluate(
    body_a: ConvexBody,
    poses_a: Array,
    normals: Array,
    supports: Array,
    poses_b: Array,
    *,
    gamma: int = 2,
    length: float = LENGTH,
    slots: int = SLOTS,
) -> tuple[Array, Array]:
    """D (B,) and wrenches (B, 6) at poses (B, 4, 4)."""
    function = mapped(slots, len(supports), gamma, length, len(poses_a))
    distance, wrench, _ = function(
        np.array([placement_rows(pose) for pose in poses_a]).T,
        np.array([placement_rows(pose) for pose in poses_b]).T,
        body_row(body_a, slots),
        np.append(normals.ravel(), supports),
    )
    return np.array(distance)[0], np.array(wrench).T


def in_numpy(
    body: ConvexBody, pose_a: Array, normals: Array, supports: Array, pose_b: Array, gamma: int, length: float
) -> float:
    """The module's equation in the blocks of `holder`: Phi(⊞_k Phi(⊕_i (n_k · a_i − r_A − h_B(n_k))))."""
    points = body.vertices @ pose_a[:3, :3].T + pose_a[:3, 3]
    local = (points - pose_b[:3, 3]) @ pose_b[:3, :3]
    inner = holder.holder_minimum(normals @ local.T - body.radius - supports[:, None], gamma)
    outer = holder.holder_maximum(holder.shaping(inner, gamma, length), gamma)
    return float(holder.shaping(outer, gamma, length))


def moved(pose: Array, axis: int, size: float) -> Array:
    """The pose after a motion of the world's frame along axis 0-2 (translation) or about its axis 3-5 (rotation)."""
    motion = np.eye(4)
    if axis < 3:
        motion[axis, 3] = size
    else:
        motion[:3, :3] = Rotation.from_rotvec(size * np.eye(3)[axis - 3]).as_matrix()
    result: Array = motion @ pose
    return result


def size_of(*arrays: Array) -> float:
    return float(max(1.0, *(np.abs(array).max() for array in arrays)))


def test_box_directions_are_the_26_of_a_cube() -> None:
    directions = box_directions()
    assert directions.shape == (26, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-15)
    assert len({tuple(np.sign(row)) for row in directions}) == 26
    np.testing.assert_array_equal(np.sort(directions, axis=0), np.sort(-directions, axis=0))


@pytest.mark.sampled(5)
@pytest.mark.parametrize("clearance", [0.0, 0.03])
def test_positive_proves_the_clearance(pair, random_poses, clearance: float) -> None:
    """d ≤ c ⇒ D ≤ 0 and D > 0 ⇒ d > c, with the supports enlarged by c; and D does say `apart` where bodies are."""
    body_a, body_b = pair
    normals, supports = planes_of(body_b)
    for spread in (0.2, 0.6, 1.5):  # deep, near, apart
        poses_a, poses_b = random_poses(41, 12, spread), random_poses(42, 12, spread)
        distance, _ = evaluate(body_a, poses_a, normals, supports + clearance, poses_b)
        truth = np.array(
            [signed_distance(body_a, a, body_b, b).distance for a, b in zip(poses_a, poses_b, strict=True)]
        )
        assert np.all(truth[distance > 0] > clearance)
        assert np.all(distance[truth <= clearance] <= 0)
        if spread == 1.5:
            far = truth > 1.0
            assert np.all(distance[far] > 0)


@pytest.mark.sampled(5)
def test_positive_only_when_apart_at_hard_poses(hard) -> None:
    """Touching, parallel, identical, deep, extreme scales; both bodies on either side."""
    for body_a, pose_a, body_b, pose_b in (
        (hard.body_a, hard.pose_a, hard.body_b, hard.pose_b),
        (hard.body_b, hard.pose_b, hard.body_a, hard.pose_a),
    ):
        normals, supports = planes_of(body_b)
        size = max(np.abs(body_a.vertices).max() + body_a.radius, np.abs(body_b.vertices).max() + body_b.radius)
        size = max(size, float(np.abs(pose_a).max()))
        for gamma in (1, 2, 8):
            distance, _ = evaluate(body_a, pose_a[None], normals, supports, pose_b[None], gamma=gamma)
            assert not (distance[0] > 0 and hard.distance < -ROUNDING * size)
            if hard.distance <= 0:  # what rounding leaves is far below anything that counts
                assert distance[0] <= NEGLIGIBLE * size
            slack, _ = evaluate(body_a, pose_a[None], normals, supports + ROUNDING * size, pose_b[None], gamma=gamma)
            assert hard.distance > 0 or slack[0] <= 0


def test_small_gaps_between_faces_are_seen() -> None:
    """Face to face the separating plane is among the planes: D > 0 at a gap of a tenth of the shaping length."""
    box = ConvexBody.box([1, 1, 1])
    pose = np.eye(4)
    pose[0, 3] = 1 + 0.1 * LENGTH
    normals, supports = planes_of(box)
    assert evaluate(box, pose[None], normals, supports, np.eye(4)[None])[0][0] > 0


def test_finite_at_hard_poses(hard) -> None:
    """Value and wrench; extreme scales and contact included, gamma 1 to 8."""
    normals, supports = planes_of(hard.body_b)
    for gamma in range(1, 9):
        distance, wrench = evaluate(hard.body_a, hard.pose_a[None], normals, supports, hard.pose_b[None], gamma=gamma)
        assert np.isfinite(distance).all()
        assert np.isfinite(wrench).all()


@pytest.mark.parametrize("gamma", [1, 2, 5, 8])
def test_numpy_form_of_the_equation_agrees(bodies, random_poses, gamma: int) -> None:
    names = list(bodies)
    for number, name in enumerate(names):
        body_a, body_b = bodies[name], bodies[names[(3 * number + 1) % len(names)]]
        normals, supports = planes_of(body_b)
        for spread in (0.2, 0.6, 1.5):
            poses_a, poses_b = random_poses(43, 6, spread), random_poses(44, 6, spread)
            distance, _ = evaluate(body_a, poses_a, normals, supports, poses_b, gamma=gamma)
            truth = [
                in_numpy(body_a, a, normals, supports, b, gamma, LENGTH) for a, b in zip(poses_a, poses_b, strict=True)
            ]
            np.testing.assert_allclose(distance, truth, rtol=WITNESS, atol=NEGLIGIBLE)


@pytest.mark.core
@pytest.mark.sampled(5)
def test_separation_is_the_plain_form_and_never_more_than_the_distance(pair, random_poses) -> None:
    """D̃ = max_k min_i: of D's sign, also where D underflows, and a lower bound of the signed distance in value."""
    body_a, body_b = pair
    normals, supports = planes_of(body_b)
    for spread in (0.2, 0.6, 1.5):
        poses_a, poses_b = random_poses(54, 6, spread), random_poses(55, 6, spread)
        for a, b in zip(poses_a, poses_b, strict=True):
            placed = placement_rows(a), placement_rows(b), body_row(body_a), np.append(normals.ravel(), supports)
            distance, _, separation = (np.array(x).ravel() for x in mapped(SLOTS, PLANES, 8, LENGTH, 1)(*placed))
            local = (body_a.vertices @ a[:3, :3].T + a[:3, 3] - b[:3, 3]) @ b[:3, :3]
            plain = (normals @ local.T - body_a.radius - supports[:, None]).min(axis=1).max()
            assert separation[0] == pytest.approx(plain, rel=WITNESS, abs=NEGLIGIBLE)
            assert distance[0] == 0 or np.sign(separation[0]) == np.sign(distance[0])
            assert separation[0] <= signed_distance(body_a, a, body_b, b).distance + ORACLE


@pytest.mark.core
@pytest.mark.parametrize("gamma", [1, 2, 4])
def test_wrench_is_the_derivative(bodies, random_poses, gamma: int) -> None:
    """Central differences of D along motions of A; along the same motions of B the opposite."""
    length, names = 0.1, ("box", "capsule", "swept octahedron", "sphere", "triangle")  # wide: D smooth at every pose
    step = 1e-5 * length
    for number, name in enumerate(names):
        body_a, body_b = bodies[name], bodies[names[(number + 1) % len(names)]]
        normals, supports = planes_of(body_b)
        for spread in (0.2, 0.7):
            poses_a, poses_b = random_poses(45, 4, spread), random_poses(46, 4, spread)
            _, wrench = evaluate(body_a, poses_a, normals, supports, poses_b, gamma=gamma, length=length)
            of_a, of_b = np.empty_like(wrench), np.empty_like(wrench)
            for axis in range(6):
                ahead, behind = (np.array([moved(pose, axis, s) for pose in poses_a]) for s in (step, -step))
                values = [
                    evaluate(body_a, p, normals, supports, poses_b, gamma=gamma, length=length)[0]
                    for p in (ahead, behind)
                ]
                of_a[:, axis] = (values[0] - values[1]) / (2 * step)
                ahead, behind = (np.array([moved(pose, axis, s) for pose in poses_b]) for s in (step, -step))
                values = [
                    evaluate(body_a, poses_a, normals, supports, p, gamma=gamma, length=length)[0]
                    for p in (ahead, behind)
                ]
                of_b[:, axis] = (values[0] - values[1]) / (2 * step)
            np.testing.assert_allclose(wrench, of_a, atol=DIFFERENCE * size_of(wrench))
            np.testing.assert_allclose(-wrench, of_b, atol=DIFFERENCE * size_of(wrench))


@pytest.mark.sampled(5)
def test_common_motion_changes_nothing(pair, random_poses) -> None:
    """D stays, and the wrench turns with the frame: F' = R F, T' = R T + t × R F."""
    body_a, body_b = pair
    normals, supports = planes_of(body_b)
    poses_a, poses_b = random_poses(47, 6, 0.6), random_poses(48, 6, 0.6)
    before, wrench = evaluate(body_a, poses_a, normals, supports, poses_b, length=0.02)
    for motion in random_poses(49, 2, 10.0):
        after, turned = evaluate(body_a, motion @ poses_a, normals, supports, motion @ poses_b, length=0.02)
        np.testing.assert_allclose(after, before, rtol=INVARIANCE, atol=NEGLIGIBLE)
        force = wrench[:, :3] @ motion[:3, :3].T
        torque = wrench[:, 3:] @ motion[:3, :3].T + np.cross(motion[:3, 3], force)
        np.testing.assert_allclose(turned, np.hstack([force, torque]), atol=INVARIANCE * size_of(torque))


def test_slots_of_weight_zero_change_nothing(bodies, random_poses) -> None:
    for name in ("sphere", "capsule", "triangle", "box"):
        body = bodies[name]
        normals, supports = planes_of(bodies["tetrahedron"])
        poses_a, poses_b = random_poses(50, 20, 0.6), random_poses(51, 20, 0.6)
        plain = evaluate(body, poses_a, normals, supports, poses_b, slots=len(body.vertices))
        padded = evaluate(body, poses_a, normals, supports, poses_b, slots=SLOTS)
        for one, other in zip(plain, padded, strict=True):
            np.testing.assert_allclose(one, other, rtol=PADDING, atol=PADDING * size_of(plain[1]))


@pytest.mark.parametrize("gamma", [1, 2, 4])
def test_planes_far_behind_change_next_to_nothing(bodies, random_poses, gamma: int) -> None:
    """Each weighs (depth / FAR_OFFSET)^(gamma+1) in the maximum where bodies overlap, and exactly 0 where they are
    apart."""
    body = bodies["capsule"]
    normals, supports = planes_of(bodies["box"])
    few, count = 26, PLANES - 26
    filled = np.vstack([normals[:few], np.tile([0.0, 0.0, 1.0], (count, 1))])
    far = np.append(supports[:few], np.full(count, FAR_OFFSET))
    poses_a, poses_b = random_poses(52, 40, 0.6), random_poses(53, 40, 0.6)
    plain = evaluate(body, poses_a, normals[:few], supports[:few], poses_b, gamma=gamma)
    padded = evaluate(body, poses_a, filled, far, poses_b, gamma=gamma)
    deepest = np.abs(plain[0]).max()
    bound = 2 * (gamma + 2) * count * (2 * deepest / FAR_OFFSET) ** (gamma + 1) + 1e-14
    for one, other in zip(plain, padded, strict=True):
        np.testing.assert_allclose(other, one, atol=bound * size_of(plain[1]))
    apart = plain[0] > 0
    assert 0 < apart.sum() < len(apart)
    np.testing.assert_array_equal(padded[0][apart], plain[0][apart])
