"""Laws of maps: the checker reads grids and octomaps itself; a proof may put their cells together, and no others."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.geometry.voxel_grids import boxes_in
from hdplan.verify.balls import RejectedError, rejecting
from hdplan.verify.checking import check
from hdplan.verify.maps import CORNERS, boxes_of
from hdplan.verify.text import Files

from ..geometry.test_voxel_grids import cells_of, random_grid, written
from .test_verify_meaning import MOTION, SCENE, files
from .worlds import packed, unpacked


def corners(boxes: Any) -> Any:
    """The corners (8 k, 3) of boxes (k, 6), as a world has them."""
    return (boxes[:, None, :3] + CORNERS * (boxes[:, None, 3:] - boxes[:, None, :3])).reshape(-1, 3)


def read(kind: str, section: dict[str, Any], claimed: Any, folder: Path = Path()) -> dict[str, Any]:
    with rejecting():
        return boxes_of(kind, section, "a map", folder, Files(), claimed)


@pytest.mark.parametrize("seed", range(6))
def test_boxes_of_a_grid_are_just_its_cells(seed: int, tmp_path: Path) -> None:
    """Cells may be put together anyhow; no box may be missing, added, moved or overlap another one."""
    grid, size, origin = random_grid(seed) != 0, 0.013 * (seed + 1), [0.3, -1.7, 0.1 * seed]
    np.save(tmp_path / "a.npy", grid)
    np.savez(tmp_path / "b.npz", occupied=grid.astype(np.float32), other=np.zeros(3))
    expected = corners(boxes_in(hdplan.Voxels(grid, size, origin)).array)
    single = np.argwhere(grid)
    cells = corners(np.hstack([origin + size * single, origin + size * (single + 1)]))
    for section in ({"file": "a.npy"}, {"file": "b.npz"}, {"occupied": grid.astype(int).tolist()}):
        more = {**section, "size": size, "origin": origin}
        for boxes in (expected, cells):
            found = read("voxels", more, boxes, tmp_path)
            np.testing.assert_allclose(found["points"], boxes, rtol=0, atol=1e-12)
            assert found["off"] < 1e-12
    low = single[0]
    empty = np.argwhere(~grid)[:1]
    twice, moved = np.concatenate([expected, expected[:8]]), np.arange(len(expected))[:, None] == 3
    forged = [expected[8:], cells[:-8], twice, expected + 0.4 * size, expected + size, expected[::-1]]
    forged += [np.concatenate([cells, corners(np.hstack([origin + size * empty, origin + size * (empty + 1)]))])]
    forged += [expected[:-1], expected[:0], expected * [1, 1, -1], np.where(moved, expected + 1e-4, expected)]
    forged += [np.concatenate([cells, corners(np.hstack([origin + size * low, origin + size * low])[None])])]
    for each in forged:
        with pytest.raises(RejectedError):
            read("voxels", more, each)
    with pytest.raises(RejectedError):
        read("voxels", {**more, "size": size * (1 + 1e-3)}, cells)


@pytest.mark.parametrize("kind", ["bt", "ot"])
@pytest.mark.parametrize("unknown", ["free", "occupied"])
def test_octomaps_are_read_as_the_planner_reads_them(kind: str, unknown: str, tmp_path: Path) -> None:
    for seed in range(2):
        content = written(cells_of(seed), kind)
        (tmp_path / "room.bt").write_bytes(content)
        expected = corners(boxes_in(hdplan.OctoMap(content, unknown)).array)
        coded = base64.b64encode(content).decode()
        for section in ({"file": "room.bt"}, {"content": coded}):
            found = read("octomap", {**section, "unknown": unknown}, expected, tmp_path)
            np.testing.assert_allclose(found["points"], expected, rtol=0, atol=1e-9)
        for cut in (*range(0, len(content), len(content) // 7), len(content) - 1):
            with pytest.raises(RejectedError):
                read("octomap", {"content": base64.b64encode(content[:cut]).decode(), "unknown": unknown}, expected)
        for data in (content + b"0", content.replace(b"OcTree\n", b"ColorOcTree\n"), b""):
            with pytest.raises(RejectedError):
                read("octomap", {"content": base64.b64encode(data).decode(), "unknown": unknown}, expected)
        other = {"free": "occupied", "occupied": "free"}[unknown]
        with pytest.raises(RejectedError):
            read("octomap", {"content": coded, "unknown": other}, expected)


def test_scenes_with_maps_are_accepted_whole(tmp_path: Path) -> None:
    """A box less is rejected."""
    grid = np.zeros((4, 3, 2), int)
    grid[1:, :2] = 1
    far = [[9, 9, 9], [9, 9, 9.5]]
    maps = [{"name": "grid", "voxels": {"occupied": grid.tolist(), "size": 0.1, "origin": far[0]}}]
    content = base64.b64encode(written(cells_of(0), "bt")).decode()
    maps += [{"name": "tree", "octomap": {"content": content}, "pose": {"position": [5000.0, 0, 0]}}]
    scene, motion = files(tmp_path, {**SCENE, "obstacles": maps}, MOTION)
    proof = hdplan.prove(scene, motion)
    assert proof.text.startswith("accepted: ")
    head, world, rest = unpacked(proof.data)
    for body in world["bodies"]:
        if body["kind"] == "obstacle":
            body["shape"]["parts"] = body["shape"]["parts"][:-1]
            body["shape"]["points"] = body["shape"]["points"][:-8]
            with pytest.raises(RejectedError):
                check(scene, motion, packed(head, json.loads(json.dumps(world)), rest))
