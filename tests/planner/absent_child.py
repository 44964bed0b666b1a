"""A child of test_absent: plans scenes in a fresh hdplan in which some modules cannot be imported.

Standard input: JSON list of runs (modules, scenes). Standard output: for each run scene -> what was built and planned.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import importlib.util
import json
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from typing import Any


class Missing:
    """A finder that refuses modules, and those within them."""

    def __init__(self, modules: Sequence[str]) -> None:
        if unknown := [name for name in modules if importlib.util.find_spec(f"hdplan.{name}") is None]:
            raise ValueError(f"no such module: {', '.join(unknown)}")
        self.modules = {f"hdplan.{name}" for name in modules}

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if any(name == module or name.startswith(f"{module}.") for module in self.modules):
            raise ImportError(f"absent: {name}")
        return None


def planned(name: str) -> dict[str, Any]:
    """Build and plan one scene; `X without self-collision` is scene X with self_collision: false."""
    hdplan = importlib.import_module("hdplan")
    obstacles = importlib.import_module("hdplan.scenes.obstacles")
    scene = hdplan.load_scene(name.split(" ")[0])
    if " without " in name:
        scene = dataclasses.replace(scene, self_collision=obstacles.SelfCollision(checked=False))
    try:
        problem, result = hdplan.build(scene), hdplan.plan(scene)
    except ImportError as error:
        if not str(error).startswith("absent: "):
            raise
        return {"status": "cannot import"}
    functions = [
        problem.kinematics.state,
        *(each.expand() for term in problem.terms for each in term.functions.values()),
    ]
    return {
        "status": result.certificate.status.value,
        "terms": [term.name for term in problem.terms],
        "pairs": [len(term.pairs) for term in problem.terms.pairs],
        "functions": [(f.name(), f.n_instructions(), f.n_nodes()) for f in functions],
        "waypoints": hashlib.sha256(result.trajectory.positions.tobytes()).hexdigest(),
        "iterations": result.iterations,
        "text": result.certificate.text,
        "notes": list(result.notes),
    }


def main() -> None:
    """Do every run with modules of its own."""
    found = []
    for modules, scenes in json.load(sys.stdin):
        finder = Missing(modules)
        for name in [name for name in sys.modules if name.split(".")[0] == "hdplan"]:
            del sys.modules[name]
        sys.meta_path.insert(0, finder)
        found.append({scene: planned(scene) for scene in scenes})
        sys.meta_path.remove(finder)
    print(json.dumps(found))


main()
