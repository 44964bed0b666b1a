"""Ways out of narrow ends: from a start or goal close to obstacles to where nothing is near.

A gripper that holds its fingers beside a can has to leave straight back, and a straight line to anywhere else leads the
can through a finger. The way back is steepest descent, by damped Gauss-Newton steps, on the penalty of bodies that come
closer than FREE_AROUND; it is a guess like any other, and the certificate decides.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.collision.exact import ExactPairs
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.problem.clearance import Clearance
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.samples import Samples
from hdplan.scenes.array_types import Array

FREE_AROUND = 0.08  # [m] that nothing is nearer than in the end: about the opening of a gripper
MOST_STEPS, LONGEST_STEP, LEAST_STEP = (
    40,
    0.15,
    1e-3,
)  # steps at most, and how far the joint that moves most goes [rad or m]
DAMPING = 1e-2  # share of the mean curvature
CORNERS = 3  # of a way back, at most


def escapes(problem: Problem) -> tuple[Array, Array]:
    """The corners (C, n) of the ways back from the start, and from the goal, without the ends themselves; none where
    there is room already, and where a path constraint says how to move."""
    first, last = (_corners(way) for way in ways_back(problem))
    return first, last


def ways_back(problem: Problem) -> tuple[Array, Array]:
    """The ways step by step (S, n), from the ends on, which are part of them."""
    if problem.terms.path:
        return problem.start[None], problem.goal[None]
    terms = _with_room(problem)
    return _back(problem, terms, problem.start), _back(problem, terms, problem.goal)


def _corners(way: Array) -> Array:
    return way[np.linspace(1, len(way) - 1, min(CORNERS, len(way) - 1)).astype(np.int64)]


def _with_room(problem: Problem) -> tuple[Clearance, ...]:
    """The clearance of links and static obstacles, obstacles at FREE_AROUND."""
    settings, found = problem.scene.planner, []
    for term, more in (
        (problem.terms.obstacles, FREE_AROUND - settings.activation),
        (problem.terms.self_collision, 0.0),
    ):
        if term is None:
            continue
        if isinstance(term.distance, ExactPairs):
            distance = term.distance.enlarged(max(more, 0.0))
            found.append(Clearance(term.name, distance.pairs, distance))
            continue
        pairs = term.pairs.enlarged(max(more, 0.0))
        found.append(Clearance(term.name, pairs, HdsdfPairs(pairs, settings.gamma, settings.shaping_length)))
    return tuple(found)


def _back(problem: Problem, terms: tuple[Clearance, ...], end: Array) -> Array:
    way, once, fold = [end], Samples((1,)), problem.robot.fold
    for _ in range(MOST_STEPS):
        kinematics = problem.placed(way[-1])
        found = [term.at_samples(kinematics, once) for term in terms]
        gradient = fold(np.sum([penalty.gradient[0] for penalty in found], axis=0))
        if not np.any(gradient):
            break
        curvature = fold(fold(np.sum([penalty.curvature[0] for penalty in found], axis=0)).T)
        damped = curvature + DAMPING * np.trace(curvature) / len(end) * np.eye(len(end))
        step = -np.linalg.solve(damped, gradient)
        step *= min(1.0, LONGEST_STEP / np.abs(step).max())
        after = np.clip(way[-1] + step, *problem.robot.inner)
        if np.abs(after - way[-1]).max() < LEAST_STEP:
            break
        way.append(after)
    return np.array(way)
