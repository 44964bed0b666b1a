"""Planners of `peers` that run in a process of their own, since their libraries do not load beside hdplan's.

A request holds the task as URDF and SRDF (`peer_urdf`), start and goal, the margin and the time limit, and what a row
of the table sets. Times are taken on the far side (`peer_server`). A planner that does not keep to its time limit is
ended.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from peer_server import READY
from peer_task import Answer, Task
from peer_urdf import describe

import hdplan

PATIENCE = 5.0  # [s] beyond the time limit, for set-up and the last iteration
LIBRARIES = Path(pin.__file__).resolve().parents[3]  # of the robotics packages; hpp-python does not name it


class Peer:
    """One planner's process."""

    def __init__(self, script: str) -> None:
        """Start it. Raises ImportError where its package is missing."""
        self.script = Path(__file__).with_name(script)
        self.folder = tempfile.TemporaryDirectory()
        self._start()

    def plan(self, task: Task, time_limit: float, **options: object) -> Answer:
        """Plan with the options of a row. Raises RuntimeError with the planner's message."""
        robot = describe(task, Path(self.folder.name))
        request = {**vars(robot), "start": task.start.tolist(), **_goal(task), "time_limit": time_limit, **options}
        reply = self._ask(request, time_limit + PATIENCE)
        if reply is None:
            return Answer(None, np.nan, time_limit)
        if "error" in reply:
            raise RuntimeError(reply["error"])
        path = np.array(reply["path"]) if reply["path"] else None
        return Answer(path, reply["setup"], reply["seconds"])

    def _start(self) -> None:
        paths = [str(LIBRARIES), os.environ.get("LD_LIBRARY_PATH", "")]
        self.process = subprocess.Popen(
            [sys.executable, str(self.script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1", "LD_LIBRARY_PATH": os.pathsep.join(filter(None, paths))},
        )
        atexit.register(self.process.kill)
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        if READY not in iter(self.process.stdout.readline, ""):  # some libraries print while they are imported
            raise ImportError(self.process.stderr.read().strip().splitlines()[-1])
        threading.Thread(target=self.process.stderr.read, daemon=True).start()

    def _ask(self, request: dict[str, object], patience: float) -> dict[str, Any] | None:
        """Return the reply; None if there is none in time, and then a new process waits for the next request."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        end = threading.Timer(patience, self.process.kill)
        end.start()
        print(json.dumps(request), file=self.process.stdin, flush=True)
        line = self.process.stdout.readline()
        end.cancel()
        if not line:
            self._start()
            return None
        reply: dict[str, Any] = json.loads(line)
        return reply


def _goal(task: Task) -> dict[str, object]:
    """The goal: joint values, or a pose of the hand in the world."""
    match getattr(task.scene.goal, "targets", ()):
        case (hdplan.PoseTarget() as target,):
            return {"pose": target.pose.matrix.tolist()}
    return {"goal": task.goal.tolist()}
