"""Commands as `cli.py` declares them: arguments and help, beside the name of the function that does the work."""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib import import_module
from typing import Any

import typer

from hdplan.planner.terminal.arguments import robot_with

Declared = Callable[..., None]


def command(group: typer.Typer, work: str, **fixed: Any) -> Callable[[Declared], Declared]:
    """Return a decorator of a command's declaration.

    `work` is a function of `planner.commands`, "MODULE.FUNCTION", which takes the arguments by their names, and those
    that are `fixed`, and returns the exit code. It is loaded when the command runs, so that help appears at once.
    """
    module, _, function = work.partition(".")

    def declare(declared: Declared) -> Declared:
        @functools.wraps(declared)
        def run(**given: Any) -> None:
            if "xacro_arg" in given:
                given["robot"] = robot_with(given["robot"], given.pop("xacro_arg"))
            home = import_module(f"hdplan.planner.commands.{module}")
            raise typer.Exit(getattr(home, function)(**given, **fixed))

        group.command()(run)
        return run

    return declare
