"""Lazy imports, so that start-up stays quick: a package's names from modules below it, and heavy libraries."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_imports(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """``__getattr__`` of a package that offers names of other modules: `homes` maps each name to its module."""

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        if homes[name] == package:
            return import_module(f"{package}.{name}")  # a module below it
        return getattr(import_module(homes[name]), name)

    return find


def lazy_names(package: str, file: str, *own: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package with the path `file`, whose public names are listed
    once, in the stub file (``.pyi``) beside it: ``from module import name as name``, or under a name of its own,
    ``from module import name`` and ``other = name``. `own` are names that the package itself defines."""
    homes: dict[str, str] = {}
    called: dict[str, str] = {}  # what has another name in its module
    for line in ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8")).body:
        if isinstance(line, ast.ImportFrom):
            homes |= {each.name: str(line.module) for each in line.names}
        elif isinstance(line, ast.Assign):
            called[line.targets[0].id] = line.value.id  # type: ignore[attr-defined]
    find = lazy_imports(package, homes)
    names = sorted([*(homes.keys() - called.values()), *called, *own])
    return lambda name: find(called.get(name, name)), lambda: names, names


class LazyModule:
    """A library that is imported when something of it is used for the first time."""

    def __init__(self, name: str) -> None:
        """Take the library's name."""
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        """Return the library's object of this name."""
        return getattr(import_module(self._name), attribute)


scipy: Any = LazyModule("scipy")  # its parts too; a plan with a robot that is known needs nothing of it
trimesh: Any = LazyModule("trimesh")  # with its imports, half of the time until a robot is first seen
