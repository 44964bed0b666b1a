"""Typer's commands, started without Pydantic.

Typer checks every argument by Pydantic, which takes longer to load than a motion to plan. Ours are words, paths and
numbers with a parser of their own: they need no more than to be made such. Versions of Typer that keep no reader of
values with their parameters, or keep it elsewhere, check them as they do.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

MADE: dict[Any, Any] = {str: str, bool: bool, Path: Path, list[Path]: Path, list[str]: str}  # of a word


class Reader:
    """Reads the values of one parameter, in place of Typer's own reader."""

    def __init__(self, make: Any) -> None:
        """Take what makes a value of a word."""
        self.make = make

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the value of a word, or of each word where there may be several; a default is one already."""
        if param.nargs == -1 or param.multiple:
            return tuple(map(self.make, value or ()))
        return self.make(value) if isinstance(value, str) else value


def command_of(app: typer.Typer) -> Any:
    """Return the app as a command to be called with the arguments."""
    command = typer.main.get_command(app)
    _read_plainly(command)
    return command


def _read_plainly(command: Any) -> None:
    for parameter in command.get_params(typer.Context(command)):  # --help too
        descriptor = getattr(parameter, "type_descriptor", None)
        if descriptor is not None and hasattr(parameter, "_runtime_param"):
            make = getattr(descriptor.parameter_info, "parser", None) or MADE.get(descriptor.annotation)
            if make is not None:
                parameter._runtime_param = Reader(make)
    for below in getattr(command, "commands", {}).values():
        _read_plainly(below)
