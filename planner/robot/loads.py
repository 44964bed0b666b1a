"""The loads of a robot: a scene's payload and held objects, added to the inertia of the joints that carry them.

Scene, Robot -> a copy of the robot's pin.Model; the robot's own is not changed.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.scene import Scene

MASS_ROUNDING = 1e-6  # [–] and [kg] by which sums of masses may differ: rounding


def loaded_model(scene: Scene, robot: Robot) -> pin.Model:
    """Return the robot's model with the masses that the scene puts on its links; a copy.

    Gravity is the world's, along −z, whatever the orientation of the base.

    Raises:
        InputError: for a link that the robot does not have; an inertia that no body can have; a mass for a mesh that
            is not closed, as it has no volume over which to distribute it; a joint that moves no mass; a robot with
            joints that follow others.
    """
    with naming(scene.source):
        torque = scene.limits.torque is not None or scene.objective != "energy"
        needed = "limits.torque" if torque else "planner.objective: 'energy' (time and smoothness need no masses)"
        return with_loads(robot, scene.payload, scene.attached, needed)


def with_loads(
    robot: Robot, payload: Payload | None, attached: tuple[Attached, ...], needed: str = "limits.torque"
) -> pin.Model:
    """Return the model with a payload and held objects whose files were read; errors do not name the scene's file, but
    the reason `needed` why masses are required."""
    if robot.linkage is not None:
        raise InputError(f"{needed}: {robot.linkage.no_torques}")
    return carrying(robot, payload, attached, needed)


def carrying(robot: Robot, payload: Payload | None, attached: tuple[Attached, ...], needed: str) -> pin.Model:
    """Return the same, also of a robot with joints that follow others: all of its joints then have torques of their
    own, of which only sums are known."""
    if robot.impossible:
        raise InputError(
            f"{needed}: no body has the inertia of link '{robot.impossible[0]}' of {robot.name}: a principal moment is "
            "negative or greater than the sum of the others, or there is no mass"
        )
    model = robot.model.copy()
    if payload is not None:
        _add(model, "payload", payload.link, _inertia_of_payload(payload), robot.name)
    for held in attached:
        if held.mass is not None:
            _add(model, f"attached.{held.name}", held.link, _inertia_of_held(held, held.mass), robot.name)
    upper = np.triu(pin.crba(model, model.createData(), pin.neutral(model)))
    whole = upper + np.triu(upper, 1).T
    inert = np.diag(whole if robot.linkage is None else robot.linkage.fold_blocks(whole))
    if (inert <= 0).any():
        joint = robot.joint_names[int(np.argmin(inert))]
        raise InputError(f"{needed}: joint '{joint}' of {robot.name} moves no mass: its URDF gives no inertia")
    return model


def loads_in(model: pin.Model, scene: Scene, robot: Robot) -> tuple[str, ...]:
    """Return the fields of the scene's masses if a model carries all of them beside its robot's own, else none."""
    masses = {f"attached.{each.name}.mass": each.mass for each in scene.attached if each.mass is not None}
    if scene.payload is not None:
        masses["payload"] = scene.payload.mass
    more = _whole_mass(model) - _whole_mass(robot.model)
    return (
        tuple(masses)
        if math.isclose(more, math.fsum(masses.values()), rel_tol=MASS_ROUNDING, abs_tol=MASS_ROUNDING)
        else ()
    )


def moved_mass(model: pin.Model) -> float:
    """Return the mass that the joints carry [kg]."""
    return float(sum(body.mass for body in itertools.islice(model.inertias, 1, None)))


def _whole_mass(model: pin.Model) -> float:
    """Return the mass of a model [kg], with what stands still."""
    return math.fsum(body.mass for body in model.inertias)


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
    """Return the inertia of a body of uniform density and a mass [kg], in its link's frame."""
    inertia = operations(held.shape).inertia(held.shape, mass, f"attached.{held.name}")
    return pin.SE3(held.pose.matrix).act(inertia)
