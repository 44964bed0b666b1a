"""roboplan for `peers`: its RRT-Connect, then its shortcuts, both with collisions looked at every `step` [rad].

Its collision test is coal's, as ours; it keeps no margin.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from peer_server import serve
from roboplan.core import (
    JointConfiguration,
    PathShortcutter,
    PathShortcuttingOptions,
    Scene,
    loadUrdfSceneDescriptionFromXml,
)
from roboplan.rrt import RRT, RRTOptions

NODES = 1_000_000  # the time limit ends the search
SEED = 1


def solve(request: dict[str, Any]) -> dict[str, Any]:
    """Plan one task."""
    began = time.process_time()
    scene = Scene("task", loadUrdfSceneDescriptionFromXml(request["urdf"]))
    scene.importSrdf(request["srdf"])
    group, step = request["group"], request["step"]
    ready = time.process_time()
    options = RRTOptions(
        group,
        max_nodes=NODES,
        collision_check_step_size=step,
        max_planning_time=request["time_limit"],
        rrt_connect=True,
    )
    planner = RRT(scene, options)
    planner.setRngSeed(SEED)
    start, goal = (JointConfiguration(request["joints"], np.array(request[end])) for end in ("start", "goal"))
    try:
        found = planner.plan(start, goal)
    except RuntimeError:  # not found
        return {"path": None, "setup": ready - began, "seconds": time.process_time() - ready}
    short = PathShortcutter(scene, PathShortcuttingOptions(group, max_step_size=step, seed=SEED)).shortcut(found)
    done = time.process_time()
    return {"path": [q.tolist() for q in short.positions], "setup": ready - began, "seconds": done - ready}


if __name__ == "__main__":
    serve(solve)
