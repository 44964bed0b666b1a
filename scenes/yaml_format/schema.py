"""The scene format as a JSON Schema (draft 7), for editors: derived from the classes and checks that the reader uses.

The keys of a section are the fields of its class, with the few exceptions below; what a value may be follows from its
field's check (`scenes/values.py`). The schema and the reader agree about unknown and missing keys, types and ranges.
Only the reader checks what a schema cannot express: how values fit together, the content of files, that 40.0 is not an
integer and .nan not a number. What the sections are made of is in `schema_parts.py`.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Collection
from typing import Any

from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.clouds import RADIUS, Cloud, Ignored, radius_of
from hdplan.scenes.curve_stages import Along
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.job import KINDS, MOST_STAGES, Move, Set, Wait
from hdplan.scenes.limits import Limits, ranges
from hdplan.scenes.obstacles import Obstacle, SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import MOST_POSES, Follow, Relative, Upright, Within
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import rotation
from hdplan.scenes.robot_spec import PlanarBase, RobotSpec
from hdplan.scenes.sizes import Calibration, Tracking, Uncertainty
from hdplan.scenes.targets import PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import JointValue, Named, Number, Row, checks_of
from hdplan.scenes.voxel_grids import OctoMap, Voxels
from hdplan.scenes.yaml_format.job import OF_THE_ARM
from hdplan.scenes.yaml_format.reader import SECTIONS, VERSION
from hdplan.scenes.yaml_format.schema_parts import (
    BASE64,
    TEXT,
    Schema,
    given,
    list_of,
    not_both,
    not_empty,
    nullable,
    object_of,
    one_key_of,
    value_schema,
)
from hdplan.scenes.yaml_format.shape_fields import CLASSES, SHAPE_KEYS


def schema_text() -> str:
    """Return the schema as a JSON file."""
    return json.dumps(scene_schema(), indent=1, ensure_ascii=False) + "\n"


def scene_schema() -> Schema:
    """Return the schema of a scene file."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "hdplan scene",
        **object_of(
            {
                **{key: {} for key in SECTIONS},  # in their order; a section not listed below would allow anything
                "hdplan": {"const": VERSION},
                "robot": nullable(_robot()),
                "obstacles": nullable(list_of(_obstacle())),
                "attached": nullable(list_of(_section(Attached, pose=_pose(), shape=_shape()))),
                "start": one_key_of({"joints": _joints(), "state": TEXT}, _rates()),
                "goal": {"anyOf": [one_key_of(_goal(), _rates()), {"type": "null"}]},
                "from_request": {"type": ["boolean", "null"]},
                "self_collision": {
                    "anyOf": [{"type": ["boolean", "null"]}, not_empty(_section(SelfCollision, without=("checked",)))]
                },
                "limits": nullable(not_empty(_section(Limits, position=not_empty(value_schema(ranges))))),
                "payload": nullable(_section(Payload)),
                "path": nullable(not_empty(_path())),
                "timing": nullable(not_both(not_empty(_section(Timing)), "duration", "scale")),
                "planner": nullable(_section(PlannerSettings)),
                "job": nullable(
                    {**list_of({"anyOf": [_stage(), _repeated()]}), "minItems": 1, "maxItems": MOST_STAGES}
                ),
            },
            required=("hdplan", "start"),
            about="One planning problem.",
        ),
        "oneOf": [given("goal"), given("job")],
    }


def _section(kind: Any, without: Collection[str] = (), **instead: Schema) -> Schema:
    """Return an object whose keys are the fields of a class, without some of them; some with other schemas."""
    keys, required = {}, []
    for field in dataclasses.fields(kind):
        if not field.init or field.name in without:
            continue
        keys[field.name] = _field(field, instead.get(field.name) or value_schema(checks_of(kind)[field.name]))
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            required.append(field.name)
    if "name" in required:  # obstacles and held objects without one are numbered
        required.remove("name")
    return object_of(keys, required, kind.__doc__ or "")


def _field(field: dataclasses.Field[Any], schema: Schema) -> Schema:
    """Return the schema of a field with its default; a field with a default may be null."""
    if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING and field.name != "name":
        return schema
    shown = isinstance(field.default, bool | int | float | str)
    return {**nullable(schema), **({"default": field.default} if shown else {})}


def _placed(kind: Any) -> Schema:
    """Return a section with the keys of a pose beside its own."""
    own, pose = _section(kind, without=("pose", "field")), _pose()
    return {**own, "properties": {**own["properties"], **pose["properties"]}, "allOf": pose["allOf"]}


def _path() -> Schema:
    constraints = {
        "upright": _section(Upright),
        "position": _placed(Within),
        "relative": _section(Relative, pose=_pose()),
        "follow": _section(Follow, poses={**list_of(_pose()), "minItems": 2, "maxItems": MOST_POSES}),
    }
    return object_of({name: nullable(schema) for name, schema in constraints.items()})


def _stage() -> Schema:
    """Return one stage of a job: its kind, and what every stage may have."""
    limits, path = not_empty(_section(Limits, position=not_empty(value_schema(ranges)))), nullable(not_empty(_path()))
    common = _section(Wait, without=("seconds",), limits=limits)["properties"]
    own = {
        "move": one_key_of(_goal()),
        **{name: _section(KINDS[name], without=(*common, "blend")) for name in ("line", "circle")},
        **{name: _section(KINDS[name], without=tuple(common)) for name in ("grip", "release")},
        "along": _along((*common, "blend")),
        "set": {**value_schema(checks_of(Set)["outputs"]), "minProperties": 1},
        "wait": value_schema(checks_of(Wait)["seconds"]),
    }
    some = {"type": "object", "properties": {"joints": {"type": "object", "minProperties": 1}}, "required": ["joints"]}
    bare = {"not": {"anyOf": [given("link"), given("mass")]}}
    own["grip"] = {**own["grip"], "anyOf": [given("object"), {**some, **bare}]}
    own["release"] = {**own["release"], "anyOf": [given("object"), some]}
    own["line"] = {**own["line"], "oneOf": [given("by"), given("to")]}
    either = [{"oneOf": [given(name) for name in names]} for names in (("by", "to"), ("interim", "center"))]
    own["circle"] = {**own["circle"], "allOf": either}
    kinds: dict[str, Schema] = {kind: {"anyOf": [schema, {"type": "null"}]} for kind, schema in own.items()}
    beside = {"path": path, "blend": value_schema(checks_of(Move)["blend"])}
    alone = [{"anyOf": [*map(given, OF_THE_ARM[key]), {"not": given(key)}]} for key in beside]
    return {**object_of({**kinds, **common, **beside}), "oneOf": [given(kind) for kind in own], "allOf": alone}


def _repeated() -> Schema:
    """Return stages that are repeated over a table; what stands in them is known once they have its values."""
    some = {"type": "array", "items": {"type": "object"}, "minItems": 1}
    return one_key_of({"repeat": object_of({"over": some, "stages": some}, ("over", "stages"))})


def _along(common: Collection[str]) -> Schema:
    """Return a list of poses to be followed: in a file, or here."""
    section = _section(Along, without=("poses", *common))
    poses = {**list_of(_pose()), "minItems": 2, "maxItems": MOST_POSES}
    section["properties"] = {"file": nullable(TEXT), "poses": nullable(poses), **section["properties"]}
    return {**section, "oneOf": [given("file"), given("poses")]}


def _robot() -> Schema:
    sizes = {"tracking": not_empty(_section(Tracking)), "calibration": not_empty(_section(Calibration))}
    own = _section(RobotSpec, without=("source",), base=_pose(), base_joints=_section(PlanarBase), **sizes)
    robot = not_both(own, "name", "srdf")
    for key in ("package_dirs", "xacro_args"):
        robot = not_both(robot, "name", key)
    return {**robot, "oneOf": [given("name"), given("urdf"), {"type": "null"}]}


def _pose() -> Schema:
    turns = {"quaternion_xyzw": value_schema(rotation), "rpy": value_schema(Row(Number(unit="rad"), 3))}
    keys = {"position": value_schema(Row(Number(unit="m"), 3)), **turns}
    about = "A pose: position, and a unit quaternion (x, y, z, w) or roll, pitch and yaw as in URDF."
    return not_both(object_of({name: nullable(key) for name, key in keys.items()}, (), about), *turns)


def _shape() -> Schema:
    shapes = []
    for name, kind in CLASSES.items():
        keys, checks = SHAPE_KEYS[name], checks_of(kind)
        own = {
            key: value_schema(checks[key]) if needed else nullable(value_schema(checks[key]))
            for key, needed in keys.items()
        }
        required = ("type", *(key for key, needed in keys.items() if needed))
        shapes.append(object_of({"type": {"const": name}, **own}, required, kind.__doc__ or ""))
    return {"anyOf": shapes}


def _obstacle() -> Schema:
    """Return an obstacle's section: a shape, or in its place a cloud or a depth image."""
    unknown = not_empty(_section(Uncertainty))
    section = _section(Obstacle, pose=_pose(), shape=_shape(), motion=_motion(), uncertainty=unknown)
    solids = {"shape": section["properties"].pop("shape"), "cloud": _cloud(), "depth": _depth()}
    solids |= {"octomap": _octomap(), "voxels": _voxels()}
    keys = {"name": section["properties"].pop("name"), **{word: nullable(each) for word, each in solids.items()}}
    section["properties"] = {**keys, **section["properties"]}
    del section["required"]
    return {**section, "oneOf": [given(word) for word in solids]}


def _cloud() -> Schema:
    """Return a cloud: its points in a file, or here."""
    section = _of_cloud()
    points = {**list_of(value_schema(Row(Number(unit="m"), 3))), "minItems": 1}
    section["properties"] = {"file": nullable(TEXT), "points": nullable(points), **section["properties"]}
    section["properties"]["radius"] = value_schema(radius_of)
    return {**section, "required": ["radius"], "oneOf": [given("file"), given("points")]}


def _depth() -> Schema:
    """Return a depth image: in a file, or here."""
    section, camera = _of_cloud(("drop_nan",)), _section(DepthImage, without=("image",))
    image = {**list_of({**list_of({"type": "number"}), "minItems": 1}), "minItems": 1}
    own = {"file": nullable(TEXT), "image": nullable(image), **camera["properties"]}
    section["properties"] = {**own, **section["properties"], "radius": nullable(value_schema(RADIUS))}
    return {**section, "required": ["intrinsics"], "oneOf": [given("file"), given("image")]}


def _octomap() -> Schema:
    """Return an octomap: its file, or the content of that in base64."""
    section = _section(OctoMap, without=("source", "name", "pose"))
    content = {"type": "string", "pattern": BASE64}
    section["properties"] = {"file": nullable(TEXT), "content": nullable(content), **section["properties"]}
    return {**section, "required": [], "oneOf": [given("file"), given("content")]}


def _voxels() -> Schema:
    """Return a voxel grid: in a file, or here."""
    section = _section(Voxels, without=("occupied", "name", "pose"))
    grid = list_of(list_of({**list_of({"enum": [0, 1, False, True]}), "minItems": 1}))
    section["properties"] = {"file": nullable(TEXT), "occupied": nullable(grid), **section["properties"]}
    return {**section, "required": ["size"], "oneOf": [given("file"), given("occupied")]}


def _of_cloud(without: Collection[str] = ()) -> Schema:
    """Return the settings that all clouds have."""
    ignored = {**_section(Ignored), "oneOf": [given("link"), given("obstacle")]}
    left_out = ("points", "name", "pose", *without)
    return _section(Cloud, without=left_out, ignore={"anyOf": [ignored, list_of(ignored)]})


def _motion() -> Schema:
    return {"anyOf": [not_empty(_section(SteadyMotion)), _section(TimedPoses, poses=list_of(_pose()))]}


def _joints() -> Schema:
    """Return one configuration: a list of values, or values by name."""
    row, named = value_schema(Row(JointValue)), value_schema(Named(JointValue))
    return {"anyOf": [{**row, "minItems": 1}, not_empty(named)]}


def _rates() -> dict[str, Schema]:
    """Return the robot's rates at a configuration."""
    row, named = value_schema(Row(Number())), value_schema(Named(Number()))
    rates = {"anyOf": [{**row, "minItems": 1}, not_empty(named)]}
    return {"velocity": rates, "acceleration": rates}


def _goal() -> dict[str, Schema]:
    pose = _placed(PoseTarget)
    pose["required"] = ["position"]
    pose["properties"]["position"] = value_schema(Row(Number(unit="m"), 3))
    return {
        "joints": {"anyOf": [*_joints()["anyOf"], {**list_of(_joints()), "minItems": 1}]},
        "state": TEXT,
        "pose": pose,
        "poses": {**list_of(pose), "minItems": 1},
        "any": {**list_of(one_key_of({"joints": _joints(), "state": TEXT, "pose": pose})), "minItems": 1},
        "all": {**list_of(object_of({"pose": {**pose, "required": ["link", "position"]}}, ["pose"])), "minItems": 2},
    }
