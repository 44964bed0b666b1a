"""HPP (Humanoid Path Planner) for `peers`: its bidirectional RRT, then its random shortcuts.

`validation` is Discretized, which looks at collisions every `tolerance` [rad]; or Dichotomy, which by bounds of the
links' speeds proves that straight lines between configurations are free, as far as penetrations of `tolerance` [m].
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pinocchio as pin
import pyhpp.core
from peer_server import serve
from pyhpp.pinocchio import Device
from pyhpp.pinocchio.urdf import loadModelFromString

ITERATIONS = 1_000_000  # the time limit ends the search


def solve(request: dict[str, Any]) -> dict[str, Any]:
    """Plan one task."""
    began = time.process_time()
    robot = Device("task")
    loadModelFromString(robot, 0, "", "anchor", request["urdf"], request["srdf"], pin.SE3.Identity())
    problem = pyhpp.core.Problem(robot)
    problem.pathValidation(getattr(pyhpp.core, request["validation"])(robot, request["tolerance"]))
    problem.initConfig(np.array(request["start"]))
    problem.addGoalConfig(np.array(request["goal"]))
    ready = time.process_time()
    planner = pyhpp.core.BiRRTPlanner(problem)
    planner.maxIterations(ITERATIONS)
    planner.timeOut(request["time_limit"])
    try:
        found = planner.solve()
    except RuntimeError:  # not found
        return {"path": None, "setup": ready - began, "seconds": time.process_time() - ready}
    short = pyhpp.core.RandomShortcut(problem).optimize(found)
    done = time.process_time()
    path = [short.initial(), *(short.pathAtRank(part).end() for part in range(short.numberPaths()))]
    return {"path": [q.tolist() for q in path], "setup": ready - began, "seconds": done - ready}


if __name__ == "__main__":
    serve(solve)
