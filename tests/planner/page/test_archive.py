"""Laws of archives: what is in one is proven by what is in it, wherever it is unpacked, and nothing else is packed."""

from __future__ import annotations

import dataclasses
import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hdplan
from hdplan.planner.page.archive import archive
from hdplan.planner.page.packing import thinned
from hdplan.planner.result import PlanResult
from hdplan.planner.view.drawing.skins import Skin
from hdplan.scenes.errors import InputError, NotProvenError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Box, Mesh
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from hdplan.verify import verify

HOOK = shipped_scenes()["panda_vase"].parent / "hook.obj"


def unpacked(data: bytes, folder: Path) -> Path:
    with zipfile.ZipFile(io.BytesIO(data)) as read:
        assert all(".." not in name and not name.startswith("/") for name in read.namelist())
        read.extractall(folder)
    (inner,) = folder.iterdir()
    return inner


def test_an_archive_is_proven_where_it_is_unpacked(result: PlanResult, tmp_path: Path) -> None:
    """Two meshes of one name among its obstacles, the originals gone: the checker needs the archive alone."""
    scene, other = load_scene("planar_arm"), tmp_path / "other" / "hook.obj"
    other.parent.mkdir()
    other.write_text(f"# another one\n{HOOK.read_text()}")
    far = [Pose((0.0, -3.0 - i, 0.0)) for i in range(2)]
    hooks = [
        Obstacle(f"hook {i}", Mesh(file), pose) for i, (file, pose) in enumerate(zip((HOOK, other), far, strict=True))
    ]
    whole = dataclasses.replace(scene, obstacles=(*scene.obstacles, *hooks))
    made = archive(whole, result.trajectory)
    other.unlink()
    folder = unpacked(made.data, tmp_path / "there")
    folder = folder.rename(tmp_path / "renamed")
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*.*")}
    assert names == {"README.txt", "page.html", "motion.json", "motion.proof"} | {
        *("planar_arm.yaml", "meshes/hook.obj", "meshes/hook_2.obj")
    }
    files = folder / "planar_arm.yaml", folder / "motion.json"
    assert str(tmp_path) not in files[0].read_text()
    assert verify(*files, folder / "motion.proof").whole
    assert hdplan.certify(hdplan.load_scene(files[0]), hdplan.Trajectory.load(files[1])).text == made.text
    assert made.text in (folder / "README.txt").read_text()
    assert made.text in (folder / "page.html").read_text()
    assert [each.name for each in hdplan.load_scene(files[0]).obstacles] == [each.name for each in whole.obstacles]
    assert "planar_arm.urdf has to be where it was" in (folder / "README.txt").read_text()


def test_an_unproven_motion_is_not_packed(result: PlanResult) -> None:
    """An obstacle in the way, a motion that ends elsewhere, a mesh that is gone."""
    scene = load_scene("planar_arm")
    ball, prism = scene.obstacles
    grown = dataclasses.replace(scene, obstacles=(dataclasses.replace(ball, shape=Box((3.0, 3.0, 3.0))), prism))
    with pytest.raises(NotProvenError, match="contact"):
        archive(grown, result.trajectory)
    with pytest.raises(NotProvenError):
        archive(scene, result.trajectory.between(0, 5))
    gone = Obstacle("gone", Mesh(HOOK), Pose((0.0, -3.0, 0.0)))
    gone = dataclasses.replace(gone, shape=dataclasses.replace(gone.shape, file=Path("/nowhere/hook.obj")))
    with pytest.raises(InputError, match="nowhere"):
        archive(dataclasses.replace(scene, obstacles=(*scene.obstacles, gone)), result.trajectory)


@pytest.mark.core
def test_thinned_meshes_stay_where_they_are() -> None:
    """Fewer triangles, none farther than a cell from where it was, sharp edges of a box as sharp."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    skins = [Skin("link", 1, ball.vertices, ball.faces, (0, 0, 0))]
    assert thinned(skins, len(ball.faces)) is skins
    (thin,) = thinned(skins, 5000)
    assert 1000 < len(thin.triangles) <= 5000
    assert thin.triangles.max() == len(thin.vertices) - 1
    np.testing.assert_allclose(np.linalg.norm(thin.vertices, axis=1), 0.1, atol=0.004)
    assert abs(trimesh.Trimesh(thin.vertices, thin.triangles).volume / ball.volume - 1.0) < 0.05
    box = trimesh.creation.box((0.2, 0.2, 0.2)).subdivide().subdivide()
    corners = box.vertices[box.faces].reshape(-1, 3)  # each triangle with corners of its own
    boxes = [Skin("link", 1, corners, np.arange(len(corners)).reshape(-1, 3), (0, 0, 0))]
    (sharp,) = thinned(boxes, 150)
    assert len(sharp.triangles) <= 150
    np.testing.assert_allclose(np.abs(sharp.vertices).max(axis=1), 0.1, atol=1e-6)  # on its faces still
