"""Bodies of well-known robots that come with the package, and the proofs about their pairs, so that nobody waits for
them.

They lie in files by content, as in the cache: a link that differs in anything is fitted again. What was found are the
entries of the cache that take long to compute. `benchmarks/shipped_bodies.py` writes both; bodies that are there stay,
so that no motion changes for it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.distance.compiled.cache import Value, load, store
from hdplan.planner.collision.sphere_swept_fit import Swept

FILE = Path(__file__).with_name("shipped_bodies.json")
RESULTS = Path(__file__).with_name("shipped_results.json")  # kind -> key -> value
KINDS = ("overlaps", "separation")  # of results
ROBOTS = ("panda", "ur3_gripper", "ur5", "ur5_gripper", "ur10", "xarm7", "kinova", "z1", "baxter", "pr2", "tiago")


def shipped_bodies(key: str) -> tuple[Swept, ...] | None:
    """Return the fitted bodies of the link whose geometry has this content, if they come with the package."""
    known = _read().get(key)
    return None if known is None else tuple(Swept(np.array(vertices), radius) for vertices, radius in known)


def known_result(kind: str, key: str, read: Callable[[Any], Value]) -> Value | None:
    """Return the result of `read` for the JSON value stored under one of KINDS and a key, in the cache or with the
    package; None if there is none."""
    known = load(kind, key, read)
    if known is not None:
        return known
    shipped = _results().get(kind, {}).get(key)
    if shipped is None:
        return None
    store(kind, key, shipped)  # a small file, for the next time
    return read(shipped)


@cache
def _results() -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return found


@cache
def _read() -> dict[str, list[tuple[list[list[float]], float]]]:
    return dict(json.loads(FILE.read_text(encoding="utf-8")))
