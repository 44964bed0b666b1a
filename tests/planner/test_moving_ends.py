"""Laws of starts and goals through which the robot moves: the motion begins as required, keeps its limits and
is proven; what cannot be braked is refused; and commands without moving ends refuse them."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import hdplan
from hdplan import InputError, Job, Limits, Move, Scene, State, Timing, Trajectory, UnsolvableError
from hdplan.planner.batch.sample import sample
from hdplan.planner.build import problem_of
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.control.follow import follow
from hdplan.planner.control.simulation import replay
from hdplan.planner.job.places import link_pose
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.explain_effects import effects
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.verify import RejectedError
from hdplan.verify.kernel import accept
from hdplan.verify.reading import read_world

LIMITS = Limits(acceleration=5.0, jerk=60.0)
HOME: dict[str, Any] = {
    "kinova": [0.81, 2.01, 3.54, 1.65, 0.81, -3.06],
    "panda": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
    "ur5": [0.5, -1.2, 1.5, -1.8, -1.57, 0.0],
}


def scene_of(robot: str, seed: int = 0, **more: Any) -> Scene:
    """A robot beside a box, on the way to a configuration near its start."""
    box = hdplan.Obstacle("box", hdplan.Box([0.1, 0.1, 0.4]), pose=[0.1, 0.9, 0.3])
    rest = Scene(robot=robot, obstacles=[box], start=HOME[robot], goal=HOME[robot], limits=LIMITS, **more)
    loaded = load_scene_robot(rest)
    rng = np.random.default_rng(seed)
    start = np.clip(loaded.configuration(rest.start), loaded.lower + 0.3, loaded.upper - 0.3)
    goal = np.clip(start + rng.uniform(-0.6, 0.6, loaded.n), loaded.lower + 0.2, loaded.upper - 0.2)
    return rest.with_start(start).with_goal(goal)


def moving(scene: Scene, velocity: Any, acceleration: Any = None) -> Scene:
    return scene.with_start(State(scene.start, velocity, acceleration))


@pytest.fixture(scope="module")
def planned() -> tuple[Scene, hdplan.PlanResult]:
    """A UR5 that moves through its start and its goal."""
    rest = scene_of("ur5")
    scene = moving(rest, [0.3, -0.2, 0.1, 0.2, -0.3, 0.1], [0.5, 0, 0, 0, 0, -0.5])
    scene = scene.with_goal(State(rest.goal, [0.1, 0, 0, 0.1, 0, 0]))
    return scene, hdplan.plan(scene)


@pytest.mark.parametrize("robot", ["panda", "ur5", pytest.param("kinova", marks=pytest.mark.slow)])
def test_random_velocities_are_planned_from_within_their_limits(robot: str) -> None:
    for seed in range(2):
        rest = scene_of(robot, seed)
        setup = Setup.of(rest)
        rng = np.random.default_rng([seed, 1])
        most = np.minimum(0.5, 0.5 * setup.limits["velocity"])
        velocity = rng.uniform(-1, 1, setup.robot.n) * most
        acceleration = rng.uniform(-1, 1, setup.robot.n) * (2.0 if seed else 0.0)
        scene = moving(rest, velocity, acceleration)
        result = hdplan.plan(scene, robot=setup.robot)
        assert result.certificate.certified, result.certificate.text
        motion = result.trajectory
        curve = motion.curve
        np.testing.assert_allclose(curve.at_time(0.0), setup.query.start, atol=1e-9)
        np.testing.assert_allclose(curve.at_time(0.0, 1), velocity, atol=1e-9)
        np.testing.assert_allclose(curve.at_time(0.0, 2), acceleration, atol=1e-9)
        assert motion.times is not None
        when = np.linspace(0.0, motion.times[-1], 5000)
        for order, name in enumerate(("velocity", "acceleration", "jerk"), 1):
            assert (np.abs(curve.at_time(when, order)) <= setup.limits[name] * (1 + 1e-6)).all(), name
        assert replay(Setup.of(scene, setup.robot), motion).succeeded


def test_at_velocity_zero_the_plan_is_that_from_rest_to_the_byte() -> None:
    rest = scene_of("ur5")
    one, other = (hdplan.plan(each).trajectory for each in (rest, moving(rest, np.zeros(6), np.zeros(6))))
    for name in ("positions", "times", "velocities", "accelerations"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_an_end_may_be_at_a_limit_and_the_other_at_a_velocity_of_zero() -> None:
    """A rate to the last bit of a limit is within it; an end at rest needs no braking."""
    rest = scene_of("ur5")
    most = Setup.of(rest).limits
    ends = (most["velocity"] * [1, 0, 0, -1, 0, 0], None), (np.zeros(6), most["acceleration"] * [1, 0, 0, 0, -1, 0])
    for velocity, acceleration in ends:
        for still in (rest.goal, State(rest.goal, np.zeros(6)), State(rest.goal, np.zeros(6), np.zeros(6))):
            result = hdplan.plan(moving(rest, velocity, acceleration).with_goal(still))
            assert result.certificate.certified, result.certificate.text


def test_braking_beyond_a_joints_range_is_refused() -> None:
    """A joint at 1 rad/s goes 0.1 rad and more at 5 rad/s², with any jerk."""
    for name in ("panda", "ur5"):
        rest = scene_of(name)
        robot = load_scene_robot(rest)
        for joint in range(robot.n):
            for end, way in ((robot.upper, 1.0), (robot.lower, -1.0)):
                q, velocity = np.array(rest.start.positions), np.zeros(robot.n)
                q[joint], velocity[joint] = end[joint] - way * 0.09, way
                message = (
                    rf"start.velocity: the robot cannot brake from it: joint '{robot.joint_names[joint]}' at {way:g} "
                )
                with pytest.raises(UnsolvableError, match=message) as error:
                    Retimer(Setup.of(moving(rest.with_start(q), velocity), robot))
                assert error.value.cause == "end_too_fast"
                assert "\n" not in str(error.value)
                ends = Retimer(Setup.of(moving(rest.with_start(q), -velocity), robot)).ends  # away from the range's end
                assert ends is not None
                assert ends.head.away[0, joint] * way > 0.1


def test_braking_into_contact_is_refused() -> None:
    rest = scene_of("panda").with_start([0, 0, 0, -1.57, 0, 1.57, 0])
    wall = hdplan.Obstacle("wall", hdplan.Box([0.8, 0.02, 1.0]), pose=[0.6, 0.23, 0.5])
    fast = [1.5, 0, 0, 0, 0, 0, 0]
    assert hdplan.plan(moving(rest, fast)).certificate.certified
    with pytest.raises(
        UnsolvableError, match=r"start.velocity: the robot cannot brake from it: panda_\w+ and wall would"
    ):
        hdplan.plan(moving(rest.with_obstacles([wall]), fast))


def test_obstacles_are_where_they_are_when_the_robot_comes_to_its_goal() -> None:
    """One that stood in the way of its last part is none once it has left."""
    home = HOME["ur5"]
    goal = [home[0] + 0.5, *home[1:]]
    place = link_pose(hdplan.load_robot("ur5"), np.array([goal[0] - 0.15, *goal[1:]]), "tool0")[:3, 3]
    poses = [hdplan.Pose([*place]), hdplan.Pose([*(place + [0, 0, 2.0])])]
    scene = Scene(
        robot="ur5",
        start=[home[0] - 0.3, *home[1:]],
        goal=State(goal, [0.6, 0, 0, 0, 0, 0]),
        obstacles=[hdplan.Obstacle("ball", hdplan.Sphere(0.1), motion=hdplan.TimedPoses([1.2, 2.0], poses))],
        limits=Limits(acceleration=3.0, jerk=40.0),
        timing=Timing(duration=3.0),
    )
    assert hdplan.plan(scene).certified


def test_a_forged_beginning_is_refused_by_certificate_and_kernel(
    planned: tuple[Scene, hdplan.PlanResult], tmp_path: Path
) -> None:
    scene, result = planned
    motion = result.trajectory
    assert result.certificate.certified, result.certificate.text
    scene.save(tmp_path / "s.yaml")
    result.save(tmp_path / "m.json")
    proof = hdplan.prove(tmp_path / "s.yaml", tmp_path / "m.json")
    assert proof.text.startswith("accepted: over the whole motion")
    assert "moving at the start: shoulder_pan_joint at 0.3" in proof.text
    for name, row in (("velocities", 0), ("velocities", -1), ("accelerations", 0)):
        rows = np.array(getattr(motion, name))
        rows[row, 2] += 1e-5
        forged = dataclasses.replace(motion, **{name: rows})
        found = hdplan.certify(scene, forged)
        assert found.status in (Status.WRONG_ENDS, Status.TOO_FAST)
        forged.save(tmp_path / "f.json")
        with pytest.raises(hdplan.NotProvenError):
            hdplan.prove(tmp_path / "s.yaml", tmp_path / "f.json")
    world = read_world(tmp_path / "s.yaml", tmp_path / "m.json", None).world
    assert accept(world, proof.data)[1]
    for end, name, by in (("start", "velocity", 1e-5), ("start", "acceleration", 1e-5), ("goal", "velocity", -1e-5)):
        other = copy.deepcopy(world)
        other[end][0][name][2] += by
        with pytest.raises(RejectedError, match=r"begins or ends with a jump|the motion's end is elsewhere"):
            accept(other, proof.data)
    for end, change in (
        ("start", {"velocity": [0.3]}),
        ("start", {"velocity": None}),
        ("goal", {"speed": [0.0] * 6}),
        ("start", {"acceleration": "fast"}),
    ):
        other = copy.deepcopy(world)
        other[end][0] |= change
        with pytest.raises(RejectedError):
            accept(other, proof.data)
    still = {key: value for key, value in world["start"][0].items() if key in ("joints", "others")}
    with pytest.raises(RejectedError, match="begins or ends with a jump"):  # of a robot at rest
        accept({**world, "start": [still]}, proof.data)


def test_motions_of_other_scenes_begin_wrongly(planned: tuple[Scene, hdplan.PlanResult]) -> None:
    scene, result = planned
    rest = scene_of("ur5")
    assert hdplan.certify(rest, result.trajectory).status is Status.TOO_FAST  # it jumps to its velocity
    slow = moving(scene, [0.3, -0.2, 0.1, 0.2, -0.3, 0.0999])
    assert hdplan.certify(slow, result.trajectory).status is Status.WRONG_ENDS
    assert hdplan.certify(scene, hdplan.plan(rest).trajectory).status is Status.WRONG_ENDS
    path = Trajectory(result.trajectory.joint_names, result.trajectory.positions)
    with pytest.raises(InputError, match="has no times"):
        hdplan.certify(scene, path)
    untimed = dataclasses.replace(rest, limits=Limits()).with_start(State(rest.start, np.zeros(6)))
    assert hdplan.certify(untimed, hdplan.plan(untimed).trajectory).certified  # at rest, which has no times


def test_durations_scales_and_rates_are_kept_with_moving_ends() -> None:
    rest = scene_of("ur5", 1)
    for timing in (Timing(duration=3.217, rate=33.0), Timing(scale=0.3), Timing(rate=250.0)):
        result = hdplan.plan(moving(dataclasses.replace(rest, timing=timing), [0.4, 0, 0, -0.4, 0, 0]))
        assert result.certificate.certified, result.certificate.text
        times = result.trajectory.times
        assert times is not None
        assert np.diff(times).max() <= 1 / timing.rate + 1e-9
        if timing.duration is not None:
            assert times[-1] == pytest.approx(timing.duration, abs=1e-9)
    short = dataclasses.replace(rest, timing=Timing(duration=0.05))
    with pytest.raises(UnsolvableError, match=r"timing.duration: 0.05 s, but the robot needs"):
        hdplan.plan(moving(short, [0.4, 0, 0, 0, 0, 0]))


STILL = [0.0] * 5
REFUSED: dict[str, tuple[Callable[[Scene], object], str]] = {
    "no limit": (
        lambda s: hdplan.plan(dataclasses.replace(s, limits=Limits(velocity=1.0), timing=Timing(2.0))),
        "start.velocity: is not 0, but limits.acceleration is missing",
    ),
    "too few": (lambda s: hdplan.plan(moving(s, [0.1])), "start.velocity: 1 values, but ur5 plans 6 joints"),
    "unknown": (lambda s: hdplan.plan(moving(s, {"elbow": 0.1})), "start.velocity: unknown joint 'elbow'"),
    "too fast": (lambda s: hdplan.plan(moving(s, [9, *STILL])), "start.velocity: joint 'shoulder_pan_joint' is at 9,"),
    "too strong": (lambda s: hdplan.plan(moving(s, [0, *STILL], [6, *STILL])), "start.acceleration: joint"),
    "soon too fast": (lambda s: hdplan.plan(moving(s, [3.14, *STILL], [5, *STILL])), "passes its limit of velocity"),
    "acceleration alone": (lambda s: State(s.start, None, [0.1, *STILL]), "State.acceleration: needs a velocity"),
    "a choice": (lambda s: s.with_goal([State(s.goal, [0.1, *STILL]), s.goal]), "one of several goals has a velocity"),
    "a job": (
        lambda s: dataclasses.replace(s, goal=None, job=Job([Move(s.goal)])),
        "start.velocity: applies to a single",
    ),
    "a stage": (lambda s: Move(State(s.goal, [0.1, *STILL])), "goal.velocity: applies to a single motion"),
    "a problem": (hdplan.build, "start.velocity: is not 0, and the path of a problem"),
    "a controller": (lambda s: follow(Setup.of(s), None), "start.velocity: is not 0, and a controller"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_commands_that_cannot_take_a_moving_start_refuse_it(case: str) -> None:
    call, message = REFUSED[case]
    with pytest.raises(InputError, match=message) as error:
        call(moving(scene_of("ur5"), [0.1] * 6))
    assert "\n" not in str(error.value)


def test_problems_are_sampled_and_edited_at_rest_alone(tmp_path: Path) -> None:
    moving(scene_of("ur5"), [0.1] * 6).save(tmp_path / "s.yaml")
    with pytest.raises(InputError, match="sampled problems begin and end at rest"):
        sample(tmp_path / "s.yaml", 1)
    pytest.importorskip("viser", reason="the viewer is optional")
    from hdplan.planner.view.edited_scene import Edited

    with pytest.raises(InputError, match="the viewer edits scenes that begin and end at rest"):
        Edited.of(Setup.of(load_scene(tmp_path / "s.yaml")))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("start: {velocity: [0.1]}", "start: must have either 'joints' or 'state', found neither"),
        ("start: {state: default, velocity: fast}", "start.velocity: must be a list of numbers, or a mapping"),
        ("start: {state: default, velocity: [0.1, .nan]}", r"start.velocity\[1\]: must be a finite number"),
        ("start: {state: default, acceleration: [0.1]}", "start.acceleration: needs a velocity beside it"),
        (
            "goal: {pose: {position: [0.5, 0, 0.5], free_rotation: all}, velocity: [0.1]}",
            "goal.velocity: applies to a single",
        ),
        ("goal: {joints: [[0, 0], [1, 1]], velocity: [0.1, 0.1]}", "goal.velocity: applies to a single configuration"),
        ("goal: {any: [{joints: [0, 0], velocity: [0.1, 0.1]}]}", r"goal.any\[0\]: unknown key 'velocity'"),
    ],
)
def test_files_with_rates_that_have_no_meaning_are_refused(line: str, message: str, tmp_path: Path) -> None:
    ends = {"start": "start: {state: default}", "goal": "goal: {state: default}"} | {line.partition(":")[0]: line}
    (tmp_path / "s.yaml").write_text("\n".join(["hdplan: 1", "robot: {name: panda}", *ends.values()]))
    with pytest.raises(InputError, match=message):
        load_scene(tmp_path / "s.yaml")


def test_an_explanation_says_how_fast_the_robot_is() -> None:
    rows = effects(problem_of(Setup.of(moving(scene_of("ur5"), [0.1, -0.25, 0, 0, 0, 0]))))
    assert next(each.on for each in rows if each.name == "moving ends").startswith("start at up to 0.25 rad/s")


def test_a_request_with_velocities_is_planned_and_proven(tmp_path: Path) -> None:
    examples = Path(__file__).parents[2] / "docs" / "examples"
    request = yaml.safe_load((examples / "moveit_request.yaml").read_text())
    state = request["start_state"]["joint_state"]
    state["velocity"] = [0.2, *(0.0 for _ in state["name"][1:])]
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(request))
    given = examples / "moveit_scene.yaml", tmp_path / "r.yaml", "panda"
    result = hdplan.plan(load_scene(*given))
    assert result.certificate.certified
    assert result.trajectory.velocities is not None
    assert (
        dict(zip(result.trajectory.joint_names, result.trajectory.velocities[0], strict=True))[state["name"][0]] == 0.2
    )
    result.save(tmp_path / "m.json")
    proof = hdplan.prove(given[0], tmp_path / "m.json", *given[1:])
    assert proof.text.startswith("accepted: over the whole motion")
    state["velocity"][0] = 0.2001
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(request))
    with pytest.raises(hdplan.NotProvenError, match="wrong ends"):
        hdplan.prove(given[0], tmp_path / "m.json", *given[1:])
