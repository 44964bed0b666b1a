"""A robot as the planner and the certificate see it: Pinocchio model, collision geometry, joints, pairs, named
states.

RobotSpec (name or URDF, base, locked joints) -> `Robot`: fixed base, locked joints taken out of the model, one
coordinate per planned joint. Units: metres and radians; frames: Pinocchio's, with the base where the scene puts it.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.robot.pin_model import move_base, read_model, without_joints
from hdplan.scenes.attached import Attached
from hdplan.scenes.deadline import check_time
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.files import Stamps, stamps_of
from hdplan.scenes.once import freeze
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_files.description import LinkPair, Semantics, Tree, link_pair, read_semantics, read_tree
from hdplan.scenes.robot_files.library import description_of
from hdplan.scenes.robot_spec import RobotSpec, robot_spec
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import checked

Array = NDArray[np.float64]

LIMIT_ROUNDING = 1e-3  # how far a MoveIt request may lie beyond a limit [rad or m]: it is rounded
SAME_PLACE = 1e-6  # [rad or m] between two values of a joint that are the same
UNLIMITED = 1e6  # [rad] a limit beyond which is written for none at all
CONTACT_SAMPLES = 1000  # configurations at which a pair must touch to count as always in contact
GRIPPER = re.compile("finger|gripper|knuckle|thumb", re.IGNORECASE)  # joints of a hand: held
# Why pairs of links are not checked, beside what a file says of them.
NEIGHBOURS, MOVE_AS_ONE, ALWAYS_TOUCHING = "neighbours", "moving as one", "in contact at every sampled configuration"
ARM_GROUP = re.compile(r"(^|_)arm$|^manipulator$")  # the SRDF group that is planned, where several are given


@dataclass(frozen=True, eq=False)
class Robot:
    """A fixed-base robot with its locked joints taken out; joint i of the planned ones is joint i + 1 of the
    model."""

    name: str
    model: pin.Model  # base at the scene's place; joint 0 is the world
    collision: pin.GeometryModel  # the links' collision geometry; parentJoint refers to `model`
    joint_names: tuple[str, ...]  # the n planned joints, one coordinate each
    lower: Array  # (n,) [rad or m], -inf for a continuous joint
    upper: Array  # (n,) [rad or m], inf for a continuous joint
    locked: Mapping[str, float]  # joint -> the value at which it is held
    links: tuple[str, ...]  # links with collision geometry, from base to tip
    link_joint: Mapping[str, int]  # link -> index of the joint that carries it (0: fixed to the world)
    link_geometry: Mapping[str, tuple[int, ...]]  # link -> indices into collision.geometryObjects
    self_pairs: tuple[LinkPair, ...]  # pairs of links to be checked against each other
    named_states: Mapping[str, Mapping[str, float]]  # state of the SRDF -> joint -> value
    notes: tuple[str, ...]  # what was decided in loading, in words for the user
    unchecked: Mapping[LinkPair, str] = field(default_factory=dict)  # pairs of links that are excluded, and by what
    files: Stamps = ()  # that it was read from, as they were before
    attached: tuple[Attached, ...] = ()  # held objects: by their names among the links, their geometry and pairs
    base: Pose = field(default_factory=Pose)  # of the URDF's root link in the world

    def __post_init__(self) -> None:
        """Share its arrays read-only."""
        freeze(self)

    def __repr__(self) -> str:
        """Say which robot it is, and what of it is planned."""
        held = f", {len(self.locked)} joints held" if self.locked else ""
        return f"<Robot {self.name}: {self.n} joints planned ({', '.join(self.joint_names)}){held}>"

    @property
    def n(self) -> int:
        """Number of planned joints."""
        return len(self.joint_names)

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Return random configurations (count, n), uniform within the limits; a joint that turns freely within one
        turn."""
        turning = self.upper - self.lower >= 2 * math.pi
        low, high = np.where(turning, -math.pi, self.lower), np.where(turning, math.pi, self.upper)
        return rng.uniform(low, high, size=(count, self.n))

    def pin_q(self, q: ArrayLike) -> Array:
        """Return Pinocchio's configurations (..., nq) for joint values (..., n): (cos, sin) for a continuous
        joint."""
        values = np.asarray(q, dtype=np.float64)
        columns: list[Array] = []
        for index, joint in enumerate(itertools.islice(self.model.joints, 1, None)):
            angle = values[..., index]
            columns.extend((angle,) if joint.nq == 1 else (np.cos(angle), np.sin(angle)))
        return np.stack(columns, axis=-1)

    def configuration(self, target: JointTarget, from_request: bool = False) -> Array:
        """Return the joint values (n,) that a scene's start or goal means.

        A MoveIt request speaks of whole robots and is rounded: with `from_request` names that the robot lacks are
        passed over, joints that are not planned must be wanted where they are held, and the limits have LIMIT_ROUNDING.
        Otherwise both kinds of names are refused.

        Raises:
            InputError: wrong number of values, unknown or missing names, values outside the limits, or for joints that
                are held elsewhere.
        """
        where = target.field
        if target.positions is not None:
            if len(target.positions) != self.n:
                raise InputError(
                    f"{where}: {len(target.positions)} joint values, but {self.name} plans {self.n} joints: "
                    f"{', '.join(self.joint_names)}"
                )
            return self._within_limits(np.array(target.positions, dtype=np.float64), where, from_request)
        if target.state is not None:
            if target.state not in self.named_states:
                raise InputError(f"{where}: unknown state '{target.state}'{nearest(target.state, self.named_states)}")
            where, named = f"{where}: state '{target.state}'", self.named_states[target.state]
        else:
            named = target.by_name or {}
            for joint, value in named.items():
                if not from_request:
                    self.index_of(joint, where)
                elif abs(value - self.locked.get(joint, value)) > SAME_PLACE:
                    raise InputError(
                        f"{where}: joint '{joint}' is to be at {value:g}, but is not planned, and held at "
                        f"{self.locked[joint]:g}; planned are {', '.join(self.joint_names)}"
                    )
        missing = [joint for joint in self.joint_names if joint not in named]
        if missing:
            raise InputError(f"{where}: no value for {', '.join(missing)}")
        return self._within_limits(
            np.array([named[joint] for joint in self.joint_names], dtype=np.float64), where, from_request
        )

    def index_of(self, joint: str, where: str) -> int:
        """Return the place of a planned joint among them. Raises InputError, naming `where`, for any other name."""
        if joint in self.locked:
            raise InputError(f"{where}: joint '{joint}' is held at {self.locked[joint]:g}, not planned (robot.locked)")
        if joint not in self.joint_names:
            raise InputError(f"{where}: unknown joint '{joint}'{nearest(joint, self.joint_names)}")
        return self.joint_names.index(joint)

    def _within_limits(self, q: Array, where: str, from_request: bool) -> Array:
        slack = LIMIT_ROUNDING if from_request else 1e-9
        for joint, value, low, high in zip(self.joint_names, q.tolist(), self.lower, self.upper, strict=True):
            if not low - slack <= value <= high + slack:
                raise InputError(f"{where}: joint '{joint}' is {value:g}, outside its limits [{low:g}, {high:g}]")
        return q


# --- loading ---------------------------------------------------------------------------------------------


def load_robot(robot: str | RobotSpec) -> Robot:
    """Load a robot: one of example-robot-data by its name, or what a RobotSpec says, such as a URDF (and SRDF) file.

    Planned are the joints of the SRDF's group that the specification names; without one those of its arm group, or else
    all joints, but for those of a hand. Never planned are mimic joints and what they follow. All others are held: at
    the scene's value (even beyond the limits), or else at the first named state that mentions them, or else at 0, as
    near as their limits allow.

    Raises:
        InputError: unknown robot, group, joint or link; a file that cannot be read; a joint with several coordinates.
    """
    spec: RobotSpec = checked(robot_spec, robot, "robot")
    name, urdf, srdf, package_dirs = description_of(spec)
    files = stamps_of((urdf,) if srdf is None else (urdf, srdf))
    tree = read_tree(urdf)
    semantics = read_semantics(srdf, tree) if srdf is not None else Semantics()
    full, geometry, meshes = read_model(urdf, package_dirs)
    if len(geometry.geometryObjects) != tree.collisions:  # what is passed over would be proven free
        read = len(geometry.geometryObjects)
        raise InputError(f"robot.urdf: {urdf}: only {read} of {tree.collisions} collision geometries could be read")

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
    planned, notes = _planned(joints, spec, tree, semantics, name)
    held = {joint: _held_at(joint, full, spec, tree, semantics) for joint in joints if joint not in planned}
    notes += [*tree.notes, *semantics.notes]
    if not geometry.geometryObjects:
        notes.append(f"no link of {name} has collision geometry: it can touch nothing")
    by_default = [f"{joint} at {value:g}" for joint, value in held.items() if joint not in spec.locked]
    if by_default:
        notes.append(f"joints held: {', '.join(by_default)}")

    model, collision = without_joints(full, geometry, held)
    move_base(model, collision, pin.SE3(spec.base.matrix))

    link_geometry: dict[str, tuple[int, ...]] = {}
    link_joint: dict[str, int] = {}
    for index, item in enumerate(collision.geometryObjects):
        link = str(model.frames[item.parentFrame].name)
        link_geometry[link] = (*link_geometry.get(link, ()), index)
        link_joint[link] = int(item.parentJoint)
    bounded = np.array([joint.nq == 1 for joint in itertools.islice(model.joints, 1, None)])
    first = [joint.idx_q for joint in itertools.islice(model.joints, 1, None)]
    lower, upper = np.asarray(model.lowerPositionLimit)[first], np.asarray(model.upperPositionLimit)[first]
    loaded = Robot(
        name=name,
        model=model,
        collision=collision,
        joint_names=tuple(str(joint) for joint in model.names)[1:],
        lower=np.where(bounded & (lower > -UNLIMITED), lower, -np.inf),
        upper=np.where(bounded & (upper < UNLIMITED), upper, np.inf),
        locked=held,
        links=tuple(link_geometry),
        link_joint=link_joint,
        link_geometry=link_geometry,
        self_pairs=(),
        named_states=semantics.states,
        notes=(),
        files=(*files, *meshes),
        base=spec.base,
    )
    unchecked = _told_apart(loaded, tree, semantics, spec)
    every = (link_pair(a, b) for a, b in itertools.combinations(loaded.links, 2))
    pairs = tuple(pair for pair in every if pair not in unchecked)
    touching = _always_in_contact(loaded, pairs)
    unchecked |= dict.fromkeys(touching, ALWAYS_TOUCHING)
    if touching:
        named = ", ".join(f"{a}-{b}" for a, b in touching)
        notes.append(f"link pairs in contact at every sampled configuration, not checked: {named}")
    pairs = tuple(pair for pair in pairs if pair not in touching)
    return replace(loaded, self_pairs=pairs, unchecked=unchecked, notes=tuple(notes))


def _planned(
    joints: list[str], spec: RobotSpec, tree: Tree, semantics: Semantics, name: str
) -> tuple[list[str], list[str]]:
    """Return the joints to plan, and notes where a group of the SRDF chose them or could not."""
    notes: list[str] = []
    coupled = {joint for mimic, (followed, _, _) in tree.mimics.items() for joint in (mimic, followed)}
    candidates = [joint for joint in joints if joint not in coupled]
    groups = {group: [joint for joint in candidates if joint in members] for group, members in semantics.groups.items()}
    if spec.group is not None and semantics.groups:
        with naming("robot.group"):
            group = semantics.group(spec.group, (name, tree.name))
        planned = [joint for joint in groups[group] if joint not in spec.locked]
        if not planned:
            raise InputError(
                f"robot.group: the group '{group}' has no joint that can be planned: fixed and mimic joints cannot, "
                "nor what those follow, nor those of robot.locked"
            )
        return planned, [f"planned are the joints of the SRDF's group '{group}'"]
    if spec.group is not None:
        notes.append(f"no SRDF of {name} says which joints the group '{spec.group}' has: planned is what can be")
    groups = {group: members for group, members in groups.items() if members}
    arms = [group for group in groups if ARM_GROUP.search(group)] if len(groups) > 1 else list(groups)
    if len(arms) == 1 and len(groups[arms[0]]) < len(candidates):
        candidates = groups[arms[0]]
        notes.append(f"planned are the joints of the SRDF's group '{arms[0]}'")
    candidates = [joint for joint in candidates if not GRIPPER.search(joint)] or candidates
    planned = [joint for joint in candidates if joint not in spec.locked]
    if not planned:
        raise InputError(f"robot: {name} has no joint left to plan")
    return planned, notes


def _held_at(joint: str, model: pin.Model, spec: RobotSpec, tree: Tree, semantics: Semantics) -> float:
    """Return the value of a joint that is not planned."""
    if joint in spec.locked:
        return float(spec.locked[joint])
    if joint in tree.mimics and tree.mimics[joint][0] in model.names:
        followed, factor, offset = tree.mimics[joint]
        return factor * _held_at(followed, model, spec, tree, semantics) + offset
    value = next((state[joint] for state in semantics.states.values() if joint in state), 0.0)
    index = model.getJointId(joint)
    if model.joints[index].nq != 1:
        return value
    at = model.joints[index].idx_q
    return float(np.clip(value, model.lowerPositionLimit[at], model.upperPositionLimit[at]))


# --- self-collision pairs --------------------------------------------------------------------------------


def _told_apart(robot: Robot, tree: Tree, semantics: Semantics, spec: RobotSpec) -> dict[LinkPair, str]:
    """Return the pairs that are not checked, each with its reason: ignored, disabled, neighbours, or without motion
    against each other.

    Neighbours have exactly one moving joint between them, and no other link with geometry: what meets at a joint may
    overlap there. Across two joints, be it by a link without geometry, and beyond a link that is fixed to another, they
    are as free to collide as any two. Held joints do not move.
    """
    for link in (link for pair in spec.ignore_pairs for link in pair):
        if link not in tree.links:
            raise InputError(f"robot.ignore_pairs: unknown link '{link}'{nearest(link, tree.links)}")
    joint, parents = robot.link_joint, robot.model.parents
    pairs = [link_pair(a, b) for a, b in itertools.combinations(robot.links, 2)]
    one_joint = [(a, b) for a, b in pairs if joint[a] == parents[joint[b]] or joint[b] == parents[joint[a]]]
    neighbours = [pair for pair in one_joint if not any(link in joint for link in tree.between(*pair))]
    return {
        **{link_pair(*pair): "robot.ignore_pairs" for pair in spec.ignore_pairs},
        **dict.fromkeys(semantics.disabled, "the SRDF"),
        **dict.fromkeys(neighbours, NEIGHBOURS),
        **{(a, b): MOVE_AS_ONE for a, b in pairs if joint[a] == joint[b]},
    }


def _always_in_contact(robot: Robot, pairs: tuple[LinkPair, ...]) -> tuple[LinkPair, ...]:
    """Return the pairs that touch at every one of CONTACT_SAMPLES random configurations (fixed seed)."""
    samples = robot.draw(np.random.default_rng(0), CONTACT_SAMPLES)
    data, geometry_data = robot.model.createData(), pin.GeometryData(robot.collision)
    items = robot.collision.geometryObjects
    left = list(pairs)
    for q in robot.pin_q(samples):
        if not left:
            break
        check_time("loading the robot")
        pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry_data, q)
        left = [
            (a, b)
            for a, b in left
            if any(
                coal.collide(
                    items[i].geometry,
                    _transform(geometry_data.oMg[i]),
                    items[j].geometry,
                    _transform(geometry_data.oMg[j]),
                    coal.CollisionRequest(),
                    coal.CollisionResult(),
                )
                for i in robot.link_geometry[a]
                for j in robot.link_geometry[b]
            )
        ]
    return tuple(left)


def _transform(pose: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(pose.rotation, pose.translation)
