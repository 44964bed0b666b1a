"""Unions of convex bodies, for each witness: what a Hölder minimum over pieces promises, and the hard poses again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from hdplan.distance import (
    BodyUnion,
    ConvexBody,
    fcl_distances,
    hdsdf,
    hdsdf_compiled,
    hdsdf_derivatives,
    separating_axis_distance,
    separation,
    signed_distance,
    signed_distances,
)
from hdplan.distance.baselines.coal import CoalPair
from hdplan.distance.baselines.fcl import FclPair
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.studies.random_poses import touching_poses
from hdplan.distance.unions import pairs_of
from hdplan.scenes.errors import InputError
from tests.distance.conftest import BODIES
from tests.distance.extended import truth
from tests.distance.hard_cases import HARD, place
from tests.distance.witnesses import Evaluation, agree, evaluator

COUNT = 6
ROUNDING = 16 * float(np.finfo(float).eps)


def _shifted(body, *by):
    return replace(body, vertices=body.vertices + np.array(by))


ELL = ConvexBody.union([ConvexBody.box([1.0, 0.3, 0.3]), _shifted(ConvexBody.box([0.3, 1.0, 0.3]), 0.35, 0.35, 0.0)])
MIXED = ConvexBody.union([BODIES["swept octahedron"], _shifted(BODIES["capsule"], 0.4, 0.1, 0.0), BODIES["triangle"]])
BALLS = ConvexBody.union([ConvexBody.sphere(0.2), _shifted(ConvexBody.sphere(0.3), 0.4, 0.0, 0.1)])
PAIRS = {"ell-box": (ELL, BODIES["box"]), "mixed-ell": (MIXED, ELL), "balls-balls": (BALLS, BALLS)}
SETTINGS = [
    {"gamma": 1, "shaping_length": 0.1, "normals": "paper"},
    {"gamma": 2, "shaping_length": 1e-3, "normals": "paper+edges"},
    {"gamma": 5, "shaping_length": 1e-2, "normals": "paper+centre"},
]


@pytest.fixture(params=PAIRS)
def union(request):
    """Return every pair of bodies, of which at least one is a union."""
    return PAIRS[request.param]


@pytest.fixture(params=SETTINGS, ids=lambda row: f"gamma {row['gamma']}")
def settings(request):
    """Return every combination of settings."""
    return request.param


@pytest.fixture
def poses(random_poses):
    """Return poses deep in each other, near and apart."""
    spreads = (0.05, 0.4, 3.0)
    return tuple(np.concatenate([random_poses(seed + k, COUNT, s) for k, s in enumerate(spreads)]) for seed in (1, 5))


def _scaled(found, factor):
    return Evaluation(found.value * factor, found.separation, found.gradient * factor, found.hessian * factor)


# --- the witnesses agree ----------------------------------------------------------------------------------------------


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", ["casadi", "graph"])
def test_casadi_agrees_with_numpy(name, union, settings, poses):
    found = [evaluator(witness, *union, **settings)(*poses) for witness in ("numpy", name)]
    agree(found[0], found[1], poses, union, settings["gamma"])


def test_compiled_agrees_with_numpy(poses):
    found = [evaluator(witness, BALLS, BALLS)(*poses) for witness in ("numpy", "compiled")]
    agree(found[0], found[1], poses, (BALLS, BALLS), 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["jax", "grad"])
def test_jax_agrees_with_numpy(name, union, poses):
    found = [evaluator(witness, *union, **SETTINGS[1])(*poses) for witness in ("numpy", name)]
    agree(found[0], found[1], poses, union, SETTINGS[1]["gamma"])


def test_jax_values_agree_with_numpy(poses):
    pytest.importorskip("jax")
    from hdplan.distance.batch.distance import hdsdf_batch

    batch = hdsdf_batch(BALLS, BALLS)
    value, least = batch.value(*poses)
    np.testing.assert_allclose(value, hdsdf(BALLS, poses[0], BALLS, poses[1]), rtol=1e-9, atol=1e-280)
    np.testing.assert_allclose(least, separation(BALLS, poses[0], BALLS, poses[1]), atol=1e-14)


def test_witness_normals_go_to_every_pair(poses):
    normals = np.random.default_rng(6).normal(size=(len(poses[0]), 2, 3))
    found = [evaluator(name, ELL, BODIES["box"], witness_count=2)(*poses, normals) for name in ("numpy", "casadi")]
    agree(found[0], found[1], poses, (ELL, BODIES["box"]), gamma=2)
    bare = evaluator("numpy", ELL, BODIES["box"])(*poses)
    assert np.all(found[0].value >= bare.value)


@pytest.mark.sampled(4)
def test_gradient_and_hessian_are_those_of_the_value(union, settings, poses):
    """Central differences along random twists."""
    body_a, body_b = union
    settings = settings | {"shaping_length": 0.1}
    twists, step = np.random.default_rng(3).normal(size=(len(poses[0]), 12)), 1e-6

    def at(side):
        moved = [
            pose @ np.array([_motion(side * step * row) for row in part])
            for pose, part in zip(poses, np.split(twists, 2, axis=1), strict=True)
        ]
        return hdsdf_derivatives(body_a, moved[0], body_b, moved[1], **settings)

    before, here, after = map(at, (-1.0, 0.0, 1.0))
    slope = np.einsum("ni,ni->n", here.gradient, twists)
    np.testing.assert_allclose((after.value - before.value) / (2 * step), slope, rtol=1e-5, atol=1e-9)
    if settings["gamma"] > 1:  # the gradient's change, less the frames' own turn: half the bracket, 0 along a twist
        curvature = np.einsum("ni,nij,nj->n", twists, here.hessian, twists)
        change = np.einsum("ni,ni->n", after.gradient - before.gradient, twists) / (2 * step)
        np.testing.assert_allclose(change, curvature, rtol=1e-4, atol=1e-5)


def _motion(twist):
    x, y, z = twist[:3]
    pose = place(x, y, z, Rotation.from_rotvec(twist[3:]))
    pose[:3, 3] += 0.5 * np.cross(twist[3:], twist[:3])  # to the second order
    return pose


# --- pieces -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["numpy", "casadi"])
def test_one_piece_is_itself_to_the_last_bit(name, poses):
    body_a, body_b = BODIES["box"], BODIES["swept triangle"]
    alone = evaluator(name, body_a, body_b)(*poses)
    united = evaluator(name, ConvexBody.union([body_a]), ConvexBody.union([body_b]))(*poses)
    for x, y in zip(alone, united, strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("name", ["numpy", "casadi"])
def test_neither_order_nor_grouping_of_pieces_matters(name, poses):
    one, two, three = MIXED.pieces
    ways = [[one, two, three], [three, one, two], [ConvexBody.union([three, two]), one]]
    first, *others = (evaluator(name, ConvexBody.union(way), ELL)(*poses) for way in ways)
    for other in others:
        agree(first, other, poses, (MIXED, ELL), 2)


@pytest.mark.sampled(17)
@pytest.mark.parametrize("name", ["numpy", "casadi"])
def test_copies_count_at_every_hard_pose(name, hard):
    """D of n equal pieces is n^(∓1/p) times the piece's, with all derivatives: touching, aligned, tiny and huge."""
    gamma, alone = 2, (hard.body_a, hard.body_b)
    united = ConvexBody.union([hard.body_a] * 3), hard.body_b
    one, many = (evaluator(name, *pair, gamma=gamma)(hard.pose_a, hard.pose_b) for pair in (alone, united))
    right = _scaled(one, 3.0 ** (np.sign(one.value) * -1.0 / (gamma + 1)))
    agree(right, many, (hard.pose_a, hard.pose_b), alone, gamma)
    assert np.sign(many.value) == np.sign(one.value)


@pytest.mark.slow
def test_copies_count_at_the_hard_poses_of_boxes_in_jax():
    for case in HARD:
        alone = case.body_a, case.body_b
        if [len(body.vertices) for body in alone] == [8, 8]:  # another kind compiles for seconds
            one = evaluator("numpy", *alone)(case.pose_a, case.pose_b)
            many = evaluator("jax", ConvexBody.union([case.body_a] * 3), case.body_b)(case.pose_a, case.pose_b)
            right = _scaled(one, 3.0 ** (np.sign(one.value) * -1.0 / 3))
            agree(right, many, (case.pose_a, case.pose_b), alone, gamma=2)


@pytest.mark.slow
def test_float32_as_far_as_its_digits_go(poses):
    found = evaluator("jax", ELL, BODIES["box"], dtype="float32")(*poses)
    right = evaluator("numpy", ELL, BODIES["box"])(*poses)
    clear = np.abs(right.separation) > 0.05
    assert clear.any()
    np.testing.assert_allclose(found.value[clear], right.value[clear], rtol=1e-3)
    np.testing.assert_allclose(found.separation, right.separation, atol=1e-5)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", ["numpy", "casadi"])
@pytest.mark.parametrize("case", HARD[::6], ids=lambda case: case.name)
def test_hard_poses_in_many_digits(name, case):
    """A second piece beside, in or far off the first; against 120 digits."""
    number = HARD.index(case)
    gamma = (1, 2, 4)[number % 3]
    size = case.body_a.reach + case.body_b.reach or 1.0
    other = _shifted(case.body_a, *(size * np.array([0.1, 0.3, 3.0])[number % 3] * np.array([0.6, -0.64, 0.48])))
    body_a = ConvexBody.union([case.body_a, other])
    scale = body_a.reach + case.body_b.reach + float(np.abs(case.pose_a[:3, 3] - case.pose_b[:3, 3]).max())
    twist = np.random.default_rng(1).normal(size=12) * np.repeat([scale, 1.0, scale, 1.0], 3)
    chosen = {"gamma": gamma, "shaping_length": (1e-6, 1e-3, 1.0)[number % 3]}
    right = truth(body_a, case.pose_a, case.body_b, case.pose_b, twist, digits=120, **chosen)
    found = evaluator(name, body_a, case.body_b, **chosen)(case.pose_a, case.pose_b)
    for part in found:
        assert np.all(np.isfinite(part))
    noise = ROUNDING * scale
    assert abs(found.separation - right.separation) <= noise
    if found.value != 0:
        assert np.sign(found.value) == np.sign(found.separation)
    relative = 4 * (gamma + 1) ** 2 * noise / max(abs(right.separation), 1e-300)
    if relative >= 0.5:  # the gap is nothing but rounding
        assert abs(found.value) <= noise
        return
    slopes, curvatures = found.gradient * twist, twist[:, None] * found.hessian * twist
    slope_scale = abs(right.value) + np.abs(slopes).sum()
    assert abs(found.value - right.value) <= relative * abs(right.value) + 1e-280
    assert abs(slopes.sum() - right.slope) <= relative * slope_scale + 1e-280
    if gamma > 1:
        assert abs(curvatures.sum() - right.curvature) <= relative * (slope_scale + np.abs(curvatures).sum()) + 1e-280


@pytest.mark.sampled(3)
@pytest.mark.parametrize("gamma", [32, 1, 2])
def test_a_hundred_pieces_overflow_nothing(gamma):
    """Pieces of all scales, near and far; D lies, as ``unions`` proves, at m = min D_kl or within N^(∓1/p) of it."""
    rng = np.random.default_rng(4)
    pieces = [
        _shifted(ConvexBody.sphere(10.0**power), *(rng.normal(size=3) * 10.0 ** (power + 1)))
        for power in np.linspace(-9, 6, 100)
    ]
    body_a, body_b = ConvexBody.union(pieces), ConvexBody.sphere(1e-3)
    poses = np.array([place(x) for x in (1e-8, 1.0, 1e8)])
    found = hdsdf_derivatives(body_a, poses, body_b, place(), gamma=gamma)
    for part in (found.value, found.gradient, found.hessian):
        assert np.all(np.isfinite(part))
    least = np.min([hdsdf(a, poses, b, place(), gamma=gamma) for a, b in pairs_of(body_a, body_b)], axis=0)
    bounds = np.sort([100.0 ** (-np.sign(least) / (gamma + 1)) * least, least], axis=0)
    slack = 1e-12 * np.abs(least)
    assert np.all((bounds[0] - slack <= found.value) & (found.value <= bounds[1] + slack))
    assert least.min() < 0 < least.max()


# --- safety -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rung", ["paper", "paper+edges"])
def test_unions_whose_pieces_touch_never_read_as_apart(union, rung):
    for piece_a, piece_b in pairs_of(*union):
        a, b = touching_poses(piece_a, piece_b, np.random.default_rng(1), 20)
        noise = ROUNDING * (union[0].reach + union[1].reach + np.abs([a, b]).max())
        assert separation(union[0], a, union[1], b, normals=rung).max() <= noise
        assert hdsdf(union[0], a, union[1], b, normals=rung, gamma=1, shaping_length=1e-9).max() <= 100 * noise


def test_positive_exactly_where_every_pair_is_and_then_apart(union, poses):
    body_a, body_b = union
    found = hdsdf(body_a, poses[0], body_b, poses[1], gamma=1, shaping_length=0.1)
    every = [hdsdf(a, poses[0], b, poses[1], gamma=1, shaping_length=0.1) for a, b in pairs_of(body_a, body_b)]
    np.testing.assert_array_equal(np.sign(found), np.sign(np.min(every, axis=0)))
    exact = signed_distances(body_a, poses[0], body_b, poses[1])
    assert np.any(found > 0)
    assert np.all(exact[found > 0] > 0)
    assert np.all(separation(body_a, poses[0], body_b, poses[1]) <= exact + 1e-8)


@pytest.mark.core
@pytest.mark.parametrize("name", ["numpy", "casadi"])
def test_symmetric_and_the_same_from_everywhere(name, poses, random_poses):
    settings = {"gamma": 3, "shaping_length": 0.01}
    there = evaluator(name, MIXED, ELL, **settings)(*poses)
    back = evaluator(name, ELL, MIXED, **settings)(*poses[::-1])
    swap = np.roll(np.arange(12), 6)
    back = back._replace(gradient=back.gradient[:, swap], hessian=back.hessian[:, swap][:, :, swap])
    agree(there, back, poses, (MIXED, ELL), 3)
    moved = [random_poses(10, 1, 3.0) @ pose for pose in poses]
    agree(there, evaluator(name, MIXED, ELL, **settings)(*moved), moved, (MIXED, ELL), 3)


# --- smoothness -------------------------------------------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize("gamma", [1, 2, 3])
@pytest.mark.parametrize(("gap", "reach"), [(0.4, 0.8), (0.05, 0.5)], ids=["past", "through"])
def test_differentiable_gamma_times_along_a_step(gamma, gap, reach):
    """A box moves past two pieces, one nearer and then the other, or through both of them. The gamma-th derivative's
    largest change between neighbours vanishes with their spacing, as of a pair."""
    block, box = ConvexBody.box([1.0, 1.0, 0.4]), ConvexBody.box([0.3, 0.3, 0.3])
    step = ConvexBody.union([block, _shifted(block, 0.9, 0.1, 0.0)])
    evaluate = evaluator("compiled", step, box, gamma=gamma, shaping_length=0.2)
    times, twist = np.linspace(-reach, reach, 1201 if gamma == 3 else 601), np.array([1.0, 0.05, 0.0, 0.0, 0.0, 0.2])
    xi = np.concatenate([np.zeros(6), twist])
    generator = np.zeros((4, 4))
    generator[:3, :3] = np.cross(np.eye(3), -twist[3:])
    generator[:3, 3] = twist[:3]

    def derivatives(at):
        found = evaluate(place(), place(0.3, 0.65 + gap) @ expm(at[:, None, None] * generator))
        return found.gradient @ xi, np.einsum("i,tij,j->t", xi, found.hessian, xi), found.value

    *rates, value = derivatives(times)
    assert (value.min() < 0.0 < value.max()) == (gap < 0.1)
    if gamma < 3:
        highest = rates[gamma - 1]
    else:
        near = 1e-6
        highest = (derivatives(times + near)[1] - derivatives(times - near)[1]) / (2 * near)
    coarse, fine = (np.abs(np.diff(highest[::k])).max() for k in (8, 1))
    assert fine <= 0.3 * coarse


# --- use --------------------------------------------------------------------------------------------------------------


def test_many_poses_are_those_one_by_one(poses):
    distance = hdsdf_compiled(BALLS, BALLS)
    at_once = distance.hessian(*poses)
    for k in range(len(poses[0])):
        for x, y in zip(at_once, distance.hessian(poses[0][k], poses[1][k]), strict=True):
            np.testing.assert_array_equal(x[k], y)


def test_exact_distances_are_the_least_of_the_pairs(poses):
    exact = signed_distances(MIXED, poses[0], ELL, poses[1])
    every = [signed_distances(a, poses[0], b, poses[1]) for a, b in pairs_of(MIXED, ELL)]
    np.testing.assert_array_equal(exact, np.min(every, axis=0))
    for k in range(0, len(exact), 5):
        one = signed_distance(MIXED, poses[0][k], ELL, poses[1][k])
        assert one.distance == exact[k]
        np.testing.assert_allclose(one.point_a - one.point_b, one.distance * one.normal, atol=1e-9)


def test_fcl_agrees(poses):
    pytest.importorskip("fcl")
    found = fcl_distances(BALLS, poses[0], BODIES["box"], poses[1])
    assert not found.aborted.any()
    np.testing.assert_allclose(found.distances, signed_distances(BALLS, poses[0], BODIES["box"], poses[1]), atol=1e-8)


def test_the_least_of_overlapping_pairs_is_above_the_signed_distance():
    """A cube is cut in two: a small one inside is 0.1 m deep in either half, but 0.6 m in the cube."""
    half = ConvexBody.box([0.5, 1.0, 1.0])
    cut = ConvexBody.union([_shifted(half, 0.25, 0, 0), _shifted(half, -0.25, 0, 0)])
    small = ConvexBody.box([0.2, 0.2, 0.2])
    least = signed_distance(cut, place(), small, place()).distance
    np.testing.assert_allclose(least, -0.1, atol=1e-12)
    assert least > signed_distance(ConvexBody.box([1, 1, 1]), place(), small, place()).distance
    assert separation(cut, place(), small, place()) <= least


def test_a_union_lists_its_pieces():
    assert ConvexBody.union([ELL, BODIES["box"]]).pieces == (*ELL.pieces, BODIES["box"])
    assert repr(ELL) == "<BodyUnion: 2 pieces>"
    grown = ELL.inflated(0.1)
    assert isinstance(grown, BodyUnion)
    assert [piece.radius for piece in grown.pieces] == [0.1, 0.1]
    pose = place(1.0, 0.2)
    inflated = signed_distance(grown, pose, BODIES["box"], place()).distance
    np.testing.assert_allclose(inflated, signed_distance(ELL, pose, BODIES["box"], place()).distance - 0.1, atol=1e-12)
    corners = np.vstack([piece.vertices for piece in ELL.pieces])
    assert np.linalg.norm(corners - ELL.centre, axis=1).max() == pytest.approx(ELL.reach)


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        ([], "pieces: found none, at least one is needed"),
        (BODIES["box"], "pieces: found <ConvexBody: 8 vertices>, allowed is a list of convex bodies"),
        (None, "pieces: found nothing, allowed is a list of convex bodies"),
        ([BODIES["box"], [BODIES["box"]]], r"pieces\[1\]: found a list of 1, allowed is a ConvexBody or a union"),
    ],
)
def test_invalid_unions_are_refused(pieces, words):
    with pytest.raises(InputError, match=words):
        ConvexBody.union(pieces)


@pytest.mark.parametrize(
    "refuse",
    [
        lambda: separating_axis_distance(ELL, place(), BODIES["box"], place()),
        lambda: gdf(BODIES["box"], place(), ELL, place()),
        lambda: CoalPair(ELL, BODIES["box"]),
        lambda: FclPair(ELL, BODIES["box"]),
        lambda: hdsdf(ELL, place(), "a box", place()),
        lambda: hdsdf_compiled(ELL, None),
    ],
)
def test_distances_that_take_no_union_or_no_body_say_so(refuse):
    with pytest.raises(InputError, match=r"^body_[ab]: .*(ConvexBody)"):
        refuse()
