"""First guesses: the straight line, then lines through via configurations drawn at random and chosen by their penalty.

All draws come from one seeded generator, so the same seed gives the same guesses.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.problem import Problem

Floats = NDArray[np.float64]

CANDIDATES = 24  # via configurations drawn for each guess
LOOKS = 16  # configurations at which a candidate line is scored


def seeds(problem: Problem, seed: int) -> Iterator[Floats]:
    """Yield guesses (N, n) without end, the straight line first."""
    yield through(problem, [])
    rng = np.random.default_rng(seed)
    attempt = 0
    while True:
        attempt += 1
        spread = (0.3, 0.6, 1.0)[attempt % 3]
        count = 1 if attempt % 4 else 2
        candidates = [_via(problem, rng, count, spread) for _ in range(CANDIDATES)]
        looks = np.concatenate([_resample(np.array([problem.start, *via, problem.goal]), LOOKS) for via in candidates])
        penalty = problem.penalties(looks).reshape(CANDIDATES, LOOKS).sum(axis=1)
        yield through(problem, candidates[int(np.argmin(penalty))])


def through(problem: Problem, via: list[Floats]) -> Floats:
    """The polyline start – via – goal as N waypoints at equal steps of joint-space length."""
    return _resample(np.array([problem.start, *via, problem.goal]), problem.waypoints)


def _via(problem: Problem, rng: np.random.Generator, count: int, spread: float) -> list[Floats]:
    """Via configurations: points on the straight line, moved by up to `spread` of the joints' ranges."""
    robot, result = problem.robot, []
    for index, drawn in enumerate(robot.draw(rng, count)):
        middle = problem.start + (index + 1) / (count + 1) * (problem.goal - problem.start)
        result.append(np.clip(middle + spread * (drawn - middle), robot.lower, robot.upper))
    return result


def _resample(corners: Floats, count: int) -> Floats:
    """`count` points at equal steps along a polyline (C, n)."""
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    if lengths[-1] == 0:
        return np.repeat(corners[:1], count, axis=0)
    wanted = np.linspace(0, lengths[-1], count)
    return np.stack([np.interp(wanted, lengths, column) for column in corners.T], axis=1)
