"""The parts of the scene format's JSON Schema: what a field's check allows, as far as a schema can express it, and
objects, lists and keys that may be null.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any

from hdplan.scenes.attached import body_inertia
from hdplan.scenes.clouds import RADIUS, radius_of
from hdplan.scenes.depth_images import measured, pinhole
from hdplan.scenes.job import outputs_of
from hdplan.scenes.limits import JointQuantity, ranges
from hdplan.scenes.obstacles import rising_times
from hdplan.scenes.path_constraints import AXES, direction, extent
from hdplan.scenes.poses import rotation
from hdplan.scenes.robot_spec import argument, group_of, pair, span
from hdplan.scenes.shapes import axis_factors, volume
from hdplan.scenes.stage import touching
from hdplan.scenes.values import (
    LARGEST_NUMBER,
    SMALLEST_NUMBER,
    Check,
    Choice,
    JointValue,
    Maybe,
    Named,
    Number,
    PerJoint,
    Row,
    Whole,
    absolute_path,
    boolean,
    text,
)

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


def value_schema(check: Check) -> Schema:
    """Schema of what a check allows, as far as a schema can express it."""
    match check:
        case Maybe(item):
            return value_schema(item)
        case Number():
            return _number(check)
        case Whole(low, high):
            return {"type": "integer", "minimum": low, "maximum": high}
        case Choice(allowed):
            return {"enum": [*allowed]}
        case Named(item):
            return {"type": "object", "additionalProperties": value_schema(item)}
        case Row(item, length):
            exactly = {} if length is None else {"minItems": length, "maxItems": length}
            return {**list_of(value_schema(item)), **exactly}
        case PerJoint(number):
            one = _number(number)
            named = {"type": "object", "additionalProperties": one, "minProperties": 1}
            return {"anyOf": [one, {**list_of(one), "minItems": 1}, named]}
        case JointQuantity():
            words = [{"enum": ["urdf"]}] if check.in_urdf else []
            return {"anyOf": [*words, *value_schema(check.numbers)["anyOf"]]}
    if check is extent:
        return {**list_of(_edge()), "minItems": 3, "maxItems": 3}
    if check in PLAIN:
        return PLAIN[check]
    form = FORMS[check]
    if isinstance(form, tuple):
        schema: Schema = {"anyOf": [value_schema(each) for each in form]}
    else:
        schema = value_schema(form)
    return {**schema, **LISTS.get(check, {})}


def _number(check: Number) -> Schema:
    above = math.isfinite(check.above)
    low = {"exclusiveMinimum": check.above} if above else {"minimum": max(check.low, -LARGEST_NUMBER)}
    if check.above == 0.0:
        low = {"minimum": SMALLEST_NUMBER}
    unit = {"description": f"[{check.unit}]"} if check.unit else {}
    return {"type": "number", **low, "maximum": min(check.high, LARGEST_NUMBER), **unit}


def _edge() -> Schema:
    """Schema of an edge of a box: a length, or .inf, which JSON cannot write."""
    return {
        "anyOf": [
            _number(Number(above=0.0, unit="m")),
            {"type": "number", "minimum": BEYOND_NUMBERS, "description": ".inf"},
        ]
    }


def object_of(keys: Mapping[str, Schema], required: Collection[str] = (), about: str = "") -> Schema:
    """Schema of an object with these keys and no others, some of them required."""
    described = {"description": " ".join(about.split())} if about else {}
    needed = {"required": [*required]} if required else {}
    return {"type": "object", **described, "properties": dict(keys), **needed, "additionalProperties": False}


def one_key_of(keys: Mapping[str, Schema], beside: Mapping[str, Schema] = MappingProxyType({})) -> Schema:
    """Schema of an object in which exactly one of some keys is given, and maybe others beside it."""
    either = object_of({key: nullable(schema) for key, schema in {**keys, **beside}.items()})
    return {**either, "minProperties": 1, "oneOf": [given(key) for key in keys]}


def not_empty(schema: Schema) -> Schema:
    """Schema of an object in which something is given: not only nulls."""
    return {**schema, "minProperties": 1, "not": {"type": "object", "additionalProperties": {"type": "null"}}}


def not_both(schema: Schema, one: str, other: str) -> Schema:
    """Schema of an object in which at most one of two keys is given."""
    return {**schema, "allOf": [*schema.get("allOf", []), {"not": given(one, other)}]}


def given(*keys: str) -> Schema:
    """Schema of an object in which all these keys are given, and not as null."""
    return {"type": "object", "required": [*keys], "properties": {key: {"not": {"type": "null"}} for key in keys}}


def list_of(item: Schema) -> Schema:
    """Schema of a list of such items."""
    return {"type": "array", "items": item}


def nullable(schema: Schema) -> Schema:
    """Schema of a key that may be left out, or null, to the same effect."""
    if "anyOf" in schema:
        return {**schema, "anyOf": [*schema["anyOf"], {"type": "null"}]}
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    return {**schema, "type": [schema["type"], "null"]}
