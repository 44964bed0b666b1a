"""Scenes made in a program are refused what a file is refused, with the same words; what is harmless is taken."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.plan import plan
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.errors import FieldError, InputError
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import Obstacle, SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import Relative, Upright, Within
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Mesh, Points, Sphere
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import Checked
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from hdplan.scenes.yaml_format.writer import scene_text

NAN, INF = math.nan, math.inf
NUMBERS: tuple[Any, ...] = (NAN, INF, -INF, 1e7, -1e7, "1", "a", "", True, [1.0], {"a": 1})
LENGTHS = (*NUMBERS, 0, -1, -1e-300)
VECTORS: tuple[Any, ...] = (*([0.1, bad, 0.1] for bad in NUMBERS), [1, 1], [1, 1, 1, 1], [], "abc", 1.0, NAN, {"a": 1})
SIZES = (*VECTORS, [0.1, 0, 0.1], [0.1, -1, 0.1])
WORDS: tuple[Any, ...] = ("x" * 100, "hdsd", 1, NAN, True, ["a"])
NAMES: tuple[Any, ...] = ("", "  ", "a\nb", "\ud800", 1, NAN, True, ["a"], {"a": 1})
BOX = {"type": "box", "size": [0.1, 0.1, 0.1]}
BOX_MADE = Box((0.1, 0.1, 0.1))
POSE = {"link": "hand", "position": [0, 0, 0], "rpy": [0, 0, 0]}
QUATERNIONS = ([0, 0.5, 0, 0.5], [0, 0, 0, 0], [0, 0, 0, 1.02], [0, 0, 1], [0, 0, 0, NAN], "abcd", 1.0)


def below(kind: type) -> set[str]:
    """Names of all classes made of one."""
    return {kind.__name__}.union(*(below(each) for each in kind.__subclasses__()))


CHECKED = below(Checked)


def scene_with(path: str, value: Any, beside: dict[str, Any]) -> dict[str, Any]:
    """A scene file's content with a value at a path, and other keys beside it."""
    for step in reversed(path.split(".")):
        name = step.removesuffix("[0]")
        value, beside = {**beside, name: value if name == step else [value]}, {}
    ends = {"start": {"state": "a"}, "goal": {"state": "a"}}
    content = {"hdplan": 1, "robot": {}, **ends, "limits": {"torque": "urdf"}, "timing": {"duration": 3.0}, **value}
    content["robot"] = {"name": "panda", **content["robot"]}
    for section, needed in (("obstacles", {}), ("attached", {"link": "hand"})):
        content[section] = [{"shape": BOX, **needed, **each} for each in content.get(section, ())]
    return content


UNIT = (*NUMBERS, -0.1, 1.1)
POINTS = ([], [[0, 0, 0]] * 5, [[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]], [[NAN, 0, 0]], [[1, 2]], 1, "abc")
TIMES = ([1, 1], [2, 1], [1], [], [-1, 1], [0, NAN], [0, INF], "ab", 1)
RATES = (NAN, INF, 0, -1, 1e-300, "urdf", "a", "", True, [], {}, [1, NAN], [1, "a"], {"j": 0}, {"j": NAN}, {"j": "a"})
INERTIAS = ([1, 0, 0, 1, 0, 3], [1, 0, 0, 1, 0, -1], [1, 2], [NAN, 0, 0, 1, 0, 1], "abcdef")
REGIONS = ([INF, INF, INF], [0, 1, 1], [-1, 1, 1], [NAN, 1, 1], [1, 1], "abc")
PAIRS = (["a", "a"], ["a"], ["a", 1], ["a", ""], "ab", 1)
COUNTS = (2, 1001, 10**9, 10.5, 10.0, NAN, True, "10", [10])
Case = tuple[str, Callable[[Any], Any], tuple[Any, ...], dict[str, Any]]
# the path of the field in the file, the same made in Python, hostile values, and the keys beside it
CASES: list[Case] = [
    ("obstacles[0].shape.size", Box, SIZES, {"type": "box"}),
    ("obstacles[0].shape.radius", Sphere, LENGTHS, {"type": "sphere"}),
    ("obstacles[0].shape.radius", lambda v: Cylinder(v, 1), LENGTHS, {"type": "cylinder", "length": 1}),
    ("obstacles[0].shape.length", lambda v: Cylinder(1, v), LENGTHS, {"type": "cylinder", "radius": 1}),
    ("obstacles[0].shape.length", lambda v: Capsule(1, v), (*NUMBERS, -1), {"type": "capsule", "radius": 1}),
    ("obstacles[0].shape.points", Points, POINTS, {"type": "points"}),
    ("obstacles[0].pose.position", Pose, VECTORS, {}),
    ("obstacles[0].pose.quaternion_xyzw", lambda v: Pose(quaternion_xyzw=v), QUATERNIONS, {}),
    ("obstacles[0].name", lambda v: Obstacle(v, BOX_MADE), NAMES, {}),
    ("obstacles[0].clearance", lambda v: Obstacle("a", BOX_MADE, clearance=v), UNIT, {}),
    ("obstacles[0].motion.velocity", lambda v: SteadyMotion(velocity=v), VECTORS, {}),
    ("obstacles[0].motion.times", lambda v: TimedPoses(v, (Pose(), Pose())), TIMES, {"poses": [{}, {}]}),
    ("attached[0].mass", lambda v: Attached("a", "hand", BOX_MADE, mass=v), LENGTHS, {}),
    ("attached[0].link", lambda v: Attached("a", v, BOX_MADE), NAMES, {}),
    ("start.state", lambda v: JointTarget("start", state=v), NAMES, {}),
    ("start.joints", lambda v: JointTarget("start", positions=v), ([NAN, 0], [0, INF], [1e7], ["a"], [True]), {}),
    ("goal.pose.position_tolerance", lambda v: PoseTarget("a", Pose(), position_tolerance=v), (*LENGTHS, 1.5), POSE),
    ("goal.pose.free_rotation", lambda v: PoseTarget("a", Pose(), free_rotation=v), WORDS, POSE),
    ("self_collision.clearance", lambda v: SelfCollision(clearance=v), UNIT, {}),
    ("limits.jerk", lambda v: Limits(jerk=v), RATES, {}),
    ("limits.position.j", lambda v: Limits(position={"j": v}), ([1, 1], [1, 0], [0, NAN], [0], [0, 1, 2], "ab", 1), {}),
    ("payload.inertia", lambda v: Payload("hand", 1.0, inertia=v), INERTIAS, {"link": "hand", "mass": 1.0}),
    ("timing.duration", Timing, (*LENGTHS, 1e5), {}),
    ("timing.rate", lambda v: Timing(1.0, rate=v), (*NUMBERS, 0, 0.5, 1e9), {"duration": 1.0}),
    ("path.upright.axis", lambda v: Upright("a", v), ("zz", [0, 0, 0], [1, 2], [NAN, 0, 1], 1, True), {"link": "a"}),
    ("path.position.size", lambda v: Within("a", v), REGIONS, {"link": "a"}),
    ("robot.locked.finger", lambda v: RobotSpec(name="panda", locked={"finger": v}), NUMBERS, {}),
    ("robot.ignore_pairs[0]", lambda v: RobotSpec(name="panda", ignore_pairs=[v]), PAIRS, {}),
    ("planner.waypoints", lambda v: PlannerSettings(waypoints=v), COUNTS, {}),
    ("planner.clearance", lambda v: PlannerSettings(clearance=v), UNIT, {}),
    ("planner.activation", lambda v: PlannerSettings(activation=v), UNIT, {}),
    ("planner.gamma", lambda v: PlannerSettings(gamma=v), (0, 33, 2.0, NAN, True, "2"), {}),
    ("planner.shaping_length", lambda v: PlannerSettings(shaping_length=v), (*NUMBERS, 0, 1.1), {}),
    ("planner.distance", lambda v: PlannerSettings(distance=v), WORDS, {}),
    ("planner.link_bodies", lambda v: PlannerSettings(link_bodies=v), WORDS, {}),
    ("planner.swept", lambda v: PlannerSettings(swept=v), (1, "true", NAN, [True]), {}),
    ("planner.normals", lambda v: PlannerSettings(normals=v), WORDS, {}),
]
HINTS = (", which YAML does not read as a number: write ", "; put it in quotes if it is a name")


@pytest.mark.parametrize(("key", "make", "hostile", "beside"), CASES, ids=[key for key, *_ in CASES])
def test_file_and_program_are_refused_with_the_same_words(
    tmp_path: Path, key: str, make: Callable[[Any], Any], hostile: tuple[Any, ...], beside: dict[str, Any]
) -> None:
    file = tmp_path / "scene.yaml"
    for value in hostile:
        file.write_text(_yaml(scene_with(key, value, beside)), encoding="utf-8")
        with pytest.raises(InputError) as by_file:
            load_scene(file)
        with pytest.raises(FieldError) as by_program:
            make(value)
        message, made = str(by_file.value), by_program.value
        if "\ud800" in str(value):  # no file can hold it
            continue
        assert message.startswith(f"{file}: {key}"), (value, message)
        message = message.removeprefix(f"{file}: {key}")
        for hint in HINTS:
            message = message.partition(hint)[0]
        tail = made.where.partition("[")[1] + made.where.partition("[")[2]  # which item of a list
        assert message.endswith(f": {made.problem}"), (value, message, made.problem)
        if message.startswith("["):
            assert tail.endswith(message.partition(":")[0]), (value, message, tail)
        assert str(made).split(":")[0].split(".")[0] in CHECKED, value
        assert "\n" not in str(made)


def _yaml(value: Any) -> str:
    """JSON, with YAML's words for what it lacks."""
    text = json.dumps(value)
    for word, written in (("-Infinity", "-.inf"), ("Infinity", ".inf"), ("NaN", ".nan")):
        text = text.replace(word, written)
    return text.replace("1e-300", "1.0e-300")


def scene_of(**changes: Any) -> Scene:
    target = JointTarget("start", state="default")
    scene = Scene("made", Path("made.yaml"), RobotSpec(name="panda"), (), target, JointTarget("goal", (0.0,) * 7))
    return dataclasses.replace(scene, **changes)


def test_the_short_forms_say_what_the_long_ones_say(tmp_path: Path) -> None:
    """Each form is equal to the scene that is read back from its file."""
    joints, place = (0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785), Pose((0.5, 0.0, 0.2))
    names = tuple(f"panda_joint{i}" for i in range(1, 8))
    tool = PoseTarget("panda_hand_tcp", Pose.from_rpy((0.5, 0.1, 0.4), (0.0, 1.571, 0.0)), free_rotation="x")
    anyhow = PoseTarget("panda_hand", Pose((0.5, 0.0, 0.4)), free_rotation="all")
    zeros = dict.fromkeys(names, 0.0)
    many = np.array([joints, joints]) + [[0.0], [0.1]]
    for short, goal in (
        (joints, JointTarget("goal", joints)),
        (np.array(joints), JointTarget("goal", joints)),
        (dict(zip(names, joints, strict=True)), JointTarget("goal", by_name=dict(zip(names, joints, strict=True)))),
        ("default", JointTarget("goal", state="default")),
        (tool, Goals((tool,))),
        ([tool, anyhow], Goals((tool, anyhow))),
        (AllOf([tool, anyhow]), Goals((AllOf((tool, anyhow)),))),
        ([AllOf([tool, anyhow])], Goals((AllOf((tool, anyhow)),))),
        (many, Goals(tuple(JointTarget("goal", tuple(row)) for row in many.tolist()))),
        ([list(joints), zeros], Goals((JointTarget("a", joints), JointTarget("b", by_name=zeros)))),
    ):
        shapes = [Box([1, 1, 0.1], pose=[0, 0, -0.2]), Sphere(0.1, name="ball", pose=place), Obstacle("x", BOX_MADE)]
        obstacles = (
            Obstacle("obstacle0", Box((1.0, 1.0, 0.1)), Pose((0.0, 0.0, -0.2))),
            Obstacle("ball", Sphere(0.1), place),
            Obstacle("x", BOX_MADE),
        )
        made = Scene(robot="panda", obstacles=shapes, start="default", goal=short)
        assert made == Scene("b", Path("c"), RobotSpec("panda"), obstacles, JointTarget("start", state="default"), goal)
        assert made == made.with_goal([0.0]).with_goal(short) == made.with_start([0.0]).with_start("default")
        assert (made.name, str(made.source)) == ("scene", "scene")
        made.save(tmp_path / "made.yaml")
        assert load_scene(tmp_path / "made.yaml") == made


@pytest.mark.parametrize("name", sorted(shipped_scenes()))
def test_saved_scenes_read_back_equal(tmp_path: Path, name: str) -> None:
    scene, file = load_scene(name), tmp_path / "again.yml"
    scene.save(file)
    assert load_scene(file) == scene


def test_scenes_that_no_file_may_hold_are_not_saved(tmp_path: Path) -> None:
    for scene, words in (
        (scene_of(payload=Payload("panda_hand", 1.0)), "payload: only matters for joint torques"),
        (scene_of(timing=Timing()), "timing: makes the motion timed"),
        (scene_of(goal={"\ud800": 0.0}), "half a character"),
    ):
        with pytest.raises(InputError, match=words):
            scene.save(tmp_path / "a.yaml")
    for path in ("a.txt", "a", tmp_path, tmp_path / "no" / "a.yaml", 5, "a\0.yaml"):
        with pytest.raises(InputError):
            scene_of().save(path)
    assert not list(tmp_path.iterdir())


def test_files_are_named_whole(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A scene means the same file wherever the program goes."""
    monkeypatch.chdir(tmp_path)
    mesh, spec = Mesh("part.stl"), RobotSpec(urdf="arm.urdf", package_dirs=["there"])
    monkeypatch.chdir("/")
    assert (mesh.file, spec.urdf) == (tmp_path / "part.stl", tmp_path / "arm.urdf")
    assert spec.package_dirs == (tmp_path / "there",)


def test_a_scene_is_shown_in_few_words() -> None:
    assert repr(Box((1, 2, 3))) == "Box(size=(1.0, 2.0, 3.0))"
    assert repr(Pose()) == "Pose()"
    rows = np.random.default_rng(0).uniform(size=(2000, 3))
    cloud = Points(rows)
    many = [Obstacle(f"o{i}", cloud) for i in range(500)]
    times = TimedPoses(list(range(1000)), [Pose((i, 0, 0)) for i in range(1000)])
    scene = scene_of(obstacles=[*many, Obstacle("m", BOX_MADE, motion=times)], notes=("words " * 1000,) * 1000)
    assert len(repr(scene)) < 50_000
    assert len(repr(Obstacle("m", BOX_MADE, motion=times))) < 5_000
    assert "RobotSpec(name='panda')" in repr(scene)


def test_harmless_forms_become_those_of_the_reader() -> None:
    assert Box([1, np.float32(2), np.int64(3)]) == Box((1.0, 2.0, 3.0))
    assert Box(np.array([1.0, 2.0, 3.0])) == Box((1.0, 2.0, 3.0))
    assert all(type(x) is float for x in Box(np.array([1, 2, 3])).size)
    assert Pose([0, 0, 1]) == Pose((0.0, 0.0, 1.0))
    half = Pose(quaternion_xyzw=(0, 0, 0.708, 0.708))
    assert math.hypot(*half.quaternion_xyzw) == pytest.approx(1.0, abs=1e-15)
    assert np.linalg.det(half.matrix[:3, :3]) == pytest.approx(1.0, abs=1e-15)
    exact = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    assert Pose(quaternion_xyzw=exact).quaternion_xyzw == exact
    assert Upright("hand", "-z") == Upright("hand", [0, 0, -2])
    assert Mesh("part.stl", 2) == Mesh(Path("part.stl"), (2.0, 2.0, 2.0))
    assert PlannerSettings(waypoints=np.int64(40)).waypoints == 40
    assert type(Limits(velocity=np.str_("urdf")).velocity) is str
    locked: dict[str, float] = {"finger": 1}
    spec = RobotSpec(name="panda", locked=locked, ignore_pairs=[["a", "b"]])
    locked["finger"] = NAN
    assert (spec.locked, spec.ignore_pairs) == ({"finger": 1.0}, (("a", "b"),))
    made = scene_of(obstacles=[Obstacle("a", BOX_MADE)], goal=Goals([JointTarget("goal", (0.0,) * 7)]))
    assert isinstance(made.obstacles, tuple)
    moving = Obstacle("a", BOX_MADE, motion=TimedPoses([0, 1], [Pose((1, 0, 0)), Pose()]))
    assert moving.pose == Pose((1, 0, 0))


HAND, OTHER = PoseTarget("hand", Pose()), PoseTarget("b", Pose())
RESTING = TimedPoses((0, 1), (Pose(), Pose()))
NAMED, CARRIED = Obstacle("a", BOX_MADE), Attached("a", "hand", BOX_MADE)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Scene(start="a", goal="a"), "Scene.robot: must be the name of a robot, or a RobotSpec, found nothing"),
        (lambda: Scene(robot="panda", goal="a"), "Scene.start: must be a list of joint values, .* found nothing"),
        (lambda: Scene(robot="panda", start="a"), "Scene.goal: must be a list of joint values, .* found nothing"),
        (lambda: scene_of(robot=7), "Scene.robot: must be the name of a robot, or a RobotSpec, found 7"),
        (lambda: scene_of(start=()), "Scene.start: must be a list of joint values, .* found a list of 0"),
        (lambda: scene_of(start={}), "Scene.start: must be a list of joint values, .* found a mapping"),
        (lambda: scene_of(start=HAND), "Scene.start: must be a list of joint values"),
        (lambda: scene_of(start=(0.0, NAN)), r"Scene.start\[1\]: must be a finite number \[rad or m\], found nan"),
        (lambda: scene_of(start={"j": "a"}), "Scene.start.j: must be a finite number"),
        (lambda: scene_of(goal=[[0.0], [NAN]]), r"Scene.goal\[1\]\[0\]: must be a finite number"),
        (lambda: scene_of(goal=np.empty((0, 7))), "Scene.goal: .* a Pose, a PoseTarget, a list of these, or an AllOf"),
        (lambda: scene_of(obstacles=NAMED), "Scene.obstacles: must be a list"),
        (lambda: scene_of(obstacles=[3]), r"Scene.obstacles\[0\]: must be an Obstacle, or one of the shapes Box, Sph"),
        (lambda: Obstacle("a", Box([1, 1, 1], name="b")), "Obstacle.shape.name: belongs to the obstacle"),
        (lambda: Attached("a", "b", Box([1, 1, 1], pose=[0, 0, 1])), "Attached.shape.pose: belongs to the held object"),
        (lambda: Box([1, 1, 1], pose=[0, 0]), "Box.pose: must be a Pose, or a position of three numbers"),
        (lambda: Box([1, 1, 1], pose=[0, 0, NAN]), r"Box.pose.position\[2\]: must be a finite number"),
        (lambda: PoseTarget("hand"), "PoseTarget.pose: must be a Pose, or .*, found nothing"),
        (lambda: AllOf([HAND]), "AllOf.poses: must be a list of two or more PoseTargets"),
        (lambda: AllOf([HAND, HAND]), r"AllOf.poses\[1\]: the link 'hand' has a pose already"),
        (lambda: AllOf([HAND, PoseTarget(pose=Pose())]), r"AllOf.poses\[1\]: names no link"),
        (lambda: scene_of(goal=[AllOf([HAND, OTHER]), [0.0] * 7]), "Scene.goal.targets: must be one AllOf alone"),
        (lambda: Relative("hand", "hand"), "Relative.to: must be another link than 'link', found 'hand' twice"),
        (lambda: PoseTarget("hand", [0, 1]), "PoseTarget.pose: must be a Pose, or a position of three numbers"),
        (lambda: Pose.from_rpy([0, 0, 0], [0, NAN, 0]), r"rpy\[1\]: must be a finite number \[rad\], found nan"),
        (lambda: scene_of(obstacles=[NAMED] * 2), "'a' is taken by an earlier obstacle"),
        (
            lambda: scene_of(obstacles=[NAMED], attached=[CARRIED]),
            r"Scene.attached\[0\]: .*'a' is taken by an obstacle",
        ),
        (
            lambda: scene_of(attached=[CARRIED, CARRIED]),
            r"Scene.attached\[1\]: .*'a' is taken by an earlier held object",
        ),
        (lambda: Obstacle("a", "box"), "Obstacle.shape: must be of the class Box or Sphere or"),
        (lambda: Obstacle("a", BOX_MADE, pose=np.eye(4)), r"Obstacle.pose: .* an array of shape \(4, 4\)"),
        (
            lambda: Obstacle("a", BOX_MADE, Pose((1, 2, 3)), motion=RESTING),
            "Obstacle.pose: is given twice: motion.poses",
        ),
        (lambda: TimedPoses((0, 1), (Pose(),)), "TimedPoses.poses: must be as many as the 2 times, found 1"),
        (lambda: JointTarget("start"), "must have exactly one of positions, by_name and state, found none"),
        (lambda: JointTarget("start", (1.0,), {"a": 1.0}), "found positions and by_name"),
        (lambda: JointTarget("start", ()), "JointTarget.positions: must not be empty"),
        (lambda: Goals(()), "Goals.targets: must be a list of one or more"),
        (lambda: Goals((JointTarget("a", (1.0,)), Pose())), "Goals.targets: must be a list of one or more"),
        (lambda: RobotSpec(), "RobotSpec: must have either 'name' or 'urdf', found neither"),
        (lambda: RobotSpec("panda", "a.urdf"), "found both"),
        (lambda: RobotSpec("panda", srdf="a.srdf"), "RobotSpec.srdf: goes with 'urdf'"),
        (lambda: RobotSpec(urdf=3), "RobotSpec.urdf: must be a path, found 3"),
        (lambda: Timing(1.0, 0.5), "Timing: has both 'duration' and 'scale'"),
        (lambda: Timing(1e6), "Timing.duration: 1e.06 s are 1e.08 rows at a rate of 100 1/s"),
        (lambda: Mesh(5), "Mesh.file: must be a path"),
    ],
)
def test_contradictions_are_refused_by_name(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()


def test_a_program_that_plans_is_refused_what_a_file_is(tmp_path: Path) -> None:
    """The needs of one section from another: reported by the reader, and by plan."""
    import hdplan

    moving = Obstacle("ball", Sphere(0.1), Pose((9, 9, 9)), motion=SteadyMotion((0.1, 0, 0)))
    for scene, words in (
        (scene_of(obstacles=(moving,)), r"obstacles\[0\].motion: needs known times, but timing.duration is missing"),
        (scene_of(payload=Payload("panda_hand", 1.0)), "payload: only matters for joint torques"),
        (scene_of(timing=Timing()), "timing: makes the motion timed"),
        (scene_of(limits=Limits(velocity="urdf")), "limits.velocity: makes the motion timed"),
    ):
        with pytest.raises(InputError, match=f"made.yaml: {words}"):
            hdplan.plan(scene)
        file = tmp_path / "scene.yaml"
        file.write_text(scene_text(scene), encoding="utf-8")
        with pytest.raises(InputError, match=f"scene.yaml: {words}"):
            load_scene(file)


def test_settings_without_meaning_are_refused() -> None:
    """A file cannot say it, so that it would be lost when the scene is saved."""
    with pytest.raises(InputError, match=r"orientation_tolerance: has no meaning with free_rotation: all"):
        PoseTarget("hand", Pose(), orientation_tolerance=0.5, free_rotation="all")
    with pytest.raises(InputError, match=r"pose.quaternion_xyzw: has no meaning with free_rotation: all"):
        PoseTarget("hand", Pose(quaternion_xyzw=(0, 0, 1, 0)), free_rotation="all")
    with pytest.raises(InputError, match=r"clearance: has no meaning if nothing is checked"):
        SelfCollision(False, 0.01)
    with pytest.raises(InputError, match=r"robot.check_pairs: names pairs to check, but self_collision: false"):
        Scene(
            robot=RobotSpec("panda", check_pairs=[("panda_link0", "panda_link1")]),
            start="default",
            goal="default",
            self_collision=SelfCollision(False),
        )


@pytest.mark.parametrize(
    "rows", [[[1.0, 2.0]], np.eye(3), np.empty((0, 3)), np.array(["a"]), np.array([]), np.array([None])]
)
def test_limits_are_rows_of_numbers(rows: Any) -> None:
    for name in ("velocity", "acceleration", "jerk", "torque"):
        with pytest.raises(InputError, match=rf"Limits\.{name}.*: must be ") as caught:
            Limits(**{name: rows})
        assert "\n" not in str(caught.value)


def test_errors_of_a_changed_scene_do_not_name_its_file() -> None:
    """The file is right; the change is not. Of a scene as it was read, and of what we change ourselves, it is named."""
    read = load_scene("planar_arm")
    assert read.source.name == "planar_arm.yaml"
    ball = Obstacle("ball", Sphere(0.3), Pose((0.3, -0.3, 0.1)))
    changed = (dataclasses.replace(read, obstacles=[ball]), read.with_start([0.06, 0.0]), read.with_goal([9.0, 0.0]))
    for scene in (*changed, pickle.loads(pickle.dumps(read)).with_goal([9.0, 0.0])):
        for again in (scene, dataclasses.replace(scene), pickle.loads(pickle.dumps(scene))):
            with pytest.raises(InputError, match=r"^the scene made from planar_arm: (start|goal): "):
                plan(again)
    assert (read.name, changed[0].name) == ("planar_arm", "planar_arm")
    whole = derived(read, goal=JointTarget("goal", (9.0, 0.0)))
    with pytest.raises(InputError, match=r"planar_arm\.yaml: goal: "):
        plan(whole)
    alone = Scene(robot=read.robot, start=[0.0, 0.0], goal=[9.0, 0.0], name="mine")
    for scene in (alone, dataclasses.replace(alone)):
        with pytest.raises(InputError, match=r"^mine: goal: "):
            plan(scene)
