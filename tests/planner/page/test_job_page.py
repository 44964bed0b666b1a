"""A job's page: what is held moves with the hand, what was let go stays, and what is close is that of the stage."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.commands.view import run_view
from hdplan.planner.job.places import link_pose
from hdplan.planner.page import job_page
from hdplan.planner.page.job_page import ShownJob
from hdplan.planner.terminal.declared import GivenScene
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacle_motion import ObstacleMotion

HAND = ["panda_leftfinger", "panda_rightfinger", "panda_hand"]
FINGERS = {"panda_finger_joint1": 0.02}


@pytest.fixture(scope="module")
def shown() -> ShownJob:
    """A block is carried down, let go, and left; on the way stands a box."""
    block = hdplan.Attached("block", "panda_hand", hdplan.Box([0.02] * 3), [0.0, 0.0, 0.12], HAND[:2])
    box = hdplan.Box([0.1] * 3, name="box", pose=[0.6, 0.3, 0.4])
    job = hdplan.Job([
        hdplan.Line(by=[0.0, 0.05, -0.05], name="down"),
        hdplan.Release({"panda_finger_joint1": 0.03}, "block", name="leave"),
        hdplan.Line(by=[0.0, 0.0, 0.05], touch=[["block", HAND]], name="up"),
    ])  # fmt: skip
    robot = hdplan.load_robot("panda")
    start = {x: robot.named_states["default"][x] for x in robot.joint_names} | FINGERS
    scene = hdplan.Scene(
        robot="panda", start=start, limits=hdplan.Limits(acceleration=4.0), attached=[block], obstacles=[box], job=job
    )
    result = hdplan.plan_job(scene)
    assert result.certified, result.text
    return ShownJob(scene, result.trajectory, result.certificate)


def test_a_held_object_moves_with_the_hand_and_stays_where_it_is_released(shown: ShownJob) -> None:
    setup, stages = shown.setup, shown.certificate.stages
    (block,) = [each for each in setup.scene.obstacles if each.name == "block"]

    moving, curve = ObstacleMotion.of(block), shown.motion.curve
    times = np.linspace(0.0, stages[-1].ends, 41)
    grasp = np.eye(4)
    grasp[2, 3] = 0.12
    for now, place in zip(times, moving.at(times), strict=True):
        until = min(now, stages[1].ends)
        hand = link_pose(setup.robot, curve.at_time(np.array([until]))[0], "panda_hand")
        np.testing.assert_allclose(place, hand @ grasp, atol=2e-4)  # between two places it moves straight
    (left,) = [each for each in stages[-1].scene.attached if each.name == "block"]
    world = link_pose(setup.robot, curve.at_time(times[:1])[0], left.link) @ left.pose.matrix
    np.testing.assert_allclose(moving.at(times[-1:])[0], world, atol=1e-9)


def test_a_stage_too_short_to_be_drawn_is_passed_over(shown: ShownJob, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that sets outputs in the middle of a long job."""
    monkeypatch.setattr(job_page, "sample_parameters", lambda _: np.array([0.0, 1.0]))
    rough = replace(shown)
    np.testing.assert_array_equal(rough.motion.clearance, shown.motion.clearance[[0, -1]])


def test_the_closest_pair_is_that_of_the_stage(shown: ShownJob) -> None:
    """Nothing that may touch, and never closer than is proven; while fingers move, of the arm too."""
    ends = [stage.begins for stage in shown.certificate.stages]
    for stage, proven in zip(shown.stages, shown.certificate.stages, strict=True):
        for now in np.linspace(proven.begins, proven.ends, 5):
            near, between = stage.closest(now)
            assert near is not None
            least = min(proven.certificate.clearance or 0.0, proven.certificate.self_clearance or 0.0)
            for pair in (near, between):  # of which one may be with what may be touched, as it then stands
                assert pair is None or {pair.link, pair.other} not in [{"block", each} for each in HAND]
                assert pair is None or pair.distance >= least - 1e-9
    middle = shown.certificate.stages[1]
    before, during = (shown.closest(now)[0] for now in (ends[1] - 1e-6, 0.5 * (middle.begins + middle.ends)))
    assert before is not None
    assert during is not None
    assert during.distance == pytest.approx(before.distance, abs=1e-3)


def test_the_page_has_the_stages(shown: ShownJob, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown.scene.save(tmp_path / "job.yaml")
    shown.trajectory.save(tmp_path / "job.json")
    given: dict[str, Any] = {"proof": None, "video": None, "host": None, "port": None}
    twice = [tmp_path / "job.json"] * 2
    with pytest.raises(InputError, match="one motion at a time"):
        run_view(GivenScene(str(tmp_path / "job.yaml")), twice, record=tmp_path / "a.html", **given)
    assert run_view(GivenScene(str(tmp_path / "job.yaml")), twice[:1], record=tmp_path / "a.html", **given) == 0
    assert "a.html" in capsys.readouterr().out
    written = (tmp_path / "a.html").read_text(encoding="utf-8")
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', written, re.S)
    assert found
    content: Any = json.loads(found[1])
    assert [stage["name"] for stage in content["stages"]] == ["down", "leave", "up"]
    assert content["stages"][0]["begin"] == content["timeline"]["begin"] == 0.0
    assert content["stages"][-1]["end"] == pytest.approx(content["timeline"]["end"], abs=1e-5)
    assert all(one["end"] == two["begin"] for one, two in zip(content["stages"], content["stages"][1:], strict=False))
    assert content["stages"][0]["words"] == "holds block"
    assert content["stages"][2]["words"].startswith("holds nothing; may touch: block-panda_leftfinger")
    (motion,) = content["motions"]
    assert (motion["certified"], motion["verdict"]) == (True, shown.certificate.text)
    assert [joint["name"] for joint in content["joints"]][-1] == "panda_finger_joint1"


def test_a_job_that_is_not_certified_says_so(shown: ShownJob) -> None:
    place = link_pose(shown.setup.robot, shown.motion.joints[-1], "panda_hand")[:3, 3]
    wall = hdplan.Box([0.05] * 3, name="wall", pose=[*place])
    scene = replace(shown.scene, goal=None, obstacles=[*shown.scene.obstacles, wall])
    found = hdplan.certify_job(scene, shown.trajectory)
    assert not found.certified
    refused = ShownJob(scene, shown.trajectory, found)
    assert not refused.motion.certificate.certified
    assert [stage.data["certified"] for stage in refused.stages].count(False) >= 1
    part = ShownJob(shown.scene, shown.trajectory, replace(shown.certificate, missing=("more",)))
    assert not part.motion.certificate.certified
