"""MoveIt's files by the hundred: objects that RViz exports, files changed at random, and those of a benchmark."""

from __future__ import annotations

import copy
import itertools
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import HdplanError, Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.verify import RejectedError
from hdplan.verify.compare import check_equal

from .moveit_cell import REQUEST, SCENE, Cell, Data, written
from .worlds import unpacked

MBM = Path(__file__).parents[4] / "shared" / "mbm"
TEXT = """a cell
* desk top; 1.2 0.1 0; 0 0 0.6 0.8; 2
box; 0.4 0.3 0.2; 0.4 0.3 0; 0 0 0 1; 0 0 0 0
cylinder; 0.05 0.3; 0 0.2 0.3; 0.6 0 0 0.8; 0.5 0.5 0.5 1
1; rim; 0 0 0.2; 0 0 0 1
* ball; 0 0 0; 0 0 0 1; 1
sphere; 0.1; -1.5 1e-01 0.4; 0 0 0 1; 0 0 0 0
0
.
""".replace("; ", "\n")
OLD_TEXT = "\n* ball; 1; sphere; 0.1; -1.5 0.1 0.4; 0 0 0 1; 0 0 0 0; .\n".replace("; ", "\n")


@pytest.mark.parametrize("text", [TEXT, OLD_TEXT, "empty\n.\n"])
def test_objects_that_rviz_exports_are_a_scene(text: str, tmp_path: Path) -> None:
    """Their text with another word has hdplan's world, or one of both refuses it."""
    cell = written(tmp_path)
    cell = cell._replace(scene=cell.scene.rename(tmp_path / "cell.scene"))
    cell.scene.write_text(text)
    cell.agrees()
    rng, both = np.random.default_rng(0), 0
    for _ in range(40):
        words = text.split(" ") if rng.integers(2) else text.split("\n")
        at = rng.integers(len(words))
        way = rng.integers(4)
        words[at : at + int(way > 0)] = [[words[at - 1]], [], ["1"], [f"{words[at]}5"]][way]
        cell.scene.write_text((" " if "\n" in "".join(words) else "\n").join(words))
        try:
            own, world = cell.planned(), cell.read().world
        except (HdplanError, RejectedError):
            continue
        both += 1
        check_equal(world, own)
    assert both > 3


def test_other_spaces_than_those_of_ascii_are_in_no_number(tmp_path: Path) -> None:
    """Python splits words there; a program in C++ reads "0.1", and then nothing, or something else."""
    cell = written(tmp_path)
    cell = cell._replace(scene=cell.scene.rename(tmp_path / "cell.scene"))
    for space in "\u00a0\u2003\u2028\x1c\x85":
        cell.scene.write_text(TEXT.replace("1.2 0.1 0\n", f"1.2{space}0.1 0\n"))
        cell.refused(".", "but a number of a position is expected")


WORDS = [
    *["a", "b", "c", "f", "base", "up", "hand", "finger", "desk", "cup", "ball", "room", "world"],
    "",
    "/base",
    "arm",
    "r",
    "box",
]
VALUES: list[Any] = [0, 1, -1, 0.5, 1e-5, "1e-05", "2", "", True, False, [], {}, [0, 0, 0], [0, 0, 0, 1], [1.0]]
KEYS = [
    "header",
    "pose",
    "id",
    "operation",
    "meshes",
    "is_diff",
    "touch_links",
    "frame_id",
    "w",
    "x",
    "type",
    "weight",
    "zz",
]


def places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Every container with each of its keys or indices."""
    for key in list(content) if isinstance(content, dict) else range(len(content)):
        yield content, key
        if isinstance(content[key], (dict, list)):
            yield from places(content[key])


def change(rng: np.random.Generator, content: Data) -> None:
    """Change one thing."""
    found = list(places(content))
    where, key = found[rng.integers(len(found))]
    old = where[key]

    def pick(values: list[Any]) -> Any:
        return copy.deepcopy(values[rng.integers(len(values))])

    ways: list[Callable[[], None]] = [lambda: where.__delitem__(key), lambda: where.__setitem__(key, pick(VALUES))]
    if isinstance(where, list):
        ways += [lambda: where.append(copy.deepcopy(old)), lambda: where.reverse()]
    if isinstance(old, dict):
        ways += [lambda: old.__setitem__(pick(KEYS), pick([*VALUES, *WORDS]))] * 2
    if type(old) is str:
        ways += [lambda: where.__setitem__(key, pick(WORDS))] * 4
    if type(old) is bool:
        ways += [lambda: where.__setitem__(key, not old)] * 4
    if type(old) in (int, float):
        ways += [lambda: where.__setitem__(key, old + float(rng.normal(scale=0.1)))] * 4
    ways[rng.integers(len(ways))]()


@pytest.mark.parametrize("count", [60, pytest.param(200, marks=pytest.mark.slow)])
def test_changed_files_have_hdplans_world_or_one_of_both_refuses(tmp_path: Path, count: int) -> None:
    """The old proof is accepted for them only where hdplan plans in the same world."""
    rng, cell = np.random.default_rng(0), written(tmp_path)
    proof = cell.prove().data
    world = unpacked(proof)[1]
    both = accepted = hdplans = checkers = 0
    for _ in range(count):
        messages = {"scene": copy.deepcopy(SCENE), "request": copy.deepcopy(REQUEST)}
        change(rng, messages["scene" if rng.random() < 0.7 else "request"])
        cell.scene.write_text(json.dumps(messages["scene"]))
        cell.request.write_text(json.dumps(messages["request"]))
        own = reading = None
        try:
            own = cell.planned()
        except HdplanError:
            hdplans += 1
        try:
            reading = cell.read()
        except RejectedError:
            checkers += 1
        if own is None or reading is None:
            continue
        both += 1
        check_equal(reading.world, own)
        if not cell.outcome(proof, reading.hashes):
            accepted += 1
            check_equal(world, own)
    assert min(both, hdplans, checkers) > count // 4
    assert count // 20 < accepted < both


@pytest.mark.skipif(not MBM.is_dir(), reason="the benchmark's files are not here")
@pytest.mark.parametrize("robot", ["panda", "ur5", "fetch", "baxter"])
def test_files_of_the_benchmark_are_read_as_hdplan_reads_them(robot: str, tmp_path: Path) -> None:
    folders = [x for x in sorted((MBM / robot).iterdir()) if any(x.glob("scene*.yaml"))]
    for scene in itertools.chain.from_iterable(sorted(x.glob("scene*.yaml"))[7:8] for x in folders):
        request, section = scene.with_name(scene.name.replace("scene", "request")), MBM / robot / "robot.yaml"
        setup = Setup.of(hdplan.load_scene(scene, request, section))
        ends = [setup.query.start, setup.query.goal]
        motion = tmp_path / "m.json"
        Trajectory(setup.robot.joint_names, ends).save(motion)
        if {x.name for x in setup.scene.obstacles} & {str(x.name) for x in setup.robot.model.frames}:
            continue
        cell = Cell(scene, motion, request, str(section))
        cell.agrees()
        assert not cell.read().taken
