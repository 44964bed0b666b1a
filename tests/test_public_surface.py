"""The doors: the names of `hdplan`, `hdplan.distance`, `hdplan.control` and `hdplan.symbolic` are those of the stubs,
are documented, and can be pickled, copied and printed."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import GenericAlias, ModuleType
from typing import Any, get_args

import numpy as np
import pytest

import hdplan
from hdplan import control, distance, symbolic
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.values import Checked

DOORS = (hdplan, distance, control, symbolic)
PUBLIC = [(door, name) for door in DOORS for name in door.__all__]
AGAIN: dict[str, Callable[[Any], Any]] = {"pickle": lambda it: pickle.loads(pickle.dumps(it)), "copy": copy.deepcopy}


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.__name__)
def test_the_surface_is_what_the_stub_lists(door: ModuleType) -> None:
    """Nothing else is found by its name, and nothing twice."""
    assert dir(door) == sorted(set(door.__all__))
    with pytest.raises(AttributeError):
        door.no_such_name  # noqa: B018


@pytest.mark.parametrize(("door", "name"), PUBLIC, ids=lambda it: getattr(it, "__name__", it))
def test_public_names_are_documented(door: ModuleType, name: str) -> None:
    """A function says what each of its arguments is and what it refuses; a class what it is, and so do its members."""
    if name in ("hdsdf_batch", "jax_cost", "JaxCost"):
        pytest.importorskip("jax")
    found = getattr(door, name)
    if isinstance(found, str | tuple):
        return
    text = inspect.getdoc(found) or ""
    assert text, name
    assert not text.startswith(f"{name}("), "what dataclasses write themselves"
    if isinstance(found, type):
        for member, value in vars(found).items():
            plain = getattr(value, "__func__", getattr(value, "fget", getattr(value, "func", value)))
            if not member.startswith("_") and inspect.isfunction(plain) and plain.__module__.startswith("hdplan"):
                assert plain.__name__.startswith("_") or inspect.getdoc(plain), f"{name}.{member}"
    elif callable(found):
        assert "Raises" in text or "errors as" in text, name
        missing = [argument for argument in inspect.signature(found).parameters if argument not in text]
        assert not missing or "rguments and errors as" in text, (name, missing)


def test_the_parts_of_a_scene_are_public() -> None:
    """Classes that hdplan makes of plain values are the exception: joint values, lists of goals, arrays."""
    public = {thing for door, name in PUBLIC if door is hdplan and isinstance(thing := getattr(door, name), type)}
    made: set[str] = set()
    for owner in (thing for thing in public if dataclasses.is_dataclass(thing) and issubclass(thing, Checked)):
        names = {name: value for base in reversed(owner.__mro__) for name, value in _names(base).items()}
        for each in dataclasses.fields(owner):
            kinds = _classes(eval(each.type, names) if isinstance(each.type, str) else each.type)
            made |= {kind.__name__ for kind in kinds if kind.__module__.startswith("hdplan") and kind not in public}
    assert made == {"JointTarget", "Goals", "FixedArray"}


def _names(owner: type) -> dict[str, Any]:
    return vars(sys.modules[owner.__module__])


def _classes(annotation: Any) -> Iterator[type]:
    if isinstance(annotation, type) and not isinstance(annotation, GenericAlias):
        yield annotation
    for argument in get_args(annotation):
        yield from _classes(argument)


def test_five_lines_without_a_file() -> None:
    scene = hdplan.Scene(
        robot="panda",
        obstacles=[hdplan.Box([0.1, 0.1, 0.6], pose=[0.6, 0.0, 0.6])],
        start=[-0.6, -0.3, 0, -2, 0, 1.8, 0.785],
        goal=[0.6, -0.3, 0, -2, 0, 1.8, 0.785],
    )
    result = hdplan.plan(scene, time_limit=20)
    assert result.certified
    assert hdplan.certify(scene, result.trajectory, hdplan.load_robot("panda")).certified


@pytest.mark.parametrize("how", AGAIN)
def test_copies_in_another_process_plan_and_steer_the_same(how: str) -> None:
    again, scene = AGAIN[how], hdplan.load_scene("panda_cage")
    problem, controller = hdplan.build(scene), control.Controller.of(scene)
    sent, robot = again(problem), again(problem.robot)
    assert sent.scene == scene
    ours, theirs = (hdplan.solve(each).trajectory.positions for each in (problem, sent))
    assert ours.tobytes() == theirs.tobytes()
    result = hdplan.plan(scene)
    other = hdplan.plan(again(scene), robot=robot)
    assert other.trajectory.positions.tobytes() == result.trajectory.positions.tobytes()
    back = again(result)
    assert back.trajectory.positions.tobytes() == result.trajectory.positions.tobytes()
    assert back.certificate == result.certificate
    q = problem.start
    steps = [each.step(q, again(control.standing(q + 0.1))) for each in (controller, again(controller))]
    assert steps[0].velocity.tobytes() == steps[1].velocity.tobytes()
    rows = [each.evaluate(q).value.tobytes() for each in (controller.barriers, again(controller.barriers))]
    assert rows[0] == rows[1]
    run = control.simulate(again(controller), q, control.standing(q + 0.01), 0.02)
    assert again(run).positions.tobytes() == run.positions.tobytes()
    target = hdplan.PoseTarget("panda_hand", hdplan.Pose((0.4, 0.0, 0.5)))
    task = again(control.PoseTask(controller.robot, target))
    assert len(controller.step(q, task).velocity) == 7
    again(hdplan.Budget())


@pytest.mark.parametrize("kind", ["hdsdf-boxes", "euclidean", "gdf"])
def test_controllers_of_every_distance_can_be_sent(kind: str) -> None:
    scene = hdplan.load_scene("panda_cage")
    normals = "paper" if kind == "hdsdf-boxes" else "box"
    boxes = tuple(each for each in scene.obstacles if isinstance(each.shape, hdplan.Box))
    settings = control.ControlSettings(
        control.BarrierSettings(kind, normals=normals), margin=0.02, self_margin=0.01, as_published=True
    )
    controller = control.Controller.of(dataclasses.replace(scene, obstacles=boxes), settings)
    q = controller.robot.configuration(scene.start)
    steps = [each.step(q, control.standing(q + 0.1)) for each in (controller, AGAIN["pickle"](controller))]
    assert steps[0].velocity.tobytes() == steps[1].velocity.tobytes()


def test_each_can_be_looked_at() -> None:
    """Each object is shown in one line of some hundred characters, however large it is."""
    scene = hdplan.load_scene("panda_carry")
    problem, controller = hdplan.build(scene), control.Controller.of(scene)
    result = hdplan.plan(scene)
    shown = (problem, problem.robot, hdplan.solve(problem), result, result.trajectory, result.certificate, controller)
    body = hdplan.distance.ConvexBody.capsule(0.1, 0.3)
    distances = hdplan.distance.hdsdf_compiled(body, body), hdplan.distance.hdsdf_batch(body, body)
    start = problem.robot.configuration(scene.start)
    step = controller.step(start, control.standing(start + 0.1))
    run = control.simulate(controller, start, control.standing(start + 0.1), 0.05)
    twists = hdplan.distance.hdsdf_derivatives(body, np.eye(4), body, np.eye(4))
    for it in (*shown, controller.barriers, body, *distances, step, run, twists, Setup.of(scene)):
        assert "\n" not in repr(it)
        assert len(repr(it)) < 500, repr(it)
        assert " object at " not in repr(it)
    assert result.certificate.text in repr(result)
    assert "panda" in repr(problem.robot)


def test_a_notebook_shows_the_verdict_and_the_sheet() -> None:
    pytest.importorskip("matplotlib")
    result = hdplan.plan(hdplan.load_scene("planar_arm"))
    page = result._repr_html_()
    assert result.certificate.text in page
    assert page.count('src="data:image/png;base64,iVBOR') == 1
    hostile = dataclasses.replace(result, scene="<script>", requested=None)
    assert "<script>" not in hostile._repr_html_()
    assert "<img" not in hostile._repr_html_()


def test_without_matplotlib_a_notebook_shows_the_verdict_alone() -> None:
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "import importlib.util, hdplan\n"
        "find = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *rest: None if name == 'matplotlib' else find(name, *rest)\n"
        "result = hdplan.plan(hdplan.load_scene('planar_arm'))\n"
        "print(result._repr_html_())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "certified: " in done.stdout
    assert "<img" not in done.stdout


def test_planning_loads_no_picture() -> None:
    code = (
        "import sys, hdplan; result = hdplan.plan(hdplan.load_scene('planar_arm')); repr(result);"
        "print('matplotlib' in sys.modules, type(result).__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "PlanResult"]


@pytest.mark.parametrize("name", ["panda_cage", "panda_grasp"])
def test_a_warm_start_from_a_certified_motion_gives_a_certified_one(name: str) -> None:
    scene = hdplan.load_scene(name)
    cold = hdplan.plan(scene)
    warm = hdplan.plan(scene, guess=cold.trajectory)
    assert cold.certified
    assert warm.certified
    assert warm.attempts <= cold.attempts
    assert warm.certificate.clearance is not None
    assert hdplan.certify(scene, warm.trajectory).certified


def test_a_warm_start_is_first_taken_as_it_is() -> None:
    """A guess far from any optimum may be the motion itself, where the solver finds none."""
    scene = hdplan.load_scene("planar_arm")
    robot, seen = hdplan.load_robot(scene.robot), []
    ends = [robot.configuration(end) for end in (scene.start, scene.goal)]
    line = np.linspace(*ends, scene.planner.waypoints)
    swing = np.sin(np.linspace(0, np.pi, len(line)))[:, None] * [0.0, 0.4]
    guess = hdplan.Trajectory(robot.joint_names[::-1], np.clip(line + swing, robot.lower, robot.upper)[:, ::-1])
    hdplan.plan(scene, guess=guess, report=seen.append)
    assert seen[0].attempt == 1
    for changed in (scene.with_goal(ends[1] + [0.1, 0.0]), scene):
        result = hdplan.plan(changed, guess=guess)
        assert result.certified
        assert any("the guess's ends were moved by up to 0.1 rad" in note for note in result.notes) == (
            changed is not scene
        )
        assert np.array_equal(result.trajectory.positions[-1], robot.configuration(changed.goal))


def test_a_guess_is_a_motion_or_its_waypoints_everywhere() -> None:
    """Both mean the same to `plan`, `solve` and the CasADi program, whatever the order of the motion's joints."""
    scene = hdplan.load_scene("planar_arm")
    problem = hdplan.build(scene)
    names, rows = problem.robot.joint_names, hdplan.solve(problem).trajectory.positions
    motion = hdplan.Trajectory(names[::-1], rows[:, ::-1])
    for few in (rows, rows[::2].tolist()):
        guess = hdplan.Trajectory(names, np.array(few))
        same = [hdplan.plan(scene, guess=each).trajectory.positions for each in (few, guess)]
        assert np.array_equal(*same)
    for solver in ("gauss_newton", "chomp"):
        same = [hdplan.solve(problem, solver=solver, guess=each).trajectory.positions for each in (rows, motion)]
        np.testing.assert_allclose(*same, atol=1e-12)
    program = problem.casadi()
    np.testing.assert_allclose(program.guess(motion), program.guess(rows), atol=1e-12)
    assert hdplan.solve(problem, guess=hdplan.Trajectory(names, rows[::5])).trajectory.positions.shape == rows.shape
    with pytest.raises(hdplan.InputError, match="guess: trajectory: joint"):
        hdplan.solve(problem, guess=hdplan.Trajectory(("a", "b"), rows))


POSE = [0.5, 0.1, 0.4]


def test_a_position_alone_is_a_pose_everywhere() -> None:
    whole, box = hdplan.Pose(POSE), hdplan.Box([0.1, 0.1, 0.1])
    for made in (
        lambda pose: hdplan.Obstacle("a", box, pose),
        lambda pose: hdplan.Box([0.1, 0.1, 0.1], pose=pose),
        lambda pose: hdplan.Attached("a", "panda_hand", box, pose),
        lambda pose: hdplan.RobotSpec("panda", base=pose),
        lambda pose: hdplan.PoseTarget("panda_hand", pose, free_rotation="all"),
        lambda pose: hdplan.Within("panda_hand", [1.0, 1.0, 1.0], pose),
        lambda pose: hdplan.Relative("panda_hand", "panda_link0", pose),
        lambda pose: hdplan.TimedPoses([0.0, 1.0], [pose, hdplan.Pose()]),
        lambda pose: hdplan.Voxels(np.ones((1, 1, 1), bool), 0.1, pose=pose),
        lambda pose: hdplan.Cloud([[0.0, 0.0, 0.0]], 0.01, pose=pose),
    ):
        assert repr(made(whole)) == repr(made(POSE)) == repr(made(np.array(POSE)))
        with pytest.raises(hdplan.InputError, match="a Pose, or a position of three numbers"):
            made([0.0, 1.0])
    robot = hdplan.load_robot("panda")
    found = [hdplan.inverse_kinematics(robot, pose, free_rotation="all") for pose in (whole, POSE)]
    assert len(found[0])
    assert np.array_equal(*found)


def test_goals_of_all_kinds_stand_in_one_list(tmp_path: Path) -> None:
    """Each is one that will do: the cheapest that is free is taken, and the saved scene and its proof mean the same."""
    joints = [0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]
    far = hdplan.PoseTarget("panda_hand", hdplan.Pose([3.0, 0.0, 0.5]))  # beyond its reach
    pose = hdplan.Pose.from_rpy([0.45, 0.2, 0.5], [3.1416, 0, 0])
    for goal, taken in (([far, joints], "goal[1]"), ([joints, "default"], "goal[1]"), ([far, pose, joints], None)):
        scene = hdplan.Scene(robot="panda", start="default", goal=goal, planner=hdplan.PlannerSettings(waypoints=8))
        result = hdplan.plan(scene)
        assert result.certified
        assert result.goal is not None
        assert result.goal.field in ([taken] if taken else ["goal[1]", "goal[2]"])
        scene.save(tmp_path / "scene.yaml")
        assert hdplan.load_scene(tmp_path / "scene.yaml") == scene
        assert hdplan.certify(hdplan.load_scene(tmp_path / "scene.yaml"), result.trajectory).certified
    only = hdplan.Scene(robot="panda", start="default", goal=pose)
    assert only == only.with_goal([pose]) == only.with_goal(hdplan.PoseTarget(None, pose))


def test_obstacles_can_be_exchanged() -> None:
    scene = hdplan.Scene(robot="panda", start="default", goal="default", obstacles=[hdplan.Sphere(0.1, pose=POSE)])
    more = scene.with_obstacles([*scene.obstacles, hdplan.Box([0.1, 0.1, 0.1], name="box", pose=POSE)])
    assert [obstacle.name for obstacle in more.obstacles] == ["obstacle0", "box"]
    assert more.with_obstacles(scene.obstacles) == scene
    assert scene.with_obstacles([]).obstacles == ()
    with pytest.raises(hdplan.InputError, match=r"obstacles\[1\]: the name 'obstacle0' is taken"):
        scene.with_obstacles([*scene.obstacles, *scene.obstacles])


def test_a_guess_that_does_not_fit_is_refused() -> None:
    scene = hdplan.load_scene("planar_arm")
    names = hdplan.load_robot(scene.robot).joint_names
    for guess, words in (
        (3, "guess: must be a Trajectory, or waypoints by joints of .*, found 3"),
        ("abc", "guess: must be a Trajectory, .*, found the text 'abc'"),
        (np.zeros((32, 3)), "guess: must be a Trajectory, .*, found an array of shape \\(32, 3\\)"),
        (np.zeros((1, 2)), "guess: must be a Trajectory, .*two or more, 2"),
        ([[0.0, 0.0], [0.0, float("nan")]], "guess: .*finite"),
        (np.ones((32, 2)) * 1j, "guess: must be a Trajectory, .*found an array of shape \\(32, 2\\)"),
        (np.full((32, 2), 9.0), "guess: trajectory: .*limit"),
        (hdplan.Trajectory(("a", "b"), np.zeros((4, 2))), "guess: trajectory: joint '.*' of .* is missing"),
        (hdplan.Trajectory((*names, "c"), np.zeros((4, 3))), "guess: trajectory: joint 'c' is not one of"),
        (hdplan.Trajectory(names, np.full((4, 2), 90.0)), "guess: trajectory: waypoint 0 has joint .* its limits are"),
    ):
        with pytest.raises(hdplan.InputError, match=words):
            hdplan.plan(scene, guess=guess)


def test_a_timed_motion_may_be_the_guess() -> None:
    scene = hdplan.load_scene("ur5_pallet")
    cold = hdplan.plan(scene)
    warm = hdplan.plan(scene, guess=cold.trajectory)
    assert cold.certified
    assert warm.certified
    assert warm.attempts == 1


def test_inverse_kinematics_refuses_bad_input() -> None:
    robot, pose, ik = hdplan.load_robot("panda"), hdplan.Pose(), hdplan.inverse_kinematics
    for call, words in (
        (lambda: ik("panda", pose), "^robot: must be a Robot or a Scene"),
        (lambda: ik(robot, pose, "panda_hnd"), "^link: unknown link .*panda_hand"),
        (lambda: ik(robot, pose, "panda_link0"), "^link: no planned joint moves 'panda_link0'"),
        (lambda: ik(robot, [0, 1]), "^pose: must be a Pose, or a position"),
        (lambda: ik(robot, "panda_hand", pose), "^(pose|link): must be"),
        (lambda: ik(robot, pose, seed=[0, 1]), "^seed: shape"),
        (lambda: ik(robot, pose, seed=[np.nan] * 7), "^seed: found nan for joint"),
        (lambda: ik(robot, pose, seed="default"), "^seed: expected 7 numbers"),
        (lambda: ik(robot, pose, all_branches=2), "^all_branches: must be"),
        (lambda: ik(robot, pose, free_rotation="w"), "^free_rotation: unknown value 'w'"),
        (lambda: ik(robot, pose, 3), "^link: must be"),
        (lambda: ik(hdplan.load_robot("baxter"), pose), "^link: .*no one end effector"),
    ):
        with pytest.raises(hdplan.InputError, match=words) as refused:
            call()
        assert "\n" not in str(refused.value)
