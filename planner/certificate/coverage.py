"""Coverage of a scene by its certificate: the scene's demands on a motion, against the checks that were made.

The demands are read off the fields of the scene's own classes, and nothing here knows which checks there are; each
check names the fields that it covered. A new field is therefore required at once, whether or not anybody checks it:
there is no certificate until somebody does. Names are those of the scene's fields: "limits.jerk", "obstacles.shelf".
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from hdplan.planner.certificate.intervals import Bodies, Pairs
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.tracking import tracking_of_all
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.clouds import Cloud, Ignored
from hdplan.scenes.curve_stages import Along, Circle, Line
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.job import Grip, Job, Move, Release, Set, Wait
from hdplan.scenes.limits import QUANTITIES, Limits
from hdplan.scenes.obstacles import Obstacle, SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import Follow, PathConstraints, Relative, Upright, Within
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import PlanarBase, RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Solid
from hdplan.scenes.sizes import Calibration, Tracking, Uncertainty, chord
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.voxel_grids import OctoMap, Voxels

ANY_FIELD = "*"  # fields of a class each of which is required by its own name
FIELDS: Mapping[type, str] = {  # of each class of a scene: the fields that the certificate knows, alone or by a check
    Scene: (
        "name source robot obstacles start goal planner from_request attached self_collision limits payload path "
        "timing job notes"  # a job is required by its name, and no check of a single motion covers it
    ),
    RobotSpec: (
        "name urdf srdf package_dirs xacro_args group base base_joints locked ignore_pairs check_pairs "
        "tracking calibration source"
    ),
    PlanarBase: "x y yaw kind",
    Obstacle: "name shape pose clearance motion uncertainty",
    **dict.fromkeys((Uncertainty, Tracking, Calibration), ANY_FIELD),
    SteadyMotion: "velocity spin",
    TimedPoses: "times poses",
    Cloud: "points radius voxel drop_nan ignore_robot ignore name pose",
    Ignored: "margin link obstacle",
    DepthImage: "image intrinsics scale range",
    Voxels: "occupied size origin name pose",
    OctoMap: "source unknown name pose",
    Attached: "name link shape pose touch_links mass",
    SelfCollision: "checked clearance",
    JointTarget: "field positions by_name state velocity acceleration",
    PoseTarget: "link pose position_tolerance orientation_tolerance free_rotation field",
    AllOf: "poses field",
    Goals: "targets field",
    Limits: ANY_FIELD,
    Payload: "link mass com inertia",
    PathConstraints: ANY_FIELD,
    Upright: "link axis tolerance",
    Within: "link size pose point",
    Relative: "link to pose position_tolerance orientation_tolerance",
    Follow: (
        "link poses position_tolerance orientation_tolerance free_rotation speed acceleration begin_tolerance "
        "end_tolerance"
    ),
    PlannerSettings: (  # all but the clearance are about how a motion is found
        "waypoints clearance activation gamma shaping_length distance link_bodies swept normals polish objective"
    ),
    Timing: "duration scale rate",  # how a motion is made: what is certified lasts as long as it lasts
    Job: "stages",  # each of which has a scene of its own
    **dict.fromkeys((Move, Line, Circle, Along, Grip, Release, Set, Wait), ANY_FIELD),
    Pose: "position quaternion_xyzw",
    FixedArray: "array left_out",
}


END_RATES = ("velocity", "acceleration")  # of an end that has them
NUMBERS = (float, int, str)  # which hold nothing


class UncheckedError(RuntimeError):
    """A fault of hdplan: something that the scene requires of a motion was not checked, so that there is no
    certificate."""


def refuse_gaps(required: frozenset[str], checked: frozenset[str]) -> None:
    """Raise UncheckedError unless all demands were checked, and nothing else."""
    if required == checked:
        return
    if missing := sorted(required - checked):
        raise UncheckedError(f"no certificate: the scene requires {', '.join(missing)}, which no check covers")
    raise UncheckedError(
        f"no certificate: checks cover {', '.join(sorted(checked - required))}, which the scene does not require"
    )


def ends_of(scene: Scene) -> frozenset[str]:
    """Return a scene's requirements on the ends of a motion, by name."""
    ends = {"start": scene.start, "goal": scene.goal}
    given = ((end, rate) for end, at in ends.items() for rate in END_RATES if getattr(at, rate, None) is not None)
    return frozenset({*ends, *(f"{end}.{rate}" for end, rate in given)})


def required_of(scene: Scene, robot: Robot) -> frozenset[str]:
    """Return a scene's requirements on a motion of its robot, by name, besides its ends (`ends_of`). Raises
    UncheckedError for a requirement that this module does not know."""
    if unknown := sorted(_unknown(scene, "")):
        raise UncheckedError(f"no certificate: the certificate does not know {', '.join(unknown)}")
    return frozenset(_required(scene, robot))


def _of_pair(one: str, other: str) -> str:
    return f"robot.check_pairs: {one}, {other}"


def _required(scene: Scene, robot: Robot) -> Iterator[str]:
    yield from (f"robot: {link}" for link in robot.links)
    for obstacle in scene.obstacles:
        where = f"obstacles.{obstacle.name}"
        yield where
        yield from (
            f"{where}.{name}" for name in ("clearance", "motion", "uncertainty") if getattr(obstacle, name) is not None
        )
    yield from (f"attached.{held.name}" for held in scene.attached)
    if scene.job is not None:
        yield "job"
    if (tracking := scene.robot.tracking) is not None:
        yield from (f"robot.tracking.{each.name}" for each in fields(tracking) if getattr(tracking, each.name))
    if scene.robot.calibration is not None:
        yield "robot.calibration"
    if scene.self_collision.checked:
        yield "self_collision"
        yield from (_of_pair(*pair) for pair in scene.robot.check_pairs)
    limited = {each.name for each in fields(scene.limits) if getattr(scene.limits, each.name) not in (None, {})}
    yield from (f"limits.{name}" for name in ({*limited, "velocity"} if scene.timed else limited))
    for each in fields(scene.path):
        if (constraint := getattr(scene.path, each.name)) is not None:
            names = [part.name for part in fields(constraint) if getattr(constraint, part.name) is not None]
            parts = [name for name in names if name.endswith(("_tolerance", "speed", "acceleration"))]  # one proof each
            yield from (f"path.{each.name}.{part}" for part in parts) if parts else (f"path.{each.name}",)
    if any(name in limited and each.order is None for name, each in QUANTITIES.items()):  # which depend on masses
        yield from ["payload"] if scene.payload is not None else []
        yield from (f"attached.{held.name}.mass" for held in scene.attached if held.mass is not None)


def _unknown(value: Any, where: str) -> Iterator[str]:
    """Yield the values and fields within a scene that this module does not know. Shapes are their own affair:
    `exact_proximity.PIECES` and `geometry.shapes.TABLE` know all of their fields, or fail."""
    kind: Any = type(value)
    known, names = _known(kind)
    if known is None:
        yield f"{where or 'a scene'} of class {kind.__name__}"
    for name in names:
        inner, place = getattr(value, name), f"{where}.{name}" if where else name
        if known is not None and name not in known:
            yield place
        for i, each in enumerate(inner) if isinstance(inner, tuple) else ():
            if type(each) not in NUMBERS:
                yield from _unknown(each, f"{place}[{i}]")
        if type(inner) not in NUMBERS:
            yield from _unknown(inner, place)


@functools.cache
def _known(kind: type[Any]) -> tuple[frozenset[str] | None, tuple[str, ...]]:
    """Return the fields of a class that are known, None for a class of a scene that is not, and all its fields."""
    if not is_dataclass(kind) or issubclass(kind, Solid):
        return frozenset(), ()
    names, listed = tuple(each.name for each in fields(kind)), FIELDS.get(kind)
    return None if listed is None else frozenset(names if listed == ANY_FIELD else listed.split()), names


def compared(scene: Scene, robot: Robot, bodies: Bodies, pairs: Pairs, floor: Array, own: int) -> frozenset[str]:
    """Return the links, obstacles and ranges covered by these pairs of bodies, and by the robot's limits.

    The robot's `own` bodies come first. An obstacle is covered if every piece of it is in a pair with every body of the
    robot that moves relative to it; `floor` (P,) [m] is what pairs must keep.
    """
    return frozenset(
        {
            *_of_robot(scene, robot, bodies.names[:own]),
            *_of_obstacles(scene, bodies, pairs, floor, own),
            *_of_self_pairs(scene, robot, bodies, pairs, floor, own),
            *_of_sizes(scene, robot, bodies),
        }
    )


def _of_robot(scene: Scene, robot: Robot, names: Sequence[str]) -> Iterator[str]:
    there = {*names}
    yield from (f"robot: {link}" for link in robot.links if link in there)
    yield from (f"attached.{held.name}" for held in scene.attached if held in robot.attached and held.name in there)
    if scene.limits.position and all(_keeps(robot, joint, span) for joint, span in scene.limits.position.items()):
        yield "limits.position"


def _keeps(robot: Robot, joint: str, span: Sequence[float]) -> bool:
    """True if the robot's own limits keep a joint within a range."""
    if joint not in robot.joint_names:
        return False
    i = robot.joint_names.index(joint)
    return bool(span[0] <= robot.lower[i] and robot.upper[i] <= span[1])


def _of_obstacles(scene: Scene, bodies: Bodies, pairs: Pairs, floor: Array, own: int) -> Iterator[str]:
    outside = pairs.group == 0
    met = np.bincount(pairs.b[outside], minlength=len(bodies.names))
    least = np.full(len(bodies.names), np.inf)
    if any(obstacle.clearance is not None for obstacle in scene.obstacles):
        np.minimum.at(least, pairs.b[outside], floor[outside])
    moving = np.count_nonzero(bodies.chain.carried_by[bodies.joint[:own]].any(axis=1))
    whole = met == np.where(bodies.free, own, moving)
    rows = _rows(bodies.names, own)
    for obstacle in scene.obstacles:
        pieces, where = rows.get(obstacle.name, []), f"obstacles.{obstacle.name}"
        if not pieces or not whole[pieces].all():
            continue
        yield where
        if obstacle.motion is not None and bodies.drifting[pieces].all():
            yield f"{where}.motion"
        if (unknown := obstacle.uncertainty) is not None and _are_known(bodies, pieces, unknown):
            yield f"{where}.uncertainty"
        if obstacle.clearance is not None and (least[pieces] >= obstacle.clearance).all():
            yield f"{where}.clearance"


def _of_sizes(scene: Scene, robot: Robot, bodies: Bodies) -> Iterator[str]:
    """Yield which sizes of the robot are those of the bodies."""
    sizes, calibration, lag = bodies.sizes, scene.robot.calibration, scene.robot.tracking
    if sizes is None:
        return
    if lag is not None and lag.position and (sizes.joints >= tracking_of_all(scene, robot)).all():
        yield "robot.tracking.position"
    if calibration and sizes.base[0] >= calibration.position and sizes.base[1] >= chord(calibration.orientation):
        yield "robot.calibration"


def _are_known(bodies: Bodies, pieces: Sequence[int], unknown: Uncertainty) -> bool:
    """True if pieces of an obstacle may be as far from their places as the scene's sizes allow."""
    if (sizes := bodies.sizes) is None:
        return False
    far = (sizes.position[pieces] >= unknown.position) & (sizes.turn[pieces] >= chord(unknown.orientation))
    return bool((far & (sizes.speed[pieces] >= unknown.speed)).all())


def _of_self_pairs(scene: Scene, robot: Robot, bodies: Bodies, pairs: Pairs, floor: Array, own: int) -> Iterator[str]:
    """Yield whether every pair of links is there that may not be left out and that moves relative to each other, each
    body of the one with each of the other."""
    inside, count = pairs.group == 1, len(robot.links)
    if not scene.self_collision.checked or (floor[inside] < scene.self_collision.clearance).any():
        return
    number = {link: i for i, link in enumerate(robot.links)}
    link = np.array([number[name] for name in bodies.names[:own]], dtype=np.int64)
    ends = np.sort(np.stack([link[pairs.a[inside]], link[pairs.b[inside]]]), axis=0)
    codes, found = np.unique(ends[0] * count + ends[1], return_counts=True)
    met = np.zeros(count * count, dtype=np.int64)
    met[codes] = found
    pieces = np.bincount(link, minlength=count)
    carried = bodies.chain.carried_by[np.array([robot.link_joint[each] for each in robot.links], dtype=np.int64)]
    due = np.triu((carried[:, None] != carried[None]).any(axis=2), 1)
    for one, other in robot.unchecked.keys() - {*robot.never_touching}:
        if one in number and other in number:
            due[min(number[one], number[other]), max(number[one], number[other])] = False
    compared = met.reshape(count, count) >= pieces[:, None] * pieces
    if compared[due].all():
        yield "self_collision"
    for pair in scene.robot.check_pairs:  # what moves as one, or has no geometry, cannot meet
        rows = sorted(number[link] for link in pair if link in number)
        if len(rows) < 2 or compared[rows[0], rows[1]] or not (carried[rows[0]] != carried[rows[1]]).any():
            yield _of_pair(*pair)


def _rows(names: Sequence[str], own: int) -> dict[str, list[int]]:
    """Return the rows of the bodies of each obstacle."""
    rows: dict[str, list[int]] = {}
    for row in range(own, len(names)):
        rows.setdefault(names[row], []).append(row)
    return rows
