"""Maps are exactly the union of their occupied cells, from whatever file they come."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

import hdplan
from hdplan import Box, InputError, Obstacle, OctoMap, Pose, Scene, SteadyMotion, Timing, Voxels, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.geometry.octomap_files import DEPTH, read_octomap
from hdplan.planner.geometry.voxel_grids import boxes_in, merged, read_map
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.obstacle_motion import ObstacleMotion

Grid = NDArray[np.bool_]
START = [-0.5, 0.3, 0.0, -1.8, 0.0, 2.1, 0.785]


def random_grid(seed: int) -> Grid:
    rng = np.random.default_rng(seed)
    grid = rng.random(rng.integers(1, 12, size=3)) < rng.choice([0.05, 0.5, 0.95])
    grid[tuple(rng.integers(grid.shape))] = True
    return grid


@pytest.mark.parametrize("seed", range(40))
def test_boxes_cover_the_occupied_cells_exactly_and_once(seed: int) -> None:
    grid = random_grid(seed)
    covered = np.zeros(grid.shape, dtype=int)
    low, high = merged(grid)
    for a, b in zip(low, high, strict=True):
        covered[a[0] : b[0], a[1] : b[1], a[2] : b[2]] += 1
    np.testing.assert_array_equal(covered, grid)


def test_a_solid_block_is_one_box() -> None:
    grid = np.zeros((9, 8, 7), dtype=bool)
    grid[2:6, 1:5, 3:7] = True
    assert [each.tolist() for each in merged(grid)] == [[[2, 1, 3]], [[6, 5, 7]]]
    boxes = boxes_in(read_map(Voxels(grid, 0.1, (1.0, 0.0, -1.0)), ""))
    np.testing.assert_allclose(boxes.array, [[1.2, 0.1, -0.7, 1.6, 0.5, -0.3]])


# Octomaps, written as its authors' library does


def tree(cells: dict[tuple[int, int, int], bool]) -> Any:
    """The tree of cells by their place from the root's lower corner; equal leaves that fill a node are merged."""

    def node(low: tuple[int, ...], size: int, inside: dict[tuple[int, int, int], bool]) -> Any:
        if not inside:
            return None
        if size == 1:
            return next(iter(inside.values()))
        half, children = size // 2, []
        for child in range(8):
            corner = tuple(low[axis] + half * (child >> axis & 1) for axis in range(3))
            own = {c: v for c, v in inside.items() if all(0 <= c[a] - corner[a] < half for a in range(3))}
            children.append(node(corner, half, own))
        if all(isinstance(each, bool) and each == children[0] for each in children):
            return children[0]
        return children

    return node((0, 0, 0), 1 << DEPTH, cells)


def written(cells: dict[tuple[int, int, int], bool], kind: str) -> bytes:
    whole, data = tree(cells), io.BytesIO()

    def binary(children: list[Any]) -> None:
        bits = 0
        for child, each in enumerate(children):
            code = 0 if each is None else 3 if isinstance(each, list) else 2 if each else 1
            bits |= code << 2 * child
        data.write(struct.pack("<H", bits))
        for each in children:
            if isinstance(each, list):
                binary(each)

    def full(each: Any) -> None:
        inner = isinstance(each, list)
        odds = 0.0 if inner else 0.85 if each else -0.4
        bits = sum(1 << child for child, one in enumerate(each) if one is not None) if inner else 0
        data.write(struct.pack("<fB", odds, bits))
        for one in each if inner else ():
            if one is not None:
                full(one)

    (binary if kind == "bt" else full)(whole)
    head = "# Octomap OcTree binary file" if kind == "bt" else "# Octomap OcTree file"
    return f"{head}\n# comment\nid OcTree\nsize 7\nres 0.05\ndata\n".encode() + data.getvalue()


def cells_of(seed: int) -> dict[tuple[int, int, int], bool]:
    rng, middle = np.random.default_rng(seed), 1 << (DEPTH - 1)
    grid = rng.integers(-1, 2, size=(10, 10, 10))
    grid[:4, 4:8, :4] = 1
    low = middle + rng.integers(-20, 10, size=3)
    low -= low % 4  # so that a block of equal cells is one leaf
    return {
        (int(low[0] + x), int(low[1] + y), int(low[2] + z)): bool(grid[x, y, z])
        for x, y, z in np.argwhere(grid >= 0).tolist()
    }


@pytest.mark.parametrize("kind", ["bt", "ot"])
@pytest.mark.parametrize("seed", range(4))
def test_octomaps_are_their_occupied_cells(tmp_path: Path, kind: str, seed: int) -> None:
    cells, file = cells_of(seed), tmp_path / f"room.{kind}"
    file.write_bytes(written(cells, kind))
    leaves = read_octomap(file.read_bytes())
    assert leaves.size.max() > 1
    for unknown in ("free", "occupied"):
        boxes = boxes_in(read_map(OctoMap(file, unknown), "")).array
        middle = 1 << (DEPTH - 1)
        places = np.array([*cells])
        low, high = places.min(axis=0), places.max(axis=0) + 1
        for place in np.ndindex(*(high - low + 2)):
            cell = tuple((low + place - 1).tolist())
            centre = 0.05 * (np.array(cell) + 0.5 - middle)
            inside = bool(((boxes[:, :3] < centre) & (centre < boxes[:, 3:])).all(axis=1).any())
            known = ((np.array(cell) >= low) & (np.array(cell) < high)).all()
            assert inside == cells.get(cell, unknown == "occupied" and bool(known))


@pytest.mark.parametrize("kind", ["bt", "ot"])
def test_an_octomap_cut_anywhere_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    data, file = written(cells_of(0), kind), tmp_path / f"room.{kind}"
    rng = np.random.default_rng(0)
    for cut in sorted({0, 20, 60, len(data) - 1, *rng.integers(len(data), size=30).tolist()}):
        file.write_bytes(data[:cut])
        with pytest.raises(InputError, match=r"obstacles.map.octomap: .*room") as caught:
            boxes_in(read_map(OctoMap(file), "obstacles.map"))
        assert "\n" not in str(caught.value)
    for _ in range(100):
        broken = bytearray(data)
        for place in rng.integers(len(data), size=3):
            broken[place] = rng.integers(256)
        file.write_bytes(bytes(broken))
        try:
            boxes_in(read_map(OctoMap(file), "obstacles.map"))
        except InputError as error:
            words = str(error)
            continue
    assert "\n" not in words


HEAD = b"# Octomap OcTree file\nid OcTree\nsize 1\nres 0.1\n"


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("room.bt", b"octomap\nid OcTree\nsize 1\nres 0.1\ndata\n", "begins neither with '# Octomap OcTree binary"),
        ("room.ot", b"# Octomap OcTree file\nid ColorOcTree\nsize 1\nres 0.1\ndata\n", "of kind 'ColorOcTree'; OcTree"),
        ("room.ot", b"# Octomap OcTree file\nid OcTree\nsize 1\nres x\ndata\n", "has the resolution 'x'"),
        ("room.ot", b"# Octomap OcTree file\nid OcTree\nsize 0\nres 0.1\ndata\n", "is empty"),
        ("room.ot", HEAD + b"data\n\0\0\xc0\x7f\0", "has a cell whose probability is not a number"),
    ],
)
def test_other_octomaps_are_refused(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=words):
        boxes_in(read_map(OctoMap(tmp_path / name), "obstacles.map"))


def test_grids_in_files_and_scenes(tmp_path: Path) -> None:
    grid = random_grid(3)
    np.savez(tmp_path / "grid.npz", occupied=grid, other=np.zeros(3))
    np.save(tmp_path / "grid.npy", grid.astype(np.uint8))
    expected = boxes_in(read_map(Voxels(grid, 0.1), ""))
    for name in ("grid.npz", "grid.npy"):
        assert boxes_in(read_map(Voxels(tmp_path / name, 0.1), "")) == expected
    (tmp_path / "room.bt").write_bytes(written(cells_of(0), "bt"))
    shapes = [
        Voxels(tmp_path / "grid.npz", 0.1, [0, 0, 1]),
        Voxels(grid, 0.1),
        OctoMap(tmp_path / "room.bt", "occupied"),
        held := OctoMap(written(cells_of(0), "bt")),
    ]
    assert boxes_in(read_map(OctoMap(tmp_path / "room.bt"), "")) == boxes_in(read_map(held, ""))
    scene = Scene(robot="panda", obstacles=[*shapes, Box([1, 1, 1])], start="default", goal="default")
    scene.save(tmp_path / "saved.yaml")
    assert load_scene(tmp_path / "saved.yaml") == scene


@pytest.mark.parametrize(
    ("grid", "words"),
    [
        (np.zeros((2, 2, 2)), "holds no occupied cell"),
        (np.full((2, 2, 2), 2), "must hold 0 .free. and 1 .occupied. only"),
        (np.zeros((2, 2)), "must be a grid .x, y, z. of 0 and 1, found an array of shape .2, 2."),
        ([[[1]], [[1], [0]]], "must be a file, or a grid"),
        (np.broadcast_to(True, (500, 500, 500)), "has 125000000 cells; at most 64000000"),
    ],
)
def test_bad_grids_are_refused(tmp_path: Path, grid: Any, words: str) -> None:
    with pytest.raises(InputError, match=f"Voxels.occupied: {words}"):
        Voxels(grid, 0.1)
    (tmp_path / "grid.npy").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"obstacles.a.voxels: .*grid.npy: cannot be read"):
        boxes_in(read_map(Voxels(tmp_path / "grid.npy", 0.1), "obstacles.a"))


@pytest.mark.parametrize("moves", [False, True])
def test_a_map_is_certified_as_its_cells_are(moves: bool) -> None:
    """The same motion between the same cells, as a map and as boxes, at rest and on the move."""
    rng = np.random.default_rng(0)
    grid = rng.random((6, 6, 6)) < 0.2
    pose, goal = Pose((0.55, -0.2, 0.75), (0.0, 0.0, 0.6, 0.8)), [0.5, *START[1:]]
    motion = SteadyMotion((0.0, 0.05, 0.02), (0.0, 0.0, 0.2)) if moves else None
    timing = Timing(duration=2.0) if moves else None
    grid_map = Obstacle("map", Voxels(grid, 0.04), pose, motion=motion)
    scene = Scene(robot="panda", obstacles=(grid_map,), start=START, goal=goal, timing=timing)
    result = hdplan.plan(scene, time_limit=10.0)
    assert result.certified
    if moves:
        certifier = Certifier(Setup.of(scene))
        for time in (0.0, 1.0, 2.0):
            near, _ = certifier.nearest(np.array(START), time=time)
            placed = pin.SE3ToXYZQUAT(pin.SE3(ObstacleMotion.of(grid_map).at(np.array([time]))[0]))
            there = Obstacle("map", Voxels(grid, 0.04), Pose(tuple(placed[:3].tolist()), tuple(placed[3:].tolist())))
            still = Scene(robot="panda", obstacles=(there,), start=START, goal=goal)
            expected, _ = Certifier(Setup.of(still)).nearest(np.array(START))
            assert near.distance == pytest.approx(expected.distance, abs=1e-6)
        return
    centres = 0.04 * (np.argwhere(grid) + 0.5) @ pose.matrix[:3, :3].T + pose.matrix[:3, 3]
    places = [Pose(tuple(at), pose.quaternion_xyzw) for at in centres.tolist()]
    boxes = tuple(Obstacle(f"cell{i}", Box([0.04] * 3), place) for i, place in enumerate(places))
    solid = Scene(robot="panda", obstacles=boxes, start=START, goal=goal)
    found = hdplan.certify(solid, result.trajectory, check_ends=False)
    assert found.certified
    assert found.clearance == pytest.approx(result.certificate.clearance, rel=0.06)
