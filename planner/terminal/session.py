"""One run of the command line: it prepares streams and signals, and turns every error into one line and an exit code.

Exit codes: 0 certified, 1 no certified motion was found, 2 bad input, 3 internal error, 130 interrupted before there
was anything to show, 143 terminated.
"""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import sys
import traceback
import warnings
from pathlib import Path
from typing import NoReturn

import typer

from hdplan.planner.terminal.console import say
from hdplan.planner.terminal.interrupts import INTERRUPTED, ended_by_signals
from hdplan.planner.terminal.plain_text import register
from hdplan.planner.terminal.quick_start import command_of
from hdplan.scenes.errors import DEBUG, HdplanError, TimeLimitError, debugging

# new objects before a search for cycles: imports make as many and drop none, a sixth of a start's time
NEW_OBJECTS = 50_000
NOT_CERTIFIED, BAD_INPUT, INTERNAL = 1, 2, 3
TyperError: type[Exception] = typer.BadParameter.__mro__[2]  # ClickException, wherever this Typer keeps its click


def run(app: typer.Typer) -> NoReturn:
    """Run the command line. Every error becomes one line, with exit code 2 if a user can cause it, else 3."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as by `>&-`
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names of files and obstacles hold any character
            stream.reconfigure(errors=register())
    gc.set_threshold(NEW_OBJECTS)
    atexit.register(gc.freeze)  # at the end all memory is given back, cycles included
    warnings.showwarning = lambda message, *_, **__: say(f"note: {message}", "yellow")  # a line, not a source location
    try:
        with ended_by_signals():
            code = command_of(app)(sys.argv[1:] or ["--help"], prog_name="hdplan", standalone_mode=False)
    except TimeLimitError as error:
        code = complain(str(error), NOT_CERTIFIED)
    except HdplanError as error:
        code = complain(str(error))
    except TyperError as error:
        command = context.command_path if (context := getattr(error, "ctx", None)) else "hdplan"
        code = complain(f"{error.format_message().rstrip('.')} (see {command} --help)")  # type: ignore[attr-defined]
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except OSError as error:  # while printing help; hdplan's own output handles its errors
        if error.errno not in (errno.EPIPE, errno.ENOSPC):
            code = _internal(error)
        else:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 0 if error.errno == errno.EPIPE else complain(f"the output cannot be written ({error.strerror})")
    except Exception as error:
        code = _internal(error)
    if code == INTERRUPTED:  # from Typer, or from KeyboardInterrupt above
        complain("interrupted before anything was found")
    sys.exit(code)


def complain(text: str, code: int = BAD_INPUT) -> int:
    """Print one line about what went wrong and return its exit code."""
    say(text, "red")
    return code


def _internal(error: Exception) -> int:
    """Print one line about an internal error, or all of it where DEBUG requires it, and return its exit code."""
    text = f"internal error, please report it with the scene and the command: {_fault(error)}"
    if not debugging():
        return complain(f"{text}; {DEBUG}=1 shows it whole", INTERNAL)
    traceback.print_exception(error)
    return complain(text, INTERNAL)


def _fault(error: Exception) -> str:
    """Name an internal error, and the line of hdplan from which it came."""
    below = traceback.extract_tb(error.__traceback__)[1:]  # the first is `run`
    own = [frame for frame in below if {"planner", "distance", "scenes"} & set(Path(frame.filename).parts)]
    place = next((f" ({Path(frame.filename).stem}, line {frame.lineno})" for frame in reversed(own)), "")
    return f"{type(error).__name__}: {' '.join(str(error).split())}{place}"
