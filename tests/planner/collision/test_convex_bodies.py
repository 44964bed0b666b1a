"""Bodies kept on disk: bit for bit those that are computed, whatever became of their file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdplan.distance.bodies import ConvexBody
from hdplan.planner.collision.convex_bodies import convex_bodies
from hdplan.planner.collision.sphere_swept_fit import Swept

FIELDS = ("vertices", "faces", "edges", "edge_counts")


def bodies(seed: int) -> list[Swept]:
    """A point, a segment, a flat polygon and some polytopes."""
    rng = np.random.default_rng(seed)
    clouds = [rng.normal(size=(count, 3)) for count in (1, 2, 4, 9, 30)]
    flat = rng.normal(size=(6, 3)) * [1, 1, 0]
    return [Swept(cloud, float(rng.uniform(0, 0.1))) for cloud in (*clouds, flat)]


@pytest.mark.parametrize("damage", ["none", "cut", "empty", "other"])
def test_cached_results_equal_computed_ones(damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path))
    around = bodies(3)
    convex_bodies(bodies(4))
    convex_bodies(around)
    files = sorted((tmp_path / "convex_bodies").glob("*.json"))
    assert len(files) == 2
    for file in files:
        text = file.read_text()
        file.write_text({"none": text, "cut": text[: len(text) // 2], "empty": "", "other": "[1, 2]\n[1]"}[damage])
    for each, found in zip(around, convex_bodies(around), strict=True):
        wanted = ConvexBody.from_points(each.vertices, each.radius)
        assert found.radius == wanted.radius
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
