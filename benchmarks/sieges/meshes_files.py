"""Mesh files of every format, odd but legal or made wrong, against Assimp: the same surface, or refused.

A file that is legal must be read, and say what its writer meant. What hdplan reads of a file made wrong must be what
Assimp, as coal loads it, reads of it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import coal
import numpy as np
import trimesh

from hdplan.planner.geometry.meshes import load_mesh
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.shapes import Mesh
from sieges import mesh_writers
from sieges.campaign import Outcome

SAME = 4e-6  # of the largest coordinate: Assimp calculates in single precision
SPOILT = 0.7  # of the files are made wrong


def attack(rng: np.random.Generator, folder: Path) -> Outcome:
    """Write one file, maybe make it wrong, and read it in both ways."""
    ending = str(rng.choice(list(mesh_writers.WRITERS)))
    data, truth = mesh_writers.written(rng, ending)
    wrong = rng.random() < SPOILT
    if wrong:
        data = spoilt(rng, data, ending)
    path = folder / f"mesh.{ending}"
    path.write_bytes(data)
    kind, finding = opinions(path, None if wrong else truth)
    return Outcome(f"{ending}, {'spoilt' if wrong else 'legal'}: {kind}", finding)


def opinions(path: Path, truth: Array | None = None) -> tuple[str, str]:
    """Return what came of a file, and what is wrong: hdplan against what was written, if that is known, and Assimp."""
    try:
        mesh = load_mesh(Mesh(path), "obstacles.thing")
    except InputError as error:
        return "refused", "" if truth is None else f"a legal file is refused: {str(error).rpartition(path.name)[2]}"
    ours = mesh.vertices[mesh.triangles]
    if truth is not None and (wrong := different(ours, truth)):
        return "read", f"not what was written: {wrong}"
    data = path.read_bytes()
    name = next((name for name in READERS if not known_fault(name, path.suffix, data)), "")
    theirs = READERS[name](path) if name else None
    if theirs is None:
        return (f"refused by {name}" if name else "read by hdplan alone"), ""  # other readers parse normals, too
    wrong = different(ours, theirs)
    return f"read by {name}", wrong and f"hdplan reads {len(ours)} triangles, {name} {len(theirs)}: {wrong}"


def by_assimp(path: Path) -> Array | None:
    """Return the triangles (F, 3, 3) that Assimp reads, through coal's loader; None where it refuses the file."""
    try:
        tree = coal.MeshLoader(coal.BV_AABB).load(str(path))
    except (RuntimeError, ValueError, IndexError):
        return None
    rows = np.array([[t[0], t[1], t[2]] for t in map(tree.tri_indices, range(tree.num_tris))], dtype=np.int64)
    return np.asarray(tree.vertices())[rows.reshape(-1, 3)]


def by_trimesh(path: Path) -> Array | None:
    """Return the triangles (F, 3, 3) that trimesh reads; None where it fails."""
    try:
        scene = trimesh.load_scene(str(path), process=False)
        return np.concatenate([np.asarray(mesh.triangles) for mesh in scene.dump() if hasattr(mesh, "faces")])
    except Exception:  # of any kind
        return None


READERS: dict[str, Callable[[Path], Array | None]] = {"Assimp": by_assimp, "trimesh": by_trimesh}
FAULTS: dict[tuple[str, str], dict[str, str]] = {  # what these readers make of legal files, by patterns in them
    ("Assimp", ".obj"): {
        r"(?m)^[ \t]+[vf]": "lines that are indented are passed over",
        r"\\(?!\r?\n)": "a backslash joins lines wherever it stands, in comments too",
    },
    ("Assimp", ".ply"): {
        r"(?s)element face.*element vertex": "faces before vertices end the process",
        r"[ \t\n]\+[0-9]+[ \t\r\n]": "rows with a plus sign before a whole number are read one word late",
        r"(?m)^comment [0-9]": "of a comment that begins with a number, rows are lost",
        r"element face (?s:.*)element tristrips|element tristrips (?s:.*)element face": "faces beside strips are lost",
        r"element tristrips (?!1\s)": "of several lists of strips only the first is read",
    },
    ("trimesh", ".ply"): {r"element tristrips": "strips are passed over"},
    ("trimesh", ".obj"): {r"(?m)^\s*[vf]\t": "lines with a tab after their keyword are passed over"},
    ("Assimp", ".off"): {r"#": "reading does not end after a comment"},
}


def known_fault(reader: str, ending: str, data: bytes) -> str:
    """Return what in a file a reader is known to read otherwise than it is meant; empty for nothing."""
    known = FAULTS.get((reader, ending), {})
    return next((why for what, why in known.items() if re.search(what.encode(), data)), "")


def different(ours: Array, theirs: Array) -> str:
    """Return the difference of two surfaces, up to rounding, the order of triangles, and how flat polygons are cut."""
    if not np.isfinite(theirs).all():
        return "numbers that are not finite"
    size = max(float(np.abs(each).max(initial=0.0)) for each in (ours, theirs))
    ours, theirs = (_proper(each, SAME * size) for each in (ours, theirs))
    turns = np.stack([np.roll(theirs, k, axis=1) for k in range(3)], axis=1)
    apart = np.abs(turns - ours[:, None, None]).max(axis=(3, 4)).min(axis=2, initial=np.inf)  # (ours, theirs)
    for row, column in np.argwhere(apart <= SAME * size):
        if apart[row, column] >= 0.0:  # neither has found its like
            apart[row], apart[:, column] = -1.0, -1.0
            ours[row], theirs[column] = np.nan, np.nan
    one, other = (each[~np.isnan(each[:, 0, 0])] for each in (ours, theirs))
    if not len(one) and not len(other):
        return ""
    middle, reach = np.concatenate([one, other]).reshape(-1, 3).mean(axis=0), np.ptp(np.concatenate([one, other]))
    moments = [_moments((each - middle) / reach) for each in (one, other)]
    moved = float(np.abs(moments[0] - moments[1]).max())
    area = max(moment[3, 0] for moment in moments)
    return f"{len(one)} and {len(other)} triangles differ" * bool(moved > (1e-4 + 10 * SAME * size / reach) * area)


def _proper(triangles: Array, thin: float) -> Array:
    """Return the triangles without those that are no higher than rounding."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    longest = np.max([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)], axis=0)
    proper: Array = triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 4.0 * thin * longest]
    return proper


def _moments(triangles: Array) -> Array:
    """Return integrals of the powers up to degree 4 over the surface, by its normal's three parts and by its area: the
    quadrature of D. A. Dunavant (1985) of degree 4."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a) / 2.0
    weights = np.column_stack([normal, np.linalg.norm(normal, axis=1)])
    total = 0.0
    for near, weight in ((0.108103018168070, 0.223381589678011), (0.816847572980459, 0.109951743655322)):
        for k in range(3):
            share = np.roll([near, (1 - near) / 2, (1 - near) / 2], k)
            x, y, z = (share[0] * a + share[1] * b + share[2] * c).T
            powers = [x**i * y**j * z**m for i in range(5) for j in range(5 - i) for m in range(5 - i - j)]
            total = total + weight * weights.T @ np.stack(powers, axis=1)
    return np.asarray(total)


ODD = {  # lines that say more than points and triangles
    "stl": ["color 1 0 0", "vertex 0 0 0", "facet normal 0 0 1", "endloop", "endsolid", "solid b", "# a", "endfacet"],
    "obj": ["v 1 2 3 2", "v 1 2", "vp 0 0", "cstype bezier", "curv 0 1 1 2", "call a.obj", "f 1 2 3 \\", "f 1 2 3 # a"]
    + ["f -1 -2 -3", "f 1 1 2", "v 1_0 0 0", "vn 1 0 0", "lod 3", "f 1 2 3 1 2", "fo 1 2 3", "f 1/ 2/ 3/", "g \\"]
    + ["v 0 0 0\nv 1 0 0\nv 1 1 0.3\nv 0 1 0\nf -4 -3 -2 -1", "v 0 0 0\nv 2 0 0\nv 0.5 0.5 0\nv 0 2 0\nf -1 -2 -3 -4"],
    "off": ["3 0 1 2", "0 0 0", "# a", "4 0 1 2 3", "3 0 1 2 9 9"],
    "ply": ["element tristrips 1\nproperty list int int vertex_indices", "property float w", "comment a", "3 0 1 2"]
    + ["element face 1", "property list uchar int more", "0 0 0"],
    "dae": ["<node/>", "<skew>1 0 0 0 1 0 0</skew>", "<scale>2 2 2</scale>", '<unit meter="0.001"/>', "<ph/>"],
    "gltf": [],
    "glb": [],
}
WRONG = ["nan", "inf", "-1", "0", "1", "2", "1e308", "1e-30", "99999999999999999999", "x", "1_0", "1,5", "0x10", "3.5"]
WRONG += ["1e", ".", "+1", "-0", "1e5", "７", "1.5f", "4294967295"]


def spoilt(rng: np.random.Generator, data: bytes, ending: str) -> bytes:
    """Return a file made wrong: bytes, words and lines flipped, left out, doubled, swapped, or cut off."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        at = int(rng.integers(len(data) + 1))
        lines = data.split(b"\n")
        line = int(rng.integers(len(lines)))
        words = list(re.finditer(rb"[^\s<>\"=,:]+", data))
        match int(rng.integers(11)):
            case 0:
                data = data[: len(data) // 2] if rng.random() < 0.5 else data[:at]
            case 1 | 2:
                data = data[:at] + bytes([int(rng.integers(256))]) + data[at + int(rng.integers(2)) :]
            case 3:
                data = data[:at] + bytes(b ^ (1 << int(rng.integers(8))) for b in data[at : at + 1]) + data[at + 1 :]
            case 4:
                data = b"\n".join(lines[:line] + lines[line + 1 :])
            case 5:
                data = b"\n".join(lines[: line + 1] + lines[line:])
            case 6 if len(words) > 1:
                one, other = sorted(words[int(k)].span() for k in rng.choice(len(words), 2, replace=False))
                data = b"".join(
                    (data[: one[0]], data[slice(*other)], data[one[1] : other[0]], data[slice(*one)], data[other[1] :])
                )
            case 7 | 8 if words:
                word = words[int(rng.integers(len(words)))]
                data = data[: word.start()] + str(rng.choice(WRONG)).encode() + data[word.end() :]
            case 9 if ODD[ending]:
                data = b"\n".join([*lines[:line], str(rng.choice(ODD[ending])).encode(), *lines[line:]])
            case _:
                swapped = int(rng.integers(len(lines)))
                lines[line], lines[swapped] = lines[swapped], lines[line]
                data = b"\n".join(lines)
    return data
