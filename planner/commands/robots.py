"""`hdplan robots`: list the robots that are known by name, or show one of them."""

from __future__ import annotations

import json

from rich.text import Text

from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.robots import describe, listing
from hdplan.planner.terminal.tables import columns


def run_robots(name: str | None, *, as_json: bool) -> int:
    """Load every robot, or the one of this name. Returns the exit code: 0."""
    with waiting("loading every robot" if name is None else f"loading {name}"):
        tables = listing() if name is None else describe(name)
    with printing() as show:
        if as_json:
            show(json.dumps(tables))
            return 0
        for title, rows in tables.items():
            if rows:
                show(Text(title.replace("_", " "), style="bold"))
                show(columns(rows))
    return 0
