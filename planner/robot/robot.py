"""A robot for planner and certificate: Pinocchio model, collision geometry, joints, self-collision pairs, named states.

`loading.load_robot` makes it of a RobotSpec (name or URDF, base, locked joints): fixed base, locked joints removed from
the model, one coordinate per planned joint. Units: metres and radians; frames: Pinocchio's, with the base where the
scene puts it.
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

from hdplan.planner.robot.as_loaded import AsLoaded
from hdplan.planner.robot.linkage import Linkage
from hdplan.planner.robot.pin_model import motion_axes
from hdplan.planner.robot.self_pairs import CONTACT_SAMPLES, NEVER_TOUCHING
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached
from hdplan.scenes.errors import LISTED_NAMES, InputError, UnsolvableError, listed, nearest
from hdplan.scenes.files import Stamps
from hdplan.scenes.once import freeze, read_only
from hdplan.scenes.poses import LARGEST_ANGLE, Pose
from hdplan.scenes.robot_files.description import Semantics
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.targets import JointTarget

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
    files: Stamps = ()  # stamps of its files, taken before reading
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
        """Coordinates of the planned joints among the model's velocities (n,)."""
        return self.linkage.own if self.linkage else read_only(np.arange(self.n))

    @cached_property
    def unfolded(self) -> Robot:
        """A copy of the robot with followers as ordinary joints, within what the planned ones' limits leave them;
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
        """Return the derivatives (..., n) with respect to the planned joints, from those (..., m) with respect to all
        joints of the model."""
        return wrench if self.linkage is None else self.linkage.fold(wrench)

    @property
    def never_touching(self) -> tuple[LinkPair, ...]:
        """The pairs of links that are not checked, as they are proven never to touch."""
        return tuple(pair for pair, reason in self.unchecked.items() if reason == NEVER_TOUCHING)

    def doubt(self, pairs: Iterable[tuple[str, str]]) -> str:
        """Return a hint on links in contact that touched at every sample, with the remedy; empty if none of them
        did."""
        for a, b in (pair for pair in pairs if link_pair(*pair) in self.doubtful):
            return (
                f"; links {a} and {b} touch at each of {CONTACT_SAMPLES} sampled configurations, which is not a proof: "
                "name them in robot.ignore_pairs, or an SRDF, if they may"
            )
        return ""

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """Mask of the joints that turn, rather than slide (n,)."""
        joints = itertools.islice(self.model.joints, 1, None)
        return read_only(np.array([bool(np.any(motion_axes(joint)[1])) for joint in joints])[self.coordinates])

    @cached_property
    def followed(self) -> NDArray[np.bool_]:
        """Mask of the joints that others follow (n,): a whole turn of one may take these anywhere."""
        return self.linkage.followed if self.linkage else read_only(np.zeros(self.n, dtype=np.bool_))

    @cached_property
    def endless(self) -> NDArray[np.bool_]:
        """Mask of the joints that turn without limits, so that whole turns lead to the same place (n,)."""
        return read_only(np.isinf(self.lower) & np.isinf(self.upper) & self.turning & ~self.followed)

    @cached_property
    def _circling(self) -> tuple[bool, ...]:
        """Mask of the joints that Pinocchio describes by cosine and sine."""
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

        A MoveIt request describes the whole robot and is rounded: with `from_request` unknown names are ignored, values
        for joints that are not planned must be those at which they are held, and limits may be exceeded by
        LIMIT_ROUNDING. Otherwise names of unknown or held joints are refused.

        Raises:
            InputError: for a wrong number of values, unknown or missing names, values outside the limits, or values for
                joints that are held at others.
        """
        where = target.field
        if target.positions is not None:
            return self._within_limits(self.one_each(target.positions, where), where, from_request)
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
            joints = f"{listed(self.joint_names)}{PLAN_LESS * (self.n > LISTED_NAMES)}"
            raise InputError(f"{where}: {len(values)} values, but {self.name} plans {self.n} joints: {joints}")
        return np.array(values, dtype=np.float64)

    def _within_limits(self, q: Array, where: str, from_request: bool) -> Array:
        slack = LIMIT_ROUNDING if from_request else 1e-9
        for joint, value, low, high in zip(self.joint_names, q.tolist(), self.lower, self.upper, strict=True):
            if not low - slack <= value <= high + slack:
                beyond = f"{where}: joint '{joint}' is {value:g}, outside its limits [{low:g}, {high:g}]"
                degrees = self.turning[self.joint_names.index(joint)] and abs(value) > LARGEST_ANGLE
                hint = "; is it in degrees? hdplan takes radians" if degrees else ""
                raise UnsolvableError(f"{beyond}{hint}", "end_beyond_limits")
        return q
