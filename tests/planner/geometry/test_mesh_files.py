"""Mesh files: every format reads as it was written, and whatever is wrong with a file is one line that names it."""

from __future__ import annotations

import json
import os
import random
import re
from base64 import b64encode
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hdplan import InputError, Mesh
from hdplan.planner.certificate.exact_proximity import MOST_PIECES, mesh_pieces
from hdplan.planner.geometry import mesh_files
from hdplan.planner.geometry.meshes import load_mesh

NUMBER = re.compile(rb"-?\d+(\.\d+)?(e-?\d+)?")
WRONG = b"nan inf -1 0 1e308 -1e400 999999999 4294967295 99999999999999999999 2147483648 abc 1e-320 3.5 1e5".split()
BLOCKS = [b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"\xff\xff\xff\x7f", b"\x00\x00\xc0\x7f"]


def contents(mesh: trimesh.Trimesh) -> dict[tuple[str, str], bytes]:
    """A mesh as each format has it: (ending, variant) -> file."""
    written = {
        ("stl", "binary"): mesh.export(file_type="stl"),
        ("stl", "ascii"): mesh.export(file_type="stl_ascii"),
        ("obj", ""): mesh.export(file_type="obj"),
        ("ply", "ascii"): mesh.export(file_type="ply", encoding="ascii"),
        ("ply", "binary"): mesh.export(file_type="ply"),
        ("off", ""): mesh.export(file_type="off"),
        ("dae", ""): mesh.export(file_type="dae"),
        ("glb", ""): mesh.export(file_type="glb"),
    }
    parts = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh))
    header = json.loads(parts["model.gltf"])
    for buffer in header["buffers"]:
        buffer["uri"] = "data:application/octet-stream;base64," + b64encode(parts[buffer["uri"]]).decode()
    written["gltf", ""] = json.dumps(header).encode()
    return {kind: text.encode() if isinstance(text, str) else text for kind, text in written.items()}


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Cut a file short, flip bytes, write wrong numbers, drop or repeat lines."""
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        if len(data) < 8:
            return data
        match rng.randrange(7):
            case 0:
                data = data[: rng.randrange(len(data))]
            case 1:
                flipped = bytearray(data)
                for _ in range(rng.choice([1, 3, 20])):
                    flipped[rng.randrange(len(flipped))] = rng.randrange(256)
                data = bytes(flipped)
            case 2 | 3 | 4:
                if numbers := list(NUMBER.finditer(data)):
                    found = rng.choice(numbers[: rng.choice([5, len(numbers)])])  # the first ones count what follows
                    data = data[: found.start()] + rng.choice(WRONG) + data[found.end() :]
            case 5:
                lines = data.split(b"\n")
                lines[rng.randrange(len(lines))] = lines[rng.randrange(len(lines))]
                data = b"\n".join(lines)
            case 6:
                at = rng.randrange(len(data) - 4)
                data = data[:at] + rng.choice(BLOCKS) + data[at + 4 :]
    return data


def solids() -> list[trimesh.Trimesh]:
    box = trimesh.creation.box((0.2, 0.3, 0.4))
    two = trimesh.util.concatenate([box, box.copy().apply_translation([1, 0, 0])])
    return [box, trimesh.creation.icosphere(1, 0.2), two]


def area(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The vector area of each triangle (F, 3): its size, and which way it looks."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    return np.cross(b - a, c - a) / 2


def test_every_format_reads_as_it_was_written(tmp_path: Path) -> None:
    for mesh in solids():
        for (ending, _), data in contents(mesh).items():
            path = tmp_path / f"mesh.{ending}"
            path.write_bytes(data)
            vertices, triangles = mesh_files.read_mesh_file(path)
            assert triangles.shape == mesh.faces.shape
            meshes = (vertices, triangles), (mesh.vertices, mesh.faces)
            found, written = (np.sort(area(*each), axis=0) for each in meshes)
            np.testing.assert_allclose(found, written, atol=1e-6)
            np.testing.assert_allclose(vertices.min(axis=0), mesh.bounds[0], atol=1e-6)


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Any damage gives a mesh of finite size, or InputError; nothing on the error stream, no other exception."""
    rng, read = random.Random(0), 0
    files = [item for mesh in solids() for item in contents(mesh).items()]
    for _ in range(700):
        (ending, _), data = rng.choice(files)
        path = tmp_path / f"mesh.{ending}"
        path.write_bytes(damaged(data, rng))
        try:
            mesh = load_mesh(Mesh(path), "obstacles.thing")
        except InputError as error:
            message = str(error)
        else:
            read, message = read + 1, ""
            assert np.isfinite(mesh.vertices).all()
            assert len(mesh_pieces(mesh)) <= MOST_PIECES
        if message:
            where, words = message.split(f"mesh {path}: ", 1)
            assert where == "obstacles.thing: "
            assert words.isprintable()
            assert len(words) < 300
    assert 40 < read < 300
    assert capfd.readouterr() == ("", "")


def test_a_file_cut_short_is_refused(tmp_path: Path) -> None:
    """All but an OBJ say how much they hold; of a line that is cut short, only a digit may go unnoticed."""
    rng = random.Random(0)
    for (ending, _), data in contents(solids()[0]).items():
        end = len(data.rstrip()) if ending != "obj" else data.rindex(b"\nv ")
        end = data.rindex(b"\n", 0, end) if ending in ("ply", "off") and b"\n" in data[-40:] else end
        for _ in range(40):
            path = tmp_path / f"mesh.{ending}"
            path.write_bytes(data[: rng.randrange(end)])
            with pytest.raises(InputError, match=r"obstacles\.thing: mesh"):
                load_mesh(Mesh(path), "obstacles.thing")


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", TRIANGLE + "f 1 2 0\n", "line 7: 'f 1 2 0': there is no such vertex"),
        ("a.obj", TRIANGLE + "f 1 2 -5\n", "line 7: 'f 1 2 -5': there is no such vertex"),
        ("a.obj", TRIANGLE + "f 1 2 5\n", "has vertex 4 .* there are 4 vertices"),
        ("a.obj", TRIANGLE + "f 1 2\n", "line 7: 'f 1 2': a face has at least 3 vertices"),
        ("a.obj", TRIANGLE + "v 0 0\n", "line 7: 'v 0 0': a vertex has 3 coordinates"),
        ("a.stl", "solid a\nfacet normal 0 0 1\nvertex 0 0 0\nendfacet\n", "line 3: 'vertex 0 0 0': 'outer loop' is"),
        ("a.stl", "solid a\nfacet normal 0 0 z\n", "line 2: '0 0 z': numbers are expected"),
        ("a.stl", "x" * 200, "is not an STL file, or is damaged: binary, it would have"),
        ("a.off", "OFF\n3 4 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "is cut short: it says 3 vertices and 4 faces"),
        ("a.off", "OFF\n1e308 4 0\n", "line 2: '1e308 4 0': the numbers of vertices, faces and edges are expected"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "line 6: says 3 vertices and holds 2"),
        ("a.3mf", "", r"format '.3mf' is not known \(allowed: dae, glb, gltf, obj, off, ply, stl\)"),
        ("a.stp", "", r"format '.stp' is not known \(did you mean 'stl'\?\)"),
    ],
)
def test_an_error_in_a_mesh_file_is_reported_with_its_line(tmp_path: Path, name: str, content: str, words: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=words):
        mesh_files.read_mesh_file(tmp_path / name)


def test_faces_of_an_obj_may_count_back_and_have_more_than_three_corners(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0 1 1 1\n  f -4//1 -3/2/1 \\\n -2 -1  # a square\nv 0 0 1\nf -1 1 2\n"
    (tmp_path / "a.obj").write_text(text)
    vertices, triangles = mesh_files.read_mesh_file(tmp_path / "a.obj")
    assert len(vertices) == 5
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 0, 1]]


def test_files_that_are_not_regular_are_refused_at_once(tmp_path: Path) -> None:
    """Their endings come second: a folder's name seldom has one."""
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "folder").mkdir()
    for name, words in (("pipe.stl", "is a pipe, not"), ("folder", "is a directory, not"), ("none", "no such file")):
        with pytest.raises(InputError, match=words):
            mesh_files.read_mesh_file(tmp_path / name)


def test_a_gltf_file_costs_no_more_than_it_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers without data, files beside it that never end, and the same part a thousand times over."""
    path = tmp_path / "a.gltf"
    text = contents(solids()[0])["gltf", ""]
    header = json.loads(text)
    del header["accessors"][0]["bufferView"]
    header["accessors"][0]["count"] = 10**11
    path.write_text(json.dumps(header))
    with pytest.raises(InputError, match="count is 100000000000; 1 to 3000000 are read"):
        mesh_files.read_mesh_file(path)

    header = json.loads(text)
    header["buffers"][0]["uri"] = "endless.bin"
    (tmp_path / "endless.bin").symlink_to("/dev/zero")
    path.write_text(json.dumps(header))
    with pytest.raises(InputError, match=r"names the file 'endless.bin', which cannot be used: is a device"):
        mesh_files.read_mesh_file(path)

    header = json.loads(text)
    mesh = next(node for node in header["nodes"] if "mesh" in node)
    header["nodes"] += [{"mesh": mesh["mesh"], "name": f"again{i}"} for i in range(99)]
    header["scenes"][0]["nodes"] += range(len(header["nodes"]) - 99, len(header["nodes"]))
    path.write_text(json.dumps(header))
    assert len(mesh_files.read_mesh_file(path)[1]) == 1200
    monkeypatch.setattr(mesh_files, "MOST_TRIANGLES", 1000)
    with pytest.raises(InputError, match="has 1200 triangles; at most 1000"):
        mesh_files.read_mesh_file(path)
    monkeypatch.setattr("hdplan.scenes.files.MOST_BYTES", 1000)
    with pytest.raises(InputError, match="at most 0 MB are read"):
        mesh_files.read_mesh_file(path)
