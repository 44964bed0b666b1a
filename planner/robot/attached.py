"""Held objects: a robot with the objects that the scene attaches to it, each one more body carried by its link.

Robot, `Attached`s -> a `Robot` whose collision geometry, links and self pairs include the objects; outer bodies, pieces
of the certificate and pairs follow from those, as they do for links. Its model has a frame for each, so that goals and
constraints may be about an object as they are about a link.
"""

from __future__ import annotations

from dataclasses import replace

import pinocchio as pin

from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.robot.link_frame import HELD
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.self_pairs import MOVE_AS_ONE
from hdplan.scenes.attached import Attached
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.robot_files.link_pairs import link_pair


def with_attached(robot: Robot, attached: tuple[Attached, ...]) -> Robot:
    """Return the robot holding the objects; itself if there are none.

    An object is kept apart from every link and object that moves relative to it, except for its `touch_links`.

    Raises:
        InputError: for a link that the robot does not have, a name that a link has, a mesh that cannot be used.
    """
    if not attached:
        return robot
    links = [str(frame.name) for frame in robot.model.frames if frame.type == pin.FrameType.BODY]
    known = {*links, *(held.name for held in attached)}
    for held in attached:
        where = f"attached.{held.name}"
        if held.name in links:
            raise InputError(f"{where}: the name '{held.name}' is taken by a link of {robot.name}; names must differ")
        if held.link not in links:
            raise InputError(f"{where}.link: unknown link '{held.link}'{nearest(held.link, links)}")
        for link in held.touch_links:
            if link not in known:
                raise InputError(f"{where}.touch_links: unknown link '{link}'{nearest(link, known)}")

    model, collision = robot.model.copy(), robot.collision.copy()
    link_joint, link_geometry = dict(robot.link_joint), dict(robot.link_geometry)
    for held in attached:
        index = robot.model.getFrameId(held.link, pin.FrameType.BODY)
        frame = robot.model.frames[index]
        placement = frame.placement * pin.SE3(held.pose.matrix)
        model.addFrame(pin.Frame(held.name, frame.parentJoint, index, placement, HELD), False)
        shape = operations(held.shape).coal(held.shape, f"attached.{held.name}")
        item = pin.GeometryObject(held.name, frame.parentJoint, index, placement, shape)
        link_geometry[held.name] = (int(collision.addGeometryObject(item)),)
        link_joint[held.name] = int(frame.parentJoint)
    pairs = dict.fromkeys(
        link_pair(held.name, other) for held in attached for other in link_joint if other != held.name
    )
    unchecked = {link_pair(held.name, link): "touch_links" for held in attached for link in held.touch_links}
    unchecked |= {(a, b): MOVE_AS_ONE for a, b in pairs if link_joint[a] == link_joint[b]}
    return replace(
        robot,
        model=model,
        collision=collision,
        links=tuple(link_geometry),
        link_joint=link_joint,
        link_geometry=link_geometry,
        self_pairs=(*robot.self_pairs, *(pair for pair in pairs if pair not in unchecked)),
        unchecked={**robot.unchecked, **unchecked},
        attached=attached,
    )
