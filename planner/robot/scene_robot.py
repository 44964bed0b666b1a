"""A scene's robot, loaded once per process for all scenes that use it.

Reading a URDF and its meshes often takes longer than planning; a robot is cached until one of its files changes.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from hdplan.planner.geometry.opened import with_content
from hdplan.planner.robot.as_loaded import check_as_loaded
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.self_pairs import LIMIT_EXCESS, NEVER_TOUCHING
from hdplan.planner.robot.tracking import tracking
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import stamps_of
from hdplan.scenes.once import ForkSafeLock, made_once
from hdplan.scenes.robot_files.packages import OF_ROS
from hdplan.scenes.robot_files.urdf_text import XACRO
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget

KEPT_ROBOTS = 8  # robots kept
_kept: OrderedDict[Hashable, Robot] = OrderedDict()
_loading = ForkSafeLock()  # one robot at a time: threads that require the same one must get the same object


def load_scene_robot(scene: Scene) -> Robot:
    """Load a scene's robot, with the start's values for joints that it names and that are not planned, with the objects
    that it holds, within the scene's own position limits, and without self pairs if the scene says so.

    The limits are widened for a request's start and goal and for named states, by up to LIMIT_EXCESS, which is noted.
    Returns the same object for the same specification as long as its files do not change. Raises InputError, naming the
    file that specifies the robot.
    """
    with naming(scene.robot.source or scene.source):
        robot = _load_bare(scene)
    lags = tracking(scene, robot) if scene.robot.tracking is not None and scene.robot.tracking.position else None
    with naming(scene.source):
        if scene.limits.position:
            robot = _narrowed(robot, tuple(scene.limits.position.items()))
        if lags is not None:
            robot = _with_lag(robot, tuple(lags.tolist()))
        if scene.attached:
            robot = _holding(robot, tuple(with_content(held, "attached") for held in scene.attached))
    if scene.self_collision.clearance:
        robot = _all_kept_apart(robot)
    return robot if scene.self_collision.checked else _unchecked(robot)


def check_robot(scene: Scene, robot: Robot) -> None:
    """Raise InputError, saying what differs, for a robot that is not the scene's (`load_scene_robot`).

    What is proven of it must hold of the scene's: it may be kept within less, and checked for more pairs of links, but
    not the reverse.
    """
    check_as_loaded(robot)
    own = load_scene_robot(scene)
    if robot is not own and (words := next(_differences(robot, own), None)):
        raise InputError(f"robot: {words}; the scene's own is hdplan.build(scene).robot")


def are_alike(robot: Robot, other: Robot) -> bool:
    """True if two robots stand, move and are checked alike, so that one may take the other's place."""
    return robot is other or not (any(_differences(robot, other)) or any(_differences(other, robot)))


def _differences(robot: Robot, own: Robot) -> Iterator[str]:
    """Say in what a robot differs from the scene's own so that a proof for it would be none for that."""
    if robot.files != own.files:
        yield f"{robot.name} was read from other files than the scene's {own.name}, or before they changed"
    if robot.base != own.base:
        yield "its base is not where the scene's is"
    for joint, value in own.locked.items():
        if robot.locked.get(joint) != value:
            yield f"its joint '{joint}' is not held where the scene's is"
    if robot.joint_names != own.joint_names:
        yield "other joints of it are planned than of the scene's"
    elif robot.followers != own.followers:
        yield "other joints of it follow than of the scene's"
    for joint, beyond in zip(own.joint_names, (robot.lower < own.lower) | (robot.upper > own.upper), strict=True):
        if beyond:
            yield f"its joint '{joint}' may go beyond the limits of the scene's"
    if robot.attached != own.attached:
        yield "it does not hold what the scene attaches"
    links = (robot.link_joint, robot.link_geometry) == (own.link_joint, own.link_geometry)
    if robot.model != own.model or robot.collision != own.collision or not links:
        yield "its joints, links or geometry are not those of the scene's"
    for pair in own.self_pairs:
        if pair not in robot.self_pairs:
            yield f"its links {pair[0]} and {pair[1]} are not checked against each other, the scene's are"


@made_once(KEPT_ROBOTS)
def _narrowed(robot: Robot, ranges: tuple[tuple[str, tuple[float, float]], ...]) -> Robot:
    """Return the robot with narrower position ranges, which must lie within its own."""
    lower, upper = robot.lower.copy(), robot.upper.copy()
    for joint, (low, high) in ranges:
        where = f"limits.position.{joint}"
        i = robot.index_of(joint, where)
        if not robot.lower[i] <= low < high <= robot.upper[i]:
            raise InputError(
                f"{where}: must be a range within the URDF's [{robot.lower[i]:g}, {robot.upper[i]:g}], "
                f"found [{low:g}, {high:g}]"
            )
        lower[i], upper[i] = low, high
    return _between(robot, lower, upper)


@made_once(KEPT_ROBOTS)
def _with_lag(robot: Robot, off: tuple[float, ...]) -> Robot:
    """Return the robot with position ranges in which joints stay that may be so far `off` from there (n,)."""
    lower, upper = robot.lower + np.array(off), robot.upper - np.array(off)
    if (gone := ~(lower < upper)).any():
        i = int(gone.argmax())
        raise InputError(
            f"robot.tracking.position: {off[i]:g} of joint '{robot.joint_names[i]}' leaves nothing of its range "
            f"[{robot.lower[i]:g}, {robot.upper[i]:g}]"
        )
    return _between(robot, lower, upper, "joint limits are kept with room for robot.tracking.position")


def _between(robot: Robot, lower: Array, upper: Array, *notes: str) -> Robot:
    """Return the robot with limits (n,) within its own."""
    inner = np.stack([np.maximum(robot.inner[0], lower), np.minimum(robot.inner[1], upper)])
    return replace(robot, lower=lower, upper=upper, inner=inner, notes=(*robot.notes, *notes))


@made_once(KEPT_ROBOTS)
def _all_kept_apart(robot: Robot) -> Robot:
    """Return the robot with the pairs checked too that never touch, where the scene requires more than that."""
    never = robot.never_touching
    left = {pair: reason for pair, reason in robot.unchecked.items() if reason != NEVER_TOUCHING}
    return replace(robot, self_pairs=(*robot.self_pairs, *never), unchecked=left) if never else robot


@made_once(KEPT_ROBOTS)
def _unchecked(robot: Robot) -> Robot:
    """Return the robot without self-collision checks."""
    bodies = "links and held objects" if robot.attached else "links"
    note = f"{bodies} are not checked against each other: self_collision: false"
    unchecked = {**robot.unchecked, **dict.fromkeys(robot.self_pairs, "self_collision: false")}
    return replace(robot, self_pairs=(), unchecked=unchecked, notes=(*robot.notes, note))


def _load_bare(scene: Scene) -> Robot:
    """Load the robot without the objects that it holds."""
    spec = scene.robot
    robot = _load_once(spec)
    held = {joint: value for joint, value in (scene.start.by_name or {}).items() if joint in robot.locked}
    if held:
        robot = _load_once(replace(spec, locked={**held, **spec.locked}))
    return _with_room(robot, scene)


@made_once(KEPT_ROBOTS)
def _holding(robot: Robot, attached: tuple[Attached, ...]) -> Robot:
    """Return the robot holding objects whose files were read."""
    from hdplan.planner.robot.attached import with_attached

    return with_attached(robot, attached)


def _with_room(robot: Robot, scene: Scene) -> Robot:
    """Widen the limits, by at most LIMIT_EXCESS, to ends of a request or a named state that lie beyond them, but not
    those of a joint that others follow; a plan goes beyond the robot's own (`Robot.inner`) at these ends alone."""
    lower, upper = robot.lower.copy(), robot.upper.copy()
    ends = [target for target in (scene.start, scene.goal) if isinstance(target, JointTarget)]
    for target in ends:
        given: Mapping[str, float] = {}
        if target.state is not None:
            given = robot.named_states.get(target.state, {})
        elif scene.from_request:
            given = target.by_name or dict(zip(robot.joint_names, target.positions or (), strict=False))
        for i, joint in enumerate(robot.joint_names):
            value = None if robot.followed[i] else given.get(joint)  # what follows may have limits of its own
            if value is not None and 0.0 < robot.lower[i] - value <= LIMIT_EXCESS:
                lower[i] = min(lower[i], value)
            if value is not None and 0.0 < value - robot.upper[i] <= LIMIT_EXCESS:
                upper[i] = max(upper[i], value)
    if np.array_equal(lower, robot.lower) and np.array_equal(upper, robot.upper):
        return robot
    return _with_limits(robot, tuple(lower.tolist()), tuple(upper.tolist()))


@made_once(KEPT_ROBOTS)
def _with_limits(robot: Robot, lower: tuple[float, ...], upper: tuple[float, ...]) -> Robot:
    words = tuple(
        f"joint '{joint}': limits [{robot.lower[i]:g}, {robot.upper[i]:g}] widened to "
        f"[{lower[i]:.9g}, {upper[i]:.9g}], as start or goal lies there"
        for i, joint in enumerate(robot.joint_names)
        if (lower[i], upper[i]) != (robot.lower[i], robot.upper[i])
    )
    return replace(robot, lower=np.array(lower), upper=np.array(upper), notes=(*robot.notes, *words))


def _surroundings(spec: RobotSpec) -> tuple[tuple[str, str], ...]:
    """Return the parts of the environment that may change a description: where ROS keeps packages; of xacro all of
    it."""
    if spec.urdf is not None and spec.urdf.suffix.lower() == XACRO:
        return tuple(sorted(os.environ.items()))
    return tuple((name, os.environ.get(name, "")) for name in OF_ROS)


def _load_once(spec: RobotSpec) -> Robot:
    key = (
        spec.name,
        spec.urdf,
        spec.srdf,
        spec.package_dirs,
        tuple(sorted(spec.xacro_args.items())),
        _surroundings(spec),
        spec.group,
        spec.base.matrix.tobytes(),
        spec.base_joints,
        tuple(sorted(spec.locked.items())),
        spec.ignore_pairs,
        spec.check_pairs,
    )
    with _loading:
        kept = _kept.get(key)
        if kept and stamps_of(file for file, *_ in kept.files) == kept.files and not kept.as_loaded.changed(kept):
            _kept.move_to_end(key)
            return kept
        robot = load_robot(spec)
        _kept[key] = robot
        while len(_kept) > KEPT_ROBOTS:
            _kept.popitem(last=False)
        return robot
