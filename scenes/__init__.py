"""Scenes: what they say (`scene` and its parts), and, behind this door, how a file says it.

A `Scene` stands below the readers and writers of files; what it needs of them it asks for here, when it is needed.
"""

from __future__ import annotations

from hdplan.scenes.doors import door

__getattr__ = door(__name__, {"scene_text": "yaml_format.writer"})
