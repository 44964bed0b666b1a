"""A scene that is read, written and read is the same scene: equal, and with the same verdicts."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.clouds import Cloud, Ignored
from hdplan.scenes.curve_stages import Along, Circle, Line
from hdplan.scenes.errors import InputError
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.job import Grip, Job, Move, Release, Set, Wait
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import Obstacle, Seen, SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import Follow, PathConstraints, Relative, Upright, Within
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import Pose, from_rpy
from hdplan.scenes.robot_spec import PlanarBase, RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Shape, Sphere
from hdplan.scenes.sizes import Calibration, Tracking, Uncertainty
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from hdplan.scenes.yaml_format.writer import scene_text

MBM = Path(__file__).parents[4] / "shared" / "mbm"
HOOK = shipped_scenes()["empty"].with_name("hook.obj")

HOSTILE = [
    *("null", "~", "yes", "no", "on", "off", "true", "1e3", "12", "0x1f", "0o7", "1_000", ".inf", ".nan", "12:30:45"),
    *("2001-01-01", "a: b", "a:", "#c", "a #c", "- a", "? a", "?", "{a}", "[b]", ",", "'\"é\\", "\\n", " lead", "a "),
    *("<<", "=", "!tag", "&anchor", "*alias", "%d", "@at", "`tick`", "|", "> x", "---", "...", "käse😀", "日本語"),
    *("👩\u200d🚀", "e\u0301", "\u200b", "\ufeffbom", "a\u00a0", "\ue000", "\ufffe", "\U0010ffff"),
    *("x" * 1100, "é" * 2000, "a/1"),
]
NO_NAMES = ["", " ", "a\nb", "tab\t", "\r", "\x00", "\x7f", "\x85", "\u2028", "\ud83d", "\ude00", "a\ud800b"]


def back(scene: Scene, folder: Path) -> Scene:
    """The scene written and read, from another folder and by another name."""
    file = folder / "written.yaml"
    file.write_text(scene_text(scene), encoding="utf-8")
    return load_scene(file)


def assert_same(scene: Scene, folder: Path) -> None:
    again = back(scene, folder)
    assert again == scene
    assert scene_text(again) == scene_text(scene)


def verdicts(scene: Scene, rng: np.random.Generator) -> tuple[object, ...]:
    """Verdicts on some motions, and distances at some configurations."""
    robot = load_scene_robot(scene)
    certifier = Certifier(Setup.of(scene, robot))
    rows = robot.draw(rng, 4)
    if isinstance(scene.goal, JointTarget):
        query = Setup.of(scene, robot).query
        rows = np.vstack([query.start, rows[:1], query.goal])
    times = np.linspace(0.0, scene.end_time or 5.0, len(rows)) if scene.timed or scene.moving else None
    rates = None if times is None else np.zeros_like(rows)
    found = certifier.certify(Trajectory(robot.joint_names, rows, robot.locked, times, rates, rates))
    settings = (robot.joint_names, robot.locked, robot.lower.tolist(), robot.upper.tolist(), robot.self_pairs)
    return *settings, found.text, found.notes, certifier.contacts(rows[0])


@pytest.mark.sampled(3)
@pytest.mark.core
@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_read_back_the_same(name: str, tmp_path: Path) -> None:
    scene = load_scene(name)
    assert_same(scene, tmp_path)
    again = back(scene, tmp_path)
    assert verdicts(again, np.random.default_rng(3)) == verdicts(scene, np.random.default_rng(3))


# --- MoveIt's files ---------------------------------------------------------------------------------------------------

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
ARM = [f"panda_joint{i}" for i in range(1, 8)]
FINGERS = {"panda_finger_joint1": 0.065, "panda_finger_joint2": 0.065}  # beyond what the URDF allows
BEYOND = [0.4, 0.2, 0.1, -3.1218, 0.0, 1.9, 0.8]  # joint 4 a little beyond its limit


def moveit(folder: Path, name: str = "cup", **request: Any) -> Scene:
    start = dict(zip(ARM, READY, strict=True)) | FINGERS | {"a wheel: 1": 0.3, name: 1.0}
    joints = [{"joint_name": joint, "position": value} for joint, value in zip(ARM, BEYOND, strict=True)]
    shape = {"primitives": [{"type": "box", "dimensions": [0.1, 0.1, 0.2]}, {"type": "sphere", "dimensions": [0.05]}]}
    place = {"primitive_poses": [{"position": [0.6, 0.4, "1e-05"]}, {"position": [0.6, -0.4, 0.3]}]}
    cup = {"id": f"held {name}", "header": {"frame_id": "panda_hand"}, "pose": {"position": [0, 0, 0.15]}}
    cup["primitives"] = [{"type": "cylinder", "dimensions": [0.1, 0.02]}]
    held = {"link_name": "panda_hand", "touch_links": ["panda_leftfinger"], "object": cup}
    scene = {
        "robot_model_name": "panda",
        "robot_state": {"attached_collision_objects": [held]},
        "world": {"collision_objects": [{"id": name, "header": {"frame_id": "panda_link0"}, **shape, **place}]},
    }
    requested = {
        "group_name": "panda_arm",
        "start_state": {"joint_state": {"name": list(start), "position": list(start.values())}},
        "goal_constraints": [{"joint_constraints": [*joints, {"joint_name": "a wheel: 1", "position": 3.0}]}],
        **request,
    }
    for file, content in (("scene", scene), ("request", requested)):
        (folder / f"{file}.yaml").write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    return load_scene(folder / "scene.yaml", folder / "request.yaml", "panda")


def test_moveit_problems_read_back_the_same_with_their_fingers_and_limits(tmp_path: Path) -> None:
    scene = moveit(tmp_path)
    assert_same(scene, tmp_path)
    robot = load_scene_robot(back(scene, tmp_path))
    assert robot.locked == FINGERS
    assert robot.lower[3] == BEYOND[3]
    again = back(scene, tmp_path)
    assert verdicts(again, np.random.default_rng(5)) == verdicts(scene, np.random.default_rng(5))
    assert Setup.of(again, robot).left_out == Setup.of(scene).left_out != ()


def test_moveit_goals_by_pose_and_constraints_read_back_the_same(tmp_path: Path) -> None:
    def placed(radius: float) -> dict[str, Any]:
        region = {
            "primitives": [{"type": "sphere", "dimensions": [radius]}],
            "primitive_poses": [{"position": [0.5, 0, 0.4]}],
        }
        return {"link_name": "panda_hand", "header": {"frame_id": "panda_link0"}, "constraint_region": region}

    def turned(*tolerances: float) -> dict[str, Any]:
        named = {f"absolute_{axis}_axis_tolerance": t for axis, t in zip("xyz", tolerances, strict=True)}
        return {"link_name": "panda_hand", "orientation": [1.0, 0.0, 0.0, 0.0], **named}

    path = {"orientation_constraints": [turned(0.2, 0.2, 3.2)]}
    for goal in ({}, turned(0.1, 0.2, 0.3), turned(0.1, 0.1, 3.2), turned(4, 4, 4)):
        constraint = {"position_constraints": [placed(3.0 if goal else 0.01)]}
        constraint |= {"orientation_constraints": [goal]} if goal else {}
        scene = moveit(tmp_path, goal_constraints=[constraint], path_constraints=path)
        assert isinstance(scene.goal, Goals)
        assert scene.path.upright
        assert_same(scene, tmp_path)


@pytest.mark.parametrize("name", HOSTILE)
def test_names_of_all_kinds_read_back_the_same(name: str, tmp_path: Path) -> None:
    scene = moveit(tmp_path, name)
    assert scene.obstacles[0].name == name
    assert_same(scene, tmp_path)
    assert_same(load_scene("empty"), tmp_path)
    plain = load_scene("empty")
    robot = replace(plain.robot, group=name, locked={name: 0.1}, ignore_pairs=((name, f"{name}2"),))
    start = JointTarget("start", by_name={name: 1.0, f"{name}2": -1e-9})
    assert_same(replace(plain, robot=robot, start=start, goal=JointTarget("goal", state=name)), tmp_path)


@pytest.mark.parametrize("name", NO_NAMES)
def test_names_that_no_file_can_hold_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        back(replace(load_scene("empty"), obstacles=(Obstacle(name, Sphere(0.1)),)), tmp_path)


def problems(every: int) -> list[Any]:
    return [
        pytest.param(arm, file, id=f"{arm}-{file.parent.name}-{file.stem}")
        for arm in ("panda", "ur5", "fetch", "baxter")
        for file in sorted((MBM / arm).glob("*/scene*.yaml"))[::every]
    ]


def problem(arm: str, file: Path) -> Scene:
    return load_scene(file, file.with_name(file.name.replace("scene", "request")), MBM / arm / "robot.yaml")


@pytest.mark.skipif(not MBM.is_dir(), reason="the MotionBenchMaker problems are not beside this repository")
@pytest.mark.parametrize(("arm", "file"), problems(100))
def test_benchmark_problems_read_back_with_the_same_verdicts(arm: str, file: Path, tmp_path: Path) -> None:
    scene = problem(arm, file)
    assert_same(scene, tmp_path)
    again = back(scene, tmp_path)
    assert verdicts(again, np.random.default_rng(7)) == verdicts(scene, np.random.default_rng(7))


@pytest.mark.slow
@pytest.mark.skipif(not MBM.is_dir(), reason="the MotionBenchMaker problems are not beside this repository")
@pytest.mark.parametrize("arm", ["panda", "ur5", "fetch", "baxter"])
def test_every_benchmark_problem_reads_back_the_same(arm: str, tmp_path: Path) -> None:
    files = sorted((MBM / arm).glob("*/scene*.yaml"))
    assert files
    for file in files:
        assert_same(problem(arm, file), tmp_path)


# --- every effect -----------------------------------------------------------------------------------------------------


class Maker:
    """Random scenes that use every field of the model."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.count = 0
        self.first = self.name()  # of the obstacles

    def name(self) -> str:
        self.count += 1
        return f"{HOSTILE[int(self.rng.integers(len(HOSTILE)))]}{self.count}"

    def number(self, low: float = 1e-9, high: float = 1e4) -> float:
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def vector(self) -> tuple[float, float, float]:
        x, y, z = self.rng.normal(scale=self.number(), size=3).tolist()
        return x, y, z

    def pose(self) -> Pose:
        turn = self.rng.normal(size=4)
        x, y, z, w = (turn / np.linalg.norm(turn)).tolist()
        return Pose(self.vector(), (x, y, z, w))

    def shape(self) -> Shape:
        a, b, c = (self.number() for _ in range(3))
        corners = tuple(tuple(corner) for corner in (self.rng.normal(size=(6, 3))).tolist())
        kinds: list[Shape] = [Box((a, b, c)), Sphere(a), Cylinder(a, b), Capsule(a, b), Points(corners)]
        kinds += [Ellipsoid((a, b, c)), Mesh(HOOK, (a, b, c))]
        return kinds[int(self.rng.integers(len(kinds)))]

    def cloud(self) -> Cloud:
        ignored = (Ignored(float(self.rng.random()), link=self.name()), Ignored(0.0, obstacle=self.first))
        points = self.rng.normal(scale=self.number(), size=(3, 3))
        return Cloud(points, self.number(high=1.0), self.maybe(0.1, None), True, 0.1, ignored[: self.rng.integers(3)])

    def maybe(self, value: Any, otherwise: Any) -> Any:
        return value if self.rng.random() < 0.6 else otherwise

    def obstacle(self) -> Obstacle:
        """An obstacle that moves or stands, perhaps not quite at its nominal place."""
        unknown = Uncertainty(self.number(high=1.0), self.number(high=3.0), self.number(high=100.0))
        return replace(self.known(), uncertainty=self.maybe(unknown, None))

    def known(self) -> Obstacle:
        shape, clearance = self.maybe(self.shape(), self.cloud()), self.maybe(float(self.rng.uniform()), None)
        match int(self.rng.integers(3)):
            case 0:
                return Obstacle(self.name(), shape, self.pose(), clearance)
            case 1:
                motion = SteadyMotion(self.vector(), self.vector())
                return Obstacle(self.name(), shape, self.pose(), clearance, motion)
            case _:
                poses = (self.pose(), self.pose(), self.pose())
                times = tuple(np.cumsum(self.rng.uniform(0.1, 1.0, size=3)).tolist())
                return Obstacle(self.name(), shape, poses[0], clearance, TimedPoses(times, poses))

    def end(self, field: str) -> JointTarget:
        """A configuration, maybe with rates."""
        at, rates = self.target(field), {}
        for name in ("velocity", "acceleration")[: self.rng.integers(0, 3)]:
            values = self.rng.uniform(-1, 1, 3).tolist()
            rates[name] = tuple(values) if self.rng.integers(2) else {self.name(): value for value in values}
        return replace(at, **rates)

    def target(self, field: str) -> JointTarget:
        values = self.rng.normal(size=3).tolist()
        match int(self.rng.integers(3)):
            case 0:
                return JointTarget(field, tuple(values))
            case 1:
                return JointTarget(field, by_name={self.name(): value for value in values})
            case _:
                return JointTarget(field, state=self.name())

    def pose_target(self, field: str) -> PoseTarget:
        free = str(self.rng.choice(["none", "x", "y", "z", "all"]))
        if free == "all":
            link = self.maybe(self.name(), None)
            return PoseTarget(link, Pose(self.vector()), self.number(high=1.0), free_rotation=free, field=field)
        tolerances = self.number(high=1.0), self.number(high=3.0)
        return PoseTarget(self.name(), self.pose(), *tolerances, free, field=field)

    def goal(self) -> JointTarget | Goals:
        match int(self.rng.integers(6)):
            case 0:
                return self.end("goal")
            case 4:
                poses = [replace(self.pose_target(f"goal.all[{i}].pose"), link=f"link {i}") for i in range(3)]
                return Goals((AllOf(poses, "goal.all"),))
            case 1:
                return Goals((self.pose_target("goal.pose"),))
            case 5:
                return Goals((self.target("a"), self.pose_target("b"), self.target("c"), self.pose_target("d")))
            case 2:
                return Goals(tuple(self.pose_target(f"goal.poses[{i}]") for i in range(3)))
            case _:
                return Goals((self.target("a"), self.target("b"), self.target("c")))

    def values(self) -> Any:
        named = {self.name(): self.number(), self.name(): self.number()}
        choices = [self.number(), tuple(self.number() for _ in range(3)), named]
        return choices[int(self.rng.integers(3))]

    def scene(self) -> Scene:
        spec = RobotSpec(name=self.name()) if self.rng.random() < 0.5 else RobotSpec(urdf=HOOK, srdf=HOOK)
        folders = () if spec.name else (HOOK.parent,)
        group = self.maybe(self.name(), (f"a {self.name()}", f"b {self.name()}"))
        mobile = self.maybe(PlanarBase((-1.0, 1e-7), (0.0, 2.0), (-7.0, 1.0)), None)
        arguments = {} if spec.name else {"prefix": "", self.name(): "true", "k": "-1e-7"}
        spec = replace(spec, package_dirs=folders, xacro_args=arguments)
        spec = replace(spec, base=self.pose(), group=group, base_joints=mobile)
        spec = replace(spec, locked={self.name(): -1e-7}, ignore_pairs=((self.name(), self.name()),))
        axis = self.rng.normal(size=3)
        x, y, z = (axis / np.linalg.norm(axis)).tolist()
        torque = self.maybe("urdf", self.values())
        limits = Limits(
            {self.name(): (-1.5, 1e-7)}, self.maybe(self.values(), "urdf"), self.values(), self.values(), torque
        )
        payload = Payload(self.name(), self.number(), self.vector(), (0.01, 0.0, 0.0, 0.01, 0.0, 0.01))
        upright = Upright(self.name(), (x, y, z), self.number(high=3.0))
        within = Within(self.name(), (np.inf, self.number(), self.number()), self.pose(), self.vector())
        pose = self.maybe(self.pose(), None)
        relative = Relative(f"a {self.name()}", f"b {self.name()}", pose, self.number(high=1.0), self.number(high=3.0))
        turned = from_rpy(*self.rng.uniform(-0.4, 0.4, 3).tolist())
        near = Pose(self.vector(), turned), Pose(self.vector()), Pose(self.vector(), turned)
        rates = self.maybe(self.number(), None), self.maybe(None, self.number())
        free = ("none", "x", "y", "z")[int(self.rng.integers(4))]
        ends = self.maybe(self.number(high=1.0), None), self.maybe(None, self.number(high=1.0))
        follow = Follow(self.name(), near, self.number(high=1.0), self.number(high=3.0), free, *rates, *ends)
        timing = Timing(self.number(0.1, 10.0), rate=float(self.rng.uniform(1, 1000)))
        settings = PlannerSettings(
            17, self.number(high=1.0), self.number(high=1.0), 5, 1e-5, "fcl", "box", True, "faces", 7, "energy"
        )
        kinds = [SelfCollision(), SelfCollision(False), SelfCollision(clearance=self.number(high=1.0))]
        own = kinds[int(self.rng.integers(3))]
        spec = replace(spec, check_pairs=((self.name(), self.name()),) * own.checked)
        held = Attached(self.name(), self.name(), self.shape(), self.pose(), (self.name(),), self.number())
        path = PathConstraints(*(self.maybe(each, None) for each in (upright, within, relative, follow)))
        carried = self.maybe(payload, None)
        if self.rng.random() < 0.3:  # of what is unknown of a robot there are no proofs beside these
            limits, settings = replace(limits, torque=None), replace(settings, objective="smoothness")
            path, carried = PathConstraints(), None
            lag = Tracking(self.number(high=1.0), {self.name(): self.number()})
            spec = replace(spec, tracking=lag, calibration=Calibration(self.number(high=1.0), self.number(high=3.0)))
        return Scene(
            name="random",
            source=Path("random.yaml"),
            robot=spec,
            obstacles=tuple(
                replace(self.obstacle(), name=name) for name in (self.first, *(self.name() for _ in range(4)))
            ),
            start=self.end("start"),
            goal=self.goal(),
            planner=self.maybe(settings, PlannerSettings()),
            from_request=self.rng.random() < 0.5,
            attached=self.maybe((held,), ()),
            self_collision=own,
            limits=limits,
            payload=carried,
            path=path,
            timing=timing,
        )


def with_a_job() -> Scene:
    """A job in which no field of a stage is at its default."""
    every: dict[str, Any] = {"touch": [["a", ["b", "c"]]], "limits": Limits(acceleration=2.0), "speed": 0.5}
    fine: dict[str, Any] = {"position_tolerance": 1e-4, "orientation_tolerance": 1e-3, "free_rotation": "x"}
    fine |= {"link": "tool", "tool_speed": 0.1, "tool_acceleration": 0.2}
    job = Job([
        Move("default", PathConstraints(Upright("tool", "-z")), name="go", **every, blend=0.1),
        Line(by=[0.0, 0.1, 0.2], frame="tool", turn=[0.1, 0.2, 0.3], name="down", **fine, **every, blend=0.1),
        Line(to=[0.0, 0.1, 0.2], rpy=[0.1, 0.2, 0.3], limits=every["limits"]),
        Circle([0.0, 0.1, 0.2], None, "a", [0.1, 0.2, 0.3], None, [0.1] * 3, name="arc", **fine, **every, blend=0.1),
        Circle(to=[0.0, 0.1, 0.2], rpy=[0.1, 0.2, 0.3], center=[0.1, 0.1, 0.1], limits=every["limits"]),
        Along([Pose([0.0, 0.1, 0.2]), Pose([0.1, 0.1, 0.2])], "tool", name="seam", **fine, **every, blend=0.1),
        Line([0.0, 0.1, 0.2], limits=every["limits"]),
        Grip({"finger": 0.1}, "a", "tool", 2.0, name="take", **every),
        Release({"finger": 0.1}, "a", name="leave", **every),
        Set({"valve": True, "level": 0.5, "state": "on"}, name="valve", **every),
        Wait(0.5, name="stand", **every),
    ])  # fmt: skip
    return replace(load_scene("empty"), goal=None, limits=Limits(acceleration=2.0), job=job)


def test_random_scenes_of_every_field_read_back_the_same(tmp_path: Path) -> None:
    """Every field counts: a scene in which it differs is another scene, and written otherwise."""
    seen: dict[type, set[str]] = {}
    kinds = set()

    def look(value: Any) -> None:
        if dataclasses.is_dataclass(value) and not isinstance(value, type | FixedArray):
            kinds.add(type(value))
            for each in dataclasses.fields(value):
                item = getattr(value, each.name)
                default = each.default if each.default_factory is dataclasses.MISSING else each.default_factory()
                if item != default:
                    seen.setdefault(type(value), set()).add(each.name)
                look(item)
        elif isinstance(value, tuple):
            for item in value:
                look(item)

    for seed in range(60):
        scene = Maker(seed).scene()
        assert_same(scene, tmp_path)
        look(scene)
    whole = with_a_job()
    assert_same(whole, tmp_path)
    look(whole)
    aside = {"source", "notes", "field", "scale", "kind"}  # of the file; timing.scale stands for a duration, below
    for kind in kinds:
        placed = {"name", "pose"} if issubclass(kind, Shape | Seen) else set()  # which the scene gives to the obstacle
        assert {each.name for each in dataclasses.fields(kind)} - seen[kind] <= aside | placed, kind
    slow = replace(load_scene("empty"), timing=Timing(scale=0.3, rate=50.0), limits=Limits(acceleration=2.0))
    assert_same(slow, tmp_path)


def test_numbers_of_other_kinds_are_written_as_what_they_are(tmp_path: Path) -> None:
    scene = load_scene("empty")
    ball = Obstacle("ball", Sphere(np.float64(1e-5)), Pose((np.float32(0.5), np.int64(2), -0.0)))
    again = back(replace(scene, obstacles=(ball,)), tmp_path)
    assert again.obstacles[0].shape == Sphere(1e-5)
    assert again.obstacles[0].pose.position == (0.5, 2.0, 0.0)


def test_a_mesh_behind_a_link_keeps_its_name(tmp_path: Path) -> None:
    """The target of a link may have a name without an ending."""
    (tmp_path / "blob").write_bytes(HOOK.read_bytes())
    (tmp_path / "hook.obj").symlink_to(tmp_path / "blob")
    scene = load_scene("empty")
    (tmp_path / "scene.yaml").write_text(
        scene_text(replace(scene, obstacles=(Obstacle("hook", Mesh(tmp_path / "hook.obj")),))), encoding="utf-8"
    )
    read = load_scene(tmp_path / "scene.yaml")
    assert_same(read, tmp_path)
    robot = load_scene_robot(read)
    query = Setup.of(read, robot).query
    certify(back(read, tmp_path), Trajectory(robot.joint_names, np.array([query.start, query.goal])), robot)
