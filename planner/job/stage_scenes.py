"""The scene of a single motion, for a stage of a job in the world before it.

It is one like any other: it is planned, certified, proven and drawn as such. The arm starts where the last stage ended.
What is held is `attached`, what was released is an obstacle where it was released. Fingers that are not moved are held.
An obstacle that something may touch is `attached` to a link that stands fast in the world, with these as its
`touch_links`: it is kept out of contact with everything else, without planner.clearance.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, assert_never

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.job.curves import along_curve
from hdplan.planner.job.places import fixed_link, pose_of
from hdplan.planner.job.world import World, shape_of
from hdplan.planner.robot.link_frame import links_of
from hdplan.planner.robot.linkage import rules_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.attached import Attached
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.job import Grip, Move, Release, Set, Stage, Wait, stage_name
from hdplan.scenes.limits import QUANTITIES, Limits
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.robot_files.description import read_words
from hdplan.scenes.robot_files.library import description_of, source_of
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.timing import Timing


def stage_scene(world: World, number: int) -> Scene:
    """Return the scene of the motion of a stage. Raises InputError, naming the stage, for names that there are not,
    and for what cannot be done from here."""
    stage = world.job.stages[number]
    with naming(stage_source(world.scene, number)):
        match stage:
            case Move() | Curve() if world.taken:
                (held,) = (each for each in world.held if each.name == world.taken[0].name)
                raise InputError(
                    f"'{held.name}' is held by '{held.link}' and '{world.taken[0].link}': one has to let go "
                    "(`release`) before an arm moves"
                )
            case Move():
                return _of_arm(world, number, stage, goal=stage.goal, path=stage.path)
            case Curve():
                return _of_arm(world, number, stage, **along_curve(world, number))
            case Grip() | Release() if stage.joints:
                return _of_hand(world, number, stage)
            case Grip() | Release():
                _check_object(world, stage)
                return _of_arm(world, number, stage, goal=world.start)
            case Set() | Wait():
                return _of_arm(world, number, stage, goal=world.start)
            case _:
                assert_never(stage)


def stage_setup(world: World, number: int) -> Setup:
    """Return the scene of a stage with its robot, made once. Raises InputError as `stage_scene`."""
    if number not in world.setups:
        world.setups[number] = Setup.of(stage_scene(world, number))
    return world.setups[number]


def stage_certifier(world: World, number: int) -> Certifier:
    """Return the certifier of a stage's scene, made once. Raises InputError as `stage_scene`."""
    if number not in world.certifiers:
        world.certifiers[number] = Certifier(stage_setup(world, number))
    return world.certifiers[number]


def standing_scene(world: World, number: int) -> Scene:
    """Return the scene in which the arm stands still when a stage of the fingers begins: theirs compares nothing
    that does not move with them."""
    stage = replace(world.job.stages[number], limits=None)
    with naming(stage_source(world.scene, number)):
        scene = _of_arm(world, number, stage, goal=world.start)
    return derived(scene, limits=Limits(position=scene.limits.position), payload=None, timing=None)


def _of_arm(world: World, number: int, stage: Stage, **fields: Any) -> Scene:
    """Return a scene in which the arm moves and the hand is held."""
    spec = world.scene.robot
    robot = replace(spec, locked={**spec.locked, **dict(world.hand)})
    limits = world.scene.limits if stage.limits is None else stage.limits
    return _made(world, number, stage, {"robot": robot, "start": world.start, "limits": limits, **fields})


def _of_hand(world: World, number: int, stage: Grip | Release) -> Scene:
    """Return a scene in which the hand moves and the arm is held."""
    spec, robot, leaders = world.scene.robot, world.robot, leaders_of(world.scene.robot)
    for joint in stage.joints:
        if joint in robot.joint_names:
            raise InputError(f"joints: '{joint}' is one of the arm's, which stands still while fingers move")
        if joint not in robot.locked:
            raise InputError(f"joints: unknown joint '{joint}'{nearest(joint, robot.locked)}")
        if leaders.get(joint, joint) not in stage.joints:
            raise InputError(f"joints: '{joint}' follows '{leaders[joint]}': name that one")
    _check_object(world, stage)
    group = tuple(joint for joint in stage.joints if joint not in leaders)
    fixed = {**spec.locked, **dict(world.hand), **dict(world.arm)}
    locked = {joint: at for joint, at in fixed.items() if leaders.get(joint, joint) not in group}
    fields: dict[str, Any] = {
        "robot": replace(spec, group=group, locked=locked),
        "start": JointTarget("start", by_name={joint: robot.locked[joint] for joint in group}),
        "goal": JointTarget("goal", by_name=stage.joints),
        "limits": _of_fingers(world.scene.limits) if stage.limits is None else stage.limits,
    }
    return _made(world, number, stage, fields)


def _made(world: World, number: int, stage: Stage, fields: dict[str, Any]) -> Scene:
    """Return the scene with these fields, with what is held, and with what may touch."""
    scene, timing = world.scene, world.scene.timing or Timing()
    obstacles, attached = _touching(world, stage)
    limits = fields["limits"]
    if limits.acceleration is None:  # without it no proof says that a stage begins and ends at rest
        raise InputError("limits.acceleration: is missing in the stage's own limits")
    fields |= {"job": None, "name": f"{scene.name} {number} {stage_name(stage, number)}", "obstacles": obstacles}
    fields |= {"attached": attached, "payload": scene.payload if limits.torque is not None else None}
    found = derived(scene, timing=Timing(scale=timing.scale * stage.speed, rate=timing.rate), **fields)
    object.__setattr__(found, "source", Path(stage_source(scene, number)))
    return found


def _touching(world: World, stage: Stage) -> tuple[tuple[Obstacle, ...], tuple[Attached, ...]]:
    """Return obstacles and held objects as they are in a stage, in which some pairs may touch."""
    if not stage.touch:
        return world.obstacles, world.held
    robot = world.robot
    links, held = set(links_of(robot)), {each.name: each for each in world.held}
    standing = {each.name: each for each in world.obstacles}
    # a held object or an obstacle -> what it may touch, of what moves with the robot
    may: dict[str, list[str]] = {}
    for pair in stage.touch:
        for name in pair:
            if name not in links and name not in world.things:
                raise InputError(f"touch: unknown body '{name}'{nearest(name, [*world.things, *links])}")
        one, other = sorted(pair, key=lambda name: (name in standing, name in held), reverse=True)
        if one in links:
            raise InputError(f"touch: '{one}' and '{other}' are links both; robot.ignore_pairs names such pairs")
        if other not in standing:  # two obstacles are not compared
            may.setdefault(one, []).append(other)
    root, fixed = fixed_link(robot)
    attached = [
        replace(each, touch_links=tuple(dict.fromkeys((*each.touch_links, *may.get(each.name, ())))))
        for each in world.held
    ]
    for name in [name for name in may if name in standing]:
        obstacle = world.standing(name)
        if obstacle.clearance is not None:
            raise InputError(f"touch: '{name}' has a clearance of its own, which nothing may fall below")
        pose = pose_of(np.linalg.inv(fixed) @ obstacle.pose.matrix)
        attached.append(Attached(name, root, shape_of(obstacle), pose, may[name]))
    return tuple(each for each in world.obstacles if each.name not in may), tuple(attached)


def _check_object(world: World, stage: Grip | Release) -> None:
    """Refuse to grip a missing object, and to release an object that is not held."""
    if stage.object is not None and isinstance(stage, Release):
        world.holding(stage.object)
    elif stage.object is not None and stage.object not in {each.name for each in world.held}:
        world.standing(stage.object)
    elif stage.object in {each.name for each in world.taken}:
        raise InputError(f"grip.object: '{stage.object}' is held by two hands already")


def moves_fingers(stage: Stage) -> bool:
    """True if the fingers move in a stage, while the arm stands still."""
    return isinstance(stage, Grip | Release) and bool(stage.joints)


def stage_source(scene: Scene, number: int) -> str:
    """Return the source of a stage, for error messages: "jobs.yaml: job[2] (descend)"."""
    assert scene.job is not None
    return f"{scene.source}: job[{number}] ({scene.job.names[number]})"


def leaders_of(spec: RobotSpec) -> dict[str, str]:
    """Return the joints of a robot that follow another one, and which."""
    _, _, srdf, _ = description_of(spec)
    tree, _ = read_words(source_of(spec), srdf)
    rules = rules_of(tree, list(tree.joints))
    return {joint: rules[joint].leader if joint in rules else tree.mimics[joint][0] for joint in tree.mimics}


def _of_fingers(limits: Limits) -> Limits:
    """Return the arm's limits that apply to fingers: single values for all joints. Raises InputError for accelerations
    and jerks that are not."""
    given = {name: getattr(limits, name) for name in QUANTITIES if name != "torque"}
    kept: dict[str, Any] = {name: value for name, value in given.items() if isinstance(value, float | str)}
    for name in ("acceleration", "jerk"):  # velocities are the URDF's then
        if given[name] is not None and name not in kept:
            raise InputError(f"limits: the scene's {name} is by joints of the arm: give the fingers' in this stage")
    return Limits(**kept)
