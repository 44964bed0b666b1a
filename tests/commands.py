"""Runs `hdplan` in this process, as its command line is."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest

from hdplan import cli


class Done(NamedTuple):
    """What a run left behind."""

    code: int
    out: str
    err: str


Command = Callable[..., Done]


def in_process(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs `hdplan` with some arguments, on a terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments: object) -> Done:
        monkeypatch.setattr("sys.argv", ["hdplan", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return Done(int(end.value.code or 0), *capsys.readouterr())

    return run
