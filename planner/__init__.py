"""The planner: from a scene to a certified motion (`plan`), and how a notebook or a page shows it.

The result of a plan is imported by the pictures; what it needs of them itself is imported here, on first use.
"""

from __future__ import annotations

from hdplan.scenes.lazy_imports import lazy_imports

_HOMES = {"result_html": "hdplan.planner.pictures.notebook", "result_page": "hdplan.planner.page.result_page"}

__getattr__ = lazy_imports(__name__, _HOMES)
