"""Check a proof that a robot's motion is free: NumPy, PyYAML, and nothing of the planner that wrote the proof.

    hdplan verify SCENE MOTION PROOF     or, with this folder alone,     python -m verify SCENE MOTION PROOF

Scene, URDF, SRDF, meshes and motion are read into a *world* (`reading`, docs/world.md), by readers that share nothing
with hdplan's. The proof holds the world in which hdplan planned: the two must be equal (`compare`). Then the kernel
(`kernel`, `balls`, `world`, `effects`, `verdict`) checks the proof in that world, and reads no file.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .balls import RejectedError
    from .checking import Verdict, verify

__all__ = ["RejectedError", "Verdict", "verify"]


def __getattr__(name: str) -> Any:
    """Import public names on first use, so that the kernel can run alone."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = ".balls" if name == "RejectedError" else ".checking"
    return getattr(importlib.import_module(home, __name__), name)
