"""`hdplan verify`: check a proof with the checker that shares nothing with hdplan."""

from __future__ import annotations

from pathlib import Path

from hdplan.planner.terminal.console import printing
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify import RejectedError, verify


def run_verify(scene: str, trajectory: Path, proof: Path) -> int:
    """Check a proof, and print what it proves or why not. Returns the exit code: 0 if it is accepted, else 1."""
    try:
        said, code = verify(find_scene(scene), trajectory, proof), 0
    except RejectedError as error:
        said, code = f"rejected: {error}", 1
    with printing() as show:
        show(said)
    return code
