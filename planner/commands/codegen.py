"""`hdplan codegen`: write a scene as C."""

from __future__ import annotations

import json
from pathlib import Path

from hdplan.planner.robot.setup import Setup
from hdplan.planner.symbolic.c_code import c_files, c_name
from hdplan.planner.symbolic.pairs import all_movable
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.tables import table
from hdplan.scenes.output import check_new_folder, write_folder


def run_codegen(scene: GivenScene, *, output: Path, as_json: bool) -> int:
    """Write kinematics, distances and penalty of a scene as C. Returns the exit code: 0."""
    output = output.absolute()  # also of "." and "..": a folder has a name and a place
    check_new_folder(output)
    requested = scene.load()
    with waiting("writing C"):
        found = all_movable(Setup.of(requested))
        files = c_files(found)
        write_folder(output, {name: text.encode() for name, text in files.items()})
    counts = {
        "prefix": c_name(found.setup.scene.name),
        "joints": found.setup.robot.n,
        "obstacles": len(found.movable),
        "pairs": len(found.names),
    }
    with printing() as show:
        if as_json:
            show(json.dumps({"folder": str(output), "files": list(files), **counts}))
            return 0
        show(f"{output}: {', '.join(files)}")
        show(table([(name, str(value)) for name, value in counts.items()]))
    return 0
