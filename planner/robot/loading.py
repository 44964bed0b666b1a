"""Loading of a robot: what is planned, follows and is held, what is compared, and the notes on all of this."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from hdplan.planner.robot.lasting_contacts import lasting_contacts
from hdplan.planner.robot.linkage import Linkage, room_of, rules_of
from hdplan.planner.robot.pin_model import move_base, read_model, without_joints
from hdplan.planner.robot.planned_joints import planned_joints, range_of
from hdplan.planner.robot.robot import SAME_PLACE, Robot
from hdplan.planner.robot.self_pairs import (
    ALWAYS_TOUCHING,
    CONTACT_SAMPLES,
    LIMIT_EXCESS,
    NEVER_TOUCHING,
    excluded,
    never_in_contact,
)
from hdplan.scenes.errors import InputError, listed, nearest
from hdplan.scenes.files import stamps_of
from hdplan.scenes.robot_files.description import Semantics, Tree, read_words
from hdplan.scenes.robot_files.library import description_of, source_of
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.robot_files.urdf_text import BASE_JOINTS
from hdplan.scenes.robot_spec import RobotSpec, robot_spec
from hdplan.scenes.values import checked


def load_robot(robot: str | RobotSpec) -> Robot:
    """Load a robot: one of example-robot-data by its name, or that of a RobotSpec, such as a URDF (and SRDF) file.

    The planned joints are those of the SRDF group that the specification names; without one, those of the SRDF's arm
    group, or else all joints except those of a hand. Mimic joints, and those that the SRDF calls passive, are never
    planned: mimic joints move with the joint that they follow, where that is planned.
    All other joints are held: at the scene's value (at most LIMIT_EXCESS beyond the limits), or else at the value of
    the first named state that has one, or else at 0, or as near to it as their limits allow.

    Raises:
        InputError: unknown robot, group, joint or link; a file that cannot be read; a joint with several coordinates.
    """
    spec: RobotSpec = checked(robot_spec, robot, "robot")
    name, urdf, srdf, _ = description_of(spec)
    source = source_of(spec)
    files = stamps_of((urdf,) if srdf is None else (urdf, srdf))
    tree, semantics = read_words(source, srdf)
    files += stamps_of(tree.files[1:])  # known only now
    full, geometry, meshes = read_model(source)
    if len(geometry.geometryObjects) != tree.collisions:  # what is left out would be proven free
        read = len(geometry.geometryObjects)
        raise InputError(f"robot.urdf: {urdf}: only {read} of {tree.collisions} collision geometries could be read")

    ranges = _ranges(full, spec, name)
    planned, group, notes = planned_joints(full, ranges, spec, tree, semantics, name)
    if spec.base_joints is not None:
        planned += [joint for joint in BASE_JOINTS if joint not in (*planned, *spec.locked)]
    rules = {
        joint: rule for joint, rule in rules_of(tree, list(ranges)).items() if rule.leader in planned and rule.factor
    }
    for joint in spec.locked:
        if joint in rules:
            raise InputError(
                f"robot.locked: joint '{joint}' follows '{rules[joint].leader}', which is planned: hold that one"
            )
    resting = [joint for joint in ranges if joint not in (*planned, *rules)]
    held = {joint: _held_at(joint, full, spec, tree, semantics) for joint in resting}
    notes += [*tree.notes, *semantics.notes]
    if not geometry.geometryObjects:
        notes.append(f"no link of {name} has collision geometry, so it cannot touch anything")
    notes += _held_notes(held, tree, spec, name)

    apart = never_in_contact(full, geometry, held) if srdf is None else ()
    model, collision = without_joints(full, geometry, held)
    move_base(model, collision, pin.SE3(spec.base.matrix))

    link_geometry: dict[str, tuple[int, ...]] = {}
    link_joint: dict[str, int] = {}
    for index, item in enumerate(collision.geometryObjects):
        link = str(model.frames[item.parentFrame].name)
        link_geometry[link] = (*link_geometry.get(link, ()), index)
        link_joint[link] = int(item.parentJoint)
    names, linkage = tuple(str(joint) for joint in model.names)[1:], None
    lower, upper = np.array([ranges[joint] for joint in names]).reshape(-1, 2).T
    if rules:
        linkage = Linkage.of(names, rules)
        names = tuple(names[i] for i in linkage.own.tolist())
        notes += [f"joints that move with others: {', '.join(map(linkage.rule, linkage.followers))}"]
        within = np.array([room_of(joint, rules, ranges) for joint in names])
        for i in np.flatnonzero((within != np.stack([lower, upper], axis=1)[linkage.own]).any(axis=1)).tolist():
            low, high = within[i].tolist()
            notes.append(f"joint '{names[i]}': limits narrowed to [{low:g}, {high:g}] by those of its followers")
        lower, upper = within.T
    loaded = Robot(
        name=name,
        model=model,
        collision=collision,
        joint_names=names,
        lower=lower,
        upper=upper,
        inner=np.stack([lower, upper]),
        locked=held,
        links=tuple(link_geometry),
        link_joint=link_joint,
        link_geometry=link_geometry,
        self_pairs=(),
        named_states=semantics.named_states(group),
        semantics=semantics,
        notes=tuple(notes),
        files=(*files, *meshes),
        base=spec.base,
        impossible=_moved(tree.impossible, model),
        linkage=linkage,
    )
    return _with_pairs(loaded, apart, tree, semantics, spec)


def _ranges(full: pin.Model, spec: RobotSpec, name: str) -> dict[str, tuple[float, float]]:
    """Return each joint's limits; raise an error for joints of several coordinates and impossible locked ones."""
    joints = [str(joint) for joint in full.names][1:]
    for joint in spec.locked:
        if joint not in joints:
            raise InputError(f"robot.locked: unknown joint '{joint}'{nearest(joint, joints)}")
    for joint, kind in zip(joints, itertools.islice(full.joints, 1, None), strict=True):
        if kind.nv != 1:
            raise InputError(
                f"robot: joint '{joint}' of {name} has {kind.nv} coordinates ({kind.shortname()}); "
                "only joints with one coordinate can be planned"
            )
    ranges = {joint: range_of(full, joint) for joint in joints}
    for joint, value in spec.locked.items():
        low, high = ranges[joint]
        if not low - LIMIT_EXCESS <= value <= high + LIMIT_EXCESS:
            raise InputError(
                f"robot.locked or start: joint '{joint}' is to be held at {value:g}, more than {LIMIT_EXCESS:g} beyond "
                f"its limits [{low:g}, {high:g}]"
            )
    return ranges


def _held_notes(held: Mapping[str, float], tree: Tree, spec: RobotSpec, name: str) -> Iterator[str]:
    """Yield what a user may not expect of the joints that are held."""
    if lost := [joint for joint, (followed, _, _) in tree.mimics.items() if followed not in tree.joints]:
        yield f"joints that mimic one that {name} does not have, held: {listed(lost)}"
    for joint, (followed, factor, offset) in tree.mimics.items():
        should = factor * held.get(followed, 0.0) + offset
        if joint in held and joint not in lost and abs(held[joint] - should) > SAME_PLACE:
            yield f"joint '{joint}' is held at {held[joint]:g}; following '{followed}' it would be at {should:g}"
    by_default = [f"{joint} at {value:g}" for joint, value in held.items() if joint not in spec.locked]
    if by_default:
        yield f"joints held: {listed(by_default)}"


def _with_pairs(robot: Robot, apart: Iterable[LinkPair], tree: Tree, semantics: Semantics, spec: RobotSpec) -> Robot:
    """Return the robot with the link pairs that are compared and, each with its reason, those that are not."""
    notes = [*robot.notes]
    unchecked = dict.fromkeys(apart, NEVER_TOUCHING) | excluded(robot, tree, semantics, spec)
    every = [link_pair(a, b) for a, b in itertools.combinations(robot.links, 2)]
    checked = {link_pair(a, b) for a, b in spec.check_pairs}
    touching, proven = lasting_contacts(
        robot, [pair for pair in every if pair not in unchecked and pair not in checked]
    )
    unchecked |= dict.fromkeys(proven, ALWAYS_TOUCHING)
    if never := list(unchecked.values()).count(NEVER_TOUCHING):
        notes.append(f"without an SRDF: link pairs that are proven never to touch, not checked: {never}")
    if always := [pair for pair in touching if pair in unchecked]:
        notes.append(f"link pairs that are proven always to touch, not checked: {_words(always)}")
    if doubtful := tuple(pair for pair in touching if pair not in unchecked):
        notes.append(
            f"link pairs in contact at each of {CONTACT_SAMPLES} sampled configurations, which is not a proof, so they "
            f"are checked: {_words(doubtful)}; name them in robot.ignore_pairs, or an SRDF, if they may touch"
        )
    pairs = tuple(pair for pair in every if pair not in unchecked)
    return replace(robot, self_pairs=pairs, unchecked=unchecked, doubtful=doubtful, notes=tuple(notes))


def _words(pairs: Iterable[LinkPair]) -> str:
    return ", ".join(f"{a}-{b}" for a, b in pairs)


def _moved(links: tuple[str, ...], model: pin.Model) -> tuple[str, ...]:
    """Return the links that a joint of the model moves."""
    carried = {str(frame.name) for frame in model.frames if frame.type == pin.FrameType.BODY and frame.parentJoint}
    return tuple(link for link in links if link in carried)


def _held_at(joint: str, model: pin.Model, spec: RobotSpec, tree: Tree, semantics: Semantics) -> float:
    """Return the value of a joint that is not planned."""
    if joint in spec.locked:
        return float(spec.locked[joint])
    if joint in tree.mimics and tree.mimics[joint][0] in tree.joints:
        followed, factor, offset = tree.mimics[joint]
        at = _held_at(followed, model, spec, tree, semantics) if followed in model.names else 0.0  # a fixed joint
        return factor * at + offset
    states = semantics.named_states(None).values()
    value = next((state[joint] for state in states if joint in state), 0.0)
    index = model.getJointId(joint)
    if model.joints[index].nq != 1:
        return value
    at = model.joints[index].idx_q
    return float(np.clip(value, model.lowerPositionLimit[at], model.upperPositionLimit[at]))
