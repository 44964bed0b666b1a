"""OMPL's sampling planners for `peers`, in joint space, with straight lines between the states of a path.

A state is valid if no pair of bodies is within the task's margin: coal's collision test, all pairs in one call of
Pinocchio's in C++, with a broad phase. OMPL asks by a Python function, a few microseconds of the ten or so that an
answer takes. Edges are checked at steps of `resolution` (OMPL's DiscreteMotionValidator); what is found is simplified
as OMPL's SimpleSetup does it, in the time that is left.
"""

from __future__ import annotations

import time

import numpy as np
import pinocchio as pin
from ompl import base, geometric, util
from peer_task import Answer, Task

from hdplan.scenes.array_types import Array

STARTS_WRONG = "AORRTC"  # gives the goal alone where the straight line is free (OMPL's issue 1420): it is tried before

util.setLogLevel(util.LOG_NONE)  # else OMPL complains whenever its generator is seeded again


def solve(task: Task, planner: str, resolution: float | None, margin: float, seed: int, time_limit: float) -> Answer:
    """Plan with OMPL's geometric planner of that name, edges checked at steps of `resolution` [rad] (OMPL's default
    without), bodies kept `margin` [m] apart. A planner that keeps improving its path uses the whole time limit."""
    began = time.process_time()
    util.RNG.setSeed(seed)  # of all generators made later; 0 would be ignored
    setup = simple_setup(task.lower, task.upper, task.start, task.goal)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(_Validity(task, margin))
    if resolution is not None:
        information.setStateValidityCheckingResolution(resolution / setup.getStateSpace().getMaximumExtent())
    setup.setPlanner(getattr(geometric, planner)(information))
    setup.setup()
    ready = time.process_time()
    ends = setup.getProblemDefinition()
    if planner == STARTS_WRONG and information.checkMotion(ends.getStartState(0), ends.getGoal().getState()):
        return Answer(np.stack([task.start, task.goal]), ready - began, time.process_time() - ready)
    setup.solve(time_limit)
    found = setup.haveExactSolutionPath()
    left = time_limit - (time.process_time() - ready)
    if found and left > 0.0:
        setup.simplifySolution(left)
    done = time.process_time()
    return Answer(path_of(setup, task.robot.n), ready - began, done - ready)


def simple_setup(lower: Array, upper: Array, start: Array, goal: Array) -> geometric.SimpleSetup:
    """OMPL's task of a way between two configurations (n,) within limits (n,)."""
    space, bounds = base.RealVectorStateSpace(len(lower)), base.RealVectorBounds(len(lower))
    for joint, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
        bounds.setLow(joint, low)
        bounds.setHigh(joint, high)
    space.setBounds(bounds)
    setup, ends = geometric.SimpleSetup(space), (space.allocState(), space.allocState())
    for state, q in zip(ends, (start, goal), strict=True):
        for joint, value in enumerate(q.tolist()):
            state[joint] = value
    setup.setStartAndGoalStates(*ends)
    return setup


def path_of(setup: geometric.SimpleSetup, joints: int) -> Array | None:
    """Return the way (N, n) that was found, if any."""
    if not setup.haveExactSolutionPath():
        return None
    return np.array([[state[joint] for joint in range(joints)] for state in setup.getSolutionPath().getStates()])


class _Validity:
    """Check that a state keeps the margin; owns the objects behind the broad phase's pointers."""

    def __init__(self, task: Task, margin: float) -> None:
        robot = task.robot
        self.model, self.joints = robot.model, range(robot.n)
        self.configuration = robot.pin_q if robot.model.nq > robot.n else np.asarray  # the same numbers, mostly
        self.data, self.geometry = robot.model.createData(), task.geometry()
        self.found = pin.GeometryData(self.geometry)
        for request in self.found.collisionRequests:
            request.security_margin = margin
        self.broad = pin.BroadPhaseManager_NaiveCollisionManager(self.model, self.geometry, self.found)

    def __call__(self, state: base.State) -> bool:
        q = self.configuration(np.array([state[joint] for joint in self.joints]))
        return not pin.computeCollisions(self.model, self.data, self.broad, q, True)
