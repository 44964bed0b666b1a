"""Forged proofs: whoever forges one has to choose between the world that would suit, which is not the one that the
checker reads, and the world that is read, in which the kernel finds what is not true."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.verify import RejectedError
from hdplan.verify.checking import check
from hdplan.verify.compare import check_equal
from hdplan.verify.kernel import accept
from hdplan.verify.reading import read_world
from hdplan.verify.world import OFF, REASONS, World

from .conftest import Honest
from .forging import BALL, BOX, EVERY, LIMITS, ROBOT, TIMED, TOOL, URDF, Data, at, files, forge, put
from .worlds import packed, rejects_unless, unpacked


def spoilt(folder: Path, given: tuple[Path, Path], wish: Data, claims: list[str]) -> tuple[str, str]:
    """The verdicts on a proof in the world that would suit, and in the world that is read; the first proof is good in
    its own world."""
    try:
        reading = read_world(*given)
        hashes: dict[str, str] = reading.hashes
    except RejectedError:
        reading, hashes = None, read_world(*files(folder / "honest", {})).hashes
    false = forge(wish, hashes, claims)
    assert accept(wish, false)[0].startswith("accepted")
    with pytest.raises(RejectedError) as first:
        check(*given, false)
    if reading is None:
        return str(first.value), str(first.value)
    try:
        return str(first.value), check(*given, forge(reading.world, hashes, claims))[0].text
    except RejectedError as error:
        return str(first.value), str(error)


UPRIGHT = {"path": {"upright": {"link": "hand", "axis": "z", "tolerance": 0.3}}}
HANGING = {"start": {"joints": [2, 1.1415926]}, "goal": {"joints": [2, 1.2]}}
HANGS = {"positions": [[2, 1.1415926], [2, 1.2]]}
ENDLESS = URDF.replace('name="g" type="revolute"', 'name="g" type="continuous"')
TURNS = {
    "robot": {**ROBOT, "group": ["a", "b", "g"]}, "start": {"joints": [0, 0, 0]}, "goal": {"joints": [0.1, 0.5, 0.5]},
}  # fmt: skip
TURNED = {"joint_names": ["a", "b", "g"], "positions": [[0, 0, 0], [0.1, 0.5, 0.5 + 2 * np.pi]]}
HEAVY = URDF.replace('<mass value="1"/>', '<origin xyz="0.5 0 0"/><mass value="5"/>')
INERTIAL = HEAVY[HEAVY.index("<inertial>") : HEAVY.index("</inertial>") + 11]
TORQUE = {"limits": {"torque": 24, "acceleration": 10}}
MOVED = URDF.replace('<origin xyz="0 0 0.6"/>', '<origin xmlns="u" xyz="0 0 0.6"/>')
SHIFTED = URDF.replace('"fore"><collision><origin xyz', '"fore"><collision><origin xmlns="u" xyz')
NAMED = {"start": {"state": "home"}, "goal": {"state": "reach"}}
NO_BASE = {**ROBOT, "base_joints": {"x": [-1, 1], "y": [-1, 1], "yaw": [-1, 1]}}
WHEELS = {"joint_names": ["base_x", "base_y", "base_yaw", "a", "b"]}

Case = tuple[Data, Data, str, Data, Data, str, list[str], str, str]
# (scene, motion, URDF as they are; scene, motion, URDF of the world that would suit; claims; the verdicts on both)
CASES: dict[str, Case] = {
    "another joint moves than those of the group": (
        {}, {"joint_names": ["a", "g"]}, URDF,
        {"robot": {**ROBOT, "group": ["a", "g"]}}, {"joint_names": ["a", "g"]}, URDF,
        LIMITS, "has no column of joint 'b', which moves", "has no column",
    ),
    "one joint moves more than those of the group": (
        {}, {"joint_names": ["a", "b", "g"], "positions": [[0, 0, 0], [0.1, 0.5, 1]]}, URDF,
        {}, {}, URDF, LIMITS, "'g' moves otherwise in the world", "'g' moves otherwise",
    ),
    "a joint of a named goal does not move": (
        NAMED, {"joint_names": ["a"], "positions": [[0], [0.5]]},
        URDF,
        {**NAMED, "robot": {**ROBOT, "group": ["a"], "locked": {"b": 1}}},
        {"joint_names": ["a"], "positions": [[0], [0.5]]}, URDF, LIMITS, "no column of joint 'b'", "no column",
    ),
    "a held joint of a named goal is elsewhere": (
        {**NAMED, "robot": {**ROBOT, "group": ["a"]}},
        {"joint_names": ["a"], "positions": [[0], [0.5]]}, URDF,
        {**NAMED, "robot": {**ROBOT, "group": ["a"], "locked": {"b": 1}}},
        {"joint_names": ["a"], "positions": [[0], [0.5]]}, URDF,
        LIMITS, r"the worlds differ: held\.b: 0.0 is read, the proof has 1.0", "goal: .* elsewhere",
    ),
    "a base that does not move": (
        {"robot": NO_BASE, "obstacles": at(0, 0, 0.9)}, {}, URDF,
        {"robot": {**ROBOT, "base": {"position": [50, 0, 0]}}, "obstacles": at(0, 0, 0.9)}, {}, URDF,
        LIMITS, "no column of joint 'base_x'", "no column",
    ),
    "a base beyond its limits": (
        {"robot": NO_BASE, "start": {"joints": [50, 0, 0, 0, 0]}, "goal": {"joints": [50, 0, 0, 0.1, 0.5]}},
        {**WHEELS, "positions": [[50, 0, 0, 0, 0], [50, 0, 0, 0.1, 0.5]]}, URDF,
        {
            "robot": {**ROBOT, "base_joints": {"x": [-1, 60], "y": [-1, 1], "yaw": [-1, 1]}},
            "start": {"joints": [50, 0, 0, 0, 0]}, "goal": {"joints": [50, 0, 0, 0.1, 0.5]},
        },
        {**WHEELS, "positions": [[50, 0, 0, 0, 0], [50, 0, 0, 0.1, 0.5]]}, URDF, LIMITS,
        r"the worlds differ: limits\.position\[0\]\[1\]: 1.0 is read, the proof has 60.0", "joint 'base_x' is beyond",
    ),
    "a joint held beyond its limits": (
        {"obstacles": at(0.05, 0, 1.25)}, {}, URDF,
        {"robot": {**ROBOT, "locked": {"g": -1.9}}}, {}, URDF,
        LIMITS, r"the worlds differ: held\.g: 0.0 is read, the proof has -1.9", "hand 0 and obstacle o: leaf",
    ),
    "an axis in a word that is none": (
        {"path": {"upright": {**UPRIGHT["path"]["upright"], "axis": "+z"}}, **HANGING}, HANGS, URDF,
        {"path": {"upright": {**UPRIGHT["path"]["upright"], "axis": "-z"}}, **HANGING}, HANGS, URDF,
        [*LIMITS, "path"], r"path.upright.axis: one of", "path.upright.axis: one of",
    ),
    "an axis the other way": (
        {**UPRIGHT, **HANGING}, HANGS, URDF,
        {"path": {"upright": {**UPRIGHT["path"]["upright"], "axis": "-z"}}, **HANGING}, HANGS, URDF,
        [*LIMITS, "path"], r"the worlds differ: path\[0\]\.axis\[2\]: 1.0 is read", "path.upright: the link is beyond",
    ),
    "two masses of one link": (
        TORQUE, TIMED, HEAVY.replace(INERTIAL, INERTIAL + INERTIAL.replace('"0.5', '"-0.5')),
        {"limits": {"torque": 240, "acceleration": 10}}, TIMED, URDF,
        [*LIMITS, "torque"], "an element appears twice in <link>", "appears twice",
    ),
    "another mass": (
        TORQUE, TIMED, HEAVY, TORQUE, TIMED, URDF,
        [*LIMITS, "torque"], r"the worlds differ: loads\[1\]\.mass: 5.0 is read, .* 1.0", "torque: joint 'a'",
    ),
    "a goal a whole turn away, within limits": (
        {**TURNS, "limits": {"position": {"g": [-1, 9]}}}, TURNED, ENDLESS, TURNS, TURNED, ENDLESS,
        LIMITS, r"the worlds differ: limits\.position\[2\]\[0\]: -1.0 is read, .* None", "goal: .* elsewhere",
    ),
    "a limit that is wider": (
        {"limits": {"position": {"b": [-1, 0.4]}}}, {}, URDF, {"limits": {"position": {"b": [-1, 0.6]}}}, {}, URDF,
        LIMITS, r"the worlds differ: limits\.position\[1\]\[1\]: 0.4 is read, the proof has 0.6", "'b' is beyond it",
    ),
    "a speed that is wider": (
        {"limits": {"velocity": 0.04}}, TIMED, URDF, {"limits": {"velocity": 0.4}}, TIMED, URDF,
        [*LIMITS, "velocity"], r"the worlds differ: limits\.velocity\[0\]: 0.04 is", "velocity: joint 'b' is beyond",
    ),
    "a joint in a namespace": (
        {"obstacles": at(0.05, 0, 0.95)}, {}, MOVED,
        {"obstacles": at(0.05, 0, 0.95)}, {}, URDF.replace('<origin xyz="0 0 0.6"/>', ""),
        LIMITS, "<{u}origin> is not known there", "not known there",
    ),
    "a shape in a namespace": (
        {"obstacles": at(0.3, 0, 1.05)}, {}, SHIFTED, {"obstacles": at(0.3, 0, 1.05)}, {},
        URDF.replace(f'"fore"><collision><origin xyz="0 0 0.3"/>{BOX}', f'"fore"><collision>{BOX}'),
        LIMITS, "<{u}origin> is not known there", "not known there",
    ),
    "a number with an underscore": (
        {"obstacles": at(0.05, 0, 0.95)}, {}, URDF.replace('"0 0 0.6"', '"0 0 0.6_0"'),
        {}, {}, URDF, LIMITS, "'0.6_0' is not a number", "'0.6_0' is not a number",
    ),
    "a number in other digits": (
        {"obstacles": at(0.05, 0, 0.95)}, {}, URDF.replace('"0 0 0.6"', '"0 0 &#1632;.6"'),
        {}, {}, URDF, LIMITS, "is not a number", "is not a number",
    ),
    "an obstacle elsewhere": (
        {"obstacles": at(0.3, 0, 0.95)}, {}, URDF, {}, {}, URDF,
        LIMITS, r"the worlds differ: bodies\[obstacle o\]\.position\[0\]: 0.3 is read, the proof has 1.5",
        "fore 0 and obstacle o: leaf",
    ),
    "an obstacle less": (
        {"obstacles": [*at(0.3, 0, 0.95), {**BALL, "name": "p"}]}, {}, URDF, {"obstacles": [{**BALL, "name": "p"}]}, {},
        URDF, LIMITS, r"the worlds differ: bodies: 6 entries are read, the proof has 5", "fore 0 and obstacle o: leaf",
    ),
    "a goal elsewhere": (
        {"goal": {"joints": [0.1, 0.6]}}, {}, URDF, {}, {}, URDF,
        LIMITS, r"the worlds differ: goal\[0\]\.joints\[1\]: 0.6 is read, the proof has 0.5", "goal: .* elsewhere",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", CASES)
def test_a_forged_proof_is_rejected_in_the_world_that_would_suit_and_in_the_one_that_is_read(
    kind: str, tmp_path: Path
) -> None:
    scene, motion, urdf, *wished, claims, differs, kernel = CASES[kind]
    given = files(tmp_path / "given", scene, motion, urdf)
    wish = read_world(*files(tmp_path / "wished", *wished)).world
    first, second = spoilt(tmp_path, given, wish, claims)
    assert re.search(differs, first)
    assert re.search(kernel, second)


# --- other changes of a world -----------------------------------------------------------------------------------------


def places(value: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """All values of a world that hold no others, and all lists and mappings, by their places."""
    yield way, value
    for key, each in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(each, (*way, key))


def changes(value: Any) -> list[Any]:
    """Other values in place of one."""
    wild: list[Any] = [None, "x", [], {}, [value], float("nan"), float("inf")]
    if isinstance(value, dict):
        return [{**value, "more": 0}, {k: v for k, v in [*value.items()][1:]} if value else None, [], None]
    if isinstance(value, list):
        return [[*value, *(value[:1] or [0])], value[1:] or None, {}, None]
    if isinstance(value, str):
        return [*wild, f"{value} ", value[1:], 0]
    return wild[1:] if value is None else [*wild, value + 3e-6, value - 1, 7 - 2 * value, str(value)]


@pytest.mark.parametrize("each", [3, pytest.param(1, marks=pytest.mark.slow)])
def test_every_other_value_anywhere_in_a_world_is_a_difference_there(honest: Honest, each: int) -> None:
    """Every third of the other values is tried by default, at every place."""
    _, world, *_ = honest
    check_equal(world, copy.deepcopy(world))
    count = 0
    for way, value in places(world):
        for other in (changes(value) if way else [None, [], {}])[::each]:
            changed = put(world, *way, to=other) if way else other
            with pytest.raises(RejectedError, match="the worlds differ: ") as found:
                check_equal(world, changed)
            count += 1
            if way and way[-1] == "off":
                continue
            assert str(found.value).startswith(f"the worlds differ: {way[0] if way else ''}")
    assert count > 3000 / each


def test_numbers_that_were_worked_out_may_differ_by_their_bounds_and_prove_nothing_more(honest: Honest) -> None:
    """A shift that hides behind an `off`: the kernel looks at the world that was read."""
    given, world, _, true = honest
    head, _, rest = unpacked(true)
    row = next(i for i, x in enumerate(world["joints"]) if x["name"] == "b")
    place = world["joints"][row]["position"][0]
    for off, shift, good in ((OFF, 0.9e-6, True), (OFF, 1.1e-6, False), (0.0, 1e-12, False), (1e-9, 1.1e-9, False)):
        other = put(put(world, "joints", row, "off", to=off), "joints", row, "position", 0, to=place + shift)
        with rejects_unless(good, r"the worlds differ: joints\[b\]\.position\[0\]: 0.0 is read"):
            assert check(*given, packed(head, other, rest)) == check(*given, true)
    for wrong in (1.1e-6, -1e-9, float("nan"), "0", None, [0], True):
        with pytest.raises(RejectedError, match=r"joints\[b\]\.off: is not within"):
            check_equal(world, put(world, "joints", row, "off", to=wrong))
        with pytest.raises(RejectedError, match=r"joints\[1\]"):
            World(put(world, "joints", row, "off", to=wrong), {})


def test_exact_numbers_of_a_world_allow_no_difference(honest: Honest) -> None:
    _, world, *_ = honest
    wide = put(put(world, "path", 0, "off", to=OFF), "tracks", 0, "off", to=OFF)
    tilt = world["path"][0]["tolerance"]  # a request's may be worked out
    check_equal(world, put(wide, "path", 0, "tolerance", to=tilt + 0.9 * OFF))
    with pytest.raises(RejectedError, match=r"the worlds differ: path\[0\]\.tolerance"):
        check_equal(world, put(wide, "path", 0, "tolerance", to=tilt + 1.1 * OFF))
    for way in (("path", 0, "link"), ("tracks", 0, "times", 1), ("motion", "positions", 1, 0)):
        value: Any = world
        for key in way:
            value = value[key]
        with pytest.raises(RejectedError, match=rf"the worlds differ: {way[0]}.*: {re.escape(repr(value))} is read"):
            check_equal(wide, put(wide, *way, to="up" if way[-1] == "link" else float(np.nextafter(value, 9))))


@pytest.mark.parametrize("reason", REASONS)
def test_a_pair_that_is_not_compared_for_a_reason_that_does_not_hold_is_a_difference(
    reason: str, honest: Honest
) -> None:
    given, world, hashes, true = honest
    for pair in (["base", "fore"], ["fore", "o"], ["base", "tool"], ["o", "tool"]):
        listed = sorted([*world["not_compared"], [*pair, reason]])
        other = {**world, "not_compared": listed}
        try:  # with all other pairs, or, where the kernel does not take such a world, with all of the true ones
            head, _, rest = unpacked(forge(other, hashes, EVERY, depth=0))
        except RejectedError:
            head, _, rest = unpacked(true)
        with pytest.raises(RejectedError, match=r"the worlds differ: not_compared: \d+ entries are read, the proof"):
            check(*given, packed(head, other, rest))
        if head["pairs"] < len(World(world, {}).pairs):
            with pytest.raises(RejectedError, match="pairs are to be kept apart, the proof has"):
                check(*given, packed(head, world, rest))
    (pair,) = [x for x in world["not_compared"] if x[:2] == ["base", "up"]]
    assert pair[2] == "neighbours"
    if reason != "neighbours":
        where = world["not_compared"].index(pair)
        other = put(world, "not_compared", where, 2, to=reason)
        with pytest.raises(RejectedError, match=rf"not_compared\[{where}\]\[2\]: 'neighbours' is .* has '{reason}'"):
            check_equal(world, other)


TIP = '<link name="tip"/><joint name="t" type="fixed"><parent link="hand"/><child link="tip"/></joint></robot>'


@pytest.mark.parametrize(
    ("kind", "name"), [("obstacles", "o"), ("attached", "fore"), ("attached", "tip"), ("attached", "tool")]
)
def test_no_name_stands_for_two_obstacles_or_for_two_of_links_and_held_objects(
    kind: str, name: str, tmp_path: Path
) -> None:
    """A link without geometry has a name, too; whoever writes the world."""
    scene: Data = {"obstacles": [BALL], "attached": [TOOL]}
    urdf = URDF.replace("</robot>", TIP)
    honest = read_world(*files(tmp_path, scene, {}, urdf)).world
    World(honest, {})
    (body,) = [x for x in honest["bodies"] if x["kind"] == ("obstacle" if kind == "obstacles" else "held")]
    last = honest["bodies"].index(body) + 1
    bodies = [*honest["bodies"][:last], {**body, "name": name}, *honest["bodies"][last:]]
    with pytest.raises(RejectedError, match=r"bodies\[\d\]: .*(taken|a link)"):
        World({**honest, "bodies": bodies}, {})
    twice = {**scene, kind: [*scene[kind], {**scene[kind][0], "name": name}]}
    with pytest.raises(RejectedError, match="taken"):
        World(read_world(*files(tmp_path, twice, {}, urdf)).world, {})


@pytest.mark.parametrize("robot", [{"locked": {"g": -50}}, {"locked": {"g": 2.11}}, {"locked": {"g": -2.11}}, {}])
def test_a_joint_that_is_held_far_beyond_its_limits_is_refused(robot: Data, tmp_path: Path) -> None:
    """Several sections of a scene may hold it there."""
    start = {"start": {"joints": {"a": 0, "b": 0, "g": 2.11}}} if not robot else {}
    with pytest.raises(RejectedError, match=r"joint 'g' is held at .*, more than 0\.1 beyond its limits"):
        read_world(*files(tmp_path, {"robot": {**ROBOT, **robot}, **start}))
    assert read_world(*files(tmp_path, {"robot": {**ROBOT, "locked": {"g": 2.09}}})).world["held"] == {"g": 2.09}
