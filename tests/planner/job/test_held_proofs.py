"""Laws of proofs of what is held: it is led as a link is, it goes from hand to hand, and no proof can say when."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.job.proof import prove_job
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.verify.balls import RejectedError
from hdplan.verify.bundle import parts_of
from hdplan.verify.checking import check, check_job, check_part
from hdplan.verify.job import read_job

from ..proof.worlds import packed as packed_world, unpacked
from .forging import Forgery, body, change_body, judged, marked, packed, worlds, written

Files = tuple[Path, Path, bytes]
URDF = """<robot name="sliders"><link name="root"/>{}</robot>"""
HAND = """<link name="{0}"><collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision></link>
<link name="{0}_tool"/><joint name="{0}_way" type="fixed"><parent link="{0}"/><child link="{0}_tool"/>
<origin xyz="0 0.02 0" rpy="0 0 0.5"/></joint>
<joint name="{0}_x" type="prismatic"><parent link="root"/><child link="{0}"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="10"/></joint>"""
LIMITS = hdplan.Limits(acceleration=8.0)
TOUCH = {"left": [["bar", "left"]], "right": [["bar", "right"]]}


def job(**changes: Any) -> hdplan.Job:
    """The left hand takes a bar and brings it, the right one takes it over and sets it down; stages by name."""
    there = hdplan.Pose.from_rpy([0.0, 0.0, 0.0], [0.0, 0.0, 0.3])
    stages = {
        "comes": hdplan.Move([-0.323, 0.6]),
        "takes": hdplan.Grip(object="bar", link="left_tool", touch=TOUCH["left"]),
        "brings": hdplan.Move(hdplan.PoseTarget("bar", there)),
        "meets": hdplan.Move([-0.123, 0.123]),
        "both": hdplan.Grip(object="bar", link="right_tool", touch=TOUCH["right"]),
        "stand": hdplan.Wait(0.05),
        "gives": hdplan.Release(object="bar"),
        "goes": hdplan.Line(by=[-0.2, 0.0, 0.0], link="left"),
        "carries": hdplan.Line(by=[0.2, 0.0, 0.0], link="bar"),
        "leaves": hdplan.Release(object="bar"),
        "away": hdplan.Line(by=[0.1, 0.0, 0.0], link="right"),
    }
    named = {name: replace(x, name=name, **(changes.get(name) or {})) for name, x in stages.items()}
    return hdplan.Job([x for name, x in named.items() if changes.get(name, ()) is not None])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> hdplan.Scene:
    urdf = tmp_path_factory.mktemp("sliders") / "sliders.urdf"
    urdf.write_text(URDF.format("\n".join(HAND.format(name) for name in ("left", "right"))))
    turned = hdplan.Pose.from_rpy([-0.2, 0.0, 0.0], [0.0, 0.0, 0.3])
    bar = hdplan.Obstacle("bar", hdplan.Box([0.1996, 0.03, 0.03]), turned)
    return hdplan.Scene(robot=hdplan.RobotSpec(urdf=urdf), obstacles=[bar], start=[-0.6, 0.6], limits=LIMITS, job=job())


@pytest.fixture(scope="module")
def files(scene: hdplan.Scene, tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Scene, motion and proof."""
    path, motion = written(hdplan.plan_job(scene), tmp_path_factory.mktemp("held"))
    return path, motion, prove_job(path, motion).data


def test_a_handover_is_proven_in_full(files: Files) -> None:
    """The joint that carries the bar, and what may touch it, are known in every stage."""
    scene, motion, data = files
    verdict, read = check_job(scene, motion, data)
    assert verdict.whole
    assert judged(scene, motion, data).whole  # the forger's pen writes what is read
    assert "bar follows its curve of 2 poses" in verdict.text
    left, right = (["left_x", "right_x"].index(x) for x in ("left_x", "right_x"))
    carried = [body(x, "bar")["joint"] for x in read]
    assert carried == [-1, -1, left, left, left, left, left, right, right, right, -1]
    touching = [
        {x for pair in world["not_compared"] if "bar" in pair and pair[2] == "touch_links" for x in pair[:2]} - {"bar"}
        for world in read
    ]
    assert touching[4:9] == [{"right"}, {"right"}, {"right"}, set(), set()]  # beside the hand that holds it
    np.testing.assert_allclose(body(read[-1], "bar")["position"], [0.2, 0.0, 0.0], atol=1e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"both": None}, "'bar' is not a link or held object that moves"),  # nobody has it when the first lets go
        ({"gives": None}, "one has to let go before an arm moves"),
        ({"both": {"link": "left_tool", "touch": TOUCH["left"]}}, "which moves with 'left_tool'"),
        ({"both": {"link": "root", "touch": []}}, "'bar' is not a link or held object that moves"),
        ({"both": {"link": "left", "touch": TOUCH["right"]}}, "'right' does not move with 'left'"),
        ({"meets": {"touch": TOUCH["right"]}}, None),  # another list of what touches
        ({"both": {"touch": []}}, None),
        ({"goes": {"touch": TOUCH["left"]}}, None),
        ({"takes": {"link": "right"}}, "does not move with"),
        ({"brings": {"goal": hdplan.PoseTarget("left", hdplan.Pose())}}, None),  # of another link
        ({"brings": {"goal": hdplan.PoseTarget("bar", hdplan.Pose())}}, None),  # turned otherwise
        ({"comes": {"goal": hdplan.PoseTarget("bar", hdplan.Pose())}}, "nothing of this name is held"),
        ({"away": {"link": "bar"}}, "'bar' is not a link or held object that moves"),
        ({"carries": {"by": [0.202, 0.0, 0.0]}}, None),
        ({"carries": {"link": "left"}}, None),
        ({"carries": {"frame": "bar"}}, None),
    ],
)
def test_the_proof_of_another_job_is_rejected(
    scene: hdplan.Scene, files: Files, tmp_path: Path, changes: dict[str, Any], words: str | None
) -> None:
    """The forger writes hashes and worlds of the files that are read."""
    _, motion, data = files
    other, moved = tmp_path / "other.yaml", Trajectory.load(motion)
    replace(scene, goal=None, job=job(**changes)).save(other)
    kept = [i for i, mark in enumerate(moved.stages) if changes.get(mark.name, ()) is not None]
    replace(moved, stages=tuple(moved.stages[i] for i in kept)).save(tmp_path / "other.json")
    with pytest.raises(RejectedError, match=words):
        judged(other, tmp_path / "other.json", packed([parts_of(data)[i] for i in kept]))


def test_a_forged_motion_is_rejected(files: Files, tmp_path: Path) -> None:
    """Hands that move where both hold, marks elsewhere: the bar is taken, given or set down at another moment."""
    scene, motion, data = files
    old = Trajectory.load(motion)
    rows = {mark.name: mark.row for mark in old.stages}

    def drift(stage: str, joint: str) -> Forgery:
        def change(motion: Trajectory) -> Trajectory:
            positions = motion.positions.copy()
            positions[rows[stage] + 1 :, motion.joint_names.index(joint)] += 1e-4
            return replace(motion, positions=positions)

        return change

    later = (("takes", -3), ("both", -3), ("goes", 3), ("carries", 3), ("away", 3))
    changes = [drift(stage, joint) for stage in ("both", "stand", "gives") for joint in ("left_x", "right_x")]
    changes += [marked(by, name) for name, by in later]
    for i, change in enumerate(changes):
        change(old).save(tmp_path / f"{i}.json")
        with pytest.raises(RejectedError):
            judged(scene, tmp_path / f"{i}.json", data)


def test_a_proof_cannot_say_who_holds_it(files: Files) -> None:
    """Another carrier, another place, another list of what may touch, another link that is led, in any stage."""
    scene, motion, data = files
    parts = worlds(data)

    def bars(**changes: Any) -> Callable[[dict[str, Any]], Any]:
        return lambda x: change_body(x, "bar", **changes)

    changes: list[Callable[[dict[str, Any]], Any]] = [
        bars(joint=0), bars(joint=1), bars(joint=-1), bars(kind="held"), bars(kind="obstacle"),
        lambda x: bars(position=(np.array(body(x, "bar")["position"]) + 1e-7).tolist())(x),
        lambda x: x.update(not_compared=sorted([*x["not_compared"], ["bar", "left", "touch_links"]])),
        lambda x: x.update(not_compared=[y for y in x["not_compared"] if "right" not in y]),
        lambda x: [y.update(link="left") for y in x["path"]],
        lambda x: [y.update(link="right") for z in x["goal"] for y in z.get("poses", [])],
    ]  # fmt: skip
    tried = 0
    for part, world in zip(read_job(scene, motion, parts), parts, strict=True):
        check_part(part, world)
        for change in changes:
            forged = json.loads(json.dumps(world))
            change(forged)
            if forged != world:
                tried += 1
                with pytest.raises(RejectedError):
                    check_part(part, forged)
    assert tried > 60


def test_a_single_motion_leads_what_is_held(scene: hdplan.Scene, tmp_path: Path) -> None:
    """Its own frame is led to a pose, and nowhere else; a link that does not move cannot be led."""
    bar = hdplan.Attached("bar", "left", scene.obstacles[0].shape, hdplan.Pose.from_rpy([0.13, 0.0, 0.0], [0, 0, 0.3]))
    there = hdplan.Pose.from_rpy([0.0, 0.0, 0.0], [0.0, 0.0, 0.3])
    path = hdplan.PathConstraints(upright=hdplan.Upright("bar", "z", 0.01))
    changes = {"obstacles": [], "attached": [bar], "job": None, "goal": hdplan.PoseTarget("bar", there), "path": path}
    alone = replace(scene, **changes)
    alone.save(tmp_path / "scene.yaml")
    result = hdplan.plan(alone)
    result.save(tmp_path / "motion.json")
    proof = hdplan.prove(tmp_path / "scene.yaml", tmp_path / "motion.json")
    assert proof.text.startswith("accepted: ")
    (text,) = [line for line in proof.text.splitlines() if line.startswith("  also proven: ")]
    assert {"goal", "path"} <= {*text.removeprefix("  also proven: ").split(", ")}
    head, world, rest = unpacked(proof.data)
    other = tmp_path / "other.yaml"
    for link in ("left", "right", "root", "cup"):
        replace(alone, goal=hdplan.PoseTarget(link, there)).save(other)
        head["files"]["scene"] = hashlib.sha256(other.read_bytes()).hexdigest()
        world["goal"][0]["poses"][0]["link"] = link
        with pytest.raises(RejectedError, match="goal: "):
            check(other, tmp_path / "motion.json", packed_world(head, world, rest))
