"""The loops of C in tests: laws that need them, and their twins in their place."""

from __future__ import annotations

import inspect
import sys
from types import FunctionType, ModuleType

import pytest

from hdplan.distance.compiled.loops import C

needs_loops = pytest.mark.skipif(C is None, reason="built without a C compiler")


def in_numpy(patch: pytest.MonkeyPatch, *modules: ModuleType) -> None:
    """Let the functions of modules, and the methods of their classes, be those of a build without loops."""
    classes = [each for module in modules for each in vars(module).values() if inspect.isclass(each)]
    own = {each for owner in (*modules, *classes) for each in vars(owner).values() if hasattr(each, "twin")}
    importing = [module for name, module in sys.modules.items() if name.startswith(("hdplan.", "tests."))]
    for owner in (*importing, *classes):
        for name, function in list(vars(owner).items()):
            if isinstance(function, FunctionType) and function in own:
                patch.setattr(owner, name, function.twin)  # type: ignore[attr-defined]
    for module in modules:
        patch.setattr(module, "C", None, raising=False)
