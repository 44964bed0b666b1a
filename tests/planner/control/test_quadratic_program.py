"""Laws of the program: the best command within the rows, and the least violation where they cannot all be met."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize, nnls

from hdplan import Obstacle, Pose, Robot
from hdplan.control import Controller, ControlSettings, Mode, scene_barriers
from hdplan.planner.control.braking import USED_SHARE
from hdplan.planner.control.quadratic_program import SoftConstraints, best_velocity
from hdplan.planner.control.tasks import standing
from hdplan.scenes.shapes import Box

from .rooms import READY, random_boxes, scene_of


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


def test_the_command_is_the_best_if_not_all_rows_can_be_met(robot: Robot) -> None:
    """A box around the wrist: what cannot come back to its margin does not fall, links that overlap it come out as a
    whole, and the step says which."""
    tight = Obstacle("tight", Box((0.6, 0.6, 0.6)), Pose((0.3, 0.0, 0.5)))
    for look_ahead in (True, False):
        settings = ControlSettings(look_ahead=look_ahead)
        controller = Controller.of(scene_of(tight), settings, robot)
        step = controller.step(READY, standing(READY))
        assert step.mode in (Mode.GIVING_WAY, Mode.STOPPED)
        assert step.closest in step.gave
        gave, outer = np.array(step.gave), np.arange(controller.barriers.obstacle_pairs)
        exact = controller.barriers.at(READY[None], np.zeros(1)).nearness(0 * outer, outer)
        overlap, coming_out = exact.value < 0.0, exact.gradient @ step.velocity
        assert overlap.sum() == 8
        assert (step.rows.gradient @ step.velocity)[gave[~overlap[gave]]].min() >= -1e-6
        assert (exact.value * coming_out)[overlap].sum() < -1e-3  # half the sum of the squared depths falls
        assert step.slack < 0.0
        assert step.proven is None


def test_rows_that_cannot_be_met_are_met_as_well_as_can_be() -> None:
    """Random programs without a solution: floors hold, and what is missed is paid for as little as can be."""
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
