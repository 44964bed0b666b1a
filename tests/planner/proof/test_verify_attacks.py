"""Hostile proofs and files do not get past the checker, and cost little."""

from __future__ import annotations

import hashlib
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.scenes.robot_files.library import data_folder, description_of, robot_names
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify import RejectedError
from hdplan.verify.balls import dot
from hdplan.verify.reading import read_world
from hdplan.verify.robot_files import robot_of
from hdplan.verify.text import strict_xml

from .worlds import packed, read, scene_files, unpacked, words_of

Content = tuple[Path, dict[str, Any], dict[str, Any], bytes]


def test_a_robot_s_name_stands_for_the_same_files_as_in_the_planner() -> None:
    """A proof must not choose among URDFs and SRDFs: several folders hold more than one."""
    for name, files in robot_names().items():
        assert robot_of(data_folder(), name) == (files.urdf, files.srdf)
    with pytest.raises(RejectedError, match="not the name of one robot"):
        robot_of(data_folder(), "ur")


@pytest.fixture(scope="module")
def cage(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """The motion of a scene, and its proof's head, world and arrays."""
    motion = tmp_path_factory.mktemp("cage") / "m.json"
    hdplan.plan(hdplan.load_scene("panda_cage"), time_limit=60).save(motion)
    return motion, *unpacked(hdplan.prove("panda_cage", motion).data)


def check(cage: Content, words: str, head: dict[str, Any], rest: bytes | None = None) -> None:
    with pytest.raises(RejectedError, match=words):
        words_of(find_scene("panda_cage"), cage[0], packed(head, cage[2], cage[3] if rest is None else rest))


def test_another_description_in_the_robot_s_folder_is_rejected(cage: Content) -> None:
    _, urdf, _, _ = description_of(hdplan.load_scene("panda_cage").robot)
    other = urdf.with_name("panda_collision.urdf")
    assert other.is_file()
    files = {**cage[1]["files"], "urdf": hashlib.sha256(other.read_bytes()).hexdigest()}
    check(cage, "urdf: is not the file", {**cage[1], "files": files})


def test_a_joint_that_follows_another_is_held_where_it_follows(cage: Content, tmp_path: Path) -> None:
    """A proof must not close one finger alone where neither scene nor motion say so."""
    content, text = json.loads(cage[0].read_text()), find_scene("panda_cage").read_text()
    assert ", panda_finger_joint2: 0.04" in text
    del content["locked"]["panda_finger_joint2"]
    motion, scene = tmp_path / "m.json", tmp_path / "scene.yaml"
    motion.write_text(json.dumps(content))
    scene.write_text(text.replace(", panda_finger_joint2: 0.04", ""))
    files = {"scene": scene, "motion": motion}
    hashes = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in files.items()}
    head, world = {**cage[1], "files": {**cage[1]["files"], **hashes}}, cage[2]
    assert "panda_finger_joint2 at 0.04" in words_of(scene, motion, packed(head, world, cage[3]))
    for value in (0.038, 0.0):
        other = {**world, "held": {**world["held"], "panda_finger_joint2": value}}
        with pytest.raises(RejectedError, match=r"the worlds differ: held\.panda_finger_joint2: 0.04 is read"):
            words_of(scene, motion, packed(head, other, cage[3]))


def test_large_heads_and_many_groups_are_rejected_before_they_cost_memory(cage: Content) -> None:
    check(cage, "too large|too long", {**cage[1], "more": "[]," * 23_000_000})
    world = read(find_scene("panda_cage"), cage[0])
    cuts = {key: len(x) for key, x in world.parts.items()}
    groups = b"".join(np.arange(n, dtype="<u2").tobytes() for n in cuts.values())
    check(cage, "more pairs of pieces", {**cage[1], "cuts": cuts}, groups + cage[3])


@pytest.mark.parametrize("terms", [3, 59, 61, 200, 800])
def test_long_sums_are_enclosed(terms: int) -> None:
    """Every addition may lose half a unit of the last place."""
    rng = np.random.default_rng(terms)
    for x in (np.append(1.0, np.full(terms - 1, 2.0**-53)), rng.normal(size=terms) * 10.0 ** rng.uniform(-6, 6, terms)):
        one = np.ones((terms, 2))
        found = dot("ln,lni->li", x[None], one[None])
        exact = sum(map(Fraction, x.tolist()))
        assert all(abs(Fraction(m) - exact) <= Fraction(r) for m, r in zip(found.mid.flat, found.rad.flat, strict=True))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["baxter", "tiago", "pr2", "panda", "alex_nub_hands", "xarm7", "a1"])
def test_joints_come_in_the_order_in_which_a_scene_counts_them(name: str, tmp_path: Path) -> None:
    robot = hdplan.load_robot(hdplan.RobotSpec(name=name))
    joints, ends = list(robot.joint_names)[::-1], {"joints": [0.0] * robot.n}
    scene = {"robot": {"name": name}, "start": ends, "goal": ends}
    motion = {"joint_names": joints, "positions": np.zeros((2, robot.n)).tolist()}
    world = read_world(*scene_files(tmp_path, scene, motion)).world
    assert [x["name"] for x in world["joints"] if x["follows"] is None] == joints[::-1]
    assert world["held"] == robot.locked


def test_attributes_cannot_come_from_a_document_type() -> None:
    with pytest.raises(RejectedError, match="DTD"):
        strict_xml(b'<!DOCTYPE robot [<!ATTLIST origin xyz CDATA "0 0 5">]><robot><origin/></robot>')
