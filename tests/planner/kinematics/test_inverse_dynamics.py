"""Inverse dynamics agree with Pinocchio's rnea, with the base anywhere and with what a scene puts on the links."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from hdplan.planner.kinematics.inverse_dynamics import InverseDynamics, inverse_dynamics
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.loads import loaded_model
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Shape, Sphere
from hdplan.scenes.targets import JointTarget

from ..urdf import joint_text, link_text, write_robot

SCENES = Path(__file__).resolve().parents[3] / "scenes" / "shipped"
ARMS = ("panda", "ur5", "xarm7", "kinova", "planar")
BASES = {
    "upright": Pose(),
    "upside down": Pose((0, 0, 2), (1, 0, 0, 0)),
    "on a wall": Pose((0.3, -0.2, 0.9), (0, 0.6, 0, 0.8)),
}
EXACT = 1e-10  # [Nm] required agreement
LOAD = Payload("panda_hand", 2.5, (0.02, -0.03, 0.11), (0.02, 0.001, -0.002, 0.03, 0.0015, 0.025))


def _robot(name: str, base: Pose = BASES["upright"]) -> Robot:
    return load_robot(
        RobotSpec(urdf=SCENES / "planar_arm.urdf", base=base) if name == "planar" else RobotSpec(name=name, base=base)
    )


def _scene(robot: str = "panda", **changes: object) -> Scene:
    joints = JointTarget("start", state="default")
    scene = Scene("test", Path("test.yaml"), RobotSpec(name=robot), (), joints, joints)
    return replace(scene, **changes)


def _states(robot: Robot, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return robot.draw(rng, count), rng.normal(0, 2, (count, robot.n)), rng.normal(0, 8, (count, robot.n))


def _rnea(model: pin.Model, robot: Robot, q: Array, v: Array, a: Array) -> Array:
    data = model.createData()
    return np.array([pin.rnea(model, data, *state).copy() for state in zip(robot.pin_q(q), v, a, strict=True)])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("name", ARMS)
def test_torques_agree_with_pinocchio(name: str, base: str) -> None:
    robot = _robot(name, BASES[base])
    state = _states(robot, 30)
    torques = InverseDynamics(robot.model).torques(*state)
    np.testing.assert_allclose(torques, _rnea(robot.model, robot, *state), atol=EXACT, rtol=0)


def test_all_kinds_of_joints_and_rotors_agree_with_pinocchio(tmp_path: Path) -> None:
    axes = ["1 0 0", "0 1 0", "0.6 0 0.8"]
    kinds = [(kind, axis) for kind in ("prismatic", "continuous", "revolute") for axis in axes]
    body = (
        '<inertial><origin xyz="0.1 -0.05 0.2" rpy="0.4 0 1"/><mass value="{}"/>'
        '<inertia ixx="0.3" ixy="0.01" ixz="-0.02" iyy="0.4" iyz="0.03" izz="0.5"/></inertial>'
    )
    links = (link_text(f"l{i}", inertial=body.format(1 + i / 7)) for i in range(len(kinds) + 1))
    place: dict[str, Any] = {"at": "0.1 0.2 0.3", "limits": (-3, 3)}
    joints = (  # a tree: the last three hang on the third link
        joint_text(f"j{i}", f"l{i if i < 6 else 3}", f"l{i + 1}", axis, kind=kind, rpy=f"0.3 0.2 {0.1 * i}", **place)
        for i, (kind, axis) in enumerate(kinds)
    )
    path = write_robot(tmp_path / "mixed.urdf", *links, *joints)
    robot = load_robot(RobotSpec(urdf=path, base=BASES["on a wall"]))
    robot.model.armature = np.linspace(0.1, 0.9, robot.n)
    state = _states(robot, 20)
    torques = InverseDynamics(robot.model).torques(*state)
    np.testing.assert_allclose(torques, _rnea(robot.model, robot, *state), atol=EXACT, rtol=0)


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_path_coefficients_give_the_torques_at_any_rate(name: str) -> None:
    robot = _robot(name)
    dynamics, rng = InverseDynamics(robot.model), np.random.default_rng(3)
    q, dq, ddq = _states(robot, 25)
    found = dynamics.coefficients(q, dq, ddq)
    rate, change = rng.uniform(0, 3, (25, 1)), rng.normal(0, 3, (25, 1))
    torques = found.a * change + found.b * rate**2 + found.c
    expected = dynamics.torques(q, dq * rate, ddq * rate**2 + dq * change)
    np.testing.assert_allclose(torques, expected, atol=1e-9, rtol=0)


def test_gravity_alone_is_a_smaller_expression_and_the_same_torque() -> None:
    robot = _robot("panda")
    q = ca.SX.sym("q", robot.n)
    still = ca.SX(robot.n, 1)
    gravity = ca.Function("gravity", [q], [inverse_dynamics(robot.model, q, still, still)])
    dynamics = InverseDynamics(robot.model)
    assert gravity.n_instructions() < dynamics.function.n_instructions() / 3
    for configuration in robot.draw(np.random.default_rng(4), 5):
        expected = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), configuration)
        np.testing.assert_allclose(gravity(configuration).full().ravel(), expected, atol=EXACT, rtol=0)


def test_upside_down_gravity_stays_the_worlds() -> None:
    upright, hanging = _robot("ur5"), _robot("ur5", BASES["upside down"])
    q = upright.draw(np.random.default_rng(5), 10)
    still = np.zeros_like(q)
    np.testing.assert_allclose(
        InverseDynamics(hanging.model).torques(q, still, still),
        -InverseDynamics(upright.model).torques(q, still, still),
        atol=EXACT,
    )


def test_a_payload_changes_torques_by_what_a_body_there_takes() -> None:
    """Newton and Euler for the load alone: its wrench at its centre, carried to the joints by the Jacobian."""
    robot = _robot("panda", BASES["on a wall"])
    loaded = Setup(_scene(payload=LOAD), robot).loaded_model
    q, v, a = _states(robot, 10)
    added = InverseDynamics(loaded).torques(q, v, a) - InverseDynamics(robot.model).torques(q, v, a)
    model = robot.model.copy()
    hand = model.frames[model.getFrameId("panda_hand")]
    centre = model.addFrame(
        pin.Frame(
            "centre",
            hand.parentJoint,
            hand.placement * pin.SE3(np.eye(3), np.array(LOAD.com)),
            pin.FrameType.OP_FRAME,
        )
    )
    xx, xy, xz, yy, yz, zz = LOAD.inertia
    inertia, data = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), model.createData()
    for row in range(10):
        pin.forwardKinematics(model, data, q[row], v[row], a[row])
        pin.updateFramePlacements(model, data)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = pin.computeFrameJacobian(model, data, q[row], centre, aligned)
        pin.forwardKinematics(model, data, q[row], v[row], a[row])
        spin = pin.getFrameVelocity(model, data, centre, aligned).angular
        classical = pin.getFrameClassicalAcceleration(model, data, centre, aligned)
        turned = data.oMf[centre].rotation @ inertia @ data.oMf[centre].rotation.T
        force = LOAD.mass * (classical.linear + [0, 0, 9.81])
        moment = turned @ classical.angular + np.cross(spin, turned @ spin)
        np.testing.assert_allclose(added[row], jacobian.T @ np.concatenate([force, moment]), atol=1e-9)


SHAPES: dict[str, tuple[Shape, Array]] = {  # and points that fill it evenly enough for integrals
    "box": (Box((0.1, 0.2, 0.3)), np.array([0.1, 0.2, 0.3])),
    "sphere": (Sphere(0.1), np.array([0.2, 0.2, 0.2])),
    "ellipsoid": (Ellipsoid((0.1, 0.2, 0.05)), np.array([0.2, 0.4, 0.1])),
    "cylinder": (Cylinder(0.1, 0.4), np.array([0.2, 0.2, 0.4])),
    "capsule": (Capsule(0.1, 0.3), np.array([0.2, 0.2, 0.5])),
    "points": (Points(((0.0, 0, 0), (0.3, 0, 0), (0, 0.2, 0), (0, 0, 0.4))), np.array([0.6, 0.4, 0.8])),
}


def _inside(shape: Shape, points: Array) -> NDArray[np.bool_]:
    x, y, z = np.abs(points).T
    match shape:
        case Sphere(radius):
            return x * x + y * y + z * z <= radius**2
        case Ellipsoid(radii):
            return ((points / radii) ** 2).sum(axis=1) <= 1
        case Cylinder(radius, _):
            return x * x + y * y <= radius**2
        case Capsule(radius, length):
            return x * x + y * y + np.maximum(z - length / 2, 0) ** 2 <= radius**2
        case Points():
            return (points >= 0).all(axis=1) & (points @ [1 / 0.3, 1 / 0.2, 1 / 0.4] <= 1)
    return np.ones(len(points), dtype=np.bool_)


@pytest.mark.parametrize("kind", SHAPES)
def test_a_held_object_weighs_as_a_body_of_even_density(kind: str) -> None:
    shape, size = SHAPES[kind]
    pose = Pose((0.05, -0.02, 0.1), (0.5, 0.5, -0.5, 0.5))
    robot = _robot("panda")
    model = loaded_model(_scene(attached=(Attached("thing", "panda_hand", shape, pose, mass=3.0),)), robot)
    joint = model.frames[model.getFrameId("panda_hand")].parentJoint
    total, bare = model.inertias[joint], robot.model.inertias[joint]
    grid = (np.stack(np.meshgrid(*[np.arange(60)] * 3), axis=-1).reshape(-1, 3) + 0.5) / 60 - 0.5
    points = grid * size
    points = points[_inside(shape, points)] @ pose.matrix[:3, :3].T + pose.matrix[:3, 3]
    hand = model.frames[model.getFrameId("panda_hand")].placement
    points = points @ hand.rotation.T + hand.translation
    assert total.mass == pytest.approx(bare.mass + 3.0, abs=1e-12)
    first = (total.mass * total.lever - bare.mass * bare.lever) / 3.0
    np.testing.assert_allclose(first, points.mean(axis=0), atol=2e-3)
    second = total.matrix()[3:, 3:] - bare.matrix()[3:, 3:]  # about the joint's origin
    spread = (points[:, :, None] * points[:, None, :]).mean(axis=0)
    expected = 3.0 * (np.trace(spread) * np.eye(3) - spread)
    np.testing.assert_allclose(second, expected, atol=0.03 * np.abs(expected).max())


def test_a_held_mesh_weighs_as_the_box_that_it_is_and_an_open_one_is_refused(tmp_path: Path) -> None:
    import trimesh

    box = trimesh.creation.box([0.1, 0.2, 0.3])
    box.export(tmp_path / "box.stl")
    inside_out = box.copy()
    inside_out.invert()
    inside_out.export(tmp_path / "inverted.stl")
    open_box = box.copy()
    open_box.update_faces(np.arange(len(box.faces)) > 0)
    open_box.export(tmp_path / "open.stl")
    robot = _robot("ur5")

    def model(shape: Shape) -> pin.Model:
        held = Attached("thing", "wrist_3_link", shape, Pose((0, 0, 0.1)), mass=1.5)
        return Setup(_scene("ur5", attached=(held,)), robot).loaded_model

    expected = model(Box((0.1, 0.2, 0.3))).inertias[-1].matrix()
    for name in ("box", "inverted"):
        found = model(Mesh(tmp_path / f"{name}.stl")).inertias[-1].matrix()
        np.testing.assert_allclose(found, expected, atol=1e-7)
    with pytest.raises(InputError, match=r"attached.thing.mass: mesh .*open.stl is not closed"):
        model(Mesh(tmp_path / "open.stl"))


def test_the_robots_own_model_stays_as_it_is() -> None:
    robot = _robot("panda")
    before = [inertia.matrix() for inertia in robot.model.inertias]
    loaded = Setup(_scene(payload=LOAD), robot).loaded_model
    np.testing.assert_array_equal(before, [inertia.matrix() for inertia in robot.model.inertias])
    assert not np.array_equal(before, [inertia.matrix() for inertia in loaded.inertias])
    bare = loaded_model(_scene(attached=(Attached("cup", "panda_hand", Sphere(0.03)),)), robot)
    np.testing.assert_array_equal(before, [inertia.matrix() for inertia in bare.inertias])


def test_unknown_robots_and_bodies_are_refused_by_name() -> None:
    robot = _robot("panda")
    with pytest.raises(InputError, match=r"test.yaml: payload.link: panda has no link 'panda_hnd' \(did you mean 'pan"):
        _ = Setup.of(_scene(payload=replace(LOAD, link="panda_hnd")), robot).loaded_model
    with pytest.raises(InputError, match=r"Payload.inertia: .* its principal moments are 0.1, 0.1 and 0.3"):
        replace(LOAD, inertia=(0.1, 0, 0, 0.1, 0, 0.3))
    with pytest.raises(InputError, match=r"Payload\.inertia: .* none may be negative"):
        replace(LOAD, inertia=(0.1, 0, 0, 0.1, 0, -0.1))


def test_a_urdf_without_masses_is_refused(tmp_path: Path) -> None:
    path = write_robot(tmp_path / "light.urdf", *map(link_text, ("base", "tip")), joint_text("turn", "base", "tip"))
    with pytest.raises(InputError, match=r"limits\.torque: joint 'turn' of light moves no mass"):
        _ = Setup(_scene(), load_robot(RobotSpec(urdf=path))).loaded_model
