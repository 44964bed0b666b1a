"""Bodies of well-known arms that come with the package, so that nobody waits for them.

They lie in a file by the content of the link's geometry, as in the cache: a link that differs in anything is fitted
anew. `benchmarks/shipped_bodies.py` adds what is missing; what is there stays, so that no motion changes for it.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np

from hdplan.planner.collision.sphere_swept_fit import Swept

FILE = Path(__file__).with_name("shipped_bodies.json")
ARMS = ("panda", "ur3_gripper", "ur5", "ur5_gripper", "ur10", "xarm7", "kinova", "z1")  # all of whose links are in it


def shipped_bodies(key: str) -> tuple[Swept, ...] | None:
    """Return the fitted bodies of the link whose geometry has this content, if they come with the package."""
    known = _read().get(key)
    return None if known is None else tuple(Swept(np.array(vertices), radius) for vertices, radius in known)


@cache
def _read() -> dict[str, list[tuple[list[list[float]], float]]]:
    return dict(json.loads(FILE.read_text(encoding="utf-8")))
