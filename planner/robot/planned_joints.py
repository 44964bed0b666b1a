"""The joints of a robot that are planned: those that `robot.group` names, or else the arm's."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from hdplan.planner.robot.linkage import room_of, rules_of
from hdplan.scenes.errors import InputError, listed, naming, nearest
from hdplan.scenes.robot_files.description import Semantics, Tree
from hdplan.scenes.robot_files.mjcf import UNLIMITED
from hdplan.scenes.robot_spec import RobotSpec

GRIPPER = re.compile("finger|gripper|knuckle|thumb", re.IGNORECASE)  # joints of a hand: held
ARM_GROUP = re.compile(r"(^|_)arm$|^manipulator$")  # the SRDF group that is planned, where several are given


def range_of(model: pin.Model, joint: str) -> tuple[float, float]:
    """Return a joint's limits [rad or m]; infinite where it has none."""
    kind = model.joints[model.getJointId(joint)]
    if kind.nq != 1:
        return -np.inf, np.inf
    low, high = float(model.lowerPositionLimit[kind.idx_q]), float(model.upperPositionLimit[kind.idx_q])
    return low if low > -UNLIMITED else -np.inf, high if high < UNLIMITED else np.inf


def with_range(ranges: Mapping[str, tuple[float, float]], tree: Tree) -> list[str]:
    """Return the joints that follow no other one, and to which the limits of those that follow them leave a range."""
    rules = rules_of(tree, list(ranges))
    followed = {rule.leader for rule in rules.values()}
    rooms = {joint: room_of(joint, rules, ranges) for joint in ranges if joint not in tree.mimics}
    return [joint for joint, (low, high) in rooms.items() if low < high or joint not in followed]


def planned_joints(
    model: pin.Model,
    ranges: Mapping[str, tuple[float, float]],
    spec: RobotSpec,
    tree: Tree,
    semantics: Semantics,
    name: str,
) -> tuple[list[str], str | None, list[str]]:
    """Return the joints to plan, the SRDF's group that they are of, if any, and notes where a group chose them or could
    not. `ranges` holds the limits of every joint of the whole `model`, in its order."""
    joints = list(ranges)
    rules = rules_of(tree, joints)
    leader = {joint: rules[joint].leader if joint in rules else tree.mimics[joint][0] for joint in tree.mimics}
    followers = {joint: [each for each in leader if leader[each] == joint] for joint in joints}  # fixed ones, too
    candidates = [joint for joint in with_range(ranges, tree) if joint not in semantics.passive]
    if isinstance(spec.group, tuple):
        _check_list(spec.group, joints, candidates, spec, tree, semantics)
        return [joint for joint in joints if joint in spec.group], None, []
    groups = {group: [joint for joint in candidates if joint in members] for group, members in semantics.groups.items()}
    if spec.group is not None:
        if not semantics.groups:
            raise InputError(
                f"robot.group: no SRDF of {name} says which joints the group '{spec.group}' has; "
                "robot.group: [joint, ..] names them, robot.srdf gives an SRDF"
            )
        with naming("robot.group"):
            group = semantics.group(spec.group, (name, tree.name))
        planned = [joint for joint in groups[group] if joint not in spec.locked]
        if not planned:
            raise InputError(
                f"robot.group: the group '{group}' has no joint that can be planned: not fixed, mimic or passive "
                "joints, or those of robot.locked"
            )
        return planned, group, [f"planned joints: those of the SRDF's group '{group}'"]
    notes: list[str] = []
    movable = [joint for joint in joints if joint not in (*tree.mimics, *semantics.passive)]
    hands = _hands(model, movable, followers)
    if left := [joint for joint in movable if joint not in (*candidates, *hands)]:
        notes.append(f"held, as the limits of the joints that follow leave no range: {listed(left)}")
    candidates = [joint for joint in candidates if joint not in hands]
    groups = {group: [joint for joint in members if joint not in hands] for group, members in groups.items()}
    groups = {group: members for group, members in groups.items() if members}
    arms = [group for group in groups if ARM_GROUP.search(group)] if len(groups) > 1 else list(groups)
    chosen = None
    if len(arms) == 1 and len(groups[arms[0]]) < len(candidates):
        chosen = arms[0]
        candidates = groups[chosen]
        notes.append(f"planned joints: those of the SRDF's group '{chosen}'")
    candidates = [joint for joint in candidates if not GRIPPER.search(joint)] or candidates
    planned = [joint for joint in candidates if joint not in spec.locked]
    if not planned:
        raise InputError(f"robot: {name} has no joint left to plan")
    return planned, chosen, notes


def _hands(model: pin.Model, movable: list[str], followers: Mapping[str, list[str]]) -> set[str]:
    """Return the joints that drive a hand, held unless robot.group requires them: those with followers where one of
    them has a finger's name, or none of them carries another joint of the arm."""
    arm = [joint for joint in movable if not followers[joint] and not GRIPPER.search(joint)]
    below = {index for joint in arm for index in model.supports[model.getJointId(joint)]}
    found = set()
    for joint in movable:
        moved = (joint, *followers[joint])
        if followers[joint] and (any(map(GRIPPER.search, moved)) or below.isdisjoint(map(model.getJointId, moved))):
            found.add(joint)
    return found


def _check_list(
    requested: tuple[str, ...],
    joints: list[str],
    candidates: list[str],
    spec: RobotSpec,
    tree: Tree,
    semantics: Semantics,
) -> None:
    """Raise InputError for a joint of robot.group that cannot be planned."""
    for i, joint in enumerate(requested):
        why = None
        if joint in spec.locked:
            why = "is held by robot.locked: leave it out of one of the two"
        elif joint not in joints and joint not in tree.joints:
            raise InputError(f"robot.group[{i}]: unknown joint '{joint}'{nearest(joint, candidates)}")
        elif joint not in joints:
            why = "cannot be planned: it is fixed"
        elif joint in tree.mimics:
            why = f"cannot be planned: it is a mimic joint, which follows '{tree.mimics[joint][0]}'"
        elif joint in semantics.passive:
            why = "cannot be planned: the SRDF calls it passive"
        elif joint not in candidates:
            why = "cannot be planned: the limits of the joints that follow it leave no range"
        if why:
            raise InputError(f"robot.group[{i}]: joint '{joint}' {why}")
