"""The planner: from a scene to a certified motion (`plan`).

The module of results comes before the pictures in the order of imports, so it gets its notebook view from here, on use.
"""

from __future__ import annotations

from hdplan.scenes.doors import door

__getattr__ = door(__name__, {"result_html": "pictures.notebook"})
