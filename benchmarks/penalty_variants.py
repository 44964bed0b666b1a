"""The penalties that `penalties` compares, as settings of the planner.

The second tells apart what smoothness does from what exactness does: at gamma 12 the HD-SDF has almost the kinks of a
plain maximum of minima, with the same planes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from hdplan.scenes.scene import Scene

VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "hdsdf": {"distance": "hdsdf"},
    "hdsdf, gamma 12": {"distance": "hdsdf", "gamma": 12},
    "fcl": {"distance": "fcl"},
}


def varied(scene: Scene, name: str, **settings: Any) -> Scene:
    """The scene with a variant's settings, and others."""
    planner: Any = dataclasses.replace(scene.planner, **VARIANTS[name], **settings)
    return dataclasses.replace(scene, planner=planner)
