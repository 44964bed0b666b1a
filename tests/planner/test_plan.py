"""Laws of planning whole: shipped scenes are certified, wrong ends refused by name, and every end is a result."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import ENDS_KEEP, Certifier, certify
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.problem.problem import Problem
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.guesses import Guess
from hdplan.planner.search.search import DENSER_ROUNDS, Event, Search
from hdplan.planner.solvers.solution import Budget, Solution, Solver, SolverStatus
from hdplan.scenes import deadline
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Sphere
from hdplan.scenes.targets import Goals, JointTarget
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

EXACT = 1e-9  # [m] of a distance known in closed form: the certificate's own bound is 1e-9 of the sizes
KEYS = {  # of the summary, as promised to whoever reads the JSON
    "status", "text", "scene", "robot", "solver", "joint_names", "waypoints", "clearance_m", "self_clearance_m",
    "worst", "time_s", "iterations", "attempts", "seed", "objective", "timed_out", "notes",
}  # fmt: skip
TIMES = {"load", "build", "compile", "solve", "certify"}

START, GOAL = (-0.8, 0.3), (1.0, 0.4)  # of the planar arm


def tip(shoulder: float, elbow: float) -> tuple[np.ndarray, np.ndarray]:
    """The centre of the ball at the tip of the planar arm, and the direction of its forearm."""
    upper, fore = ([np.cos(a), np.sin(a), 0] for a in (shoulder, shoulder + elbow))
    return np.array([0, 0, 0.1]) + 0.5 * np.array(upper) + 0.5 * np.array(fore), np.array(fore)


def ball_before_the_tip(gap: float, q: tuple[float, float] = START) -> Obstacle:
    """A ball whose distance from the arm at q is `gap` [m] exactly: it faces the tip's own ball of 0.04 m."""
    centre, direction = tip(*q)
    place = centre + (0.04 + 0.1 + gap) * direction
    return Obstacle("pea", Sphere(0.1), Pose(tuple(place.tolist())))


def planar(*obstacles: Obstacle, **planner: float) -> Scene:
    scene = load_scene("planar_arm")
    return dataclasses.replace(
        scene, obstacles=obstacles or scene.obstacles, planner=dataclasses.replace(scene.planner, **planner)
    )


def assert_sound(result: PlanResult, scene: Scene) -> None:
    """The laws of every result, found or not: its shape, its ends, and a certificate that stands alone."""
    positions = result.trajectory.positions
    rows = len(result.trajectory) if scene.timed else scene.planner.waypoints  # in time there are more
    assert positions.shape == (rows, len(result.trajectory.joint_names))
    assert (result.trajectory.accelerations is not None) == scene.timed
    assert np.isfinite(positions).all()
    again = certify(scene, result.trajectory)
    assert again.status is not Status.WRONG_ENDS
    assert again.certified or not result.certified


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_are_certified_by_default(name: str) -> None:
    scene = load_scene(name)
    result = plan(scene)
    assert result.certified, result.certificate.text
    assert_sound(result, scene)
    summary = json.loads(json.dumps(result.summary()))
    called_for = {
        "goal": isinstance(scene.goal, Goals),
        "path": scene.path != PathConstraints(),
        "limits": scene.timed,
        "duration_s": scene.timed,
    }
    assert set(summary) == KEYS | {key for key, there in called_for.items() if there}
    assert set(summary["time_s"]) == TIMES
    assert summary["status"] == "certified"
    assert summary["waypoints"] == len(result.trajectory)
    assert summary["joint_names"] == list(result.trajectory.joint_names)
    assert all(seconds >= 0 for seconds in summary["time_s"].values())
    if scene.obstacles:
        assert summary["clearance_m"] > 0
        sized = {"unknown_m"} if name == "panda_person" else set()
        assert set(summary["worst"]) == {"parameter", "seconds", "link", "obstacle", "distance_m"} | sized
        assert summary["worst"]["distance_m"] >= summary["clearance_m"] - EXACT
        assert summary["worst"]["obstacle"] in {obstacle.name for obstacle in scene.obstacles}
    else:
        assert (summary["clearance_m"], summary["worst"]) == (None, None)


@pytest.mark.core
def test_the_same_seed_gives_the_same_bytes() -> None:
    one, other = (plan(load_scene("panda_corridor"), seed=3) for _ in range(2))
    assert one.trajectory.positions.tobytes() == other.trajectory.positions.tobytes()
    assert (one.iterations, one.attempts) == (other.iterations, other.attempts)


@pytest.mark.parametrize("solver", ["chomp", "fatrop", "ipopt"])
def test_the_other_solvers_come_through_too(solver: str) -> None:
    scene = planar(waypoints=16)
    result = plan(scene, solver=solver, time_limit=60.0)
    assert result.certified, result.certificate.text
    assert result.summary()["solver"] == solver


@pytest.mark.core
def test_the_required_clearance_is_proven() -> None:
    result = plan(planar(clearance=0.02))
    assert result.certified
    assert result.certificate.clearance is not None
    assert result.certificate.clearance >= 0.02
    assert result.notes == ()


@pytest.mark.parametrize("field", ["start", "goal"])
def test_an_end_in_collision_is_refused_by_link_obstacle_and_depth(field: str) -> None:
    scene = planar(ball_before_the_tip(-0.005, START if field == "start" else GOAL))
    words = rf"the scene made from planar_arm: {field}: in collision: forearm and pea overlap by 5 mm$"
    with pytest.raises(InputError, match=words):
        plan(scene)


def test_an_end_that_collides_with_itself_is_refused() -> None:
    """The Panda's hand in its own upper arm."""
    folded = JointTarget("goal", (1.9, -0.3, 1.9, -3.0, -0.8, 0.3, 0.9))
    words = r"the scene made from empty: goal: in collision: panda_hand and panda_link2 overlap by \d"
    with pytest.raises(InputError, match=words):
        plan(dataclasses.replace(load_scene("empty"), goal=folded))


@pytest.mark.parametrize("field", ["start", "goal"])
def test_ends_closer_than_the_clearance_lower_it_with_a_word(field: str) -> None:
    """The motion is the same forwards and backwards, away from the ball."""
    scene = planar(ball_before_the_tip(0.003, GOAL), clearance=0.02)
    ends = {"start": GOAL, "goal": START} if field == "start" else {}
    scene = dataclasses.replace(scene, **{end: JointTarget(end, q) for end, q in ends.items()})
    result = plan(scene)
    assert result.certified, result.certificate.text
    assert result.certificate.clearance is not None
    assert ENDS_KEEP * 0.003 - EXACT <= result.certificate.clearance <= 0.003 + EXACT
    (note,) = result.notes
    assert note == (
        f"{field} is 3 mm from pea: 2.25 mm are required over the whole motion instead of the 20 mm of "
        "planner.clearance"
    )


def test_no_time_gives_the_straight_line_with_its_verdict() -> None:
    scene = planar()
    result = plan(scene, time_limit=0.0)
    assert not result.certified
    assert result.certificate.status is Status.IN_CONTACT
    assert (result.attempts, result.iterations, result.steps) == (1, 0, ())
    assert_sound(result, scene)
    assert result.summary()["clearance_m"] is None
    np.testing.assert_allclose(result.trajectory.positions, np.linspace(START, GOAL, scene.planner.waypoints))


def test_a_problem_without_a_solution_ends_with_the_time_and_the_best_attempt() -> None:
    """Walls along x, ahead and behind: nearer to the shoulder than the elbow is, so it can be folded past neither."""
    walls = [
        Obstacle(name, Box((3.0, 0.02, 1.0)), Pose((x, 0.0, 0.1))) for name, x in (("wall", 1.85), ("back", -1.85))
    ]
    ends = {"start": JointTarget("start", (-0.3, 0.0)), "goal": JointTarget("goal", (0.3, 0.0))}
    scene = dataclasses.replace(planar(*walls, waypoints=12), **ends)
    reached: list[Event] = []
    result = plan(scene, time_limit=1.5, report=reached.append)
    assert not result.certified
    assert result.certificate.status is Status.IN_CONTACT
    assert "wall" in result.certificate.text or "back" in result.certificate.text
    certificates = [event.certificate for event in reached if event.certificate]
    assert result.certificate in certificates
    deepest = [min(place.distance for place in c.failures) for c in certificates]
    assert min(place.distance for place in result.certificate.failures) >= min(deepest)
    assert_sound(result, scene)


def interrupt_at(matches: Callable[[Event], bool]) -> Callable[[Event], None]:
    """A report that stands for Ctrl-C at the first event of its kind."""

    def report(event: Event) -> None:
        if matches(event):
            raise KeyboardInterrupt

    return report


@pytest.mark.parametrize("step", [1, 3])
def test_an_interrupt_while_solving_gives_the_motion_so_far(step: int) -> None:
    scene = planar()
    result = plan(scene, report=interrupt_at(lambda event: event.step is not None and event.step.iteration == step))
    assert result.iterations == step
    assert result.attempts == 1
    assert_sound(result, scene)


def test_an_interrupt_at_a_certificate_gives_the_best_so_far() -> None:
    scene = planar()
    first = plan(scene, report=interrupt_at(lambda event: event.certificate is not None))
    assert first.steps
    result = plan(scene, report=interrupt_at(lambda event: bool(event.certificate and event.certificate.certified)))
    assert result.certified
    assert_sound(result, scene)


def test_an_interrupt_before_anything_is_an_interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    def certify_never(self: object, *args: object, **kwargs: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr("hdplan.planner.certificate.certifier.Certifier.certify", certify_never)
    with pytest.raises(KeyboardInterrupt):
        plan(planar())


def test_events_tell_the_whole_story() -> None:
    """Every step and every certificate is reported; the counts of the result are theirs."""
    events: list[Event] = []
    result = plan(load_scene("panda_cage"), report=events.append)
    steps = [event.step for event in events if event.step]
    assert len(steps) == result.iterations
    assert events[-1].certificate is not None
    assert max(event.attempt for event in events) == result.attempts
    assert set(result.steps) <= set(steps)


WALL = Obstacle("wall", Box([2.4, 0.05, 0.5]), Pose((1.4, 0.0, 0.1)))  # no motion passes it


def test_a_search_that_the_clock_ended_says_so() -> None:
    blocked = planar(WALL)
    result = plan(blocked, time_limit=0.3)
    assert not result.certified
    assert result.timed_out
    guesses = f"{result.attempts} guess{'es' * (result.attempts != 1)}"
    assert result.ended == f"time limit of 0.3 s reached after {guesses}; more time may help"
    assert result.ended in result.notes
    assert (result.summary()["timed_out"], result.summary()["notes"]) == (True, list(result.notes))
    free = plan(planar())
    assert (free.timed_out, free.ended, free.summary()["timed_out"]) == (False, "", False)
    stopped = plan(blocked, stop=lambda: True)
    assert not stopped.certified
    assert not stopped.timed_out, "nobody's clock"


def test_a_motion_that_the_clock_left_unbettered_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion that the time limit decides may be another one in the next run."""
    from hdplan.planner import plan as planning

    limit = 0.3
    monkeypatch.setattr(planning, "polish", lambda *_: time.sleep(limit))
    result = plan(planar(polish=2), time_limit=limit)
    assert result.certified
    assert result.ended == "time limit of 0.3 s reached while the motion was improved; more time may improve it"
    with deadline.time_limit(1.5 * limit):
        assert "time limit of 0.3 s" in plan(planar(polish=2), time_limit=limit).ended
    monkeypatch.setattr(planning, "polish", lambda *_: None)
    assert plan(planar(polish=2), time_limit=10.0).ended == ""


def test_a_motion_is_saved_with_its_verdict(tmp_path: Path) -> None:
    scene = planar()
    result = plan(scene)
    result.save(tmp_path / "motion.json")
    stored = json.loads((tmp_path / "motion.json").read_text())
    assert stored["hdplan_trajectory"] == 1
    assert result.summary()["status"] in json.dumps(stored)
    read = Trajectory.load(tmp_path / "motion.json")
    assert certify(scene, read).certified


def test_a_robot_that_nothing_can_touch_is_certified(stick_scene: Callable[[Obstacle], Scene]) -> None:
    result = plan(stick_scene(Obstacle("ball", Sphere(0.1))))
    assert result.certified
    assert (result.certificate.clearance, result.certificate.self_clearance) == (None, None)


def test_an_unknown_solver_is_refused_before_any_work() -> None:
    with pytest.raises(InputError, match=r"solver: unknown 'chump' \(did you mean 'chomp'\?\)"):
        plan(planar(), solver="chump")


def test_stop_ends_the_search_with_a_verdict_on_what_there_is() -> None:
    events: list[Event] = []
    result = plan(load_scene("panda_cage"), report=events.append, stop=lambda: len(events) >= 5)
    assert (result.attempts, result.iterations) == (1, 5)
    assert result.certificate.text


def test_an_interrupt_within_the_first_certificate_does_not_lose_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    certify, calls = Certifier.certify, []

    def interrupted_once(self: Certifier, *args: Any, **kwargs: Any) -> Any:
        calls.append(1)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return certify(self, *args, **kwargs)

    monkeypatch.setattr(Certifier, "certify", interrupted_once)
    scene = planar()
    result = plan(scene)
    assert len(calls) == 2
    assert_sound(result, scene)


def test_the_straight_line_is_taken_where_the_solver_leaves_it_for_worse() -> None:
    """Solvers do so where outer bodies overlap at an end, though the links are free: it is not believed either."""
    scene = planar(Obstacle("pea", Sphere(0.05), Pose((0.0, -0.9, 0.1))), polish=0)
    robot, rounds = load_scene_robot(scene), []

    def astray(problem: Problem, guess: np.ndarray, budget: Budget) -> Solution:
        rounds.append(guess)
        worse = guess - np.sin(np.linspace(0.0, np.pi, len(guess)))[:, None] * [2.0, 0.4]
        return Solution(Trajectory(robot.joint_names, worse), SolverStatus.CLEAR, budget.first_weight, (), 0.0)

    problem, certifier = build(scene, robot), Certifier(Setup.of(scene, robot))
    search = Search(problem, certifier, None, Solver(astray), 0.005, np.inf, lambda event: None, lambda: False)
    line = np.linspace(START, GOAL, problem.waypoints)
    assert search.attempt(Guess(line, as_it_is=True))
    best = search.conclude()
    assert best.certificate.certified
    assert len(rounds) == 1 + DENSER_ROUNDS  # as it says that it is clear, and is not
    assert np.array_equal(best.trajectory.positions, line)
    assert certify(scene, best.trajectory, robot).certified


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"report": None}, "report: must be a function, found nothing"),
        ({"stop": True}, "stop: must be a function, found true"),
        ({"terms": 3}, "terms: must be a list of OwnTerms, found 3"),
        ({"terms": (each for each in ())}, "terms: must be a list of OwnTerms"),  # would be empty the second time
        ({"terms": ["cost"]}, "terms: must be of the class OwnTerm"),
    ],
)
def test_arguments_of_other_kinds_are_refused_by_name(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan(planar(), **wrong)
    motion = Trajectory(("panda_joint1",), np.zeros((2, 1)))
    for value in (1, [], np.zeros((2, 2))):
        with pytest.raises(InputError, match="check_ends: must be true or false"):
            certify(planar(), motion, check_ends=value)
