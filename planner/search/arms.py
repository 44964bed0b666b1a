"""Arms of one robot that only meet each other: ways of each alone, which guide the trees of all.

What several arms span has as many dimensions as they have joints, and nearly every random configuration has one of them
in contact. An arm without the others soon finds a way, as trees of its own joints look at its own pairs alone. Targets
with each arm somewhere on its way are free but for what the arms do to one another, and the trees of all joints grow
towards these. Some targets are drawn as elsewhere: the ways may pass so that no motion leads both along them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.corners import at, lengths, past_corners
from hdplan.planner.search.free_space import is_free, with_these_alone
from hdplan.planner.search.roadmap import around_line
from hdplan.planner.search.trees import Trees
from hdplan.scenes.array_types import Array, Mask

UNGUIDED_SHARE = 0.25  # share of the targets that are drawn as if there were no ways


class Arms:
    """The arms of a robot, none if it has but one, and the way of each that is found so far."""

    def __init__(self, problem: Problem, space: Record, rng: np.random.Generator, roots: Sequence[Array]) -> None:
        """Take the ways (S, n) from both ends with which trees begin."""
        self.problem, self.rng, self.arms = problem, rng, arms_of(problem)
        self.trees = [_alone(problem, space, rng, roots, arm) for arm in self.arms]
        self.ways = [_straight(tree) for tree in self.trees]

    def grow(self, targets: int, over: Callable[[], bool]) -> None:
        """Grow the trees of each arm that has no way yet."""
        for k, tree in enumerate(self.trees):
            if self.ways[k] is None and (way := tree.grow(targets, over)) is not None:
                self.ways[k] = past_corners(tree.space, way)

    def draw(self, count: int) -> Array:
        """Random configurations (count, n) for the trees of all joints."""
        drawn = around_line(self.problem, self.rng, count)
        if not self.arms:
            return drawn
        led = self.rng.uniform(size=count) >= UNGUIDED_SHARE
        for arm, way in zip(self.arms, self.ways, strict=True):
            if way is not None:
                length = lengths(way)
                places = self.rng.uniform(0.0, length[-1], int(led.sum()))
                drawn[np.ix_(led, arm)] = at(way, length, places)[:, arm]
        return drawn


def arms_of(problem: Problem) -> tuple[Mask, ...]:
    """The robot's joints by arms (n,) each: joints that move one and the same body are of one arm; none if all are."""
    robot, supports = problem.robot, problem.kinematics.supports
    leader = np.arange(robot.n) if robot.linkage is None else robot.linkage.leader
    arms: list[Mask] = []
    for joint in {body.joint for body in problem.bodies}:
        arm = np.zeros(robot.n, np.bool_)
        arm[leader[supports[joint]]] = True
        for other in filter(arm.dot, arms):
            arm |= other
        if arm.any():
            arms = [*(other for other in arms if not arm.dot(other)), arm]
    return tuple(sorted(arms, key=np.argmax)) if len(arms) > 1 else ()


def _alone(problem: Problem, space: Record, rng: np.random.Generator, roots: Sequence[Array], arm: Mask) -> Trees:
    """Trees of one arm, as if the others were not there: these stay at the start, and their pairs do not count."""

    def draw(count: int) -> Array:
        return np.where(arm, around_line(problem, rng, count), problem.start)

    return Trees(problem, with_these_alone(space, arm), rng, [np.where(arm, way, problem.start) for way in roots], draw)


def _straight(trees: Trees) -> Array | None:
    """The straight line, if it is free."""
    ends = np.stack([nodes[0] for nodes in trees.nodes])
    return ends if is_free(trees.space, *ends) else None
