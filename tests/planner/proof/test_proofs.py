"""Laws of proofs: what is certified is written and accepted, and what is not true has no proof."""

from __future__ import annotations

import dataclasses
import json
import pickle
import shutil
import subprocess
import sys
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
from hdplan.verify.verdict import statement

from .conftest import Proven
from .worlds import read, saved, unpacked, words_of

SCENES = ("panda_cage", "panda_carry", "panda_table_pick", "ur5_table", "planar_arm", "panda_gate")


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
    """Its folder lies outside the package, without hdplan."""
    each = proven("ur5_table")
    shutil.copytree(Path(kernel.__file__).parent, tmp_path / "verify")
    code = "import sys; sys.modules['hdplan'] = None; import runpy; runpy.run_module('verify', run_name='__main__')"
    files = [str(each.scene), str(each.motion), str(tmp_path / "m.proof")]
    for data, verdict in ((each.proof.data, "accepted"), (each.proof.data[:-10], "rejected")):
        (tmp_path / "m.proof").write_bytes(data)
        command = [sys.executable, "-c", code, *files]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
        assert (done.returncode, done.stdout.split(":")[0], done.stderr) == (verdict == "rejected", verdict, "")


@pytest.mark.parametrize("name", ["panda_cage", "lost.yaml", "n" * 5_000], ids=["shipped name", "lost", "no name"])
def test_a_file_that_is_not_there_is_named(name: str, tmp_path: Path) -> None:
    """The words are not those of a proof that needs too much."""
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
    assert (verdict.text, verdict.whole) == (proof.text, False)
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


POINTS = ["-1 -1 -1", "1 -1 -1", "1 1 -1", "-1 1 -1", "-1 -1 1", "1 -1 1", "1 1 1", "-1 1 1", "0 0 0.5"]
FACES = ["1 4 3 2", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8", "5 6 9", "6 7 9", "7 8 9", "8 5 9"]
DENTED = "\n".join([*(f"v {x}" for x in POINTS), *(f"f {x}" for x in FACES), ""])
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
    solid = hdplan.Mesh(tmp_path / "dented.obj", 5.0, name="solid")
    scene = hdplan.Scene(robot="panda", obstacles=[solid], start=HOME, goal=AWAY)
    with pytest.raises(hdplan.NotProvenError, match="may lie within obstacle solid"):
        believed(monkeypatch, tmp_path, scene, [HOME, AWAY])


def test_a_ball_inside_a_held_solid_has_no_proof(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "dented.obj").write_text(DENTED)
    mesh, fingers = hdplan.Mesh(tmp_path / "dented.obj", 0.3), ("panda_leftfinger", "panda_rightfinger")
    held = hdplan.Attached("solid", "panda_hand", mesh, [0.0, 0.0, 0.45], fingers)
    around = {"attached": [held], "obstacles": [hdplan.Sphere(0.01, name="ball", pose=[0.31, 0.0, 0.15])]}
    blind = hdplan.SelfCollision(checked=False)
    scene = hdplan.Scene(robot="panda", start=HOME, goal=AWAY, self_collision=blind, **around)
    with pytest.raises(hdplan.NotProvenError, match="obstacle ball may lie within solid"):
        believed(monkeypatch, tmp_path, scene, [HOME, [0.01, *HOME[1:]]])


def test_an_arm_that_sweeps_through_a_thin_wall_between_samples_has_no_proof(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    wall = hdplan.Box([0.3, 0.0005, 0.3], name="wall", pose=[0.5, 0.0, 0.5])
    left, right = [[side, *HOME[1:]] for side in (-0.7, 0.7)]
    scene = hdplan.Scene(robot="panda", obstacles=[wall], start=left, goal=right)
    with pytest.raises(hdplan.NotProvenError, match=r"no plane keeps .* and obstacle wall apart"):
        believed(monkeypatch, tmp_path, scene, [left, right])


def test_limits_that_do_not_hold_are_not_claimed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A joint that is beyond its limit in the middle of a spline, and ends elsewhere than the goal."""
    start, head = [2.8973 - 0.01, *HOME[1:]], {"clearance": None, "self_clearance": 1e-3}
    scene, file, _, motion = saved(hdplan.Scene(robot="panda", start=start, goal=AWAY), tmp_path)
    for rate in (0.039, 0.041):  # the most is an eighth of the difference of the two
        rates = np.outer([rate, -rate], np.eye(7)[0])
        dataclasses.replace(motion, times=[0.0, 1.0], velocities=rates).save(file)
        world = read(scene, file)
        statement(world, {**head, "claims": ["start"]})
        with pytest.raises(RejectedError, match="goal"):
            statement(world, {**head, "claims": ["goal"]})
        if rate < 0.04:
            assert "limits" in statement(world, {**head, "claims": ["limits"]})[0]
        else:
            with pytest.raises(RejectedError, match=r"limits.position: joint 'panda_joint1' is beyond"):
                statement(world, {**head, "claims": ["limits"]})


def test_a_scene_that_requires_more_is_accepted_in_part(tmp_path: Path) -> None:
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


# --- from the library -------------------------------------------------------------------------------------------------


def test_a_result_gives_its_proof_of_the_files_that_it_writes(tmp_path: Path) -> None:
    for name, scene in (
        ("a shipped scene", hdplan.load_scene("ur5_table")),
        ("one made in Python", hdplan.Scene(robot="ur5", obstacles=[hdplan.Box([0.1] * 3, pose=[0.9, 0, 0.1])],
                                            start=[0.0, -1.5, 1, 0, 0, 0], goal=[0.5, -1.5, 1, 0, 0, 0])),
        ("one that was changed", hdplan.load_scene("ur5_table").with_goal([-0.5, -1.07, 1.79, -2.29, -1.57, 0])),
    ):  # fmt: skip
        result, files = hdplan.plan(scene), scene.source if name == "a shipped scene" else tmp_path / "s.yaml"
        result.save(tmp_path / "m.json")
        if name != "a shipped scene":
            scene.save(files)
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
