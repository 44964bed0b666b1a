"""Scenes: what they say (`scene` and its parts), and, behind this door, how a file says it.

A `Scene` stands below the readers and writers of files; what it needs of them it asks for here, when it is needed.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_BEHIND = {"scene_text": "yaml_format.writer"}


def __getattr__(name: str) -> Any:
    """Import the module of a name behind the door when it is first asked for."""
    if name in _BEHIND:
        return getattr(import_module(f"{__name__}.{_BEHIND[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
