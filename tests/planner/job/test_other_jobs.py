"""Jobs of other robots: choices that are taken back, a base that hangs, a held mesh that is not convex, what reading
refuses."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import InputError, JobResult
from hdplan.planner.job.choices import Search
from hdplan.planner.job.world import World
from hdplan.scenes import deadline
from hdplan.scenes.yaml_format.reader import shipped_scenes

DOWN = [0.0, np.pi / 2, 0.0]  # the cup of a UR5 looks down
ACROSS = [0.0, np.pi / 2, np.pi / 2]
LIMITS = hdplan.Limits(acceleration=8.0)
CUP = "wrist_3_link"


def above(place: list[float], turn: list[float] = DOWN) -> hdplan.PoseTarget:
    return hdplan.PoseTarget("ee_link", hdplan.Pose.from_rpy(place, turn))


def line(z: float, place: tuple[float, float], **more: Any) -> hdplan.Line:
    return hdplan.Line(to=[*place, z], link="ee_link", **more)


@pytest.mark.parametrize(("wrist", "taken_back"), [(-1.57, True), (1.57, False)])
def test_the_first_grasp_that_works_to_the_end_is_taken(wrist: float, taken_back: bool) -> None:
    """A bar is to lie in a slot, in which it fits one way round only: which, is decided when it is gripped, two moves
    before. From one of two starts the grasp that does not fit is the nearer one."""
    spec = hdplan.RobotSpec("ur5", ignore_pairs=[["wrist_3_link", "ee_link"]])
    walls = [
        hdplan.Box([0.3, 0.02, 0.06], name=f"wall{i}", pose=[0.5, -0.4 + 0.06 * side, 0.05])
        for i, side in enumerate((-1, 1))
    ]
    floor = hdplan.Box([0.6, 1.2, 0.02], name="floor", pose=[0.5, 0.0, 0.01])
    bar = hdplan.Box([0.24, 0.04, 0.04], name="bar", pose=[0.5, 0.3, 0.04])
    job = hdplan.Job([
        hdplan.Move([above([0.5, 0.3, 0.25], turn) for turn in (DOWN, ACROSS)], name="above"),
        line(0.063, (0.5, 0.3), touch=[["bar", CUP]], name="down"),
        hdplan.Grip(object="bar", link="ee_link", touch=[["bar", CUP]], name="take"),
        line(0.25, (0.5, 0.3), touch=[["bar", "floor"]], name="lift"),
        hdplan.Move(above([0.5, -0.4, 0.25]), name="carry"),
        line(0.065, (0.5, -0.4), touch=[["bar", "floor"]], name="lower"),
        hdplan.Release(object="bar", touch=[["bar", "floor"]], name="leave"),
        line(0.25, (0.5, -0.4), touch=[["bar", CUP]], name="back"),
    ])  # fmt: skip
    start = [0.3, -1.5, 1.9, -1.97, -1.57, wrist]
    scene = hdplan.Scene(robot=spec, obstacles=[floor, bar, *walls], start=start, limits=LIMITS, job=job)
    result = hdplan.plan_job(scene)
    assert result.certified, result.text
    # without a motion
    given_up = re.compile(r"above: goal\[\d\]: rejected, as stage 'carry' cannot follow it: rejected, as stage 'lower'")
    (left,) = [each for each in result.certificate.stages[-1].scene.attached if each.name == "bar"]
    assert (
        abs(left.pose.matrix[0, 0]) > 0.99
    )  # along the slot; the link that stands fast is the world's, or half turned
    assert any(map(given_up.match, result.notes)) == taken_back


@pytest.fixture(scope="module")
def hanging() -> hdplan.Scene:
    """A UR5 under a ceiling takes a hook, a mesh that is not convex, by its top."""
    base = hdplan.Pose.from_rpy([0.0, 0.0, 1.0], [np.pi, 0.0, 0.0])
    spec = hdplan.RobotSpec("ur5", base=base, ignore_pairs=[["wrist_3_link", "ee_link"]])
    file = shipped_scenes()["panda_vase"].parent / "hook.obj"
    hook = hdplan.Mesh(file, 0.5, name="hook", pose=[0.45, 0.2, 0.05])
    floor = hdplan.Box([1.0, 1.2, 0.02], name="floor", pose=[0.4, 0.0, 0.03])
    top = 0.05 + 0.12
    job = hdplan.Job([
        hdplan.Move(hdplan.PoseTarget("ee_link", hdplan.Pose.from_rpy([0.45, 0.2, 0.3], DOWN), free_rotation="x")),
        line(top + 0.003, (0.45, 0.2), touch=[["hook", CUP]], name="down"),
        hdplan.Grip(object="hook", link="ee_link", touch=[["hook", CUP]]),
        line(0.35, (0.45, 0.2), touch=[["hook", "floor"]], name="lift", position_tolerance=1e-4),
        hdplan.Wait(0.2, name="hold"),
    ])  # fmt: skip
    start = {"shoulder_pan_joint": 0.0, "shoulder_lift_joint": -1.5, "elbow_joint": 1.5, "wrist_1_joint": 0.0}
    start |= {"wrist_2_joint": 0.0, "wrist_3_joint": 0.0}
    return hdplan.Scene(robot=spec, obstacles=[hook, floor], start=start, limits=LIMITS, job=job)


@pytest.fixture(scope="module")
def hung(hanging: hdplan.Scene) -> JobResult:
    return hdplan.plan_job(hanging)


def test_a_mesh_that_is_not_convex_is_held_by_a_robot_that_hangs(hung: JobResult) -> None:
    assert hung.certified, hung.text
    lift, hold = hung.certificate.stages[-2:]
    assert lift.held == hold.held == ("hook",)
    assert hold.ends - hold.begins == pytest.approx(0.2, abs=1e-12)
    assert not np.ptp(hold.trajectory.positions, axis=0).any()
    (kept,) = [each for each in lift.scene.attached if each.name == "hook"]
    assert isinstance(kept.shape, hdplan.Mesh)


def test_meshes_that_are_held_are_compared_as_they_are(hanging: hdplan.Scene, hung: JobResult) -> None:
    motion = hung.trajectory
    peg = hdplan.Box([0.01, 0.01, 0.02], name="peg", pose=[0.45, 0.2 - 0.02, 0.25])
    found = hdplan.certify_job(replace(hanging, goal=None, obstacles=[*hanging.obstacles, peg]), motion)
    assert not found.certified
    assert found.failed is not None


JOB = """
hdplan: 1
robot: {name: panda}
start: {state: default}
limits: {acceleration: 4}
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("job: [{fly: 1}]", r"job\[0\]: unknown key 'fly'"),
        ("job: []", "job: must be a list of one or more stages"),
        ("job: [{move: {state: default}, wait: 1}]", "has more than one of move, wait"),
        ("job: [{name: a}]", "has none of the keys move, line, circle, along, grip, release, set, wait"),
        ("job: [{line: {by: [0, 0, 1], too: [0, 0, 1]}}]", r"job\[0\].line: unknown key 'too' \(did you mean 'to'\?\)"),
        ("job: [{line: {}}]", "must have either 'by' or 'to', found neither"),
        ("job: [{line: {by: [0, 0, 0]}}]", r"job\[0\].line.by: has no length"),
        ("job: [{line: {to: [0, 0, 1], frame: tool}}]", "goes with 'by'"),
        ("job: [{wait: -1}]", r"job\[0\].wait: must be a finite number"),
        ("job: [{wait: 1, path: {upright: {link: panda_hand}}}]", r"job\[0\].path: goes with 'move' alone"),
        ("job: [{wait: 1, speed: 2}]", r"job\[0\].speed: "),
        ("job: [{wait: 1, touch: [[a]]}]", r"touch\[0\]: must be two names"),
        ("job: [{wait: 1, touch: [[a, a]]}]", "two different bodies"),
        ("job: [{wait: 1, name: a}, {wait: 1, name: a}]", "names must differ"),
        ("job: [{grip: {link: panda_hand}}]", "must have 'joints', 'object' or both"),
        ("job: [{release: {object: can, link: a}}]", "unknown key 'link'"),
        ("job: [{wait: 1}]\ngoal: {state: default}", "goal: the stages of the job define the goals"),
        ("job: [{wait: 1}]\ntiming: {duration: 2}", "timing.duration: applies to one motion"),
        ("job: [{wait: 1}]\npath: {upright: {link: panda_hand}}", "path: belongs to the stages"),
        ("job: [{wait: 1}]\nself_collision: false", "self_collision: false is not allowed with a job"),
        (
            "job: [{wait: 1}]\nobstacles: [{shape: {type: sphere, radius: 0.1}, motion: {velocity: [0, 0, 1]}}]",
            r"obstacles\[0\].motion: depends on the time of a single motion",
        ),
    ],
)
def test_invalid_jobs_are_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "job.yaml").write_text(JOB + text + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=words) as caught:
        hdplan.load_scene(tmp_path / "job.yaml")
    assert "\n" not in str(caught.value)


def test_a_job_needs_times_and_objects_that_can_be_held() -> None:
    wait = hdplan.Job([hdplan.Wait(1.0)])
    with pytest.raises(InputError, match=r"limits\.acceleration: is missing"):
        hdplan.plan_job(hdplan.Scene(robot="panda", start="default", job=wait))
    cloud = hdplan.Cloud([[0.5, 0.0, 0.3]], radius=0.01, name="seen")
    vase = hdplan.Obstacle("vase", hdplan.Sphere(0.02), [0.5, 0.3, 0.3], clearance=0.02)
    for name, words in (("seen", "only shapes and meshes"), ("vase", "a clearance of its own")):
        job = hdplan.Job([hdplan.Wait(1.0, touch=[[name, "panda_hand"]])])
        scene = hdplan.Scene(robot="panda", start="default", limits=LIMITS, obstacles=[cloud, vase], job=job)
        with pytest.raises(InputError, match=words):
            hdplan.plan_job(scene)


def test_fingers_alone_move_what_follows_them() -> None:
    job = hdplan.Job(
        [hdplan.Grip({"panda_finger_joint1": 0.01}), hdplan.Wait(0.1), hdplan.Release({"panda_finger_joint1": 0.02})]
    )
    result = hdplan.plan_job(hdplan.Scene(robot="panda", start="default", limits=LIMITS, job=job))
    assert result.certified, result.text
    motion = result.trajectory
    assert motion.locked.keys().isdisjoint({"panda_finger_joint1", "panda_finger_joint2"})
    assert motion.positions[-1, motion.joint_names.index("panda_finger_joint1")] == 0.02
    held = [stage.scene.robot.locked.get("panda_finger_joint2") for stage in result.certificate.stages]
    assert held == [None, 0.01, None]


def test_a_job_that_ends_before_its_first_stage_reports_it() -> None:
    job = hdplan.Job([hdplan.Move([0.3, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]), hdplan.Wait(0.1)])
    scene = hdplan.Scene(robot="panda", start="default", limits=LIMITS, job=job)
    with pytest.raises(hdplan.TimeLimitError, match="before the first stage"):
        hdplan.plan_job(scene, time_limit=0.0)
    with pytest.raises(hdplan.TimeLimitError, match="before the first stage"):
        hdplan.plan_job(scene, stop=lambda: True)
    fingers = hdplan.Job([hdplan.Grip({"panda_finger_joint1": 0.01})])
    with pytest.raises(InputError, match="give the fingers' in this stage"):
        hdplan.plan_job(replace(scene, goal=None, job=fingers, limits=hdplan.Limits(acceleration=[5.0] * 7)))


def test_stages_planned_before_a_commands_time_limit_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit around all of a command passes while the third stage is planned: nothing is lost, as nothing is where
    the job's own limit passes. The stages that were planned are certified, as stops."""
    table = hdplan.Box([0.3, 0.3, 0.02], name="table", pose=[0.0, 0.6, 0.3])
    away = [[share, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785] for share in (0.3, 0.6, 0.9)]
    job = hdplan.Job([hdplan.Move(q, blend=0.02 * (k < 2)) for k, q in enumerate(away)])
    scene = hdplan.Scene(robot="panda", start="default", obstacles=[table], limits=LIMITS, job=job)
    goals = Search._goals

    def late(search: Search, world: World, number: int) -> Any:
        if number == 2:
            deadline._until.set(time.perf_counter())
        return goals(search, world, number)

    monkeypatch.setattr(Search, "_goals", late)
    with deadline.time_limit(600.0):
        result = hdplan.plan_job(scene)
        assert deadline.seconds_left() == 0.0
    assert len(result.trajectory.stages) == 2
    assert "stage 'move 2'" in result.text
    assert all(stage.certificate.certified for stage in result.certificate.stages)
    assert hdplan.certify_job(scene, result.trajectory).text == result.certificate.text
