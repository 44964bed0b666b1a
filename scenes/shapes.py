"""Shapes as scene files write them: ``{type: box, size: [x, y, z]}`` and the like."""

from __future__ import annotations

import numpy as np

from hdplan.scenes.fields import Field
from hdplan.scenes.model import Box, Capsule, Cylinder, Mesh, Points, Shape, Sphere, Vector3
from hdplan.scenes.poses import read_vector

SHAPE_KEYS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "points": ("points",),
    "mesh": ("file", "scale"),
}
"""Keys of each shape beside its type; all are required but a mesh's scale."""
FLAT = 1e-9  # thickness over size below which points lie in one plane


def read_shape(section: Field) -> Shape:
    """Read a shape. Raises InputError: unknown type or key, a size that is not above 0, points in one plane."""
    every_key = {"type", *(key for keys in SHAPE_KEYS.values() for key in keys)}
    kind = section.mapping(every_key, required=["type"])["type"].choice(SHAPE_KEYS)
    required = [key for key in SHAPE_KEYS[kind] if key != "scale"]
    keys = section.mapping(("type", *SHAPE_KEYS[kind]), required)
    match kind:
        case "box":
            return Box(read_vector(keys["size"], above=0.0, unit="m"))
        case "sphere":
            return Sphere(keys["radius"].number(above=0.0, unit="m"))
        case "cylinder":
            return Cylinder(keys["radius"].number(above=0.0, unit="m"), keys["length"].number(above=0.0, unit="m"))
        case "capsule":
            return Capsule(keys["radius"].number(above=0.0, unit="m"), keys["length"].number(low=0.0, unit="m"))
        case "points":
            return Points(_points(keys["points"]))
        case _:
            return Mesh(keys["file"].path(), _scale(keys["scale"]) if "scale" in keys else (1.0, 1.0, 1.0))


def _points(entry: Field) -> tuple[Vector3, ...]:
    points = tuple(read_vector(item, unit="m") for item in entry.items(of="points"))
    spread = np.ptp(points, axis=0).max() if points else 0.0
    if not points or np.linalg.matrix_rank(np.subtract(points, points[0]), tol=FLAT * spread) < 3:
        raise entry.error(
            f"must be points that span a volume (four or more, not in one plane), found {len(points)} that do not"
        )
    return points


def _scale(entry: Field) -> Vector3:
    if isinstance(entry.value, list):
        return read_vector(entry, above=0.0)
    factor = entry.number(above=0.0)
    return factor, factor, factor
