"""A body in MuJoCo obeys the same mechanics as hdplan's robot, executes what is planned, and stays in the tube of its
measured errors, for which the proof then holds."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as xml

import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan import InputError, Trajectory, control
from hdplan.planner.control.mujoco_arm import execute_in_mujoco
from hdplan.planner.control.mujoco_model import mujoco_xml
from hdplan.planner.control.simulation import replay
from hdplan.planner.robot.loads import carrying
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from tests.extras import mujoco, needs
from tests.planner.replanning.driving import AtOnce

from .rooms import FakeArm

pytestmark = needs("mujoco")

LIMITS = hdplan.Limits(velocity="urdf", acceleration=7.5, jerk=500)


def _panda(**changes: object) -> hdplan.Scene:
    """A Panda that goes round a box."""
    box = hdplan.Obstacle("box", hdplan.Box([0.1, 0.1, 0.5]), [0.55, 0, 0.35])
    ends = {"start": [-0.6, -0.3, 0, -2, 0, 1.8, 0.785], "goal": [0.6, -0.3, 0, -2, 0, 1.8, 0.785]}
    return hdplan.Scene(**{"robot": "panda", "obstacles": [box], "limits": LIMITS, **ends, **changes})


@pytest.fixture(scope="module")
def planned() -> tuple[hdplan.Scene, Trajectory]:
    scene = _panda()
    result = hdplan.plan(scene)
    assert result.certified
    return scene, result.trajectory


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["panda_carry", "ur5_ceiling", "ur5_payload", "xarm7_post", "kinova_shelf"])
def test_the_mujoco_model_has_the_mechanics_of_the_robot(name: str) -> None:
    """Mass matrix, gravity and Coriolis forces, at random configurations and speeds; with loads, from the ceiling."""
    setup = Setup.of(hdplan.load_scene(name))
    robot, scene = setup.robot, setup.scene
    body = mujoco.MjModel.from_xml_string(mujoco_xml(setup))
    data, rng = mujoco.MjData(body), np.random.default_rng(3)
    model = carrying(robot, scene.payload, scene.attached, "")
    own = model.createData()
    for q in robot.draw(rng, 5):
        v = rng.normal(size=robot.n)
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(body, data)
        whole = np.zeros((robot.n, robot.n))
        mujoco.mj_fullM(body, data, whole)
        upper = np.triu(pin.crba(model, own, robot.pin_q(q)))
        mass = upper + np.triu(upper, 1).T
        assert np.allclose(whole, mass, rtol=1e-6, atol=1e-6 * np.abs(mass).max())
        assert np.allclose(data.qfrc_bias, pin.nle(model, own, robot.pin_q(q), v), rtol=1e-5, atol=1e-4)
        weight = pin.computeGeneralizedGravity(model, own, robot.pin_q(q))
        assert np.allclose(data.qfrc_gravcomp, weight, rtol=1e-6, atol=1e-5)


def test_the_executed_motion_stays_in_the_measured_tube_and_the_proof_holds(
    planned: tuple[hdplan.Scene, Trajectory],
) -> None:
    scene, motion = planned
    done = control.Loop(control.MuJoCoArm.of(scene)).follow(motion)
    assert not done.why
    assert 1e-5 < np.abs(done.errors).max() < 0.02
    lag = done.tracking
    assert (np.abs(done.errors) <= np.array(lag.position)).all()
    assert (np.array(lag.position) <= 1.02 * np.abs(done.errors).max(axis=0)).all()
    for known in (hdplan.Tracking(lag.position), lag.times(1.5)):  # the same motion; another one, slower by its sizes
        sized = replace(scene, robot=hdplan.RobotSpec("panda", tracking=known))
        again = motion if known.velocity == 0.0 else hdplan.plan(sized).trajectory
        proven = hdplan.certify(sized, again)
        assert proven.certified, proven.text
        assert proven.clearance is not None
        simulation = replay(Setup.of(sized), again, execute_in_mujoco)
        assert simulation.succeeded, simulation.text
        assert simulation.closest is not None
        assert simulation.closest.distance >= proven.clearance


def test_a_body_that_is_farther_off_than_the_scene_has_it_fails(planned: tuple[hdplan.Scene, Trajectory]) -> None:
    scene, motion = planned
    close = replace(scene, robot=hdplan.RobotSpec("panda", tracking=hdplan.Tracking(1e-4)))
    simulation = replay(Setup.of(close), motion, execute_in_mujoco)
    assert not simulation.succeeded
    assert "more than robot.tracking.position: the proof does not cover it" in simulation.text


def test_the_simulated_arm_holds_its_place() -> None:
    """The weight is carried; nothing moves by itself, however the base hangs."""
    arm = control.MuJoCoArm.of(hdplan.load_scene("ur5_ceiling"))
    q = arm.state()[0]
    for _ in range(200):
        arm.send(q, np.zeros_like(q))
    assert np.abs(arm.state()[0] - q).max() < 1e-6
    assert np.allclose(arm.time(), 0.2)


def _model(tmp_path: Path) -> Path:
    """hdplan's own model of the Panda as a file of the user's, with Menagerie's names and position actuators alone."""
    root = xml.fromstring(mujoco_xml(Setup.of(_panda())))
    drives = root.find("actuator")
    assert drives is not None
    for drive in list(drives):
        if drive.tag == "velocity":
            drives.remove(drive)
        else:
            drive.set("kv", "30")
    text = xml.tostring(root, encoding="unicode").replace("panda_joint", "joint")
    path = tmp_path / "panda.xml"
    path.write_text(text)
    return path


def test_a_model_file_executes_and_is_held_against_the_robot(
    tmp_path: Path, planned: tuple[hdplan.Scene, Trajectory]
) -> None:
    scene, motion = planned
    path = _model(tmp_path)
    done = execute_in_mujoco(Setup.of(scene), motion.curve, path)
    assert not done.lost
    assert np.abs(done.errors).max() > 0.005  # no drive gets a velocity
    hanging = replace(scene, robot=hdplan.RobotSpec("panda", base=[0, 0, 0.1]))
    with pytest.raises(InputError, match=r"panda\.xml: joint: the axis of 'panda_joint2' is 100 mm and 0 rad from"):
        control.MuJoCoArm.of(hanging, model=path)
    with pytest.raises(InputError, match="joint: no joint 'shoulder_pan_joint' is there; it has joint1"):
        control.MuJoCoArm.of(hdplan.load_scene("ur5_table"), model=path)
    whole = path.read_text()
    path.write_text(re.sub(r'<position name="joint3"[^>]*>', '<motor name="joint3" joint="joint3" />', whole))
    with pytest.raises(InputError, match="actuator: joint 'panda_joint3' needs one position actuator"):
        control.MuJoCoArm.of(scene, model=path)
    path.write_text(whole[:300])
    with pytest.raises(InputError, match="is not a model that MuJoCo can read") as caught:
        control.MuJoCoArm.of(scene, model=path)
    assert "\n" not in str(caught.value)


class Faulty(FakeArm):
    """An arm with which something is wrong after a while."""

    def __init__(self, names: tuple[str, ...], at: Array, fault: float | BaseException, after: int = 20) -> None:
        super().__init__(names, at, 0.01)
        self.fault, self.left = fault, after

    def send(self, position: Array, velocity: Array) -> None:
        super().send(position, velocity)
        self.left -= 1
        if self.left <= 0:
            if isinstance(self.fault, BaseException):
                raise self.fault
            self.q[2] += self.fault


@pytest.mark.parametrize("fault", [np.nan, 0.2, -np.inf])
def test_an_arm_that_is_off_is_stopped(fault: float, planned: tuple[hdplan.Scene, Trajectory]) -> None:
    motion = planned[1]
    arm = Faulty(motion.joint_names, motion.positions[0], fault)
    done = control.Loop(arm).follow(motion)
    assert arm.stopped
    assert "joint 'panda_joint3' is" in done.why
    assert len(done.times) == 21


@pytest.mark.parametrize("error", [RuntimeError("no network"), KeyboardInterrupt()])
def test_an_arm_whose_driver_fails_is_stopped(error: BaseException, planned: tuple[hdplan.Scene, Trajectory]) -> None:
    motion = planned[1]
    arm = Faulty(motion.joint_names, motion.positions[0], error)
    with pytest.raises(type(error)):
        control.Loop(arm).follow(motion)
    assert arm.stopped


def test_nothing_is_sent_to_an_arm_that_does_not_fit(planned: tuple[hdplan.Scene, Trajectory]) -> None:
    motion = planned[1]
    away = Faulty(motion.joint_names, motion.positions[0] + 0.1, 0.0)
    for arm, wrong, match in (
        (away, motion, "is 0.1 from where the motion begins, at most 0.05 is allowed: move it there first"),
        (away, replace(motion, times=None, velocities=None, accelerations=None), "times: missing"),
        (
            Faulty(("a", "b"), np.zeros(2), 0.0),
            motion,
            "joint_names: must be those of the arm: a, b; found panda_joint1",
        ),
    ):
        with pytest.raises(InputError, match=match):
            control.Loop(arm).follow(wrong)
        assert arm.now == 0.0
    with pytest.raises(InputError, match="most: must be"):
        control.Loop(away, most=float("nan"))


def test_a_replanner_drives_the_body(planned: tuple[hdplan.Scene, Trajectory]) -> None:
    """The body arrives, within the tracking error of its scene, and stands at the planned place."""
    scene = replace(planned[0], robot=hdplan.RobotSpec("panda", tracking=hdplan.Tracking(0.01, 0.4)))
    arm = control.MuJoCoArm.of(scene)
    with hdplan.Replanner(scene, clock=arm.time, executor=AtOnce()) as replanner:
        done = control.Loop(arm).replan(replanner, 10.0)
    assert not done.why
    assert done.commands[-1].mode.value == "arrived"
    assert np.abs(done.positions[-1] - np.array(scene.goal.positions)).max() < 0.01
    assert np.abs(done.errors).max() <= 0.01


@pytest.mark.parametrize("fault", ["camera", "speed"])
def test_an_arm_whose_replanner_fails_comes_to_rest_as_proven(
    fault: str, planned: tuple[hdplan.Scene, Trajectory]
) -> None:
    """The arm follows the last command to its end, without a jump. Then the error is raised."""
    scene = replace(planned[0], obstacles=[], robot=hdplan.RobotSpec("panda", tracking=hdplan.Tracking(0.01, 0.4)))
    arm = Faulty(planned[1].joint_names, np.array(scene.start.positions), 0.0, 10**6)

    def see(t: float) -> None:
        if t > 0.4:
            if fault == "camera":
                raise RuntimeError("no camera")
            arm.v = arm.v + 100.0

    with hdplan.Replanner(scene, clock=arm.time, executor=AtOnce()) as replanner:
        steps, step = list[hdplan.Command](), replanner.step
        replanner.step = lambda t: steps.append(step(t)) or steps[-1]  # type: ignore[method-assign]
        with pytest.raises((RuntimeError, InputError), match=r"no camera|dq: joint"):
            control.Loop(arm).replan(replanner, 10.0, see)
    last = steps[-1]
    assert last.mode.value == "moving"
    assert last.motion.duration is not None
    assert arm.now >= last.time + last.motion.duration
    assert not arm.stopped
    np.testing.assert_allclose(arm.q, last.motion.positions[-1], atol=1e-9)


def test_a_job_is_executed_with_its_stages() -> None:
    """The caller drives the fingers: a callback reports when each stage begins."""
    scene = hdplan.load_scene("panda_pick_place")
    motion = hdplan.plan_job(scene).trajectory
    arm = control.MuJoCoArm.of(scene)
    begun: list[tuple[str, float]] = []
    done = control.Loop(arm).follow(motion, begins=lambda mark: begun.append((mark.name, arm.time())))
    assert not done.why
    assert motion.times is not None
    assert [name for name, _ in begun] == [mark.name for mark in motion.stages]
    assert np.allclose([when for _, when in begun], [motion.times[mark.row] for mark in motion.stages], atol=arm.period)
    assert np.abs(done.errors).max() < 0.02
    part = replace(motion, stages=())
    with pytest.raises(InputError, match="joint_names: must be those of the arm"):
        control.Loop(arm).follow(part)
