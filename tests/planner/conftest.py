"""Fixtures of several planner tests."""

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

from .urdf import joint_text, link_text, write_robot


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
    urdf = write_robot(tmp_path / "stick.urdf", *map(link_text, ("base", "tip")), joint_text("turn", "base", "tip"))

    def scene(obstacle: Obstacle) -> Scene:
        start, goal = JointTarget("start", (-0.5,)), JointTarget("goal", (0.5,))
        return Scene("stick", tmp_path / "stick.yaml", RobotSpec(urdf=urdf), (obstacle,), start, goal)

    return scene
