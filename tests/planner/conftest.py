"""What several planner tests need."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hdplan.scenes.model import JointTarget, Obstacle, RobotSpec, Scene


@pytest.fixture
def stick_scene(tmp_path: Path) -> Callable[[Obstacle], Scene]:
    """Give the scene of one obstacle and a robot that nothing can touch: its links have no collision geometry."""
    urdf = tmp_path / "stick.urdf"
    urdf.write_text(
        '<robot name="stick"><link name="base"/><link name="tip"/><joint name="turn" type="revolute">'
        '<parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )

    def scene(obstacle: Obstacle) -> Scene:
        start, goal = JointTarget("start", (-0.5,)), JointTarget("goal", (0.5,))
        return Scene("stick", tmp_path / "stick.yaml", RobotSpec(urdf=urdf), (obstacle,), start, goal)

    return scene
