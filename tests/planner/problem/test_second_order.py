"""Laws of second derivatives by the joints: those that CasADi finds, of any function of how one link is placed to
another, and of what path constraints measure and gravity asks; on random trees of joints that turn and slide, and on
robots."""

from __future__ import annotations

import functools
from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.gravity_torque import GravityTorques
from hdplan.planner.problem.hinge import Measure
from hdplan.planner.problem.path_terms import LEVER, RelativeMeasure, UprightMeasure, WithinMeasure
from hdplan.planner.problem.second_order import by_joints, point_along
from hdplan.planner.robot.loading import load_robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.robot_spec import RobotSpec

ROBOTS = ("panda", "pr2", "tree 1", "tree 2", "tree 3")
COUNT, ROUNDING = 12, 1e-10


@functools.cache
def robot(name: str) -> tuple[pin.Model, Kinematics]:
    model = tree(int(name[-1])) if name.startswith("tree") else load_robot(RobotSpec(name=name)).model
    return model, Kinematics(model)


def tree(seed: int, joints: int = 8) -> pin.Model:
    """Joints of either kind about random axes, each on one of the two before it; bodies with weight."""
    rng, model = np.random.default_rng(seed), pin.Model()
    for k in range(joints):
        axis = rng.normal(size=3)
        kind = pin.JointModelPrismaticUnaligned if rng.random() < 0.4 else pin.JointModelRevoluteUnaligned
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), 0.3 * rng.normal(size=3))
        on = model.addJoint(
            int(rng.integers(max(k - 1, 0), k + 1)), kind(axis / np.linalg.norm(axis)), placement, f"{k}"
        )
        model.appendBodyToJoint(on, pin.Inertia(1.0 + k, rng.normal(size=3) * 0.1, np.eye(3)), pin.SE3.Identity())
    return model


def drawn(name: str, seed: int) -> tuple[Array, KinematicsBatch]:
    _, kinematics = robot(name)
    q = np.random.default_rng(seed).normal(size=(COUNT, kinematics.n))
    return q, kinematics.evaluate(q)


def hessians(name: str, function: Callable[[list[ca.SX], list[ca.SX]], ca.SX], q: Array) -> Array:
    """CasADi's Hessians (B, n, n) of a function of the joints' rotations and origins."""
    _, kinematics = robot(name)
    symbol = ca.SX.sym("q", kinematics.n)
    rotations, origins = kinematics.function(symbol)
    value = function(ca.horzsplit(rotations, 3), ca.horzsplit(origins, 1))
    found = ca.Function("hessian", [symbol], [ca.densify(ca.hessian(value, symbol)[0])])
    return np.array([np.array(found(each)) for each in q])


def close(found: Array, expected: Array) -> None:
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING * max(1.0, float(np.abs(expected).max())))
    np.testing.assert_allclose(found, found.swapaxes(-1, -2), rtol=0, atol=ROUNDING)


def moved(twist: ca.SX, rotation: ca.SX, origin: ca.SX) -> tuple[ca.SX, ca.SX]:
    """exp(ξ) on a placement, to second order."""
    turn = ca.skew(twist[3:])
    turn += turn @ turn / 2
    return rotation + turn @ rotation, origin + turn @ origin + twist[:3] + ca.cross(twist[3:], twist[:3]) / 2


@pytest.mark.parametrize("name", ROBOTS)
def test_second_order_holds_for_any_function_of_a_relative_placement(name: str) -> None:
    """Two links of one branch, of two branches, or a link and the world, in either order."""
    _, kinematics = robot(name)
    rng = np.random.default_rng(7)
    for _ in range(6):
        a, b = (int(joint) for joint in rng.choice(kinematics.nj, 2, replace=False))
        mix, shift = rng.normal(size=(3, 12)), rng.normal(size=3)

        def function(rotation_a: ca.SX, origin_a: ca.SX, rotation_b: ca.SX, origin_b: ca.SX) -> ca.SX:
            seen = ca.vertcat(ca.vec(rotation_b.T @ rotation_a), rotation_b.T @ (origin_a - origin_b))
            return ca.sum1(ca.sin(ca.DM(mix) @ seen + shift))  # noqa: B023 - called at once

        placed = [ca.SX.sym(part, *size) for part, size in zip("RtSu", [(3, 3), (3, 1)] * 2, strict=True)]
        twist = ca.SX.sym("twist", 6)
        second_order, slope = ca.hessian(function(*moved(twist, *placed[:2]), *placed[2:]), twist)
        zero = [ca.substitute(ca.densify(part), twist, ca.DM.zeros(6)) for part in (slope, second_order)]
        derivatives = ca.Function("derivatives", placed, zero)
        q, state = drawn(name, 3)
        each = [
            derivatives(
                state.rotations[k, a], state.translations[k, a], state.rotations[k, b], state.translations[k, b]
            )
            for k in range(COUNT)
        ]
        wrench, hessian = (np.array([np.array(one[part]) for one in each]) for part in (0, 1))
        moves = kinematics.supports[a].astype(float) - kinematics.supports[b]
        expected = hessians(name, lambda turns, origins: function(turns[a], origins[a], turns[b], origins[b]), q)  # noqa: B023
        close(by_joints(state.columns, np.tile(moves, (COUNT, 1)), wrench[..., 0], hessian), expected)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_point_along_an_axis(name: str) -> None:
    _, kinematics = robot(name)
    joint, (point, axis) = kinematics.nj - 1, np.random.default_rng(4).normal(size=(2, 3))
    q, state = drawn(name, 4)
    place = state.rotations[:, joint] @ point + state.translations[:, joint]
    found = by_joints(state.columns, kinematics.supports[joint], *point_along(place, np.tile(axis, (COUNT, 1))))
    close(found, hessians(name, lambda turns, origins: ca.dot(turns[joint] @ point + origins[joint], axis), q))


def angle_of(turn: ca.SX) -> ca.SX:
    return ca.acos((ca.trace(turn) - 1) / 2)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kind", ["upright", "within", "relative"])
def test_the_lengths_that_path_constraints_measure(name: str, kind: str) -> None:
    """A link relative to one that branches off before it, and to one that carries it, too."""
    _, kinematics = robot(name)
    rng = np.random.default_rng(8)
    last, supports = kinematics.nj - 1, kinematics.supports
    point, axis, centre = rng.normal(size=(3, 3))
    axis /= np.linalg.norm(axis)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    frame *= np.linalg.det(frame)
    q, state = drawn(name, 5)
    found: Measure
    if kind == "upright":
        found = UprightMeasure(last, axis, supports[last], np.ones(1))
        lengths = [lambda turns, origins: LEVER * ca.acos((turns[last] @ axis)[2])]
    elif kind == "within":
        found = WithinMeasure(last, point, supports[last], centre, frame[:2], np.ones(2))
        lengths = [
            lambda turns, origins, row=row: ca.fabs(ca.dot(turns[last] @ point + origins[last] - centre, row))
            for row in frame[:2]
        ]
    else:
        other = kinematics.nj // 2
        first, second = supports[last] & ~supports[other], supports[other] & ~supports[last]
        own, wanted = np.eye(4), np.eye(4)
        own[:3, 3], wanted[:3, 3], wanted[:3, :3] = point, centre, frame
        found = RelativeMeasure((last, other), (own, wanted), (first, second), np.ones(2))
        lengths = [
            lambda turns, origins: ca.norm_2(
                turns[last] @ point + origins[last] - turns[other] @ centre - origins[other]
            ),
            lambda turns, origins: LEVER * angle_of(turns[last] @ (turns[other] @ frame).T),
        ]
    expected = np.stack([hessians(name, length, q) for length in lengths], axis=1)
    close(found.second_order(state), expected)


@pytest.mark.parametrize("name", ROBOTS)
def test_gravitys_torques(name: str) -> None:
    """Any weights, by the potential U's third derivatives."""
    model, kinematics = robot(name)
    torques = GravityTorques.of(model)
    q, state = drawn(name, 6)
    symbol = ca.SX.sym("q", kinematics.n)
    rotations, origins = kinematics.function(symbol)
    weights = np.random.default_rng(9).normal(size=kinematics.n)
    places = [
        turn @ centre + origin
        for turn, centre, origin in zip(
            ca.horzsplit(rotations, 3), torques.centres, ca.horzsplit(origins, 1), strict=True
        )
    ]
    potential = -sum(mass * ca.dot(torques.gravity, place) for mass, place in zip(torques.masses, places, strict=True))
    second_order = ca.hessian(ca.dot(weights, ca.gradient(potential, symbol)), symbol)[0]
    each = ca.Function("bend", [symbol], [ca.densify(second_order)])
    close(np.einsum("j,bjkl->bkl", weights, torques.second_order(state)), np.array([np.array(each(row)) for row in q]))


def test_a_length_without_a_derivative_has_a_finite_second_one() -> None:
    """No turn, half of one, and the given place."""
    placements, columns = np.zeros((2, 2, 12)), np.random.default_rng(2).normal(size=(2, 3, 6))
    placements[..., [0, 4, 8]] = 1.0
    placements[1, 1, [4, 8]] = -1.0
    state, moves, own = KinematicsBatch(placements, columns), np.ones(3, np.bool_), np.eye(4)
    for measure in (
        UprightMeasure(1, np.array([0.0, 0.0, 1.0]), moves, np.ones(1)),
        WithinMeasure(1, np.zeros(3), moves, np.zeros(3), np.eye(3), np.ones(3)),
        RelativeMeasure((1, 0), (own, own), (moves, ~moves), np.ones(2)),
    ):
        assert np.isfinite(measure.second_order(state)).all()
