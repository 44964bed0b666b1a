"""The scene format as a JSON Schema (draft 7), for editors: derived from the classes and checks that the reader uses.

The keys of a section are the fields of its class, with the few exceptions below; what a value may be follows from its
field's check (`scenes/values.py`). The schema and the reader agree about unknown and missing keys, types and ranges.
Only the reader checks what a schema cannot express: how values fit together, the content of files, that 40.0 is not an
integer and .nan not a number.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any

from hdplan.scenes.attached import Attached, Payload, body_inertia
from hdplan.scenes.clouds import RADIUS, Cloud, Ignored, radius_of
from hdplan.scenes.curve_stages import Along
from hdplan.scenes.depth_images import DepthImage, measured, pinhole
from hdplan.scenes.job import KINDS, MOST_STAGES, Move, Set, Wait, fingers_of, outputs_of
from hdplan.scenes.limits import JointQuantity, Limits, ranges
from hdplan.scenes.obstacles import Obstacle, SelfCollision, SteadyMotion, TimedPoses, rising_times
from hdplan.scenes.path_constraints import AXES, MOST_POSES, Follow, Relative, Upright, Within, direction, extent
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import rotation
from hdplan.scenes.robot_spec import PlanarBase, RobotSpec, argument, group_of, pair, span
from hdplan.scenes.shapes import axis_factors, volume
from hdplan.scenes.sizes import Calibration, JointSize, Tracking, Uncertainty
from hdplan.scenes.stage import touching
from hdplan.scenes.targets import PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import (
    LARGEST_NUMBER,
    SMALLEST_NUMBER,
    Check,
    Choice,
    JointValue,
    Maybe,
    Named,
    Number,
    Row,
    Whole,
    absolute_path,
    boolean,
    checks_of,
    text,
)
from hdplan.scenes.voxel_grids import OctoMap, Voxels
from hdplan.scenes.yaml_format.job import OF_THE_ARM
from hdplan.scenes.yaml_format.reader import SECTIONS, VERSION
from hdplan.scenes.yaml_format.shape_fields import CLASSES, SHAPE_KEYS

Schema = dict[str, Any]

TEXT: Schema = {
    "type": "string",
    "pattern": r"\S",
    "not": {"type": "string", "pattern": r"[\x00-\x1f\x7f-\x9f\u2028\u2029]"},
}
FORMS: Mapping[Check, Check | tuple[Check, ...]] = {  # of checks that a schema cannot express in full: one of these
    rotation: Row(Number(), 4),
    direction: (Choice(AXES), Row(Number(), 3)),
    volume: Row(Row(Number(unit="m"), 3)),
    axis_factors: (Number(above=0.0), Row(Number(above=0.0), 3)),
    body_inertia: Row(Number(unit="kg m²"), 6),
    rising_times: Row(Number(low=0.0, unit="s")),
    ranges: Named(Row(JointValue, 2)),
    fingers_of: Named(JointValue),
    pair: Row(text, 2),
    span: Row(JointValue, 2),
    group_of: (text, Row(text)),
    radius_of: (RADIUS, Row(RADIUS)),
    pinhole: Row(Number(unit="pixels"), 4),
    measured: Row(Number(low=0.0, unit="m"), 2),
}
LISTS: Mapping[Check, Schema] = {  # what else holds of lists
    volume: {"minItems": 4},
    rising_times: {"minItems": 2},
    group_of: {"minItems": 1, "uniqueItems": True},
}
BASE64 = r"^([A-Za-z0-9+/]{4})*([A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=|[A-Za-z0-9+/]{4})$"
BEYOND_NUMBERS = 1e308  # only infinity is greater
PLAIN: Mapping[Check, Schema] = {
    text: TEXT,
    boolean: {"type": "boolean"},
    absolute_path: TEXT,
    outputs_of: {"type": "object", "additionalProperties": {"anyOf": [{"type": ["boolean", "number"]}, TEXT]}},
    touching: {
        "type": "array",
        "items": {
            "type": "array",
            "items": [TEXT, {"anyOf": [TEXT, {"type": "array", "items": TEXT}]}],
            "minItems": 2,
            "maxItems": 2,
        },
    },
    argument: {
        "anyOf": [
            TEXT,
            {"const": ""},
            {"type": "boolean"},
            {"type": "number", "minimum": -LARGEST_NUMBER, "maximum": LARGEST_NUMBER},
        ]
    },
}


def schema_text() -> str:
    """Return the schema as a JSON file."""
    return json.dumps(scene_schema(), indent=1, ensure_ascii=False) + "\n"


def scene_schema() -> Schema:
    """Return the schema of a scene file."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "hdplan scene",
        **_object(
            {
                **{key: {} for key in SECTIONS},  # in their order; a section not listed below would allow anything
                "hdplan": {"const": VERSION},
                "robot": _nullable(_robot()),
                "obstacles": _nullable(_list(_obstacle())),
                "attached": _nullable(_list(_section(Attached, pose=_pose(), shape=_shape()))),
                "start": _one_key({"joints": _joints(), "state": TEXT}, _rates()),
                "goal": {"anyOf": [_one_key(_goal(), _rates()), {"type": "null"}]},
                "from_request": {"type": ["boolean", "null"]},
                "self_collision": {
                    "anyOf": [{"type": ["boolean", "null"]}, _some(_section(SelfCollision, without=("checked",)))]
                },
                "limits": _nullable(_some(_section(Limits, position=_some(_value(ranges))))),
                "payload": _nullable(_section(Payload)),
                "path": _nullable(_some(_path())),
                "timing": _nullable(_not_both(_some(_section(Timing)), "duration", "scale")),
                "planner": _nullable(_section(PlannerSettings)),
                "job": _nullable({**_list({"anyOf": [_stage(), _repeated()]}), "minItems": 1, "maxItems": MOST_STAGES}),
            },
            required=("hdplan", "start"),
            about="One planning problem.",
        ),
        "oneOf": [_given("goal"), _given("job")],
    }


# Sections


def _section(kind: Any, without: Collection[str] = (), **instead: Schema) -> Schema:
    """Return an object whose keys are the fields of a class, without some of them; some with other schemas."""
    keys, required = {}, []
    for field in dataclasses.fields(kind):
        if not field.init or field.name in without:
            continue
        keys[field.name] = _field(field, instead.get(field.name) or _value(checks_of(kind)[field.name]))
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            required.append(field.name)
    if "name" in required:  # obstacles and held objects without one are numbered
        required.remove("name")
    return _object(keys, required, kind.__doc__ or "")


def _field(field: dataclasses.Field[Any], schema: Schema) -> Schema:
    """Return the schema of a field with its default; a field with a default may be null."""
    if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING and field.name != "name":
        return schema
    shown = isinstance(field.default, bool | int | float | str)
    return {**_nullable(schema), **({"default": field.default} if shown else {})}


def _placed(kind: Any) -> Schema:
    """Return a section with the keys of a pose beside its own."""
    own, pose = _section(kind, without=("pose", "field")), _pose()
    return {**own, "properties": {**own["properties"], **pose["properties"]}, "allOf": pose["allOf"]}


def _path() -> Schema:
    constraints = {
        "upright": _section(Upright),
        "position": _placed(Within),
        "relative": _section(Relative, pose=_pose()),
        "follow": _section(Follow, poses={**_list(_pose()), "minItems": 2, "maxItems": MOST_POSES}),
    }
    return _object({name: _nullable(schema) for name, schema in constraints.items()})


def _stage() -> Schema:
    """Return one stage of a job: its kind, and what every stage may have."""
    limits, path = _some(_section(Limits, position=_some(_value(ranges)))), _nullable(_some(_path()))
    common = _section(Wait, without=("seconds",), limits=limits)["properties"]
    own = {
        "move": _one_key(_goal()),
        **{name: _section(KINDS[name], without=(*common, "blend")) for name in ("line", "circle")},
        **{name: _section(KINDS[name], without=tuple(common)) for name in ("grip", "release")},
        "along": _along((*common, "blend")),
        "set": {**_value(checks_of(Set)["outputs"]), "minProperties": 1},
        "wait": _value(checks_of(Wait)["seconds"]),
    }
    some = {"type": "object", "properties": {"joints": {"type": "object", "minProperties": 1}}, "required": ["joints"]}
    bare = {"not": {"anyOf": [_given("link"), _given("mass")]}}
    own["grip"] = {**own["grip"], "anyOf": [_given("object"), {**some, **bare}]}
    own["release"] = {**own["release"], "anyOf": [_given("object"), some]}
    own["line"] = {**own["line"], "oneOf": [_given("by"), _given("to")]}
    either = [{"oneOf": [_given(name) for name in names]} for names in (("by", "to"), ("interim", "center"))]
    own["circle"] = {**own["circle"], "allOf": either}
    kinds: dict[str, Schema] = {kind: {"anyOf": [schema, {"type": "null"}]} for kind, schema in own.items()}
    beside = {"path": path, "blend": _value(checks_of(Move)["blend"])}
    alone = [{"anyOf": [*map(_given, OF_THE_ARM[key]), {"not": _given(key)}]} for key in beside]
    return {**_object({**kinds, **common, **beside}), "oneOf": [_given(kind) for kind in own], "allOf": alone}


def _repeated() -> Schema:
    """Return stages that are repeated over a table; what stands in them is known once they have its values."""
    some = {"type": "array", "items": {"type": "object"}, "minItems": 1}
    return _one_key({"repeat": _object({"over": some, "stages": some}, ("over", "stages"))})


def _along(common: Collection[str]) -> Schema:
    """Return a list of poses to be followed: in a file, or here."""
    section = _section(Along, without=("poses", *common))
    poses = {**_list(_pose()), "minItems": 2, "maxItems": MOST_POSES}
    section["properties"] = {"file": _nullable(TEXT), "poses": _nullable(poses), **section["properties"]}
    return {**section, "oneOf": [_given("file"), _given("poses")]}


def _robot() -> Schema:
    sizes = {"tracking": _some(_section(Tracking)), "calibration": _some(_section(Calibration))}
    own = _section(RobotSpec, without=("source",), base=_pose(), base_joints=_section(PlanarBase), **sizes)
    robot = _not_both(own, "name", "srdf")
    for key in ("package_dirs", "xacro_args"):
        robot = _not_both(robot, "name", key)
    return {**robot, "oneOf": [_given("name"), _given("urdf"), {"type": "null"}]}


def _pose() -> Schema:
    turns = {"quaternion_xyzw": _value(rotation), "rpy": _value(Row(Number(unit="rad"), 3))}
    keys = {"position": _value(Row(Number(unit="m"), 3)), **turns}
    about = "A pose: position, and a unit quaternion (x, y, z, w) or roll, pitch and yaw as in URDF."
    return _not_both(_object({name: _nullable(key) for name, key in keys.items()}, (), about), *turns)


def _shape() -> Schema:
    shapes = []
    for name, kind in CLASSES.items():
        keys, checks = SHAPE_KEYS[name], checks_of(kind)
        own = {key: _value(checks[key]) if needed else _nullable(_value(checks[key])) for key, needed in keys.items()}
        required = ("type", *(key for key, needed in keys.items() if needed))
        shapes.append(_object({"type": {"const": name}, **own}, required, kind.__doc__ or ""))
    return {"anyOf": shapes}


def _obstacle() -> Schema:
    """Return an obstacle's section: a shape, or in its place a cloud or a depth image."""
    unknown = _some(_section(Uncertainty))
    section = _section(Obstacle, pose=_pose(), shape=_shape(), motion=_motion(), uncertainty=unknown)
    solids = {"shape": section["properties"].pop("shape"), "cloud": _cloud(), "depth": _depth()}
    solids |= {"octomap": _octomap(), "voxels": _voxels()}
    keys = {"name": section["properties"].pop("name"), **{word: _nullable(each) for word, each in solids.items()}}
    section["properties"] = {**keys, **section["properties"]}
    del section["required"]
    return {**section, "oneOf": [_given(word) for word in solids]}


def _cloud() -> Schema:
    """Return a cloud: its points in a file, or here."""
    section = _of_cloud()
    points = {**_list(_value(Row(Number(unit="m"), 3))), "minItems": 1}
    section["properties"] = {"file": _nullable(TEXT), "points": _nullable(points), **section["properties"]}
    section["properties"]["radius"] = _value(radius_of)
    return {**section, "required": ["radius"], "oneOf": [_given("file"), _given("points")]}


def _depth() -> Schema:
    """Return a depth image: in a file, or here."""
    section, camera = _of_cloud(("drop_nan",)), _section(DepthImage, without=("image",))
    image = {**_list({**_list({"type": "number"}), "minItems": 1}), "minItems": 1}
    own = {"file": _nullable(TEXT), "image": _nullable(image), **camera["properties"]}
    section["properties"] = {**own, **section["properties"], "radius": _nullable(_value(RADIUS))}
    return {**section, "required": ["intrinsics"], "oneOf": [_given("file"), _given("image")]}


def _octomap() -> Schema:
    """Return an octomap: its file, or the content of that in base64."""
    section = _section(OctoMap, without=("source", "name", "pose"))
    content = {"type": "string", "pattern": BASE64}
    section["properties"] = {"file": _nullable(TEXT), "content": _nullable(content), **section["properties"]}
    return {**section, "required": [], "oneOf": [_given("file"), _given("content")]}


def _voxels() -> Schema:
    """Return a voxel grid: in a file, or here."""
    section = _section(Voxels, without=("occupied", "name", "pose"))
    grid = _list(_list({**_list({"enum": [0, 1, False, True]}), "minItems": 1}))
    section["properties"] = {"file": _nullable(TEXT), "occupied": _nullable(grid), **section["properties"]}
    return {**section, "required": ["size"], "oneOf": [_given("file"), _given("occupied")]}


def _of_cloud(without: Collection[str] = ()) -> Schema:
    """Return the settings that all clouds have."""
    ignored = {**_section(Ignored), "oneOf": [_given("link"), _given("obstacle")]}
    left_out = ("points", "name", "pose", *without)
    return _section(Cloud, without=left_out, ignore={"anyOf": [ignored, _list(ignored)]})


def _motion() -> Schema:
    return {"anyOf": [_some(_section(SteadyMotion)), _section(TimedPoses, poses=_list(_pose()))]}


def _joints() -> Schema:
    """Return one configuration: a list of values, or values by name."""
    row, named = _value(Row(JointValue)), _value(Named(JointValue))
    return {"anyOf": [{**row, "minItems": 1}, _some(named)]}


def _rates() -> dict[str, Schema]:
    """Return how the robot moves through a configuration."""
    row, named = _value(Row(Number())), _value(Named(Number()))
    rates = {"anyOf": [{**row, "minItems": 1}, _some(named)]}
    return {"velocity": rates, "acceleration": rates}


def _goal() -> dict[str, Schema]:
    pose = _placed(PoseTarget)
    pose["required"] = ["position"]
    pose["properties"]["position"] = _value(Row(Number(unit="m"), 3))
    return {
        "joints": {"anyOf": [*_joints()["anyOf"], {**_list(_joints()), "minItems": 1}]},
        "state": TEXT,
        "pose": pose,
        "poses": {**_list(pose), "minItems": 1},
        "any": {**_list(_one_key({"joints": _joints(), "state": TEXT, "pose": pose})), "minItems": 1},
        "all": {**_list(_object({"pose": {**pose, "required": ["link", "position"]}}, ["pose"])), "minItems": 2},
    }


# Values


def _value(check: Check) -> Schema:
    """Return what a check allows, as far as a schema can express it."""
    match check:
        case Maybe(item):
            return _value(item)
        case Number():
            return _number(check)
        case Whole(low, high):
            return {"type": "integer", "minimum": low, "maximum": high}
        case Choice(allowed):
            return {"enum": [*allowed]}
        case Named(item):
            return {"type": "object", "additionalProperties": _value(item)}
        case Row(item, length):
            exactly = {} if length is None else {"minItems": length, "maxItems": length}
            return {**_list(_value(item)), **exactly}
        case JointSize(unit, most):
            size = _number(Number(0.0, most, unit=unit))
            named = {"type": "object", "additionalProperties": size, "minProperties": 1}
            return {"anyOf": [size, {**_list(size), "minItems": 1}, named]}
        case JointQuantity(unit=unit, in_urdf=in_urdf):
            number = _number(Number(above=0.0, unit=unit))
            words = [{"enum": ["urdf"]}] if in_urdf else []
            named = {"type": "object", "additionalProperties": number, "minProperties": 1}
            return {"anyOf": [*words, number, {**_list(number), "minItems": 1}, named]}
    if check is extent:
        return {**_list(_edge()), "minItems": 3, "maxItems": 3}
    if check in PLAIN:
        return PLAIN[check]
    form = FORMS[check]
    if isinstance(form, tuple):
        schema: Schema = {"anyOf": [_value(each) for each in form]}
    else:
        schema = _value(form)
    return {**schema, **LISTS.get(check, {})}


def _number(check: Number) -> Schema:
    above = math.isfinite(check.above)
    low = {"exclusiveMinimum": check.above} if above else {"minimum": max(check.low, -LARGEST_NUMBER)}
    if check.above == 0.0:
        low = {"minimum": SMALLEST_NUMBER}
    unit = {"description": f"[{check.unit}]"} if check.unit else {}
    return {"type": "number", **low, "maximum": min(check.high, LARGEST_NUMBER), **unit}


def _edge() -> Schema:
    """Return an edge of a box: a length, or .inf, which JSON cannot write."""
    return {
        "anyOf": [
            _number(Number(above=0.0, unit="m")),
            {"type": "number", "minimum": BEYOND_NUMBERS, "description": ".inf"},
        ]
    }


def _object(keys: Mapping[str, Schema], required: Collection[str] = (), about: str = "") -> Schema:
    said = {"description": " ".join(about.split())} if about else {}
    needed = {"required": [*required]} if required else {}
    return {"type": "object", **said, "properties": dict(keys), **needed, "additionalProperties": False}


def _one_key(keys: Mapping[str, Schema], beside: Mapping[str, Schema] = MappingProxyType({})) -> Schema:
    """Return the schema of an object in which exactly one of some keys is given, and maybe others beside it."""
    nullable = _object({key: _nullable(schema) for key, schema in {**keys, **beside}.items()})
    return {**nullable, "minProperties": 1, "oneOf": [_given(key) for key in keys]}


def _some(schema: Schema) -> Schema:
    """Return the schema of an object in which something is given: not only nulls."""
    return {**schema, "minProperties": 1, "not": {"type": "object", "additionalProperties": {"type": "null"}}}


def _not_both(schema: Schema, one: str, other: str) -> Schema:
    """Return the schema of an object in which at most one of two keys is given."""
    return {**schema, "allOf": [*schema.get("allOf", []), {"not": _given(one, other)}]}


def _given(*keys: str) -> Schema:
    """Return the schema of an object in which all these keys are given, and not as null."""
    return {"type": "object", "required": [*keys], "properties": {key: {"not": {"type": "null"}} for key in keys}}


def _list(item: Schema) -> Schema:
    return {"type": "array", "items": item}


def _nullable(schema: Schema) -> Schema:
    """Return the schema of a key that may be left out or null, which is the same."""
    if "anyOf" in schema:
        return {**schema, "anyOf": [*schema["anyOf"], {"type": "null"}]}
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    return {**schema, "type": [schema["type"], "null"]}
