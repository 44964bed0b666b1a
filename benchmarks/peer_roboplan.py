"""roboplan for `peers`: its RRT-Connect, then its shortcuts, both with collisions looked at every `step` [rad].

A pose as the goal is reached by one configuration, that of its simple inverse kinematics, which is tried until it is
free. Its collision test is coal's, as ours; it keeps no margin. Its time limit is by the clock; a limit of processor
time beside it ends the process.
"""

from __future__ import annotations

import signal
import time
from typing import Any

import numpy as np
from peer_server import serve
from roboplan.core import (
    CartesianConfiguration,
    JointConfiguration,
    PathShortcutter,
    PathShortcuttingOptions,
    Scene,
    loadUrdfSceneDescriptionFromXml,
)
from roboplan.rrt import RRT, RRTOptions
from roboplan.simple_ik import SimpleIk, SimpleIkOptions

NODES = 1_000_000  # the time limit ends the search
SEED = 1
RESTARTS = 1_000_000  # likewise
CLOSE = 5e-4  # [m], [rad] half of hdplan's tolerance of a pose, in metres


def solve(request: dict[str, Any]) -> dict[str, Any]:
    """Plan one task."""
    signal.setitimer(signal.ITIMER_PROF, 0.0)  # the last task's ends
    began = time.process_time()
    scene = Scene("task", loadUrdfSceneDescriptionFromXml(request["urdf"]))
    scene.importSrdf(request["srdf"])
    group, step = request["group"], request["step"]
    ready = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, request.get("of_processor", 0.0))  # 0: no limit
    limits = {"max_nodes": NODES, "max_planning_time": request["time_limit"]}
    planner = RRT(scene, RRTOptions(group, collision_check_step_size=step, rrt_connect=True, **limits))
    planner.setRngSeed(SEED)
    start = JointConfiguration(request["joints"], np.array(request["start"]))
    try:
        found = planner.plan(start, _goal(scene, start, request))
    except RuntimeError:  # not found
        return {"path": None, "setup": ready - began, "seconds": time.process_time() - ready}
    short = PathShortcutter(scene, PathShortcuttingOptions(group, max_step_size=step, seed=SEED)).shortcut(found)
    done = time.process_time()
    return {"path": [q.tolist() for q in short.positions], "setup": ready - began, "seconds": done - ready}


def _goal(scene: Scene, start: JointConfiguration, request: dict[str, Any]) -> JointConfiguration:
    """Raises RuntimeError if the pose is not reached."""
    goal = JointConfiguration(request["joints"], np.array(request.get("goal", request["start"])))
    if "pose" in request:
        pose = CartesianConfiguration(request["base"], request["tip"], np.array(request["pose"]))
        limits = {"max_time": request["time_limit"], "max_restarts": RESTARTS}
        close = {"max_linear_error_norm": CLOSE, "max_angular_error_norm": CLOSE}
        kinematics = SimpleIk(scene, SimpleIkOptions(request["group"], **limits, **close))
        kinematics.setRngSeed(SEED)
        if not kinematics.solveIk(pose, start, goal):
            raise RuntimeError("no inverse kinematics")
    return goal


if __name__ == "__main__":
    serve(solve)
