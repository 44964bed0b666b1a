"""Triangles of mesh files: STL, OBJ and COLLADA. Whatever changes what is meant is known here, or rejected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .balls import EPS, HERE, Ball, dot, need, unit, up
from .text import row, split, strict_xml, table
from .turns import rotation
from .world import unique

KINDS = (".stl", ".obj", ".dae")
NEARLY = 1e-4  # of a polygon's largest coordinate, by which it may be bent
FULL = 2 * np.pi - 1e-6  # [rad] a whole turn
OBJ_WORDS = b"v f vn vt vp g o s usemtl mtllib".split()


def triangles(path: Path, data: bytes, upright: bool) -> Ball:
    """The corners (F, 3, 3) of a mesh file's triangles. `upright`: COLLADA must say that z is up."""
    kind, size = path.suffix.lower(), 84 + 50 * int.from_bytes(data[80:84], "little")
    if kind == ".stl" and len(data) == size:
        rows = np.frombuffer(data, dtype=np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]), offset=84)
        found = Ball(rows["v"])
    else:
        need(b"\0" not in data, f"{path}: is not text")
        found = collada(strict_xml(data), upright) if kind == ".dae" else Ball((stl if kind == ".stl" else obj)(data))
    good = len(found.mid) and (np.abs(found.mid) < 1e9).all() and (found.rad < 1e-6).all()
    need(good, f"{path}: has no triangles, or numbers that are not finite")
    return found


def stl(data: bytes) -> Any:
    """The triangles of an STL file that is text: of 21 words each, between two lines."""
    first, *lines, last = data.strip().lower().replace(b"\r", b"\n").split(b"\n")
    words = np.array(b" ".join(lines).split()).reshape(-1, 21)
    rule = b"facet normal outer loop vertex vertex vertex endloop endfacet".split()
    same = words[:, [0, 1, 5, 6, 7, 11, 15, 19, 20]] == rule
    good = first.startswith(b"solid") and last.startswith(b"endsolid") and same.all() and b"vertex" not in first + last
    need(good, "STL: its lines are not those of triangles")
    return table(words[:, [8, 9, 10, 12, 13, 14, 16, 17, 18]].ravel().tolist(), "STL").reshape(-1, 3, 3)


def fans(faces: Sequence[Sequence[int]], points: Any) -> Any:
    """Triangles (F, 3) of polygons, all at the first corner of theirs, from where a polygon must be flat and seen
    whole: others are cut in other ways by other readers. Those cut a quadrilateral alike that is bent, if both of its
    diagonals run within it."""
    for count in {*map(len, faces)} - {3}:
        at = points[np.array([x for x in faces if len(x) == count])]
        edges = at[:, 1:] - at[:, :1]
        halves, off = np.cross(edges[:, :-1], edges[:, 1:]), NEARLY * np.abs(at).max(axis=(1, 2))[:, None]
        way = halves.sum(axis=1)
        way = way / np.sqrt((way * way).sum(axis=1, keepdims=True))
        area, along = dots(halves, way[:, None]), dots(edges[:, :-1], edges[:, 1:])
        good = (np.abs(dots(edges, way[:, None])) <= off).all(axis=1) & (np.arctan2(area, along).sum(axis=1) < FULL)
        good &= (area >= -4 * off * np.abs(edges).max(axis=(1, 2))[:, None]).all(axis=1)
        if count == 4:
            others = np.cross(at[:, [2, 3]] - at[:, [1, 1]], at[:, [3, 0]] - at[:, [1, 1]])
            good |= (dots(halves[:, 0], halves[:, 1]) > 0) & (dots(others[:, 0], others[:, 1]) > 0)
        need(good.all(), f"a face of {count} corners is not flat and convex, and readers disagree about its surface")
    corners = [[x[0], x[i], x[i + 1]] for x in faces for i in range(1, len(x) - 1)]
    return np.array(corners, dtype=np.int64).reshape(-1, 3)


def obj(data: bytes) -> Any:
    """The triangles of an OBJ file: vertices count from 1, or backwards from the last before the face. A fourth number
    of a vertex divides the others for some readers, and more are colours for some."""
    points, faces = list[list[bytes]](), list[list[int]]()
    for key, *rest in filter(None, (line.split() for line in data.replace(b"\r", b"\n").split(b"\n"))):
        good = (key in OBJ_WORDS or key[:1] == b"#") and not [key, *rest][-1].endswith(b"\\")
        need(good, "OBJ: a line that may be read in two ways")
        if key == b"v":
            need(
                len(rest) in (3, 6) or (len(rest) == 4 and rest[3] in (b"1", b"1.0")), "OBJ: a vertex of other numbers"
            )
            points.append(rest[:3])
        elif key == b"f":
            words = [x.split(b"/")[0] for x in rest]
            need(len(words) > 2 and all(x.lstrip(b"-").isdigit() for x in words), "OBJ: a face of other words")
            numbers = [int(x) for x in words]
            faces.append([x - 1 if x > 0 else len(points) + x for x in numbers])
            need(all(numbers) and min(faces[-1]) >= 0, "OBJ: a face has a vertex that is not there")
    need(max(map(max, faces), default=-1) < len(points), "OBJ: a face has a vertex that is not there")
    places = table([x for each in points for x in each], "OBJ").reshape(-1, 3)
    return places[fans(faces, places)]


def wholes(words: Sequence[str]) -> bool:
    """True if words are whole numbers in the digits that everybody reads."""
    return all(x.isascii() and x.isdigit() for x in words)


def dots(a: Any, b: Any) -> Any:
    """Products of vectors along the last axis."""
    return (a * b).sum(axis=-1)


def collada(root: Any, upright: bool) -> Ball:
    """The triangles of a COLLADA file in metres; which of its axes is up is passed over for links, as ROS does."""
    for x in root.iter():
        x.tag = x.tag.rpartition("}")[2]
    named = unique([(x.get("id"), x) for x in root.iter() if "id" in x.attrib])
    need(all(x.get("meter") in ("1", "1.0") for x in root.iter("unit")), "COLLADA: its unit is not the metre")
    need(not upright or [x.text for x in root.iter("up_axis")] == ["Z_UP"], "COLLADA: its z axis is not up")

    def there(element: Any, key: str = "source") -> Any:
        need(element is not None and element.get(key, "")[:1] == "#", "COLLADA: a reference is not within the file")
        need(element.get(key)[1:] in named, "COLLADA: a reference leads nowhere")
        return named[element.get(key)[1:]]

    def soup(geometry: Any) -> Iterator[Ball]:
        need({x.tag for x in geometry} <= {"mesh", "extra", "asset"}, "COLLADA: a geometry must be a mesh")
        for part in geometry.findall("mesh/*"):
            need(part.tag in ("source", "vertices", "lines", "triangles", "polylist", "extra"), f"COLLADA: {part.tag}")
            if part.tag not in ("triangles", "polylist"):  # lines enclose nothing
                continue
            need({x.tag for x in part} <= {"input", "p", "vcount", "extra"}, "COLLADA: a mesh with other parts")
            ways = {x.get("semantic"): x for x in part.findall("input")}
            need(
                [x.get("semantic") for x in part.findall("input")].count("VERTEX") == 1, "COLLADA: two kinds of points"
            )
            source = there(there(ways["VERTEX"]).find("input[@semantic='POSITION']"))
            (array,), (way,) = source.findall("float_array"), source.findall("technique_common/accessor")
            plain = (way.get("stride"), way.get("offset", "0"), there(way)) == ("3", "0", array)
            plain = plain and [x.get("name") for x in way.findall("param")] in ([], ["X", "Y", "Z"]) and len(array) == 0
            words = split(array.text or "")
            plain = plain and array.get("count") == str(len(words)) and way.get("count") == str(len(words) // 3)
            need(plain, "COLLADA: its points are not three numbers each")
            points, stride = table(words, "COLLADA").reshape(-1, 3), 1
            offsets = [x.get("offset", "") for x in part.findall("input")]
            need(wholes(offsets), "COLLADA: an input without offset")
            stride += max(map(int, offsets))
            text = split(" ".join(x.text or "" for x in part.findall("p")))
            need(wholes(text), "COLLADA: a face has a vertex that is not there")
            corners = np.array(text, dtype=np.int64).reshape(-1, stride)[:, int(ways["VERTEX"].get("offset"))]
            count = len(corners) // 3
            if part.tag == "polylist":
                sizes = split(part.findtext("vcount") or "")
                need(wholes(sizes), "COLLADA: polygons of other sizes than it says")
                ends, count = np.cumsum(np.array(sizes, dtype=np.int64)), len(sizes)
                need(len(corners) == ends.max(initial=0), "COLLADA: polygons of other sizes than it says")
                need((corners < len(points)).all(), "COLLADA: a face has a vertex that is not there")
                corners = fans([x.tolist() for x in np.split(corners, ends[:-1])], points)
            need(part.get("count") == str(count), "COLLADA: other faces than it counts")
            need((corners < len(points)).all(), "COLLADA: a face has a vertex that is not there")
            need(corners.size % 3 == 0, "COLLADA: corners that make no triangle")
            yield Ball(points[corners.reshape(-1, 3)])

    def parts(node: Any) -> list[Ball]:
        ways = ("matrix", "translate", "scale", "rotate")
        plain = (*ways, "asset", "node", "instance_geometry", "instance_camera", "instance_light", "extra")
        need({x.tag for x in node} <= {*plain}, f"COLLADA: a node has other parts than {', '.join(plain)}")
        found = [x for each in node.findall("instance_geometry") for x in soup(there(each, "url"))]
        found += [x for each in node.findall("node") for x in parts(each)]
        for step in [x for x in reversed(node) if x.tag in ways]:
            count = {"matrix": 16, "rotate": 4}.get(step.tag, 3)
            v, (turn, at) = row(step.text, count, "COLLADA"), HERE
            if step.tag == "matrix":
                need(v[12:].tolist() == [0, 0, 0, 1], "COLLADA: a matrix must be an affine map")
                turn, at = (Ball(x, EPS * np.abs(x)) for x in np.split(v.reshape(4, 4)[:3], [3], axis=1))
                at = at[:, 0]
            elif step.tag == "rotate":  # by an angle in degrees, wrong by less than 5 roundings
                turn = rotation(unit(v[:3]), v[3] * np.pi / 180)
                turn = Ball(turn.mid, up(turn.rad + 5 * EPS * 0.02 * abs(v[3]) + 4 * EPS))
            else:
                v = Ball(v, EPS * np.abs(v))
                turn, at = (turn, v) if step.tag == "translate" else (Ball(np.diag(v.mid), np.diag(v.rad)), at)
            found = [dot("ij,fkj->fki", turn, x) + at for x in found]
            if np.linalg.det(turn.mid) < 0:  # what mirrors is named backwards
                found = [x[:, ::-1] for x in found]
        return found

    scene = root.find("scene")
    need(scene is not None and [x.tag for x in scene] == ["instance_visual_scene"], "COLLADA: not one visual scene")
    all_ = parts(there(scene[0], "url"))
    return Ball(*(np.concatenate([np.zeros((0, 3, 3)), *x]) for x in ([y.mid for y in all_], [y.rad for y in all_])))
