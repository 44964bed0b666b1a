"""Mesh formats: files that are legal, odd ones too, say what they say to Assimp; whatever else is refused by name."""

from __future__ import annotations

import struct
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.geometry.mesh_files import read_mesh_file
from hdplan.scenes.errors import InputError

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from sieges import mesh_writers, meshes_files

ENDINGS = ("stl", "obj", "off", "ply")


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("count", [120, pytest.param(500, marks=pytest.mark.slow)])
def test_legal_files_are_read_as_written_and_as_assimp_reads_them(ending: str, count: int, tmp_path: Path) -> None:
    kinds: Counter[str] = Counter()
    for seed in range(count):
        data, truth = mesh_writers.written(np.random.default_rng([seed, 0]), ending)
        path = tmp_path / f"mesh.{ending}"
        path.write_bytes(data)
        kind, finding = meshes_files.opinions(path, truth)
        assert finding == "", seed
        kinds[kind] += 1
    assert kinds["read by Assimp"] > 0.6 * count, kinds


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("count", [80, pytest.param(5000, marks=pytest.mark.slow)])
def test_spoilt_files_are_refused_or_read_as_others_read_them(ending: str, count: int, tmp_path: Path) -> None:
    kinds: Counter[str] = Counter()
    for seed in range(count):
        rng = np.random.default_rng([seed, 1])
        data, _ = mesh_writers.written(rng, ending)
        path = tmp_path / f"mesh.{ending}"
        path.write_bytes(meshes_files.spoilt(rng, data, ending))
        kind, finding = meshes_files.opinions(path)
        assert finding == "", seed
        kinds[kind] += 1
    assert kinds["refused"] > count // 4, kinds
    assert kinds["read by Assimp"] > kinds["refused by Assimp"], kinds


def test_the_judge_sees_what_is_missing_or_moved_but_not_how_flat_polygons_are_cut() -> None:
    rng = np.random.default_rng(0)
    points, polygons = mesh_writers.part(rng)
    triangles = mesh_writers.cut(points, polygons)
    assert meshes_files.different(triangles, np.roll(triangles[::-1], 1, axis=1)) == ""
    for k in range(len(triangles)):
        assert meshes_files.different(triangles, np.delete(triangles, k, axis=0))
        moved = triangles.copy()
        moved[k, 1] += 1e-3
        assert meshes_files.different(triangles, moved)
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    one, other = square[[[0, 1, 2], [0, 2, 3]]], square[[[1, 2, 3], [1, 3, 0]]]
    assert meshes_files.different(one, other) == ""
    assert meshes_files.different(one, other[:, ::-1])
    square[2, 2] = 0.1
    assert meshes_files.different(square[[[0, 1, 2], [0, 2, 3]]], square[[[1, 2, 3], [1, 3, 0]]])


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.5 1\n"
SOLID = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
OFF = "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"


def ply(*lines: str, head: str = "ascii", vertex: str = "", rows: str = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n") -> str:
    header = ["ply", f"format {head} 1.0", "element vertex 3", *(f"property double {axis}" for axis in "xyz")]
    header += [vertex] * bool(vertex) + ["element face 1", "property list uchar int vertex_indices", *lines]
    return "\n".join([*header, "end_header"]) + "\n" + rows


@pytest.mark.parametrize(
    ("ending", "content", "words"),
    [
        ("obj", SQUARE + "v 1_0 0 0\nf 1 2 3\n", "line 6: '1_0 0 0': numbers are expected"),
        ("obj", SQUARE + "v 1 2 3 2\nf 1 2 3\n", "line 6: 'v 1 2 3 2': the weight of a vertex must be 1"),
        ("obj", SQUARE + "v 1 2 3 1 0\nf 1 2 3\n", "line 6: .* a vertex has 3 coordinates"),
        ("obj", SQUARE + "f 1_0 2 3\n", "line 6: 'f 1_0 2 3': vertices are whole numbers"),
        ("obj", SQUARE + "f 1 2 3/a\n", "line 6: .* vertices are whole numbers"),
        ("obj", SQUARE + "curv 0 1 1 2\n", "line 6: 'curv 0 1 1 2': free-form curves and surfaces are not read"),
        ("obj", SQUARE + "call other.obj\n", "line 6: 'call other.obj': other files and commands are not read"),
        ("obj", SQUARE + "shadow_obj a.obj\n", "line 6: .* other files that stand for this one are not read"),
        ("obj", SQUARE + "usemlt red\n", r"line 6: .*'usemlt' is not known \(did you mean 'usemtl'\?\)"),
        ("obj", SQUARE + "# a \\\nf 1 2 3\n", "line 6: .* a backslash at its end has two readings"),
        ("obj", SQUARE + "f 1 2\\\n3 4\n", "line 6: .* a backslash at its end has two readings"),
        ("obj", SQUARE + "# a\rf 1 2 3\n", "line 6: holds the control character"),
        ("obj", SQUARE + "f 1 2 3 4\nf 1 3 2 4\n", "line 7: a face of 4 corners is not flat and convex"),
        ("obj", SQUARE + "f 1 2 3 4 5\n", "line 6: a face of 5 corners is not flat and convex"),
        ("obj", SQUARE + "f 1 2 3\nf 1 2 9\n", "line 7: a face has vertex 8 .* there are 5 vertices"),
        ("stl", SOLID + "endsolid a\nsolid b\n", "is cut short: it does not end with 'endsolid'"),
        ("stl", SOLID + SOLID.partition("\n")[2] + "color 1 0 0\nendsolid", "line 16: 'color 1 0 0': 'facet normal'"),
        ("stl", SOLID + "endsolid\nfacet normal 0 0 1\n", "line 10: .* 'solid' is expected"),
        ("stl", SOLID.replace("endloop", "vertex 1 1 1\nendloop"), "line 7: 'vertex 1 1 1': 'endloop' is expected"),
        ("stl", SOLID.replace("endloop\n", ""), "line 7: 'endfacet': 'endloop' is expected"),
        ("stl", SOLID.replace("vertex 1 0 0", "vertex 1 0 0_1"), "line 5: '1 0 0_1': numbers are expected"),
        ("stl", SOLID.replace("solid a", "solid vertex"), "line 1: .* a name with the keyword 'vertex'"),
        ("off", OFF + "0 0 0\n", "line 9: '0 0 0': the file continues after its 4 vertices and 2 faces"),
        ("off", OFF.replace("OFF", "4OFF"), "its first word is not OFF, .* but '4OFF'"),
        ("off", OFF.replace("OFF", "nOFF"), "its first word is not OFF, .* but 'nOFF'"),
        ("off", OFF.replace("OFF", "OFF BINARY"), "'BINARY': the numbers of vertices, faces and edges are expected"),
        ("off", OFF.replace("1 0 0\n", "1 0 0 1\n"), "line 4: '1 0 0 1': a vertex of OFF has 3 numbers"),
        ("off", OFF.replace("3 0 1 3", "3 0 1 3 9 9"), "line 8: .* a face of 3 vertices and a colour"),
        ("off", OFF.replace("3 0 1 3", "2 0 1"), "line 8: '2 0 1': a face has at least 3 vertices"),
        ("ply", ply("element trifans 1", "property list int int vertex_indices", rows=""), "'trifans' is not read"),
        ("ply", ply(vertex="property float w", rows=""), "element 'vertex': the property 'w' is not known"),
        ("ply", ply("property list uchar int more", rows=""), "element 'face': the property 'more' is not known"),
        ("ply", ply("property double vertex_index", rows=""), "'face': does not have exactly one list of whole"),
        ("ply", ply("element vertex 3", rows=""), "'vertex' appears twice"),
        ("ply", ply() + "0 0 0\n", "continues after its end: its header says 4 rows, and it holds 5"),
        ("ply", ply().replace("0 1 2\n", "0 1 2 3\n"), "line 13: '3 0 1 2 3': 'face' needs numbers"),
        ("ply", ply().replace("1 0 0", "1_0 0 0"), "line 11: '1_0 0 0': 'vertex' needs numbers"),
        ("ply", ply().replace("double z", "double y"), "line 6: 'y' appears twice"),
        ("ply", ply().replace("ascii 1.0", "ascii 2.0"), "line 2: .* not a line of a PLY header"),
    ],
)
def test_unknown_lines_of_a_mesh_are_refused_by_name(ending: str, content: str, words: str, tmp_path: Path) -> None:
    (tmp_path / f"a.{ending}").write_bytes(content.encode())
    with pytest.raises(InputError, match=words):
        read_mesh_file(tmp_path / f"a.{ending}")


def test_bytes_of_a_ply_are_all_read(tmp_path: Path) -> None:
    """Bytes left over, or missing, are refused; a comment with the words of the header's end changes nothing."""
    head = ply(head="binary_big_endian", rows="").replace("element face", "comment end_header\nelement face").encode()
    rows = np.eye(3).astype(">f8").tobytes() + struct.pack(">B3i", 3, 0, 1, 2)
    path = tmp_path / "a.ply"
    path.write_bytes(head + rows)
    vertices, triangles = read_mesh_file(path)
    assert vertices.tolist() == np.eye(3).tolist()
    assert triangles.tolist() == [[0, 1, 2]]
    for data, words in ((rows + b"\n", "continues for 1 bytes"), (rows[:-1], "is cut short")):
        path.write_bytes(head + data)
        with pytest.raises(InputError, match=words):
            read_mesh_file(path)


@pytest.mark.parametrize("head", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_strips_of_a_ply_turn_every_second_triangle_and_restart_after_minus_one(head: str, tmp_path: Path) -> None:
    """Judges are the rule, corner by corner, and Assimp, which reads one list of strips and no faces beside it."""
    path = tmp_path / "a.ply"
    for seed in range(12):
        rng = np.random.default_rng(seed)
        points, beside = rng.normal(size=(9, 3)), rng.integers(9, size=(seed % 3, 3)).tolist()
        lists = [np.concatenate([[*rng.permutation(9)[: rng.integers(3, 9)], -1] for _ in range(3)]) for _ in "ab"]
        lists = [each[: len(each) - int(rng.integers(2))].tolist() for each in lists[: 1 + seed % 2]]
        truth = [*beside]
        for each in lists:
            strip: list[int] = []
            for corner in each:
                strip = [*strip, corner] if corner >= 0 else []
                if len(strip) > 2:
                    truth.append(strip[-3:] if len(strip) % 2 else [strip[-2], strip[-3], strip[-1]])
        path.write_bytes(strips_of(points, beside, lists, head))
        vertices, triangles = read_mesh_file(path)
        assert meshes_files.different(vertices[triangles], points[np.array(truth)]) == ""
        if not beside and len(lists) == 1:
            theirs = meshes_files.by_assimp(path)
            assert meshes_files.different(vertices[triangles], theirs) == ""
    for wrong, words in (
        ([0, 1, -1, 2, 3, 4], "tristrips 0 .*: a strip has at least 3 corners, not 2"),
        ([0, 1, 2, 9], "tristrips 0 .*: a face has vertex 9"),
        ([0, 1, 2, -2], "'tristrips' needs numbers|a face has vertex -2"),
    ):
        path.write_bytes(strips_of(points, [], [wrong], head))
        with pytest.raises(InputError, match=words):
            read_mesh_file(path)


def strips_of(points: np.ndarray, faces: list[list[int]], lists: list[list[int]], head: str) -> bytes:
    """A PLY file of triangles and lists of strips."""
    of_vertex = [f"element vertex {len(points)}", *(f"property double {axis}" for axis in "xyz")]
    of_faces = [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    of_strips = [f"element tristrips {len(lists)}", "property list int int vertex_indices", "end_header\n"]
    header = "\n".join(["ply", f"format {head} 1.0", *of_vertex, *(of_faces if faces else []), *of_strips])
    if head == "ascii":
        rows = [*points.tolist(), *([len(each), *each] for each in (*faces, *lists))]
        return (header + "".join(" ".join(map(repr, row)) + "\n" for row in rows)).encode()
    sign = "<" if "little" in head else ">"
    rows = [np.asarray(points, dtype=f"{sign}f8").tobytes(), *(struct.pack(f"{sign}B3i", 3, *each) for each in faces)]
    rows += [struct.pack(f"{sign}{1 + len(each)}i", len(each), *each) for each in lists]
    return header.encode() + b"".join(rows)


def test_polygons_are_cut_where_all_readers_see_the_same(tmp_path: Path) -> None:
    """Flat ones that are seen whole from their first corner, concave ones too, and quadrilaterals that are bent."""
    for faces, count in (("f 1 2 3 4", 2), ("f 1 2 3 5", 2), ("f -5 -4 -3 -2", 2)):
        (tmp_path / "a.obj").write_text(SQUARE.replace("0.5 0.5 1", "0 1 0.2") + faces)
        assert len(read_mesh_file(tmp_path / "a.obj")[1]) == count
    arrow = "v 0 0 0\nv 2 -1 0\nv 1 0 0\nv 2 1 0\n"
    (tmp_path / "a.obj").write_text(arrow + "f 1 2 3 4\n")
    assert read_mesh_file(tmp_path / "a.obj")[1].tolist() == [[0, 1, 2], [0, 2, 3]]
    (tmp_path / "a.obj").write_text(arrow + "f 2 3 4 1\n")
    with pytest.raises(InputError, match="line 5: a face of 4 corners is not flat and convex"):
        read_mesh_file(tmp_path / "a.obj")
