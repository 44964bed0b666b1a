"""Arrays that a module or a cache shares are the same for all: nobody can write to them."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest

import hdplan
from hdplan.distance.symbolic.halfspaces import box_directions
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.kinematics.inverse_dynamics import dynamics_of
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.corridor_experiment import link_boxes
from hdplan.scenes.yaml_format.reader import load_scene


def writable(value: object, path: str, seen: dict[int, object]) -> Iterator[str]:
    """The arrays that can be written to, by their paths: in an object, and in all that it makes public."""
    if id(value) in seen:
        return
    seen[id(value)] = value
    parts: list[tuple[str, object]] = []
    if isinstance(value, np.ndarray) and value.flags.writeable:
        yield path
    elif isinstance(value, list | tuple | set | frozenset):
        parts = [(f"{path}[{i}]", part) for i, part in enumerate(value)]
    elif isinstance(value, dict):
        parts = [(f"{path}[{key!r}]", part) for key, part in value.items()]
    elif isinstance(value, ModuleType) or (
        type(value).__module__.startswith("hdplan") and not inspect.isclass(value) and hasattr(value, "__dict__")
    ):
        of_others = (type, ModuleType)
        public = [(name, part) for name, part in vars(value).items() if not name.startswith("_")]
        parts = [(f"{path}.{name}", part) for name, part in public if not isinstance(part, of_others)]
    for name, part in parts:
        yield from writable(part, name, seen)


def test_constants_of_modules_are_read_only() -> None:
    names = [found.name for found in pkgutil.walk_packages(hdplan.__path__, "hdplan.")]
    modules = []
    for name in names:
        try:
            modules.append(importlib.import_module(name))
        except ImportError:  # of what is optional
            continue
    assert len(modules) > 100
    seen: dict[int, object] = {}
    assert [path for module in modules for path in writable(module, module.__name__, seen)] == []


@pytest.mark.parametrize("name", ["panda_cage", "panda_carry", "ur5_payload", "panda_conveyor"])
def test_kept_parts_of_a_scene_and_its_robot_are_read_only(name: str) -> None:
    scene = load_scene(name)
    robot = load_scene_robot(scene)
    certifier = Certifier(Setup.of(scene, robot))
    assert certifier.contacts(np.clip(np.zeros(robot.n), robot.lower, robot.upper)) is not None
    collision_model = collision_model_of(robot, "fitted", "box")
    shared = {
        "scene": scene,
        "poses": [obstacle.pose.matrix for obstacle in scene.obstacles],
        "robot": robot,
        "collision_model": collision_model,
        "kinematics": kinematics_of(robot),
        "bodies": [body for body in certifier.sweep.bodies.bodies if body.name in robot.links],
        "dynamics": dynamics_of(Setup.of(scene, robot)) if scene.limits.torque else None,
        "directions": box_directions(),
        "boxes": link_boxes(),
    }
    assert list(writable(shared, name, {})) == []
    with pytest.raises(ValueError, match="read-only"):
        robot.lower[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        box_directions()[0] = 0.0


def test_skins_are_read_only() -> None:
    pytest.importorskip("viser", reason="the viewer is optional")
    from hdplan.planner.view.drawing import skins

    scene = load_scene("planar_arm")
    robot = load_scene_robot(scene)
    drawn = skins.collision_skins(robot), skins.outer_skins(robot, "fitted"), skins.visual_skins(robot, scene.robot)
    assert list(writable(drawn, "skins", {})) == []
