"""Xacro, macros for URDF, expanded by ROS's own library (the package xacro), with arguments and packages of one robot.

The library keeps what it works on in its module: everything of that is made again for each file, so that no robot has a
part of one that was read before.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hdplan.scenes.errors import InputError, listed, nearest
from hdplan.scenes.once import ForkSafeLock
from hdplan.scenes.robot_files.packages import Packages
from hdplan.scenes.values import shorten

_expanding = ForkSafeLock()  # one file at a time


def expand_xacro(path: Path, packages: Packages, arguments: Mapping[str, str]) -> tuple[bytes, tuple[Path, ...]]:
    """Return the URDF that a xacro file is a recipe for, and the files that it includes or loads.

    Raises InputError without the library; for anything goes wrong in the file; for arguments that have no value, and
    for those that the file does not use.
    """
    try:
        import xacro
        from xacro import substitution_args
    except ImportError:
        raise InputError("xacro files need xacro, which is not installed: pip install xacro") from None
    if not hasattr(substitution_args, "_eval_find"):
        raise InputError("xacro files need another version of xacro: pip install 'xacro>=2.0'")
    given = _Arguments(arguments)
    with _expanding, _finding(substitution_args, packages), contextlib.redirect_stderr(io.StringIO()):
        xacro.all_includes.clear()
        xacro._global_symbols = xacro.create_global_symbols()  # an expression may have changed them
        try:
            text = xacro.process_file(str(path), mappings=given, verbosity=0).toxml()
        except Exception as error:  # whatever the expressions in the file raise
            raise _in_words(error) from None
        files = tuple(dict.fromkeys(Path(file).absolute() for file in xacro.all_includes))
    for name in arguments:
        if name not in given.used:
            words = f"used: {listed(sorted(given.used))}" if given.used else "the file uses none"
            near = nearest(name, given.used, words)
            raise InputError(f"robot.xacro_args: the file does not use the argument '{name}'{near}")
    return text.encode(), files


class _Arguments(dict[str, str]):
    """Values of arguments; the names that the file uses are kept."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.used: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.used.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.used.add(name)
        return super().__getitem__(name)


@contextlib.contextmanager
def _finding(library: Any, packages: Packages) -> Iterator[None]:
    """Let the library find packages here instead of in an installed ROS."""
    usual = library._eval_find

    def find(name: str) -> str:
        return str(packages.find(name))

    library._eval_find = library._eval_dict["find"] = find
    try:
        yield
    finally:
        library._eval_find = library._eval_dict["find"] = usual


def _in_words(error: BaseException) -> InputError:
    """Return the reason of a failure, in one line. The library wraps errors in errors; the innermost says what to
    do."""
    inner: BaseException | None = error
    while inner is not None:
        if isinstance(inner, InputError):
            return InputError(f"xacro: {inner}")
        if type(inner).__name__ == "ArgException":
            name = shorten(str(inner))
            hint = f"robot.xacro_args: {{{name}: ..}} or --xacro-arg {name}:=.. gives one"
            return InputError(f"xacro: the argument '{name}' has no value; {hint}")
        inner = getattr(inner, "exc", None) or inner.__context__
    return InputError(f"xacro: {' '.join(str(error).split()) or type(error).__name__}")
