"""The planner: from a scene to a certified motion (`plan`), and, behind this door, how a notebook shows it.

The result of a plan stands below the pictures; what it needs of them it asks for here, when it is needed.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_BEHIND = {"result_html": "pictures.notebook"}


def __getattr__(name: str) -> Any:
    """Import the module of a name behind the door when it is first asked for."""
    if name in _BEHIND:
        return getattr(import_module(f"{__name__}.{_BEHIND[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
