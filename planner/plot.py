"""A result as one sheet: joints, clearance, convergence, and the scene from two sides; PNG, PDF or SVG by its ending.

matplotlib is optional: only this module's parts (plot_panels, plot_scene) import it, and only when a picture is wanted.
"""

from __future__ import annotations

import importlib.util
import io
from pathlib import Path

from hdplan.planner.output import check_writable, write_output
from hdplan.planner.result import PlanResult
from hdplan.planner.robot import Robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.model import Scene

PICTURES = (".png", ".pdf", ".svg")


def check_picture(path: str | Path) -> None:
    """Say early that no picture can be written to `path`.

    Raises InputError for another ending than PICTURES, a place that cannot be written, or a missing matplotlib.
    """
    check_writable(Path(path), PICTURES)
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError(f"{path}: pictures need matplotlib, which is not installed: pip install hdplan[plot]")


def plot_result(scene: Scene, robot: Robot, result: PlanResult, path: str | Path) -> None:
    """Draw `result` and write it to `path`, whole or not at all.

    Args:
        scene: the scene it was planned for.
        robot: the scene's robot, from load_scene_robot.
        result: certified or not.
        path: ends with one of PICTURES.

    Raises:
        InputError: another ending, no matplotlib, a path that cannot be written.
    """
    path = Path(path)
    check_picture(path)
    from hdplan.planner.plot_panels import sheet

    picture = io.BytesIO()
    sheet(scene, robot, result).savefig(picture, format=path.suffix.lower().removeprefix("."))
    write_output(path, picture.getvalue())
