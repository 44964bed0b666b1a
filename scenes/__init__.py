"""Scenes: their content (`scene` and its parts), and how files hold it.

`Scene` is imported by the readers and writers of files; what it needs of them itself is imported here, on first use.
"""

from __future__ import annotations

from hdplan.scenes.lazy_imports import lazy_imports

__getattr__ = lazy_imports(__name__, {"scene_text": "hdplan.scenes.yaml_format.writer"})
