"""A robot for planner and certificate: Pinocchio model, collision geometry, joints, self-collision pairs, named states.

RobotSpec (name or URDF, base, locked joints) -> `Robot`: fixed base, locked joints removed from the model, one
coordinate per planned joint. Units: metres and radians; frames: Pinocchio's, with the base where the scene puts it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.robot.always_touching import always_touching
from hdplan.planner.robot.as_loaded import AsLoaded
from hdplan.planner.robot.linkage import Linkage, room_of, rules_of
from hdplan.planner.robot.pin_model import motion_axes, move_base, read_model, without_joints
from hdplan.planner.robot.planned_joints import planned_joints, range_of
from hdplan.planner.robot.self_pairs import (
    ALWAYS_TOUCHING,
    CONTACT_SAMPLES,
    EXCESS,
    NEVER_TOUCHING,
    always_in_contact,
    excluded,
    never_in_contact,
)
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached
from hdplan.scenes.errors import LISTED_NAMES, InputError, UnsolvableError, listed, nearest
from hdplan.scenes.files import Stamps, stamps_of
from hdplan.scenes.once import freeze, read_only
from hdplan.scenes.poses import TURN, Pose
from hdplan.scenes.robot_files.description import Semantics, Tree, read_words
from hdplan.scenes.robot_files.library import description_of, source_of
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.robot_files.urdf_text import BASE_JOINTS
from hdplan.scenes.robot_spec import RobotSpec, robot_spec
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import checked

LIMIT_ROUNDING = 1e-3  # how far a MoveIt request may lie beyond a limit [rad or m], as it is rounded
SAME_PLACE = 1e-6  # [rad or m] two values of a joint that differ by less are the same
PLAN_LESS = "; robot.group plans only some of the joints, robot.locked holds others"


@dataclass(frozen=True, eq=False)
class Robot:
    """A fixed-base robot with its locked joints removed. Planned joint i is joint i + 1 of the model, unless joints
    follow others (`linkage`): these are joints of the model, too, but not planned."""

    name: str
    model: pin.Model  # with the base where the scene puts it; joint 0 is the world
    collision: pin.GeometryModel  # the links' collision geometry; parentJoint refers to `model`
    joint_names: tuple[str, ...]  # the n planned joints, one coordinate each
    lower: Array  # (n,) [rad or m], -inf for a continuous joint
    upper: Array  # (n,) [rad or m], inf for a continuous joint
    inner: Array  # (2, n) lower and upper between the ends: narrower where an end lies beyond the robot's own limits
    locked: Mapping[str, float]  # joint -> the value at which it is held
    links: tuple[str, ...]  # links with collision geometry, from base to tip
    link_joint: Mapping[str, int]  # link -> index of the joint that carries it (0: fixed to the world)
    link_geometry: Mapping[str, tuple[int, ...]]  # link -> indices into collision.geometryObjects
    self_pairs: tuple[LinkPair, ...]  # pairs of links to be checked against each other
    named_states: Mapping[str, Mapping[str, float]]  # state of the SRDF -> joint -> value, of the planned group first
    notes: tuple[str, ...]  # notes for the user on what was decided in loading
    unchecked: Mapping[LinkPair, str] = field(default_factory=dict)  # pairs of links not checked, and the reason
    doubtful: tuple[LinkPair, ...] = ()  # pairs checked that touch at every sampled configuration, which is no proof
    files: Stamps = ()  # stamps of the files that it was read from, taken before reading
    attached: tuple[Attached, ...] = ()  # held objects, which are also among the links, their geometry and pairs
    base: Pose = field(default_factory=Pose)  # of the URDF's root link in the world
    semantics: Semantics = field(default_factory=Semantics)  # what the SRDF says, of the whole robot
    impossible: tuple[str, ...] = ()  # links that move and have an inertia that no body has: no torques
    linkage: Linkage | None = None  # how joints of the model follow the planned ones; None: there are no others
    as_loaded: AsLoaded = field(default=None, repr=False)  # type: ignore[assignment]  # made here: `check_as_loaded`

    def __post_init__(self) -> None:
        """Share its arrays read-only, and keep copies of what can be changed."""
        freeze(self)
        object.__setattr__(self, "as_loaded", AsLoaded.of(self, self.as_loaded))

    def __repr__(self) -> str:
        """Name the robot and its planned joints."""
        held = f", {len(self.locked)} joints held" if self.locked else ""
        along = f", {len(self.linkage.followers)} follow" if self.linkage else ""
        return f"<Robot {self.name}: {self.n} joints planned ({', '.join(self.joint_names)}){along}{held}>"

    @property
    def n(self) -> int:
        """Number of planned joints."""
        return len(self.joint_names)

    @property
    def followers(self) -> tuple[str, ...]:
        """The joints of the model that follow planned ones."""
        return self.linkage.followers if self.linkage else ()

    @cached_property
    def coordinates(self) -> NDArray[np.int64]:
        """Which coordinates of the model's velocities the planned joints are (n,)."""
        return self.linkage.own if self.linkage else read_only(np.arange(self.n))

    @cached_property
    def unfolded(self) -> Robot:
        """The same robot with followers as joints like any other, within what the planned ones' limits leave them;
        itself where nothing follows. Its configurations are those of `expand`."""
        if self.linkage is None:
            return self
        lower, upper = self.linkage.spread(self.lower, self.upper)
        inner = np.stack(self.linkage.spread(*self.inner))
        return replace(self, joint_names=self.linkage.names, lower=lower, upper=upper, inner=inner, linkage=None)

    def expand(self, q: Array) -> Array:
        """Return the values (..., m) of all joints of the model at configurations (..., n): q itself where nothing
        follows."""
        return q if self.linkage is None else self.linkage.expand(q)

    def fold(self, wrench: Array) -> Array:
        """Return what derivatives (..., m) with respect to all joints of the model are with respect to the planned ones
        (..., n)."""
        return wrench if self.linkage is None else self.linkage.fold(wrench)

    @property
    def never_touching(self) -> tuple[LinkPair, ...]:
        """The pairs of links that are not checked, as they are proven never to touch."""
        return tuple(pair for pair, reason in self.unchecked.items() if reason == NEVER_TOUCHING)

    def doubt(self, pairs: Iterable[tuple[str, str]]) -> str:
        """Say of links in contact that they touch wherever it was tried, and what to do; empty if none of them does."""
        for a, b in (pair for pair in pairs if link_pair(*pair) in self.doubtful):
            return (
                f"; links {a} and {b} touch at each of {CONTACT_SAMPLES} sampled configurations, which is no proof: "
                "name them in robot.ignore_pairs, or an SRDF, if they may"
            )
        return ""

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """Which joints turn, rather than slide (n,)."""
        joints = itertools.islice(self.model.joints, 1, None)
        return read_only(np.array([bool(np.any(motion_axes(joint)[1])) for joint in joints])[self.coordinates])

    @cached_property
    def followed(self) -> NDArray[np.bool_]:
        """Which joints others follow (n,): a whole turn of one may take these anywhere."""
        return self.linkage.followed if self.linkage else read_only(np.zeros(self.n, dtype=np.bool_))

    @cached_property
    def endless(self) -> NDArray[np.bool_]:
        """Which joints turn without limits, so that whole turns lead to the same place (n,)."""
        return read_only(np.isinf(self.lower) & np.isinf(self.upper) & self.turning & ~self.followed)

    @cached_property
    def _circling(self) -> tuple[bool, ...]:
        """Which joints Pinocchio describes by cosine and sine."""
        return tuple(joint.nq == 2 for joint in itertools.islice(self.model.joints, 1, None))

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Return random configurations (count, n), uniform within the limits; a joint that may turn by more than one
        turn, or slides without limits, is drawn from the 2π nearest to 0 that its limits leave."""
        span = self.upper - self.lower
        wide = (span >= 2 * math.pi) & (self.turning | np.isinf(span))
        middle = np.clip(0.0, self.lower + math.pi, np.where(wide, self.upper - math.pi, np.inf))
        low, high = np.where(wide, middle - math.pi, self.lower), np.where(wide, middle + math.pi, self.upper)
        return rng.uniform(low, high, size=(count, self.n))

    def pin_q(self, q: ArrayLike) -> Array:
        """Return Pinocchio's configurations (..., nq) for joint values (..., n): (cos, sin) for a continuous joint."""
        values = self.expand(np.asarray(q, dtype=np.float64))
        if not any(self._circling):
            return values.copy()
        columns: list[Array] = []
        for index, circling in enumerate(self._circling):
            angle = values[..., index]
            columns.extend((np.cos(angle), np.sin(angle)) if circling else (angle,))
        return np.stack(columns, axis=-1)

    def configuration(self, target: JointTarget, from_request: bool = False) -> Array:
        """Return the joint values (n,) of a scene's start or goal.

        A MoveIt request is about the whole robot and is rounded: with `from_request` unknown names are ignored, values
        for joints that are not planned must be those at which they are held, and limits may be exceeded by
        LIMIT_ROUNDING. Otherwise names of unknown or held joints are refused.

        Raises:
            InputError: for a wrong number of values, unknown or missing names, values outside the limits, or values for
                joints that are held at others.
        """
        where = target.field
        if target.positions is not None:
            if len(target.positions) != self.n:
                raise InputError(
                    f"{where}: {len(target.positions)} joint values, but {self.name} plans {self.n} joints: "
                    f"{listed(self.joint_names)}{PLAN_LESS * (self.n > LISTED_NAMES)}"
                )
            return self._within_limits(np.array(target.positions, dtype=np.float64), where, from_request)
        if target.state is not None:
            if target.state not in self.named_states:
                raise InputError(f"{where}: unknown state '{target.state}'{nearest(target.state, self.named_states)}")
            where, named = f"{where}: state '{target.state}'", self.named_states[target.state]
        else:
            named = target.by_name or {}
            for joint, value in named.items():
                if joint not in (*self.locked, *self.followers) and not from_request:
                    self.index_of(joint, where)
                if abs(value - self.locked.get(joint, value)) > SAME_PLACE:
                    raise InputError(
                        f"{where}: joint '{joint}' is given the value {value:g}, but is not planned and held at "
                        f"{self.locked[joint]:g}; the planned joints are {listed(self.joint_names)}"
                    )
        missing = [joint for joint in self.joint_names if joint not in named]
        if missing:
            raise InputError(f"{where}: no value for {listed(missing)}{PLAN_LESS * (len(missing) > LISTED_NAMES)}")
        q = np.array([named[joint] for joint in self.joint_names], dtype=np.float64)
        if self.linkage is not None:
            rounded = from_request or target.state is not None
            self.linkage.check(q, named, where, LIMIT_ROUNDING if rounded else SAME_PLACE)
        return self._within_limits(q, where, from_request)

    def nearest_turn(self, q: Array, near: Array) -> Array:
        """Return configurations q (..., n) as near to another one as whole turns of joints without limits bring them:
        q_i + 2πk is the same place for every whole k, and the values that the joint passes on the way are free."""
        turns = np.round((near - q) / (2 * math.pi))
        return np.where(self.endless, q + 2 * math.pi * turns, q)

    def index_of(self, joint: str, where: str) -> int:
        """Return the index of a planned joint. Raises InputError, naming `where`, for any other name."""
        if joint in self.locked:
            raise InputError(f"{where}: joint '{joint}' is held at {self.locked[joint]:g}, not planned (robot.locked)")
        if self.linkage is not None and joint in self.followers:
            raise InputError(f"{where}: joint '{joint}' is not planned itself: {self.linkage.rule(joint)}")
        if joint not in self.joint_names:
            raise InputError(f"{where}: unknown joint '{joint}'{nearest(joint, (*self.joint_names, *self.locked))}")
        return self.joint_names.index(joint)

    def one_each(self, values: Sequence[float], where: str) -> Array:
        """Return values of the planned joints (n,), in their order. Raises InputError, naming `where`, for another
        number of them."""
        if len(values) != self.n:
            joints = listed(self.joint_names)
            raise InputError(f"{where}: {len(values)} values, but {self.name} plans {self.n} joints: {joints}")
        return np.array(values)

    def _within_limits(self, q: Array, where: str, from_request: bool) -> Array:
        slack = LIMIT_ROUNDING if from_request else 1e-9
        for joint, value, low, high in zip(self.joint_names, q.tolist(), self.lower, self.upper, strict=True):
            if not low - slack <= value <= high + slack:
                beyond = f"{where}: joint '{joint}' is {value:g}, outside its limits [{low:g}, {high:g}]"
                degrees = self.turning[self.joint_names.index(joint)] and abs(value) > TURN
                asked = "; is it in degrees? hdplan takes radians" if degrees else ""
                raise UnsolvableError(f"{beyond}{asked}", "end_beyond_limits")
        return q


# --- loading ---------------------------------------------------------------------------------------------


def load_robot(robot: str | RobotSpec) -> Robot:
    """Load a robot: one of example-robot-data by its name, or that of a RobotSpec, such as a URDF (and SRDF) file.

    The planned joints are those of the SRDF group that the specification names; without one, those of the SRDF's arm
    group, or else all joints except those of a hand. Mimic joints, and those that the SRDF calls passive, are never
    planned: mimic joints move with the joint that they follow, where that is planned.
    All other joints are held: at the scene's value (at most EXCESS beyond the limits), or else at the value of the
    first named state that has one, or else at 0, or as near to it as their limits allow.

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
        if not low - EXCESS <= value <= high + EXCESS:
            raise InputError(
                f"robot.locked or start: joint '{joint}' is to be held at {value:g}, more than {EXCESS:g} beyond its "
                f"limits [{low:g}, {high:g}]"
            )
    planned, group, notes = planned_joints(full, ranges, spec, tree, semantics, name)
    if spec.base_joints is not None:
        planned += [joint for joint in BASE_JOINTS if joint not in (*planned, *spec.locked)]
    rules = {joint: rule for joint, rule in rules_of(tree, joints).items() if rule.leader in planned and rule.factor}
    for joint in spec.locked:
        if joint in rules:
            raise InputError(
                f"robot.locked: joint '{joint}' follows '{rules[joint].leader}', which is planned: hold that one"
            )
    resting = [joint for joint in joints if joint not in (*planned, *rules)]
    held = {joint: _held_at(joint, full, spec, tree, semantics) for joint in resting}
    notes += [*tree.notes, *semantics.notes]
    if not geometry.geometryObjects:
        notes.append(f"no link of {name} has collision geometry, so it cannot touch anything")
    if lost := [joint for joint, (followed, _, _) in tree.mimics.items() if followed not in tree.joints]:
        notes.append(f"joints that mimic one that {name} does not have, held: {listed(lost)}")
    for joint, (followed, factor, offset) in tree.mimics.items():
        should = factor * held.get(followed, 0.0) + offset
        if joint in held and joint not in lost and abs(held[joint] - should) > SAME_PLACE:
            follows = f"following '{followed}' it would be at {should:g}"
            notes.append(f"joint '{joint}' is held at {held[joint]:g}; {follows}")
    by_default = [f"{joint} at {value:g}" for joint, value in held.items() if joint not in spec.locked]
    if by_default:
        notes.append(f"joints held: {listed(by_default)}")

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
            notes.append(f"joint '{names[i]}': limits narrowed to [{low:g}, {high:g}] by those of what follows it")
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
        notes=(),
        files=(*files, *meshes),
        base=spec.base,
        impossible=_moved(tree.impossible, model),
        linkage=linkage,
    )
    unchecked = dict.fromkeys(apart, NEVER_TOUCHING) | excluded(loaded, tree, semantics, spec)
    every = [link_pair(a, b) for a, b in itertools.combinations(loaded.links, 2)]
    asked = {link_pair(a, b) for a, b in spec.check_pairs}
    touching = always_in_contact(loaded, (pair for pair in every if pair not in unchecked and pair not in asked))
    unchecked |= dict.fromkeys(always_touching(loaded, touching, EXCESS), ALWAYS_TOUCHING)
    if never := list(unchecked.values()).count(NEVER_TOUCHING):
        notes.append(f"without an SRDF: link pairs that are proven never to touch, not checked: {never}")
    if always := [pair for pair in touching if pair in unchecked]:
        notes.append(f"link pairs that are proven always to touch, not checked: {_words(always)}")
    if doubtful := tuple(pair for pair in touching if pair not in unchecked):
        notes.append(
            f"link pairs in contact at each of {CONTACT_SAMPLES} sampled configurations, which is no proof, so they "
            f"are checked: {_words(doubtful)}; name them in robot.ignore_pairs, or an SRDF, if they may touch"
        )
    pairs = tuple(pair for pair in every if pair not in unchecked)
    return replace(loaded, self_pairs=pairs, unchecked=unchecked, doubtful=doubtful, notes=tuple(notes))


def _words(pairs: Iterable[LinkPair]) -> str:
    return ", ".join(f"{a}-{b}" for a, b in pairs)


def _moved(links: tuple[str, ...], model: pin.Model) -> tuple[str, ...]:
    """Return those of the links that a joint of the model moves."""
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
