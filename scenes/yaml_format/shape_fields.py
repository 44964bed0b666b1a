"""Shapes in scene files: ``{type: box, size: [x, y, z]}`` and the like, as the classes of `scenes.shapes` have them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import MISSING, fields
from types import MappingProxyType
from typing import Any, get_args

from hdplan.scenes.fields import Field
from hdplan.scenes.shapes import Shape

CLASSES: Mapping[str, type[Any]] = MappingProxyType({kind.__name__.lower(): kind for kind in get_args(Shape)})
"""Word -> class of each shape."""


def _keys(kind: Any) -> list[dataclasses.Field[Any]]:
    """Return the fields that files hold: in a program, a shape may also have a name and a pose, by keyword."""
    return [key for key in fields(kind) if not key.kw_only]


SHAPE_KEYS: Mapping[str, Mapping[str, bool]] = MappingProxyType(
    {
        word: MappingProxyType({key.name: key.default is MISSING for key in _keys(kind)})
        for word, kind in CLASSES.items()
    }
)
"""Keys of each shape beside its type, and whether they are required."""


def read_shape(section: Field) -> Shape:
    """Read a shape. Raises InputError for an unknown type or key, a size that is not above 0, or coplanar points."""
    every_key = {"type", *(key for keys in SHAPE_KEYS.values() for key in keys)}
    word = section.mapping(every_key, required=["type"])["type"].choice(SHAPE_KEYS)
    required = [key for key, needed in SHAPE_KEYS[word].items() if needed]
    keys: dict[str, Any] = dict(section.mapping(("type", *SHAPE_KEYS[word]), required))
    del keys["type"]
    if "file" in keys:
        keys["file"] = keys["file"].path()
    shape: Shape = section.make(CLASSES[word], **keys)
    return shape


def shape_entry(shape: Shape) -> dict[str, Any]:
    """Return the entry that `read_shape` reads back."""
    shape = shape.requested
    entry: dict[str, Any] = {"type": type(shape).__name__.lower()}
    if CLASSES.get(entry["type"]) is not type(shape):
        raise TypeError(f"no file holds a {type(shape).__name__}")
    return entry | {key.name: getattr(shape, key.name) for key in _keys(shape)}
