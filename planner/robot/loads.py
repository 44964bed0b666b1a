"""What a robot carries, as masses: a scene's payload and its held objects added to the inertia of the joints that bear
them.

Scene, Robot -> a copy of the robot's pin.Model; the robot's own is left as it is. Robot side: neither planner nor
certificate is named.
"""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.shapes import operations
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.scene import Scene


def loaded_model(scene: Scene, robot: Robot) -> pin.Model:
    """Return the robot's model with the masses that the scene puts on its links; a copy.

    Gravity stays the world's, along −z, whichever way the base is turned.

    Raises:
        InputError: a link that the robot does not have; an inertia that no body has; a mass for a mesh that is not
            closed, so that it has no volume to spread it over; a joint of a URDF without masses.
    """
    with naming(scene.source):
        return with_loads(robot, scene.payload, scene.attached)


def with_loads(robot: Robot, payload: Payload | None, attached: tuple[Attached, ...]) -> pin.Model:
    """Return the same of a scene's payload and held objects; errors do not name its file."""
    model = robot.model.copy()
    if payload is not None:
        _add(model, "payload", payload.link, _inertia_of_payload(payload), robot.name)
    for held in attached:
        if held.mass is not None:
            _add(model, f"attached.{held.name}", held.link, _inertia_of_held(held, held.mass), robot.name)
    inert = np.diag(pin.crba(model, model.createData(), pin.neutral(model)))
    if (inert <= 0).any():
        joint = robot.joint_names[int(np.argmin(inert))]
        raise InputError(f"limits.torque: joint '{joint}' of {robot.name} moves no mass: its URDF gives no inertia")
    return model


def moved_mass(model: pin.Model) -> float:
    """Return the mass that the joints carry [kg]."""
    return float(sum(body.mass for body in itertools.islice(model.inertias, 1, None)))


def _add(model: pin.Model, field: str, link: str, inertia: pin.Inertia, name: str) -> None:
    """Add an inertia, given in the link's frame, to the joint that carries the link."""
    links = [str(frame.name) for frame in model.frames if frame.type == pin.FrameType.BODY]
    if link not in links:
        raise InputError(f"{field}.link: {name} has no link '{link}'{nearest(link, links)}")
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)


def _inertia_of_payload(payload: Payload) -> pin.Inertia:
    xx, xy, xz, yy, yz, zz = payload.inertia
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return pin.Inertia(payload.mass, np.array(payload.com), about)


def _inertia_of_held(held: Attached, mass: float) -> pin.Inertia:
    """Return the inertia of a body of even density and a mass [kg], in its link's frame."""
    inertia = operations(held.shape).inertia(held.shape, mass, f"attached.{held.name}")
    return pin.SE3(held.pose.matrix).act(inertia)
