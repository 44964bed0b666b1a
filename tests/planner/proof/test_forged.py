"""Forged proofs: whoever forges one has to choose between the world that would suit, which is not the one that the
checker reads, and the world that is read, in which the kernel finds what is not true."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest

from hdplan import cli
from hdplan.planner.geometry.mesh_files import read_mesh_file
from hdplan.verify import RejectedError, kernel
from hdplan.verify.balls import shown
from hdplan.verify.checking import check
from hdplan.verify.compare import check_equal
from hdplan.verify.kernel import IN_PART, VERSION, Motion, accept, half
from hdplan.verify.meshes import triangles
from hdplan.verify.reading import read_world
from hdplan.verify.verdict import digits, millimetres, statement
from hdplan.verify.world import OFF, REASONS, World

from .worlds import packed, unpacked

Data = dict[str, Any]

BOX = '<geometry><box size="0.05 0.05 0.4"/></geometry>'
URDF = f"""<robot name="r">
<link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="up"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="fore"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="hand"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><origin xyz="0 0 0.15"/><geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="up"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1" effort="30"/></joint>
<joint name="b" type="revolute"><origin xyz="0 0 0.6"/><parent link="up"/><child link="fore"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1" effort="30"/></joint>
<joint name="g" type="revolute"><origin xyz="0 0 0.5"/><parent link="fore"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="30"/></joint></robot>"""
SRDF = """<robot name="r"><group name="arm"><joint name="a"/><joint name="b"/></group>
<group_state name="home" group="arm"><joint name="a" value="0"/><joint name="b" value="0"/></group_state>
<group_state name="reach" group="arm"><joint name="a" value="0.5"/><joint name="b" value="1"/></group_state></robot>"""
ROBOT = {"urdf": "r.urdf", "srdf": "r.srdf", "group": "arm"}
BALL: Data = {"name": "o", "shape": {"type": "sphere", "radius": 0.1}, "pose": {"position": [1.5, 0, 0.3]}}
SCENE: Data = {
    "hdplan": 1, "robot": ROBOT, "obstacles": [BALL], "start": {"joints": [0, 0]}, "goal": {"joints": [0.1, 0.5]},
}  # fmt: skip
MOTION: Data = {"hdplan_trajectory": 1, "joint_names": ["a", "b"], "positions": [[0, 0], [0.1, 0.5]]}
TIMED = {**MOTION, "times": [0, 10], "velocities": [[0, 0], [0, 0]]}
WAYS = np.rint(1e6 * np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(300, 3))]))


def at(*place: float) -> list[Data]:
    """The obstacle at another place."""
    return [{**BALL, "pose": {"position": [*place]}}]


def files(folder: Path, scene: Data, motion: Data | None = None, urdf: str = URDF) -> tuple[Path, Path]:
    """Write a scene, with some sections changed, its robot and a motion."""
    folder.mkdir(exist_ok=True)
    (folder / "r.urdf").write_text(urdf)
    (folder / "r.srdf").write_text(SRDF)
    (folder / "s.yaml").write_text(json.dumps({**SCENE, **scene}))
    (folder / "m.json").write_text(json.dumps({**MOTION, **(motion or {})}))
    return folder / "s.yaml", folder / "m.json"


def spans(low: float, high: float, depth: int) -> list[tuple[float, float]]:
    """The leaves of an even tree."""
    if not depth:
        return [(low, high)]
    middle = half(low, high)
    return spans(low, middle, depth - 1) + spans(middle, high, depth - 1)


def forge(content: Data, hashes: dict[str, str], claims: list[str], clearance: float = 1e-6, depth: int = 3) -> bytes:
    """A proof that holds this world, with those of many planes that do best in it, leaf by leaf, whether or not they
    do."""
    world = World(content, {})
    parts = spans(0.0, float(len(world.control.mid)), depth)
    motion, count = Motion(world, np.array(parts)), len(WAYS)
    best = []
    for pair in world.pairs:
        for node in range(len(parts)):
            found = motion.gaps(np.full(count, node), np.tile(pair, (count, 1)), WAYS)
            best.append(WAYS[np.nan_to_num(found, nan=-np.inf).argmax()])
    head = {
        "version": VERSION, "files": hashes, "cuts": {}, "pairs": len(world.pairs), "leaves": len(best), "rays": 0,
        "clearance": None if world.within.all() else clearance, "claims": claims,
        "self_clearance": clearance if world.within.any() else None,
    }  # fmt: skip
    counts, depths = np.full(len(world.pairs), len(parts), "<u4"), np.full(len(best), depth, "<u1")
    normals = np.array(best).reshape(-1, 3).astype("<i4")
    return packed(head, content, b"".join(x.tobytes() for x in (counts, depths, normals)))


def put(world: Data, *path: Any, to: Any) -> Data:
    """The world with another value at a place."""
    other = copy.deepcopy(world)
    where: Any = other
    for key in path[:-1]:
        where = where[key]
    where[path[-1]] = to
    return other


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


LIMITS = ["limits", "start", "goal"]
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

Honest = tuple[tuple[Path, Path], Data, dict[str, str], bytes]
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


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Honest:
    """Files of a motion with all kinds of claims, the world that is read, the files' hashes, and a true proof."""
    scene = {
        "obstacles": [{**BALL, "clearance": 0.02}, {**BALL, "name": "p", "motion": {"velocity": [0.01, 0, 0]}}],
        "attached": [{"name": "tool", "link": "hand", "shape": {"type": "box", "size": [0.01] * 3}, "mass": 0.1}],
        "limits": {"torque": 90, "acceleration": 10, "position": {"a": [-1, 1]}},
        "timing": {"duration": 10}, "path": {"upright": {"link": "hand", "tolerance": 2.5}},
        "start": {"joints": {"a": 0, "b": 0, "g": 0}}, "planner": {"clearance": 0.01},
    }  # fmt: skip
    given = files(tmp_path_factory.mktemp("honest"), scene, TIMED)
    reading = read_world(*given)
    return given, reading.world, reading.hashes, forge(reading.world, reading.hashes, EVERY, 0.01)


EVERY = ["clearance", *LIMITS, "velocity", "acceleration", "torque", "path", "duration"]


def claiming(proof: bytes, claims: list[str], clearance: float) -> bytes:
    """A proof that claims something else."""
    head, world, rest = unpacked(proof)
    return packed({**head, "claims": claims, "clearance": clearance}, world, rest)


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
    """By default every third of the other values, of every place."""
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
        if good:
            assert check(*given, packed(head, other, rest)) == check(*given, true)
        else:
            with pytest.raises(RejectedError, match=r"the worlds differ: joints\[b\]\.position\[0\]: 0.0 is read"):
                check(*given, packed(head, other, rest))
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
TOOL: Data = {"name": "tool", "link": "hand", "shape": {"type": "box", "size": [0.01] * 3}}


@pytest.mark.parametrize(
    ("kind", "name"), [("obstacles", "o"), ("attached", "fore"), ("attached", "tip"), ("attached", "tool")]
)
def test_no_name_stands_for_two_obstacles_or_for_two_of_links_and_held_objects(
    kind: str, name: str, tmp_path: Path
) -> None:
    """Nor for a link that has no geometry; whoever writes the world."""
    scene: Data = {"obstacles": [BALL], "attached": [TOOL]}
    urdf = URDF.replace("</robot>", TIP)
    honest = read_world(*files(tmp_path, scene, {}, urdf)).world
    World(honest, {})
    (body,) = [x for x in honest["bodies"] if x["kind"] == ("obstacle" if kind == "obstacles" else "held")]
    last = honest["bodies"].index(body) + 1
    bodies = [*honest["bodies"][:last], {**body, "name": name}, *honest["bodies"][last:]]
    with pytest.raises(RejectedError, match=r"bodies\[\d\]: .*(taken|a link)"):
        World({**honest, "bodies": bodies}, {})
    with pytest.raises(RejectedError, match="taken"):
        World(
            read_world(
                *files(tmp_path, {**scene, kind: [*scene[kind], {**scene[kind][0], "name": name}]}, {}, urdf)
            ).world,
            {},
        )


@pytest.mark.parametrize("robot", [{"locked": {"g": -50}}, {"locked": {"g": 2.11}}, {"locked": {"g": -2.11}}, {}])
def test_a_joint_that_is_held_far_beyond_its_limits_is_refused(robot: Data, tmp_path: Path) -> None:
    """Wherever the scene says so."""
    start = {"start": {"joints": {"a": 0, "b": 0, "g": 2.11}}} if not robot else {}
    with pytest.raises(RejectedError, match=r"joint 'g' is held at .*, more than 0\.1 beyond its limits"):
        read_world(*files(tmp_path, {"robot": {**ROBOT, **robot}, **start}))
    assert read_world(*files(tmp_path, {"robot": {**ROBOT, "locked": {"g": 2.09}}})).world["held"] == {"g": 2.09}


# --- verdicts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("claim", EVERY[1:])
def test_a_claim_that_is_missing_is_named_in_the_first_line(
    claim: str, honest: Honest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And the command's exit code says so."""
    given, _, _, true = honest
    lacking = claiming(true, [x for x in EVERY if x != claim], 0.01)
    verdict, _ = check(*given, lacking)
    assert not verdict.whole
    assert verdict.text.splitlines()[0] == f"accepted in part; NOT proven by this file: {claim}"
    assert claim not in re.findall(r"also proven: (.*)", verdict.text)[0].split(", ")
    if claim == "goal":
        (tmp_path / "m.proof").write_bytes(lacking)
        monkeypatch.setattr("sys.argv", ["hdplan", "verify", *map(str, given), str(tmp_path / "m.proof")])
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == IN_PART == 4
        assert capsys.readouterr().out.startswith("accepted in part; NOT proven by this file: goal\n")


def test_clearances_that_are_not_reached_are_missing(honest: Honest) -> None:
    given, _, _, true = honest
    lacks = "a clearance of 10 mm (obstacles)"
    for claims, least, lacking in ((EVERY[1:], 0.009, lacks), (EVERY, 0.009, ""), (EVERY[1:], 0.01, "")):
        verdict, _ = check(*given, claiming(true, claims, least))
        assert verdict.whole == (not lacking)
        assert lacking in verdict.text.splitlines()[0]
        assert "20 mm from obstacle o" in verdict.text  # which has a clearance of its own


def test_no_length_is_printed_above_the_one_that_is_proven(honest: Honest) -> None:
    rng = np.random.default_rng(0)
    lengths = [*(10.0 ** rng.uniform(-12, 1, 2000)), *(rng.integers(1, 10**6, 500) / 10**6), 0.3, 5e-324, 1e-300]
    for length in [float(x) for each in lengths for x in (each, np.nextafter(each, 0))]:
        printed = Fraction(millimetres(length).removesuffix(" mm")) / 1000
        assert 0 <= Fraction(length) - printed < Fraction(1, 10**9)
        assert float(digits(length)) == length
        assert Fraction(digits(length, 1000)) == Fraction(digits(length)) * 1000
    least = {"obstacles": 0.0, "own": {"o": 0.123456789999}, "self": 0.0}
    world = World({**honest[1], "held": {"at rest": 0.1234567890123}, "clearances": least}, {})
    text, _ = statement(world, {"clearance": 0.029999999999, "self_clearance": 0.0123456789, "claims": []})
    assert "at least 29.999999 mm from every obstacle; 123.456789 mm from obstacle o\n" in text
    assert "at least 12.345678 mm from one another\n" in text
    assert 'held: "at rest" at 0.1234567890123\n' in text


def test_a_name_adds_nothing_to_the_statement(honest: Honest) -> None:
    """Not another obstacle's clearance, nor another pair."""
    world = json.dumps(honest[1])
    for name in ("o; 900 mm from p", "base-fore, o", 'o"; 900 mm from "p', "o\n  links and held objects", "o from p"):
        other = json.loads(world.replace('"o"', json.dumps(name)))
        text, _ = statement(World(other, {}), {"clearance": 0.01, "self_clearance": 0.01, "claims": []})
        (own,) = re.findall("10 mm from every obstacle; (.*)", text)
        quoted = shown(json.dumps(name))
        assert own == f"20 mm from obstacle {quoted}"
        (still,) = re.findall("not compared, both stand still: (.*)", text)
        assert still == f"base and obstacles {quoted}"
        assert text.count("\n") == statement(
            World(honest[1], {}), {"clearance": 0.01, "self_clearance": 0.01, "claims": []}
        )[0].count("\n")


def test_what_stands_still_is_listed_beside_obstacles(tmp_path: Path) -> None:
    """A wall through the arm, of which one joint alone moves."""
    wall = {"name": "wall", "shape": {"type": "box", "size": [1, 1, 0.1]}, "pose": {"position": [0, 0, 0.9]}}
    scene = {
        "robot": {"urdf": "r.urdf", "group": ["g"], "locked": {"a": 0, "b": 0}}, "obstacles": [wall, BALL],
        "start": {"joints": [0]}, "goal": {"joints": [1]},
    }  # fmt: skip
    given = files(tmp_path, scene, {"joint_names": ["g"], "positions": [[0], [1]]})
    reading = read_world(*given)
    verdict, _ = check(*given, forge(reading.world, reading.hashes, LIMITS))
    (line,) = re.findall("not compared, both stand still: (.*)", verdict.text)
    assert line == "base, fore, up and obstacles wall, o"
    assert "held: a at 0, b at 0" in verdict.text


# --- meshes that readers read in several ways -------------------------------------------------------------------------

DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>
<unit meter="1"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="4">
<input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 1 3 0 2 3 1 2 3</p></triangles></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
DAES: dict[str, Callable[[str], str]] = {
    "plain": str,
    "params in another order": lambda x: x.replace('"X"', '"T"').replace('"Y"', '"X"').replace('"T"', '"Y"'),
    "a param without name": lambda x: x.replace('name="X" ', ""),
    "y is up": lambda x: x.replace("Z_UP", "Y_UP"),
    "fewer triangles": lambda x: x.replace('triangles count="4"', 'triangles count="1"'),
    "a comment in numbers": lambda x: x.replace("0 2 0 0 0 3", "0 2<!-- x -->5 0 0 0 3"),
    "underscores": lambda x: x.replace("0 2 0 0", "0 2_0 0 0"),
    "a unit without size": lambda x: x.replace('<unit meter="1"/>', '<unit name="inch"/>'),
    "turned and stretched": lambda x: x.replace(
        "<instance_g", "<rotate>0 0 1 90</rotate><scale>1 1 2</scale><instance_g"
    ),
    "mirrored": lambda x: x.replace("<instance_g", "<scale>-1 1 2</scale><instance_g"),
    "two kinds of vertices": lambda x: x.replace(
        '#v" offset="0"/>', '#v" offset="0"/><input semantic="VERTEX" source="#v" offset="1"/>'
    ).replace("0 1 2 0 1 3 0 2 3 1 2 3", "0 0 1 1 2 2 0 0 1 1 3 0"),
    "a camera": lambda x: x.replace('url="#g"/>', 'url="#g"/><instance_camera url="#q"/>'),
    "fewer numbers": lambda x: x.replace('count="12"', 'count="9"'),
    "fewer points": lambda x: x.replace('count="4" stride', 'count="3" stride'),
}


@pytest.mark.parametrize("kind", DAES)
def test_a_collada_file_is_rejected_or_has_the_triangles_of_hdplan_and_coal(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "d.dae"
    file.write_text(DAES[kind](DAE))
    assert (DAES[kind](DAE) == DAE) == (kind == "plain")
    try:
        found = np.sort(triangles(file, file.read_bytes(), upright=False).mid.reshape(-1, 3), axis=0)
    except RejectedError:
        assert kind not in ("plain", "turned and stretched", "mirrored")
        return
    points, corners = read_mesh_file(file)
    read = coal.MeshLoader().load(str(file))
    there = read.vertices()[[[x[i] for i in range(3)] for x in map(read.tri_indices, range(read.num_tris))]]
    for other in (points[corners], there):
        np.testing.assert_allclose(np.sort(other.reshape(-1, 3), axis=0), found, atol=1e-6)


@pytest.mark.parametrize("world", ["[" * 100_000, '{"a": 1, "a": 1}', "nan", "\ud800", '{"hdplan_world": 3}', "[]", ""])
def test_the_kernel_alone_rejects_worlds_that_are_none(
    world: str, honest: Honest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files_ = tmp_path / "w.json", tmp_path / "m.proof"
    files_[0].write_bytes(world.encode(errors="surrogatepass"))
    files_[1].write_bytes(honest[3])
    monkeypatch.setattr("sys.argv", ["kernel", *map(str, files_)])
    assert kernel.main() == 1
    assert capsys.readouterr().out.startswith("rejected: ")
    files_[0].write_text(json.dumps(honest[1]))
    assert kernel.main() == 0
    assert capsys.readouterr().out.startswith("accepted: ")
