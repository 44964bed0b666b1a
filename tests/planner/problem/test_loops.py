"""Laws of the loops in C: the same as in NumPy but for rounding, in any thread and any process."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from hdplan.planner.build import build
from hdplan.planner.collision import broad_phase, hdsdf
from hdplan.planner.kinematics import forward
from hdplan.planner.problem import problem as problems, samples
from hdplan.planner.problem.problem import Evaluation, Problem
from hdplan.planner.problem.samples import Samples
from hdplan.planner.solvers import newton_step
from hdplan.scenes.array_types import Array
from hdplan.scenes.yaml_format.reader import load_scene
from tests.loops import in_numpy, needs_loops

ROUNDING = 1e-9  # relative to the largest number of its kind: sums of a few hundred terms, in another order
WEIGHT = 1e4  # of the penalty [1/m²]
PARTS = ("gradient", "diagonal", "coupling", "depth")
# Turning and sliding joints, links against links, obstacles that move, bodies that are held, path constraints.
SCENES = ("panda_corridor", "panda_conveyor", "planar_arm", "tiago_shelf", "baxter_bimanual_carry")

pytestmark = needs_loops


@pytest.fixture(scope="module", params=SCENES)
def problem(request: pytest.FixtureRequest) -> Problem:
    return build(load_scene(request.param))


def motions(problem: Problem, count: int) -> list[Array]:
    """The straight line, bent at random by ever more."""
    rng, line = np.random.default_rng(21), problem.polyline()
    return [problem.clip(line + share * rng.normal(size=line.shape)) for share in np.linspace(0.0, 0.6, count)]


def assert_same(one: Evaluation, other: Evaluation) -> None:
    assert one.cost == pytest.approx(other.cost, rel=ROUNDING)
    for part in PARTS:
        first, second = getattr(one, part), getattr(other, part)
        np.testing.assert_allclose(first, second, rtol=0, atol=ROUNDING * max(np.abs(second).max(), 1.0))


@pytest.mark.sampled(2)
def test_the_loop_equals_numpy(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = motions(problem, 5)
    compiled = [problem.evaluate(positions, WEIGHT) for positions in tried]
    depths = [problem.depth(positions, np.linspace(0, 1, len(positions))) for positions in tried]
    assert any(each.penalty > 0.0 for each in compiled)
    in_numpy(monkeypatch, broad_phase, forward, hdsdf, problems, samples)
    for term in problem.terms.pairs:
        monkeypatch.setitem(vars(term), "record", None)
    for positions, found, depth in zip(tried, compiled, depths, strict=True):
        assert_same(found, problem.evaluate(positions, WEIGHT))
        plain = problem.depth(positions, np.linspace(0, 1, len(positions)))
        np.testing.assert_allclose(depth, plain, rtol=0, atol=ROUNDING)


@pytest.mark.sampled(2)
def test_threads_and_pickles_give_the_same_bits(problem: Problem) -> None:
    tried = motions(problem, 8)
    alone = [problem.evaluate(positions, WEIGHT) for positions in tried]
    copied = pickle.loads(pickle.dumps(problem))  # what an evaluation has left behind in it travels
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda positions: problem.evaluate(positions, WEIGHT), tried))
    for one, other, third in zip(alone, together, (copied.evaluate(each, WEIGHT) for each in tried), strict=True):
        for part in ("cost", *PARTS):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
            np.testing.assert_array_equal(getattr(one, part), getattr(third, part))


def test_one_configuration_or_none(problem: Problem) -> None:
    q = problem.polyline()
    together = problem.depth(q)
    for k in (0, len(q) // 2):
        assert problem.depth(q[k : k + 1]) == pytest.approx(together[k], abs=ROUNDING)
    assert problem.depth(q[:0]).shape == (0,)


def test_a_step_as_by_scipy(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Coordinates held at their limits, and motions with very few waypoints, too."""
    for positions in [*motions(problem, 5), problem.polyline()[[0, 1, -1]], problem.polyline()[[0, 1, 2, -1]]]:
        tried = positions.copy()
        tried[1] = problem.robot.inner[1]
        few = replace(problem, smoothness=replace(problem.smoothness, waypoints=len(tried)))
        few = replace(few, terms=replace(few.terms, velocity=None))
        if len(tried) != problem.waypoints:
            few = replace(few, samples=Samples((2,) * (len(tried) - 1)))
        state = few.evaluate(tried, WEIGHT)
        with monkeypatch.context() as patched:
            found = newton_step.newton_step(few, tried, state, 1e-3)
            in_numpy(patched, newton_step)
            expected = newton_step.newton_step(few, tried, state, 1e-3)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        assert not found[0].any()
        assert not found[-1].any()


def test_no_step_where_the_hessian_is_not_positive_definite(problem: Problem) -> None:
    line = problem.polyline()
    state = problem.evaluate(line, WEIGHT)
    with pytest.raises(np.linalg.LinAlgError):
        newton_step.newton_step(problem, line, replace(state, diagonal=-1e9 - state.diagonal), 1e-3)
