"""The scenes that come with hdplan."""

from __future__ import annotations

from pathlib import Path

import pytest

from hdplan.scenes.errors import InputError
from hdplan.scenes.shapes import Mesh
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

NAMES = sorted(shipped_scenes())  # the gallery of the pages has the same


@pytest.mark.parametrize("name", NAMES)
def test_each_is_found_by_its_bare_name_and_says_what_it_shows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = load_scene(name)
    assert scene.name == name
    assert scene.notes == ()
    assert scene.source.read_text(encoding="utf-8").startswith("# ")


def test_they_use_every_shape() -> None:
    shapes = {type(obstacle.shape).__name__ for name in NAMES for obstacle in load_scene(name).obstacles}
    assert shapes == {"Box", "Sphere", "Cylinder", "Capsule", "Points", "Mesh", "Cloud"}


def test_the_files_they_name_are_shipped_too() -> None:
    meshes = [o.shape.file for name in NAMES for o in load_scene(name).obstacles if isinstance(o.shape, Mesh)]
    robot = load_scene("planar_arm").robot
    assert all(file is not None and file.parent == robot.urdf.parent for file in [*meshes, robot.srdf] if robot.urdf)


def test_a_file_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = shipped_scenes()["empty"].read_text(encoding="utf-8")
    Path("empty").write_text(text, encoding="utf-8")
    assert load_scene("empty").source == Path("empty")


def test_a_misspelt_name_is_answered_with_the_nearest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"panda_coridor: no such file .*'panda_corridor'"):
        load_scene("panda_coridor")
    with pytest.raises(InputError, match=r"zzz\.yaml: no such file \(shipped scenes: baxter_bimanual_carry, empty"):
        load_scene("zzz.yaml")
