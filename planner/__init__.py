"""The planner: from a scene to a certified motion (`plan`), and, behind this door, how a notebook shows it.

The result of a plan stands below the pictures; what it needs of them it asks for here, when it is needed.
"""

from __future__ import annotations

from hdplan.scenes.doors import door

__getattr__ = door(__name__, {"result_html": "pictures.notebook"})
