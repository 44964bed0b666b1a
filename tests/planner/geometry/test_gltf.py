"""glTF: what is written is what is read, as other readers have it, too; whatever else is refused by name."""

from __future__ import annotations

import copy
import json
import math
import struct
from base64 import b64encode
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan import InputError, Mesh
from hdplan.planner.geometry.mesh_files import files_beside, mesh_stamps
from hdplan.planner.geometry.meshes import load_mesh
from tests.planner.geometry.other_readers import SAME, apart, by_assimp, by_trimesh, judged, read

KINDS = {"<i1": 5120, "<u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}
TYPES = {1: "SCALAR", 3: "VEC3"}
QUANTIZED = "KHR_mesh_quantization"


class Writer:
    """A glTF file made at random: legal, as odd as exporters are, and what its scene holds."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.odd = rng, set[str]()
        self.data, self.most = bytearray(), int(rng.choice([1, 2, 3]))
        if self.most > 1:
            self.odd.add("several parts")
        self.top: dict[str, Any] = {"asset": {"version": "2.0", "generator": "é"}, "bufferViews": [], "accessors": []}
        if rng.random() < 0.3:
            self.odd.add("quantized")
            self.top["extensionsRequired"] = self.top["extensionsUsed"] = [QUANTIZED]
        meshes = [self.mesh() for _ in range(self.most)]
        self.top["meshes"] = [mesh for mesh, _ in meshes]
        self.top["nodes"] = []
        tops = [self.node(meshes, int(rng.integers(1, self.most + 1))) for _ in range(self.most)]
        self.top["scenes"] = [{"nodes": [index for index, _ in tops], "name": "s"}]
        if rng.random() < 0.8:
            self.top["scene"] = 0
        if "scene" in self.top and rng.random() < 0.3:  # one that is not shown
            self.top["scenes"].insert(0, {"nodes": [self.node(meshes, 1)[0]]})
            self.top["scene"] = 1
            self.odd.add("scenes")
        self.top |= rng.choice([{}, {"materials": [{"doubleSided": True}], "extras": {"a": 1}, "cameras": []}])
        if rng.random() < 0.2 and "extensionsUsed" not in self.top:
            self.top["extensionsUsed"] = ["KHR_materials_unlit"]
        self.top["buffers"] = [{"byteLength": len(self.data)}]
        self.triangles = np.concatenate([each for _, each in tops])

    def view(self, rows: np.ndarray, stride: int = 0, declared: bool = False) -> int:
        """Store rows of values, `stride` bytes apart."""
        width = rows.dtype.itemsize * rows.shape[1]
        stride = max(stride, width)
        self.data += bytes(-len(self.data) % 4)
        first = len(self.data)
        for row in rows:
            self.data += row.tobytes() + self.rng.bytes(stride - width)
        view = {"buffer": 0, "byteOffset": first, "byteLength": len(self.data) - first}
        if first == 0 and self.rng.random() < 0.5:
            del view["byteOffset"]
        self.top["bufferViews"].append(view | ({"byteStride": stride} if declared else {}))
        return len(self.top["bufferViews"]) - 1

    def accessor(self, rows: np.ndarray, normalized: bool = False) -> int:
        """Store the points or the corners (n, k)."""
        kind, size = rows.dtype.str.replace("|", "<"), rows.shape[1]
        stride = -(-rows.dtype.itemsize * size // 4) * 4 + 4 * int(self.rng.integers(0, 3)) if size == 3 else 0
        spread = size == 3 and (self.rng.random() < 0.4 or rows.dtype.itemsize < 4)
        stored = rows.copy()
        found: dict[str, Any] = {"componentType": KINDS[kind], "count": len(rows), "type": TYPES[size]}
        if sparse := bool(size == 3 and self.rng.random() < 0.1):
            self.odd.add("sparse")
            changed = np.sort(self.rng.permutation(len(rows))[: self.rng.integers(1, len(rows))])
            stored[changed] = 1
            at = np.array(changed, dtype="<u2")[:, None]
            found["sparse"] = {
                "count": len(changed),
                "indices": {"bufferView": self.view(at), "componentType": 5123},
                "values": {"bufferView": self.view(rows[changed])},
            }
        found["bufferView"] = self.view(stored, stride if spread else 0, bool(spread))
        if size == 3:
            found |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        if normalized:
            found["normalized"] = True
        if sparse and self.rng.random() < 0.5 and not rows[np.setdiff1d(np.arange(len(rows)), changed)].any():
            del found["bufferView"]
        self.top["accessors"].append(found)
        return len(self.top["accessors"]) - 1

    def mesh(self) -> tuple[dict[str, Any], np.ndarray]:
        made = [self.primitive() for _ in range(self.rng.integers(1, self.most + 1))]
        return {"primitives": [each for each, _ in made]}, np.concatenate([each for _, each in made])

    def primitive(self) -> tuple[dict[str, Any], np.ndarray]:
        count = int(self.rng.integers(4, 12))
        if "quantized" in self.odd and self.rng.random() < 0.7:
            kind = str(self.rng.choice(["<i1", "<u1", "<i2", "<u2"]))
            about, normalized = np.iinfo(kind), bool(self.rng.random() < 0.6)
            rows = self.rng.integers(about.min, about.max, (count, 3), endpoint=True).astype(kind)
            points = np.maximum(rows / about.max, -1.0) if normalized else rows.astype(np.float64) / 1.0
        else:
            rows, normalized = self.rng.uniform(-2, 2, (count, 3)).astype("<f4"), False
            points = rows.astype(np.float64)
        mode = int(self.rng.choice([4, 4, 4, 4, 4, 4, 5, 6]))
        if mode > 4:
            self.odd.add("strip or fan")
        corners = self.rng.permutation(count)[: self.rng.integers(3, count + 1)]
        corners = corners[: len(corners) // 3 * 3] if mode == 4 else corners
        found: dict[str, Any] = {"attributes": {"POSITION": self.accessor(rows, normalized)}}
        if mode != 4 or self.rng.random() < 0.5:
            found["mode"] = mode
        if self.rng.random() < 0.8 or (mode == 4 and count % 3):
            kind = str(self.rng.choice(["<u1", "<u2", "<u4"]))
            found["indices"] = self.accessor(corners[:, None].astype(kind))
        else:
            corners = np.arange(count)
        if self.rng.random() < 0.3:
            found["attributes"]["_OWN"] = 0
            found["extras"] = {"targetNames": []}
        rows_of = [corners[k : k + 3] for k in range(0, len(corners) - 2, 3 if mode == 4 else 1)]
        if mode == 5:
            rows_of = [row[[0, 2, 1]] if k % 2 else row for k, row in enumerate(rows_of)]
        elif mode == 6:
            rows_of = [np.array([corners[0], *row[1:]]) for row in rows_of]
            rows_of = [np.array([corners[0], corners[k + 1], corners[k + 2]]) for k in range(len(corners) - 2)]
        return found, points[np.array(rows_of)]

    def node(self, meshes: list[tuple[dict[str, Any], np.ndarray]], depth: int) -> tuple[int, np.ndarray]:
        found: dict[str, Any] = {"name": "n"}
        matrix = np.eye(4)
        if self.rng.random() < 0.3:
            self.odd.add("matrix")
            matrix[:3] = np.eye(4)[:3] + self.rng.uniform(-0.4, 0.4, (3, 4))
            found["matrix"] = matrix.T.ravel().tolist()
        else:
            if self.rng.random() < 0.5:
                found["translation"] = (at := self.rng.uniform(-2, 2, 3)).tolist()
                matrix[:3, 3] = at
            if self.rng.random() < 0.5:
                axis, angle = self.rng.integers(3), self.rng.uniform(-3, 3)
                i, j = (axis + 1) % 3, (axis + 2) % 3
                found["rotation"] = [0.0, 0.0, 0.0, math.cos(angle / 2)]
                found["rotation"][axis] = math.sin(angle / 2)
                matrix[i, i] = matrix[j, j] = math.cos(angle)
                matrix[j, i], matrix[i, j] = math.sin(angle), -math.sin(angle)
            if self.rng.random() < 0.5:
                scale = self.rng.uniform(0.3, 2, 3) * (1 if self.rng.random() < 0.95 else np.array([-1, 1, 1]))
                found["scale"] = scale.tolist()
                matrix[:3, :3] = matrix[:3, :3] * scale
        inside = [np.empty((0, 3, 3))]
        if depth == 1 or self.rng.random() < 0.5:
            found["mesh"] = k = int(self.rng.integers(len(meshes)))
            inside.append(meshes[k][1])
        if depth > 1:
            child, triangles = self.node(meshes, depth - 1)
            found["children"] = [child]
            inside.append(triangles)
        placed = np.concatenate(inside) @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0:
            self.odd.add("mirrored")
        self.top["nodes"].append(found)
        return len(self.top["nodes"]) - 1, placed[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else placed

    def saved(self, folder: Path) -> Path:
        """Write the file: its buffer in it, beside it, or in one with it."""
        top, kind = copy.deepcopy(self.top), self.rng.integers(3)
        if kind == 0:
            text = json.dumps(top).encode()
            text += b" " * (-len(text) % 4)
            data = bytes(self.data) + bytes(-len(self.data) % 4)
            whole = struct.pack("<4s2I", b"glTF", 2, 28 + len(text) + len(data))
            whole += struct.pack("<2I", len(text), 0x4E4F534A) + text + struct.pack("<2I", len(data), 0x004E4942) + data
            (folder / "a.glb").write_bytes(whole)
            return folder / "a.glb"
        if kind == 1:
            top["buffers"][0]["uri"] = "data:application/octet-stream;base64," + b64encode(self.data).decode()
        else:
            if escaped := self.rng.random() < 0.3:
                self.odd.add("escaped")
            top["buffers"][0]["uri"] = "a%20b.bin" if escaped else "ab.bin"
            (folder / ("a b.bin" if escaped else "ab.bin")).write_bytes(self.data)
        (folder / "a.gltf").write_text(json.dumps(top, indent=self.rng.choice([0, 2])), encoding="utf-8")
        return folder / "a.gltf"


# What in a file other readers read otherwise than it is meant: names are not unescaped, whole numbers not normalized,
# strips turned, fans and sparse accessors left out, mirrored parts not turned; coal mixes the vertices of parts.
FAULTS = {
    by_trimesh: {"escaped", "quantized", "sparse", "strip or fan"},
    by_assimp: {"escaped", "quantized", "sparse", "mirrored", "several parts"},
}


def test_500_files_are_read_as_written_and_as_others_read_them(tmp_path: Path) -> None:
    confirmed = Counter[str]()
    for seed in range(500):
        made = Writer(np.random.default_rng(seed))
        path = made.saved(tmp_path)
        ours = read(path)
        assert ours.shape == made.triangles.shape
        np.testing.assert_allclose(ours, made.triangles, rtol=0, atol=1e-12 * np.abs(ours).max(initial=0))
        for reader, faults in FAULTS.items():
            if not faults & made.odd:
                theirs = reader(path)
                assert theirs is not None, (seed, reader)
                assert apart(ours, theirs) <= SAME, (seed, reader)
                confirmed[reader.__name__] += 1
    assert min(confirmed.values()) > 80


def places(value: Any) -> list[tuple[Any, Any]]:
    """All places (container, key) of a JSON value."""
    keys = list(value) if isinstance(value, dict) else list(range(len(value))) if isinstance(value, list) else []
    return [(value, key) for key in keys] + [each for key in keys for each in places(value[key])]


def spoil(top: dict[str, Any], rng: np.random.Generator) -> None:
    """Change one thing: a key, a value, or something more."""
    found = places(top)
    owner, key = found[rng.integers(len(found))]
    values = [0, 1, 2, -1, 1.5, 5125, 5123, 5121, 5126, True, "SCALAR", "VEC3", None, [], {}, 10**9, [0, 0, 0, 1], "x"]
    match rng.integers(4):
        case 0:
            owner[key] = values[rng.integers(len(values))]
        case 1 if isinstance(owner, dict):
            del owner[key]
        case 2 if isinstance(owner, dict):
            owner[f"{key}s"] = owner.pop(key)
        case _:
            objects = [each[key] for each, key in found if isinstance(each[key], dict)]
            more = [("extensions", {"EXT_mesh_gpu_instancing": {}}), ("skin", 0), ("targets", [{"POSITION": 0}])]
            more += [("normalized", True), ("byteStride", 16), ("byteOffset", 4), ("scale", [2, 2, 2]), ("mode", 5)]
            more += [("sparse", {}), ("children", [0]), ("weights", [1]), ("extras", 0), ("translations", [1, 2, 3])]
            name, value = more[rng.integers(len(more))]
            objects[rng.integers(len(objects))][name] = value


def test_spoilt_files_are_refused_or_read_as_others_read_them(tmp_path: Path) -> None:
    """A change is refused in one line, or changes no geometry, or others see the same change."""
    counts = Counter[str]()
    for seed in range(800):
        made = Writer(np.random.default_rng(seed % 200))
        if FAULTS[by_assimp] & made.odd:
            continue
        before = made.triangles
        spoil(made.top, np.random.default_rng([1, seed]))
        made.top.setdefault("buffers", [{}])
        try:
            path = made.saved(tmp_path)
        except (TypeError, IndexError, KeyError):  # no buffer that could be written
            continue
        if "escaped" in made.odd:
            continue

        def others(path: Path = path) -> list[np.ndarray]:
            return [theirs for theirs in (by_assimp(path), by_trimesh(path)) if theirs is not None]

        counts[judged(path, before, others)] += 1
    assert counts["refused"] > 80
    assert counts["as others have it"] > 0


def plain() -> dict[str, Any]:
    """A pyramid of four triangles, its buffer in the file."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4").tobytes()
    data = points + np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], dtype="<u2").tobytes()
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}, {}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "buffers": [{"byteLength": 72, "uri": "data:application/octet-stream;base64," + b64encode(data).decode()}],
    }


def put(*keys: Any) -> Callable[[dict[str, Any]], None]:
    """Give what stands at some keys another value, the last of them."""

    def change(top: Any) -> None:
        *way, key, value = keys
        for each in way:
            top = top[each]
        top[key] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("asset", {"version": "1.0"}), "asset: version is '1.0'; glTF 2.0 is read"),
        (put("asset", "minVersion", "2.1"), "minVersion is '2.1'"),
        (put("extensionsRequired", ["FOO_bar"]), "extensionsRequired uses the extension 'FOO_bar': it is not known"),
        (put("extensionsUsed", ["KHR_draco_mesh_compression"]), "compressed geometry is not read"),
        (put("nodes", 0, "extensions", {"EXT_mesh_gpu_instancing": {}}), "instances of an extension are not read"),
        (put("nodes", 1, "extensions", {"KHR_node_visibility": {}}), "hidden nodes are not read"),
        (put("bufferViews", 0, "extensions", {"EXT_meshopt_compression": {}}), "compressed geometry"),
        (put("animations", [{}]), "has animations: parts that move are not read"),
        (put("meshs", []), r"the file has the key 'meshs', which is not known \(did you mean 'meshes'\?\)"),
        (put("nodes", 0, "skin", 0), "has a skin or morph targets"),
        (put("nodes", 0, "weights", [1]), "has a skin or morph targets"),
        (put("meshes", 0, "weights", [0]), "has morph targets"),
        (put("meshes", 0, "primitives", 0, "targets", []), "has morph targets"),
        (put("meshes", 0, "primitives", 0, "mode", 7), "mode is 7; 0 to 6 are known"),
        (put("meshes", 0, "primitives", 0, "attributes", {}), "has no POSITION"),
        (put("meshes", 0, "primitives", 0, "attributes", {"POSITION": 0, "POS": 0}), "'POS' is not known"),
        (put("accessors", 0, "componentType", 5122), r"componentType is 5122 \(allowed here: 5126\)"),
        (put("accessors", 0, "type", "VEC4"), "type is 'VEC4'; VEC3 is needed"),
        (put("accessors", 0, "normalized", True), "normalized is True, of componentType 5126"),
        (put("accessors", 1, "normalized", True), "normalized is True, of indices"),
        (put("accessors", 1, "count", 11), "has 11 corners, which are not whole triangles"),
        (put("accessors", 1, "count", 12.0), "count is 12.0; a whole number"),
        (put("accessors", 0, "count", 3), r"has vertex 3 \(counted from 0\); there are 3"),
        (put("accessors", 0, "count", 10**11), "count is 100000000000; 1 to 3000000 are read"),
        (put("accessors", 0, {"componentType": 5126, "count": 4, "type": "VEC3"}), "has no bufferView"),
        (put("accessors", 0, "sparse", {"count": 5, "indices": {}, "values": {}}), "count is 5; 1 to 4 are possible"),
        (put("bufferViews", 0, "byteStride", 8), "byteStride is 8, for values of 12 bytes"),
        (put("bufferViews", 1, "byteStride", 4), "byteStride is 4, for values of 2 bytes"),
        (put("bufferViews", 1, "byteOffset", 50), "reaches beyond its buffer, which has 72 bytes"),
        (put("bufferViews", 1, "byteLength", 22), "reaches beyond bufferViews"),
        (put("buffers", 0, "byteLength", 76), "is cut short: it says 76 bytes and has 72"),
        (put("buffers", 0, {"byteLength": 72}), "has no uri, and no binary chunk of 72 bytes"),
        (put("buffers", 0, "uri", "data:application/octet-stream;base64,AA*A"), "is not base64"),
        (put("buffers", 0, "uri", "data:text/plain,abc"), "base64 of application/octet-stream is read"),
        (put("buffers", 0, "uri", "http://example.org/a.bin"), "only files in its own folder"),
        (put("buffers", 0, "uri", "../a.bin"), "only files in its own folder"),
        (put("buffers", 0, "uri", "%2e%2e/a.bin"), "only files in its own folder"),
        (put("buffers", 0, "uri", "/a.bin"), "only files in its own folder"),
        (put("buffers", 0, "uri", "a%zz.bin"), "only files in its own folder"),
        (put("buffers", 0, "uri", "missing.bin"), "names the file 'missing.bin', which cannot be used: no such file"),
        (put("nodes", 0, "children", [0]), r"nodes\[0\] appears 2 times"),
        (put("scenes", 0, "nodes", [0, 0]), r"nodes\[0\] appears 2 times"),
        (put("nodes", 0, "children", [7]), r"refers to nodes\[7\]; there are 2"),
        (put("nodes", 0, "matrix", [1.0] * 16), "not an affine map"),
        (put("nodes", 0, "rotation", [0, 0, 0, 2]), "rotation has length 2"),
        (put("nodes", 0, "scale", [1, 1]), "scale is .*; 3 numbers are needed"),
        (put("nodes", 0, "scale", [1, 1, 10**400]), "scale is .*; 3 numbers are needed"),
        (put("nodes", 0, "translation", [1, 1, True]), "translation is .*; 3 numbers are needed"),
        (put("scene", 3), r"refers to scenes\[3\]"),
        (put("scenes", [{}]), "is empty, it holds no triangles"),
    ],
)
def test_unsupported_content_is_refused_by_name(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    path, top = tmp_path / "a.gltf", plain()
    path.write_text(json.dumps(top))
    assert len(read(path)) == 4
    change(top)
    path.write_text(json.dumps(top))
    with pytest.raises(InputError, match=words):
        read(path)


def test_files_that_are_neither_json_nor_glb_are_refused(tmp_path: Path) -> None:
    text = json.dumps(plain())
    padded = text.encode() + b" " * (-len(text) % 4)
    whole = struct.pack("<4s4I", b"glTF", 2, 20 + len(padded), len(padded), 0x4E4F534A) + padded
    chunk = struct.pack("<2I", 4, 0x12345678) + bytes(4)
    for data, words in [
        (text.replace('"scene": 0', '"scene": 0, "scene": 0').encode(), "the key 'scene' appears twice"),
        (text.replace('"scene": 0', '"scene": NaN').encode(), "holds NaN"),
        (b"\xff" + text.encode(), "is no JSON in UTF-8"),
        (text.encode()[:-1], "is no JSON in UTF-8, or cut short"),
        (b"[" * 100_000, "is no JSON"),
        (whole[:-4], "says that it has"),
        (whole[:4] + b"\1" + whole[5:], "is of glb version 1"),
        (whole[:8] + struct.pack("<I", len(whole) + 12) + whole[12:] + chunk, "other content than one binary chunk"),
    ]:
        (tmp_path / "a.glb").write_bytes(data)
        with pytest.raises(InputError, match=words):
            read(tmp_path / "a.glb")
    (tmp_path / "a.glb").write_bytes(whole)
    assert len(read(tmp_path / "a.glb")) == 4


def test_one_of_several_scenes_is_named_or_the_file_is_refused(tmp_path: Path) -> None:
    top = plain()
    del top["scene"]
    (tmp_path / "a.gltf").write_text(json.dumps(top))
    assert len(read(tmp_path / "a.gltf")) == 4
    top["scenes"].append({"nodes": [1]})
    (tmp_path / "a.gltf").write_text(json.dumps(top))
    with pytest.raises(InputError, match="has 2 scenes and does not say which is shown"):
        read(tmp_path / "a.gltf")


def test_a_buffer_beside_a_file_belongs_to_it(tmp_path: Path) -> None:
    """A changed buffer is a changed mesh, for everybody who keeps meshes by their stamps."""
    top, path, beside = plain(), tmp_path / "a.gltf", tmp_path / "a b.bin"
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    rows = np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], dtype="<u2")
    top["buffers"][0]["uri"] = "a%20b.bin"
    path.write_text(json.dumps(top))
    beside.write_bytes(corners.tobytes() + rows.tobytes())
    assert files_beside(path) == (beside,)
    before, mesh = mesh_stamps([path]), load_mesh(Mesh(path), "thing")
    beside.write_bytes((2 * corners).tobytes() + rows.tobytes() + b"\0")
    assert mesh_stamps([path]) != before
    assert np.array_equal(load_mesh(Mesh(path), "thing").vertices, 2 * mesh.vertices)
    beside.unlink()
    assert mesh_stamps([path]) != before
    path.write_text("{")
    assert files_beside(path) == ()


def test_quantized_points_are_what_their_type_says(tmp_path: Path) -> None:
    """Whole numbers stand as they are, or normalized: the least of a signed type stands for -1, too."""
    for normalized, expected in ((False, [-32768, 32767, 100]), (True, [-1.0, 1.0, 100 / 32767])):
        top, rows = plain(), np.array([[-32768, 32767, 100], [1, 0, 0], [0, 1, 0]], dtype="<i2")
        top["extensionsRequired"] = [QUANTIZED]
        top["buffers"] = [{"byteLength": 18, "uri": "data:;base64," + b64encode(rows.tobytes()).decode()}]
        top["accessors"] = [{"bufferView": 0, "componentType": 5122, "count": 3, "type": "VEC3"}]
        top["accessors"][0]["normalized"] = normalized
        top["bufferViews"] = [{"buffer": 0, "byteLength": 18}]
        del top["meshes"][0]["primitives"][0]["indices"]
        (tmp_path / "a.gltf").write_text(json.dumps(top))
        assert read(tmp_path / "a.gltf")[0, 0].tolist() == expected
