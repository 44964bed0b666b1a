"""Lazy imports, so that start-up stays quick: a package's names from modules below it, and heavy libraries."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_imports(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a package that offers names from modules below it: `homes` maps each name to its
    module, relative to the package."""

    def find(name: str) -> Any:
        if name in homes:
            return getattr(import_module(f"{package}.{homes[name]}"), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return find


class LazyModule:
    """A library that is imported when something of it is used for the first time."""

    def __init__(self, name: str) -> None:
        """Take the library's name."""
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        """Return what the library has by this name."""
        return getattr(import_module(self._name), attribute)


scipy: Any = LazyModule("scipy")  # its parts too; a plan with a robot that is known needs nothing of it
