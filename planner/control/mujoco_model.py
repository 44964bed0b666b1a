"""A robot as a model of MuJoCo: a body and a drive for each planned joint.

A drive with the servo law of industrial ones turns each joint,

    τ = K (q_d − q) + D (q̇_d − q̇) + (the weight that rests on the joint),   K = ω² m,   D = 2 ω m,

where m is the greatest inertia about the joint, of all that it moves, at seeded configurations. What the others do to a
joint, by their accelerations and speeds, is a disturbance: that is the tracking error. No friction. Bodies have
masses and no shapes: what comes close to what is hdplan's to say, by the robot's own meshes.
"""

from __future__ import annotations

from xml.etree import ElementTree as xml

import numpy as np
import pinocchio as pin

from hdplan.planner.control.computed_torque import FREQUENCY, LONGEST_STEP
from hdplan.planner.robot.loads import carrying
from hdplan.planner.robot.pin_model import motion_axes
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, naming

SAMPLES, SEED = 100, 0  # configurations at which inertias are compared
LEAST_MASS = 1e-9  # [kg] and [kg m²] of a body between two joints that has no mass, which MuJoCo does not take
NEEDED = "--plant mujoco"


def mujoco_xml(setup: Setup) -> str:
    """Return the MJCF of a scene's robot with its loads, where the scene puts it; joints by their names.

    Raises InputError for a robot without masses, or of which joints follow others, and for loads as `loads.carrying`.
    """
    robot, scene = setup.robot, setup.scene
    if robot.linkage is not None:
        raise InputError(
            f"{NEEDED}: {robot.linkage.rule(robot.followers[0])}, and here each joint has a drive of its own"
        )
    with naming(scene.source):
        model = carrying(robot, scene.payload, scene.attached, NEEDED)
    inert, most = _inertias(model, robot), _forces(setup)
    root = xml.Element("mujoco", model=robot.name)
    xml.SubElement(
        root, "compiler", angle="radian", boundmass=f"{LEAST_MASS}", boundinertia=f"{LEAST_MASS}", balanceinertia="true"
    )
    xml.SubElement(
        root, "option", timestep=f"{LONGEST_STEP}", integrator="implicitfast", gravity=_words(model.gravity.linear)
    )
    bodies = {0: xml.SubElement(root, "worldbody")}
    drives = xml.SubElement(root, "actuator")
    for i, name in enumerate(robot.joint_names, 1):
        place = pin.SE3ToXYZQUAT(model.jointPlacements[i])
        body = bodies[i] = xml.SubElement(
            bodies[model.parents[i]],
            "body",
            name=name,
            pos=_words(place[:3]),
            quat=_words(place[[6, 3, 4, 5]]),
            gravcomp="1",
        )
        linear, angular = motion_axes(model.joints[i])
        turns = bool(np.any(angular))
        joint = {"name": name, "type": "hinge" if turns else "slide", "axis": _words(angular if turns else linear)}
        if np.isfinite(most[i - 1]):
            joint |= {"actuatorfrcrange": _words((-most[i - 1], most[i - 1]))}
        xml.SubElement(body, "joint", joint, actuatorgravcomp="true")
        own = model.inertias[i]
        if own.mass > LEAST_MASS:
            about = own.inertia
            values = (about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2])
            xml.SubElement(body, "inertial", mass=repr(own.mass), pos=_words(own.lever), fullinertia=_words(values))
        else:
            xml.SubElement(body, "inertial", mass=f"{LEAST_MASS}", pos="0 0 0", diaginertia=_words(3 * (LEAST_MASS,)))
        stiffness, damping = FREQUENCY**2 * inert[i - 1], 2 * FREQUENCY * inert[i - 1]
        xml.SubElement(drives, "position", name=name, joint=name, kp=repr(float(stiffness)))
        xml.SubElement(drives, "velocity", name=f"{name} speed", joint=name, kv=repr(float(damping)))
    return xml.tostring(root, encoding="unicode")


def _inertias(model: pin.Model, robot: Robot) -> Array:
    """Return the greatest inertia (n,) about each joint [kg m²] or [kg], at seeded configurations."""
    data, found = model.createData(), np.zeros(robot.n)
    for q in robot.draw(np.random.default_rng(SEED), SAMPLES):
        found = np.maximum(found, np.diag(pin.crba(model, data, robot.pin_q(q))))
    return found


def _forces(setup: Setup) -> Array:
    """Return the most (n,) that each drive gives [Nm] or [N]: the scene's limit, or what the robot's description says;
    inf where neither does."""
    if (limit := setup.limits.get("torque")) is not None:
        return limit
    own = np.abs(np.asarray(setup.robot.model.effortLimit, dtype=np.float64))
    return np.where((own > 0.0) & (own < 1e9), own, np.inf)


def _words(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)
