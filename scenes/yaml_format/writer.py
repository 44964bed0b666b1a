"""A `Scene` becomes a hdplan scene file, one line per obstacle or held object, that `load_scene` reads back equal.

Every value is written in YAML's flow style (`yaml_text`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, assert_never

from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.clouds import Cloud, Ignored
from hdplan.scenes.curve_stages import Along, Circle, Line
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.job import Grip, Job, Move, Release, Set, Wait
from hdplan.scenes.limits import QUANTITIES, JointValues, Limits
from hdplan.scenes.obstacles import Obstacle, Seen, SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import Follow, PathConstraint, PathConstraints, Relative, Upright, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import PlanarBase, RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.sizes import Calibration, Tracking, Uncertainty
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import require_fields
from hdplan.scenes.voxel_grids import OctoMap, Voxels
from hdplan.scenes.yaml_format.job import stage_entry
from hdplan.scenes.yaml_format.seen import seen_entry
from hdplan.scenes.yaml_format.shape_fields import shape_entry
from hdplan.scenes.yaml_text import flow_style

VERSION = 1
CURVE = "link position_tolerance orientation_tolerance free_rotation tool_speed tool_acceleration"
WRITTEN: Mapping[type, str] = {  # all that there is of each class; what writes itself by its fields is not listed
    Scene: (
        "name source robot obstacles start goal planner from_request attached self_collision limits payload path "
        "timing job notes"
    ),
    RobotSpec: (
        "name urdf srdf package_dirs xacro_args group base base_joints locked ignore_pairs check_pairs "
        "tracking calibration source"
    ),
    PlanarBase: "x y yaw kind",
    Pose: "position quaternion_xyzw",
    Obstacle: "name shape pose clearance motion uncertainty",
    Uncertainty: "position orientation speed",
    Tracking: "position velocity",
    Calibration: "position orientation",
    SteadyMotion: "velocity spin",
    TimedPoses: "times poses",
    Cloud: "points radius voxel drop_nan ignore_robot ignore name pose",
    Ignored: "margin link obstacle",
    DepthImage: "image intrinsics scale range",
    Voxels: "occupied size origin name pose",
    OctoMap: "source unknown name pose",
    Attached: "name link shape pose touch_links mass",
    JointTarget: "field positions by_name state velocity acceleration",
    PoseTarget: "link pose position_tolerance orientation_tolerance free_rotation field",
    SelfCollision: "checked clearance",
    Payload: "link mass com inertia",
    Upright: "link axis tolerance",
    Within: "link size pose point",
    Relative: "link to pose position_tolerance orientation_tolerance",
    Follow: (
        "link poses position_tolerance orientation_tolerance free_rotation speed acceleration begin_tolerance "
        "end_tolerance"
    ),
    Timing: "duration scale rate",
    Job: "stages",
    Move: "name touch limits speed blend goal path",
    Line: f"name touch limits speed blend {CURVE} by to frame turn rpy",
    Circle: f"name touch limits speed blend {CURVE} by to frame turn rpy interim center",
    Along: f"name touch limits speed blend {CURVE} poses frame",
    Grip: "name touch limits speed joints object link mass",
    Release: "name touch limits speed joints object",
    Set: "name touch limits speed outputs",
    Wait: "name touch limits speed seconds",
}
for _kind, _known in WRITTEN.items():
    require_fields(_kind, _known)


def scene_text(scene: Scene) -> str:
    """Return the scene as YAML. Files that it names are written with absolute paths, so it may be saved anywhere."""
    spec, moved = scene.robot, scene.robot.base_joints
    robot = {
        "name": spec.name,
        "urdf": spec.urdf and _path(spec.urdf),
        "srdf": spec.srdf and _path(spec.srdf),
        "package_dirs": [_path(folder) for folder in spec.package_dirs],
        "xacro_args": dict(spec.xacro_args),
        "group": list(spec.group) if isinstance(spec.group, tuple) else spec.group,
        "base": _pose(spec.base),
        "base_joints": {key: list(getattr(moved, key)) for key in ("x", "y", "yaw")} if moved else None,
        "locked": dict(spec.locked),
        "ignore_pairs": [list(pair) for pair in spec.ignore_pairs],
        "check_pairs": [list(pair) for pair in spec.check_pairs],
        "tracking": _sizes(spec.tracking),
        "calibration": _sizes(spec.calibration),
    }
    lines = [
        f"hdplan: {VERSION}",
        "robot:",
        *(f"  {key}: {flow_style(value)}" for key, value in robot.items() if value),
    ]
    lines += ["obstacles:", *(f"  - {flow_style(_obstacle(obstacle))}" for obstacle in scene.obstacles)]
    if not scene.obstacles:
        lines[-1] += " []"
    if scene.attached:
        lines += ["attached:", *(f"  - {flow_style(_attached(held))}" for held in scene.attached)]
    ends = {"start": scene.start, **({"goal": scene.goal} if scene.job is None else {})}
    lines += [f"{name}: {flow_style(_target(target))}" for name, target in ends.items()]
    if scene.from_request:
        lines.append("from_request: true")
    lines += [f"{name}: {flow_style(section)}" for name, section in _effects(scene).items()]
    settings = {field.name: getattr(scene.planner, field.name) for field in fields(scene.planner)}
    changed = {name: value for name, value in settings.items() if value != type(scene.planner).__dict__[name]}
    if changed:
        lines.append(f"planner: {flow_style(changed)}")
    if scene.job is not None:
        stages = (stage_entry(stage, _target, _pose, _own_effects) for stage in scene.job.stages)
        lines += ["job:", *(f"  - {flow_style(stage)}" for stage in stages)]
    return "\n".join(lines) + "\n"


def obstacle_text(obstacle: Obstacle) -> str:
    """Return an obstacle as a line of a scene's section `obstacles`."""
    return f"- {flow_style(_obstacle(obstacle))}"


def _obstacle(obstacle: Obstacle) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": obstacle.name}
    if isinstance(obstacle.shape, Seen):
        entry |= seen_entry(obstacle.shape, _path)
    else:
        entry["shape"] = shape_entry(obstacle.shape, _path)
    if not isinstance(obstacle.motion, TimedPoses):
        entry["pose"] = _pose(obstacle.pose)
    if obstacle.clearance is not None:
        entry["clearance"] = obstacle.clearance
    if obstacle.uncertainty is not None:
        entry["uncertainty"] = _sizes(obstacle.uncertainty)
    match obstacle.motion:
        case SteadyMotion(velocity, spin):
            entry["motion"] = {"velocity": list(velocity), "spin": list(spin)}
        case TimedPoses(times, poses):
            entry["motion"] = {"times": list(times), "poses": [_pose(pose) for pose in poses]}
        case None:
            pass
        case _:
            assert_never(obstacle.motion)
    return entry


def _sizes(given: Uncertainty | Tracking | Calibration | None) -> dict[str, Any]:
    """Return sizes of what is unknown, without those that are 0."""
    named = {} if given is None else {each.name: _joint_values(getattr(given, each.name)) for each in fields(given)}
    return {name: value for name, value in named.items() if value}


def _attached(held: Attached) -> dict[str, Any]:
    entry = {"name": held.name, "link": held.link, "shape": shape_entry(held.shape, _path), "pose": _pose(held.pose)}
    return {**entry, "touch_links": list(held.touch_links), **({} if held.mass is None else {"mass": held.mass})}


def _effects(scene: Scene) -> dict[str, Any]:
    """Return the sections that switch an effect on, by name, without those at their defaults."""
    own, limits, payload, path, timing = scene.self_collision, scene.limits, scene.payload, scene.path, scene.timing
    sections: dict[str, Any] = {}
    if own != SelfCollision():
        sections["self_collision"] = {"clearance": own.clearance} if own.checked else False
    if limits != Limits():
        sections["limits"] = _own_effects(limits)
    if payload is not None:
        inertia = list(payload.inertia)
        sections["payload"] = {"link": payload.link, "mass": payload.mass, "com": list(payload.com), "inertia": inertia}
    if path != PathConstraints():
        sections["path"] = _own_effects(path)
    if timing is not None:
        when = {"scale": timing.scale} if timing.duration is None else {"duration": timing.duration}
        sections["timing"] = {**when, "rate": timing.rate}
    return sections


def _own_effects(given: Limits | PathConstraints) -> dict[str, Any]:
    """Return a section of limits or of path constraints, a scene's or a stage's."""
    if isinstance(given, PathConstraints):
        return {name.removeprefix("path."): _constraint(each) for name, each in given.given.items()}
    rates = {name: _joint_values(getattr(given, name)) for name in QUANTITIES}
    ranges = {joint: list(span) for joint, span in given.position.items()}
    return {name: value for name, value in {"position": ranges or None, **rates}.items() if value}


def _constraint(constraint: PathConstraint) -> dict[str, Any]:
    match constraint:
        case Upright(link, axis, tolerance):
            return {"link": link, "axis": list(axis), "tolerance": tolerance}
        case Within(link, size, pose, point):
            return {"link": link, "size": list(size), **_pose(pose), "point": list(point)}
        case Relative(link, to, pose, place, turn):
            where = {} if pose is None else {"pose": _pose(pose)}
            return {"link": link, "to": to, **where, "position_tolerance": place, "orientation_tolerance": turn}
        case Follow():
            given = {each.name: getattr(constraint, each.name) for each in fields(constraint)}
            given["poses"] = [_pose(pose) for pose in constraint.poses]
            return {name: value for name, value in given.items() if value is not None}
        case _:
            assert_never(constraint)


def _joint_values(values: JointValues | None) -> Any:
    if isinstance(values, Mapping):
        return dict(values)
    return list(values) if isinstance(values, tuple) else values


def _pose(pose: Pose) -> dict[str, Any]:
    return {"position": list(pose.position), "quaternion_xyzw": list(pose.quaternion_xyzw)}


def _target(target: JointTarget | Goals) -> dict[str, Any]:
    if isinstance(target, Goals):
        if isinstance(target.targets[0], AllOf):
            return {"all": [{"pose": _pose_target(each)} for each in target.targets[0].poses]}
        choice = [_one_of(each) for each in target.targets if not isinstance(each, AllOf)]
        kinds = {key for entry in choice for key in entry}
        if kinds == {"pose"}:
            return choice[0] if len(choice) == 1 else {"poses": [entry["pose"] for entry in choice]}
        return {"joints": [entry["joints"] for entry in choice]} if kinds == {"joints"} else {"any": choice}
    return _one_of(target)


def _one_of(target: JointTarget | PoseTarget) -> dict[str, Any]:
    if isinstance(target, PoseTarget):
        return {"pose": _pose_target(target)}
    given = {"velocity": target.velocity, "acceleration": target.acceleration}
    rates = {name: _joint_values(values) for name, values in given.items() if values is not None}
    if target.state is not None:
        return {"state": target.state, **rates}
    values = list(target.positions) if target.positions is not None else dict(target.by_name or {})
    return {"joints": values, **rates}


def _pose_target(target: PoseTarget) -> dict[str, Any]:
    free = target.free_rotation == "all"
    placement = {"position": list(target.pose.position)} if free else _pose(target.pose)
    turn = {} if free else {"orientation_tolerance": target.orientation_tolerance}
    tolerances = {"position_tolerance": target.position_tolerance, **turn}
    link = {} if target.link is None else {"link": target.link}
    return {**link, **placement, **tolerances, "free_rotation": target.free_rotation}


def _path(path: Path) -> str:
    return str(path.absolute())  # not resolved: the name of a symbolic link tells the kind of file
