"""Laws of the controller: exact barriers, the best command, no contact, honest stops, refused settings."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls

from hdplan import ConvexBody, InputError, Obstacle, Pose, Robot, RobotSpec, Scene, SteadyMotion, Trajectory
from hdplan.control import Barriers, BarrierSettings, Controller, ControlSettings, Mode, scene_barriers
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.numpy_reference.hdsdf import hdsdf, hdsdf_derivatives
from hdplan.distance.symbolic.graph_distance import hdsdf_function
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.collision.box_pairs import BoxPairs
from hdplan.planner.collision.halfspace_bodies import from_obstacle
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.control.barrier_safety import (
    separation_bound,
    shaped,
    straightened,
    sufficient_separation,
    touching_value,
    unshaped,
)
from hdplan.planner.control.braking import USED_SHARE, Command
from hdplan.planner.control.program_rows import NEAR_DISTANCE
from hdplan.planner.control.quadratic_program import SoftConstraints, best_velocity
from hdplan.planner.control.rollout import fast_energy, simulate, total_variation
from hdplan.planner.control.tasks import PoseTask, TrackTask, standing
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Points, Sphere
from hdplan.scenes.targets import JointTarget, PoseTarget

READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
DISTANCES = (
    BarrierSettings(),
    BarrierSettings("hdsdf-boxes", shaping_length=0.03, normals="paper"),
    BarrierSettings("hdsdf-boxes", shaping_length=0.01, normals="paper-multiset"),
    BarrierSettings("euclidean"),
    BarrierSettings("gdf"),
)


def scene_of(*obstacles: Obstacle) -> Scene:
    ends = [JointTarget(name, READY) for name in ("start", "goal")]
    return Scene("room", Path("room.yaml"), RobotSpec("panda"), obstacles, *ends)


def random_boxes(rng: np.random.Generator, count: int) -> tuple[Obstacle, ...]:
    return tuple(Obstacle(f"box{k}", Box(tuple(rng.uniform(0.05, 0.3, 3))), random_pose(rng)) for k in range(count))


def random_pose(rng: np.random.Generator) -> Pose:
    turn, direction = rng.normal(size=4), rng.normal(size=3)
    where = direction / np.linalg.norm(direction) * rng.uniform(0.35, 0.9)
    return Pose((where[0], where[1], abs(where[2]) + 0.1), tuple(turn / np.linalg.norm(turn)))


def directions(count: int) -> Array:
    """Directions (count, 3) that are spread evenly."""
    index = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * index / count), np.pi * (1.0 + math.sqrt(5.0)) * index
    return np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_scene_robot(scene_of())


# --- gradients, three ways ---------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", DISTANCES, ids=lambda s: f"{s.distance}-{s.normals}")
def test_gradients_are_those_of_finite_differences(settings: BarrierSettings, robot: Robot) -> None:
    rng = np.random.default_rng(1)
    barriers = scene_barriers(scene_of(*random_boxes(rng, 4)), robot, settings)
    step, loose = (1e-4, 2e-2) if settings.distance == "gdf" else (1e-6, 1e-5)  # the GDF's iteration ends roughly
    errors = []
    for q in robot.draw(rng, 4):
        rows = barriers.evaluate(q)
        for j, unit in enumerate(np.eye(robot.n)):
            ahead, behind = barriers.evaluate(q + step * unit).value, barriers.evaluate(q - step * unit).value
            errors.append(np.abs((ahead - behind) / (2 * step) - rows.gradient[:, j]))
    # exact distances have kinks, and the GDF none where bodies meet: a few differences may straddle one
    assert np.quantile(np.concatenate(errors), 0.99) < loose
    if settings.distance.startswith("hdsdf"):
        assert np.max(errors) < loose


@pytest.mark.sampled(2)
@pytest.mark.parametrize("normals", ["paper", "paper-multiset"])
def test_gradients_are_those_of_casadi(normals: str, robot: Robot) -> None:
    rng = np.random.default_rng(2)
    kinematics, sides = kinematics_of(robot), np.array([0.08, 0.12, 0.2])
    obstacle = Obstacle("wall", Box((0.3, 0.1, 0.4)), random_pose(rng))
    settings = BarrierSettings("hdsdf-boxes", 2, 0.02, 0.0, 0.0, normals)
    body = LinkBody("panda_link5", 5, ConvexBody.box(sides))
    barriers = Barriers(robot, kinematics, [body], [], from_obstacle(obstacle)[0], settings)

    distance = hdsdf_function(
        ConvexBody.box(sides), ConvexBody.box([0.3, 0.1, 0.4]), gamma=2, shaping_length=0.02, normals=normals
    )
    q = ca.MX.sym("q", robot.n)
    turns, origins = kinematics.function(q)
    pose = ca.vertcat(ca.horzcat(turns[:, 15:18], origins[:, 5]), ca.DM([[0, 0, 0, 1]]))
    value = distance(pose, obstacle.pose.matrix)
    automatic = ca.Function("automatic", [q], [value, ca.jacobian(value, q)])
    for configuration in robot.draw(rng, 20):
        rows = barriers.evaluate(configuration)
        expected, gradient = automatic(configuration)
        np.testing.assert_allclose(rows.value, np.array(expected).ravel(), atol=1e-12)
        np.testing.assert_allclose(rows.gradient, np.array(gradient), atol=1e-10)


@pytest.mark.core
def test_gradients_are_those_of_the_reference(robot: Robot) -> None:
    """NumPy's closed form by the body's twist, times Pinocchio's own Jacobian: nothing shared with the kernels."""
    rng = np.random.default_rng(9)
    box, obstacle = ConvexBody.box([0.08, 0.12, 0.2]), Obstacle("wall", Box((0.3, 0.1, 0.4)), random_pose(rng))
    wall, data = ConvexBody.box([0.3, 0.1, 0.4]), robot.model.createData()
    for normals in ("paper", "paper-multiset"):
        settings = BarrierSettings("hdsdf-boxes", 2, 0.02, 0.0, 0.0, normals)
        links = [LinkBody("panda_link5", 5, box)]
        barriers = Barriers(robot, kinematics_of(robot), links, [], from_obstacle(obstacle)[0], settings)
        for q in robot.draw(rng, 10):
            jacobian = pin.computeJointJacobian(robot.model, data, q, 5)  # of the joint's twist, in its own frame
            pin.forwardKinematics(robot.model, data, q)
            by_twists = hdsdf_derivatives(
                box, data.oMi[5].homogeneous, wall, obstacle.pose.matrix,
                gamma=2, shaping_length=0.02, normals=normals,
            ).gradient  # fmt: skip
            rows = barriers.evaluate(q)
            np.testing.assert_allclose(rows.gradient[0], by_twists[:6] @ jacobian, atol=1e-9)


def test_barriers_are_their_distances(robot: Robot) -> None:
    rng = np.random.default_rng(3)
    kinematics, sides = kinematics_of(robot), np.array([0.08, 0.12, 0.2])
    box = ConvexBody.box(sides)
    obstacle = random_boxes(rng, 1)[0]
    size = obstacle.shape.size
    for q in robot.draw(rng, 10):
        state, pose = kinematics.evaluate(q), np.eye(4)
        pose[:3, :3], pose[:3, 3] = state.rotations[0, 5], state.translations[0, 5]
        for settings in DISTANCES[1:]:
            at = replace(settings, growth=0.01)
            rows = Barriers(robot, kinematics, [LinkBody("five", 5, box)], [], from_obstacle(obstacle)[0], at).evaluate(
                q
            )
            other = ConvexBody.box(size)
            expected: float | Array
            if settings.distance == "gdf":
                expected = gdf(box, pose, other, obstacle.pose.matrix, tolerance=2e-4, iterations=300).distance - 0.01
            elif settings.distance == "hdsdf-boxes":
                expected = hdsdf(
                    box, pose, other.inflated(0.01), obstacle.pose.matrix,
                    gamma=2, shaping_length=settings.shaping_length, normals=settings.normals,
                )  # fmt: skip
            else:
                continue  # FclPairs has its own tests
            assert rows.value[0] == pytest.approx(expected, abs=1e-9)


def test_a_moving_obstacle_enters_with_its_own_speed(robot: Robot) -> None:
    motion = SteadyMotion((0.1, -0.3, 0.05), (0.2, -0.1, 0.7))
    obstacle = Obstacle("it", Box((0.1, 0.2, 0.3)), Pose((0.5, 0.2, 0.4)), motion=motion)
    rng = np.random.default_rng(4)
    for settings in (DISTANCES[0], DISTANCES[1]):
        bodies = from_obstacle(Obstacle("it", Box((0.1, 0.2, 0.3))))[0]
        moved = [(ObstacleMotion.of(obstacle), bodies)]
        still = scene_barriers(scene_of(), robot, settings)
        links = [LinkBody("five", 5, ConvexBody.box([0.08, 0.12, 0.2]))]
        barriers = Barriers(robot, still.kinematics, links, [], [], settings, moved)
        for q, time in zip(robot.draw(rng, 8), rng.uniform(0, 1, 8), strict=True):
            rows = barriers.evaluate(q, time)
            ahead, behind = barriers.evaluate(q, time + 1e-6).value, barriers.evaluate(q, time - 1e-6).value
            np.testing.assert_allclose(rows.drift, (ahead - behind) / 2e-6, atol=1e-6)


# --- the rules ---------------------------------------------------------------------------------------------


def test_shaping_is_inverted() -> None:
    for value in np.geomspace(1e-12, 10.0, 40).tolist():
        for gamma, length in ((1, 1e-3), (2, 0.03), (8, 1e-2)):
            assert shaped(unshaped(value, gamma, length), gamma, length) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("normals", ["paper", "paper-multiset"])
def test_what_a_barrier_reads_bounds_the_separation(normals: str, robot: Robot) -> None:
    """D ≥ δ leaves D̃ no less than `separation_bound`, wherever the boxes are, deep overlaps too."""
    rng = np.random.default_rng(5)
    length = 0.03
    settings = BarrierSettings("hdsdf-boxes", 2, length, 0.0, 0.0, normals)
    count = 12 * (1 if normals == "paper" else 5)
    tightest = np.inf
    for _ in range(12):
        body = LinkBody("seven", 7, ConvexBody.box(rng.uniform(0.03, 0.3, 3)))
        barriers = Barriers(
            robot, kinematics_of(robot), [body], [], from_obstacle(random_boxes(rng, 1)[0])[0], settings
        )
        _, distance = barriers.groups[0]
        assert isinstance(distance, BoxPairs)
        state = barriers.kinematics.evaluate(robot.draw(rng, 400))
        values, _, separations = distance(state, np.arange(400), np.zeros(400, dtype=np.int64))
        for value, separation in zip(values.tolist(), separations.tolist(), strict=True):
            bound = separation_bound(value, 2, length, count, 4)
            assert separation >= bound - 1e-12
            tightest = min(tightest, separation - bound)
    assert tightest < 0.05  # and it is not empty words


def test_a_vertex_that_touches_reads_no_less(robot: Robot) -> None:
    """What `refuse_unsafe` says of a touching vertex is true of one."""
    growth, length = 0.025, 0.03
    box, wall = ConvexBody.box([0.2, 0.2, 0.2]), ConvexBody.box([0.4 + 2 * growth] * 3)
    x = np.array([1.0, 1.0, 1.0]) / math.sqrt(3)  # the box stands on a corner
    y = np.array([1.0, -1.0, 0.0]) / math.sqrt(2)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(y, x), y, x])  # its diagonal along z
    pose[:3, 3] = [0, 0, 0.2 - (box.vertices @ pose[:3, :3].T)[:, 2].min()]  # touches the wall as it is
    for normals, alike in (("paper", 1), ("paper-multiset", 5)):
        value = float(hdsdf(box, pose, wall, np.eye(4), gamma=2, shaping_length=length, normals=normals))
        assert touching_value(growth, 2, length, 4, alike) - 1e-12 <= value < 0.0


def test_provably_unsafe_settings_are_refused_by_name() -> None:
    boxes = BarrierSettings("hdsdf-boxes", 2, 0.03, 0.025, 0.025, "paper-multiset")
    settings: tuple[tuple[dict[str, Any], str], ...] = (
        (dict(rate=300.0, period=0.005), "control.rate"),
        (dict(margin=0.0), "flat spot"),
        (dict(self_margin=0.0), "flat spot"),
        (dict(margin=-1e-9), "flat spot"),
        (dict(margin=-0.05), "lets bodies touch"),
        (dict(barriers=boxes, margin=-5e-3, self_margin=-1e-3), "lets bodies touch"),  # the paper's published code
        (dict(barriers=BarrierSettings("euclidean", growth=0.01, self_growth=0.0), margin=-0.02), "inside the true"),
        (dict(period=0.0), "ControlSettings.period"),
        (dict(speed=1.5), "ControlSettings.speed"),
        (dict(margin=math.nan), "ControlSettings.margin"),
    )
    for wrong, word in settings:
        with pytest.raises(InputError, match=word) as refused:
            ControlSettings(**wrong)
        assert "\n" not in str(refused.value)
    ControlSettings(margin=0.0, as_published=True)
    of_barriers: tuple[tuple[dict[str, Any], str], ...] = (
        (dict(distance="hdsd"), "hdsdf"),
        (dict(normals="paper"), "normals"),
        (dict(growth=-1.0), "growth"),
        (dict(gamma=0), "BarrierSettings.gamma"),
        (dict(shaping_length=-1.0), "BarrierSettings.shaping_length"),
    )
    for wrong, word in of_barriers:
        with pytest.raises(InputError, match=word):
            BarrierSettings(**wrong)


def test_sufficient_separation_bounds_the_distance(robot: Robot) -> None:
    """A D̃ of `sufficient_separation` leaves D no less than its δ, wherever the bodies are."""
    rng = np.random.default_rng(14)
    settings = BarrierSettings()
    barriers = scene_barriers(scene_of(*random_boxes(rng, 8)), robot, settings)
    tightest = np.inf
    for q in robot.draw(rng, 60):
        rows = barriers.evaluate(q)
        for delta in (1e-4, 4e-3, 5e-2):
            sure = rows.separation >= sufficient_separation(delta, 2, settings.shaping_length, barriers.corners)
            tightest = min(tightest, float((rows.value[sure] - delta).min(initial=np.inf)))
    assert 0.0 <= tightest < 2e-3  # and it is not empty words


def test_known_planes_of_an_obstacle_bound_the_distance(robot: Robot) -> None:
    """D ≥ δ keeps the true distance no less than `least_distance` of the obstacle's planes, and that is far more than
    what is proven of planes that are not known."""
    rng = np.random.default_rng(15)
    corner = tuple(map(tuple, rng.uniform(-0.1, 0.1, (12, 3)).tolist()))
    shapes = (Box((0.2, 0.1, 0.3)), Sphere(0.1), Cylinder(0.1, 0.3), Capsule(0.08, 0.2), Points(corner))
    tightest = np.inf
    for shape in shapes:
        for growth, delta, gamma, length in ((0.006, 0.014, 2, 1e-3), (0.0, 0.05, 1, 1e-2), (0.02, 4e-3, 4, 1e-3)):
            obstacle = Obstacle("it", shape, random_pose(rng))
            bodies = from_obstacle(obstacle)[0]
            settings = BarrierSettings(gamma=gamma, shaping_length=length, growth=growth, self_growth=0.0)
            links = [LinkBody("five", 5, ConvexBody.from_points(rng.uniform(-0.1, 0.1, (4, 3))))]
            made = [
                Barriers(robot, kinematics_of(robot), links, [], bodies, each)
                for each in (settings, BarrierSettings("euclidean", growth=0.0))
            ]
            proven = made[0].clearance(delta)
            assert proven is not None
            assert proven >= separation_bound(delta, gamma, length, 50, 1) + growth - 1e-9
            for q in robot.draw(rng, 300):
                value, true = (barriers.evaluate(q).value[0] for barriers in made)
                if value >= delta:
                    assert true >= proven - 1e-6
                    tightest = min(tightest, true / proven)
    assert tightest < 2.0  # and it is not empty words


def test_flat_spot_is_where_the_gradient_fades() -> None:
    assert [*map(float, straightened(0.0, 2, 1e-3))] == [0.0, 0.0]
    slopes = [straightened(-delta, 2, 1e-3)[1] for delta in np.geomspace(1e-15, 1e-3, 20)]
    assert (np.diff(slopes) > 0).all()


def test_straightened_is_the_shaping_undone() -> None:
    rng = np.random.default_rng(16)
    for u in (rng.choice([-1.0, 1.0], 40) * np.geomspace(1e-6, 1.0, 40)).tolist():
        for gamma, length in ((1, 1e-3), (2, 1e-3), (4, 1e-2)):
            read = [shaped(shaped(each, gamma, length), gamma, length) for each in (u, u * (1 + 1e-6), u * (1 - 1e-6))]
            found, slope = straightened(read[0], gamma, length)
            assert found == pytest.approx(u, rel=1e-6)
            assert slope == pytest.approx((read[1] - read[2]) / (2e-6 * u), rel=1e-5)
    for tiny in (5e-324, -1e-300, 1e-200, 0.0):  # where a distance underflows
        for gamma in (1, 2, 20, 1000):
            assert all(math.isfinite(each) for each in straightened(tiny, gamma, 1e-3))


# --- the quadratic program ---------------------------------------------------------------------------------


def test_commands_are_the_best_that_the_barriers_allow(robot: Robot) -> None:
    rng = np.random.default_rng(6)
    settings = ControlSettings(look_ahead=False, rise=0.0)
    barriers = scene_barriers(scene_of(*random_boxes(rng, 6)), robot, settings.barriers)
    controller = Controller(robot, barriers, settings)
    seen = 0
    for q, goal in zip(robot.draw(rng, 40), robot.draw(rng, 40), strict=True):
        task = standing(goal)
        step = controller.step(q, task)
        if step.mode is not Mode.MOVING:
            continue
        outer = step.pairs < barriers.obstacle_pairs
        margins = np.where(outer, settings.margin, settings.self_margin)
        share = np.clip(step.rows.separation / settings.horizon, 0.0, 1.0 - 1e-12)
        rates = settings.rate / np.where(outer, 1.0 - share**2, 1.0)
        slack = step.rows.gradient @ step.velocity + rates * (step.rows.value - margins)
        scale = np.maximum(np.linalg.norm(step.rows.gradient, axis=1), 1e-9)
        assert (slack / scale).min() > -1e-6
        lower = np.maximum(-USED_SHARE * robot.model.velocityLimit, -settings.rate * (q - robot.lower))
        upper = np.minimum(USED_SHARE * robot.model.velocityLimit, settings.rate * (robot.upper - q))
        assert ((step.velocity >= lower - 1e-6) & (step.velocity <= upper + 1e-6)).all()
        hessian, linear = task.objective(q, 0.0)
        near = np.flatnonzero(slack / scale < 1.0)
        found = minimize(
            lambda u, h=hessian, f=linear: (0.5 * u @ h @ u + f @ u, h @ u + f), step.velocity,
            jac=True, method="SLSQP",
            bounds=list(zip(lower, upper, strict=True)), options={"ftol": 1e-12, "maxiter": 200},
            constraints={"type": "ineq",
                         "fun": lambda u, g=step.rows.gradient[near] / scale[near, None], s=(slack / scale)[near],
                         u0=step.velocity: g @ (u - u0) + s},
        )  # fmt: skip
        cost = 0.5 * step.velocity @ hessian @ step.velocity + linear @ step.velocity
        assert cost <= found.fun + 1e-6 * (1 + abs(found.fun))
        seen += 1
    assert seen > 10


def test_where_not_all_can_be_met_the_command_is_the_best(robot: Robot) -> None:
    """A box around the wrist: what cannot come back to its margin does not fall, links that overlap it come out as a
    whole, and the step says which."""
    tight = Obstacle("tight", Box((0.6, 0.6, 0.6)), Pose((0.3, 0.0, 0.5)))
    for look_ahead in (True, False):
        settings = ControlSettings(look_ahead=look_ahead)
        controller = Controller.of(scene_of(tight), settings, robot)
        step = controller.step(np.array(READY), standing(np.zeros(7) + READY))
        assert step.mode in (Mode.GIVING_WAY, Mode.STOPPED)
        assert step.closest in step.gave
        gave, outer = np.array(step.gave), np.arange(controller.barriers.obstacle_pairs)
        exact = controller.barriers.at(np.array([READY]), np.zeros(1)).nearness(0 * outer, outer)
        overlap, coming_out = exact.value < 0.0, exact.gradient @ step.velocity
        assert overlap.sum() == 8
        assert (step.rows.gradient @ step.velocity)[gave[~overlap[gave]]].min() >= -1e-6
        assert (exact.value * coming_out)[overlap].sum() < -1e-3  # half the sum of the squared depths falls
        assert step.slack < 0.0
        assert step.proven is None


def test_rows_that_cannot_be_met_are_met_as_well_as_can_be() -> None:
    """On random programs without a solution: floors hold, and what is missed is paid for as little as can be."""
    rng = np.random.default_rng(11)
    gave = 0
    for k in range(60):
        count = 200 if k % 10 == 0 else int(rng.integers(2, 12))
        jacobian, matrix = (
            rng.normal(size=(6, 7)),
            rng.normal(size=(count, 7)) * rng.choice([1e-3, 0.1, 1.0], (count, 1)),
        )
        hessian, linear = jacobian.T @ jacobian + (0.0 if k % 5 == 1 else 0.01) * np.eye(7), rng.normal(size=7)
        low, high = -rng.uniform(0.0, 1.0, 7), rng.uniform(0.0, 1.0, 7)
        target = rng.normal(size=count) * np.linalg.norm(matrix, axis=1)
        hold = np.where(rng.random(count) < 0.5, -np.inf, np.minimum(target, 0.0))
        weight = rng.choice([30.0, 1e3], count)
        found = best_velocity(hessian, linear, low, high, SoftConstraints(matrix, target, hold, weight))
        assert found is not None
        assert (found >= low).all()
        assert (found <= high).all()
        assert (matrix @ found >= hold - 1e-5).all()
        missed = np.maximum(target - matrix @ found, 0.0)
        if missed.max() < 1e-6:
            continue
        gave += 1
        # Karush, Kuhn and Tucker: the gradient is a sum, of positive parts, of what holds the command back
        gradient = hessian @ found + linear - matrix.T @ (weight**2 * missed)
        held = matrix[np.isfinite(hold) & (matrix @ found <= hold + 1e-6)]
        walls = np.concatenate([held, np.eye(7)[found <= low + 1e-7], -np.eye(7)[found >= high - 1e-7]])
        left = nnls(walls.T, gradient)[1] if len(walls) else np.linalg.norm(gradient)
        assert left <= 1e-6 * (1.0 + np.linalg.norm(gradient))
        for unit in (1e-12, 1e12):  # of the objective: DAQP took no floor for one at such a scale
            rows = SoftConstraints(matrix, target, hold, weight * unit**0.5)
            assert best_velocity(unit * hessian, unit * linear, low, high, rows) == pytest.approx(found, abs=1e-5)
    assert gave > 20


@pytest.mark.parametrize("weight", [1e3, 1e6])
def test_no_weight_outweighs_a_floor(weight: float) -> None:
    """DAQP took a floor for no row at all once many rows of a great weight pulled across it."""
    matrix = np.array([[-1.0, 0.0], *60 * [[1.0, 0.0]]])
    rows = SoftConstraints(matrix, np.r_[0.0, np.ones(60)], np.r_[0.0, np.full(60, -np.inf)], np.full(61, weight))
    found = best_velocity(np.eye(2), np.array([0.0, 1.0]), -np.ones(2), np.ones(2), rows)
    assert found == pytest.approx([0.0, -1.0], abs=1e-6)


# --- what comes, what is stuck, what is none ---------------------------------------------------------------


@pytest.mark.parametrize("count", [9, pytest.param(24, marks=pytest.mark.slow)])
def test_a_ball_that_comes_is_given_way_to(count: int, robot: Robot) -> None:
    """Slow balls from all sides, aimed at the arm: none meets it, but for those that cross the shoulder, which cannot
    move aside."""
    ready, met = np.array(READY), 0
    column = np.array([0.0, 0.0, 1.0])
    for k, direction in enumerate(directions(count)):
        target = kinematics_of(robot).evaluate(ready).translations[0, 4 + k % 4]
        way = target + np.linspace(-0.4, 0.3, 50)[:, None] * direction
        if np.linalg.norm(way - column * np.clip(way[:, 2:], 0.0, 0.4), axis=1).min() < 0.3:
            continue
        ball = Obstacle(
            "ball", Sphere(0.08), Pose(tuple((target - 0.4 * direction).tolist())),
            motion=SteadyMotion(tuple((0.5 * direction).tolist())),
        )  # fmt: skip
        scene = scene_of(ball)
        settings = ControlSettings(BarrierSettings(growth=0.005), rate=4.0, period=0.01)
        run = simulate(Controller.of(scene, settings, robot), ready, standing(ready, 4.0), 1.2, until_met=False)
        motion = Trajectory(robot.joint_names, run.positions, robot.locked, run.times)
        assert Certifier(Setup.of(scene, robot)).certify(motion, check_ends=False).certified, k
        met += 1
    assert met >= count / 3


def test_what_comes_to_a_link_that_no_joint_moves_ends_the_proof(robot: Robot) -> None:
    """No command can prevent the contact, so the pair has no row: the command is the same, and nothing is proven."""
    ball = Obstacle("ball", Sphere(0.1), Pose((-1.5, 0.0, 0.05)), motion=SteadyMotion((0.5, 0.0, 0.0)))
    controller, ready = Controller.of(scene_of(ball), ControlSettings(), robot), np.array(READY)
    free, met = (controller.step(ready, standing(ready), time) for time in (0.0, 2.6))
    assert {"panda_link0"}.isdisjoint(link for link, _ in controller.barriers.names)
    assert free.proven is not None
    assert met.proven is None
    assert met.mode is Mode.MOVING


@pytest.mark.parametrize("starts", [3, pytest.param(6, marks=pytest.mark.slow)])
def test_static_obstacles_keep_their_margins_beside_fast_moving_ones(starts: int, robot: Robot) -> None:
    """A fast ball drives the arm among boxes: of what stands nothing falls below its margin, or further below."""
    rng = np.random.default_rng(12)
    gave = 0
    for q in robot.draw(rng, starts):
        hand = kinematics_of(robot).evaluate(q).translations[0, 7]
        velocity = rng.normal(size=3)
        ball = Obstacle("ball", Sphere(0.08), Pose(tuple((hand - 0.3 * velocity).tolist())),
                        motion=SteadyMotion(tuple(velocity.tolist()), (0.5, 1.0, 0.0)))  # fmt: skip
        controller = Controller.of(scene_of(*random_boxes(rng, 4), ball), ControlSettings(period=0.01), robot)
        margins = np.where(
            np.arange(len(controller.barriers.names)) < controller.barriers.obstacle_pairs, -2.5e-4, -2.5e-4
        )
        run = simulate(controller, q, standing(robot.draw(rng, 1)[0], gain=4.0), 0.6)
        stands = ~controller.barriers.coming
        begun = controller.barriers.evaluate(run.positions[0], 0.0).value[stands]
        for time, position in zip(run.times[1:], run.positions[1:], strict=True):
            now = controller.barriers.evaluate(position, float(time)).value[stands]
            assert (now >= np.minimum(begun, margins[stands]) - 1e-9).all()
        gave += run.counted[Mode.GIVING_WAY]
    assert gave


@pytest.mark.parametrize(("gap", "inside"), [(-0.01, True), (0.005, False)])
def test_a_wall_that_no_joint_can_leave_does_not_freeze_the_arm(gap: float, inside: bool, robot: Robot) -> None:
    wall = Obstacle("wall", Box((0.02, 0.5, 0.2)), Pose((-0.0725 - gap - 0.01, 0.0, 0.15)))
    scene = scene_of(wall)
    controller = Controller.of(scene, ControlSettings(), robot)
    goal = np.array(READY) + [0.5, 0.3, -0.3, 0.3, 0.3, 0.3, 0.3]
    run = simulate(controller, np.array(READY), replace(standing(goal, gain=4.0), tolerance=0.02), 4.0)
    assert Mode.STOPPED not in run.counted
    away = np.abs(run.positions[-1] - goal)
    assert away[1:].max() < 0.02  # turning about its own axis may bring link1 closer: then it does not
    assert run.slacks[0] < 0.0 or not inside
    motion = Trajectory(robot.joint_names, run.positions, robot.locked)
    assert Certifier(Setup.of(scene, robot)).certify(motion, check_ends=False).certified


@pytest.mark.parametrize("starts", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_a_robot_on_the_flat_spot_moves_on(starts: int, robot: Robot) -> None:
    """Inside the margin, where D and its derivative vanish: the arm leaves toward what is free, and slides along the
    obstacle toward what is not; it does not stand, and never touches."""
    rng, done = np.random.default_rng(3), 0
    while done < starts:
        scene = scene_of(*random_boxes(rng, 4))
        controller = Controller.of(scene, ControlSettings(period=0.01), robot)
        certifier, outer = Certifier(Setup.of(scene, robot)), controller.barriers.obstacle_pairs

        def least(q: Array, barriers: Barriers = controller.barriers, outer: int = outer) -> float:
            return float(barriers.evaluate(q).separation[:outer].min())

        drawn = robot.draw(rng, 12)
        free, deep = ([q for q in drawn if wanted(least(q))] for wanted in (lambda d: d > 0.03, lambda d: d < -0.02))
        if not free or not deep:
            continue
        out, into = free[0], deep[0]
        for _ in range(40):  # to where D is 0
            middle = 0.5 * (out + into)
            out, into = (middle, into) if least(middle) > 0.0 else (out, middle)
        start = out if done % 2 else into
        if certifier.contacts(start):
            continue
        for goal in (free[0], deep[0]):
            run = simulate(controller, start, replace(standing(goal, gain=4.0), tolerance=0.05), 0.8)
            assert run.slacks[0] == pytest.approx(-0.014, abs=1e-6)
            assert np.abs(run.positions - start).max() > 0.1
            assert run.counted[Mode.STOPPED] == 0
            motion = Trajectory(robot.joint_names, run.positions, robot.locked)
            assert certifier.certify(motion, check_ends=False).certified
            if goal is free[0]:
                assert run.slacks[-1] >= 0.0
        done += 1


@pytest.mark.parametrize(
    ("sides", "where", "turn", "q"),
    [
        ((0.12, 0.06, 0.05), (-0.16, -0.28, 0.24), (-0.31, 0.21, 0.75, 0.55),
         (-1.74, 1.56, -0.78, -2.76, 0.75, 3.48, -0.35)),
        ((0.24, 0.28, 0.08), (-0.48, -0.15, 0.26), (-0.17, -0.27, 0.95, -0.02),
         (0.48, -1.62, 1.23, -1.36, 1.89, 1.99, 1.82)),
    ],
)  # fmt: skip
def test_links_deep_in_a_box_come_out(sides: Array, where: Array, turn: Array, q: Array, robot: Robot) -> None:
    """Of two links in a box, 75 and 87 mm deep, the way out of one leads deeper into it for the other: both come out,
    and no other link touches it meanwhile."""
    deep = Obstacle("deep", Box(sides), Pose(where, tuple((np.array(turn) / np.linalg.norm(turn)).tolist())))
    controller = Controller.of(scene_of(deep), ControlSettings(period=0.01), robot)
    outer = np.arange(controller.barriers.obstacle_pairs)

    def distances(q: Array) -> Array:
        return controller.barriers.at(q[None], np.zeros(1)).nearness(0 * outer, outer).value

    first = controller.step(np.array(q), standing(np.array(q)))
    run = simulate(controller, np.array(q), standing(np.array(q)), 1.9, until_met=False)
    along = np.array([distances(row) for row in run.positions[::5]])
    assert first.overlapping == tuple(np.flatnonzero(along[0] < 0.0).tolist())
    assert along[0].min() < -0.07
    assert (along[:, along[0] >= 0.0] >= -1e-9).all()
    assert along[-1].min() > 0.0


def test_a_joint_beyond_its_limit_comes_back_as_fast_as_it_may(robot: Robot) -> None:
    controller = Controller.of(scene_of(), ControlSettings(rate=4.0), robot)
    for beyond, joint in ((0.2, 6), (-0.1, 3), (2.0, 0)):
        q = np.array(READY)
        q[joint] = robot.upper[joint] + beyond if beyond > 0 else robot.lower[joint] + beyond
        at_once = Controller.of(scene_of(), ControlSettings(rate=4.0, rise=0.0), robot)
        first = at_once.step(q, standing(q + np.sign(beyond)))
        assert first.velocity[joint] == pytest.approx(
            -np.sign(beyond) * min(4.0 * abs(beyond), at_once.rates.velocity[joint]), abs=1e-3
        )
        run = simulate(controller, q, standing(np.array(READY), gain=4.0), 2.0)
        assert (np.diff(np.sign(beyond) * run.positions[:, joint]) <= 1e-9).all()
        assert robot.lower[joint] - 1e-3 <= run.positions[-1, joint] <= robot.upper[joint] + 1e-3


def test_numbers_that_are_none_are_refused_before_anything_is_commanded(robot: Robot) -> None:
    controller, ready = Controller.of(scene_of(), robot=robot), np.array(READY)
    nan = np.where(np.arange(7) == 2, np.nan, 1.0)

    class Task:
        def __init__(self, hessian: Array, linear: Array) -> None:
            self.both = hessian, linear

        def objective(self, q: Array, time: float) -> tuple[Array, Array]:
            return self.both

        def met(self, q: Array, time: float) -> bool:
            return False

    def limited(**limits: Array) -> Controller:
        return Controller(robot, controller.barriers, ControlSettings(), limits)

    for act, words in (
        (lambda: controller.step(nan, standing(ready)), ("q", "panda_joint3", "nan", "allowed")),
        (lambda: controller.step(ready[:6], standing(ready)), ("q", "(6,)", "(7,)")),
        (lambda: controller.step(1e300 * ready, standing(ready)), ("q", "panda_joint2", "allowed")),
        (lambda: controller.step("here", standing(ready)), ("q", "7 numbers")),
        (lambda: controller.step(ready, standing(ready), math.nan), ("time", "nan")),
        (lambda: standing(nan), ("q", "nan")),
        (lambda: standing(ready, gain=math.nan), ("gain", "nan")),
        (lambda: controller.step(ready, TrackTask(lambda time: (nan, ready))), ("reference", "joint '2'", "nan")),
        (lambda: controller.step(ready, standing(ready[:5])), ("reference", "(5,)", "(7,)")),
        (lambda: controller.step(ready, Task(np.eye(6), ready)), ("task.objective", "(6, 6)", "(7, 7)")),
        (lambda: controller.step(ready, Task(-np.eye(7), ready)), ("task.objective", "positive definite")),
        (lambda: controller.step(ready, Task(np.full((7, 7), np.nan), ready)), ("task.objective", "finite")),
        (lambda: limited(velocity=nan), ("limits.velocity", "panda_joint3", "nan", "allowed")),
        (lambda: limited(acceleration=-np.ones(7)), ("limits.acceleration", "-1", "more than 0")),
        (lambda: limited(jerk=np.ones(3)), ("limits.jerk", "(3,)", "(7,)")),
        (lambda: controller.step(ready, standing(ready), 0.0, Command(nan, ready)), ("last.velocity", "nan")),
        (lambda: controller.step(ready, standing(ready), 0.0, Command(ready, ready[:2])), ("last.acc", "(2,)")),
        (lambda: controller.step(ready, standing(ready), 0.0, ready), ("last", "Command")),
        (lambda: simulate(controller, nan, standing(ready), 1.0), ("start", "panda_joint3")),
        (lambda: simulate(controller, ready, standing(ready), math.nan), ("duration", "nan")),
        (lambda: simulate(controller, ready, standing(ready), math.inf), ("duration", "inf")),
    ):
        with pytest.raises(InputError) as refused:
            act()
        assert "\n" not in str(refused.value)
        for word in words:
            assert any(each in str(refused.value) for each in word.split("|")), (word, str(refused.value))


def test_threads_that_share_a_controller_command_what_one_does(robot: Robot) -> None:
    rng = np.random.default_rng(13)
    ball = Obstacle("ball", Sphere(0.08), Pose((0.5, 0.3, 0.5)), motion=SteadyMotion((0.0, -0.3, 0.0)))
    controller = Controller.of(scene_of(*random_boxes(rng, 4), ball), robot=robot)
    cases = [(q, standing(goal), float(t)) for q, goal, t in
             zip(robot.draw(rng, 40), robot.draw(rng, 40), rng.uniform(0, 2, 40), strict=True)]  # fmt: skip
    alone = [controller.step(*case).velocity for case in cases]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda case: controller.step(*case).velocity, cases * 3))
    np.testing.assert_array_equal(together, alone * 3)


# --- closed loop -------------------------------------------------------------------------------------------


def test_a_free_robot_reaches_its_pose_and_tracks(robot: Robot) -> None:
    settings = ControlSettings()
    controller = Controller.of(scene_of(), settings, robot)
    target = PoseTarget("panda_hand", Pose((0.45, 0.2, 0.5), (1.0, 0.0, 0.0, 0.0)))
    reached = simulate(controller, np.array(READY), PoseTask(robot, target, gain=3.0), 6.0)
    assert reached.met is not None
    start, wave = np.array(READY), np.array([0.3, 0.1, -0.2, 0.1, 0.2, 0.1, 0.3])
    follow = TrackTask(lambda t: (start + wave * math.sin(t), wave * math.cos(t)), end=3.0)
    run = simulate(controller, start, follow, 3.0)
    wanted = start + wave * np.sin(run.times)[:, None]
    assert np.abs(run.positions - wanted).max() < 1e-2
    assert set(run.modes) == {Mode.MOVING}


def test_joint_limits_are_never_crossed(robot: Robot) -> None:
    settings = ControlSettings(rate=20.0)
    controller = Controller.of(scene_of(), settings, robot)
    for goal in (robot.upper + 1.0, robot.lower - 1.0):
        run = simulate(controller, np.array(READY), standing(goal), 2.0)
        assert (run.positions >= robot.lower - 1e-9).all()
        assert (run.positions <= robot.upper + 1e-9).all()


@pytest.mark.parametrize("starts", [5, pytest.param(1000, marks=pytest.mark.slow)])
def test_never_a_contact_from_random_starts(starts: int, robot: Robot) -> None:
    """With settings that the rule calls safe: every motion is certified, between its samples too, on the real meshes,
    and where the barriers held at the start it keeps what the rule promises."""
    rng = np.random.default_rng(7)
    settings = ControlSettings(period=0.01, speed=0.3)
    done = held = promised = 0
    while done < starts:
        scene = scene_of(*random_boxes(rng, 5))
        certifier = Certifier(Setup.of(scene, robot))
        q = robot.draw(rng, 1)[0]
        if certifier.contacts(q):
            continue
        done += 1
        controller = Controller.of(scene, settings, robot)
        assert controller.assured is not None
        assert controller.assured > 0.0
        run = simulate(controller, q, standing(robot.draw(rng, 1)[0], gain=4.0), 1.5)
        certificate = certifier.certify(Trajectory(robot.joint_names, run.positions, robot.locked), check_ends=False)
        assert certificate.certified, certificate.text
        held += bool((run.slacks < 5e-3).any())
        if run.slacks[0] >= 0.0:
            assert run.slacks.min() >= -1e-9
            assert certificate.clearance is not None
            assert run.proven is not None
            assert run.proven >= controller.assured - 1e-12
            assert certificate.clearance >= run.proven - 1e-4  # room for the certificate's own bounds
            promised += 1
    assert held  # barriers had something to do
    assert promised > starts // 4


def test_links_that_begin_inside_a_margin_do_not_touch(robot: Robot) -> None:
    """Where outer bodies overlap and links do not, the exact distance of the hulls is kept, and no other pair's Δ falls
    below its margin."""
    rng = np.random.default_rng(10)
    settings = ControlSettings(period=0.01, speed=0.3)
    controller = Controller.of(scene_of(), settings, robot)
    certifier = Certifier(Setup.of(scene_of(), robot))
    done = moved = 0
    for q in robot.draw(rng, 4000):
        inside = np.flatnonzero(controller.barriers.evaluate(q).value < settings.self_margin)
        if len(inside) == 0 or certifier.contacts(q):
            continue
        run = simulate(controller, q, standing(robot.draw(rng, 1)[0], gain=4.0), 0.5)

        def nearness(q: Array, inside: NDArray[np.int64] = inside) -> Array:
            return controller.barriers.at(q[None], np.zeros(1)).nearness(np.zeros_like(inside), inside).value

        near = nearness(q)
        for configuration in run.positions[::5]:
            now = nearness(configuration)
            assert (now >= np.minimum(near, NEAR_DISTANCE) - 1e-4).all()
        motion = Trajectory(robot.joint_names, run.positions, robot.locked)
        assert certifier.certify(motion, check_ends=False).certified
        moved += bool(np.abs(np.diff(run.positions, axis=0)).max() > 1e-6)
        done += 1
        if done == 6:
            break
    assert done == 6
    assert moved  # it is not that nothing goes any more


@pytest.mark.parametrize("starts", [3, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("barriers", "margin"),
    [
        (BarrierSettings(growth=0.02), -2.5e-4),
        (BarrierSettings(), 4e-3),
        (BarrierSettings("euclidean", growth=0.0), 0.01),
    ],
    ids=["grown", "hdsdf", "euclidean"],
)
def test_slacks_stay_above_zero_once_they_are(
    barriers: BarrierSettings, margin: float, starts: int, robot: Robot
) -> None:
    """The look-ahead's law: Δ ≥ δ at every sample, whatever the kinks, even with a distance that has them; and Δ falls
    from no start, except where links overlap, which come out together."""
    rng = np.random.default_rng(8)
    settings = ControlSettings(barriers, margin, 1e-3 if margin > 0 else margin, rate=20.0, period=0.02)
    controller = Controller.of(scene_of(*random_boxes(rng, 5)), settings, robot)
    for q in robot.draw(rng, starts):
        goal = standing(robot.draw(rng, 1)[0])
        run, deep = simulate(controller, q, goal, 0.8), controller.step(q, goal).overlapping
        first = run.slacks[0]
        assert (run.slacks[-1] if deep else run.slacks.min()) >= min(first, 0.0) - 1e-9


def test_measures_of_commands() -> None:
    time = np.arange(1000) * 0.01
    slow, fast = np.sin(2 * math.pi * 0.5 * time), 0.1 * np.sin(2 * math.pi * 20.0 * time)
    assert total_variation(np.stack([slow, slow], 1)) == pytest.approx(2 * total_variation(slow))
    assert total_variation(slow) == pytest.approx(20.0, rel=0.01)
    assert fast_energy(slow, 0.01) < 1e-3
    assert fast_energy(slow + fast, 0.01) == pytest.approx(0.1**2 / 2 * 10.0, rel=0.1)
