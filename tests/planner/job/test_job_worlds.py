"""Laws of what there is in a stage: what stands still counts, a camera's image of the robot is that of the beginning,
what is held moves with what holds it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hdplan
from hdplan.scenes.errors import InputError

from ..links import place_of

LIMITS = hdplan.Limits(acceleration=4.0)
FINGER = "panda_finger_joint1"
HAND = ["panda_leftfinger", "panda_rightfinger"]


def place(link: str, q: object) -> np.ndarray:
    return np.array(place_of(hdplan.load_robot("panda"), link, q).translation)


def scene(*stages: object, **more: object) -> hdplan.Scene:
    return hdplan.Scene(robot="panda", start="default", limits=LIMITS, job=hdplan.Job(stages), **more)


def default() -> list[float]:
    robot = hdplan.load_robot("panda")
    return [robot.named_states["default"][joint] for joint in robot.joint_names]


@pytest.mark.parametrize("away", [0.0, 0.3])
def test_an_arm_that_stands_in_something_moves_no_fingers(away: float) -> None:
    box = hdplan.Box([0.05, 0.05, 0.05], name="box", pose=[*(place("panda_link5", default()) - [0.0, away, 0.0])])
    requested = scene(hdplan.Grip({FINGER: 0.01}), obstacles=[box])
    if away:
        result = hdplan.plan_job(requested)
        assert result.certified
        (stage,) = result.certificate.stages
        assert stage.certificate.clearance is not None
        arm = hdplan.plan_job(replace(requested, goal=None, job=hdplan.Job([hdplan.Wait(0.1)]))).certificate
        assert arm.clearance == pytest.approx(stage.certificate.clearance, abs=1e-9)
    else:
        with pytest.raises(hdplan.UnsolvableError, match=r"in contact: panda_link\d and box"):
            hdplan.plan_job(requested)


def test_a_contact_that_an_earlier_stage_allowed_keeps_fingers_from_moving() -> None:
    """A box that the wrist stands in, which the stage before allows."""
    box = hdplan.Box([0.05, 0.05, 0.05], name="box", pose=[*place("panda_link5", default())])
    touch = [["box", [f"panda_link{i}" for i in range(8)]]]
    requested = scene(hdplan.Wait(0.1, touch=touch), hdplan.Grip({FINGER: 0.01}), obstacles=[box])
    result = hdplan.plan_job(requested)
    assert [stage.kind for stage in result.certificate.stages] == ["wait"]
    assert "in contact" in result.failure


def test_points_are_ignored_about_where_the_job_begins() -> None:
    """Points where the robot comes by later are no image of it."""
    job = [hdplan.Line(by=[0, 0, -0.1]), hdplan.Line(by=[0, 0, -0.05])]
    motion = hdplan.plan_job(scene(*job)).trajectory
    below = place("panda_hand_tcp", motion.positions[motion.stages[1].row]) - [0.0, 0.0, 0.03]
    points = [below + [x, y, 0.0] for x in (-0.02, 0.0, 0.02) for y in (-0.02, 0.0, 0.02)]
    own = place("panda_hand_tcp", default())
    seen = hdplan.Cloud(np.array([*points, own, [2.0, 2.0, 2.0]]), radius=0.002, name="seen", ignore_robot=0.06)
    found = hdplan.certify_job(scene(*job, obstacles=[seen]), motion)
    assert found.failed is found.stages[1]
    assert "and seen overlap" in found.text
    assert found.notes[0].startswith("cloud 'seen': of 11 points left out: 1 within 60 mm of the robot")


def test_points_about_an_object_are_ignored_where_the_job_finds_it() -> None:
    """Those that lie where it is carried stay."""
    down = place("panda_hand_tcp", default()) - [0.0, 0.0, 0.02]
    can = hdplan.Sphere(0.01, name="can", pose=[*down])
    job = [
        hdplan.Grip(object="can", link="panda_hand", touch=[["can", HAND]], joints={FINGER: 0.0095}),
        hdplan.Line(by=[0, 0, -0.1]),
    ]
    there = down - [0.0, 0.0, 0.1]
    seen = hdplan.Cloud(
        np.array([there, down]), radius=0.002, name="seen", ignore=[hdplan.Ignored(0.03, obstacle="can")]
    )
    open_ = hdplan.RobotSpec("panda", locked={FINGER: 0.02, "panda_finger_joint2": 0.02})
    free = replace(scene(*job, obstacles=[can]), robot=open_, goal=None)
    motion = hdplan.plan_job(free).trajectory
    assert hdplan.certify_job(free, motion).certified
    found = hdplan.certify_job(replace(free, goal=None, obstacles=[can, seen]), motion)
    assert found.failed is found.stages[1]
    assert "and seen overlap" in found.text


def test_a_wait_lasts_as_long_as_requested() -> None:
    job = scene(hdplan.Wait(5.0))
    motion = hdplan.plan_job(job).trajectory
    found = hdplan.certify_job(job, replace(motion, times=[0.0, 4.99]))
    assert found.text == "stage 'wait 0': wrong ends: the robot waits 4.99 s, the job has 5 s"
    assert hdplan.certify_job(job, replace(motion, times=[-2.0, 3.0])).certified


def test_fingers_that_close_through_what_they_hold_are_noted() -> None:
    held = hdplan.Attached("bar", "panda_hand", hdplan.Box([0.02, 0.04, 0.02]), [0.0, 0.0, 0.1], HAND)
    for closed, contacts in ((0.022, ()), (0.005, tuple(f"close: bar and {finger}" for finger in HAND))):
        job = scene(hdplan.Grip({FINGER: closed}, name="close"), attached=[held])
        notes = hdplan.plan_job(replace(job, goal=None, start={**_start(), FINGER: 0.03})).notes
        assert tuple(note.partition(" may touch, and overlap by 15 mm")[0] for note in notes) == contacts


def _start() -> dict[str, float]:
    robot = hdplan.load_robot("panda")
    return {joint: robot.named_states["default"][joint] for joint in robot.joint_names}


def test_limits_of_the_arms_joints_limit_no_fingers() -> None:
    by_joints = hdplan.Limits(acceleration=4.0, jerk=[100.0] * 7)
    job = replace(scene(hdplan.Grip({FINGER: 0.01})), goal=None, limits=by_joints)
    with pytest.raises(InputError, match="scene's jerk is by joints of the arm"):
        hdplan.plan_job(job)


def test_fingers_that_may_not_go_so_far_say_in_which_stage() -> None:
    with pytest.raises(InputError, match=r"job\[0\] \(grip 0\): goal: joint 'panda_finger_joint1' is 0.08, outside"):
        hdplan.plan_job(scene(hdplan.Grip({FINGER: 0.08})))


def test_a_released_object_loses_its_allowed_contacts() -> None:
    one = hdplan.Attached("one", "panda_hand", hdplan.Box([0.02, 0.02, 0.02]), [0.0, 0.0, 0.2], ["two"])
    two = hdplan.Attached("two", "panda_hand", hdplan.Box([0.02, 0.02, 0.02]), [0.0, 0.0, 0.225], ["one"])
    for up, certified in ((0.05, True), (-0.05, False)):
        job = [hdplan.Release(object="two"), hdplan.Line(by=[0.0, 0.0, up], touch=[["two", "panda_link0"]])]
        result = hdplan.plan_job(scene(*job, attached=[one, two]))
        assert result.certified == certified, result.text
        assert certified or "one and two overlap" in result.failure
