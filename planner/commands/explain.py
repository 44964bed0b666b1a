"""`hdplan explain`: explain the planning problem of a scene."""

from __future__ import annotations

import json

from rich.text import Text

from hdplan.planner.build import problem_of
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.explain import explain
from hdplan.planner.terminal.tables import table
from hdplan.scenes.errors import naming


def run_explain(scene: GivenScene, *, as_json: bool) -> int:
    """Build the problem and print its parts. Returns the exit code: 0."""
    problem = scene.load()
    with waiting("building the problem"):
        with naming(problem.source):
            problem.check_effects()
        sections = explain(problem_of(Setup.of(problem)))
    with printing() as show:
        if as_json:
            show(json.dumps({title: dict(rows) for title, rows in sections.items()}))
            return 0
        for title, rows in sections.items():
            if rows:
                show(Text(title, style="bold"))
                show(table(rows))
    return 0
