"""`hdplan robots`: list the robots that go by name, show one, or write an SRDF for one that has none."""

from __future__ import annotations

import json
from pathlib import Path

from rich.text import Text

from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.robots import describe, listing, named_or_read
from hdplan.planner.terminal.tables import columns
from hdplan.scenes.errors import InputError
from hdplan.scenes.output import check_writable, write_output
from hdplan.scenes.robot_spec import RobotSpec


def run_robots(robot: str | RobotSpec | None, *, srdf: Path | None, as_json: bool) -> int:
    """Load every robot, or the one of this name or file. Returns the exit code: 0."""
    if srdf is not None:
        return _write_srdf(robot, srdf, as_json=as_json)
    with waiting("loading every robot" if robot is None else f"loading {_called(robot)}"):
        tables = listing() if robot is None else describe(robot)
    with printing() as show:
        if as_json:
            show(json.dumps(tables))
            return 0
        for title, rows in tables.items():
            if rows:
                show(Text(title.replace("_", " "), style="bold"))
                show(columns(rows))
    return 0


def _called(robot: str | RobotSpec) -> str:
    return robot if isinstance(robot, str) else str(robot.urdf)


def _write_srdf(name: str | RobotSpec | None, output: Path, *, as_json: bool) -> int:
    from hdplan.planner.robot.srdf import MADE_HERE, srdf_of

    if name is None:
        raise InputError("--srdf: of which robot? Name it, or give its description")
    check_writable(output, (".srdf",))
    if output.exists() and MADE_HERE not in output.read_text(encoding="utf-8", errors="replace"):
        raise InputError(
            f"--srdf: {output} exists, and was not made by hdplan: it is not overwritten; name another file"
        )
    with waiting(f"comparing the links of {_called(name)}"):
        text, counts = srdf_of(named_or_read(name))
    write_output(output, text.encode())
    with printing() as show:
        if as_json:
            show(json.dumps({"srdf": str(output), "pairs": counts}))
            return 0
        words = ", ".join(f"{count} {reason.lower()}" for reason, count in counts.items())
        show(Text(f"{output}: {sum(counts.values())} link pairs that need no check: {words}"))
    return 0
