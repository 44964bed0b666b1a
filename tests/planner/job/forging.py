"""Jobs' files, and a forger's pen: their proofs with other parts, heads and worlds, and the hashes of other files."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import hdplan
from hdplan import Trajectory
from hdplan.verify.bundle import MAGIC as JOB_MAGIC, parts_of
from hdplan.verify.checking import Verdict, check_job
from hdplan.verify.compare import plain
from hdplan.verify.job import read_job
from hdplan.verify.kernel import MAGIC, unpack

from ..links import place_of

Worlds = list[dict[str, Any]]
Forgery = Callable[[Trajectory], Trajectory]


def written(result: hdplan.JobResult, folder: Path) -> tuple[Path, Path]:
    """The files of a certified job's scene and motion."""
    assert result.certified, result.text
    scene, motion = folder / "scene.yaml", folder / "job.json"
    result.scene.save(scene)
    result.save(motion)
    return scene, motion


def tip() -> Any:
    """The place (3,) between the Panda's fingers at its default state."""
    robot = hdplan.load_robot("panda")
    return place_of(robot, "panda_hand_tcp", [robot.named_states["default"][x] for x in robot.joint_names]).translation


def on_a_shelf(finger: float, **fields: Any) -> hdplan.Scene:
    """A bar stands there on a shelf; the fingers are so far open, and a ball is far away."""
    robot = hdplan.load_robot("panda")
    start = {x: robot.named_states["default"][x] for x in robot.joint_names}
    start |= {"panda_finger_joint1": finger, "panda_finger_joint2": finger}
    obstacles = [
        hdplan.Obstacle("bar", hdplan.Box([0.02, 0.02, 0.06]), list(tip() - [0, 0, 0.025])),
        hdplan.Obstacle("shelf", hdplan.Box([0.1, 0.1, 0.02]), list(tip() - [0, 0, 0.065])),
        hdplan.Obstacle("far", hdplan.Sphere(0.05), [0.0, 0.9, 0.5]),
    ]
    return hdplan.Scene(robot="panda", start=start, obstacles=obstacles, **fields)


def packed(parts: list[bytes]) -> bytes:
    return JOB_MAGIC + json.dumps({"lengths": [len(x) for x in parts]}).encode() + b"\n" + b"".join(parts)


def rewritten(part: bytes, change: Callable[[dict[str, Any], dict[str, Any]], None]) -> bytes:
    """A part with another head and world."""
    head, _, rest = zlib.decompress(part[len(MAGIC) :]).partition(b"\n")
    world, _, rest = rest.partition(b"\n")
    one, two = json.loads(head), json.loads(world)
    change(one, two)
    lines = (json.dumps(each, default=plain).encode() for each in (one, two))
    return MAGIC + zlib.compress(b"\n".join([*lines, rest]))


def worlds(data: bytes) -> Worlds:
    return [json.loads(unpack(x)[1]) for x in parts_of(data)]


def signed(scene: Path, motion: Path, data: bytes) -> bytes:
    """The proof of another scene or motion, with the hashes and the worlds of these: all that a forger can change but
    the directions."""
    parts = parts_of(data)
    read = read_job(scene, motion, worlds(data))

    def sign(number: int) -> Callable[[dict[str, Any], dict[str, Any]], None]:
        def change(head: dict[str, Any], world: dict[str, Any]) -> None:
            head["files"] = read[number].reading.hashes
            world |= json.loads(json.dumps(read[number].reading.world, default=plain))

        return change

    return packed([rewritten(x, sign(i)) for i, x in enumerate(parts)])


def judged(scene: Path, motion: Path, data: bytes) -> Verdict:
    """The verdict of the checker once a forger has signed."""
    return check_job(scene, motion, signed(scene, motion, data))[0]


def shifted(key: str, row: int, column: str, by: float, stage: str = "") -> Forgery:
    """A value of one joint changed in a row of the motion, counted from where a stage begins."""

    def change(motion: Trajectory) -> Trajectory:
        values, begins = np.array(getattr(motion, key)), {mark.name: mark.row for mark in motion.stages}
        values[begins.get(stage, 0) + row, motion.joint_names.index(column)] += by
        return replace(motion, **{key: values})

    return change


def marked(by: int, *names: str) -> Forgery:
    """Stages that begin some rows later."""

    def change(motion: Trajectory) -> Trajectory:
        marks = tuple(replace(each, row=each.row + by * (each.name in names)) for each in motion.stages)
        return replace(motion, stages=marks)

    return change


def body(world: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = [each for each in world["bodies"] if each["name"] == name]
    return dict(found)


def change_body(world: dict[str, Any], name: str, **changes: Any) -> None:
    world["bodies"] = [{**each, **changes} if each["name"] == name else each for each in world["bodies"]]
