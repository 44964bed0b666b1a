"""Gravity's torques from the kinematics alone, the term on them, and the scenes that need torques at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.control.simulation import replay
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.plan import plan
from hdplan.planner.problem import gravity_torque
from hdplan.planner.problem.gravity_torque import GravityMeasure, GravityTorques, StaticTorque, static_torque
from hdplan.planner.problem.samples import Samples
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.attached import Payload
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import Limits
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.yaml_format.reader import load_scene
from tests.loops import in_numpy, needs_loops

from ..urdf import joint_text, link_text, write_robot

SCENES = Path(__file__).resolve().parents[3] / "scenes" / "shipped"
ON_A_WALL = Pose((0.3, -0.2, 0.9), (0, 0.6, 0, 0.8))
UPRIGHT = Pose((0, 0, 1), (0.7071067811865476, 0, 0, 0.7071067811865476))  # the planar arm in a vertical plane
PLANAR = RobotSpec(urdf=SCENES / "planar_arm.urdf", srdf=SCENES / "planar_arm.srdf", base=UPRIGHT)
BODY = (
    '<inertial><origin xyz="0.1 -0.05 0.2"/><mass value="2"/>'
    '<inertia ixx="0.3" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0.5"/></inertial>'
)
SHORT: dict[str, Any] = {"limits": (-0.5, 0.5)}
SLIDING = (
    link_text("l0"),
    *(link_text(f"l{i}", inertial=BODY) for i in range(1, 6)),
    joint_text("slide", "l0", "l1", "0.6 0 0.8", kind="prismatic", **SHORT),
    joint_text("turn", "l1", "l2", "0 1 0", at="0.2 0.1 0", **SHORT),
    joint_text("reach", "l2", "l3", "1 0 0", kind="prismatic", **SHORT),
    joint_text("twist", "l3", "l4", kind="continuous"),
    joint_text("other", "l1", "l5", "1 0 0", **SHORT),
)


def _robot(name: str, folder: Path) -> Robot:
    if name == "planar":
        return load_robot(PLANAR)
    if name == "sliding":  # and branching
        return load_robot(RobotSpec(urdf=write_robot(folder / "sliding.urdf", *SLIDING), base=ON_A_WALL))
    return load_robot(RobotSpec(name=name, base=ON_A_WALL if name == "kinova" else Pose()))


NAMES = ("panda", "ur5", "xarm7", "kinova", "planar", "sliding")


@pytest.mark.parametrize("name", NAMES)
def test_gravity_and_its_slope_agree_with_pinocchio(name: str, tmp_path: Path) -> None:
    robot = _robot(name, tmp_path)
    q = robot.draw(np.random.default_rng(1), 20)
    torques, kinematics = GravityTorques.of(robot.model), Kinematics(robot.model).evaluate(q)
    torque, slope = torques.torque(kinematics), torques.slope(kinematics)
    data = robot.model.createData()
    for row, configuration in enumerate(robot.pin_q(q)):
        expected = pin.computeGeneralizedGravity(robot.model, data, configuration)
        np.testing.assert_allclose(torque[row], expected, atol=1e-10)
        expected = pin.computeGeneralizedGravityDerivatives(robot.model, data, configuration)
        np.testing.assert_allclose(slope[row], expected, atol=1e-10)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", NAMES)
def test_no_configuration_loads_a_joint_beyond_its_bound(name: str, tmp_path: Path) -> None:
    robot = _robot(name, tmp_path)
    torques, kinematics = GravityTorques.of(robot.model), Kinematics(robot.model)
    bound = torques.most(robot.model, np.stack([robot.lower, robot.upper], axis=1))
    found = np.zeros(robot.n)
    for seed in range(10):
        torque = torques.torque(kinematics.evaluate(robot.draw(np.random.default_rng(seed), 10_000)))
        found = np.maximum(found, np.abs(torque).max(axis=0))
    assert (found <= bound + 1e-9).all()
    assert found.max() > 0.3 * bound.max()  # and it is of some use


def _scene(limit: float, payload: Payload | None = None, torque: bool = True) -> Scene:
    """The planar arm swings its tip from hanging down to straight up; stretched out level it weighs most."""
    limits = Limits(velocity=2.0, acceleration=5.0, torque=(limit, 10.0) if torque else None)
    start, goal = JointTarget("start", (-1.5707, 0.0)), JointTarget("goal", (1.5707, 0.0))
    return Scene("swing", Path("swing.yaml"), PLANAR, (), start, goal, limits=limits, payload=payload)


def test_the_terms_derivatives_are_those_of_its_value(tmp_path: Path) -> None:
    robot = load_robot(RobotSpec(name="panda"))
    scene = replace(_scene(1.0), limits=Limits(torque=(30.0, 30, 20, 15, 2, 2, 1)))
    term = static_torque(Setup(scene, robot))
    kinematics, samples = Kinematics(robot.model), Samples((8,))
    q = robot.draw(np.random.default_rng(2), 8)
    value = term.at_samples(kinematics.evaluate(q), samples)
    assert value.cost > 0
    step = 1e-6
    for joint in range(7):
        ahead, behind = (
            term.at_samples(kinematics.evaluate(q + sign * step * np.eye(7)[joint]), samples) for sign in (1, -1)
        )
        slope = (ahead.cost - behind.cost) / (2 * step)
        assert value.gradient[:, joint].sum() == pytest.approx(slope, rel=1e-5, abs=1e-9)
    assert (np.linalg.eigvalsh(value.curvature) >= -1e-12).all()


@needs_loops
@pytest.mark.parametrize("name", ["panda", "sliding", "baxter"])
def test_loop_and_twin_agree(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chains, joints that slide and two arms; where no joint, one or all are overloaded."""
    rng, robot = np.random.default_rng(8), _robot(name, tmp_path)
    torques = GravityTorques.of(robot.model)
    kinematics = Kinematics(robot.model).evaluate(robot.expand(robot.draw(rng, 40)))
    largest = np.maximum(np.abs(torques.torque(kinematics)).max(axis=0), 1e-3)
    for share in (2.0, 0.9, 0.1, 1e-9):
        joints = np.flatnonzero(rng.random(len(largest)) < 0.7)
        measure = GravityMeasure(torques, joints, share * rng.uniform(0.7, 1.3, len(joints)) * largest[joints])
        term, samples = StaticTorque("static torque", measure, 0.02), Samples((40,))
        loop, depth = term.at_samples(kinematics, samples), term.depth(kinematics)
        with monkeypatch.context() as patch:
            in_numpy(patch, gravity_torque)
            twin = term.at_samples(kinematics, samples)
            assert depth == pytest.approx(term.depth(kinematics), rel=1e-12, abs=1e-12)
        assert (loop is None) == (twin is None) == (share > 1.5)
        for found, expected in zip(vars(loop).values(), vars(twin).values(), strict=True) if loop and twin else ():
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-11 * float(np.abs(expected).max()))


def test_a_joint_that_gravity_cannot_overload_is_left_out() -> None:
    robot = load_scene_robot(_scene(12.0))

    def joints(limit: float, carried: float) -> list[int]:
        payload = Payload("forearm", carried, (0.5, 0.0, 0.0)) if carried else None
        term = static_torque(Setup.of(_scene(limit, payload), robot))
        return term.measure.joints.tolist() if term else []

    assert joints(12.0, 0.0) == [0]  # the elbow bears 2.9 Nm at most, of 10
    assert joints(12.0, 1.0) == [0]
    assert joints(12.0, 2.0) == [0, 1]
    assert joints(100.0, 0.0) == []


def test_without_torque_limits_there_is_no_such_term() -> None:
    problem = build(_scene(0.0, torque=False))
    assert problem.terms.static_torque is None
    rows = explain(problem)
    assert dict(rows.pop("off"))["limits of torque"] == "needs limits.torque"
    assert "torque" not in str(rows)
    problem = build(_scene(12.0))
    assert problem.terms.static_torque is not None
    assert "gravity alone takes 80% of the limit of shoulder" in dict(explain(problem)["on"])["limits of torque"]
    assert "static torque" in dict(explain(problem)["trial evaluation"])


def test_ends_that_gravity_overloads_are_refused() -> None:
    scene = _scene(12.0)
    with pytest.raises(InputError, match=r"goal: joint 'shoulder' needs a torque of 13\.7\d* to hold still"):
        plan(replace(scene, goal=JointTarget("goal", (0.0, 0.0))))


def test_another_way_is_found_where_the_straight_one_is_too_heavy() -> None:
    """Level and stretched the arm with its load needs 23.5 Nm at the shoulder: it has to fold its elbow."""
    load = Payload("forearm", 1.0, (0.5, 0.0, 0.0))
    scene = _scene(12.0, load)
    robot = load_scene_robot(scene)
    blind = plan(_scene(12.0, torque=False), robot=robot)
    assert blind.certified
    assert np.abs(blind.trajectory.positions[:, 1]).max() < 1e-6  # straight through
    verdict = Certifier(Setup.of(scene, robot)).certify(blind.trajectory)
    assert verdict.status is Status.OVERLOADED
    assert verdict.overloaded
    assert "moving slower does not help" in verdict.text
    result = plan(scene, robot=robot)
    assert result.certified
    assert "torques at most" in result.certificate.text
    assert np.abs(result.trajectory.positions[:, 1]).max() > 1.0
    still = np.zeros(2)
    model = Setup.of(scene, robot).loaded_model
    held = [pin.rnea(model, model.createData(), q, still, still)[0] for q in result.trajectory.positions]
    assert np.abs(held).max() < 12.0
    assert replay(Setup.of(scene, robot), result.trajectory).succeeded
    assert not replay(Setup.of(scene, robot), blind.trajectory).succeeded


@pytest.mark.parametrize(("name", "slower"), [("ur5_payload", True), ("panda_heavy", True)])
def test_scenes_that_need_their_torque_limits(name: str, slower: bool) -> None:
    """Without the limits the motion is certified, and no robot can follow it; with them one can."""
    scene = load_scene(name)
    robot = load_scene_robot(scene)
    certifier = Certifier(Setup.of(scene, robot))
    blind = plan(replace(scene, limits=replace(scene.limits, torque=None), payload=None), robot=robot)
    assert blind.certified
    verdict = certifier.certify(blind.trajectory)
    assert verdict.status is Status.OVERLOADED
    replayed = replay(Setup.of(scene, robot), blind.trajectory)
    assert not replayed.succeeded
    assert "needs a torque of" in replayed.text
    result = plan(scene, robot=robot)
    assert result.certified
    assert certifier.certify(result.trajectory).certified
    assert blind.trajectory.times is not None
    assert result.trajectory.times is not None
    assert result.trajectory.times[-1] > blind.trajectory.times[-1]
    replayed = replay(Setup.of(scene, robot), result.trajectory)
    assert replayed.succeeded
    assert all((joint.error or 0.0) < 1e-3 for joint in replayed.joints)


def test_the_weight_of_a_held_object_counts_by_exactly_its_body() -> None:
    scene = load_scene("panda_heavy")
    robot = load_scene_robot(scene)
    weightless = replace(scene, attached=tuple(replace(held, mass=None) for held in scene.attached))
    (held,) = scene.attached
    heavy, light = (Setup(each, robot).loaded_model for each in (scene, weightless))
    hand = robot.model.frames[robot.model.getFrameId("panda_hand")]
    body = pin.Inertia.FromCylinder(held.mass, 0.03, 0.26)
    placement = hand.placement * pin.SE3(held.pose.matrix)
    light.appendBodyToJoint(hand.parentJoint, body, placement)
    rng = np.random.default_rng(5)
    for q in robot.draw(rng, 5):
        state = (q, rng.normal(size=7), rng.normal(size=7))
        torques = [pin.rnea(model, model.createData(), *state) for model in (heavy, light)]
        np.testing.assert_allclose(torques[0], torques[1], atol=1e-10)
    certifiers = [Certifier(Setup.of(each)) for each in (scene, weightless)]
    blind = plan(weightless)
    assert blind.certified
    assert certifiers[1].certify(blind.trajectory).certified
    assert certifiers[0].certify(blind.trajectory).status is Status.OVERLOADED
