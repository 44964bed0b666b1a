"""A written scene reads back as the same scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from hdplan.scenes.model import (
    Attached,
    Goals,
    JointTarget,
    Mesh,
    Obstacle,
    PlannerSettings,
    Pose,
    PoseTarget,
    RobotSpec,
    Scene,
    Sphere,
)
from hdplan.scenes.reader import load_scene, shipped_scenes
from hdplan.scenes.writer import scene_text


def written(scene: Scene, folder: Path) -> Scene:
    file = folder / f"{scene.name}.yaml"
    file.write_text(scene_text(scene), encoding="utf-8")
    return plain(load_scene(file), scene.source)


def plain(scene: Scene, source: Path) -> Scene:
    """The scene with whole paths, as it is written."""
    obstacles = tuple(
        replace(obstacle, shape=replace(obstacle.shape, file=obstacle.shape.file.resolve()))
        if isinstance(obstacle.shape, Mesh)
        else obstacle
        for obstacle in scene.obstacles
    )
    urdf, srdf = (path and path.resolve() for path in (scene.robot.urdf, scene.robot.srdf))
    robot = replace(scene.robot, urdf=urdf, srdf=srdf)
    return replace(scene, source=source, robot=robot, obstacles=obstacles)


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_read_back_the_same(name: str, tmp_path: Path) -> None:
    scene = load_scene(name)
    assert written(scene, tmp_path) == plain(scene, scene.source)


@pytest.mark.parametrize(
    "targets",
    [
        (PoseTarget("goal.pose", "hand", Pose((1e-7, 2.0, 1 / 3)), 1e-5, 0.3, "z"),),
        (PoseTarget("goal.poses[0]", "a", Pose()), PoseTarget("goal.poses[1]", "b", Pose(), free_rotation="all")),
        (JointTarget("goal.joints[0]", (0.5, 1e-9)), JointTarget("goal.joints[1]", by_name={"on": 1.0})),
    ],
)
def test_goals_that_leave_a_choice_read_back_the_same(
    targets: tuple[JointTarget, ...] | tuple[PoseTarget, ...], tmp_path: Path
) -> None:
    scene = replace(load_scene("empty"), goal=Goals(targets))
    assert written(scene, tmp_path) == plain(scene, scene.source)


def test_odd_names_and_numbers_read_back_the_same(tmp_path: Path) -> None:
    obstacles = tuple(
        Obstacle(name, Sphere(radius), Pose((1e-7, -2.5e5, 1 / 3)))
        for name, radius in (("null", 1e-5), ("a: b, #c {}", 1e5), ("'\"é\\", 0.1), ("12", 2.0))
    )
    scene = Scene(
        name="odd",
        source=Path("odd.yaml"),
        robot=RobotSpec(name="panda", locked={"panda_finger_joint1": 1e-5}, ignore_pairs=(("yes", "no"),)),
        obstacles=obstacles,
        attached=(Attached("cup", "null", Sphere(1e-5), Pose((0.0, 1e-7, 0.0)), ("on", "off")),),
        start=JointTarget("start", by_name={"panda_joint1": -1e-9, "on": 3.0}),
        goal=JointTarget("goal", state="off"),
        planner=PlannerSettings(waypoints=7, shaping_length=1e-4, normals="faces"),
    )
    assert written(scene, tmp_path) == plain(scene, scene.source)
