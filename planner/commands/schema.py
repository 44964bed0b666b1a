"""`hdplan schema`: print the scene format for editors."""

from __future__ import annotations

from hdplan.planner.terminal.console import printing
from hdplan.scenes.yaml_format.schema import schema_text


def run_schema() -> int:
    """Print the JSON Schema of scene files; return exit code 0."""
    with printing() as show:
        show(schema_text().rstrip())
    return 0
