"""The changes that a stage of a job leaves behind: the arm and the fingers elsewhere, an object gripped or released."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.job.places import link_pose, pose_of
from hdplan.planner.job.stage_scenes import stage_source
from hdplan.planner.job.world import World, shape_of
from hdplan.planner.robot.link_frame import end_effector, links_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import InputError, MisplacedError, naming, nearest
from hdplan.scenes.job import Grip, Move, Release, Set, Wait
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.scene import derived

GRIP_REACH = 5e-3  # [m] greatest distance between a gripper and an object that it takes


def after(world: World, number: int, robot: Robot, q: Array) -> World:
    """Return the world after a stage whose motion ends at joint values q (n,) of its own scene's robot. Raises
    InputError for an object that is out of reach, and for fingers that carry what another hand holds, too."""
    stage = world.job.stages[number]
    match stage:
        case Move() | Curve():
            arm = tuple(zip((joint for joint, _ in world.arm), q.tolist(), strict=True))
            return replace(world, arm=arm, rates=None, corner=None)
        case Set() | Wait():
            return world
        case Grip() | Release():
            with naming(stage_source(world.scene, number)):
                there = _with_hand(world, robot, q) if stage.joints else world
                if stage.object is None:
                    return there
                if isinstance(stage, Grip):
                    return _taken(there, stage, stage.object)
            return _let_go(there, stage.object)
        case _:
            assert_never(stage)


def _with_hand(world: World, robot: Robot, q: Array) -> World:
    links, frames = links_of(robot), robot.model.frames
    for other in world.taken:
        for link in (world.holding(other.name).link, other.link):
            if frames[links[link]].parentJoint != 0:
                raise InputError(f"joints: '{other.name}' is held by two hands, and '{link}' moves with these fingers")
    moved = dict(zip(robot.unfolded.joint_names, robot.expand(q).tolist(), strict=True))
    return replace(world, hand=tuple({**dict(world.hand), **moved}.items()))


def _taken(world: World, stage: Grip, name: str) -> World:
    """Take hold of an object where it is: where it stands, or in another hand."""
    robot, first = world.robot, next((each for each in world.held if each.name == name), None)
    there = pose_of(world.place(name)) if first else world.standing(name).pose
    links, frames = links_of(robot), robot.model.frames
    link = end_effector(robot, "grip") if stage.link is None else stage.link
    if link not in links:
        raise InputError(f"grip.link: unknown link '{link}'{nearest(link, links)}")
    touching = [other for pair in stage.touch if name in pair for other in pair if other in links]
    for other in touching:
        if frames[links[other]].parentJoint != frames[links[link]].parentJoint:
            raise InputError(
                f"grip.link: '{link}' is to carry '{name}', but '{other}', which holds it (`touch`), moves "
                "relative to that link when the arm moves"
            )
    shape = first.shape if first else shape_of(world.standing(name))
    _check_reach(world, Obstacle(name, shape, there), touching or [link])
    pose = pose_of(np.linalg.inv(link_pose(robot, world.q, link)) @ there.matrix)
    held = Attached(name, link, shape, pose, tuple(dict.fromkeys(touching)), stage.mass)
    if first is None:
        obstacles = tuple(each for each in world.obstacles if each.name != name)
        return replace(world, obstacles=obstacles, held=(*world.held, held))
    if frames[links[first.link]].parentJoint == frames[links[link]].parentJoint:
        raise InputError(f"grip.object: '{name}' is held already, by '{first.link}', which moves with '{link}'")
    both = replace(first, touch_links=tuple(dict.fromkeys((*first.touch_links, *held.touch_links))))
    taken = held if stage.mass is not None else replace(held, mass=first.mass)
    return replace(
        world, held=tuple(both if each is first else each for each in world.held), taken=(*world.taken, taken)
    )


def _check_reach(world: World, thing: Obstacle, holding: list[str]) -> None:
    """Refuse a grip of an object in which one of the holding links is not close to the object."""
    bare = replace(world.scene.robot, locked={**world.scene.robot.locked, **dict(world.hand)})
    alone = {"job": None, "payload": None, "attached": (), "limits": Limits(), "timing": None, "obstacles": (thing,)}
    scene = derived(world.scene, robot=bare, start=world.start, goal=world.start, **alone)
    near = {place.link for place, _ in Certifier(Setup.of(scene)).too_close(world.q, GRIP_REACH)}
    if far := [link for link in holding if link not in near]:
        raise MisplacedError(
            f"grip.object: '{thing.name}' is out of reach: {', '.join(far)} {'is' if len(far) == 1 else 'are'} "
            f"not within {GRIP_REACH * 1e3:g} mm of it when the fingers have closed (what is to hold it stands under "
            "`touch`, or else it is the link)"
        )


def _let_go(world: World, name: str) -> World:
    """Leave a held object where it is: to the hand that has taken hold of it too, or where it then stands."""
    held = world.holding(name)
    if (other := next((each for each in world.taken if each.name == name), None)) is not None:
        there = tuple(other if each is held else each for each in world.held)
        return replace(world, held=there, taken=tuple(each for each in world.taken if each is not other))
    before = next((each for each in world.scene.obstacles if each.name == name), None)
    pose = pose_of(world.place(name))
    left = Obstacle(name, held.shape, pose) if before is None else replace(before, pose=pose)
    others = tuple(  # it is no held object any more that they may touch
        replace(each, touch_links=tuple(link for link in each.touch_links if link != name))
        for each in world.held
        if each is not held
    )
    return replace(world, obstacles=(*world.obstacles, left), held=others)
