"""What several planner tests need."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hdplan.planner.problem.clearance import PairTerm
from hdplan.planner.problem.problem import Problem
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget


@pytest.fixture
def penalties() -> Callable[[Problem, NDArray[np.float64]], NDArray[np.float64]]:
    """Give the penalty ½ Σ min(D, 0)² of a problem at single configurations (B, n) -> (B,)."""

    def penalties(problem: Problem, configurations: NDArray[np.float64]) -> NDArray[np.float64]:
        kinematics = problem.kinematics.evaluate(configurations)
        result = np.zeros(len(configurations))
        for term in problem.terms:
            assert isinstance(term, PairTerm)
            inside = term.inside(kinematics)
            np.add.at(result, inside.sample, 0.5 * inside.distance**2)
        return result

    return penalties


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
