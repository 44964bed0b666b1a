"""The paper's properties of the distance, and the ladder's, as laws: safety, bounds, smoothness, invariance.

Those of the operators are in ``test_holder``.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.baselines.coal import signed_distance, signed_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import RUNGS
from hdplan.distance.numpy_reference.hdsdf import hdsdf, separating_axis_distance, separation
from hdplan.distance.studies.random_poses import touching_poses
from hdplan.planner.collision.link_bodies import link_bodies
from hdplan.planner.robot.loading import load_robot
from hdplan.scenes.robot_spec import RobotSpec
from tests.distance.hard_cases import place
from tests.distance.witnesses import agree, evaluator

CUBE = ConvexBody.box([1, 1, 1])
ULPS = 16 * float(np.finfo(float).eps)  # of the size: how far rounding may carry a separation of 0
ORACLE = 4e-9  # of the size: the oracle's own error, and that of its normal
UNIT = tuple(name for name in RUNGS if "centre" not in name and "edges" not in name)  # sets of unit axes alone

SAFETY = [  # pairs of names in the fixture `solids`; the links of a robot are swept
    ("box", "box"),
    ("box", "capsule"),
    ("box", "link"),
    ("tetrahedron", "octahedron"),
    ("tetrahedron", "swept octahedron"),
    ("icosahedron", "cylinder"),
    ("dodecahedron", "box"),
    ("capsule", "capsule"),
    ("capsule", "plate"),
    ("sphere", "segment"),
    ("sphere", "link"),
    ("link", "flat link"),
    ("flat link", "long link"),
    ("point", "swept triangle"),
]


@pytest.fixture(scope="module")
def solids(bodies):
    links = {len(link.body.faces): link.body for link in link_bodies(load_robot(RobotSpec("panda")))}
    flat = links.pop(2)
    long = links.pop(0)
    more = {"link": links[max(links)], "flat link": flat, "long link": long}
    more |= {name: ConvexBody.platonic(name, 0.6) for name in ("octahedron", "icosahedron", "dodecahedron")}
    return bodies | more


def _size(body_a, body_b, *poses):
    return body_a.reach + body_b.reach + max(np.abs(pose[..., :3, 3]).max() for pose in poses)


# --- safety and bounds ------------------------------------------------------------------------------------------------


@pytest.mark.sampled(5)
@pytest.mark.parametrize("rung", RUNGS)
@pytest.mark.parametrize("names", SAFETY, ids="-".join)
def test_bodies_that_share_a_point_never_read_as_apart(names, rung, solids):
    """A seeded sample of ``benchmarks/sign_safety.py``: contact by construction, whatever the set."""
    body_a, body_b = (solids[name] for name in names)
    poses_a, poses_b = touching_poses(body_a, body_b, np.random.default_rng(1), 60)
    rounding = ULPS * _size(body_a, body_b, poses_a, poses_b)
    assert separation(body_a, poses_a, body_b, poses_b, normals=rung).max() <= rounding
    for gamma, length in ((1, 1e-9), (2, 1e-3), (8, 1e-3)):
        value = hdsdf(body_a, poses_a, body_b, poses_b, gamma=gamma, shaping_length=length, normals=rung)
        assert value.max() <= 100 * rounding  # as many axes may read that little more than nothing


@pytest.mark.parametrize("names", SAFETY, ids="-".join)
def test_any_witness_normal_is_safe(names, solids):
    body_a, body_b = (solids[name] for name in names)
    rng = np.random.default_rng(2)
    poses_a, poses_b = touching_poses(body_a, body_b, rng, 60)
    found = separation(body_a, poses_a, body_b, poses_b, witnesses=rng.normal(size=(60, 5, 3)))
    assert found.max() <= ULPS * _size(body_a, body_b, poses_a, poses_b)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("rung", RUNGS)
@pytest.mark.parametrize("names", SAFETY, ids="-".join)
def test_separation_is_a_lower_bound_and_no_rung_loosens_it(names, rung, solids, random_poses):
    """Apart: at most the exact distance. In contact: of unit axes too; shorter ones read less depth, but no gap."""
    body_a, body_b = (solids[name] for name in names)
    poses = random_poses(3, 40, 0.8), random_poses(4, 40, 0.8)
    exact = signed_distances(body_a, poses[0], body_b, poses[1])
    found = separation(body_a, poses[0], body_b, poses[1], normals=rung)
    slack = ORACLE * _size(body_a, body_b, *poses)
    bound = exact if rung in UNIT else np.maximum(exact, 0.0)
    assert np.all(found <= bound + slack)
    assert np.all(found >= separation(body_a, poses[0], body_b, poses[1]) - slack)
    value, least = (hdsdf(body_a, poses[0], body_b, poses[1], normals=name) for name in (rung, "paper"))
    assert np.all(value >= least - 1e-12 * np.abs(least))  # more axes make the Hölder maximum larger, too


@pytest.mark.sampled(3)
@pytest.mark.parametrize("names", SAFETY, ids="-".join)
def test_exact_normal_as_witness_is_exact_there_and_safe_around(names, solids, random_poses):
    """A cutting plane: the oracle's normal, fixed in B, swept bodies included."""
    body_a, body_b = (solids[name] for name in names)
    rng = np.random.default_rng(5)
    for pose_a, pose_b in zip(random_poses(6, 12, 0.7), random_poses(7, 12, 0.7), strict=True):
        exact = signed_distance(body_a, pose_a, body_b, pose_b)
        normal = (pose_b[:3, :3].T @ exact.normal)[None]
        slack = ORACLE * _size(body_a, body_b, pose_a, pose_b)
        found = separation(body_a, pose_a, body_b, pose_b, witnesses=normal)
        assert abs(found - exact.distance) <= slack
        if exact.distance > slack:
            assert hdsdf(body_a, pose_a, body_b, pose_b, witnesses=normal) >= 0
        twists = [rng.normal(size=(2, 3)) * r for r in (1e-3, 0.1)]
        steps = [place(x, y, z, Rotation.from_rotvec(turn)) for (x, y, z), turn in twists]
        around = pose_a @ np.array(steps)
        near = signed_distances(body_a, around, body_b, np.array([pose_b] * 2))
        assert np.all(separation(body_a, around, body_b, pose_b, witnesses=normal) <= near + slack)


# --- smoothness -------------------------------------------------------------------------------------------------------


def _along(pose, twist, times):
    """Return pose·exp(t ξ), ξ = [v, ω] with ω along z and v across it, as exact rigid motions (T, 4, 4)."""
    (x, y, _), turn = twist[:3], twist[5] * times
    # the integral of the rotation, stable where the turn is small
    along, across = times * np.sinc(turn / np.pi), times * np.sin(turn / 2) * np.sinc(turn / (2 * np.pi))
    zero = np.zeros_like(times)
    rotations = Rotation.from_rotvec(np.stack([zero, zero, turn], -1)).as_matrix()
    moves = np.tile(np.eye(4), (len(times), 1, 1))
    moves[:, :3, :3] = rotations
    moves[:, :2, 3] = np.stack([along * x - across * y, across * x + along * y], -1)
    return pose @ moves


SQUARE = ConvexBody.box([1.0, 1.0, 0.2])
PATHS = {  # pose of a square at t = 0, its twist, how long: through kinks of the Euclidean distance to another square
    "turning over a face": (place(0, 1.3), [0, 0, 0, 0, 0, 1.0], 0.3),  # the nearest corner jumps at 0
    "moving past": (place(0, 1.25, 0, Rotation.from_euler("z", 0.1)), [1.0, 0, 0, 0, 0, 0.4], 1.6),
    "diving in": (place(0.1, 1.0, 0, Rotation.from_euler("z", 0.5)), [0.1, 1.0, 0, 0, 0, 0.7], 0.6),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("gamma", [1, 2, 3])
@pytest.mark.parametrize("name", PATHS)
def test_differentiable_gamma_times_through_the_euclidean_kinks(name, gamma):
    """The gamma-th derivative's largest change between neighbours vanishes with their spacing; the Euclidean distance's
    first derivative jumps (paper: Proposition III.3)."""
    pose, twist, reach = PATHS[name]
    xi = np.concatenate([twist, np.zeros(6)])
    times, square = np.linspace(-reach, reach, 1601), SQUARE

    evaluate = evaluator("casadi", square, square, gamma=gamma, shaping_length=0.2)

    def derivatives(at):
        found = evaluate(_along(pose, twist, at), place())
        return found.gradient @ xi, np.einsum("i,tij,j->t", xi, found.hessian, xi)

    if gamma < 3:
        highest = derivatives(times)[gamma - 1]
    else:
        step = 1e-6
        highest = (derivatives(times + step)[1] - derivatives(times - step)[1]) / (2 * step)
    exact = signed_distances(square, _along(pose, twist, times), square, np.array([place()] * len(times)))
    coarse, fine = (np.abs(np.diff(highest[::k])).max() for k in (8, 1))
    assert fine <= 0.3 * coarse, "continuous"
    slope = np.diff(exact) / np.diff(times)
    coarse, fine = (np.abs(slope[2 * k :: k] - slope[: -2 * k : k]).max() for k in (8, 1))
    assert fine >= 0.6 * coarse, "jumps"
    assert fine > 0.1


@pytest.mark.parametrize("rung", RUNGS[1:])
def test_no_jump_where_edges_and_faces_align(rung):
    """D and its gradient across alignment, down to 1e-15 rad, where the plain cross products appear from nowhere."""
    half = Rotation.from_euler("z", 45, degrees=True)
    evaluate = evaluator("casadi", CUBE, CUBE, normals=rung, shaping_length=0.01)
    angles = np.array([0.0, *(s * a for a in (1e-15, 1e-12, 1e-9, 1e-6) for s in (-1, 1))])
    for start, still in ((half, half), (half, Rotation.identity()), (Rotation.identity(), Rotation.identity())):
        poses = np.array([place(1.52, 0.1, 0.2, Rotation.from_rotvec([a, a, 0.5 * a]) * start) for a in angles])
        found = evaluate(poses, place(0, 0, 0, still))
        assert np.all(np.abs(found.value - found.value[0]) <= 10 * np.abs(angles) + 1e-13)
        assert np.all(np.abs(found.gradient - found.gradient[0]).max(-1) <= 1e4 * np.abs(angles) + 1e-10)


# --- invariance -------------------------------------------------------------------------------------------------------

MOVED = [("box", "box"), ("box", "capsule"), ("sphere", "tetrahedron"), ("cylinder", "swept triangle")]
SETTINGS = {"gamma": 3, "shaping_length": 0.01, "normals": "paper+centre+edges"}
BATCH = {"gamma": 2, "shaping_length": 0.01, "normals": "paper+edges"}  # JAX compiles for seconds: always the same
EACH = [(names, name, SETTINGS) for names in MOVED for name in ("numpy", "casadi")] + [(("box", "box"), "jax", BATCH)]


@pytest.mark.parametrize(("names", "name", "settings"), EACH)
def test_moving_both_changes_nothing(names, name, settings, bodies, random_poses):
    """D(TA, TB) = D(A, B), with gradient and Hessian, by twists in the bodies' own frames."""
    pair = [bodies[name] for name in names]
    a, b, motion = random_poses(8, 6, 0.8), random_poses(9, 6, 0.8), random_poses(10, 6, 3.0)
    evaluate = evaluator(name, *pair, **settings)
    agree(evaluate(a, b), evaluate(motion @ a, motion @ b), (motion @ a, motion @ b), pair, settings["gamma"])


@pytest.mark.parametrize(("names", "name", "settings"), EACH)
def test_symmetric(names, name, settings, bodies, random_poses):
    """D(A, B) = D(B, A), with gradient and Hessian."""
    pair = [bodies[name] for name in names]
    a, b = random_poses(11, 6, 0.8), random_poses(12, 6, 0.8)
    there = evaluator(name, *pair, **settings)(a, b)
    back = evaluator(name, *pair[::-1], **settings)(b, a)
    swap = np.roll(np.arange(12), 6)
    back = back._replace(gradient=back.gradient[:, swap], hessian=back.hessian[:, swap][:, :, swap])
    agree(there, back, (a, b), pair, settings["gamma"])


@pytest.mark.parametrize("rung", RUNGS[:3] + RUNGS[4:])
@pytest.mark.parametrize("exponent", [-20, 20])
def test_lengths_have_no_scale(rung, exponent, random_poses):
    """Everything times 2^20, the shaping length too: D times 2^20, to the last digit."""
    scale = 2.0**exponent
    body, other = ConvexBody.box([1.0, 0.6, 0.4]), ConvexBody.capsule(0.15, 0.8)
    large, larger = ConvexBody.box(scale * np.array([1.0, 0.6, 0.4])), ConvexBody.capsule(0.15 * scale, 0.8 * scale)
    a, b = random_poses(13, 6, 0.8), random_poses(14, 6, 0.8)
    scaled_a, scaled_b = a.copy(), b.copy()
    scaled_a[:, :3, 3] *= scale
    scaled_b[:, :3, 3] *= scale
    here = hdsdf(body, a, other, b, normals=rung)
    there = hdsdf(large, scaled_a, larger, scaled_b, normals=rung, shaping_length=1e-3 * scale)
    np.testing.assert_allclose(there, scale * here, rtol=1e-12)


# --- the sets ---------------------------------------------------------------------------------------------------------


def test_set_and_multiset_read_as_measured():
    """The text's set, once per body, and the published code's, every edge: two parallel boxes 0.5 m apart."""
    for name, value in (("paper", 0.2435), ("paper-multiset", 0.416)):
        found = hdsdf(CUBE, place(1.5), CUBE, place(), epsilon=1e-6, normals=name)
        assert float(found) == pytest.approx(value, rel=2e-3)


@pytest.mark.parametrize("name", ["numpy", "casadi", "jax"])
def test_crossing_edges_are_seen_by_the_edges_rung(name):
    """Boxes turned by 45° about different axes, edge to edge: a tenth of a metre apart."""
    pose_a = place(np.sqrt(2) + 0.1, 0, 0, Rotation.from_euler("z", 45, degrees=True))
    pose_b = place(0, 0, 0, Rotation.from_euler("y", 45, degrees=True))
    seen = evaluator(name, CUBE, CUBE, normals="paper+edges")(pose_a, pose_b)
    assert seen.value > 0.05
    assert 0.09 < seen.separation <= 0.1
    assert float(hdsdf(CUBE, pose_a, CUBE, pose_b)) == pytest.approx(-0.282, abs=1e-3)
    assert separating_axis_distance(CUBE, pose_a, CUBE, pose_b) == pytest.approx(0.1)


# --- any bodies -------------------------------------------------------------------------------------------------------

NORMALS = ("paper", "paper-multiset", "paper+centre", "paper+edges", "paper+sphere-8")


def drawn_points(rng, count):
    """Points (count, 3) in a cube, half of them in a grid: aligned and degenerate now and then."""
    grid, anywhere = rng.integers(-4, 5, (count, 3)) / 4, rng.uniform(-1.0, 1.0, (count, 3)).round(12)
    return np.where(rng.random((count, 1)) < 0.5, grid, anywhere)


def drawn_body(rng):
    return ConvexBody.from_points(drawn_points(rng, rng.integers(1, 7)), rng.choice([0.0, 0.1, 1.0]))


def drawn_pose(rng):
    """A place, turned by quarters now and then."""
    turn = Rotation.from_rotvec(rng.uniform(-3.0, 3.0, 3))
    quarters = Rotation.from_euler("xyz", rng.integers(-2, 3, 3) * np.pi / 2)
    x, y, z = 2 * drawn_points(rng, 1)[0]
    return place(x, y, z, quarters if rng.random() < 0.5 else turn)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["numpy", "casadi"])
@pytest.mark.parametrize("seed", range(32))
def test_any_bodies_at_any_pose(seed, name):
    """Finite, safe, below the exact distance, symmetric."""
    rng = np.random.default_rng(seed)
    body_a, body_b, pose_a, pose_b = drawn_body(rng), drawn_body(rng), drawn_pose(rng), drawn_pose(rng)
    choices = {
        "gamma": int(rng.integers(1, 33)),
        "shaping_length": 10.0 ** rng.uniform(-9.0, 0.0),
        "normals": str(rng.choice(NORMALS)),
    }
    found = evaluator.__wrapped__(name, body_a, body_b, **choices)(pose_a, pose_b)
    for part in found:
        assert np.all(np.isfinite(part))
    exact = signed_distance(body_a, pose_a, body_b, pose_b).distance
    slack = ORACLE * max(1.0, _size(body_a, body_b, pose_a, pose_b))
    assert found.separation <= max(exact, 0.0) + slack
    assert found.value == 0 or np.sign(found.value) == np.sign(found.separation)
    back = evaluator.__wrapped__(name, body_b, body_a, **choices)(pose_b, pose_a)
    swap = np.roll(np.arange(12), 6)
    back = back._replace(gradient=back.gradient[swap], hessian=back.hessian[swap][:, swap])
    agree(found, back, (pose_a, pose_b), (body_a, body_b), choices["gamma"], smooth=False)
