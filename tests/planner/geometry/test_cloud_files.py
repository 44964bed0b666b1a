"""Files of points are read whole, or refused in one line; a merged ball contains the balls that it replaces."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hdplan import Cloud, InputError
from hdplan.planner.geometry.cells import cells_of, grouped
from hdplan.planner.geometry.cloud_files import FORMATS, read_points
from hdplan.planner.geometry.clouds import balls_in, drawn_boxes, merged, part_bounds, read_cloud
from hdplan.scenes.array_types import Array
from hdplan.scenes.fixed_array import FixedArray

POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, size=(200, 3)).astype(np.float32).astype(np.float64)


def ply(points: Array, kind: str = "binary_little_endian") -> bytes:
    if kind == "ascii":
        return bytes(trimesh.PointCloud(points).export(file_type="ply", encoding="ascii"))
    return bytes(trimesh.PointCloud(points).export(file_type="ply"))


def ply_with_more(points: Array) -> bytes:
    """As cameras write it: other elements, colours between the coordinates, big-endian doubles."""
    head = f"ply\nformat binary_big_endian 1.0\ncomment camera\nelement vertex {len(points)}\nproperty uchar red\n"
    head += "property double x\nproperty double y\nproperty float quality\nproperty double z\nend_header\n"
    return head.encode() + b"".join(struct.pack(">Bddfd", 7, x, y, 0.5, z) for x, y, z in points.tolist())


def xyz(points: Array) -> bytes:
    rows = "".join(" ".join(map(repr, row)) + " 255 0 0\n" for row in points.tolist())
    return f"# x y z r g b\n\n{rows}".encode()


def csv(points: Array) -> bytes:
    return "".join(",".join(map(repr, row)) + "\n" for row in points.tolist()).encode()


def npz(points: Array) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, points=points, colors=np.zeros((len(points), 3)))
    return file.getvalue()


def npy(points: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, points.astype(np.float32))
    return file.getvalue()


def pcd(points: Array, encoding: str = "binary") -> bytes:
    from pypcd4 import Encoding, PointCloud

    file = io.BytesIO()
    PointCloud.from_xyz_points(points.astype(np.float32)).save(file, encoding=Encoding(encoding))
    return file.getvalue()


def las(points: Array) -> bytes:
    import laspy

    file = io.BytesIO()
    written = laspy.create(point_format=0, file_version="1.2")
    written.header.scales = [1e-6] * 3
    written.x, written.y, written.z = points.T
    written.write(file)
    return file.getvalue()


WRITTEN: dict[str, tuple[str, Callable[[Array], bytes]]] = {
    "ply": ("ply", ply),
    "ply, ascii": ("ply", lambda points: ply(points, "ascii")),
    "ply, more": ("ply", ply_with_more),
    "xyz": ("xyz", xyz),
    "xyz, commas": ("xyz", csv),
    "npz": ("npz", npz),
    "npy": ("npy", npy),
    "pcd": ("pcd", pcd),
    "pcd, ascii": ("pcd", lambda points: pcd(points, "ascii")),
    "pcd, compressed": ("pcd", lambda points: pcd(points, "binary_compressed")),
    "las": ("las", las),
}


@pytest.fixture(params=list(WRITTEN))
def written(request: pytest.FixtureRequest) -> tuple[str, bytes]:
    if request.param.startswith(("pcd", "las")):
        pytest.importorskip({"pcd": "pypcd4", "las": "laspy"}[request.param[:3]])
    ending, write = WRITTEN[request.param]
    return ending, write(POINTS)


def tried(file: Path) -> tuple[FixedArray | None, str]:
    """Read a file, or say in which words it is refused."""
    try:
        return balls_in(read_cloud(Cloud(file, 0.01, drop_nan=True), "obstacles.view")), ""
    except InputError as error:
        return None, str(error)


@pytest.mark.core
def test_every_format_gives_the_same_points(tmp_path: Path, written: tuple[str, bytes]) -> None:
    ending, data = written
    file = tmp_path / f"scan.{ending.upper()}"
    file.write_bytes(data)
    np.testing.assert_allclose(read_points(file), POINTS, rtol=0.0, atol=1e-6)


def test_all_formats_are_tried() -> None:
    assert {ending for ending, _ in WRITTEN.values()} == set(FORMATS)


def test_a_file_cut_anywhere_is_refused_in_one_line(tmp_path: Path, written: tuple[str, bytes]) -> None:
    """A text of numbers shows a cut only in a line that ends between two of them."""
    ending, data = written
    rng = np.random.default_rng(0)
    file = tmp_path / f"scan.{ending}"
    for cut in sorted({0, 1, len(data) // 2, len(data) - 60, *rng.integers(len(data) - 60, size=30).tolist()}):
        file.write_bytes(data[:cut])
        found, refused = tried(file)
        if found is None:
            assert refused.startswith(f"obstacles.view.cloud: {file}: ")
            assert "\n" not in refused
        else:
            assert ending == "xyz"
            assert len(found) < len(POINTS)


def test_damaged_files_are_refused_or_read_but_never_raise_anything_else(
    tmp_path: Path, written: tuple[str, bytes]
) -> None:
    ending, data = written
    rng = np.random.default_rng(1)
    file = tmp_path / f"scan.{ending}"
    for _ in range(60):
        broken = bytearray(data)
        for place in rng.integers(min(len(data), int(rng.choice([200, len(data)]))), size=int(rng.choice([1, 3, 20]))):
            broken[place] = rng.integers(256)
        file.write_bytes(bytes(broken))
        found, refused = tried(file)
        assert "\n" not in refused
        assert found is None or found.array.shape[1] == 4


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("scan.plx", b"", "format '.plx' is not known .did you mean 'ply'"),
        ("scan.ply", ply(POINTS).replace(b"vertex 200", b"vertex 201"), "is cut short"),
        ("scan.ply", b"ply\nformat ascii 1.0\nelement face 0\nend_header\n", "holds no element vertex"),
        ("scan.xyz", b"", "holds no points"),
        ("scan.xyz", b"1 2\n", "cannot be read"),
        ("scan.xyz", b"1 2 nan\n3 4 5\n", "1 of 2 points are not finite .*drop_nan"),
        ("scan.xyz", b"1 2 3\n1 2 3\n4 5", "is cut short: its last line is '4 5'"),
        ("scan.xyz", b"\xff\xfe\x00", "cannot be read"),
        ("scan.npz", npz(POINTS)[:100], "cannot be read"),
        ("scan.npy", npy(POINTS[:, :2]), "holds an array of shape .200, 2."),
        ("scan.npy", b"nothing", r"is not that of a \.npy file \(This file contains pickled .object. data\)$"),
    ],
)
def test_refused_in_one_clear_line(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    file = tmp_path / name
    file.write_bytes(data)
    with pytest.raises(InputError, match=words) as caught:
        balls_in(read_cloud(Cloud(file, 0.01), "obstacles.view"))
    assert "\n" not in str(caught.value)


def test_arrays_in_npz_need_a_name(tmp_path: Path) -> None:
    np.savez(tmp_path / "scan.npz", a=POINTS, b=POINTS)
    with pytest.raises(InputError, match="holds the arrays a, b: the points must be named `points`"):
        read_points(tmp_path / "scan.npz")
    np.savez(tmp_path / "one.npz", anything=POINTS)
    np.testing.assert_array_equal(read_points(tmp_path / "one.npz"), POINTS)
    np.savez(tmp_path / "words.npz", points=np.array([["a", "b", "c"]]))
    with pytest.raises(InputError, match=r"points .m, 3. are needed"):
        read_points(tmp_path / "words.npz")


def test_a_file_that_is_written_again_is_read_again(tmp_path: Path) -> None:
    cloud = Cloud(tmp_path / "scan.npy", 0.01)
    for count in (5, 7):
        np.save(tmp_path / "scan.npy", POINTS[:count])
        assert len(balls_in(read_cloud(cloud, "obstacles.view"))) == count


@pytest.mark.parametrize("seed", range(6))
def test_merged_balls_contain_the_given_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    given = np.column_stack([rng.normal(size=(500, 3)) * 10.0 ** rng.integers(-2, 2), rng.uniform(1e-3, 0.01, 500)])
    voxel = float(10.0 ** rng.uniform(-3, 0.5))
    found, added = merged(FixedArray(given), voxel)
    away = np.linalg.norm(given[:, None, :3] - found.array[:, :3], axis=2) + given[:, None, 3] - found.array[:, 3]
    assert (away.min(axis=1) <= 1e-12).all()
    assert len(found) <= len(given)
    assert added <= voxel * np.sqrt(3.0) / 2.0 + 0.01
    holder = found.array[away.argmin(axis=1), 3]
    assert (holder <= given[:, 3].max() + added + 1e-12).all()


@pytest.mark.parametrize("points", [POINTS, POINTS[:1], np.zeros((5, 3)), POINTS * [1, 0, 0], POINTS * 1e5])
def test_cells_hold_every_point_once_within_cubes(points: Array) -> None:
    cells = cells_of(FixedArray(points), 0.1)
    assert sorted(cells.order.tolist()) == list(range(len(points)))
    assert cells.first[0] == 0
    assert (cells.sizes > 0).all()
    for turn in cells.rotation:
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0.0
    for group in np.split(points[cells.order], cells.first[1:]):
        assert np.ptp(group, axis=0).max() <= max(0.1, np.ptp(points) / 2**19) + 1e-9
    order, first = grouped(points, 0.1)
    np.testing.assert_array_equal(order, cells.order)
    np.testing.assert_array_equal(first, cells.first)


@pytest.mark.parametrize("edge", [0.1, 1e-9])
def test_points_of_one_cube_keep_their_order_and_cubes_come_by_place(edge: float) -> None:
    """Few cubes fit into one number with the points', many do not."""
    points = np.concatenate([POINTS, POINTS[::-1]])
    order, first = grouped(points, edge)
    low, size = points.min(axis=0), max(edge, np.ptp(points, axis=0).max() / (2**20 - 1))
    cubes = [tuple(cube) for cube in ((points - low) / size).astype(int).tolist()]
    assert [(cubes[row], row) for row in order.tolist()] == sorted((cube, row) for row, cube in enumerate(cubes))
    assert len(first) == len(set(cubes))


def test_boxes_for_pictures_contain_the_balls_and_are_few() -> None:
    rng = np.random.default_rng(0)
    balls = FixedArray(np.column_stack([rng.uniform(-1.0, 1.0, size=(6_000, 3)), np.full(6_000, 0.002)]))
    vertices, triangles = drawn_boxes(balls)
    assert len(vertices) // 8 <= 4000
    assert len(triangles) == 12 * (len(vertices) // 8)
    for boxes in (vertices.reshape(-1, 8, 3)[:, [0, 7]], part_bounds(balls, 0.3)):
        inside = np.zeros(len(balls), dtype=bool)
        for low, high in boxes:
            inside |= ((balls.array[:, :3] >= low + 0.002) & (balls.array[:, :3] <= high - 0.002)).all(axis=1)
        assert inside.all()
