"""The list of robots: kept on disk, while the files that a robot is read from stay as they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from hdplan.distance.compiled.cache import content_key
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.terminal import robots
from hdplan.scenes.robot_files.library import RobotFiles
from hdplan.scenes.robot_spec import RobotSpec

from ..urdf import joint_text, link_text, robot_text

URDF = robot_text(link_text("base"), link_text("arm", box="1 1 1"), joint_text("turn", "base", "arm"), name="two")


def test_kept_counts_are_those_of_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    urdf, loads = tmp_path / "two.urdf", list[str]()
    urdf.write_text(URDF)
    read = load_robot

    def load(spec: RobotSpec) -> Robot:
        loads.append(str(spec.name))
        return read(RobotSpec(urdf=urdf))

    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(robots, "robot_names", lambda: {"two": RobotFiles(urdf, None)})
    monkeypatch.setattr(robots, "load_robot", load)
    first = robots.listing()
    assert first["robots"][0]["links"] == 1
    assert robots.listing() == first
    assert len(loads) == 1
    urdf.write_text(URDF.replace("revolute", "fixed"))  # has no joint now
    assert robots.listing()["not_usable"][0]["name"] == "two"
    urdf.write_text(URDF.replace('name="base"/>', 'name="base"/><link name="far"/>'))  # not a tree
    assert not robots.listing()["robots"]
    urdf.write_text(URDF)
    assert robots.listing() == first
    count = len(loads)
    (kept,) = (tmp_path / "cache" / "robots").glob("*.json")
    whole = kept.read_text()
    other = whole.partition("\n")[2].replace('"joints"', '"axes"')
    for number, text in enumerate((whole[:-5], f"{content_key('robots', kept.stem, other)}\n{other}"), start=1):
        kept.write_text(text)
        assert robots.listing() == first
        assert len(loads) == count + number
        assert kept.read_text() == whole
