"""Laws of terms, problem and its CasADi form: two witnesses of one cost, no term without a cause.

That the gradient is that of the cost is in test_solver_laws.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hdplan.distance.symbolic import row_function
from hdplan.planner.build import build
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.clearance import PairTerm
from hdplan.planner.problem.problem import SPACING, Problem
from hdplan.planner.problem.samples import MOST_SAMPLES, Samples
from hdplan.planner.problem.smoothness import Smoothness
from hdplan.planner.problem.terms import MotionPenalty, Penalty, Term
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle, SelfCollision
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Cylinder, Points, Shape, Sphere
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.problem.whole_graph import WholeGraph, whole_graph, whole_matrix

from ..urdf import joint_text, link_text, write_robot

# Relative to the largest number compared, unless noted.
WITNESS = 1e-10  # the fast evaluation against CasADi's: sums in another order, constants rounded alike
DIFFERENCE = 1e-8  # sixth-order differences: the distance bends over 1 mm, so their error is (STEP / 1 mm)⁶
STEP = 1e-5  # [rad]
SEMIDEFINITE = 1e-12  # most negative eigenvalue of a sum of outer products
EXACT = 1e-12
WIDE = SelfCollision(clearance=0.2)  # more than the planar arm's links are proven to keep anyway
WEIGHT = 1e4  # of the penalty [1/m²]: smoothness and penalty weigh about the same


def few_waypoints(scene: Scene, count: int) -> Scene:
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=count))


@pytest.fixture(scope="module")
def planar() -> Problem:
    """Two links that are to keep far apart, obstacles of both sizes of plane tables."""
    return build(few_waypoints(dataclasses.replace(load_scene("planar_arm"), self_collision=WIDE), 7))


@pytest.fixture(scope="module")
def panda() -> Problem:
    return build(few_waypoints(load_scene("panda_corridor"), 6))


@pytest.fixture(scope="module")
def whole(planar: Problem) -> WholeGraph:
    return whole_graph(planar)


def penalty(scene: Scene, configurations: Array) -> float:
    problem = build(scene)
    waypoints = dataclasses.replace(problem.samples, counts=(1,) * len(configurations))
    kinematics = problem.kinematics.evaluate(configurations)
    return problem.terms.obstacles.at_samples(kinematics, waypoints).cost


@pytest.mark.parametrize("distance", ["hdsdf", "fcl"])
def test_each_obstacle_has_its_own_clearance(distance: str) -> None:
    """The penalty is the sum of what each obstacle costs alone, with its clearance the planner's."""
    scene = load_scene("planar_arm")
    ball, prism = (dataclasses.replace(obstacle, clearance=None) for obstacle in scene.obstacles)
    settings = dataclasses.replace(scene.planner, distance=distance)
    q = build(scene).robot.draw(np.random.default_rng(3), 200)

    def alone(obstacle: Obstacle, clearance: float) -> float:
        kept = dataclasses.replace(settings, clearance=clearance)
        return penalty(dataclasses.replace(scene, obstacles=(obstacle,), planner=kept), q)

    both = (dataclasses.replace(ball, clearance=0.1), dataclasses.replace(prism, clearance=0.02))
    whole = penalty(dataclasses.replace(scene, obstacles=both, planner=settings), q)
    assert whole == pytest.approx(alone(ball, 0.1) + alone(prism, 0.02), rel=1e-12)
    assert alone(ball, 0.1) > 1.5 * alone(ball, 0.0) > 0.0
    stated = tuple(dataclasses.replace(obstacle, clearance=0.0) for obstacle in (ball, prism))
    unsaid = dataclasses.replace(scene, obstacles=(ball, prism), planner=settings)
    assert penalty(dataclasses.replace(unsaid, obstacles=stated), q) == penalty(unsaid, q)


def test_links_keep_the_clearance_that_the_scene_asks_of_them() -> None:
    scene = load_scene("panda_cage")
    found = []
    for clearance in (0.0, 0.05):
        problem = build(dataclasses.replace(scene, self_collision=SelfCollision(clearance=clearance)))
        own = problem.terms.self_collision
        found.append(own.pairs.margins)
    np.testing.assert_allclose(found[1], found[0] + 0.05, atol=1e-15)


def motions(problem: Problem, count: int, spread: float) -> list[Array]:
    """Motions around the straight line, from the start to the goal, some of them in contact."""
    rng = np.random.default_rng(1)
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    return [problem.clip(line + spread * rng.normal(size=line.shape)) for _ in range(count)]


def differences(function, x: Array) -> Array:
    """Sixth-order central differences of a function of x (m,), along the last axis."""

    def along(unit: Array) -> Array:
        near, far, farthest = (function(x + k * STEP * unit) - function(x - k * STEP * unit) for k in (1, 2, 3))
        return np.asarray((45 * near - 9 * far + farthest) / (60 * STEP))

    return np.stack([along(unit) for unit in np.eye(len(x))], axis=-1)


def close(found: Array, expected: Array, tolerance: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1.0, float(np.abs(expected).max())))


# --- smoothness -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [3, 4, 9])
def test_smoothness_is_the_sum_that_it_says(count: int) -> None:
    """½ Σ h |(q_{k+1} − q_k)/h|² + ½ α Σ h |(q_{k+1} − 2 q_k + q_{k−1})/h²|², h = 1/(N − 1)."""
    smoothness = Smoothness(count, acceleration=0.03)
    q, h = np.random.default_rng(2).normal(size=(count, 3)), 1 / (count - 1)
    velocity = sum(0.5 * h * np.sum(((q[k + 1] - q[k]) / h) ** 2) for k in range(count - 1))
    second_order = sum(0.5 * h * np.sum(((q[k + 1] - 2 * q[k] + q[k - 1]) / h**2) ** 2) for k in range(1, count - 1))
    value, gradient = smoothness.value(q)
    assert value == pytest.approx(velocity + 0.03 * second_order, rel=EXACT)
    assert np.sum(0.5 * q * (smoothness.matrix @ q)) == pytest.approx(value, rel=EXACT)
    close(gradient, smoothness.matrix @ q, EXACT)
    close(smoothness.matrix, smoothness.matrix.T, EXACT)


def test_smoothness_sees_no_place_and_meets_two_neighbours() -> None:
    matrix = Smoothness(9, 0.01).matrix
    close(matrix @ np.ones(9), np.zeros(9), 1e-10)
    assert np.all(np.linalg.eigvalsh(matrix[1:-1, 1:-1]) > 0)
    assert np.all(np.triu(matrix, 3) == 0)


# --- cost and derivatives ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["planar", "panda"])
def test_parts_of_an_evaluation_agree(
    name: str, request: pytest.FixtureRequest, penalties: Callable[[Problem, Array], Array]
) -> None:
    """cost = smoothness + w penalty; the penalty is the weighted sum over samples; depth is that of the samples."""
    problem: Problem = request.getfixturevalue(name)
    for positions in motions(problem, 4, 0.3):
        state = problem.evaluate(positions, WEIGHT)
        assert state.cost == pytest.approx(state.smoothness + WEIGHT * state.penalty, rel=EXACT)
        looks = problem.samples.configurations(positions)
        assert state.penalty == pytest.approx(np.sum(problem.samples.weight * penalties(problem, looks)), rel=EXACT)
        np.testing.assert_array_equal(state.depth, problem.depth(looks))
        assert np.all(state.depth >= 0)
        assert np.all((penalties(problem, looks) == 0) | (state.depth > 0))


@pytest.mark.parametrize("name", ["planar", "panda"])
def test_curvature_is_symmetric_and_semidefinite(name: str, request: pytest.FixtureRequest) -> None:
    problem: Problem = request.getfixturevalue(name)
    for positions in motions(problem, 4, 0.3):
        state = problem.evaluate(positions, WEIGHT)
        close(state.diagonal, state.diagonal.transpose(0, 2, 1), EXACT)
        matrix = whole_matrix(state.diagonal, state.coupling)
        lowest = np.linalg.eigvalsh(matrix)[0]
        assert lowest >= -SEMIDEFINITE * max(1.0, np.abs(matrix).max()) * len(matrix)


def test_penalty_scales_with_its_weight_alone(planar: Problem) -> None:
    (positions,) = motions(planar, 1, 0.3)
    one, ten = planar.evaluate(positions, 1.0), planar.evaluate(positions, 10.0)
    assert (one.smoothness, one.penalty) == (ten.smoothness, ten.penalty)
    close(10 * one.diagonal, ten.diagonal, EXACT)
    close(10 * one.coupling, ten.coupling, EXACT)


# --- the CasADi form --------------------------------------------------------------------------------------------------


@pytest.mark.core
@pytest.mark.parametrize(("name", "weights"), [("planar", (1.0, WEIGHT, 1e7)), ("panda", (WEIGHT,))])
def test_casadi_form_has_the_same_cost_and_gradient(
    name: str, weights: tuple[float, ...], request: pytest.FixtureRequest
) -> None:
    problem: Problem = request.getfixturevalue(name)
    whole = whole_graph(problem)
    evaluate = ca.Function("evaluate", [whole.x, whole.weight], [whole.cost, whole.gradient])
    for weight, positions in itertools.product(weights, motions(problem, 6, 0.4)):
        state = problem.evaluate(positions, weight)
        cost, gradient = (np.array(x).ravel() for x in evaluate(positions[1:-1].ravel(), weight))
        close(cost, np.array([state.cost]), WITNESS)
        close(gradient, state.gradient.ravel(), WITNESS)


def test_casadi_hessian_is_that_of_the_gradient(planar: Problem, whole: WholeGraph) -> None:
    evaluate = ca.Function("evaluate", [whole.x, whole.weight], [whole.cost, whole.gradient, whole.hessian])
    for positions in motions(planar, 3, 0.3):
        x = positions[1:-1].ravel()
        _, _, hessian = (np.array(part) for part in evaluate(x, WEIGHT))
        close(hessian, hessian.T, WITNESS)
        close(hessian, differences(lambda y: np.array(evaluate(y, WEIGHT)[1]).ravel(), x), DIFFERENCE)


def arm(side: str, y: float, kind: str, axis: str) -> tuple[str, ...]:
    upper, fore, reach = f"{side}_upper", f"{side}_fore", {"limits": (-3.0, 3.0)}
    return (
        *(link_text(name, box="0.44 0.06 0.04", at="0.22 0 0") for name in (upper, fore)),
        joint_text(f"{side}_yaw", "base", upper, at=f"0 {y} 0", **reach, velocity=2, effort=9),
        joint_text(f"{side}_next", upper, fore, axis, kind=kind, at="0.4 0 0.02", **reach, velocity=2, effort=9),
    )


TWO_ARMS = link_text("base"), *arm("left", 0.1, "revolute", "0 1 0"), *arm("right", -0.1, "prismatic", "1 0 0")


@pytest.fixture
def two_arms(tmp_path: Path) -> Problem:
    """Boxes along the axes, at an obstacle that is one too; in half of the pairs both bodies move, on two branches."""
    urdf = write_robot(tmp_path / "two_arms.urdf", *TWO_ARMS)
    ends = (JointTarget(name, (0.0, 0.0, 0.0, 0.0)) for name in ("start", "goal"))
    obstacle = Obstacle("beam", Box((0.3, 0.1, 0.1)), Pose((0.5, 0.0, 0.05)))
    return build(
        Scene(
            "two arms",
            tmp_path / "scene.yaml",
            RobotSpec(urdf=urdf),
            (obstacle,),
            *ends,
            planner=PlannerSettings(waypoints=4),
            self_collision=WIDE,
        )
    )


def test_casadi_derivatives_are_those_of_the_cost_where_boxes_are_aligned(two_arms: Problem) -> None:
    """There projections tie, and both orders have to be closed forms."""
    assert {-1.0, 1.0} <= set(np.concatenate([term.pairs.moves.ravel() for term in two_arms.terms.pairs]))
    whole = whole_graph(two_arms)
    given = [whole.x, whole.weight]
    cost, slope = (ca.Function("part", given, [part]) for part in (whole.cost, whole.gradient))
    evaluate = ca.Function("evaluate", given, [whole.gradient, whole.hessian])
    rng = np.random.default_rng(4)
    for number in range(8):
        turns = rng.uniform(-0.8, 0.8, (2, 3)) if number % 2 else rng.choice([-np.pi / 2, 0.0, np.pi / 2], (2, 3))
        x = np.column_stack([turns, rng.choice([0.0, 0.1, 0.3], 2)]).ravel()
        first, second = (np.array(part) for part in evaluate(x, WEIGHT))
        close(first.ravel(), differences(lambda y: float(cost(y, WEIGHT)), x), DIFFERENCE)
        close(second, differences(lambda y: np.array(slope(y, WEIGHT)).ravel(), x), DIFFERENCE)
    with pytest.raises(RuntimeError, match="cannot be calculated for jac_jac_samples"):
        ca.jacobian(ca.vec(whole.hessian), whole.x)


def test_hessian_is_banded(planar: Problem, whole: WholeGraph) -> None:
    """The penalty joins neighbours only; beyond them stands smoothness' second neighbour, and nothing further off."""
    n = planar.robot.n
    hessian = ca.Function("hessian", [whole.x, whole.weight], [whole.hessian])
    (positions,) = motions(planar, 1, 0.3)
    full = np.array(hessian(positions[1:-1].ravel(), WEIGHT))
    blocks = full.reshape(planar.waypoints - 2, n, planar.waypoints - 2, n).transpose(0, 2, 1, 3)
    smooth = planar.smoothness.matrix[1:-1, 1:-1]
    for row in range(len(blocks)):
        for column in range(len(blocks)):
            if abs(row - column) >= 2:
                close(blocks[row, column], smooth[row, column] * np.eye(n), EXACT)
    assert full.shape[0] == whole.hessian.sparsity().size1()
    assert whole.hessian.sparsity().nnz() <= (5 * len(blocks) - 6) * n * n


# --- what a problem holds ---------------------------------------------------------------------------------------------


def bare(*obstacles: Obstacle, ignore: bool = False, wide: bool = False) -> Scene:
    """The planar arm with other obstacles; `ignore` leaves out its one pair of links that are not neighbours, `wide`
    asks of them more than what is proven anyway."""
    scene = load_scene("planar_arm")
    robot = dataclasses.replace(scene.robot, ignore_pairs=(("pedestal", "forearm"),) if ignore else ())
    return dataclasses.replace(
        scene, obstacles=obstacles, robot=robot, self_collision=WIDE if wide else SelfCollision()
    )


FAR_AWAY = Obstacle("far", Box((1.0, 1.0, 1.0)), Pose((5.0, 0.0, 0.0)))
NEAR = Obstacle("near", Sphere(0.1), Pose((0.0, 0.9, 0.1)))


@pytest.mark.parametrize(
    ("scene", "names"),
    [
        (bare(), []),
        (bare(ignore=True, wide=True), []),
        (bare(FAR_AWAY), []),
        (bare(wide=True), ["self-collision"]),
        (bare(FAR_AWAY, wide=True), ["self-collision"]),
        (bare(NEAR), ["obstacles"]),
        (bare(NEAR, FAR_AWAY, wide=True), ["obstacles", "self-collision"]),
    ],
    ids=["nothing", "ignored", "out of reach", "links", "links, out of reach", "obstacle", "both"],
)
def test_terms_exist_where_the_scene_calls_for_them(scene: Scene, names: list[str]) -> None:
    problem = build(scene)
    assert [term.name for term in problem.terms] == names
    for positions in motions(problem, 2, 0.2):
        state = problem.evaluate(positions, WEIGHT)
        assert np.isfinite(state.cost)
        if not names:
            assert (state.penalty, state.depth.max()) == (0, 0)


def test_obstacles_out_of_reach_are_in_no_pair() -> None:
    alone, more = build(bare(NEAR)), build(bare(NEAR, FAR_AWAY, dataclasses.replace(FAR_AWAY, name="other")))
    assert len(more.halfspace_bodies) == len(alone.halfspace_bodies) + 2
    for one, other in zip(alone.terms, more.terms, strict=True):
        assert isinstance(one, PairTerm)
        assert isinstance(other, PairTerm)
        assert len(one.pairs) == len(other.pairs)


def test_bodies_of_the_base_are_in_no_pair_with_obstacles() -> None:
    """A base that stands in the floor is nobody's business: it cannot move."""
    problem = build(bare(Obstacle("floor", Box((4.0, 4.0, 0.1)), Pose((0.0, 0.0, -0.02)))))
    term = problem.terms.obstacles
    assert np.all(term.pairs.joint_a > 0)


def test_clip_keeps_ends_and_limits(planar: Problem) -> None:
    wild = np.random.default_rng(3).normal(size=(planar.waypoints, planar.robot.n)) * 10
    before = wild.copy()
    clipped = planar.clip(wild)
    np.testing.assert_array_equal(wild, before)
    np.testing.assert_array_equal(clipped[[0, -1]], [planar.start, planar.goal])
    assert np.all((clipped >= planar.robot.lower) & (clipped <= planar.robot.upper))
    inside = (wild >= planar.robot.lower) & (wild <= planar.robot.upper)
    np.testing.assert_array_equal(clipped[1:-1][inside[1:-1]], wild[1:-1][inside[1:-1]])


def test_refined_looks_more_often_on_the_named_intervals_only(planar: Problem) -> None:
    counts = np.array(planar.samples.counts)
    finer = planar.refined([1, 4])
    expected = counts.copy()
    expected[[1, 4]] *= 2
    np.testing.assert_array_equal(finer.samples.counts, expected)
    assert planar.samples.counts == tuple(counts)
    assert planar.refined([]).samples == planar.samples
    (positions,) = motions(planar, 1, 0.3)
    assert finer.evaluate(positions, 1.0).smoothness == planar.evaluate(positions, 1.0).smoothness


def test_resampled_leaves_no_wide_gap_between_samples(panda: Problem) -> None:
    for positions in motions(panda, 3, 0.2):
        resampled = panda.resampled(positions)
        counts = np.array(resampled.samples.counts)
        assert np.all(counts >= panda.samples.counts)
        batch = panda.kinematics.evaluate(positions)
        for body in panda.bodies:
            centre = body.body.vertices.mean(axis=0)
            places = batch.rotations[:, body.joint] @ centre + batch.translations[:, body.joint]
            steps = np.linalg.norm(np.diff(places, axis=0), axis=1) / counts
            assert np.all((steps <= SPACING * (1 + EXACT)) | (counts == MOST_SAMPLES))


def test_a_robot_without_collision_geometry_is_planned_for(stick_scene: Callable[[Obstacle], Scene]) -> None:
    """Nothing can touch it: no bodies, no terms."""
    problem = build(stick_scene(NEAR))
    assert (problem.bodies, list(problem.terms)) == ((), [])
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    assert problem.resampled(line).samples == problem.samples
    assert problem.evaluate(line, WEIGHT).penalty == 0


def test_link_pairs_left_to_the_certificate_are_in_no_term() -> None:
    for name in ("panda_cage", "ur5_table"):
        problem = build(load_scene(name))
        terms = [term for term in (problem.terms.self_collision,) if term]
        for pairs in (term.pairs for term in terms):
            met = {
                frozenset((problem.bodies[a].link, problem.bodies[b].link))
                for a, b in zip(pairs.body.tolist(), pairs.halfspace_body.tolist(), strict=True)
            }
            assert met.isdisjoint(frozenset(pair) for pair in problem.unresolved)
            apart = {frozenset(problem.bodies[index].link for index in pair) for pair in problem.apart}
            unresolved = {frozenset(pair) for pair in problem.unresolved}
            assert met | unresolved | apart == {frozenset(pair) for pair in problem.robot.self_pairs}


SIMPLEX = Points(((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))


@pytest.mark.parametrize("shape", [Sphere(0.1), Cylinder(0.1, 0.2), SIMPLEX])
def test_another_obstacle_compiles_nothing(monkeypatch: pytest.MonkeyPatch, shape: Shape) -> None:
    """Obstacles of any shape, anywhere: within reach of every link, or of the last one only."""
    scene = load_scene("panda_corridor")
    one = dataclasses.replace(scene, obstacles=(Obstacle("far", Box((0.1, 0.1, 0.1)), Pose((0.0, 0.0, 1.25))),))
    build(one)
    compiled: list[object] = []
    monkeypatch.setattr(row_function, "_library", lambda function: compiled.append(function))
    for place in ((0.4, 0.2, 0.3), (0.0, 0.9, 0.4), (0.0, 0.0, 1.3)):
        build(dataclasses.replace(one, obstacles=(*one.obstacles, Obstacle("more", shape, Pose(place)))))
    assert not compiled


class Push(Term):
    """A term of one's own at samples and over the motion: both linear."""

    name = "push"

    def __init__(self, slope: float) -> None:
        self.slope = slope

    def at_samples(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty:
        count, n = kinematics.columns.shape[:2]
        zero = np.zeros((count, n))
        return Penalty(self.slope, zero + self.slope, np.zeros((count, n, n)), zero[:, 0])

    def over_motion(self, positions: Array, kinematics: Kinematics) -> MotionPenalty:
        count, n = positions.shape
        blocks = np.zeros((count, n, n))
        return MotionPenalty(self.slope, 0 * positions + self.slope, blocks, blocks[1:], np.zeros(count - 1))


def test_terms_of_ones_own_add_to_the_cost_what_they_are_worth(panda: Problem) -> None:
    (positions,) = motions(panda, 1, 0.2)
    plain = panda.evaluate(positions, WEIGHT)
    both = panda.with_term(Push(2.0)).with_term(Push(-0.5)).evaluate(positions, WEIGHT)
    assert both.penalty == pytest.approx(plain.penalty + 2 * 1.5)
    batch, n = len(panda.samples.weight), panda.robot.n
    carried, _, _ = panda.samples.to_waypoints(np.full((batch, n), 1.5), np.zeros((batch, n, n)))
    np.testing.assert_allclose(both.gradient, plain.gradient + WEIGHT * (carried[1:-1] + 1.5))
    assert [term.name for term in panda.with_term(Push(1.0)).terms] == [*(term.name for term in panda.terms), "push"]
