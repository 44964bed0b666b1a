"""`hdplan plot`: draw a motion on one sheet."""

from __future__ import annotations

from pathlib import Path

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.plot import Subject, check_picture, plot
from hdplan.planner.result import read_steps
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.tables import table, verdict_text
from hdplan.scenes.errors import naming


def run_plot(scene: GivenScene, trajectory: Path, *, output: Path) -> int:
    """Draw a motion. Returns the exit code: 0 for every verdict."""
    check_picture(output)
    problem = scene.load()
    if problem.job is not None:
        from hdplan.planner.commands.job import run_plot_job

        return run_plot_job(problem, trajectory, output)
    motion, steps = Trajectory.load(trajectory), read_steps(trajectory)
    with waiting("drawing"):
        certifier = Certifier(Setup.of(problem))
        with naming(trajectory):  # its joints may not fit
            subject = Subject.of(certifier, motion, steps, trajectory.name)
        plot(subject, output)
    with printing() as show:
        show(verdict_text(subject.certificate))
        show(table([("written", str(output))]))
    return 0
