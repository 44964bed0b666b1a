"""Mesh files of the attacker's: odd but legal, of every format, each with the triangles that it says."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from hdplan.scenes.array_types import Array
from sieges import meshes

Polygons = list[list[int]]
Part = tuple[Array, Polygons]

NAMES = ("part", "a_b", "Körper", "x.1", "3", "Box 7", "")


def written(rng: np.random.Generator, ending: str) -> tuple[bytes, Array]:
    """Return a file of a format, and its triangles (F, 3, 3) up to how its polygons are cut."""
    return WRITERS[ending](rng)


def part(rng: np.random.Generator) -> Part:
    """Return a small solid of polygons, each flat and convex, somewhere."""
    match int(rng.integers(4)):
        case 0:
            points, faces = meshes.box(rng.uniform(0.3, 1.0, 3))
            polygons = faces.tolist()
        case 1:
            points, _ = meshes.box(rng.uniform(0.3, 1.0, 3))
            polygons = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        case 2:
            count = int(rng.integers(3, 8))
            angles = np.sort(rng.uniform(0, 2 * np.pi / count, count)) + 2 * np.pi * np.arange(count) / count
            outline = np.column_stack([np.cos(angles), np.sin(angles)])
            points = np.vstack([np.column_stack([outline, np.full(count, z)]) for z in (-0.5, 0.5)])
            polygons = [list(range(count))[::-1], list(range(count, 2 * count))]
            polygons += [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
        case _:
            points = rng.normal(size=(4, 3))
            polygons = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]]
    if rng.random() < 0.5:
        points = points @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return points + rng.normal(size=3), polygons


def parts(rng: np.random.Generator) -> list[Part]:
    """Return one to three solids at some scale."""
    scale = 10.0 ** float(rng.integers(-3, 4))
    found = [part(rng) for _ in range(int(rng.choice([1, 1, 2, 3])))]
    return [(scale * points, polygons) for points, polygons in found]


def together(all_parts: list[Part]) -> Part:
    """Return solids as one list of points and polygons."""
    starts = np.cumsum([0, *(len(points) for points, _ in all_parts)])
    polygons = [[i + int(start) for i in p] for (_, own), start in zip(all_parts, starts, strict=False) for p in own]
    return np.vstack([points for points, _ in all_parts]), polygons


def cut(points: Array, polygons: Polygons) -> Array:
    """Return polygons as triangles (F, 3, 3)."""
    rows = [[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)]
    return points[np.array(rows, dtype=np.int64).reshape(-1, 3)]


def _number(rng: np.random.Generator) -> Callable[[float], str]:
    """Return a way to write numbers, of 9 digits at least, so that what is flat stays flat."""
    ways: list[Callable[[float], str]] = [repr, lambda x: f"{x:.10e}", lambda x: f"{x:+.12E}", lambda x: f"{x:.9g}"]
    return ways[int(rng.integers(len(ways)))]


def _words(rng: np.random.Generator, words: list[str]) -> str:
    """Return words as a line, with whatever may stand between and after them."""
    gap = str(rng.choice([" ", " ", "  ", "\t"]))
    return gap.join(words) + str(rng.choice(["", "", " "]))


def _name(rng: np.random.Generator) -> str:
    return str(rng.choice(NAMES))


def _text(rng: np.random.Generator, lines: list[str]) -> bytes:
    """Return lines as a file, some indented, with empty ones in between, ended as on one system or the other."""
    if rng.random() < 0.2:
        lines = [lines[0], *(str(rng.choice(["", "  ", "\t"])) + line for line in lines[1:])]
    if rng.random() < 0.3:
        for _ in range(3):
            lines.insert(int(rng.integers(1, len(lines) + 1)), "")
    end = str(rng.choice(["\n", "\n", "\r\n"]))
    return (end.join(lines) + end * int(rng.integers(0, 3))).encode()


def stl(rng: np.random.Generator) -> tuple[bytes, Array]:
    """Binary with any header and any colours, or text of several solids."""
    found = [cut(*each) for each in parts(rng)]
    if rng.random() < 0.4:
        corners = np.concatenate(found).astype("<f4")
        head = [b"solid", b"COLOR=\1\2\3\4", b"", bytes(rng.integers(0, 256, 80, dtype=np.uint8))][rng.integers(4)]
        rows = [rng.normal(size=3).astype("<f4").tobytes() + c.tobytes() + rng.bytes(2) for c in corners]
        return head.ljust(80, b" ") + struct.pack("<I", len(rows)) + b"".join(rows), corners.astype(float)
    number, lines, held = _number(rng), list[str](), list[list[float]]()
    normal = str(rng.choice(["0 0 0", "1.0 0 -0.5", "nan nan nan", "-1e-3 2E+1 .5"]))
    for triangles in found:
        name = _name(rng)
        lines.append(f"solid {name}".rstrip())
        for triangle in triangles:
            lines += [_words(rng, ["facet", "normal", *normal.split()]), _words(rng, ["outer", "loop"])]
            for corner in triangle:
                words = [number(x) for x in corner.tolist()]
                held.append([float(x) for x in words])
                lines.append(_words(rng, ["vertex", *words]))
            lines += [_words(rng, ["endloop"]), _words(rng, ["endfacet"])]
        lines.append(str(rng.choice([f"endsolid {name}", "endsolid"])))
    return _text(rng, lines), np.array(held).reshape(-1, 3, 3)


def obj(rng: np.random.Generator) -> tuple[bytes, Array]:
    """Several parts, their faces in every form, counted from the first vertex or back from the last."""
    number, lines, held, polygons = _number(rng), ["# " + _name(rng), "mtllib a.mtl"], list[list[float]](), []
    more = str(rng.choice(["", "", " 1.0", " 0.5 0.25 1"]))
    form = str(rng.choice(["{0}", "{0}/1", "{0}//1", "{0}/1/1"]))
    for points, own in parts(rng):
        lines += [f"{rng.choice(['o', 'g'])} {_name(rng)}", "vt 0.5 0.5", "vn 0 0 1", "usemtl red", "s off"]
        start = len(held)
        for point in points.tolist():
            words = [number(x) for x in point]
            held.append([float(x) for x in words])
            lines.append(_words(rng, ["v", *words]) + more)
        back = rng.random() < 0.4
        for polygon in own:
            rows = [start + i for i in polygon]
            indices = [form.format(row - len(held) if back else row + 1) for row in rows]
            line = _words(rng, ["f", *indices])
            if rng.random() < 0.1:
                line = line[: (at := line.rindex(indices[-1]))] + "\\\n " + line[at:]
            lines.append(line)
            polygons.append(rows)
        lines += [["l 1 2"], ["p 1"], ["# f 1 2 3"], []][rng.integers(4)]
    if rng.random() < 0.1:
        lines.insert(1, r"# C:\robots\arm.obj")
    return _text(rng, lines), cut(np.array(held), polygons)


def off(rng: np.random.Generator) -> tuple[bytes, Array]:
    """With and without colours, normals and textures."""
    points, polygons = together(parts(rng))
    number, held = _number(rng), list[list[float]]()
    texture, color, normal = (rng.random() < 0.2 for _ in range(3))
    first = "ST" * texture + "C" * color + "N" * normal + "OFF"
    counts = f"{len(points)} {len(polygons)} {rng.integers(99)}"
    lines = [f"{first} {counts}"] if rng.random() < 0.2 else [first, *(["# parts"] * (rng.random() < 0.3)), counts]
    for point in points.tolist():
        words = [number(x) for x in point]
        held.append([float(x) for x in words])
        extra = ["0", "0", "1"] * normal + ["10", "20", "30", "255"] * color + ["0.5", "0.5"] * texture
        lines.append(_words(rng, [*words, *extra]))
    tint = [[], [], ["255", "0", "0"], ["0.1", "0.2", "0.3", "1.0"], ["7"]][rng.integers(5)]
    lines += [_words(rng, [str(len(p)), *map(str, p), *tint]) for p in polygons]
    return _text(rng, lines), cut(np.array(held), polygons)


PLY_TYPES = {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "uchar": "u1", "uint8": "u1"}
PLY_TYPES |= {"int": "i4", "uint": "u4", "short": "i2", "ushort": "u2", "int32": "i4", "char": "i1"}


def ply(rng: np.random.Generator) -> tuple[bytes, Array]:
    """Text or bytes of either order, elements and properties in any order."""
    points, polygons = together(parts(rng))
    order = str(rng.choice(["ascii", "binary_little_endian", "binary_big_endian"]))
    sign = ">" if order.endswith("big_endian") else "<"
    kind = str(rng.choice(["float", "double", "float32", "float64"]))
    extras = [("float", "nx"), ("float", "ny"), ("float", "nz"), ("uchar", "red"), ("uchar", "green")]
    extras = [extras[k] for k in np.flatnonzero(rng.random(len(extras)) < 0.3)]
    properties = [*extras, (kind, "x"), (kind, "y"), (kind, "z")] if rng.random() < 0.3 else []
    properties = properties or [(kind, "x"), (kind, "y"), (kind, "z"), *extras]
    count, index = (
        str(rng.choice(["uchar", "uint8", "int", "char"])),
        str(rng.choice(["int", "uint", "ushort", "int32"])),
    )
    tint = [("uchar", "red"), ("float", "quality")][: int(rng.integers(0, 3))]
    number = _number(rng)
    if order == "ascii":
        points = np.array([[float(number(x)) for x in point] for point in points.tolist()])
    points = points.astype(PLY_TYPES[kind]).astype(float) if order != "ascii" else points

    def row(values: list[tuple[str, float]]) -> bytes:
        if order == "ascii":
            return " ".join(number(x) if PLY_TYPES[t][0] == "f" else str(int(x)) for t, x in values).encode() + b"\n"
        return b"".join(np.array(x).astype(sign + PLY_TYPES[t]).tobytes() for t, x in values)

    def vertex(point: list[float]) -> bytes:
        place = dict(zip("xyz", point, strict=True))
        return row([(t, place.get(name, float(rng.integers(0, 99)))) for t, name in properties])

    vertices = b"".join(vertex(point) for point in points.tolist())
    faces = b"".join(
        row([(count, float(len(p))), *((index, float(i)) for i in p), *((t, float(rng.integers(99))) for t, _ in tint)])
        for p in polygons
    )
    name = str(rng.choice(["vertex_indices", "vertex_index"]))
    listed = [f"element face {len(polygons)}", f"property list {count} {index} {name}"]
    elements = [
        ([f"element vertex {len(points)}", *(f"property {t} {n}" for t, n in properties)], vertices),
        ([*listed, *(f"property {t} {n}" for t, n in tint)], faces),
    ]
    if rng.random() < 0.2:
        edge = ["element edge 1", "property int vertex1", "property int vertex2"]
        elements.append((edge, row([("int", 0), ("int", 1)])))
    if rng.random() < 0.1:
        elements.reverse()
    head = ["ply", f"format {order} 1.0", *([f"comment {_name(rng)}"] * int(rng.integers(0, 2)))]
    head += [line for lines, _ in elements for line in lines] + ["obj_info made by hand"] * (rng.random() < 0.2)
    end = str(rng.choice(["\n", "\n", "\n", "\r\n"]))
    data = (end.join([*head, "end_header"]) + end).encode() + b"".join(rows for _, rows in elements)
    return data, cut(points, polygons)


def placement(rng: np.random.Generator) -> Array:
    """Return a turn, a scale and a shift as a matrix (4, 4)."""
    matrix = np.eye(4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    matrix[:3, :3] = turn * np.sign(np.linalg.det(turn)) * float(rng.choice([1.0, 2.0, 0.5]))
    matrix[:3, 3] = rng.normal(size=3)
    return matrix


def dae(rng: np.random.Generator) -> tuple[bytes, Array]:
    """Triangles or polygons of one or several nodes, each with a matrix."""
    geometries, nodes, truth = "", "", []
    for k, (points, polygons) in enumerate(parts(rng)):
        matrix = placement(rng)
        numbers = " ".join(f"{x:.9g}" for x in points.ravel())
        sizes, tag = f"<vcount>{' '.join(str(len(p)) for p in polygons)}</vcount>", "polylist"
        if all(len(p) == 3 for p in polygons):
            sizes, tag = "", "triangles"
        faces = f'<{tag} count="{len(polygons)}"><input semantic="VERTEX" source="#v{k}" offset="0"/>{sizes}'
        faces += f"<p>{' '.join(str(i) for p in polygons for i in p)}</p></{tag}>"
        geometries += (
            f'<geometry id="g{k}"><mesh><source id="p{k}"><float_array id="a{k}" count="{points.size}">{numbers}'
            f'</float_array><technique_common><accessor source="#a{k}" count="{len(points)}" stride="3">'
            '<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>'
            f'</technique_common></source><vertices id="v{k}"><input semantic="POSITION" source="#p{k}"/></vertices>'
            f"{faces}</mesh></geometry>"
        )
        place = " ".join(repr(x) for x in matrix.ravel().tolist())
        nodes += f'<node id="n{k}"><matrix>{place}</matrix><instance_geometry url="#g{k}"/></node>'
        truth.append(cut(points, polygons) @ matrix[:3, :3].T + matrix[:3, 3])
    text = (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
        '<unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>'
        f"<library_geometries>{geometries}</library_geometries>\n<library_visual_scenes>"
        f'<visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>\n'
    )
    return text.encode(), np.concatenate(truth)


def gltf(rng: np.random.Generator) -> tuple[bytes, Array]:
    """Triangles in single precision of one or several nodes, the numbers within the text."""
    header, data, truth = _gltf(rng)
    header["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return json.dumps(header).encode(), truth


def glb(rng: np.random.Generator) -> tuple[bytes, Array]:
    """The same, as bytes."""
    header, data, truth = _gltf(rng)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    whole = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(whole)) + whole, truth


def _gltf(rng: np.random.Generator) -> tuple[dict[str, Any], bytes, Array]:
    views, accessors, all_meshes, nodes, truth, data = [], [], [], [], [], b""
    for k, (points, polygons) in enumerate(parts(rng)):
        corners = np.array([[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)])
        single, (kind, code) = points.astype("<f4"), [("<u2", 5123), ("<u4", 5125), ("u1", 5121)][rng.integers(3)]
        for blob, accessor in (
            (single.tobytes(), {"componentType": 5126, "type": "VEC3", "count": len(points)}),
            (corners.astype(kind).tobytes(), {"componentType": code, "type": "SCALAR", "count": corners.size}),
        ):
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(blob)})
            accessors.append({"bufferView": len(views) - 1, **accessor})
            data += blob + b"\0" * (-len(blob) % 4)
        accessors[-2] |= {"min": single.min(0).tolist(), "max": single.max(0).tolist()}
        all_meshes.append({"primitives": [{"attributes": {"POSITION": 2 * k}, "indices": 2 * k + 1}]})
        matrix = placement(rng)
        nodes.append({"mesh": k, "matrix": matrix.T.ravel().tolist()})
        truth.append(single.astype(float)[corners] @ matrix[:3, :3].T + matrix[:3, 3])
    header = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes}
    header |= {"meshes": all_meshes, "accessors": accessors, "bufferViews": views}
    return header | {"buffers": [{"byteLength": len(data)}]}, data, np.concatenate(truth)


WRITERS: dict[str, Callable[[np.random.Generator], tuple[bytes, Array]]] = {
    **{"stl": stl, "obj": obj, "off": off, "ply": ply},
    **{"dae": dae, "gltf": gltf, "glb": glb},
}
