"""`hdplan follow`: let a controller follow a motion, and certify what it executed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.text import Text

from hdplan.planner.control.follow import follow, follow_settings
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.motion.trajectory_files import check_output
from hdplan.planner.result import verdict
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.tables import closest_rows, table, verdict_text
from hdplan.scenes.errors import FieldError, InputError, naming
from hdplan.scenes.limits import Limits
from hdplan.scenes.number_text import read_number
from hdplan.scenes.scene import derived


def run_follow(
    scene: GivenScene,
    trajectory: Path,
    *,
    output: Path | None,
    rate: float | None,
    margin: float | None,
    limits: Sequence[str] | None,
    as_json: bool,
) -> int:
    """Follow a motion. Returns the exit code: 0 if the robot arrives and its motion is certified, else 1."""
    if output is not None:
        check_output(output)
    given = _limits(limits or ())
    settings = _settings(rate, margin)
    problem = scene.load()
    problem = derived(problem, limits=replace(problem.limits, **given))
    motion = Trajectory.load(trajectory)
    setup = Setup.of(problem)
    with waiting("following", shown=not as_json), naming(trajectory):  # it may not fit the scene
        found = follow(setup, motion, settings)
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


def _settings(rate: float | None, margin: float | None) -> ControlSettings:
    """Return the controller's settings. Raises InputError, naming the option, for values that are not allowed."""
    try:
        return follow_settings(rate, margin)
    except InputError as error:
        words = f"{error.where}: {error.problem}" if isinstance(error, FieldError) else str(error)
        raise InputError(f"--{words.removeprefix('control.')}") from None


def _limits(words: Sequence[str]) -> dict[str, Any]:
    """Return the limits that the command line gives, by name. Raises InputError for others than NAME=NUMBER."""
    found: dict[str, Any] = {}
    for word in words:
        name, sign, value = word.partition("=")
        if not sign or name not in DERIVATIVES or name in found:
            raise InputError(f"--limits {word}: must be one of {', '.join(DERIVATIVES)}, once each, as NAME=NUMBER")
        try:
            found[name] = read_number(value)
            Limits(**{name: found[name]})
        except FieldError as error:
            raise InputError(f"--limits {word}: {error.problem}") from None
        except ValueError:
            raise InputError(f"--limits {word}: must be NAME=NUMBER, found '{value}' for the number") from None
    return found
