"""A user's program with every documented form of a scene's parts: it runs, and type checkers accept it.

`.ci/run` has mypy read this file against the installed package. `assert_type` says what the attributes are then.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, assert_type

import numpy as np

import hdplan

JOINTS = [0.6, -0.3, 0, -2.0, 0.0, 1.8, 0.785]
Vector = tuple[float, float, float]


def scene() -> hdplan.Scene:
    return hdplan.Scene(
        robot="panda",
        obstacles=[
            hdplan.Box([0.1, 0.1, 0.6], pose=[0.6, 0.0, 0.3]),
            hdplan.Cylinder(radius=0.04, length=0.4, name="bottle", pose=np.array([0.5, 0.0, 0.28])),
            hdplan.Obstacle("ball", hdplan.Sphere(0.1), pose=(0, 0, 2), clearance=0.01),
        ],
        start="default",
        goal=JOINTS,
    )


def test_a_scene_is_made_of_its_short_forms() -> None:
    made = scene()
    assert_type(made.robot, hdplan.RobotSpec)
    assert_type(made.obstacles, tuple[hdplan.Obstacle, ...])
    assert [obstacle.name for obstacle in made.obstacles] == ["obstacle0", "bottle", "ball"]
    assert_type(made.obstacles[0].pose, hdplan.Pose)
    assert_type(made.obstacles[0].pose.position, Vector)
    assert made.obstacles[1].pose.position == (0.5, 0.0, 0.28)
    names = {f"panda_joint{i}": value for i, value in enumerate(JOINTS, start=1)}
    tool = hdplan.PoseTarget("panda_hand_tcp", hdplan.Pose([0.5, 0.1, 0.4]), free_rotation="all")
    turned = hdplan.PoseTarget("panda_hand_tcp", hdplan.Pose.from_rpy([0.5, 0.1, 0.4], [3.14, 0, 0]))
    others = [made.with_goal(names), made.with_goal("default"), made.with_goal(tool), made.with_goal([tool, turned])]
    others += [
        made.with_goal([JOINTS, JOINTS]),
        made.with_goal([names, names]),
        made.with_goal(np.array([JOINTS, JOINTS])),
    ]
    for other in others:
        assert other != made == other.with_goal(JOINTS)
    assert made.with_start(made.goal).with_goal(made.start).with_start("default").with_goal(JOINTS) == made


def test_all_parts_take_what_is_documented(tmp_path: Path) -> None:
    shapes = [
        hdplan.Ellipsoid([0.1, 0.2, 0.3], name="egg"),
        hdplan.Capsule(0.1, 0, pose=hdplan.Pose()),
        hdplan.Points([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        hdplan.Points(np.vstack([np.zeros(3), np.eye(3)])),
        hdplan.Mesh("part.stl", scale=2),
        hdplan.Mesh(tmp_path / "part.stl", (1.0, 1.0, 2.0)),
    ]
    moving = hdplan.Obstacle("a", hdplan.Box((1, 1, 1)), motion=hdplan.SteadyMotion([0.1, 0, 0], spin=(0, 0, 1)))
    timed = hdplan.TimedPoses([0.0, 1.0], [hdplan.Pose(), hdplan.Pose([1.0, 0.0, 0.0])])
    door = hdplan.Obstacle("b", hdplan.Box((1, 1, 1)), motion=timed)
    made = hdplan.Scene(
        robot=hdplan.RobotSpec("panda", base=[0, 0, 0.1], ignore_pairs=[["a", "b"]], locked={"panda_finger_joint1": 0}),
        obstacles=[*shapes, moving, door],
        attached=[hdplan.Attached("cup", "panda_hand", hdplan.Sphere(0.02), [0, 0, 0.1], touch_links=["panda_link7"])],
        start=JOINTS,
        goal=dict.fromkeys((f"panda_joint{i}" for i in range(1, 8)), 0.5),
        limits=hdplan.Limits(
            {"panda_joint1": [-1, 1]}, velocity="urdf", acceleration=[1] * 7, jerk={"panda_joint1": 9}
        ),
        payload=hdplan.Payload("panda_hand", 1, com=[0, 0, 0.1], inertia=[1, 0, 0, 1, 0, 1]),
        path=hdplan.PathConstraints(hdplan.Upright("panda_hand", "-z"), hdplan.Within("panda_hand", [np.inf, 1, 1])),
        timing=hdplan.Timing(3.0),
        planner=hdplan.PlannerSettings(waypoints=40),
        self_collision=hdplan.SelfCollision(clearance=0.01),
    )
    assert_type(timed.times, tuple[float, ...])
    assert_type(made.robot.locked, Mapping[str, float])
    assert_type(made.attached, tuple[hdplan.Attached, ...])
    assert_type(made.limits.position, Mapping[str, tuple[float, float]])
    assert_type(hdplan.Upright("panda_hand", [0, 0, 2]).axis, Vector)
    arm = hdplan.RobotSpec(urdf="arm.urdf", srdf=tmp_path / "arm.srdf", package_dirs=["packages", tmp_path])
    assert_type(arm.package_dirs, tuple[Path, ...])
    assert made.limits.acceleration == (1.0,) * 7
    assert arm.urdf == Path("arm.urdf").absolute()


def test_type_checkers_see_the_arguments_that_run() -> None:
    """The `__init__` that only they see has the arguments, in order, and the defaults of the one that runs."""
    found = 0
    for kind in (getattr(hdplan, name) for name in vars(hdplan)["__all__"]):
        if not isinstance(kind, type):
            continue
        module = sys.modules[kind.__module__]
        declared = [
            node
            for group in ast.parse(inspect.getsource(kind)).body[0].body  # type: ignore[attr-defined]
            if isinstance(group, ast.If)
            for node in group.body
            if isinstance(node, ast.FunctionDef)
        ]
        for node in declared:
            found += 1
            node.name, node.decorator_list = "declared", []
            names: dict[str, Any] = {}
            exec(compile(ast.fix_missing_locations(ast.Module([node], [])), str(module), "exec"), vars(module), names)
            arguments = [*inspect.signature(names["declared"]).parameters.values()][1:]
            runs = inspect.signature(kind).parameters
            usual = {each.name: each.default_factory for each in fields(kind) if callable(each.default_factory)}
            assert [(each.name, each.kind) for each in arguments] == [(each.name, each.kind) for each in runs.values()]
            for each in arguments:
                default = usual[each.name]() if each.name in usual else runs[each.name].default
                assert each.default == default, (kind, each.name)
    assert found > 15
