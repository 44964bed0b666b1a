"""The `start` and `goal` sections.

A goal may leave a choice: several configurations, a link's pose, or several poses. Names of joints, links and states
are checked when the robot is loaded.
"""

from __future__ import annotations

from hdplan.scenes.fields import Field
from hdplan.scenes.pose_fields import pose_of
from hdplan.scenes.targets import FREE_ROTATIONS, NO_TURN, AllOf, Goals, JointTarget, PoseTarget, unlike_the_others
from hdplan.scenes.values import JointValue, Named, Row

RATES = ("velocity", "acceleration")
GOAL_KEYS = ("joints", "state", "pose", "poses", "all", "any")
POSE_KEYS = (
    "link",
    "position",
    "quaternion_xyzw",
    "rpy",
    "position_tolerance",
    "orientation_tolerance",
    "free_rotation",
)


def read_target(section: Field) -> JointTarget:
    """Read one configuration: joint values in order, by name, or a named state; and how the robot moves there."""
    keys = section.mapping(("joints", "state", *RATES))
    rates = {name: keys.pop(name) for name in RATES if name in keys}
    if len(keys) != 1:
        raise section.error(f"must have either 'joints' or 'state', found {'both' if keys else 'neither'}")
    if "state" in keys:
        return section.make(JointTarget, field=section.key, state=keys["state"], **rates)
    found = _joints(keys["joints"], section.key)
    if not rates:
        return found
    return section.make(JointTarget, field=section.key, positions=found.positions, by_name=found.by_name, **rates)


def _joints(joints: Field, name: str) -> JointTarget:
    match joints.value:
        case [_, *_]:
            return JointTarget(name, positions=joints.checked(Row(JointValue), joints.value))
        case {**named} if named:
            return JointTarget(name, by_name=joints.checked(Named(JointValue), joints.value))
        case _:
            raise joints.wrong("a list of joint values, or a mapping from joint names to values [rad or m]")


def read_goal(section: Field) -> JointTarget | Goals:
    """Read one configuration, or a goal with a choice: several configurations, a link's pose, several poses, several
    of both, or poses of several links together."""
    keys = section.mapping((*GOAL_KEYS, *RATES))
    rates = [keys.pop(name) for name in RATES if name in keys]
    if len(keys) != 1:
        found = " and ".join(f"'{key}'" for key in keys) or "none of them"
        raise section.error(f"must have exactly one of the keys {', '.join(GOAL_KEYS)}, found {found}")
    several = "joints" in keys and isinstance(keys["joints"].value, list) and _holds_containers(keys["joints"].value)
    if rates and (several or not {"joints", "state"} & keys.keys()):
        raise rates[0].error(
            "applies to a single configuration: motions to a pose, or to a choice of goals, end at rest"
        )
    if "pose" in keys:
        return Goals((_pose_target(keys["pose"]),))
    if "poses" in keys:
        return Goals(tuple(_pose_target(pose) for pose in _at_least_one(keys["poses"], "poses")))
    if "all" in keys:
        return Goals((_all_of(keys["all"]),))
    if "any" in keys:
        return Goals(tuple(_one_of(entry) for entry in _at_least_one(keys["any"], "goals")))
    if several:
        entries = keys["joints"].items(of="configurations")
        return Goals(tuple(_joints(joints, joints.key) for joints in entries))
    return read_target(section)


def _holds_containers(values: list[object]) -> bool:
    return any(isinstance(value, list | dict) for value in values)


def _at_least_one(section: Field, of: str) -> list[Field]:
    entries = section.items(of=of)
    if not entries:
        raise section.wrong(f"a list of one or more {of}")
    return entries


def _one_of(section: Field) -> JointTarget | PoseTarget:
    keys = section.mapping(("joints", "state", "pose"))
    if len(keys) != 1:
        raise section.error(f"must have one of 'joints', 'state' and 'pose', found {' and '.join(keys) or 'none'}")
    return _pose_target(keys["pose"]) if "pose" in keys else read_target(section)


def _all_of(section: Field) -> AllOf:
    entries = [entry.mapping(("pose",), required=["pose"])["pose"] for entry in section.items(of="goals")]
    if len(entries) < 2:
        raise section.wrong("a list of two or more goals, each with the key pose")
    poses = [_pose_target(entry) for entry in entries]
    if wrong_one := unlike_the_others(poses):
        raise entries[wrong_one[0]].error(wrong_one[1])
    return AllOf(poses, section.key)


def _pose_target(section: Field) -> PoseTarget:
    keys = section.mapping(POSE_KEYS, required=["position"])
    free = keys["free_rotation"].choice(FREE_ROTATIONS) if "free_rotation" in keys else PoseTarget.free_rotation
    turn = next((keys[key] for key in ("quaternion_xyzw", "rpy", "orientation_tolerance") if key in keys), None)
    if free == "all" and turn is not None:
        raise turn.error(NO_TURN)
    if free != "all" and "quaternion_xyzw" not in keys and "rpy" not in keys:
        raise section.error("has no orientation: give 'quaternion_xyzw' or 'rpy', or free_rotation: all")
    values = {name: keys[name] for name in ("link", "position_tolerance", "orientation_tolerance") if name in keys}
    pose = pose_of(section, keys)
    return section.make(PoseTarget, field=section.key, pose=pose, free_rotation=free, **values)
