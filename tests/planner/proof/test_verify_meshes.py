"""The checker reads mesh files as hdplan, coal and their definition do, or refuses them."""

from __future__ import annotations

import functools
from contextlib import nullcontext
from pathlib import Path

import coal
import numpy as np
import pytest

from hdplan.planner.geometry.mesh_files import read_mesh_file
from hdplan.scenes.robot_files.library import data_folder
from hdplan.verify import RejectedError
from hdplan.verify.meshes import triangles


@pytest.mark.sampled(30)
@pytest.mark.parametrize("first", range(30))
def test_collada_files_are_read_as_hdplan_reads_them_or_refused(first: int) -> None:
    """Every 30th of the library: each triangle has the same corners, but for hdplan's single precision."""
    read = 0
    for file in sorted(data_folder().glob("**/*.dae"))[first::30]:
        try:
            found = triangles(file, file.read_bytes(), upright=False)
        except RejectedError as error:
            assert "COLLADA" in str(error) or "key" in str(error)  # noqa: PT017
            continue
        points, corners = read_mesh_file(file)
        apart = np.abs(np.sort(points[corners], axis=1) - np.sort(found.mid, axis=1)).max()
        assert apart <= 1e-6 * np.abs(points).max()
        assert found.rad.max() < 1e-12
        read += 1
    assert read > 2


DAE = """<COLLADA xmlns="x"><asset><unit meter="1"/></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 1 0 -1 1 0</float_array><technique_common>
<accessor source="#a" count="4" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="1"/><input semantic="NORMAL" source="#n" offset="0"/>
<vcount>4</vcount><p>9 0 9 1 9 2 9 3</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><matrix>2 0 0 1 0 2 0 0 0 0 2 0 0 0 0 1</matrix>
<node><matrix>0 -1 0 0 1 0 0 0 0 0 1 5 0 0 0 1</matrix><instance_geometry url="#g"/></node></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_nodes_of_a_collada_file_place_each_other() -> None:
    points = np.array([[1, 0, 10], [1, 2, 10], [-1, 0, 10], [-1, -2, 10]])
    other = "<translate>1 0 0</translate><scale>2 2 2</scale><translate>0 0 5</translate><rotate>0 0 1 90</rotate>"
    start, end = DAE.index("<matrix>2"), DAE.index("<instance_geometry")
    for text in (DAE, f"{DAE[:start]}<node>{other}{DAE[end:]}"):
        found = triangles(Path("a.dae"), text.encode(), upright=False)
        assert (np.abs(found.mid - points[[[0, 1, 2], [0, 1, 2], [0, 2, 3]]]) <= found.rad).all()
        assert found.rad.max() < 1e-12


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('meter="1"', 'meter="0.01"'),
        ('stride="3"', 'stride="4"'),
        ('stride="3"', 'stride="3" offset="3"'),
        ("<p>0 1 2</p>", "<p>0 1 7</p>"),
        ("<p>0 1 2</p>", "<p>0 1 -1</p>"),
        ("<vcount>4", "<vcount>3"),
        ("<polylist", "<tristrips/><polylist"),
        ("<node><matrix>2", "<node><skew>0 0 1</skew><matrix>2"),
        ("<node><matrix>2", '<node><instance_node url="#s"/><matrix>2'),
        ("0 0 0 0 1</matrix>\n<node>", "0 0 0 0 2</matrix>\n<node>"),
        ('<instance_geometry url="#g"/>', '<instance_geometry url="other.dae#g"/>'),
        ('<instance_geometry url="#g"/>', ""),
        ('<source id="p">', '<source id="g">'),
        ("0 1 0 -1 1 0</float", "0 1 0 -1 1 inf</float"),
    ],
)
def test_other_collada_files_are_refused(before: str, after: str) -> None:
    assert before in DAE
    with pytest.raises((RejectedError, ValueError, IndexError, KeyError)):
        triangles(Path("a.dae"), DAE.replace(before, after).encode(), upright=False)


@pytest.mark.parametrize(
    ("points", "good"),
    [
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], True),
        ([[0, 0, 0], [1, 0, 0.5], [1, 1, 0], [0, 1, 0.5]], True),  # bent, and whoever cuts it begins at the first
        ([[0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1, 0]], True),  # seen whole from the first corner
        ([[0, 0, 0], [0.2, 0.2, 0], [1, 0, 0], [0, 1, 0]], False),
        ([[0, 0, 0], [1, 0, 0], [2, 1, 0], [1, 2, 0], [0, 1, 0]], True),
        ([[0, 0, 0], [1, 0, 0.3], [2, 1, 0], [1, 2, 0.3], [0, 1, 0]], False),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, -1, 0]], False),
    ],
)
def test_faces_of_which_readers_disagree_are_refused(points: list[list[float]], good: bool) -> None:
    """hdplan refuses them, too: a proof about one way to cut them would be none about another."""
    lines = [*(f"v {x} {y} {z}" for x, y, z in points), f"f {' '.join(str(i + 1) for i in range(len(points)))}"]
    with nullcontext() if good else pytest.raises(RejectedError, match="readers disagree about its surface"):
        assert len(triangles(Path("a.obj"), "\n".join(lines).encode(), upright=False).mid) == len(points) - 2


FLAT = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>
<unit meter="1"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="4">
<input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 1 3 0 2 3 1 2 3</p></triangles></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
DAES: dict[str, list[tuple[str, str]]] = {  # what is replaced
    "plain": [],
    "params in another order": [('"X"', '"T"'), ('"Y"', '"X"'), ('"T"', '"Y"')],
    "a param without name": [('name="X" ', "")],
    "y is up": [("Z_UP", "Y_UP")],
    "fewer triangles": [('triangles count="4"', 'triangles count="1"')],
    "a comment in numbers": [("0 2 0 0 0 3", "0 2<!-- x -->5 0 0 0 3")],
    "underscores": [("0 2 0 0", "0 2_0 0 0")],
    "a unit without size": [('<unit meter="1"/>', '<unit name="inch"/>')],
    "turned and stretched": [("<instance_g", "<rotate>0 0 1 90</rotate><scale>1 1 2</scale><instance_g")],
    "mirrored": [("<instance_g", "<scale>-1 1 2</scale><instance_g")],
    "two kinds of vertices": [
        ('#v" offset="0"/>', '#v" offset="0"/><input semantic="VERTEX" source="#v" offset="1"/>'),
        ("0 1 2 0 1 3 0 2 3 1 2 3", "0 0 1 1 2 2 0 0 1 1 3 0"),
    ],
    "a camera": [('url="#g"/>', 'url="#g"/><instance_camera url="#q"/>')],
    "fewer numbers": [('count="12"', 'count="9"')],
    "fewer points": [('count="4" stride', 'count="3" stride')],
}


@pytest.mark.parametrize("kind", DAES)
def test_a_collada_file_is_rejected_or_has_the_triangles_of_hdplan_and_coal(kind: str, tmp_path: Path) -> None:
    text, file = functools.reduce(lambda text, change: text.replace(*change), DAES[kind], FLAT), tmp_path / "d.dae"
    assert (text == FLAT) == (kind == "plain")
    file.write_text(text)
    try:
        found = np.sort(triangles(file, file.read_bytes(), upright=False).mid.reshape(-1, 3), axis=0)
    except RejectedError:
        assert kind not in ("plain", "turned and stretched", "mirrored")
        return
    points, corners = read_mesh_file(file)
    read = coal.MeshLoader().load(str(file))
    there = read.vertices()[[[x[i] for i in range(3)] for x in map(read.tri_indices, range(read.num_tris))]]
    for other in (points[corners], there):
        np.testing.assert_allclose(np.sort(other.reshape(-1, 3), axis=0), found, atol=1e-6)


BINARY = bytes(80) + b"\1\0\0\0" + np.array([0] * 3 + [0, 0, 0, 9, 0, 0, 0, 9, 0], "<f4").tobytes() + b"\0\0"
LOOP = "facet normal 0 0 1\nouter loop\n%sendloop\nendfacet\n"


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.stl", BINARY + b"\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"),  # what follows is not the mesh
        ("a.stl", (LOOP % ("vertex 0 0 0\n" * 4) + LOOP % ("vertex 1 0 0\n" * 2)).encode()),
        ("a.stl", (LOOP % "vertex 0 0 0 vertex 9 0 0\nvertex 1 0 0\nvertex 0 1 0\n").encode()),
        ("a.obj", b"v 0 0 0\nV 9 9 9\nv 1 0 0\nv 0 1 0\nv 2 2 2\nf 1 2 3\n"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\nv 0 0 1\n"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 9 9 9\nf 1 2 3 \\\n4\n"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0 \0\nf 1 2 3\n"),
    ],
)
def test_meshes_that_others_would_read_otherwise_are_rejected(name: str, data: bytes) -> None:
    with pytest.raises((RejectedError, ValueError)):
        triangles(Path(name), data, upright=False)


def test_meshes_are_read_as_they_are_written() -> None:
    wanted = [[[0, 0, 0], [9, 0, 0], [0, 9, 0]]]
    text = (LOOP % "vertex 0 0 0\nvertex 9 0 0\nvertex 0 9 0\n").encode()
    assert triangles(Path("a.stl"), BINARY, False).mid.tolist() == wanted
    assert triangles(Path("a.stl"), b"solid x\r\n" + text.upper() + b"endsolid x\n", False).mid.tolist() == wanted
    lines = b"# a\x0cv 5 5 5\n# b\x85v 5 5 5\nv 0 0 0\rv 9 0 0\r\nv 0 9 0 1\nf 1/1/1 2//2 -1\n"
    assert triangles(Path("a.obj"), lines, False).mid.tolist() == wanted
