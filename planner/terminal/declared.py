"""Commands as `cli.py` declares them: arguments and help, beside the name of the function that does the work."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from hdplan.planner.terminal.arguments import robot_with

if TYPE_CHECKING:
    from hdplan.scenes.robot_spec import RobotSpec
    from hdplan.scenes.scene import Scene

Declared = Callable[..., None]


@dataclass(frozen=True)
class GivenScene:
    """The scene of a command, as the command line names it."""

    scene: str
    request: Path | None = None  # MoveIt's, with its start and goal
    robot: str | RobotSpec | None = None  # in place of the scene's

    @property
    def robot_file(self) -> str | None:
        """The robot's name or file, for what refers to files; None for one with xacro arguments, which has neither."""
        return self.robot if isinstance(self.robot, str) else None

    def load(self) -> Scene:
        """Read it. Raises InputError."""
        from hdplan.scenes.yaml_format.reader import load_scene

        return load_scene(self.scene, request=self.request, robot=self.robot)


def command(group: typer.Typer, work: str, **fixed: Any) -> Callable[[Declared], Declared]:
    """Return a decorator of a command's declaration.

    `work` is a function of `planner.commands`, "MODULE.FUNCTION", which takes the arguments by their names (a scene
    with its request and its robot as one), and those that are `fixed`, and returns the exit code. It is loaded when the
    command runs, so that help appears at once.
    """
    module, _, function = work.partition(".")

    def declare(declared: Declared) -> Declared:
        @functools.wraps(declared)
        def run(**given: Any) -> None:
            if "robot" in given:
                given["robot"] = robot_with(given["robot"], given.pop("xacro_arg", None))
            if "request" in given:
                given["scene"] = GivenScene(given["scene"], given.pop("request"), given.pop("robot"))
            home = import_module(f"hdplan.planner.commands.{module}")
            raise typer.Exit(getattr(home, function)(**given, **fixed))

        group.command()(run)
        return run

    return declare
