"""Laws of the exact distance in C: it equals the oracle's on random and adversarial bodies, and its wrench is its
derivative; and the parts lie within the bodies."""

from __future__ import annotations

import pickle
from collections.abc import Sequence

import numpy as np
import pytest

from hdplan.distance.baselines.coal import signed_distance, signed_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.planner.build import build
from hdplan.planner.collision import exact as exact_pairs
from hdplan.planner.collision.broad_phase import body_pairs
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.collision.euclidean import FclPairs
from hdplan.planner.collision.exact import ExactPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_link_body, from_shape
from hdplan.planner.collision.hull_distance import distance_to_hull
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.problem import clearance
from hdplan.planner.problem.assemble import exactly
from hdplan.planner.problem.clearance import Clearance
from hdplan.planner.problem.samples import Samples
from hdplan.scenes.array_types import Array
from hdplan.scenes.shapes import Box, Cylinder, Ellipsoid, Sphere
from hdplan.scenes.yaml_format.reader import load_scene
from tests.loops import in_numpy, needs_loops

from . import test_euclidean
from .test_euclidean import NO_JOINTS, clutter, convex, free_bodies, moved, poses, smooth_motions

EXACT = 1e-7  # [m]
WIDE = 10.0  # [m] a margin that nothing is beyond, so that every distance is exact


def exact(bodies: Sequence[LinkBody], others: Sequence[HalfspaceBody]) -> ExactPairs:
    """Each body against the other of the same number."""
    pairs = body_pairs(bodies, others, [(k, k) for k in range(len(bodies))], WIDE, NO_JOINTS)
    return ExactPairs(pairs, bodies, others)


def everything(pairs: ExactPairs | FclPairs, at: Array) -> tuple[Array, Array]:
    """The distances (B, P) and their wrenches (B, P, 6) of all pairs at all poses (B, 4, 4)."""
    distance, wrench = test_euclidean.everything(pairs, at)
    return distance + WIDE, wrench


def truth_of(bodies: Sequence[LinkBody], others: Sequence[HalfspaceBody], at: Array) -> Array:
    """The oracle's distances (B, P); NaN of round bodies."""
    found = np.full((len(at), len(bodies)), np.nan)
    for k, (body, other) in enumerate(zip(bodies, others, strict=True)):
        if (shape := convex(other)) is not None:
            found[:, k] = signed_distances(body.body, at, shape, np.tile(other.placement, (len(at), 1, 1)))
    return found


@needs_loops
def test_the_distance_equals_the_oracles_on_random_bodies() -> None:
    bodies, others, at = free_bodies(60, 1), clutter(60, 2, spread=0.2), poses(30, 3, spread=0.3)
    (distance, wrench), truth = everything(exact(bodies, others), at), truth_of(bodies, others, at)
    known = np.isfinite(truth)
    np.testing.assert_allclose(distance[known], truth[known], rtol=0, atol=EXACT)
    np.testing.assert_allclose(np.linalg.norm(wrench[..., :3], axis=-1), 1.0, atol=1e-9)
    assert (distance < -0.01).sum() > 100
    assert (distance > 0.01).sum() > 100


@needs_loops
@pytest.mark.parametrize("count", [257, 1000, 4096])
def test_clusters_of_large_hulls_find_what_a_look_at_all_vertices_does(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points on a ball, on the two rims of a plate, and on a grid, where many are equally far; each with another."""
    rng, none = np.random.default_rng(count), np.empty((0, 3))
    ball = rng.normal(size=(count, 3))
    ball *= 0.1 / np.linalg.norm(ball, axis=1, keepdims=True)
    turn, side = rng.uniform(0.0, 2.0 * np.pi, count), np.linspace(-0.1, 0.1, int(np.ceil(count ** (1 / 3))))
    plate = np.stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), 0.01 * rng.choice([-1.0, 1.0], count)], axis=1)
    grid = np.stack(np.meshgrid(*3 * [side]), axis=-1).reshape(-1, 3)
    hulls = [ConvexBody(each, none, none, np.empty(0), 0.003) for each in (ball, plate, grid)]
    bodies = [LinkBody("link", 1, hull) for hull in 2 * hulls]
    planes = [from_link_body("link", 0, hull) for hull in hulls[1:] + hulls[:1]]
    others, at = [*clutter(3, count, spread=0.2), *planes], poses(60, count, spread=0.3)
    found = []
    for many in (exact_pairs.CLUSTERED_VERTICES, 10 * count):
        monkeypatch.setattr(exact_pairs, "CLUSTERED_VERTICES", many)
        exact_pairs._held.cache_clear()
        pairs = ExactPairs(body_pairs(bodies, others, [(k, k) for k in range(6)], WIDE, NO_JOINTS), bodies, others)
        clusters = pairs.record.fields[3]
        assert isinstance(clusters, np.ndarray)
        assert (clusters[:6] > 0).all() == (many < count)
        found.append(everything(pairs, at)[0])
    exact_pairs._held.cache_clear()
    np.testing.assert_allclose(*found, rtol=0, atol=1e-9)
    assert (found[0] < 0.0).any()
    assert (found[0] > 0.0).any()


@needs_loops
def test_round_bodies_are_round() -> None:
    """A ball beside, above, at the rim of and inside a cylinder, on an ellipsoid's axis, and in a ball."""
    ball = LinkBody("ball", 1, ConvexBody.sphere(0.05))
    shapes = (Cylinder(0.1, 0.4), Ellipsoid((0.1, 0.2, 0.3)), Sphere(0.1))
    pairs = exact((ball,) * 3, tuple(from_shape("post", shape, np.eye(4)) for shape in shapes))
    at = np.tile(np.eye(4), (5, 1, 1))
    at[:, :3, 3] = [[0.18, 0.24, 0.1], [0.03, 0.04, 0.3], [0.4, 0.0, 0.6], [0.03, 0.04, 0.0], [0.0, 0.0, 0.32]]
    distance, _ = everything(pairs, at)
    np.testing.assert_allclose(distance[:4, 0], [0.15, 0.05, 0.45, -0.1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(distance[4, 1:], [-0.03, 0.17], rtol=0, atol=1e-6)
    np.testing.assert_allclose(distance[3, 2], 0.05 - 0.15, rtol=0, atol=1e-6)


@needs_loops
@pytest.mark.parametrize("nudge", [0.0, 1e-12, 1e-9, 1e-7, 1e-5])
def test_parallel_touching_and_coinciding_boxes(nudge: float) -> None:
    """Faces, edges and corners that meet exactly, or nearly; cubes, plates and needles; and one centre."""
    rng = np.random.default_rng(11)
    sizes = rng.choice([0.001, 0.1, 0.2, 0.3], size=(40, 3))
    bodies = tuple(LinkBody("link", 1, ConvexBody.box(size)) for size in sizes)
    others = tuple(from_shape("box", Box(tuple(size)), np.eye(4)) for size in rng.permutation(sizes))
    at = np.tile(np.eye(4), (40, 1, 1))
    at[:, :3, 3] = rng.choice([0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3], size=(40, 3)) + nudge * rng.normal(size=(40, 3))
    distance, wrench = everything(exact(bodies, others), at)
    assert np.isfinite(wrench).all()
    np.testing.assert_allclose(np.linalg.norm(wrench[..., :3], axis=-1), 1.0, atol=1e-9)
    halves = (sizes + np.array([other.half_size * 2 for other in others])) / 2
    apart = np.abs(at[:, None, :3, 3]) - halves[None]
    inside = apart.max(axis=2)
    truth = np.where(inside < 0.0, inside, np.linalg.norm(np.maximum(apart, 0.0), axis=2))
    np.testing.assert_allclose(distance, truth, rtol=0, atol=EXACT)


@needs_loops
def test_boxes_on_edge_and_slanted() -> None:
    """Turned by multiples of 45 and of 30 degrees about the axes, where edges meet edges and corners faces."""
    rng = np.random.default_rng(12)
    body, other = ConvexBody.box([0.2, 0.1, 0.05]), from_shape("box", Box((0.1, 0.2, 0.3)), np.eye(4))
    at = []
    for _ in range(300):
        axis, angle = rng.choice([-1.0, 0.0, 1.0], size=3), rng.choice([np.pi / 4, np.pi / 2, np.pi / 6])
        if not axis.any():
            axis = np.array([0.0, 0.0, 1.0])
        pose = moved(np.eye(4)[None], np.zeros(3), axis / np.linalg.norm(axis) * angle, 1.0)[0]
        pose[:3, 3] = rng.choice([-0.1, 0.0, 0.05, 0.1, 0.2], size=3)
        at.append(pose)
    distance, _ = everything(exact((LinkBody("link", 1, body),), (other,)), np.array(at))
    truth = [signed_distance(body, pose, convex(other), np.eye(4)).distance for pose in at]
    np.testing.assert_allclose(distance[:, 0], truth, rtol=0, atol=EXACT)


@needs_loops
def test_the_wrench_is_coals_and_the_distances_derivative() -> None:
    """Three ways, away from kinks."""
    bodies, others, at = free_bodies(40, 4), clutter(40, 5, spread=0.2), poses(10, 6, spread=0.4)
    pairs = exact(bodies, others)
    wrench, by_coal = everything(pairs, at)[1], everything(FclPairs(pairs.pairs, bodies, others), at)[1]
    for velocity, smooth in smooth_motions(pairs, at, 1e-5, 1e-3):
        assert np.mean(np.abs((wrench - by_coal) @ velocity)[smooth] < 1e-3) > 0.99


@needs_loops
def test_beyond_the_margin_it_says_no_more_than_that() -> None:
    bodies, others, at = free_bodies(40, 8), clutter(40, 9, spread=0.2), poses(20, 10, spread=0.4)
    far, (truth, _) = exact(bodies, others).enlarged(0.01 - WIDE), everything(exact(bodies, others), at)
    found = everything(far, at)[0] - WIDE
    close = truth < 0.01
    np.testing.assert_allclose(found[close], truth[close] - 0.01, rtol=0, atol=EXACT)
    assert (found[~close] >= -EXACT).all()
    assert (found <= truth - 0.01 + EXACT).all()


@needs_loops
def test_queries_with_nan_terminate() -> None:
    pairs, at = exact(free_bodies(3, 8), clutter(3, 9)), poses(2, 10, spread=0.4)
    at[:] = np.nan
    assert not (everything(pairs, at)[0] > 0.0).any()


@pytest.mark.parametrize("name", ["panda_cage", "panda_carry"])
def test_the_problem_with_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loop and twin agree, a batch is a loop, the penalty's gradient is its derivative, and no exact distance is below
    what the HD-SDF says of the bodies."""
    loose = build(load_scene(name))
    problem = exactly(loose)
    assert exactly(problem) is problem
    assert pickle.loads(pickle.dumps(problem)).depth(problem.start[None]) == problem.depth(problem.start[None])
    drawn = problem.robot.draw(np.random.default_rng(0), 12)
    kinematics, samples = problem.placed(drawn), Samples((1,) * 12)
    assert (problem.depth(drawn) <= loose.depth(drawn) + EXACT).all()
    found = {term.name: term.at_samples(kinematics, samples) for term in problem.terms if isinstance(term, Clearance)}
    assert found
    for term in problem.terms:
        if not isinstance(term, Clearance):
            continue
        penalty = found[term.name]
        single = [term.at_samples(problem.placed(q[None]), Samples((1,))) for q in drawn]
        np.testing.assert_allclose(penalty.depth, [each.depth[0] for each in single], atol=EXACT)
        step, turn = 1e-6, np.random.default_rng(1).normal(size=drawn.shape)
        ahead, behind = (term.at_samples(problem.placed(drawn + s * step * turn), samples).cost for s in (1, -1))
        slope = float(np.sum(penalty.gradient * turn))
        assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-3, abs=1e-6)
    in_numpy(monkeypatch, clearance, exact_pairs)
    for term in problem.terms:
        if isinstance(term, Clearance):
            monkeypatch.setitem(vars(term), "record", None)
            twin, penalty = term.at_samples(kinematics, samples), found[term.name]
            assert twin.cost == pytest.approx(penalty.cost, rel=1e-6, abs=1e-12)
            np.testing.assert_allclose(twin.depth, penalty.depth, atol=1e-6)


@pytest.mark.parametrize("name", ["panda_carry", "ur5_table"])
def test_parts_lie_within_their_bodies(name: str) -> None:
    problem = build(load_scene(name))
    settings = problem.scene.planner
    model = collision_model_of(problem.robot, settings.link_bodies, settings.normals)
    for part, body in zip(model.parts, problem.bodies, strict=True):
        assert (part.link, part.joint) == (body.link, body.joint)
        beyond, _ = distance_to_hull(part.body.vertices, body.body.vertices)
        assert (beyond <= body.body.radius + 1e-6).all()
