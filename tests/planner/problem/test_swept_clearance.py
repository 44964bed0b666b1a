"""Laws of swept clearance: the hull over an interval holds what passes in it, derivatives at both ends are exact."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from hdplan.distance.symbolic.halfspaces import box_directions, halfspace_distance, swept_halfspace_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.build import build
from hdplan.planner.plan import plan
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.swept_clearance import SweptClearance
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene

GAMMA, LENGTH = 2, 1e-3
STEP = 1e-6  # [m, rad] of finite differences
ROUNDING = 1e-12  # [m]


def swept(name: str = "panda_cage", **settings: object) -> Scene:
    scene = load_scene(name)
    return replace(scene, planner=replace(scene.planner, swept=True, **settings))


def term_of(problem: Problem) -> SweptClearance:
    term = problem.terms.obstacles
    assert isinstance(term, SweptClearance)
    return term


@pytest.fixture(scope="module")
def cage() -> Problem:
    return build(swept(waypoints=10))


@pytest.fixture(scope="module")
def motion(cage: Problem) -> Array:
    """A motion through the bars."""
    rng = np.random.default_rng(0)
    guess = np.linspace(cage.start, cage.goal, cage.waypoints)
    return cage.clip(guess + 0.1 * rng.normal(size=guess.shape))


# --- the distance -------------------------------------------------------------------------------------------------


class Thrown:
    """A tetrahedron with a radius, thrown past a box."""

    def __init__(self, count: int = 400) -> None:
        from scipy.spatial.transform import Rotation

        rng = np.random.default_rng(1)
        self.count, self.rows = count, np.arange(count)
        self.world = np.append(np.eye(3), np.zeros(3))[None]
        self.body = np.concatenate([0.05 * rng.normal(size=12), np.ones(4), [0.02]])[None]
        half = np.array([0.2, 0.1, 0.3])
        self.planes = np.append(box_directions(), np.abs(box_directions()) @ half)[None]
        turns = Rotation.random(count, random_state=2).as_matrix().reshape(count, 9)
        places = rng.uniform(-0.45, 0.45, (count, 3))
        self.first = np.hstack([turns, places])
        self.second = np.hstack([turns, places + 0.1 * rng.normal(size=(count, 3))])
        self.swept = RowFunction(swept_halfspace_distance(4, 26, GAMMA, LENGTH))
        self.single = RowFunction(halfspace_distance(4, 26, GAMMA, LENGTH))

    def between(self, first: Array, second: Array) -> list[Array]:
        zero = np.zeros(self.count, int)
        tables = [first, second, self.world, self.body, self.planes]
        return self.swept(tables, [self.rows, self.rows, zero, zero, zero])

    def at(self, placement: Array) -> list[Array]:
        zero = np.zeros(self.count, int)
        return self.single([placement, self.world, self.body, self.planes], [self.rows, zero, zero, zero])


@pytest.fixture(scope="module")
def thrown() -> Thrown:
    return Thrown()


def moved(placements: Array, twist: Array) -> Array:
    """Placements (S, 12) after a small motion: velocity of the point at the origin, angular velocity."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(twist[3:]).as_matrix()
    rotations = turn @ placements[:, :9].reshape(-1, 3, 3)
    return np.hstack([rotations.reshape(-1, 9), placements[:, 9:] @ turn.T + twist[:3]])


def test_wrenches_are_the_derivatives_by_each_placement(thrown: Thrown) -> None:
    _, *wrenches, _ = thrown.between(thrown.first, thrown.second)
    for end in (0, 1):
        for axis in range(6):
            ends = [[thrown.first, thrown.second] for _ in (0, 1)]
            for sign in (0, 1):
                ends[sign][end] = moved(ends[sign][end], (1 - 2 * sign) * STEP * np.eye(6)[axis])
            forward, backward = (thrown.between(*both)[0][:, 0] for both in ends)
            np.testing.assert_allclose(wrenches[end][:, axis], (forward - backward) / (2 * STEP), atol=2e-6)


def test_a_body_that_stays_is_as_far_as_ever(thrown: Thrown) -> None:
    np.testing.assert_allclose(thrown.between(thrown.first, thrown.first)[3], thrown.at(thrown.first)[2], atol=ROUNDING)


def test_the_hull_is_never_farther_than_what_passes_in_it(thrown: Thrown) -> None:
    """A straight way: at every moment of it the body is at least as far as the hull says, in contact above all."""
    distance, _, _, separation = thrown.between(thrown.first, thrown.second)
    nearest = np.min([thrown.at((1 - t) * thrown.first + t * thrown.second)[2] for t in np.linspace(0, 1, 21)], axis=0)
    assert np.all(separation <= nearest + ROUNDING)
    assert np.all(distance[nearest <= 0] <= 0)
    assert (nearest <= 0).any()
    assert (separation > 0).any()


# --- the penalty --------------------------------------------------------------------------------------------------


def test_gradient_is_that_of_the_cost(cage: Problem, motion: Array) -> None:
    term = term_of(cage)

    def cost(positions: Array) -> float:
        return term.over_motion(positions, cage.kinematics).cost

    gradient = term.over_motion(motion, cage.kinematics).gradient
    assert cost(motion) > 0
    scale = np.abs(gradient).max()
    for k in range(len(motion)):
        for joint in range(motion.shape[1]):
            step = np.zeros_like(motion)
            step[k, joint] = STEP
            slope = (cost(motion + step) - cost(motion - step)) / (2 * STEP)
            assert gradient[k, joint] == pytest.approx(slope, abs=1e-5 * scale)


def test_curvature_is_gauss_newtons(cage: Problem, motion: Array) -> None:
    """vᵀHv = h Σ (dD·v)² for any v, the blocks between neighbours included."""
    term, kinematics = term_of(cage), cage.kinematics.evaluate(motion)
    found, inside = term.over_motion(motion, cage.kinematics), term.between(kinematics)
    rng = np.random.default_rng(3)
    for _ in range(5):
        v = rng.normal(size=motion.shape)
        along = np.einsum("si,si->s", inside.gradient, np.hstack([v[inside.sample], v[inside.sample + 1]]))
        curved = np.einsum("ki,kij,kj->", v, found.diagonal, v)
        curved += 2 * np.einsum("ki,kij,kj->", v[1:], found.coupling, v[:-1])
        assert curved == pytest.approx(np.sum(along**2) / (len(motion) - 1))


def test_nothing_is_dropped(cage: Problem, motion: Array) -> None:
    term, kinematics = term_of(cage), cage.kinematics.evaluate(motion)
    wide = dataclasses.replace(term.pairs, half_sizes=term.pairs.half_sizes + 1e3)
    every = SweptClearance("all", wide, term.distance, GAMMA, LENGTH)
    quick, whole = term.between(kinematics), every.between(kinematics)
    assert len(quick.sample) > 20
    for name in ("sample", "pair", "distance", "separation", "gradient"):
        np.testing.assert_array_equal(getattr(quick, name), getattr(whole, name))


def test_the_problem_adds_it_up(cage: Problem, motion: Array) -> None:
    """Its gradient is that of its cost, and single configurations are judged as ever."""
    state = cage.evaluate(motion, 1e4)
    rng = np.random.default_rng(4)
    for _ in range(3):
        step = np.zeros_like(motion)
        step[1:-1] = STEP * rng.normal(size=motion[1:-1].shape)
        slope = (cage.evaluate(motion + step, 1e4).cost - cage.evaluate(motion - step, 1e4).cost) / 2
        assert slope == pytest.approx(np.sum(state.gradient * step[1:-1]), rel=1e-4)
    plain = build(replace(cage.scene, planner=replace(cage.scene.planner, swept=False)))
    np.testing.assert_array_equal(cage.depth(motion), plain.depth(motion))
    assert state.depth.max() >= plain.depth(motion).max() - ROUNDING


@pytest.mark.parametrize("name", ["panda_cage", "planar_arm"])
def test_a_plan_with_it_is_certified(name: str) -> None:
    assert plan(swept(name)).certified


def test_explain_says_so(cage: Problem) -> None:
    rows = explain(cage)
    assert dict(rows["on"])["obstacles"].endswith("of one, swept from waypoint to waypoint")
    assert dict(rows["settings"])["swept"] == "true (scene)"


def test_unsupported_settings_of_swept_are_refused() -> None:
    with pytest.raises(InputError, match=r"planner\.swept: true needs planner\.distance hdsdf, found fcl"):
        build(swept("planar_arm", distance="fcl"))
