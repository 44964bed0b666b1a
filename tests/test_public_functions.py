"""Whatever a public function or class is given that it is not for is refused in one line: no NaN comes back, no error
of NumPy's, and nothing hangs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import control, distance, symbolic
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene

NAN = float("nan")
NONE = np.empty((0, 3))
STRANGE: tuple[Any, ...] = ("a", None, 3, [1, "a"], {"a": 1}, object())
NO_NUMBERS: tuple[Any, ...] = (*STRANGE[:2], *STRANGE[3:], "1", NAN, 1j, 10**400, b"1", np.full((9, 9), NAN))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return hdplan.load_scene("planar_arm")


@pytest.fixture(scope="module")
def robot(scene: Scene) -> hdplan.Robot:
    return hdplan.load_robot(scene.robot)


@pytest.fixture(scope="module")
def problem(scene: Scene, robot: hdplan.Robot) -> hdplan.Problem:
    return hdplan.build(scene, robot)


def refused(call: Callable[..., Any], *values: Any) -> None:
    for value in values:
        with pytest.raises(InputError) as caught:
            call(value)
        assert "\n" not in str(caught.value), (value, str(caught.value))
        assert len(str(caught.value)) < 400, (value, str(caught.value))


def test_planning_and_certifying(scene: Scene, robot: hdplan.Robot, problem: hdplan.Problem) -> None:
    motion = hdplan.Trajectory(robot.joint_names, [[-0.8, 0.3], [1.0, 0.4]])
    for call in (
        lambda value: hdplan.check_configuration(value, robot, [0, 0]),
        lambda value: hdplan.certify(value, motion),
        lambda value: hdplan.plan(value),
        lambda value: hdplan.build(value),
        lambda value: hdplan.solve(value),
        lambda value: hdplan.load_robot(value),
        lambda value: hdplan.certify(scene, value, robot),
        lambda value: control.Controller.of(value),
        lambda value: control.scene_barriers(value, robot, control.BarrierSettings()),
        lambda value: control.scene_barriers(scene, value, control.BarrierSettings()),
        lambda value: control.scene_barriers(scene, robot, value),
        lambda value: control.simulate(value, control.standing(np.zeros(2)), np.zeros(2), 1.0),
        lambda value: control.PoseTask(value, value),
        control.TrackTask,
        symbolic.kinematics,
        symbolic.dynamics,
        symbolic.clearance,
        lambda value: symbolic.clearance(scene, value),
        lambda value: symbolic.clearance(scene, activated=value),
    ):
        refused(call, *STRANGE)
    refused(
        lambda q: hdplan.check_configuration(scene, robot, q), *NO_NUMBERS, [NAN, 0], [0, np.inf], [0] * 3, [[0, 0]]
    )
    refused(lambda value: hdplan.certify(scene, motion, robot, required=value), "a", NAN, -1.0, [1], True)
    refused(lambda value: hdplan.plan(scene, robot=robot, time_limit=value), "a", NAN, -1.0, np.inf, [1], None)
    refused(lambda value: hdplan.plan(scene, robot=robot, seed=value), "a", -1, 1.5, NAN, None, True)
    refused(lambda value: hdplan.plan(scene, robot=robot, solver=value), *STRANGE, NAN)
    refused(hdplan.plan_many, "planar_arm", None, 3, object())
    refused(lambda value: hdplan.plan_many([scene], time_limit=value), "a", NAN, -1.0, 0, np.inf, None)
    refused(lambda value: hdplan.plan_many([scene], seed=value), "a", -1, 1.5, None)
    refused(lambda value: hdplan.plan_many([scene], solver=value), *STRANGE)
    refused(lambda value: hdplan.plan_many([scene], workers=value), "a", 0, 1.5, NAN)
    refused(lambda value: hdplan.plan_many([scene], scheduler=value), 3, "", ["a"])
    refused(lambda value: hdplan.build(scene, value), "panda", 3)
    refused(lambda value: hdplan.solve(problem, solver=value), *STRANGE)
    refused(lambda value: hdplan.solve(problem, budget=value), 3, "a")
    refused(lambda value: hdplan.solve(problem, guess=value), "a", [[NAN]], np.full((32, 2), NAN), [[0, 0]])
    refused(lambda value: control.Controller.of(scene, value), 3, "a")
    reference = control.standing(np.zeros(2)).reference
    for name in ("gain", "end", "tolerance"):
        refused(lambda value, name=name: control.TrackTask(reference, **{name: value}), *NO_NUMBERS, True)
    refused(control.standing, *NO_NUMBERS, ["1", "2"], [True, False], [[0, 0]], [0, 10**400])
    controller = control.Controller.of(scene, robot=robot)
    refused(lambda q: controller.step(q, control.standing(np.zeros(2))), *NO_NUMBERS, ["1", "2"], [True, False])
    refused(lambda time: controller.step([0, 0], control.standing(np.zeros(2)), time), *NO_NUMBERS, True)
    for found in (*STRANGE, ("a", "b"), ([0, 0], [NAN, 0]), ([0, 0], ["0", "0"]), ([0, 0],)):
        refused(lambda found: controller.step([0, 0], control.TrackTask(lambda time: found)), found)
    refused(lambda value: control.ControlSettings(rate=value), *NO_NUMBERS, 0, -1)
    refused(lambda value: control.ControlSettings(margin=value), *NO_NUMBERS)
    refused(lambda value: control.ControlSettings(barriers=value), *STRANGE)
    refused(lambda value: control.BarrierSettings(growth=value), *NO_NUMBERS, -1, 2)
    refused(lambda value: control.BarrierSettings(distance=value), *STRANGE)
    refused(lambda value: control.BarrierSettings(gamma=value), *NO_NUMBERS, 0, 1.5)


def test_reading() -> None:
    refused(hdplan.load_scene, 5, None, NAN, ["a"], "no/such.yaml", "a\0b", "/dev/zero", "x" * 50)
    refused(lambda value: hdplan.load_scene("planar_arm", request=value), 5, NAN, ["a"])
    refused(lambda value: hdplan.load_scene("planar_arm", robot=value), 5, NAN, ["a"])
    refused(lambda value: hdplan.load_robot(RobotSpec(urdf=value)), 5, "/dev/zero", "no.urdf", "a\0b")
    refused(hdplan.Trajectory.load, 5, None, "a.txt", "no.json", "/dev/zero", ["a"])


def test_trajectories() -> None:
    good = hdplan.Trajectory(("a", "b"), [[0, 1], [2, 3]])
    refused(lambda value: hdplan.Trajectory(value, [[0, 1], [2, 3]]), *STRANGE, "ab", (1, 2), ("a", "a"), (), ("a",))
    rows: tuple[Any, ...] = (*NO_NUMBERS, [], [[0]], [[NAN], [1]], [[True], [False]], [[0], [1, 2]], [["1"], ["2"]])
    refused(lambda value: hdplan.Trajectory(("a",), value), *rows, np.array([[object()], [1]]), [[0], [np.inf]])
    refused(lambda value: hdplan.Trajectory(("a",), [[0], [1]], times=value), "ab", [0, NAN], [1, 0], [0, 0], [0], 1)
    timed = {"times": [0, 1]}
    refused(lambda value: hdplan.Trajectory(("a",), [[0], [1]], velocities=value, **timed), [[NAN], [0]], [[0]], "a", 1)
    refused(lambda value: hdplan.Trajectory(("a",), [[0], [1]], locked=value), [1], {"b": NAN}, {"b": "c"}, {1: 1}, 5)
    refused(good.at, *NO_NUMBERS, 2.0, -1.0, [0, NAN])
    refused(good.save, 5, None, "a.txt", "no/such/folder.json")
    refused(lambda value: good.of_joints(value, {}), ("x",), ("a", "x"))
    assert good.at([0.0, 1.0]).tolist() == [[0, 1], [2, 3]]


def test_bodies() -> None:
    body = distance.ConvexBody
    empty = np.empty(0)
    refused(
        lambda value: body(value, NONE, NONE, empty), "a", NONE, [[NAN, 0, 0]], [[1, 2]], [0, 0, 0, 0], [[1e200] * 3]
    )
    refused(lambda value: body(np.zeros((1, 3)), NONE, NONE, empty, value), *NO_NUMBERS, -1, np.inf)
    refused(lambda value: body(np.zeros((1, 3)), value, NONE, empty), [[0, 0, 2]], [[NAN, 0, 0]], [[0, 0, 0]], "a")
    refused(lambda value: body(np.zeros((1, 3)), NONE, [[0, 0, 1]], value), [NAN], [1, 2], [-1], "a", [])
    refused(body.box, *NO_NUMBERS, [NAN, 1, 1], [1, 1], [1, 1, 0], [1, 1, -1])
    refused(body.sphere, *NO_NUMBERS, 0, -1, True, [1, 2])
    refused(lambda value: body.capsule(1.0, value), *NO_NUMBERS, 0, -1)
    refused(lambda value: body.cylinder(1.0, 1.0, value), *NO_NUMBERS, 2, 2.5, 10**9)
    refused(lambda value: body.cylinder(value, 1.0), *NO_NUMBERS, 0)
    refused(body.platonic, *STRANGE)
    refused(lambda value: body.platonic("cube", value), *NO_NUMBERS, 0)
    refused(body.from_points, *NO_NUMBERS, [], [[NAN, 0, 0]], [[1, 2]], np.full((5, 3), 1e300))
    refused(body.box([1, 1, 1]).inflated, *NO_NUMBERS, -1)


def test_distances() -> None:
    box, pose = distance.ConvexBody.box([1, 1, 1]), np.eye(4)
    poses = pose[None]
    for call, at in (
        (distance.hdsdf, pose),
        (distance.hdsdf_derivatives, pose),
        (distance.separating_axis_distance, pose),
        (distance.separation, pose),
        (distance.signed_distance, pose),
        (distance.signed_distances, poses),
        (distance.fcl_distances, poses),
    ):
        refused(lambda value, call=call, at=at: call(value, at, box, at), *STRANGE)
        refused(lambda value, call=call, at=at: call(box, at, value, at), *STRANGE)
        refused(lambda value, call=call, at=at: call(box, value, box, at), at * NAN, at[..., :3], np.zeros(5))
    for build in (distance.hdsdf_compiled, distance.hdsdf_function):
        refused(lambda value, build=build: build(value, box), *STRANGE)
        refused(lambda value, build=build: build(box, value), *STRANGE)
    for call in (distance.hdsdf, distance.hdsdf_derivatives):
        for name, values in {
            "gamma": (0, "a", 1.5, None, NAN, True),
            "shaping_length": (0, -1, "a", None, NAN, True),
            "epsilon": (0, -1, "a", NAN),
            "normals": (*STRANGE, "papr"),
            "witnesses": ("a", [NAN, 0, 0], [[0, 0, 0]], [[1, 2]]),
        }.items():
            refused(lambda value, call=call, name=name: call(box, pose, box, pose, **{name: value}), *values)
    refused(lambda value: distance.holder_minimum(value, 2), "a", [], [NAN, 1], [1, "a"], 3.0)
    refused(lambda value: distance.holder_maximum([1.0, 2.0], value), 0, "a", 1.5, NAN)
    refused(lambda value: distance.holder_minimum([1.0, 2.0], 2, value), [1], [NAN, 1], "a")
    refused(lambda value: distance.shaping(value, 2, 1.0), "a", [NAN])
    refused(lambda value: distance.shaping([1.0], 2, value), 0, -1, NAN, "a")
