"""Laws of jobs: what is certified is free as it was driven, by a check of its own; what was forged is not certified."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan import InputError, JobResult, Scene, Trajectory
from hdplan.planner.commands.verify import run_verify
from hdplan.planner.terminal.declared import GivenScene

from .forging import Forgery, marked, shifted

ARM = [f"panda_joint{i}" for i in range(1, 8)]
FINGER = "panda_finger_joint1"
HAND = ["panda_leftfinger", "panda_rightfinger"]


def with_stages(scene: Scene, *changes: tuple[int, dict[str, Any]], more: tuple[Any, ...] = ()) -> Scene:
    assert scene.job is not None
    stages = list(scene.job.stages)
    for number, fields in changes:
        stages[number] = replace(stages[number], **fields)
    return replace(scene, goal=None, job=hdplan.Job([*stages, *more]))


def with_obstacles(scene: Scene, *more: hdplan.Obstacle, without: str = "") -> Scene:
    kept = [each for each in scene.obstacles if each.name != without]
    return replace(scene, goal=None, obstacles=(*kept, *more))


def coal_shape(shape: Any) -> Any:
    return coal.Box(*shape.size) if isinstance(shape, hdplan.Box) else coal.Cylinder(shape.radius, shape.length)


def test_only_allowed_contacts_occur_in_a_job(scene: Scene, planned: JobResult) -> None:
    """The whole robot with its hand, the can where it must be by then, coal's distance, every 20 ms: without a line of
    what derives the stages."""
    robot = hdplan.load_robot(hdplan.RobotSpec(name="panda", group=[*ARM, FINGER]))
    motion, data, places = planned.trajectory, robot.model.createData(), robot.collision.createData()
    order = [motion.joint_names.index(joint) for joint in robot.joint_names]
    hand = robot.model.getFrameId("panda_hand")
    standing = {each.name: (coal_shape(each.shape), pin.SE3(each.pose.matrix)) for each in scene.obstacles}
    may = {stage.name: {frozenset(pair) for pair in stage.touch} for stage in planned.certificate.stages}
    for name in ("grip", "lift", "carry", "lower", "let go"):
        may[name] |= {frozenset(("can", finger)) for finger in HAND}
    grasp, least = None, (np.inf, "", "", "")
    assert motion.times is not None
    marks = motion.times[[mark.row for mark in motion.stages]]
    for now in np.union1d(np.arange(0.0, motion.times[-1], 0.02), marks):
        stage = motion.stage_at(now)
        q = robot.pin_q(motion.at_time(now).positions[order])
        pin.forwardKinematics(robot.model, data, q)
        pin.updateFramePlacements(robot.model, data)
        pin.updateGeometryPlacements(robot.model, data, robot.collision, places)
        if stage == "lift" and grasp is None:
            grasp = data.oMf[hand].actInv(standing["can"][1])
        holds = stage in ("lift", "carry", "lower", "let go")
        if holds and grasp is not None:
            standing["can"] = (standing["can"][0], data.oMf[hand] * grasp)
        bodies = [
            (str(robot.model.frames[item.parentFrame].name), item.geometry, place)
            for item, place in zip(robot.collision.geometryObjects, places.oMg, strict=True)
            if item.parentJoint > 0
        ]
        if holds:
            bodies.append(("can", *standing["can"]))
        for link, shape, place in bodies:
            for name, (other, there) in standing.items():
                if name != link and frozenset((name, link)) not in may[stage]:
                    if {link, name} == {"panda_hand", "can"} and holds:
                        continue  # they move as one
                    here, away = (coal.Transform3s(at.rotation, at.translation) for at in (place, there))
                    gap = coal.distance(shape, here, other, away, coal.DistanceRequest(), coal.DistanceResult())
                    least = min(least, (gap, stage, link, name))
    assert least > (0.0, "", "", "")
    left = planned.certificate.stages[-1].scene
    (can,) = [each for each in left.obstacles if each.name == "can"]
    np.testing.assert_allclose(can.pose.matrix, standing["can"][1].homogeneous, rtol=0, atol=1e-9)
    np.testing.assert_allclose(can.pose.position, [0.5, -0.3, 0.171], rtol=0, atol=2e-3)


def test_stages_join_without_a_jump(planned: JobResult) -> None:
    motion, stages = planned.trajectory, planned.certificate.stages
    assert motion.velocities is not None
    assert motion.times is not None
    rows = [mark.row for mark in motion.stages]
    assert not motion.velocities[[*rows, -1]].any()
    assert [each.begins for each in stages[1:]] == [each.ends for each in stages[:-1]]
    for one, other in itertools.pairwise(stages):
        assert np.array_equal(one.trajectory.positions[-1], other.trajectory.positions[0])
        assert motion.stage_at(one.ends) == other.name
    assert motion.stage_at(motion.times[-1]) == stages[-1].name


def test_lines_are_straight(planned: JobResult) -> None:
    """The tool is within the tolerance at every millisecond, by the kinematics of another load of the robot."""
    robot = hdplan.load_robot("panda")
    for stage in planned.certificate.stages:
        if stage.kind == "line":
            pose = stage.trajectory.of_joints(robot.joint_names, {}).sampled(1000.0).poses(robot, "panda_hand_tcp")
            place, way = pose[:, :3, 3], pose[-1, :3, 3] - pose[0, :3, 3]
            way /= np.linalg.norm(way)
            off = place - place[0]
            assert np.linalg.norm(off - np.outer(off @ way, way), axis=1).max() < 1e-3
            turned = pose[:, :3, :3] @ pose[0, :3, :3].T
            assert np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1)).max() < 1e-2


def test_files_keep_marks_and_are_certified_again(scene: Scene, planned: JobResult, tmp_path: Path) -> None:
    planned.save(tmp_path / "job.json")
    again = Trajectory.load(tmp_path / "job.json")
    assert again.stages == planned.trajectory.stages
    assert hdplan.certify_job(scene, again).text == planned.certificate.text
    scene.save(tmp_path / "job.yaml")
    assert hdplan.load_scene(tmp_path / "job.yaml") == scene
    (tmp_path / "half.json").write_bytes((tmp_path / "job.json").read_bytes()[:4000])
    with pytest.raises(InputError, match="not JSON"):
        Trajectory.load(tmp_path / "half.json")
    for ending in ("csv", "npz"):
        planned.save(tmp_path / f"job.{ending}")
        assert Trajectory.load(tmp_path / f"job.{ending}").stages == again.stages
    with pytest.raises(InputError, match="no marks of stages"):
        hdplan.certify_job(scene, replace(again, stages=()))


def test_the_scene_of_a_stage_is_one_like_any_other(planned: JobResult, tmp_path: Path) -> None:
    for stage in planned.certificate.stages:
        stage.scene.save(tmp_path / "stage.yaml")
        assert hdplan.certify(hdplan.load_scene(tmp_path / "stage.yaml"), stage.trajectory).certified


def test_the_checker_accepts_the_proof_of_a_stage_that_touches(planned: JobResult, tmp_path: Path) -> None:
    """The stage in which fingers close on the can has a proof of its own, and none for another scene."""
    (stage,) = [each for each in planned.certificate.stages if each.name == "grip"]
    scene, motion, proof = (tmp_path / f"grip.{ending}" for ending in ("yaml", "json", "proof"))
    stage.scene.save(scene)
    stage.trajectory.save(motion)
    hdplan.prove(scene, motion).save(proof)
    assert run_verify(GivenScene(str(scene)), motion, proof) == 0
    written, touching = scene.read_text(encoding="utf-8"), '"touch_links": ["panda_leftfinger", "panda_rightfinger"]'
    assert written.count(touching) == 1
    scene.write_text(written.replace(touching, '"touch_links": []'), encoding="utf-8")
    assert run_verify(GivenScene(str(scene)), motion, proof) == 1


def test_a_forged_motion_is_not_certified(scene: Scene, planned: JobResult) -> None:
    motion = planned.trajectory
    rows = [mark.row for mark in motion.stages]
    names = [mark.name for mark in motion.stages]
    forged: list[Forgery] = [
        shifted("velocities", rows[1], ARM[0], 0.05),  # no rest where stages meet
        shifted("velocities", -1, ARM[0], 0.05),
        shifted("positions", rows[3] + 5, FINGER, 0.005),  # the hand opens while it carries
        shifted("positions", rows[2] + 3, ARM[1], 0.01),  # the arm moves while the hand closes
        shifted("positions", 0, ARM[0], 1e-3),  # another start
        shifted("positions", rows[2], ARM[3], 1e-3),  # the line ends elsewhere
        shifted("positions", rows[6] - 10, ARM[3], 0.02),  # off the line
        *(marked(by, names[n]) for n, by in ((2, 4), (3, -4), (6, -4), (7, 4))),
        lambda old: replace(old, stages=old.stages[:-1]),  # the last stage as a part of the one before
        lambda old: replace(old, stages=(*old.stages[:1], *old.stages[2:])),
    ]
    for forge in forged:
        certified = False
        with contextlib.suppress(InputError):
            certified = hdplan.certify_job(scene, forge(motion)).certified
        assert not certified


def test_touching_is_for_the_stages_that_say_so(scene: Scene, planned: JobResult) -> None:
    motion = planned.trajectory
    assert "'lift'" in hdplan.certify_job(with_stages(scene, (3, {"touch": ()})), motion).text
    swapped = with_stages(scene, (3, {"touch": ()}), (2, {"touch": [["can", [*HAND, "table"]]]}))
    assert "'lift'" in hdplan.certify_job(swapped, motion).text
    more = with_stages(scene, (4, {"touch": [["can", "crate_left"]]}))
    notes = hdplan.certify_job(more, motion).notes
    assert any("carry: can and crate_left may touch, and are apart" in note for note in notes)


def test_held_objects_are_compared_with_everything_else(scene: Scene, planned: JobResult) -> None:
    """A bar that only the can meets, and a can that is longer than the one that was planned."""
    motion = planned.trajectory
    low = hdplan.Obstacle("bar", hdplan.Box([0.02, 0.02, 0.02]), [0.5, -0.3, 0.14])
    found = hdplan.certify_job(with_obstacles(scene, low), motion)
    assert found.failed is not None
    assert found.failed.name == "lower"
    assert "can and bar" in found.failed.certificate.text
    (can,) = [each for each in scene.obstacles if each.name == "can"]
    found = hdplan.certify_job(
        with_obstacles(scene, replace(can, shape=hdplan.Cylinder(0.03, 0.3)), without="can"), motion
    )
    assert not found.certified


def test_a_released_object_is_an_obstacle_at_its_place(scene: Scene, planned: JobResult) -> None:
    """A hand that does not open leaves the can only by the way of the can."""
    motion, finger = planned.trajectory, planned.trajectory.joint_names.index(FINGER)
    row = motion.stages[6].row
    positions, velocities, accelerations = (
        np.array(values) for values in (motion.positions, motion.velocities, motion.accelerations)
    )
    positions[row:, finger], velocities[row:, finger], accelerations[row:, finger] = 0.03, 0.0, 0.0
    shut = replace(motion, positions=positions, velocities=velocities, accelerations=accelerations)
    fingers = {FINGER: 0.03, "panda_finger_joint2": 0.03}
    found = hdplan.certify_job(with_stages(scene, (6, {"joints": fingers})), shut)
    assert found.failed is not None
    assert found.failed.name == "back out"
    assert "and can" in found.failed.certificate.text


@pytest.mark.parametrize(
    ("number", "fields", "words"),
    [
        (3, {"touch": [["cann", "table"]]}, r"job\[3\] \(lift\): touch: unknown body 'cann' \(did you mean 'can'\?\)"),
        (3, {"touch": [["panda_link1", "panda_hand"]]}, "links both"),
        (6, {"object": "table"}, r"job\[6\] \(let go\): release.object: 'table' is not held; held: can"),
        (2, {"object": "cup"}, "there is no object 'cup'"),
        pytest.param(
            *(1, {"by": [0.0, 0.0, -0.02]}, "'can' is out of reach: panda_leftfinger, panda_rightfinger"),
            marks=pytest.mark.slow,  # every grasp is tried
        ),
        (2, {"joints": {"panda_finger_joint": 0.03}}, "unknown joint 'panda_finger_joint'"),
        (2, {"joints": {"panda_joint1": 0.03}}, "one of the arm's"),
        (2, {"joints": {"panda_finger_joint2": 0.03}}, "follows 'panda_finger_joint1'"),
        (2, {"link": "panda_hnd"}, "unknown link 'panda_hnd'"),
        (2, {"link": "panda_link2"}, "panda_leftfinger., which holds it .`touch`., moves relative to that"),
        (1, {"limits": hdplan.Limits(jerk=5.0)}, r"job\[1\] \(descend\): limits.acceleration: is missing"),
        (4, {"limits": hdplan.Limits(velocity=1.0)}, r"limits.acceleration: is missing in the stage's own limits"),
        (1, {"frame": "tol"}, "line.frame: unknown 'tol'"),
        (1, {"link": "hand"}, "unknown link 'hand'"),
        (1, {"link": "panda_link0"}, "line.link: no planned joint moves 'panda_link0'"),
        pytest.param(
            *(1, {"by": [0.0, 0.0, 2.5]}, "from wherever it begins: no joint values were found for 14% of the way"),
            marks=pytest.mark.slow,  # every goal is tried
        ),
    ],
)
def test_an_impossible_job_is_one_line(scene: Scene, number: int, fields: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        hdplan.plan_job(with_stages(scene, (number, fields)))
    assert "\n" not in str(caught.value)


def test_functions_for_one_motion_refuse_a_job(scene: Scene, planned: JobResult) -> None:
    motion = planned.trajectory
    robot = hdplan.load_robot(scene.robot)
    calls: list[Callable[[], object]] = [
        lambda: hdplan.plan(scene),
        lambda: hdplan.build(scene),
        lambda: hdplan.certify(scene, motion),
        lambda: hdplan.check_configuration(scene, robot, np.zeros(7)),
        lambda: hdplan.control.Controller.of(scene),
        lambda: hdplan.symbolic.clearance(scene),
        lambda: hdplan.prove(scene.source, "motion.json"),
    ]
    for call in calls:
        with pytest.raises(InputError, match="job: holds several motions"):
            call()
    plain = replace(scene, goal="default", job=None)
    for ask in (hdplan.plan_job, lambda scene: hdplan.certify_job(scene, motion)):
        with pytest.raises(InputError, match="job: is missing"):
            ask(plain)
