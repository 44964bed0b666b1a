from __future__ import annotations

import pytest

from hdplan import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot

from .rooms import scene_of


@pytest.fixture(scope="session")
def robot() -> Robot:
    """A Panda, whose fingers are locked."""
    return load_scene_robot(scene_of())
