"""A motion on one sheet: joints, clearance, convergence, and the scene from two sides; as PNG, PDF or SVG.

matplotlib is optional: only the modules that draw (`sheet`, `panels`, `scene` and others) import it, and only when a
picture is made.
"""

from __future__ import annotations

import importlib.util
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.setup import Setup
from hdplan.planner.solvers.solution import Iteration
from hdplan.scenes.errors import InputError
from hdplan.scenes.output import check_writable, write_output

if TYPE_CHECKING:
    from hdplan.planner.control.simulation import Simulation

PICTURES = (".png", ".pdf", ".svg")
PIXELS, FINE = 150, 300  # per inch: of a PNG; of the painted scene in vector formats


@dataclass(frozen=True, eq=False)
class Subject:
    """Contents of a sheet."""

    certifier: Certifier  # of the scene and its robot
    trajectory: Trajectory  # with the robot's planned joints, in its order
    certificate: Certificate
    steps: tuple[Iteration, ...]  # of the solver; empty if not known
    origin: str  # a short note on the motion's source

    @classmethod
    def of(cls, certifier: Certifier, trajectory: Trajectory, steps: tuple[Iteration, ...], name: str) -> Subject:
        """Take a trajectory of any planner, with its joints in any order, and certify it.

        Raises InputError for joints that do not match the robot's.
        """
        certificate, robot = certifier.certify(trajectory), certifier.robot
        ordered = trajectory.of_joints(robot.joint_names, robot.locked)
        iterations = f", {len(steps)} iterations" if steps else ""
        return cls(certifier, ordered, certificate, steps, f"{name}: {ordered.extent}{iterations}")

    @classmethod
    def planned(cls, setup: Setup, result: PlanResult) -> Subject:
        """Take the result of a plan, with its own certificate."""
        seconds = sum(vars(result.times).values())
        effort = f"{result.solver}, {result.iterations} iterations, {seconds:.2f} s from scene to verdict"
        origin = f"{result.trajectory.extent}, {effort}"
        return cls(Certifier(setup), result.trajectory, result.certificate, result.steps, origin)


def check_picture(path: str | Path) -> None:
    """Check early that a picture can be written to `path`.

    Raises InputError for an extension not in PICTURES, a path that cannot be written, or a missing matplotlib.
    """
    check_writable(Path(path), PICTURES)
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError(f"{path}: pictures need matplotlib, which is not installed: pip install matplotlib")


def plot(subject: Subject, path: str | Path) -> None:
    """Draw a motion and write the sheet to `path`, whole or not at all.

    Args:
        subject: certified or not.
        path: with an extension in PICTURES.

    Raises:
        InputError: another extension, no matplotlib, a path that cannot be written.
    """
    check_picture(path)
    from hdplan.planner.pictures.sheet import sheet

    write_picture(sheet(subject), Path(path))


def plot_simulation(simulation: Simulation, title: str, path: str | Path) -> None:
    """Draw the result of `hdplan simulate` and write it to `path`. Raises InputError like `plot`, and for a path
    without times."""
    check_picture(path)
    from hdplan.planner.pictures.simulation_sheet import simulation_sheet

    write_picture(simulation_sheet(simulation, title), Path(path))


def write_picture(figure: Any, path: Path) -> None:
    """Write a figure to a path of a picture, whole or not at all. Raises InputError."""
    picture, kind = io.BytesIO(), path.suffix.lower().removeprefix(".")
    figure.savefig(picture, format=kind, dpi=PIXELS if kind == "png" else FINE)
    write_output(path, picture.getvalue())
