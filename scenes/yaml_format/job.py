"""The `job` section: a list of stages, each a mapping with one of the keys of `KINDS` and, beside it, what every stage
may have."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any, assert_never

from hdplan.scenes.curve_stages import Along, Curve
from hdplan.scenes.fields import Field
from hdplan.scenes.job import KINDS, Grip, Job, Move, Release, Set, Stage, Wait, stages_of
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.pose_fields import read_poses
from hdplan.scenes.pose_table import read_pose_table
from hdplan.scenes.poses import Pose
from hdplan.scenes.stage import ArmStage
from hdplan.scenes.values import checks_of
from hdplan.scenes.yaml_format.effects import read_limits, read_path
from hdplan.scenes.yaml_format.repeat import repeated
from hdplan.scenes.yaml_format.targets import read_goal

COMMON = ("name", "touch", "limits", "speed")
OF_THE_ARM = {"blend": ("move", "line", "circle", "along"), "path": ("move",)}  # keys beside some kinds alone
OWN: dict[type[Stage], tuple[str, ...]] = {  # keys of each kind, which are fields of its class
    kind: tuple(each.name for each in dataclasses.fields(kind) if each.name not in (*COMMON, *OF_THE_ARM))
    for kind in KINDS.values()
}
DEFAULTS = ("frame", "free_rotation")  # are not written


def read_job(section: Field) -> Job:
    """Read the stages. Raises InputError for unknown kinds and keys, and for values that are not allowed."""
    return Job(section.checked(stages_of, [_stage(entry) for entry in _entries(section)]))


def _entries(section: Field) -> Iterator[Field]:
    """Yield the entries of all stages, those that are repeated once for each row."""
    for entry in section.items(of="stages"):
        if isinstance(entry.value, Mapping) and "repeat" in entry.value:
            yield from repeated(entry.mapping(("repeat",), required=["repeat"])["repeat"])
        else:
            yield entry


def _stage(entry: Field) -> Stage:
    keys = entry.mapping((*KINDS, *COMMON, *OF_THE_ARM))
    given = [kind for kind in KINDS if kind in keys]
    if len(given) != 1:
        found = f"has more than one of {', '.join(given)}" if given else f"has none of the keys {', '.join(KINDS)}"
        raise entry.error(f"{found}: a stage is of one kind")
    kind, content = given[0], keys[given[0]]
    make: Callable[..., Stage] = KINDS[kind]
    for key, kinds in OF_THE_ARM.items():
        if key in keys and kind not in kinds:
            raise keys[key].error(f"goes with {', '.join(map(repr, kinds))} alone")
    values: dict[str, Any] = {key: keys[key] for key in (*COMMON, *OF_THE_ARM) if key in keys}
    values |= {key: read(keys[key]) for key, read in (("limits", read_limits), ("path", read_path)) if key in keys}
    match kind:
        case "move":
            return entry.make(Move, goal=read_goal(content), **values)
        case "along":
            keys = content.mapping((*OWN[Along], "file"))
            poses = _poses(content, keys)
            own = {key: value for key, value in keys.items() if key != "file"}
            return _made(entry, kind, Along, {**own, "poses": poses}, values)
        case "line" | "circle" | "grip" | "release":
            return _made(entry, kind, make, content.mapping(OWN[KINDS[kind]]), values)
        case _:  # set and wait, of one value
            (name,) = OWN[KINDS[kind]]
            value = content.checked(checks_of(KINDS[kind])[name], content.value)
            return entry.make(make, **{name: value}, **values)


def _made(entry: Field, kind: str, make: Callable[..., Stage], own: dict[str, Any], common: dict[str, Any]) -> Stage:
    """Return a stage made of its own keys, at which errors are reported, and of those that every stage has."""
    bare = Field(entry.value, f"{entry.key}.{kind}", entry.document).make(make, **own)
    return entry.make(lambda **given: dataclasses.replace(bare, **given), **common)


def _poses(content: Field, keys: dict[str, Field]) -> tuple[Pose, ...]:
    """Return the poses that stand here, or those of the file that is named."""
    if ("file" in keys) == ("poses" in keys):
        raise content.error("needs either file or poses")
    return read_pose_table(keys["file"].path()) if "file" in keys else read_poses(keys["poses"])


def stage_entry(stage: Stage, target: Callable[[Any], Any], effects: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
    """Return a stage as it is written; `target` writes a goal, `effects` the sections limits and path."""
    match stage:
        case Move():
            content: Any = target(stage.goal)
        case Curve() | Grip() | Release():
            usual = {each.name: each.default for each in dataclasses.fields(stage) if each.name in DEFAULTS}
            written = {key: getattr(stage, key) for key in OWN[type(stage)]}
            content = {key: value for key, value in written.items() if value not in (None, {}, usual.get(key))}
        case Set():
            content = stage.outputs
        case Wait():
            content = stage.seconds
        case _:
            assert_never(stage)
    entry: dict[str, Any] = {stage.kind: content}
    if stage.name is not None:
        entry["name"] = stage.name
    if stage.touch:
        entry["touch"] = stage.touch
    if stage.limits is not None:
        entry["limits"] = effects(stage.limits)
    if isinstance(stage, Move) and stage.path != PathConstraints():
        entry["path"] = effects(stage.path)
    if stage.speed != 1.0:
        entry["speed"] = stage.speed
    if isinstance(stage, ArmStage) and stage.blend:
        entry["blend"] = stage.blend
    return entry
