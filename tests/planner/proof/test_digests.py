"""Laws of the digests of meshes in a proof, and of files parsed once: both depend on the files' content alone."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hdplan
from hdplan.verify import RejectedError
from hdplan.verify.compare import check_equal, digest
from hdplan.verify.reading import read_world

from .forging import put
from .worlds import packed, scene_files, unpacked, words_of

ROBOT = """<robot name="r"><link name="a"/><link name="b"><collision><geometry><mesh filename="b.stl"/></geometry>
</collision></link><joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="9" velocity="2"/></joint></robot>"""
ENDS = {"start": {"joints": [0.0]}, "goal": {"joints": [1.0]}}
SHAPE = ("bodies", 0, "shape")
BOX = {"name": "o", "shape": {"type": "box", "size": [0.1, 0.1, 0.1]}, "pose": {"position": [0.0, 0.0, 2.0]}}


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A robot of one mesh under a box, and a motion."""
    trimesh.creation.box([0.4, 0.1, 0.1]).export(tmp_path / "b.stl")
    scene = {"robot": {"urdf": "r.urdf"}, "obstacles": [BOX], **ENDS}
    motion = {"joint_names": ["j"], "positions": [[0.0], [1.0]]}
    return scene_files(tmp_path, scene, motion, {"r.urdf": ROBOT})


def test_a_mesh_by_its_digest(files: tuple[Path, Path]) -> None:
    """The mesh is not in the proof, which is accepted with it, too, and with no other one or another digest."""
    proof = hdplan.prove(*files).data
    head, world, rest = unpacked(proof)
    read = read_world(*files).world
    assert world["bodies"][0]["shape"] == digest(read["bodies"][0]["shape"])
    assert words_of(*files, proof) == words_of(*files, packed(head, read, rest))
    for change in ("points", "parts"):
        shape = copy.deepcopy(read["bodies"][0]["shape"])
        shape[change][3][1] += 1
        for other in (shape, digest(shape)):
            with pytest.raises(RejectedError, match="the worlds differ: bodies"):
                words_of(*files, packed(head, put(world, *SHAPE, to=other), rest))
    whole = world["bodies"][0]["shape"]["sha256"]
    for wrong in (whole.upper(), whole[:-1], None, [whole], ""):
        with pytest.raises(RejectedError):
            words_of(*files, packed(head, put(world, *SHAPE, to={"sha256": wrong}), rest))
    for more in ({"off": 1.0}, {"points": []}, {"type": "box"}):
        with pytest.raises(RejectedError):
            words_of(*files, packed(head, put(world, *SHAPE, to={"sha256": whole, **more}), rest))


def test_a_digest_stands_for_meshes_alone(files: tuple[Path, Path]) -> None:
    """Shapes that the proof alone could give have no digest: neither a cloud nor a box is one."""
    read = read_world(*files).world
    for place in (1, 0):
        with pytest.raises(RejectedError, match="the worlds differ: bodies"):
            check_equal(read, put(read, "bodies", place, "shape", to={"sha256": "0" * 64}))


def test_digests_tell_meshes_apart() -> None:
    """A point that becomes a triangle, or the other way round, makes another digest; a zero's sign does not."""
    rng = np.random.default_rng(0)
    points, triangles = rng.normal(size=(4, 3)), rng.integers(4, size=(3, 3))
    bits = triangles.astype("<i8").view("<f8")
    one = digest({"points": points.tolist(), "parts": triangles.tolist()})
    moved = {"points": [*points.tolist(), *bits[:1].tolist()], "parts": triangles[1:].tolist()}
    assert digest(moved) != one
    zero = digest({"points": [[0.0, 1.0, -0.0]], "parts": [[0, 0, 0]]})
    assert zero == digest({"points": [[-0.0, 1.0, 0.0]], "parts": [[0, 0, 0]]})


def test_files_that_change_are_read_again(files: tuple[Path, Path]) -> None:
    """A process keeps what it parsed by a file's content, not by its name, and nobody can change it."""
    first = read_world(*files).world
    kept = copy.deepcopy(first)
    with pytest.raises(ValueError, match="read-only"):
        first["bodies"][0]["shape"]["points"][0][0] += 1.0
    first["bodies"][0]["shape"]["off"] = 1.0
    check_equal(read_world(*files).world, kept)
    folder = files[0].parent
    trimesh.creation.box([0.6, 0.1, 0.1]).export(folder / "b.stl")
    found = read_world(*files).world["bodies"][0]["shape"]["points"]
    assert np.abs(np.array(found)).max() == np.float32(0.3)
    (folder / "r.urdf").write_text(ROBOT.replace('upper="3"', 'upper="2"'))
    assert read_world(*files).world["limits"]["position"] == [[-3.0, 2.0]]
