"""Laws of what is held: it may be brought somewhere as a link may, and it goes from one hand to another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan import InputError, JobResult
from hdplan.planner.job.proof import prove_job

from ..links import place_of
from .forging import written

LIMITS = hdplan.Limits(acceleration=8.0)
CUP = "wrist_3_link"
TWO_HANDS = """<robot name="sliders"><link name="root"/>
{}
</robot>"""
SLIDER = """<link name="{0}"><collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision></link>
<joint name="{0}_x" type="prismatic"><parent link="root"/><child link="{0}"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="10"/></joint>"""


@pytest.fixture(scope="module")
def placed() -> JobResult:
    """A UR5 takes a bar aslant, and sets it down by the bar's own frame."""
    spec = hdplan.RobotSpec("ur5", ignore_pairs=[["wrist_3_link", "ee_link"]])
    floor = hdplan.Box([0.6, 1.2, 0.02], name="floor", pose=[0.5, 0.0, 0.01])
    bar = hdplan.Box([0.2, 0.04, 0.04], name="bar", pose=hdplan.Pose.from_rpy([0.5, 0.3, 0.041], [0.0, 0.0, 0.3]))
    down = hdplan.Pose.from_rpy([0.5, 0.3, 0.2], [0.0, np.pi / 2, 0.0])
    there = hdplan.Pose.from_rpy([0.45, -0.3, 0.15], [0.0, 0.0, 1.1])
    level = hdplan.PathConstraints(upright=hdplan.Upright("bar", "z", 0.3))
    job = hdplan.Job([
        hdplan.Move(hdplan.PoseTarget("ee_link", down, free_rotation="x"), name="above"),
        hdplan.Line(to=[0.5, 0.3, 0.064], link="ee_link", touch=[["bar", CUP]]),
        hdplan.Grip(object="bar", link="ee_link", touch=[["bar", CUP]]),
        hdplan.Line(by=[0.0, 0.0, 0.1], link="bar", touch=[["bar", "floor"]], name="lift"),
        hdplan.Move(hdplan.PoseTarget("bar", there), level, name="carry"),
        hdplan.Line(to=[0.45, -0.3, 0.041], link="bar", touch=[["bar", "floor"]], name="lower"),
        hdplan.Release(object="bar"),
    ])  # fmt: skip
    start = [0.3, -1.5, 1.9, -1.97, -1.57, 0.0]
    return hdplan.plan_job(hdplan.Scene(robot=spec, obstacles=[floor, bar], start=start, limits=LIMITS, job=job))


def test_a_held_object_is_brought_to_a_pose_like_a_link(placed: JobResult, tmp_path: Path) -> None:
    """The cup keeps the bar where it took it, all the way, by Pinocchio; the bar's own line is straight."""
    assert placed.certified, placed.text
    robot, motion = hdplan.load_robot(placed.scene.robot), placed.trajectory

    def hand(row: int) -> pin.SE3:
        return place_of(robot, "ee_link", motion.positions[row])

    rows = [mark.row for mark in motion.stages]
    (bar,) = [each for each in placed.scene.obstacles if each.name == "bar"]
    held = hand(rows[2]).inverse() * pin.SE3(bar.pose.matrix)
    lift = np.array([(hand(row) * held).translation for row in range(rows[3], rows[4] + 1)])
    np.testing.assert_allclose(lift[:, :2], np.broadcast_to([0.5, 0.3], lift[:, :2].shape), rtol=0, atol=1e-3)
    assert lift[-1, 2] == pytest.approx(0.141, abs=1e-3)
    there = hand(rows[5]) * held
    np.testing.assert_allclose(there.translation, [0.45, -0.3, 0.15], rtol=0, atol=1e-3)
    np.testing.assert_allclose(pin.rpy.matrixToRpy(there.rotation), [0.0, 0.0, 1.1], rtol=0, atol=0.02)
    tilts = [(hand(row) * held).rotation[2, 2] for row in range(rows[4], rows[5] + 1)]
    assert min(tilts) >= np.cos(0.3)
    proof = prove_job(*written(placed, tmp_path))
    assert proof.certificate.certified
    assert proof.text.startswith("accepted: a job of 7 stages")
    assert proof.text.count("bar follows its curve of 2 poses") == 2


def test_an_object_that_is_not_held_is_not_a_link(placed: JobResult) -> None:
    job = hdplan.Job([hdplan.Line(by=[0.0, 0.0, 0.1], link="bar")])
    with pytest.raises(InputError, match=r"job\[0\] \(line 0\): line.link: unknown link 'bar'"):
        hdplan.plan_job(replace(placed.scene, goal=None, job=job))


@pytest.fixture
def sliders(tmp_path: Path) -> hdplan.Scene:
    """Two cups on one rail: the left one takes a bar, the right one takes it over."""
    urdf = tmp_path / "sliders.urdf"
    urdf.write_text(TWO_HANDS.format("\n".join(SLIDER.format(name) for name in ("left", "right"))))
    bar = hdplan.Box([0.2, 0.03, 0.03], name="bar", pose=[-0.2, 0.0, 0.0])
    takes = {"left": [["bar", "left"]], "right": [["bar", "right"]]}
    job = hdplan.Job([
        hdplan.Move([-0.323, 0.6], name="left comes"),
        hdplan.Grip(object="bar", link="left", touch=takes["left"], name="left takes"),
        hdplan.Move([-0.123, 0.6], name="left brings"),
        hdplan.Move([-0.123, 0.123], name="right comes"),
        hdplan.Grip(object="bar", link="right", touch=takes["right"], name="right takes"),
        hdplan.Release(object="bar", name="left lets go"),
        hdplan.Move([-0.5, 0.123], name="left goes"),
        hdplan.Move([-0.5, 0.423], name="right brings"),
        hdplan.Release(object="bar", name="right lets go"),
    ])  # fmt: skip
    return hdplan.Scene(robot=hdplan.RobotSpec(urdf=urdf), obstacles=[bar], start=[-0.6, 0.6], limits=LIMITS, job=job)


def test_an_object_goes_from_hand_to_hand(sliders: hdplan.Scene) -> None:
    result = hdplan.plan_job(sliders)
    assert result.certified, result.text
    stages = {each.name: each for each in result.certificate.stages}
    carries = {name: [each.link for each in stage.scene.attached] for name, stage in stages.items()}
    assert carries["left brings"] == carries["right takes"] == carries["left lets go"] == ["left"]
    assert carries["left goes"] == carries["right brings"] == ["right"]
    assert set(stages["left lets go"].scene.attached[0].touch_links) == {"left", "right"}
    assert stages["left goes"].scene.attached[0].touch_links == ("right",)
    assert stages["right brings"].scene.attached[0].pose.position[0] == pytest.approx(-0.123, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({5: None}, r"job\[5\] \(left goes\): 'bar' is held by 'left' and 'right': one has to let go"),
        ({3: hdplan.Move([-0.123, 0.2], name="right comes")}, r"'bar' is out of reach: right is not within 5 mm"),
        ({4: hdplan.Grip(object="bar", link="left", name="right takes")}, "held already, by 'left'"),
        ({5: hdplan.Grip(object="bar", link="left", name="left lets go")}, "held by two hands already"),
    ],
)
def test_two_hands_hold_one_object_only_while_they_stand(
    sliders: hdplan.Scene, changes: dict[int, hdplan.Move | hdplan.Grip | None], words: str
) -> None:
    assert sliders.job is not None
    stages = [changes.get(i, stage) for i, stage in enumerate(sliders.job.stages)]
    with pytest.raises(InputError, match=words):
        hdplan.plan_job(replace(sliders, goal=None, job=hdplan.Job([each for each in stages if each is not None])))


def test_a_hand_that_moves_while_both_hold_is_not_certified(sliders: hdplan.Scene) -> None:
    """A motion in which the left cup drifts where both hold the bar."""
    motion = hdplan.plan_job(sliders).trajectory
    rows = [mark.row for mark in motion.stages]
    positions = motion.positions.copy()
    positions[rows[5] + 1 :, motion.joint_names.index("left_x")] -= 1e-3
    forged = replace(motion, positions=positions)
    verdict = hdplan.certify_job(sliders, forged)
    assert not verdict.certified


def test_fingers_carry_nothing_that_another_hand_holds_too(sliders: hdplan.Scene) -> None:
    """A finger that holds an object, and moves where the other hand holds it as well, would go with it."""
    assert sliders.job is not None
    spec = hdplan.RobotSpec(urdf=sliders.robot.urdf, group=["right_x"], locked={"left_x": -0.123})
    stages = [
        hdplan.Move([0.123]),
        hdplan.Grip(object="bar", link="right", touch=[["bar", "right"]]),
        hdplan.Release({"left_x": -0.2}, "bar", name="left lets go"),
    ]
    held = hdplan.Attached("bar", "left", sliders.obstacles[0].shape, [0.123, 0.0, 0.0], ["left"])
    changes = {"robot": spec, "obstacles": [], "attached": [held], "start": [0.6], "job": hdplan.Job(stages)}
    with pytest.raises(InputError, match=r"job\[2\] \(left lets go\): joints: 'bar' is held by two hands, and 'left'"):
        hdplan.plan_job(replace(sliders, goal=None, **changes))


def test_a_grasp_out_of_reach_leads_to_the_next_one(placed: JobResult) -> None:
    """A bar is taken at its middle, and not from where the first choice would take the cup: beside the bar. Alone, that
    is bad input, by name."""
    stages = list(placed.scene.job.stages) if placed.scene.job else []
    above = hdplan.Pose.from_rpy([0.5, 0.3, 0.2], [0.0, np.pi / 2, 0.0])
    beside = hdplan.Pose.from_rpy([0.38, 0.1, 0.2], [0.0, np.pi / 2, 0.0])
    stages[1] = hdplan.Line(by=[0.0, 0.0, -0.136], link="ee_link", touch=[["bar", CUP]])
    both = [hdplan.PoseTarget("ee_link", pose, free_rotation="x") for pose in (beside, above)]
    job = hdplan.Job([hdplan.Move(both, name="above"), *stages[1:3]])
    found = hdplan.plan_job(replace(placed.scene, job=job))
    assert found.certified, found.text
    job = hdplan.Job([hdplan.Move(both[0], name="above"), *stages[1:3]])
    with pytest.raises(InputError, match="'bar' is out of reach: wrist_3_link"):
        hdplan.plan_job(replace(placed.scene, job=job))
