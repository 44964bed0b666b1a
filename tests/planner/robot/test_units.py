"""Values in degrees or millimetres stand as they are, and a note asks; what may well be meant gets none."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

import hdplan
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.yaml_format.reader import shipped_scenes

ARM = Path(shipped_scenes()["planar_arm"]).with_suffix(".urdf")
HINT = "hdplan takes"


def notes_of(scene: hdplan.Scene) -> list[str]:
    return [note for note in Setup.of(scene).notes if HINT in note]


def test_angles_of_a_scene_beyond_a_whole_turn(tmp_path: Path) -> None:
    def scene(angles: str) -> hdplan.Scene:
        box = f"{{name: b, shape: {{type: sphere, radius: 0.1}}, pose: {{position: [3, 0, 0], rpy: {angles}}}}}"
        ends = "start: {joints: [0, 0]}\ngoal: {joints: [1, 0]}"
        (tmp_path / "s.yaml").write_text(f"hdplan: 1\nrobot: {{urdf: {ARM}}}\nobstacles: [{box}]\n{ends}\n")
        return hdplan.load_scene(tmp_path / "s.yaml")

    words = "is beyond a whole turn: is it in degrees? hdplan takes radians"
    assert notes_of(scene("[180, 0, 0]")) == [f"s.yaml: obstacles[0].pose.rpy: 180 {words}"]
    assert notes_of(scene("[0, 0, -6.4]")) == [f"s.yaml: obstacles[0].pose.rpy: -6.4 {words}"]
    assert notes_of(scene("[3.1416, -6.2832, 0]")) == []
    assert f"s.yaml: obstacles[0].pose.rpy: 180 {words}" in hdplan.plan(scene("[180, 0, 0]")).notes
    with pytest.warns(UserWarning, match="rpy: 90 is beyond a whole turn"):
        hdplan.Pose.from_rpy([0, 0, 0], [90, 0, 0])


def test_angles_of_a_robot_beyond_a_whole_turn(tmp_path: Path) -> None:
    text = ARM.read_text().replace('<origin xyz="0.25 0 0"/>', '<origin xyz="0.25 0 0" rpy="0 0 180"/>')
    (tmp_path / "arm.urdf").write_text(text)
    notes = hdplan.load_robot(hdplan.RobotSpec(urdf=tmp_path / "arm.urdf")).notes
    assert [note.split(":")[0] for note in notes if HINT in note] == ["link 'upper_arm'", "link 'forearm'"]
    assert not any(HINT in note for note in hdplan.load_robot(hdplan.RobotSpec(urdf=ARM)).notes)


def test_joint_values_in_degrees() -> None:
    scene = hdplan.load_scene("planar_arm")
    words = r"is 45, outside its limits .*; is it in degrees\? hdplan takes radians$"
    for goal, message in (([45, 0], words), ([0, 3.0], r"is 3, outside its limits \[[^;]*\]$")):
        with pytest.raises(hdplan.InputError, match=message):
            hdplan.plan(scene.with_goal(goal))


@pytest.mark.parametrize("scale", [1.0, 0.001])
def test_meshes_in_millimetres(tmp_path: Path, scale: float) -> None:
    """An obstacle's and a link's meshes in metres get no note."""
    trimesh.creation.box((300.0, 400.0, 500.0)).apply_scale(scale).export(tmp_path / "thing.stl")
    place = hdplan.Pose([2000.0, 0.0, 0.0])
    thing = hdplan.Obstacle("thing", hdplan.Mesh(tmp_path / "thing.stl"), place)
    scene = hdplan.Scene(robot=hdplan.RobotSpec(urdf=ARM), obstacles=[thing], start=[0, 0], goal=[0.5, 0])
    found = notes_of(scene)
    assert [note.split(" is ")[0] for note in found] == (["obstacle 'thing': mesh thing.stl"] if scale == 1.0 else [])
    result = hdplan.plan(scene)
    assert result.certified
    assert set(found) <= set(hdplan.certify(scene, result.trajectory).notes)
    text = ARM.read_text().replace('<box size="0.56 0.06 0.04"/>', '<mesh filename="thing.stl"/>')
    (tmp_path / "arm.urdf").write_text(text)
    large = hdplan.Scene(robot=hdplan.RobotSpec(urdf=tmp_path / "arm.urdf"), start=[0, 0], goal=[0.5, 0])
    assert [note.split(" is ")[0] for note in notes_of(large)] == (["link 'upper_arm'"] if scale == 1.0 else [])
