"""glTF 2.0 (gltf, glb): what the file's scene shows, in metres.

Coordinates are taken as they stand: glTF's y axis is up, and readers of meshes for robots do not turn it.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from hdplan.planner.geometry.mesh_formats.gltf_container import listed, numbers, whole
from hdplan.planner.geometry.mesh_formats.gltf_keys import ATTRIBUTES, Object, checked
from hdplan.planner.geometry.mesh_formats.gltf_numbers import Beside, GltfFile
from hdplan.planner.geometry.mesh_formats.scene_parts import DEEPEST_NODE, joined
from hdplan.planner.geometry.mesh_formats.triangles import Triangles, fan, strip
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

TRIANGLES, STRIP, FAN = 4, 5, 6  # modes; those below are points and lines, which enclose nothing
UNIT_QUATERNION = 1e-5  # how far a rotation may be from unit length: readers disagree about others


def read_gltf(data: bytes, beside: Beside) -> Triangles:
    """Read a glTF file: vertices (m, 3) [m] and triangles (F, 3) of all nodes of its scene.

    `beside` returns the content of a file by its name, in the folder of the one that is read or below it, and raises
    InputError where it cannot. Raises InputError for what is no glTF file, and, by name, for all that is not known.
    Source: glTF 2.0 specification, Khronos Group (ISO/IEC 12113:2022); KHR_mesh_quantization.
    """
    return joined(_parts(GltfFile(data, beside)))


def _parts(file: GltfFile) -> list[tuple[Array, Triangles]]:
    """Return the meshes of the scene and their placements (4, 4)."""
    scenes, nodes = listed(file.top, "scenes", "the file"), listed(file.top, "nodes", "the file")
    if "scene" not in file.top and len(scenes) != 1:
        raise InputError(f"has {len(scenes)} scenes and does not say which is shown")
    scene, place = file.item("scenes", file.top.get("scene", 0), "scene", "scene")
    roots = listed(scene, "nodes", place)
    below = [child for i in range(len(nodes)) for child in _children(file, i)]  # of all nodes, shown or not
    for index, count in Counter(map(str, (*below, *roots))).items():
        if count > 1:
            raise InputError(f"nodes[{index[:20]}] appears {count} times; each may appear once")
    found, meshes = list[tuple[Array, Triangles]](), dict[int, list[Triangles]]()
    waiting = [(np.eye(4), index, 1) for index in reversed(roots)]
    while waiting:
        above, index, depth = waiting.pop()
        node, place = file.item("nodes", index, "node", "a node or scene")
        if depth > DEEPEST_NODE:
            raise InputError(f"{place} is nested more than {DEEPEST_NODE} levels deep")
        if "skin" in node or "weights" in node:
            raise InputError(f"{place} has a skin or morph targets, which are not read: export it as it stands")
        here = above @ _transform(node, place)
        waiting += [(here, child, depth + 1) for child in reversed(_children(file, index))]
        if "mesh" in node:
            mesh, name = file.item("meshes", node["mesh"], "mesh", place)
            if node["mesh"] not in meshes:
                meshes[node["mesh"]] = _mesh(file, mesh, name)
            found += [(here, part) for part in meshes[node["mesh"]]]
    return found


def _children(file: GltfFile, index: int) -> list[Any]:
    node, place = file.item("nodes", index, "node", "a node or scene")
    return listed(node, "children", place)


def _mesh(file: GltfFile, mesh: Object, place: str) -> list[Triangles]:
    """Return the triangles of a mesh's primitives."""
    if "weights" in mesh:
        raise InputError(f"{place} has morph targets, which are not read: export it as it stands")
    if not (primitives := listed(mesh, "primitives", place)):
        raise InputError(f"{place} has no primitives")
    found = [_primitive(file, each, f"{place}.primitives[{i}]") for i, each in enumerate(primitives)]
    return [each for each in found if each is not None]


def _primitive(file: GltfFile, value: Any, place: str) -> Triangles | None:
    """Return the triangles of a primitive; None for points and lines."""
    primitive = checked(value, "primitive", place)
    mode = whole(primitive, "mode", place, TRIANGLES)
    if mode > FAN:
        raise InputError(f"{place}: mode is {mode}; 0 to {FAN} are known")
    if "targets" in primitive:
        raise InputError(f"{place} has morph targets, which are not read: export it as it stands")
    attributes = primitive.get("attributes")
    if not isinstance(attributes, dict) or "POSITION" not in attributes:
        raise InputError(f"{place} has no POSITION")
    for name in attributes:
        if name != "POSITION" and name.partition("_")[0] not in ATTRIBUTES:
            raise InputError(f"{place}: the attribute '{name[:40]}' is not known")
    if mode < TRIANGLES:
        return None
    points = file.points(attributes["POSITION"], place)
    rows = file.indices(primitive["indices"], place) if "indices" in primitive else np.arange(len(points))
    if rows.max() >= len(points):
        raise InputError(f"{place}: a triangle has vertex {rows.max()} (counted from 0); there are {len(points)}")
    if len(rows) < 3 or (mode == TRIANGLES and len(rows) % 3):
        raise InputError(f"{place} has {len(rows)} corners, which are not whole triangles")
    return points, rows.reshape(-1, 3) if mode == TRIANGLES else (strip if mode == STRIP else fan)(rows)


def _transform(node: Object, place: str) -> Array:
    """Return a node's placement (4, 4): its matrix, or translation · rotation · scale."""
    if "matrix" in node:
        matrix = numbers(node, "matrix", place, [0.0] * 16).reshape(4, 4).T  # stored by columns
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0] or {"translation", "rotation", "scale"} & set(node):
            raise InputError(f"{place}: its matrix is not an affine map, or appears beside other transforms")
        return matrix
    quaternion = numbers(node, "rotation", place, [0.0, 0.0, 0.0, 1.0])
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) <= UNIT_QUATERNION:
        raise InputError(f"{place}: rotation has length {length:g}; a quaternion of length 1 is needed")
    x, y, z, w = quaternion / length
    placed = np.eye(4)
    placed[:3, :3] = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    placed[:3, :3] *= numbers(node, "scale", place, [1.0, 1.0, 1.0])
    placed[:3, 3] = numbers(node, "translation", place, [0.0, 0.0, 0.0])
    return placed
