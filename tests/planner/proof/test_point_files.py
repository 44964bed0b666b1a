"""Laws of files of points: the checker reads them as hdplan does, to the bit, or not at all; one that is damaged gives
no other points."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.geometry.cloud_files import read_points
from hdplan.planner.proof.world import world_of
from hdplan.verify.balls import RejectedError, rejecting
from hdplan.verify.compare import check_equal, plain
from hdplan.verify.point_files import KINDS, table
from hdplan.verify.reading import read_world

from .worlds import saved

Points = np.ndarray[Any, Any]


def points(rng: np.random.Generator, kind: str = "f4") -> Points:
    """From millimetres to a kilometre away; some that were not seen."""
    found = (rng.normal(size=(60, 3)) * 10.0 ** rng.integers(-3, 4, (60, 1))).astype(kind)
    found[rng.random(60) < 0.1] = np.nan
    return found


def words(rows: Points, between: str = " ") -> str:
    return "".join(between.join(str(x) for x in row) + "\n" for row in rows)


def xyz(rng: np.random.Generator) -> bytes:
    between = str(rng.choice([" ", ", ", "\t", ","]))
    colours = rng.integers(0, 255, (60, int(rng.integers(0, 4))))
    return ("# a scan\n\n" + words(np.hstack([points(rng, "f8"), colours]), between)).encode()


def ply(rng: np.random.Generator) -> bytes:
    order, sign = [("ascii", "="), ("binary_little_endian", "<"), ("binary_big_endian", ">")][rng.integers(3)]
    name, kind = [("float", "f4"), ("double", "f8"), ("float32", "f4")][rng.integers(3)]
    columns = ("red", "u1"), ("y", sign + kind), ("x", sign + kind), ("label", sign + "i2"), ("z", sign + kind)
    rows = np.empty(60, [*columns])
    rows["red"], rows["label"] = rng.integers(0, 255, 60), rng.integers(-9, 9, 60)
    for axis, column in zip("xyz", points(rng, kind).T, strict=True):
        rows[axis] = column
    types = f"uchar red,{name} y,{name} x,short label,{name} z".replace(",", "\nproperty ")
    head = f"ply\nformat {order} 1.0\ncomment of a camera\nelement vertex 60\nproperty {types}\nelement face 0\n"
    return (head + "end_header\n").encode() + (words(rows).encode() if order == "ascii" else rows.tobytes())


def pcd(rng: np.random.Generator) -> bytes:
    data, size = ["ascii", "binary"][rng.integers(2)], [4, 8][rng.integers(2)]
    rows = np.empty(60, [("x", f"<f{size}"), ("y", f"<f{size}"), ("z", f"<f{size}"), ("rgb", "<u4"), ("ring", "<u2")])
    rows["rgb"], rows["ring"] = rng.integers(0, 2**24, 60), rng.integers(0, 64, 60)
    for axis, column in zip("xyz", points(rng, f"f{size}").T, strict=True):
        rows[axis] = column
    head = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb ring\nSIZE {size} {size} {size} 4 2\nTYPE F F F U U\n"
        f"COUNT 1 1 1 1 1\nWIDTH 12\nHEIGHT 5\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 60\nDATA {data}\n"
    )
    return head.encode() + (words(rows).encode() if data == "ascii" else rows.tobytes())


def las(rng: np.random.Generator) -> bytes:
    laspy = pytest.importorskip("laspy")
    kind, version = [(0, "1.2"), (3, "1.3"), (6, "1.4")][rng.integers(3)]
    cloud = laspy.LasData(laspy.LasHeader(point_format=kind, version=version))
    cloud.header.scales, cloud.header.offsets = np.array([1e-3, 1e-4, 0.01]), rng.normal(size=3)
    cloud.x, cloud.y, cloud.z = rng.normal(size=(3, 60))
    held = io.BytesIO()
    cloud.write(held)
    return held.getvalue()


MADE: dict[str, Callable[[np.random.Generator], bytes]] = {".xyz": xyz, ".ply": ply, ".pcd": pcd, ".las": las}


def test_every_kind_is_tried() -> None:
    assert {*MADE} == {*KINDS}


@pytest.mark.parametrize("kind", MADE)
def test_points_are_those_of_the_planner(kind: str, tmp_path: Path) -> None:
    for seed in range(20):
        data = MADE[kind](np.random.default_rng(seed))
        (tmp_path / f"a{kind}").write_bytes(data)
        with rejecting():
            found = table(tmp_path / f"a{kind}", data)
        np.testing.assert_array_equal(found, read_points(tmp_path / f"a{kind}"))
        assert found.shape == (60, 3)


@pytest.mark.parametrize("kind", MADE)
def test_damaged_files_have_no_other_points(kind: str, tmp_path: Path) -> None:
    """Cut short, longer, with other bytes: what both read is the same, and what is cut is read by nobody."""
    rng, file, read = np.random.default_rng(7), tmp_path / f"a{kind}", 0
    for _ in range(60):
        data, how = bytearray(MADE[kind](rng)), int(rng.integers(3))
        if how == 0:
            del data[int(rng.integers(len(data))) :]
        elif how == 1:
            data += rng.bytes(int(rng.integers(1, 40)))
        else:
            at = int(rng.integers(min(len(data), 400)))
            data[at] = int(rng.choice(list(b"0123456789 .-+exyz\n#" + rng.bytes(2))))
        file.write_bytes(data)
        try:
            with rejecting():
                found = table(file, bytes(data))
        except RejectedError:
            continue
        try:
            planned = read_points(file)
        except hdplan.InputError:
            continue
        if found is not None:
            np.testing.assert_array_equal(found, planned)
            read += 1
    assert read


def test_compressed_files_and_lists_are_not_read() -> None:
    rng = np.random.default_rng(0)
    packed = re.sub(rb"DATA \w+", b"DATA binary_compressed", pcd(rng))
    faces = ply(rng).replace(b"element face 0\n", b"element face 0\nproperty list uchar int vertex_indices\n")
    assert table(Path("a.pcd"), packed) is None
    assert table(Path("a.ply"), faces) is None


def test_the_world_of_a_scene_takes_nothing_from_the_proof(tmp_path: Path) -> None:
    """A cloud of each kind beside a robot: the checker's world is the planner's."""
    clouds = []
    for kind, made in MADE.items():
        (tmp_path / f"a{kind}").write_bytes(made(np.random.default_rng(1)))
        clouds.append(hdplan.Cloud(tmp_path / f"a{kind}", 0.002, name=kind, drop_nan=True, pose=[9e3, 0.0, 0.0]))
    scene = hdplan.Scene(robot="panda", obstacles=clouds, start="default", goal="default")
    file, held, setup, motion = saved(scene, tmp_path)
    world = json.loads(json.dumps(world_of(setup, motion), default=plain))
    found = read_world(file, held, world)
    assert not found.taken
    check_equal(found.world, world)
