"""Laws of proofs: what is certified is written and accepted; what is changed so that it is not true is rejected, in
words; a damaged file is rejected, and costs nothing."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import pickle
import re
import shutil
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.proof.proof import prove_planned
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.yaml_format.reader import find_scene, shipped_scenes
from hdplan.verify import RejectedError, kernel, verify
from hdplan.verify.checking import check
from hdplan.verify.kernel import MAGIC, MOST_BYTES, half
from hdplan.verify.reading import read_world
from hdplan.verify.verdict import statement

from .worlds import packed, read, unpacked, words_of

SCENES = ("panda_cage", "panda_carry", "panda_table_pick", "ur5_table", "planar_arm", "panda_gate")


class Proven:
    """A scene, its motion and the proof as files that may be changed."""

    def __init__(self, name: str, folder: Path) -> None:
        self.scene, self.motion, self.folder = find_scene(name), folder / "m.json", folder
        result = hdplan.plan(hdplan.load_scene(name), time_limit=60)
        assert result.certified
        result.save(self.motion)
        self.certificate = result.certificate
        self.proof = hdplan.prove(name, self.motion)

    def verify(self, data: bytes | None = None, scene: Path | None = None, motion: Path | None = None) -> str:
        return words_of(scene or self.scene, motion or self.motion, self.proof.data if data is None else data)

    def content(self) -> tuple[dict[str, Any], dict[str, Any], bytes]:
        """Head, world and arrays."""
        return unpacked(self.proof.data)


@pytest.fixture(scope="module")
def proven(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Proven]:
    made: dict[str, Proven] = {}

    def get(name: str) -> Proven:
        if name not in made:
            made[name] = Proven(name, tmp_path_factory.mktemp(name))
        return made[name]

    return get


@pytest.mark.parametrize("name", SCENES)
def test_certified_motions_are_accepted_with_nearly_the_same_clearance(
    name: str, proven: Callable[[str], Proven]
) -> None:
    each = proven(name)
    text, head = each.verify(), each.content()[0]
    assert text.startswith("accepted")
    assert each.proof.text == text
    for key, bound in (("clearance", each.certificate.clearance), ("self_clearance", each.certificate.self_clearance)):
        if bound is not None:
            assert bound - 1e-4 <= head[key] <= bound
    assert len(each.proof.data) < 200_000
    assert head["claims"] == ["limits", "start", "goal", *(["velocity", "duration"] if name == "panda_gate" else [])]


def test_the_checker_runs_on_its_own(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    """As a folder outside the package, without hdplan."""
    each = proven("ur5_table")
    each.proof.save(tmp_path / "m.proof")
    shutil.copytree(Path(kernel.__file__).parent, tmp_path / "verify")
    code = "import sys; sys.modules['hdplan'] = None; import runpy; runpy.run_module('verify', run_name='__main__')"
    files = [str(each.scene), str(each.motion), str(tmp_path / "m.proof")]
    command = [sys.executable, "-c", code, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout.split(":")[0], done.stderr) == (0, "accepted", "")
    (tmp_path / "m.proof").write_bytes(each.proof.data[:-10])
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout.split(":")[0], done.stderr) == (1, "rejected", "")


@pytest.mark.parametrize("name", ["panda_cage", "lost.yaml", "n" * 5_000], ids=["shipped name", "lost", "no name"])
def test_a_file_that_is_not_there_is_named(name: str, tmp_path: Path) -> None:
    """In its own words, which are not those of a proof that needs too much."""
    with pytest.raises(RejectedError, match=r"^\S+: no such file$"):
        verify(tmp_path / name, tmp_path / "m.json", tmp_path / "m.proof")


def test_a_motion_that_is_not_certified_has_no_proof(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    each = proven("panda_cage")
    content = json.loads(each.motion.read_text())
    content["positions"] = [content["positions"][0], content["positions"][-1]]
    (tmp_path / "m.json").write_text(json.dumps(content))
    with pytest.raises(hdplan.NotProvenError, match="contact"):
        hdplan.prove("panda_cage", tmp_path / "m.json")


def test_links_that_touch_wherever_tried_or_always_are_refused_by_name(tmp_path: Path) -> None:
    text = find_scene("tiago_shelf").read_text()
    (tmp_path / "s.yaml").write_text("\n".join(x for x in text.splitlines() if "ignore_pairs" not in x))
    scene = hdplan.load_scene(tmp_path / "s.yaml")
    with pytest.raises(hdplan.UnsolvableError, match="touch at each of 1000 sampled configurations"):
        hdplan.plan(scene)
    setup, motion = Setup.of(hdplan.load_scene("empty")), hdplan.plan(hdplan.load_scene("empty")).trajectory
    (pair,) = setup.robot.self_pairs[:1]
    unchecked = {**setup.robot.unchecked, pair: ALWAYS_TOUCHING}
    robot = dataclasses.replace(setup.robot, unchecked=unchecked, self_pairs=setup.robot.self_pairs[1:])
    with pytest.raises(hdplan.InputError, match=f"links {pair[0]} and {pair[1]} "):
        world_of(dataclasses.replace(setup, robot=robot), motion)


def test_meshes_of_other_kinds_are_taken_from_the_proof_and_named(tmp_path: Path) -> None:
    trimesh.creation.box([0.1, 0.1, 0.1]).export(tmp_path / "b.off")
    text = find_scene("empty").read_text()
    shape = "obstacles: [{name: b, shape: {type: mesh, file: b.off}, pose: {position: [2, 2, 2]}}]\n"
    (tmp_path / "s.yaml").write_text(text + shape)
    hdplan.plan(hdplan.load_scene(tmp_path / "s.yaml"), time_limit=60).save(tmp_path / "m.json")
    proof = hdplan.prove(tmp_path / "s.yaml", tmp_path / "m.json")
    assert proof.text.startswith("accepted in part; NOT read by the checker, but taken from the proof: b.off (b);")
    files = tmp_path / "s.yaml", tmp_path / "m.json"
    verdict, _ = check(*files, proof.data)
    assert verdict.text == proof.text
    assert not verdict.whole
    trimesh.creation.box([0.1, 0.1, 0.2]).export(tmp_path / "b.off")  # another file is none of the proof
    with pytest.raises(RejectedError, match=r"b\.off: is not the file"):
        check(*files, proof.data)


QUICK = ("panda_camera", "panda_cup", "panda_heavy", "panda_grasp")


@pytest.mark.parametrize(
    "scene", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in sorted(shipped_scenes())]
)
def test_the_motion_of_every_shipped_scene_is_proven_whole(scene: str, tmp_path: Path) -> None:
    result = hdplan.plan(hdplan.load_scene(scene), time_limit=120)
    result.save(tmp_path / "m.json")
    proof = hdplan.prove(scene, tmp_path / "m.json")
    assert proof.text.startswith("accepted: ")
    assert "NOT proven" not in proof.text
    head, _, _ = unpacked(proof.data)
    for key in ("clearance", "self_clearance"):
        least, proven = getattr(result.certificate, key), head[key]
        if least is not None:
            assert least - 1e-4 <= proven <= least


# --- faults that a certificate once had -------------------------------------------------------------------------------


DENTED = """v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
v 0 0 0.5
f 1 4 3 2
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
f 5 6 9
f 6 7 9
f 7 8 9
f 8 5 9
"""
HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
AWAY = [0.2, *HOME[1:]]


def believed(monkeypatch: pytest.MonkeyPatch, folder: Path, scene: hdplan.Scene, rows: list[list[float]]) -> None:
    """Write a proof of rows of a scene for a certificate that finds nothing wrong with them."""
    real = Certifier.certify

    def blind(self: Certifier, *arguments: Any, **options: Any) -> hdplan.Certificate:
        certificate = real(self, *arguments, **options)
        assert not certificate.certified
        return dataclasses.replace(certificate, status=Status.CERTIFIED, clearance=1e-3, self_clearance=1e-3)

    monkeypatch.setattr(Certifier, "certify", blind)
    scene.save(folder / "scene.yaml")
    robot = hdplan.load_robot(scene.robot)
    hdplan.Trajectory(robot.joint_names, np.array(rows), dict(robot.locked)).save(folder / "m.json")
    hdplan.prove(folder / "scene.yaml", folder / "m.json")


def test_an_arm_inside_a_solid_has_no_proof(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its surface is nowhere near: a dented cube of 10 m around the robot."""
    (tmp_path / "dented.obj").write_text(DENTED)
    solid = hdplan.Obstacle("solid", hdplan.Mesh(tmp_path / "dented.obj", (5.0, 5.0, 5.0)))
    scene = hdplan.Scene(robot="panda", obstacles=[solid], start=HOME, goal=AWAY)
    with pytest.raises(hdplan.NotProvenError, match="may lie within obstacle solid"):
        believed(monkeypatch, tmp_path, scene, [HOME, AWAY])


def test_a_ball_inside_a_held_solid_has_no_proof(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "dented.obj").write_text(DENTED)
    held = hdplan.Attached(
        "solid",
        "panda_hand",
        hdplan.Mesh(tmp_path / "dented.obj", (0.3, 0.3, 0.3)),
        hdplan.Pose((0.0, 0.0, 0.45)),
        ("panda_leftfinger", "panda_rightfinger"),
    )
    ball = hdplan.Obstacle("ball", hdplan.Sphere(0.01), hdplan.Pose((0.31, 0.0, 0.15)))
    scene = hdplan.Scene(
        robot="panda",
        obstacles=[ball],
        attached=[held],
        start=HOME,
        goal=AWAY,
        self_collision=hdplan.SelfCollision(checked=False),
    )
    with pytest.raises(hdplan.NotProvenError, match="obstacle ball may lie within solid"):
        believed(monkeypatch, tmp_path, scene, [HOME, [0.01, *HOME[1:]]])


def test_an_arm_that_sweeps_through_a_thin_wall_between_samples_has_no_proof(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    wall = hdplan.Obstacle("wall", hdplan.Box([0.3, 0.0005, 0.3]), hdplan.Pose((0.5, 0.0, 0.5)))
    left, right = [[side, *HOME[1:]] for side in (-0.7, 0.7)]
    scene = hdplan.Scene(robot="panda", obstacles=[wall], start=left, goal=right)
    with pytest.raises(hdplan.NotProvenError, match=r"no plane keeps .* and obstacle wall apart"):
        believed(monkeypatch, tmp_path, scene, [left, right])


def test_limits_that_do_not_hold_are_not_claimed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A joint that is beyond its limit in the middle of a spline, and ends elsewhere than the goal."""
    high = 2.8973
    times, rows = [0.0, 1.0], [[high - 0.01, *HOME[1:]], [high - 0.01, *HOME[1:]]]
    scene = hdplan.Scene(robot="panda", start=rows[0], goal=AWAY)
    scene.save(tmp_path / "scene.yaml")
    robot = hdplan.load_robot("panda")
    speed = np.zeros((2, 7))
    for rate in (0.039, 0.041):  # the most is an eighth of the difference of the two
        speed[:, 0] = rate, -rate
        motion = hdplan.Trajectory(robot.joint_names, np.array(rows), dict(robot.locked), np.array(times), speed)
        motion.save(tmp_path / "m.json")
        world = read(tmp_path / "scene.yaml", tmp_path / "m.json")
        head = {"clearance": None, "self_clearance": 1e-3}
        statement(world, {**head, "claims": ["start"]})
        with pytest.raises(RejectedError, match="goal"):
            statement(world, {**head, "claims": ["goal"]})
        if rate < 0.04:
            assert "limits" in statement(world, {**head, "claims": ["limits"]})[0]
        else:
            with pytest.raises(RejectedError, match=r"limits.position: joint 'panda_joint1' is beyond"):
                statement(world, {**head, "claims": ["limits"]})


def test_a_scene_that_asks_for_more_is_accepted_in_part(tmp_path: Path) -> None:
    """The first line says so, and a line what is missing."""
    scene = hdplan.Scene(robot="panda", start=HOME, goal=AWAY, planner=hdplan.PlannerSettings(clearance=0.005))
    scene.save(tmp_path / "scene.yaml")
    hdplan.plan(scene).trajectory.save(tmp_path / "m.json")
    world = read(tmp_path / "scene.yaml", tmp_path / "m.json")
    claims = ["limits", "start", "goal"]
    for least, first, missing in ((0.005, "accepted:", ""), (0.004, "accepted in part;", "a clearance of 5 mm")):
        text, whole = statement(world, {"clearance": least, "self_clearance": 1e-3, "claims": claims})
        assert text.startswith(first)
        assert whole == (not missing)
        assert ("NOT proven" in text) == bool(missing)
        assert missing in text
    text, whole = statement(world, {"clearance": 0.005, "self_clearance": 1e-3, "claims": claims[:2]})
    assert text.startswith("accepted in part; NOT proven by this file: goal")
    assert not whole


# --- changes ----------------------------------------------------------------------------------------------------------


def rejected(words: str, check: Callable[[], str]) -> None:
    with pytest.raises(RejectedError, match=words) as found:
        check()
    assert str(found.value) == " ".join(str(found.value).split())


def test_other_files_are_rejected(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    each = proven("panda_cage")
    for key in ("scene", "motion"):
        path = tmp_path / getattr(each, key).name
        path.write_bytes(getattr(each, key).read_bytes() + b"\n")
        rejected(f"{key}: is not the file", lambda key=key, path=path: each.verify(**{key: path}))
    head, world, rest = each.content()
    for key in head["files"]:
        other = {**head, "files": {**head["files"], key: "0" * 64}}
        rejected("SHA-256", lambda other=other: each.verify(packed(other, world, rest)))
        less = {**head, "files": {k: v for k, v in head["files"].items() if k != key}}
        rejected("not among the files", lambda less=less: each.verify(packed(less, world, rest)))
        more = {**head, "files": {**head["files"], "mesh more/more.stl": "0" * 64}}
        rejected("SHA-256", lambda more=more: each.verify(packed(more, world, rest)))


def moved(each: Proven, tmp_path: Path, change: Callable[[dict[str, Any]], None], **files: Path) -> str:
    """Verify the proof for a changed motion, whose hash it has."""
    content = json.loads(each.motion.read_text())
    change(content)
    path = tmp_path / "m.json"
    path.write_text(json.dumps(content))
    return rehashed(each, {"motion": path})


def rehashed(each: Proven, files: dict[str, Path]) -> str:
    """Verify the proof for other files, of which it has the hashes, in its own world or in theirs."""
    head, world, rest = each.content()
    head["files"] |= {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in files.items()}
    other = {key: path for key, path in files.items() if key in ("scene", "motion")}
    with contextlib.suppress(RejectedError):
        return each.verify(packed(head, world, rest), **other)
    reading = read_world(other.get("scene", each.scene), other.get("motion", each.motion))
    return each.verify(packed({**head, "files": reading.hashes}, reading.world, rest), **other)


@pytest.mark.parametrize("name", ["panda_cage", "ur5_table"])
def test_other_motions_are_rejected_where_they_are_not_free(
    name: str, proven: Callable[[str], Proven], tmp_path: Path
) -> None:
    """Rows that are moved: the certificate says which of these motions keep what the proof claims."""
    each, rng = proven(name), np.random.default_rng(0)
    scene, head = hdplan.load_scene(name), each.content()[0]
    verdicts: list[str] = []
    for _ in range(15):
        row, joint = int(rng.integers(1, 31)), int(rng.integers(0, 6))
        step = float(rng.normal() * 10.0 ** rng.uniform(-4, 0.5))

        def change(verdicts: dict[str, Any], row: int = row, joint: int = joint, step: float = step) -> None:
            verdicts["positions"][row][joint] += step

        try:
            moved(each, tmp_path, change)
        except RejectedError as error:
            verdicts.append(str(error))
            continue
        certificate = hdplan.certify(scene, hdplan.Trajectory.load(tmp_path / "m.json"), required=0.0)
        assert certificate.certified
        assert certificate.clearance is not None
        assert certificate.worst is not None
        assert certificate.worst.distance >= head["clearance"]
    assert len(verdicts) > 3
    assert all(re.search(r" and .*leaf \d+, from .* apart, not|leaves its limits", words) for words in verdicts)


def test_a_motion_that_says_it_is_another_curve_is_rejected(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    def change(data: dict[str, Any]) -> None:
        data["interpolation"] = "cubic"

    rejected("interpolation", lambda: moved(proven("panda_cage"), tmp_path, change))


def test_many_leaves_and_rows_are_checked_in_parts(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    """The largest proofs that are allowed take little memory; they are rejected for what they say."""
    each = proven("planar_arm")
    content = json.loads(each.motion.read_text())
    first, last = np.array(content["positions"][0]), np.array(content["positions"][-1])
    content["positions"] = np.linspace(first, last, 20_000).tolist()
    (tmp_path / "m.json").write_text(json.dumps(content))
    head, _, _ = each.content()
    head["files"]["motion"] = hashlib.sha256((tmp_path / "m.json").read_bytes()).hexdigest()
    counts = np.zeros(head["pairs"], "<u4")
    tree = _depths(20_000)
    counts[0], counts[1:] = len(tree), 1
    depths = np.concatenate([tree, np.zeros(head["pairs"] - 1)]).astype("<u1")
    normals = np.full((len(depths), 3), 1000, "<i4")
    world = read_world(each.scene, tmp_path / "m.json").world
    data = packed({**head, "leaves": len(depths)}, world, counts.tobytes() + depths.tobytes() + normals.tobytes())
    rejected(r" and .*: leaf \d+, from .* its plane keeps them", lambda: each.verify(data, motion=tmp_path / "m.json"))


def _depths(rows: int) -> np.ndarray[Any, Any]:
    """The depths of the tree whose leaves are single rows."""
    found, waiting = [], [(0.0, float(rows), 0)]
    while waiting:
        a, b, depth = waiting.pop()
        if b - a <= 1:
            found.append(depth)
        else:
            middle = half(a, b)
            waiting += [(middle, b, depth + 1), (a, middle, depth + 1)]
    return np.array(found)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("0.012, length: 0.95}, pose: {position: [0.436, 0.1", "0.05, length: 0.95}, pose: {position: [0.436, 0.1"),
        ("[0.436, 0.147, 0.475]", "[0.40, 0.147, 0.475]"),
        ("[0.436, 0.147, 0.475]", "[.nan, 0.147, 0.475]"),
        ("type: capsule", "type: cylinder, size: [1, 1, 1]"),
        ("name: panda\n", "name: panda\n  base: {position: [0.05, 0, 0]}\n"),
        ("panda_finger_joint1: 0.04", "panda_finger_joint1: 0.01"),
        ("goal: {joints: [0.648", "goal: {joints: [0.647"),
        ("hdplan: 1", "hdplan: 2"),
        ("hdplan: 1", "hdplan: 1\nfloor: 3"),
        ("hdplan: 1", "hdplan: 1\nobstacles: []"),
        ("radius: 0.012, length", "radius: 0.012, radius: 0.001, length"),
        ("hdplan: 1", "hdplan: 1\ntiming: " + "[" * 100_000 + "]" * 100_000),
        ("hdplan: 1", "hdplan: 1\nlimits: {position: {panda_joint1: [-0.01, 0.01]}}"),
    ],
)  # fmt: skip
def test_other_scenes_are_rejected(before: str, after: str, proven: Callable[[str], Proven], tmp_path: Path) -> None:
    each = proven("panda_cage")
    text = each.scene.read_text()
    assert before in text
    path = tmp_path / "scene.yaml"
    path.write_text(text.replace(before, after))
    rejected(".", lambda: rehashed(each, {"scene": path}))


def changed_urdf(each: Proven, folder: Path, change: Callable[[str], str]) -> str:
    """Verify against a changed robot description: the scene then names it by its file."""
    from hdplan.scenes.robot_files.library import description_of, library_package_dirs

    _, urdf, srdf, _ = description_of(hdplan.load_scene(each.scene).robot)
    text = urdf.read_text()
    new = change(text)
    assert new != text
    (folder / "robot.urdf").write_text(new)
    dirs = ", ".join(str(path) for path in library_package_dirs())
    robot = f"urdf: robot.urdf\n  srdf: {srdf}\n  package_dirs: [{dirs}]\n"
    (folder / "scene.yaml").write_text(each.scene.read_text().replace("name: panda\n", robot))
    return rehashed(each, {"scene": folder / "scene.yaml", "urdf": folder / "robot.urdf"})


def test_other_robots_are_rejected(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    each = proven("panda_cage")
    assert changed_urdf(each, tmp_path, lambda text: text + "\n<!-- the same -->").startswith("accepted")
    place = 'xyz="0.0825 0 0"'
    found = changed_urdf
    for change in (
        lambda text: text.replace(place, place.replace("0.0825", "0.12"), 1),
        lambda text: text.replace('axis xyz="0 0 1"', 'axis xyz="0 1 0"', 1),
        lambda text: re.sub(r'lower="-?[\d.]+"', 'lower="-0.01"', text),
        lambda text: text.replace("collision/link5.stl", "collision/link0.stl"),
        lambda text: text.replace('type="revolute"', 'type="planar"', 1),
        lambda text: text[: len(text) // 2],
    ):
        rejected(".", lambda change=change: found(each, tmp_path, change))


def test_a_claim_that_is_not_proven_is_rejected(proven: Callable[[str], Proven]) -> None:
    each = proven("panda_cage")
    head, world, rest = each.content()
    for change in (
        {"clearance": head["clearance"] + 0.002},
        {"self_clearance": 0.13},
        {"clearance": None},
        {"self_clearance": None},
        {"clearance": float("nan")},
        {"clearance": float("inf")},
        {"clearance": -1.0},
        {"clearance": "1"},
        {"held": {"panda_finger_joint1": 0.01}},
        {"version": 1},
        {"pairs": head["pairs"] - 1},
        {"leaves": 10**15},
        {"leaves": -1},
        {"rays": 1},
        {"cuts": {"5": 10**9}},
        {"cuts": []},
        {"files": None},
        {"claims": {"limits": 1}},
        {"more": 1},
    ):
        rejected(".", lambda change=change: each.verify(packed({**head, **change}, world, rest)))


@pytest.mark.parametrize("name", ["panda_cage", "ur5_table"])
def test_trees_with_gaps_are_rejected(name: str, proven: Callable[[str], Proven]) -> None:
    """A leaf dropped, twice, or of another depth, with all counts as they should be."""
    each, rng = proven(name), np.random.default_rng(1)
    head, world, rest = each.content()
    skip = 2 * sum(head["cuts"].values())
    counts = np.frombuffer(rest, "<u4", head["pairs"], skip)
    depths = np.frombuffer(rest, "<u1", head["leaves"], skip + counts.nbytes)
    normals = np.frombuffer(rest, "<i4", 3 * head["leaves"], skip + counts.nbytes + depths.nbytes).reshape(-1, 3)
    tail = rest[skip + counts.nbytes + depths.nbytes + normals.nbytes :]
    assert rest[:skip] + counts.tobytes() + depths.tobytes() + normals.tobytes() + tail == rest
    for _ in range(6):
        leaf = int(rng.integers(len(depths)))
        pair = int(np.searchsorted(np.cumsum(counts), leaf, side="right"))
        less, more = counts.copy(), counts.copy()
        less[pair] -= 1
        more[pair] += 1
        other = depths.copy()
        other[leaf] += 1
        for c, d, n in (
            (less, np.delete(depths, leaf), np.delete(normals, leaf, axis=0)),
            (more, np.insert(depths, leaf, depths[leaf]), np.insert(normals, leaf, normals[leaf], axis=0)),
            (counts, other, normals),
        ):
            data = packed(
                {**head, "leaves": len(d)}, world, rest[:skip] + c.tobytes() + d.tobytes() + n.tobytes() + tail
            )
            rejected(" and .*(leaf|leaves|depths)", lambda data=data: each.verify(data))


@pytest.mark.core
def test_damaged_files_are_rejected(proven: Callable[[str], Proven]) -> None:
    """Cut short, bytes changed before and after compression: never another error, and nothing false is accepted."""
    each, rng = proven("panda_cage"), np.random.default_rng(2)
    data, (head, world, rest) = each.proof.data, each.content()
    for length in rng.integers(0, len(data), 20).tolist():
        rejected(".", lambda length=length: each.verify(data[:length]))
    rejected(".", lambda: each.verify(data + b"x"))
    rejected(".", lambda: each.verify(MAGIC + zlib.compress(b"0" * (MOST_BYTES + 1), 9)))
    content = json.dumps(head).encode() + b"\n" + json.dumps(world).encode() + b"\n" + rest
    accepted = 0
    for _ in range(50):
        broken = bytearray(data if rng.random() < 0.4 else content)
        for _ in range(int(rng.integers(1, 4))):
            broken[int(rng.integers(len(broken)))] = int(rng.integers(256))
        whole = bytes(broken) if broken[:13] == MAGIC else MAGIC + zlib.compress(bytes(broken), 1)
        try:
            text = each.verify(whole)
        except RejectedError:
            continue
        accepted += 1  # another direction that does as well, or a lower claim
        least = float(re.search(r"at least ([\d.]+) mm from every", text)[1])  # type: ignore[index]
        assert least <= 1e3 * each.certificate.worst.distance
    assert accepted < 25


# --- from the library -------------------------------------------------------------------------------------------------


def test_a_result_gives_its_proof_of_the_files_that_it_writes(tmp_path: Path) -> None:
    for name, scene in (
        ("a shipped scene", hdplan.load_scene("ur5_table")),
        ("one made in Python", hdplan.Scene(robot="ur5", obstacles=[hdplan.Box([0.1] * 3, pose=[0.9, 0, 0.1])],
                                            start=[0.0, -1.5, 1, 0, 0, 0], goal=[0.5, -1.5, 1, 0, 0, 0])),
        ("one that was changed", hdplan.load_scene("ur5_table").with_goal([-0.5, -1.07, 1.79, -2.29, -1.57, 0])),
    ):  # fmt: skip
        result = hdplan.plan(scene)
        result.save(tmp_path / "m.json")
        files = scene.source if name == "a shipped scene" else tmp_path / "s.yaml"
        if name != "a shipped scene":
            scene.save(tmp_path / "s.yaml")
        proof = result.certificate.proof
        assert words_of(files, tmp_path / "m.json", proof.data) == proof.text
        assert hdplan.prove(files, tmp_path / "m.json").text == proof.text
        assert result.certificate.proof is proof
        again = pickle.loads(pickle.dumps(result))
        assert again.certificate.proof.data == proof.data
    certificate = hdplan.certify(scene, result.trajectory)
    with pytest.raises(hdplan.InputError, match=r"hdplan\.prove"):
        _ = certificate.proof


def test_there_is_no_proof_of_a_planned_motion_in_files_that_say_something_else_by_now(tmp_path: Path) -> None:
    scene, motion = tmp_path / "s.yaml", tmp_path / "m.json"
    hdplan.load_scene("ur5_table").save(scene)
    result = hdplan.plan(hdplan.load_scene(scene))
    result.save(motion)
    content = json.loads(motion.read_text())
    assert words_of(scene, motion, prove_planned(result, scene, motion).data).startswith("accepted")
    content["positions"][1][2] = np.nextafter(content["positions"][1][2], 9.0)
    for file, words, message in (
        (motion, json.dumps(content), r"the worlds differ: motion\.positions\[1\]"),
        (scene, scene.read_text().replace("[0.3, 0.0, -0.03]", "[0.3, 0.0, -0.04]"), r"the worlds differ: bodies"),
        (scene, "hdplan: 1\n", "no proof of this can be written"),
    ):
        whole = file.read_text()
        assert words != whole
        file.write_text(words)
        with pytest.raises(hdplan.InputError, match=message):
            prove_planned(result, scene, motion)
        file.write_text(whole)
