"""COLLADA (dae, 1.4 and 1.5): what the file's scene shows, in metres.

`unit` is kept, as by RViz and Gazebo. `up_axis` turns nothing: of robots coordinates are taken as they stand, as RViz,
MoveIt, Gazebo and Pinocchio take them, on whose reading the placements in URDFs rely. Of anything else readers
disagree, so that a file in which another axis than z is up can be refused (`upright`).
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from hdplan.planner.geometry.mesh_formats.collada_elements import (
    PRIMITIVES,
    READ,
    SEMANTICS,
    TRANSFORMS,
    VERSIONS,
    Element,
    only,
    parts_of,
    shown,
    text_of,
)
from hdplan.planner.geometry.mesh_formats.scene_parts import DEEPEST_NODE, MOST_PARTS, joined, rotation
from hdplan.planner.geometry.mesh_formats.triangles import Triangles, fan, fans, strip
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.number_text import read_number, read_numbers, read_whole, read_wholes

Placed = list[tuple[Array, Element]]  # geometries and their placements (4, 4)

UNIT_AXIS = 1e-4  # how far a rotation's axis may be from unit length: readers disagree about others


def read_collada(data: bytes, upright: bool = False) -> Triangles:
    """Read a COLLADA file: vertices (m, 3) [m] and triangles (F, 3) of all that its scene instances; `upright`: z must
    be up in it.

    Raises InputError for what is no COLLADA file, and, by name, for all in its scene that is not known. Source:
    COLLADA 1.4.1 and 1.5.0 specifications, Khronos Group.
    """
    root = _parsed(data)
    meter = _unit(root, upright)
    vertices, triangles = joined(_Scene(root).parts())
    with np.errstate(over="ignore"):  # values that are not finite are refused where they are used
        return vertices * meter, triangles


def _parsed(data: bytes) -> Element:
    """Return the root; its elements lose their namespace."""
    if any(sign in data for sign in (b"\0", b"<!DOCTYPE", b"<!ENTITY")):
        raise InputError("is not plain XML in UTF-8: document types and other encodings are not read")
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True, insert_pis=True))
    try:
        parser.feed(data)
        root: Element = parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"is not well-formed XML, or is cut short: {error}") from None
    space, _, name = root.tag.rpartition("}")
    if name != "COLLADA" or space[1:] not in VERSIONS:
        raise InputError(f"its root element is '{root.tag[:80]}', not COLLADA in a namespace of COLLADA")
    versions = VERSIONS[space[1:]]
    if root.get("version") not in versions:
        raise InputError(f"version is '{root.get('version', '')}' (allowed in its namespace: {', '.join(versions)})")
    for element in root.iter():
        if isinstance(element.tag, str):
            element.tag = element.tag.removeprefix(f"{space}}}")
    return root


def _unit(root: Element, upright: bool) -> float:
    """Return the length of the file's unit [m]; `up_axis` is checked alone."""
    asset = only(parts_of(root)["asset"], "<asset>", root)
    found = parts_of(asset)
    axes = [text_of(axis) for axis in found["up_axis"]] or ["Y_UP"]  # the format's default
    if axes[0] not in ("X_UP", "Y_UP", "Z_UP") or len(axes) > 1:
        raise InputError(f"up_axis is '{axes[0][:20]}' (allowed: one of X_UP, Y_UP, Z_UP)")
    if upright and axes[0] != "Z_UP":
        raise InputError(
            f"up_axis is '{axes[0]}', and readers disagree on whether that turns the mesh: export it with z up, or "
            "write Z_UP there if its coordinates are to be read unchanged"
        )
    if not found["unit"]:
        return 1.0
    unit = only(found["unit"], "<unit>", asset)
    parts_of(unit)
    try:
        meter = read_number(unit.get("meter", ""))
    except ValueError as error:
        raise InputError(f"<unit>: meter: {error}") from None
    if not 0.0 < meter < np.inf:
        raise InputError(f"<unit>: meter is {unit.get('meter')}; a length above 0 is needed")
    return meter


def _parts(element: Element) -> Mapping[str, list[Element]]:
    """Return an element's children that are to be read; it must have no unit of its own."""
    found = parts_of(element)
    for asset in found["asset"]:
        if parts_of(asset)["unit"] or parts_of(asset)["up_axis"]:
            raise InputError(f"{shown(element)} says its own <unit> or <up_axis>: one for the whole file is read")
    return found


class _Scene:
    """The scene of a file: nodes that place geometries. Geometries that no node of it places are no part of it."""

    def __init__(self, root: Element) -> None:
        """Find the elements that others name."""
        self.root = root
        self.by_id = defaultdict[tuple[str, str], list[Element]](list)
        for element in root.iter():
            if element.tag in ("visual_scene", "node", "geometry", "source", "vertices", "float_array"):
                self.by_id[element.tag, element.get("id", "")].append(element)
        self.known: dict[Element, Placed] = {}

    def parts(self) -> list[tuple[Array, Triangles]]:
        """Return the meshes of the scene that the file shows, and their placements (4, 4)."""
        top = parts_of(self.root)
        for name in READ["COLLADA"].split():
            for library in top[name] if name.startswith("library") else ():
                _parts(library)
        scene = only(top["scene"], "<scene>", self.root)
        shows = only(parts_of(scene)["instance_visual_scene"], "<instance_visual_scene>", scene)
        placed = list[tuple[Array, Element]]()
        for node in _parts(self.instanced(shows, "visual_scene"))["node"]:
            placed += self.placed(node, ())
        meshes = {geometry: self.mesh(geometry) for _, geometry in placed}
        return [(place, meshes[geometry]) for place, geometry in placed]

    def instanced(self, instance: Element, tag: str) -> Element:
        """Return the meaning of an element."""
        parts_of(instance)
        return self.referred(instance, "url", tag)

    def referred(self, element: Element, attribute: str, tag: str) -> Element:
        """Return the one element of this file that an attribute names."""
        value = element.get(attribute, "")
        found = self.by_id[tag, value[1:]] if value[:1] == "#" and value[1:] else []
        if len(found) != 1:
            many = f"is that of {len(found) or 'no'} <{tag}>" if value[:1] == "#" else "is not in this file"
            raise InputError(f"{shown(element)}: {attribute} '{value[:60]}' {many}; that of one is needed")
        return found[0]

    def placed(self, node: Element, above: tuple[Element, ...]) -> Placed:
        """Return the geometries below a node, placed in the frame of its parent."""
        if node in above or len(above) > DEEPEST_NODE:
            words = "instances itself" if node in above else f"is nested more than {DEEPEST_NODE} levels deep"
            raise InputError(f"{shown(node)} {words}")
        if node not in self.known:
            found = _parts(node)
            inside = [(np.eye(4), self.instanced(each, "geometry")) for each in found["instance_geometry"]]
            for child in (*found["node"], *(self.instanced(each, "node") for each in found["instance_node"])):
                inside += self.placed(child, (*above, node))
            if len(inside) > MOST_PARTS:
                raise InputError(f"places more than {MOST_PARTS} geometries")
            own = _transform(node) if inside else np.eye(4)
            self.known[node] = [(own @ place, geometry) for place, geometry in inside]
        return self.known[node]

    def mesh(self, geometry: Element) -> Triangles:
        """Return a geometry's triangles, in the file's unit."""
        mesh = only(_parts(geometry)["mesh"], "<mesh>", geometry)
        found = parts_of(mesh)
        vertices = only(found["vertices"], "<vertices>", geometry)
        with naming(shown(geometry)):
            source = self.referred(_input(vertices, "POSITION"), "source", "source")
            points = self.points(source)
            triangles = [np.empty((0, 3), dtype=np.int64)]
            for element in (each for each in mesh if each.tag in PRIMITIVES):
                if element.get("count") == "0" and not parts_of(element)["input"] and not parts_of(element)["p"]:
                    continue
                drawn = self.referred(_input(element, "VERTEX"), "source", "vertices")
                if drawn is not vertices or source not in found["source"]:
                    raise InputError(f"{shown(element)} draws what belongs to another geometry")
                triangles.append(_triangles(element, points))
        return points, np.concatenate(triangles)

    def points(self, source: Element) -> Array:
        """Return the points (m, 3) of a source, by the names X, Y and Z of its parameters; those without a name are
        skipped, as the standard has it."""
        found = _parts(source)
        array = only(found["float_array"], "<float_array>", source)
        common = only(found["technique_common"], "<technique_common>", source)
        accessor = only(parts_of(common)["accessor"], "<accessor>", source)
        params = parts_of(accessor)["param"]
        if self.referred(accessor, "source", "float_array") is not array:
            raise InputError(f"{shown(source)} takes its numbers from elsewhere")
        for param in params:
            parts_of(param)
            if param.get("type") not in ("float", "double"):
                raise InputError(f"{shown(source)}: a parameter is of type '{param.get('type', '')[:20]}', not float")
        names = [param.get("name", "") for param in params]
        if sorted(filter(None, names)) != ["X", "Y", "Z"]:
            raise InputError(f"{shown(source)}: its parameters are '{' '.join(names)[:60]}'; X, Y and Z are needed")
        numbers = _numbers(array)
        if len(numbers) != _whole(array, "count"):
            raise InputError(f"{shown(array)} says {_whole(array, 'count')} numbers and holds {len(numbers)}")
        first, count, stride = _whole(accessor, "offset", 0), _whole(accessor, "count"), _whole(accessor, "stride", 1)
        if stride < len(names) or first + count * stride > len(numbers):
            raise InputError(f"{shown(source)}: its <accessor> reaches beyond the {len(numbers)} numbers")
        rows = numbers[first : first + count * stride].reshape(count, stride)
        return rows[:, [names.index(axis) for axis in "XYZ"]]


# --- triangles and transforms -----------------------------------------------------------------------------------------


def _input(owner: Element, semantic: str) -> Element:
    """Return the one input of a meaning; those with other meanings must be harmless."""
    inputs = parts_of(owner)["input"]
    for each in inputs:
        parts_of(each)
        value = each.get("semantic", "")
        if value != semantic and value not in SEMANTICS.split():
            raise InputError(f"{shown(owner)} has an <input> '{value[:40]}', which is not known here")
    return only([each for each in inputs if each.get("semantic") == semantic], f"<input> {semantic}", owner)


def _triangles(element: Element, points: Array) -> Rows:
    """Return the triangles (F, 3) of an element such as `triangles` and `polylist`."""
    found = parts_of(element)
    offset, width = _whole(_input(element, "VERTEX"), "offset"), 1 + max(_whole(x, "offset") for x in found["input"])
    runs, count = [_wholes(p) for p in found["p"]], _whole(element, "count")
    if any(len(run) % width for run in runs):
        raise InputError(f"{shown(element)}: a <p> ends within a corner of {width} numbers")
    rows = [run[offset::width] for run in runs]
    sizes = np.array([len(run) for run in rows], dtype=np.int64)
    if element.tag in ("triangles", "polylist"):  # all in one run
        if element.tag == "polylist":
            sizes = _wholes(only(found["vcount"], "<vcount>", element)) if count or found["vcount"] else sizes[:0]
        else:
            sizes = np.full(count if rows else 0, 3)
        if len(rows) > 1 or sum(map(len, rows)) != sizes.sum():
            raise InputError(f"{shown(element)}: its {count} polygons do not have the stated corners")
    if len(sizes) != count or (sizes < 3).any():
        raise InputError(
            f"{shown(element)} says {count} polygons and holds {len(sizes)}; each needs at least 3 corners"
        )
    if element.tag in ("tristrips", "trifans"):
        rows = [(strip if element.tag == "tristrips" else fan)(run).ravel() for run in rows]
        sizes = np.full(sum(map(len, rows)) // 3, 3)
    corners = np.concatenate([np.empty(0, dtype=np.int64), *rows])
    return fans(points, sizes, corners, lambda k: f"{shown(element)}, polygon {k + 1}")


def _transform(node: Element) -> Array:
    """Return the product (4, 4) of a node's transforms, in their order."""
    product = np.eye(4)
    for element in node:
        if element.tag in TRANSFORMS:
            numbers = _numbers(element) if element.tag in _SIZES else np.empty(0)
            if len(numbers) != _SIZES.get(element.tag):
                words = f"{_SIZES.get(element.tag)} numbers are needed" if element.tag in _SIZES else "is not read"
                raise InputError(f"{shown(node)}: {shown(element)}: {words}")
            product = product @ _matrix(element, numbers)
    return product


_SIZES = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}


def _matrix(element: Element, numbers: Array) -> Array:
    matrix = np.eye(4)
    match element.tag:
        case "matrix":
            matrix = numbers.reshape(4, 4)
            if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
                raise InputError(f"{shown(element)}: its last row is {matrix[3].tolist()}, not 0 0 0 1")
        case "translate":
            matrix[:3, 3] = numbers
        case "scale":
            matrix[:3, :3] = np.diag(numbers)
        case "rotate" if numbers[3] != 0.0:
            length = float(np.linalg.norm(numbers[:3]))
            if abs(length - 1.0) > UNIT_AXIS:
                raise InputError(f"{shown(element)}: its axis has length {length:g}; length 1 is needed")
            matrix = rotation(numbers[:3] / length, np.radians(numbers[3]))
    return matrix


# --- numbers ----------------------------------------------------------------------------------------------------------


def _words(element: Element) -> list[str]:
    text = text_of(element)
    if not text.isascii():
        raise InputError(f"{shown(element)} holds characters that are in no number")
    return text.split()


def _numbers(element: Element) -> Array:
    try:
        return np.array(read_numbers(_words(element)), dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{shown(element)}: {str(error)[:80]}") from None


def _wholes(element: Element) -> Rows:
    try:
        return np.array(read_wholes(_words(element)), dtype=np.int64)
    except ValueError as error:
        raise InputError(f"{shown(element)}: {str(error)[:80]}") from None


def _whole(element: Element, name: str, otherwise: int | None = None) -> int:
    """Return an attribute that is a whole number of at least 0."""
    value = element.get(name)
    if value is None and otherwise is not None:
        return otherwise
    try:
        found = read_whole(value or "")
    except ValueError:
        found = -1
    if found < 0:
        raise InputError(f"{shown(element)}: {name} is '{(value or '')[:20]}'; a whole number of at least 0 is needed")
    return found
