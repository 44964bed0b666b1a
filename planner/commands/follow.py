"""`hdplan follow`: let a controller follow a motion, and certify what it executed."""

from __future__ import annotations

import json
from pathlib import Path

from rich.text import Text

from hdplan.planner.control.follow import follow
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.motion.trajectory_files import check_output
from hdplan.planner.result import verdict
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.tables import closest_rows, table, verdict_text
from hdplan.scenes.errors import naming
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.yaml_format.reader import load_scene


def run_follow(
    scene: str,
    trajectory: Path,
    request: Path | None,
    robot: str | RobotSpec | None,
    *,
    output: Path | None,
    as_json: bool,
) -> int:
    """Follow a motion. Returns the exit code: 0 if the robot arrives and its motion is certified, else 1."""
    if output is not None:
        check_output(output)
    problem = load_scene(scene, request=request, robot=robot)
    motion = Trajectory.load(trajectory)
    setup = Setup.of(problem)
    with waiting("following", shown=not as_json), naming(trajectory):  # it may not fit the scene
        found = follow(setup, motion)
    if output is not None:
        found.trajectory.save(output, verdict(found.certificate))
    with printing() as show:
        if as_json:
            about = {"scene": problem.name, "robot": setup.robot.name, "trajectory": str(trajectory)}
            show(json.dumps({**about, **found.summary()}))
        else:
            show(Text(found.text, style="green" if found.succeeded else "red"))
            show(verdict_text(found.certificate))
            notes = [("note", note) for note in dict.fromkeys((*setup.notes, *found.certificate.notes))]
            rows = [*found.rows(), *closest_rows(found.certificate), *notes]
            show(table([*rows, *([("written", str(output))] if output is not None else [])]))
    return 0 if found.succeeded else 1
