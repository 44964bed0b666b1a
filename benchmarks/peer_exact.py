"""OMPL's planners for `narrow`, with hdplan's own checker: exact distances of the links' hulls, lines that are proven.

A state is a line of no length. OMPL asks by a Python function, a few microseconds of the tens to hundreds that a line
takes in C. The same is kept apart by the same distances as where hdplan's trees grow.
"""

from __future__ import annotations

import itertools
import time

import numpy as np
from ompl import base, geometric, util
from peer_ompl import path_of, simple_setup

import hdplan
from hdplan.distance.compiled.loops import C, Record
from hdplan.planner.build import problem_of
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.assemble import exactly
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.end_clearance import reachable_clearance
from hdplan.planner.search.free_space import free_space
from hdplan.planner.search.goals import settled
from hdplan.scenes.array_types import Array

RANGE = 0.5  # of a step of those planners that take steps [rad or m], as in hdplan's trees


def solve(scene: hdplan.Scene, planner: str, seed: int, time_limit: float) -> tuple[str, float]:
    """Search for any way with OMPL's geometric planner of that name.

    It begins again with the next seed where a way is not certified, as where hulls overlap at an end already.
    Returns "certified", or why not, and the time [s] from the scene to the certificate.
    """
    began = time.perf_counter()
    chosen = settled(Setup.of(scene))  # of several goals the most promising one
    problem, certifier = exactly(problem_of(chosen)), Certifier(chosen)
    required, _ = reachable_clearance(chosen, certifier)
    space = free_space(problem, required)
    assert space is not None
    ends = np.stack([problem.start, problem.goal])
    lower, upper = problem.robot.lower, problem.robot.upper
    turns = np.isinf(lower)  # for ever: half a turn beyond the ends is enough
    lower = np.where(turns, -np.pi, np.minimum(lower - ends.min(axis=0), 0.0)) + ends.min(axis=0)
    upper = np.where(turns, np.pi, np.maximum(upper - ends.max(axis=0), 0.0)) + ends.max(axis=0)
    ending, found = time.perf_counter() + time_limit, "no way"
    for again in itertools.count(seed):
        util.RNG.setSeed(again)
        setup = simple_setup(lower, upper, *ends)
        information = setup.getSpaceInformation()
        free = _Free(information, space, problem.robot.n)
        setup.setStateValidityChecker(free.state)
        information.setMotionValidator(free)
        method = getattr(geometric, planner)(information)
        if hasattr(method, "setRange"):
            method.setRange(RANGE)
        if hasattr(method, "setStopOnSolnImprovement"):
            method.setStopOnSolnImprovement(True)  # at the first way: BIT* shows none before it stops
        setup.setPlanner(method)
        setup.setup()
        met = base.exactSolnPlannerTerminationCondition(setup.getProblemDefinition())
        setup.solve(base.PlannerTerminationCondition(lambda met=met: time.perf_counter() > ending or met()))
        if (path := path_of(setup, problem.robot.n)) is None:
            break
        motion = Trajectory(problem.robot.joint_names, path, problem.robot.locked)
        certificate = certifier.certify(motion, required=required)
        found = "certified" if certificate.certified else f"not certified: {certificate.text}"
        if certificate.certified or time.perf_counter() > ending:
            break
    return found, time.perf_counter() - began


class _Free(base.MotionValidator):  # type: ignore[misc]  # OMPL has no types
    """Proof that lines are free."""

    def __init__(self, information: base.SpaceInformation, space: Record, joints: int) -> None:
        super().__init__(information)
        self.space, self.joints = space, range(joints)

    def _at(self, state: base.State) -> Array:
        return np.array([state[joint] for joint in self.joints])

    def state(self, state: base.State) -> bool:
        """True if a state is free."""
        q = self._at(state)
        return bool(C.is_free(self.space.struct, q, q))

    def checkMotion(self, first: base.State, last: base.State) -> bool:
        """True if a line is free."""
        return bool(C.is_free(self.space.struct, self._at(first), self._at(last)))
