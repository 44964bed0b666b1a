"""Sliding the end of a motion along its goal set, while the motion is improved.

A pose leaves a redundant arm, or a free axis, a choice of configurations. With g the derivative of the cost with
respect to the goal and J the Jacobian of the pose error,

    dq = −(I − J⁺ J) g

is the way along the set on which the cost falls: for a straight motion, whose cost is about half the square of its
length, the whole way to the nearest configuration of the set. A few steps back to the pose follow.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.kinematics.inverse import Aim, damped_step, self_motion
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.goals import may_end
from hdplan.planner.search.search import Slide
from hdplan.planner.solvers.solution import Solution
from hdplan.scenes.array_types import Array
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.targets import JointTarget

SHORTEST_SLIDE = 0.005  # [rad] or [m] a shorter way is none
BACK = 3  # steps back to the pose
TOLERANCE_SHARE = 0.75  # share of the tolerance


def sliding(certifier: Certifier, goal: JointTarget, required: float) -> Slide | None:
    """Return the function that moves the end of a motion from configuration `goal` along its goal set, where it keeps
    `required` [m]. None where there is no choice, and with path constraints, as the end would have to keep them too."""
    scene = certifier.scene
    if isinstance(scene.goal, JointTarget) or scene.path != PathConstraints():
        return None
    target = next(target for target in scene.goal.targets if target.field == goal.field)
    if isinstance(target, JointTarget):
        return None
    aim = Aim.at(certifier.robot, target)
    return lambda problem, solution, farthest: _slid(certifier, aim, required, problem, solution, farthest)


def _slid(
    certifier: Certifier, aim: Aim, required: float, problem: Problem, solution: Solution, farthest: float
) -> Array | None:
    """Return a configuration (n,) of the goal set, at most `farthest` away [rad or m], in which a solution would better
    end; None if there is none."""
    robot, q = problem.robot, problem.goal[None]
    push = problem.evaluate(solution.trajectory.positions, solution.weight).at_goal
    way = self_motion(-push[None], aim.linearized(q)[1])
    longest = np.abs(way).max()
    if longest < SHORTEST_SLIDE:
        return None
    q = np.clip(q + way * min(1.0, farthest / longest), robot.lower, robot.upper)
    for _ in range(BACK):
        q = damped_step(robot, q, *aim.linearized(q))
    end: Array = q[0]
    falls = push @ (end - problem.goal) < 0.0  # near a singular configuration the way back may be the longer one
    reached = aim.within(aim.linearized(q)[0], TOLERANCE_SHARE)[0]
    return end if falls and reached and may_end(certifier, end, required) else None
