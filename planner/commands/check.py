"""`hdplan check`: certify any joint trajectory."""

from __future__ import annotations

import json
from pathlib import Path

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.result import how_long, verdict
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.tables import closest_rows, limit_rows, table, verdict_text
from hdplan.scenes.errors import naming


def run_check(scene: GivenScene, trajectory: Path, *, as_json: bool) -> int:
    """Certify a motion. Returns the exit code: 0 if it is certified, else 1."""
    problem = scene.load()
    if problem.job is not None:
        from hdplan.planner.commands.job import run_check_job

        return run_check_job(problem, trajectory, as_json=as_json)
    motion = Trajectory.load(trajectory)
    with waiting("certifying", shown=not as_json):
        certifier = Certifier(Setup.of(problem))
        with naming(trajectory):  # its joints may not fit
            certificate = certifier.certify(motion)
    notes = list(dict.fromkeys((*certifier.setup.notes, *certificate.notes)))
    with printing() as show:
        if as_json:
            about = {
                "status": certificate.status.value,
                "text": certificate.text,
                "scene": problem.name,
                "robot": certifier.robot.name,
                "trajectory": str(trajectory),
                "joint_names": list(motion.joint_names),
                "waypoints": len(motion),
                **how_long(motion),
                "notes": notes,
            }
            times = {"certify": round(certificate.seconds, 6)}
            show(json.dumps({**about, **verdict(certificate), "time_s": times}))
        else:
            show(verdict_text(certificate))
            effort = (
                f"{certificate.configurations} configurations, {certificate.exact_calls} exact distances, "
                f"{certificate.seconds:.2f} s"
            )
            motion_row = ("motion", f"{motion.extent} of {certifier.robot.name} in {problem.name}")
            rows = [motion_row, *closest_rows(certificate), *limit_rows(certificate), ("proof", effort)]
            show(table([*rows, *(("note", note) for note in notes)]))
    return 0 if certificate.certified else 1
