"""Worlds and proofs for tests: files as the checker reads them, and proofs as whoever means harm packs them."""

from __future__ import annotations

import json
import zlib
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import Trajectory
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.verify import RejectedError
from hdplan.verify.balls import HERE
from hdplan.verify.checking import check
from hdplan.verify.compare import check_equal, plain
from hdplan.verify.kernel import MAGIC
from hdplan.verify.reading import read_world
from hdplan.verify.scene import frame
from hdplan.verify.world import World

Data = dict[str, Any]


def scene_files(folder: Path, scene: Data, motion: Data, others: dict[str, str] | None = None) -> tuple[Path, Path]:
    """Write a scene and a motion, but for the versions of both, and other files by their names."""
    folder.mkdir(exist_ok=True)
    texts = {"s.yaml": json.dumps({"hdplan": 1, **scene}), "m.json": json.dumps({"hdplan_trajectory": 1, **motion})}
    for name, text in {**texts, **(others or {})}.items():
        (folder / name).write_text(text)
    return folder / "s.yaml", folder / "m.json"


def saved(scene: hdplan.Scene, folder: Path, to: float = 0.0) -> tuple[Path, Path, Setup, Trajectory]:
    """Files of a scene and of a motion of two rows, from its start to where each joint is `to` farther, with both as
    hdplan reads them."""
    files = folder / "scene.yaml", folder / "motion.json"
    scene.save(files[0])
    setup = Setup.of(hdplan.load_scene(files[0]))
    rows = np.array([setup.query.start, setup.query.start + to])
    motion = Trajectory(setup.robot.joint_names, rows, dict(setup.robot.locked))
    motion.save(files[1])
    return *files, setup, motion


def rejects_unless(good: bool, words: str) -> AbstractContextManager[Any]:
    """Expect that the checker rejects with these words what is not `good`."""
    return nullcontext() if good else pytest.raises(RejectedError, match=words)


def bare(bodies: list[Data], positions: list[list[float]], times: Any = None, tracks: Any = ()) -> Data:
    """A world of a slider along x with these bodies, and nothing else."""
    joint = {"name": "j", "parent": -1, "kind": "prismatic", **frame(HERE), "axis": [1.0, 0.0, 0.0], "follows": None}
    return {
        "hdplan_world": 3, "joints": [joint], "held": {}, "links": {}, "bodies": bodies, "tracks": [*tracks],
        "not_compared": [], "clearances": {"obstacles": 0.0, "own": {}, "self": 0.0}, "limits": {}, "path": [],
        "motion": {"rule": "linear", "times": times, "positions": positions},
        "start": [], "goal": [], "duration": None, "also": [],
    }  # fmt: skip


def words_of(scene: Path, motion: Path, proof: bytes) -> str:
    """Claims that a proof's content proves, in the checker's words. Raises RejectedError."""
    return check(scene, motion, proof)[0].text


def read(scene: Path, motion: Path, cuts: Data | None = None) -> World:
    """The world that the checker reads, as its kernel holds it."""
    with np.errstate(all="ignore"):
        return World(read_world(scene, motion).world, cuts or {})


def read_and_planned(setup: Setup, scene: Path, motion: Path, cuts: Data | None = None) -> World:
    """The same, equal to the world in which hdplan plans."""
    with np.errstate(all="ignore"):
        found = read_world(scene, motion).world
        check_equal(found, world_of(setup, Trajectory.load(motion)))
        return World(found, cuts or {})


def kind_of(shape: Data) -> tuple[str, list[float]]:
    """Kind of a world's shape, and its sizes."""
    points, sweep, parts = np.array(shape["points"]), np.array(shape["sweep"]), shape["parts"]
    if parts is not None:
        return {1: "balls", 3: "mesh", 8: "boxes"}[len(parts[0])], []
    (radii,), half = sweep, np.abs(points[0])
    if not radii.any():
        corners = [[x, y, z] for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (-half[2], half[2])]
        box = len(points) == 8 and (points == corners).all()
        return ("box", (2 * half).tolist()) if box else ("points", points.ravel().tolist())
    assert (points == [[0.0, 0.0, -half[2]], [0.0, 0.0, half[2]]][: len(points)]).all()
    assert radii[0] == radii[1] or len(points) == 1
    if len(points) == 1:
        return ("ellipsoid", radii.tolist()) if (radii != radii[0]).any() else ("sphere", radii[:1].tolist())
    return "capsule" if radii[2] == radii[0] else "cylinder", [radii[0], 2 * half[2]]


def unpacked(proof: bytes) -> tuple[Data, Data, bytes]:
    """Head, world and arrays of a proof's content."""
    head, world, rest = zlib.decompress(proof[len(MAGIC) :]).split(b"\n", 2)
    return json.loads(head), json.loads(world), rest


def packed(head: Data, world: Any, rest: bytes) -> bytes:
    """A proof's content."""
    lines = "".join(f"{json.dumps(each, default=plain)}\n" for each in (head, world))
    return MAGIC + zlib.compress(lines.encode() + rest, 1)
