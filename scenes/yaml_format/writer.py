"""A `Scene` becomes a hdplan scene file, one line per obstacle or held object, that `load_scene` reads back equal.

Every value is written in YAML's flow style (`yaml_text`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, assert_never

from hdplan.scenes.attached import Attached
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.job import Move, Set, Wait
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import Obstacle, Seen, SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import Follow, PathConstraint, PathConstraints, Relative, Upright, Within
from hdplan.scenes.scene import Scene
from hdplan.scenes.sizes import Calibration, Tracking, Uncertainty
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import require_fields
from hdplan.scenes.voxel_grids import OctoMap, Voxels
from hdplan.scenes.yaml_format.job import stage_entry
from hdplan.scenes.yaml_format.seen import seen_entry
from hdplan.scenes.yaml_format.shape_fields import shape_entry
from hdplan.scenes.yaml_text import by_fields, flow_style

VERSION = 1
WRITTEN: Mapping[type, str] = {  # the fields of classes that are taken apart here; all others write all of theirs
    Scene: (
        "name source robot obstacles start goal planner from_request attached self_collision limits payload path "
        "timing job notes"
    ),
    Obstacle: "name shape pose clearance motion uncertainty",
    Cloud: "points radius voxel drop_nan ignore_robot ignore name pose",
    DepthImage: "image intrinsics scale range",
    Voxels: "occupied size origin name pose",
    OctoMap: "source unknown name pose",
    JointTarget: "field positions by_name state velocity acceleration",
    PoseTarget: "link pose position_tolerance orientation_tolerance free_rotation field",
    SelfCollision: "checked clearance",
    Within: "link size pose point",
    Timing: "duration scale rate",
    Move: "name touch limits speed blend goal path",
    Set: "name touch limits speed outputs",
    Wait: "name touch limits speed seconds",
}
for _kind, _known in WRITTEN.items():
    require_fields(_kind, _known)


def scene_text(scene: Scene) -> str:
    """Return the scene as YAML. Files that it names are written with absolute paths, so it may be saved anywhere."""
    spec = scene.robot
    robot = {**by_fields(spec), "tracking": _sizes(spec.tracking), "calibration": _sizes(spec.calibration)}
    del robot["source"]
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
        stages = (stage_entry(stage, _target, _own_effects) for stage in scene.job.stages)
        lines += ["job:", *(f"  - {flow_style(stage)}" for stage in stages)]
    return "\n".join(lines) + "\n"


def obstacle_text(obstacle: Obstacle) -> str:
    """Return an obstacle as a line of a scene's section `obstacles`."""
    return f"- {flow_style(_obstacle(obstacle))}"


def _obstacle(obstacle: Obstacle) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": obstacle.name}
    if isinstance(obstacle.shape, Seen):
        entry |= seen_entry(obstacle.shape)
    else:
        entry["shape"] = shape_entry(obstacle.shape)
    if not isinstance(obstacle.motion, TimedPoses):
        entry["pose"] = obstacle.pose
    if obstacle.clearance is not None:
        entry["clearance"] = obstacle.clearance
    if obstacle.uncertainty is not None:
        entry["uncertainty"] = _sizes(obstacle.uncertainty)
    match obstacle.motion:
        case SteadyMotion() | TimedPoses():
            entry["motion"] = obstacle.motion
        case None:
            pass
        case _:
            assert_never(obstacle.motion)
    return entry


def _sizes(given: Uncertainty | Tracking | Calibration | None) -> dict[str, Any]:
    """Return sizes of what is unknown, without those that are 0."""
    return {} if given is None else {name: value for name, value in by_fields(given).items() if value}


def _attached(held: Attached) -> dict[str, Any]:
    return {**by_fields(held), "shape": shape_entry(held.shape)}


def _effects(scene: Scene) -> dict[str, Any]:
    """Return the sections that switch an effect on, by name, without those at their defaults."""
    own, limits, payload, path, timing = scene.self_collision, scene.limits, scene.payload, scene.path, scene.timing
    sections: dict[str, Any] = {}
    if own != SelfCollision():
        sections["self_collision"] = {"clearance": own.clearance} if own.checked else False
    if limits != Limits():
        sections["limits"] = _own_effects(limits)
    if payload is not None:
        sections["payload"] = payload
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
    return {name: value for name, value in by_fields(given).items() if value}


def _constraint(constraint: PathConstraint) -> Any:
    match constraint:
        case Within(link, size, pose, point):
            return {"link": link, "size": size, **by_fields(pose), "point": point}
        case Upright() | Relative() | Follow():
            return constraint
        case _:
            assert_never(constraint)


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
    rates = {name: value for name, value in by_fields(target).items() if name in ("velocity", "acceleration")}
    if target.state is not None:
        return {"state": target.state, **rates}
    return {"joints": target.by_name if target.positions is None else target.positions, **rates}


def _pose_target(target: PoseTarget) -> dict[str, Any]:
    free = target.free_rotation == "all"
    placement = {"position": target.pose.position} if free else by_fields(target.pose)
    turn = {} if free else {"orientation_tolerance": target.orientation_tolerance}
    tolerances = {"position_tolerance": target.position_tolerance, **turn}
    link = {} if target.link is None else {"link": target.link}
    return {**link, **placement, **tolerances, "free_rotation": target.free_rotation}
