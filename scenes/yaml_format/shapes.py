"""Shapes as scene files write them: ``{type: box, size: [x, y, z]}`` and the like."""

from __future__ import annotations

from collections.abc import Callable

from hdplan.scenes.fields import Field
from hdplan.scenes.model import Box, Capsule, Cylinder, Mesh, Points, Shape, Sphere

SHAPE_KEYS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "points": ("points",),
    "mesh": ("file", "scale"),
}
"""Keys of each shape beside its type; all are required but a mesh's scale."""
CLASSES: dict[str, Callable[..., Shape]] = {
    "box": Box,
    "sphere": Sphere,
    "cylinder": Cylinder,
    "capsule": Capsule,
    "points": Points,
}
"""Shapes whose keys are their attributes as they are."""


def read_shape(section: Field) -> Shape:
    """Read a shape. Raises InputError: unknown type or key, a size that is not above 0, points in one plane."""
    every_key = {"type", *(key for keys in SHAPE_KEYS.values() for key in keys)}
    kind = section.mapping(every_key, required=["type"])["type"].choice(SHAPE_KEYS)
    required = [key for key in SHAPE_KEYS[kind] if key != "scale"]
    keys = section.mapping(("type", *SHAPE_KEYS[kind]), required)
    del keys["type"]
    if "file" in keys:
        return section.make(Mesh, **{**keys, "file": keys["file"].path()})
    return section.make(CLASSES[kind], **keys)
