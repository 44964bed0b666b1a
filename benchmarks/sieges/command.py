"""hdplan's command line in this process, with all that it prints, by whatever way, kept."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import sys
import tempfile
import threading
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

_build = typer.main.get_command


@dataclass(frozen=True)
class Done:
    """Result of a run."""

    code: int
    out: str
    err: str
    crash: str = ""  # the traceback of an exception that came through


def hdplan(*arguments: str, folder: Path) -> Done:
    """Run `hdplan` with these arguments in a folder."""
    from hdplan import cli
    from hdplan.planner.terminal import console

    typer.main.get_command = _parser
    console.LONG_WAIT = threading.TIMEOUT_MAX  # what is judged are errors, not how long a loaded machine takes
    before, crash, code = os.getcwd(), "", 0
    out, err = io.StringIO(), io.StringIO()
    os.chdir(folder)
    try:
        with _heard() as native, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            sys.argv = ["hdplan", *arguments]
            try:
                cli.main()
            except SystemExit as end:
                code = end.code if isinstance(end.code, int) else int(end.code is not None)
            except BaseException as error:
                if isinstance(error, KeyboardInterrupt):
                    raise
                crash = "".join(traceback.format_exception(error))
    finally:
        os.chdir(before)
    return Done(code, out.getvalue(), err.getvalue() + "".join(native), crash)


@functools.cache
def _parser(app: typer.Typer) -> Any:
    """Build the command line's parser once: it takes longer than a check."""
    return _build(app)


@contextlib.contextmanager
def _heard() -> Iterator[list[str]]:
    """Keep what libraries write to the streams themselves."""
    messages: list[str] = []
    with tempfile.TemporaryFile() as file:
        kept = [os.dup(stream) for stream in (1, 2)]
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
        try:
            yield messages
        finally:
            for stream, old in zip((1, 2), kept, strict=True):
                os.dup2(old, stream)
                os.close(old)
            file.seek(0)
            messages.append(file.read().decode(errors="replace"))
