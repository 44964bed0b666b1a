"""Obstacles may have the name of a link: they live in a name space of their own, and nothing is left uncompared, moved
or excused by the name of another body."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.robot.setup import Setup
from hdplan.verify import RejectedError
from hdplan.verify.checking import check
from hdplan.verify.compare import check_equal
from hdplan.verify.kernel import accept
from hdplan.verify.reading import read_world
from hdplan.verify.scene import hull
from hdplan.verify.world import World

from .forging import BALL, LIMITS, ROBOT, TOOL, files, forge, put
from .test_random_worlds import write
from .worlds import kind_of, read_and_planned

Data = dict[str, Any]

NAMES = ("base", "up", "fore", "hand", "base 0", "fore 0", "0", "obstacle", "obstacle base", "world", "a")
IGNORED = {**ROBOT, "ignore_pairs": [["base", "fore"], ["base", "hand"], ["up", "hand"]]}


def shapes_of(world: World) -> list[tuple[int, int, bool]]:
    """Properties of the pairs that do not depend on names."""
    return [(*pair, within) for pair, within in zip(world.pairs.tolist(), world.within.tolist(), strict=True)]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", NAMES)
def test_an_obstacle_is_compared_whatever_its_name(name: str, tmp_path: Path) -> None:
    """Free of the arm or in its way, with ignored pairs of links of that name, with a clearance of its own."""
    scene: Data = {"robot": IGNORED, "attached": [TOOL], "obstacles": [{**BALL, "clearance": 0.02}]}
    plain = read_world(*files(tmp_path, scene)).world
    given = files(tmp_path, {**scene, "obstacles": [{**BALL, "clearance": 0.02, "name": name}]})
    reading = read_world(*given)
    assert shapes_of(World(reading.world, {})) == shapes_of(World(plain, {}))
    text = check(*given, forge(reading.world, reading.hashes, LIMITS))[0].text
    called = name if " " not in name else json.dumps(name)
    assert f"; 20 mm from obstacle {called}\n" in text
    assert f"not compared, both stand still: base and obstacles {called}\n" in text
    assert "not compared, robot.ignore_pairs: base-fore, base-hand, hand-up" in text
    with pytest.raises(RejectedError, match=rf"bodies\[obstacle {name}\]\.name: '{name}' is read, the proof has 'o'"):
        check_equal(reading.world, plain)
    hit = {**BALL, "name": name, "pose": {"position": [0.2, 0, 1.0]}}
    given = files(tmp_path, {**scene, "obstacles": [hit]})
    reading = read_world(*given)
    with pytest.raises(RejectedError, match=rf"(fore|hand|tool)( 0)? and obstacle {re.escape(called)}: leaf"):
        check(*given, forge(reading.world, reading.hashes, LIMITS))


@pytest.mark.parametrize("name", ["base", "fore"])
def test_the_motion_of_an_obstacle_is_not_that_of_a_link_of_its_name(name: str, tmp_path: Path) -> None:
    """A link that stands still is compared with what comes to it."""
    moving = {**BALL, "name": name, "motion": {"velocity": [-1.5, 0, 0]}, "pose": {"position": [5, 0, 0]}}
    scene = {"obstacles": [moving, {**BALL, "name": "up"}]}
    timed = {"times": [0, 3], "velocities": [[0, 0], [0, 0]]}
    world = World(read_world(*files(tmp_path, scene, timed)).world, {})
    numbers = {(x.name, x.kind): i for i, x in enumerate(world.pieces)}
    assert world.pieces[numbers["base", "link"]].joint == world.pieces[numbers["up", "obstacle"]].joint == -1
    pairs = {tuple(x) for x in world.pairs.tolist()}
    assert (numbers["base", "link"], numbers[name, "obstacle"]) in pairs
    assert (numbers["base", "link"], numbers["up", "obstacle"]) not in pairs
    assert (numbers["fore", "link"], numbers["up", "obstacle"]) in pairs


def test_statements_on_links_are_refused_for_obstacles(tmp_path: Path) -> None:
    """Anyone may write such a world."""
    world = read_world(*files(tmp_path, {})).world
    for pair in (["base", "o"], ["fore", "o"], ["o", "o"]):
        for reason in ("robot.ignore_pairs", "moving as one", "both stand still"):
            wrong = put(world, "not_compared", to=[*world["not_compared"], [*pair, reason]])
            with pytest.raises(RejectedError, match=r"not_compared\[\d\]: two links or held objects, and a reason"):
                World(wrong, {})
    for wrong in (put(world, "clearances", "own", to={"base": 1.0}), put(world, "bodies", -1, "joint", to=0)):
        with pytest.raises(RejectedError, match=r"of no obstacle|no joint that may carry it"):
            World(wrong, {})
    old = {**world, "hdplan_world": 2}
    with pytest.raises(RejectedError, match="the world is not of version 3"):
        accept(old, forge(world, {}, []))


def test_a_held_object_and_an_obstacle_have_two_names(tmp_path: Path) -> None:
    """hdplan demands the same."""
    given = files(tmp_path, {"attached": [TOOL], "obstacles": [{**BALL, "name": "tool"}]})
    with pytest.raises(hdplan.InputError, match="the name 'tool' is taken by an obstacle"):
        hdplan.load_scene(given[0])
    with pytest.raises(RejectedError, match="'tool': the name is taken"):
        read_world(*given)


def test_a_shape_taken_from_the_proof_is_not_another_body_s(tmp_path: Path) -> None:
    """A cloud of a link's name: its balls, not the link's shape."""
    (tmp_path / "v.laz").write_bytes(b"a kind that is not read")
    cloud = {"name": "fore", "cloud": {"file": "v.laz", "radius": 0.1}, "pose": {"position": [1.5, 0, 0.3]}}
    given = files(tmp_path, {"obstacles": [cloud]})
    balls = {**hull([[0.0, 0.0, 0.0]], 0.1, 0.1, 0.1), "parts": [[0]]}
    honest = read_world(*files(tmp_path / "other", {})).world
    world = put(honest, "bodies", -1, to={**honest["bodies"][-1], "name": "fore", "shape": balls})
    reading = read_world(*given, world)
    assert reading.world["bodies"][-1]["shape"] == balls
    assert reading.taken == ("fore (cloud)",)
    assert [kind_of(x["shape"])[0] for x in reading.world["bodies"]] == ["box", "box", "sphere", "box", "balls"]


@pytest.mark.parametrize("seed", range(6))
def test_random_worlds_are_the_same_with_names_of_links(seed: int, tmp_path: Path) -> None:
    """hdplan's worlds are the same, too."""
    if not write(np.random.default_rng(seed), tmp_path):
        return
    scene, motion = tmp_path / "scene.yaml", tmp_path / "motion.json"
    content = json.loads(scene.read_text())
    plain = World(read_world(scene, motion).world, {})
    for i, each in enumerate(content["obstacles"]):
        each["name"] = f"l{i}"
    scene.write_text(json.dumps(content))
    try:
        world = read_and_planned(Setup.of(hdplan.load_scene(scene)), scene, motion)
    except hdplan.InputError as error:
        assert "always touch" in str(error)  # noqa: PT017
        return
    assert shapes_of(world) == shapes_of(plain)
    assert (world.control.mid == plain.control.mid).all()


def test_a_motion_beside_obstacles_named_as_links_is_proven(tmp_path: Path) -> None:
    """Scenes that others have made have such names."""
    table = {"shape": {"type": "box", "size": [1, 1, 0.02]}, "pose": {"position": [0, 0, -0.02]}}
    post = {"shape": {"type": "box", "size": [0.05, 0.05, 1]}, "pose": {"position": [0.5, 0.5, 0.5]}}
    scene = {"obstacles": [{"name": "base", **table}, {"name": "fore", **post}], "self_collision": False}
    given = files(tmp_path, scene)
    proof = hdplan.prove(*given)
    assert proof.text.startswith("accepted: over the whole motion")
    assert "  not compared, both stand still: base and obstacles base, fore\n" in proof.text
    assert check(*given, proof.data)[0].text == proof.text


@pytest.mark.parametrize("name", ["base", "up", "fore", "hand"])
def test_the_certificate_finds_what_is_hit_whatever_its_name(name: str, tmp_path: Path) -> None:
    """Pairs of links that are ignored excuse no obstacle that has one of their names."""
    for place, free in (([1.5, 0, 0.3], True), ([0.2, 0, 1.0], False)):
        obstacle = {**BALL, "name": name, "pose": {"position": place}}
        given = files(tmp_path, {"robot": IGNORED, "obstacles": [obstacle], "self_collision": False})
        found = hdplan.certify(hdplan.load_scene(given[0]), hdplan.Trajectory.load(given[1]))
        assert found.certified is free
        if not free:
            assert found.worst.other == name
