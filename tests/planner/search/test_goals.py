"""Laws of goals that leave a choice: poses are reached as they say, the best certified goal wins, absent is absent."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from hdplan import InputError, PlanResult, Pose, Scene, Trajectory, UnsolvableError, build, load_scene, plan
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.pose_goals import miss_of, reached_by
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.kinematics import inverse
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search import goals as goal_search
from hdplan.planner.search.goals import goal_choice, goals_in_turn, settled
from hdplan.planner.search.inverse_kinematics import LEAST_DIFFERENCE, every_branch, inverse_kinematics, reaching
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget

from ..links import place_of, pose_at


def target_at(link: str, placement: pin.SE3, free: str) -> PoseTarget:
    """A link's pose as a target; without an orientation where any turn will do."""
    pose = pose_at(placement)
    return PoseTarget(link, Pose(pose.position) if free == "all" else pose, free_rotation=free)


def aimed(scene: Scene, *targets: Any) -> Scene:
    return dataclasses.replace(scene, goal=Goals(targets))


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", ["planar_arm", "ur5_table", "panda_cage", "kinova_shelf"])
@pytest.mark.parametrize("free", ["none", "z", "all"])
def test_configurations_found_reach_the_pose_within_limits(name: str, free: str) -> None:
    scene = load_scene(name)
    robot = load_scene_robot(scene)
    link, start = robot.links[-1], robot.configuration(scene.start)
    rng = np.random.default_rng(5)
    for q in robot.draw(rng, 3):
        target = target_at(link, place_of(robot, link, q), free)
        found, (least,) = reaching(robot, target, start, np.random.default_rng(0))
        assert len(found)
        assert least.within(target)
        for row in found:
            assert miss_of(robot, target, row).within(target)
        assert np.all((found >= robot.lower) & (found <= robot.upper))
        assert all(np.abs(a - b).max() > LEAST_DIFFERENCE for a, b in itertools.combinations(found, 2))
        lengths = np.linalg.norm(found - start, axis=1)
        assert np.all(np.diff(lengths) >= 0)
        again, _ = reaching(robot, target, start, np.random.default_rng(0))
        assert again.tobytes() == found.tobytes()


def test_plans_to_a_pose_know_every_branch_of_an_arm_in_closed_form() -> None:
    robot, rng = load_scene_robot(load_scene("ur5_table")), np.random.default_rng(0)
    for q, start in zip(robot.draw(rng, 5), robot.draw(rng, 5), strict=True):
        target = target_at("tool0", place_of(robot, "tool0", q), "none")
        found, missed = every_branch(robot, target, start)
        listed = inverse_kinematics(robot, target.pose, "tool0", seed=start, all_branches=True)
        assert missed
        assert all(miss_of(robot, target, each).within(target) for each in found)
        for branch in listed:  # whole turns aside, which plans undo towards their start
            way = found - branch
            assert np.abs(way - 2 * np.pi * np.round(way / (2 * np.pi))).max(axis=1).min() <= LEAST_DIFFERENCE
    spare = load_scene_robot(load_scene("panda_cage"))
    for arm, link, free in ((robot, "tool0", "z"), (spare, "panda_hand", "none")):  # families: these are searched
        start = arm.draw(rng, 1)[0]
        assert not len(every_branch(arm, target_at(link, place_of(arm, link, start), free), start)[0])


def test_the_search_finds_goals_if_every_branch_is_in_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene("ur5_table")
    robot = load_scene_robot(scene)
    start = robot.configuration(scene.start)
    scene = aimed(scene, target_at("tool0", place_of(robot, "tool0", start), "none"))
    calls = []
    monkeypatch.setattr(goal_search, "every_branch", lambda *_: (np.full((1, robot.n), 100.0), ()))
    monkeypatch.setattr(goal_search, "_free", lambda _, found, *__: [(1.0, q) for q in found[:, 0] if q[0] < 99.0])
    monkeypatch.setattr(goal_search, "reaching", lambda *args: (calls.append(args), reaching(*args))[1])
    goals = goal_choice(Certifier(Setup.of(scene))).goals
    assert calls
    assert np.abs(np.array([goal.positions for goal in goals]) - start).max(axis=1).min() < 0.1


def test_a_miss_is_what_the_target_was_moved_by() -> None:
    scene = load_scene("ur5_table")
    robot = load_scene_robot(scene)
    rng = np.random.default_rng(2)
    for q in robot.draw(rng, 20):
        place = place_of(robot, "tool0", q)
        shift, angle = rng.uniform(-0.1, 0.1, 3), rng.uniform(0.1, 3.0)
        for axis, name in enumerate("xyz"):
            turn = pin.exp3(angle * np.eye(3)[axis])
            moved = pin.SE3(place.rotation @ turn, place.translation + shift)
            for free in ("none", "x", "y", "z", "all"):
                miss = miss_of(robot, target_at("tool0", moved, free), q)
                expected = 0.0 if free in (name, "all") else angle
                assert miss == pytest.approx((np.linalg.norm(shift), expected), abs=1e-7)


def test_rows_reach_a_target_if_they_miss_it_by_no_more_than_the_tolerances() -> None:
    """All rows at once, and one by one, with tolerances that some rows use up."""
    robot = load_scene_robot(load_scene("ur5_table"))
    rng = np.random.default_rng(5)
    q = robot.draw(rng, 1)[0]
    rows = q + rng.uniform(-1e-2, 1e-2, (40, robot.n))
    for free in ("none", "x", "all"):
        target = target_at("tool0", place_of(robot, "tool0", q), free)
        tolerances = {"position_tolerance": 4e-3} | ({} if free == "all" else {"orientation_tolerance": 1e-2})
        target = dataclasses.replace(target, **tolerances)
        reached = reached_by(robot, target, rows)
        assert reached.tolist() == [miss_of(robot, target, row).within(target) for row in rows]
        assert 0 < reached.sum() < len(rows)
        assert reached_by(robot, target, rows[:0]).shape == (0,)


def test_a_turn_between_directions_is_as_long_as_their_angle() -> None:
    rng = np.random.default_rng(4)
    wanted, *others = (v / np.linalg.norm(v) for v in rng.normal(size=(20, 3)))
    for direction in (*others, wanted, -wanted):
        (turn,) = inverse._turn_between(direction[None], wanted[None])
        np.testing.assert_allclose(pin.exp3(turn) @ direction, wanted, atol=1e-9)
        assert np.linalg.norm(turn) == pytest.approx(np.arccos(np.clip(direction @ wanted, -1, 1)), abs=1e-7)


def test_a_pose_out_of_reach_is_refused_with_how_close_it_came() -> None:
    scene = load_scene("ur5_table")
    robot = load_scene_robot(scene)
    target = PoseTarget("tool0", Pose((0.3, 0.0, 1.5)), 0.001, 0.01, field="goal.pose")
    with pytest.raises(
        InputError, match=r"goal\.pose: link 'tool0' cannot be brought there: the best of \d+ tries is off by .* mm"
    ):
        goal_choice(Certifier(Setup.of(aimed(scene, target), robot)))


def test_tolerances_are_held_by_the_certificate() -> None:
    scene = load_scene("ur5_table")
    robot = load_scene_robot(scene)
    result = plan(scene)
    place = place_of(robot, "tool0", result.trajectory.positions[-1])
    for off, allowed, met in ((0.009, 0.01, True), (0.011, 0.01, False)):
        moved = pin.SE3(place.rotation, place.translation + [0, 0, off])
        certificate = certify(aimed(scene, PoseTarget("tool0", pose_at(moved), allowed)), result.trajectory)
        assert (certificate.status is Status.WRONG_ENDS) != met
        turned = pin.SE3(place.rotation @ pin.exp3(np.array([0, off * 10, 0])), place.translation)
        target = PoseTarget("tool0", pose_at(turned), 1e-6, allowed * 10)
        certificate = certify(aimed(scene, target), result.trajectory)
        assert (certificate.status is Status.WRONG_ENDS) != met
        other = PoseTarget("tool0", pose_at(place))
        assert certify(aimed(scene, target, other), result.trajectory).certified  # one of them is enough
    assert "the last waypoint has tool0 " in certificate.text
    backwards = Trajectory(result.trajectory.joint_names, result.trajectory.positions[::-1].copy())
    assert certify(aimed(scene, other), backwards).status is Status.WRONG_ENDS


def test_the_shipped_grasp_needs_its_free_axis_and_many_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene("panda_grasp")
    assert isinstance(scene.goal, Goals)
    robot, (target,) = load_scene_robot(scene), scene.goal.targets
    assert isinstance(target, PoseTarget)
    result = plan(scene)
    assert result.certified
    assert result.goal is not None
    miss = miss_of(robot, target, result.trajectory.positions[-1])
    assert miss.within(target)
    assert max(miss) < 1e-6  # where the centre can be reached, the goal is there and not at the tolerance's edge
    assert result.summary()["goal"] == {"of": "goal.pose", "joints": result.goal.positions}
    np.testing.assert_array_equal(result.trajectory.positions[-1], result.goal.positions)
    assert any(note.startswith("goal chosen of ") for note in result.notes)

    monkeypatch.setattr(goal_search, "DRAW_ROUNDS", 2)
    fixed = aimed(scene, dataclasses.replace(target, free_rotation="none"))
    with pytest.raises(
        InputError,
        match=r"from panda_grasp: goal\.pose: none of \d+ configurations found is valid; the nearest: in collision: ",
    ):
        plan(fixed)

    start = robot.configuration(scene.start)
    nearest = reaching(robot, target, start, np.random.default_rng(0))[0][0]
    guessed = dataclasses.replace(scene, goal=JointTarget("goal", tuple(nearest.tolist())))
    with pytest.raises(InputError, match="goal: in collision"):
        plan(guessed)


def test_a_request_s_pose_is_planned_to_whatever_else_its_start_names() -> None:
    """A MoveIt request speaks of whole robots: of joints that are held, and of some that are not there."""
    scene = load_scene("panda_grasp")
    start = load_scene_robot(scene).configuration(scene.start)
    named = {**dict(zip(load_scene_robot(scene).joint_names, start.tolist(), strict=True)), "wheel": 1.0}
    named["panda_finger_joint1"] = named["panda_finger_joint2"] = 0.04
    request = dataclasses.replace(scene, start=JointTarget("start", by_name=named), from_request=True)
    result = plan(request)
    assert result.certificate.certified
    assert any("wheel" in note for note in result.notes)


@pytest.mark.core
def test_the_same_seed_gives_the_same_bytes() -> None:
    scene = load_scene("panda_grasp")
    first, second = plan(scene, seed=3), plan(scene, seed=3)
    assert first.trajectory.positions.tobytes() == second.trajectory.positions.tobytes()
    assert first.notes == second.notes


def test_of_several_goals_the_least_smoothness_cost_wins() -> None:
    scene = load_scene("planar_arm")
    goals = tuple(JointTarget(f"goal.joints[{i}]", q) for i, q in enumerate([(1.6, 1.0), (-0.5, 0.2), (1.0, 0.4)]))
    result = plan(aimed(scene, *goals))
    costs = {}
    for goal in goals:
        alone = plan(dataclasses.replace(scene, goal=goal))
        if alone.certified:
            costs[goal.field] = build(scene).smoothness.value(alone.trajectory.positions)[0]
    assert result.certified
    assert result.goal is not None
    assert result.goal.field == min(costs, key=lambda field: costs[field])


def test_a_goal_in_collision_is_passed_over_and_reported() -> None:
    scene = load_scene("planar_arm")
    bad, good = JointTarget("goal.joints[0]", (0.0, 0.0)), JointTarget("goal.joints[1]", (1.0, 0.4))
    result = plan(aimed(scene, bad, good))
    assert result.certified
    assert any(note.startswith("goal.joints[0]: in collision") for note in result.notes)
    with pytest.raises(InputError, match=r"goal\.joints\[0\]: in collision: .* and ball"):
        plan(aimed(scene, bad))


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ("tol0", r"goal\.pose\.link: unknown link 'tol0' \(did you mean 'tool0'\?\)"),
        ("base_link", "fixed to the world"),
    ],
)
def test_links_that_will_not_do_are_refused(link: str, words: str) -> None:
    scene = aimed(load_scene("ur5_table"), PoseTarget(link, Pose(), field="goal.pose"))
    with pytest.raises(InputError, match=words):
        plan(scene)


def test_the_explanation_says_what_is_requested() -> None:
    rows = dict(explain(build(load_scene("panda_grasp")))["scene"])
    assert rows["goal.pose"] == (
        "panda_hand_tcp within 1 mm of (0.55, 0.1, 0.39), within 0.01 rad, free to rotate about its x axis"
    )


def test_a_motion_s_own_end_is_kept_for_viewing() -> None:
    scene = load_scene("panda_grasp")
    robot = load_scene_robot(scene)
    ends = {goal.positions: goal for goal in goal_choice(Certifier(Setup.of(scene, robot))).goals}
    last = list(ends)[-1]
    motion = Trajectory(robot.joint_names, np.array([robot.configuration(scene.start), last]))
    setup = Setup.of(scene, robot)
    assert settled(setup, motion).scene.goal == JointTarget("goal", last)
    assert settled(setup).scene.goal == next(iter(ends.values()))
    elsewhere = Trajectory(robot.joint_names, np.array([last, robot.configuration(scene.start)]))
    assert settled(setup, elsewhere).scene == settled(setup).scene


def bytes_of(result: PlanResult) -> Any:
    summary = result.summary()
    del summary["time_s"]
    return summary, result.trajectory.positions.tobytes(), result.steps


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "link"), [("ur5_table", "tool0"), ("panda_cage", "panda_hand")])
def test_goals_come_in_turn_as_if_all_had_been_checked(name: str, link: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The best of each target first, then the second ones; some are never computed before the first one is there."""
    scene, rng, calls = load_scene(name), np.random.default_rng(0), []
    robot, free = load_scene_robot(scene), goal_search._free
    monkeypatch.setattr(goal_search, "_free", lambda *given: (calls.append(given), free(*given))[1])
    for seed in range(4):
        targets = [
            dataclasses.replace(target_at(link, place_of(robot, link, q), "z" if i % 3 else "none"), field=str(i))
            for i, q in enumerate(robot.draw(rng, 8))
        ]
        certifier = Certifier(Setup.of(aimed(scene, *targets)))
        goals = goal_choice(certifier, seed, 3).goals
        ranks = [sum(one.field == goal.field for one in goals[:i]) for i, goal in enumerate(goals)]
        calls.clear()
        in_turn = goals_in_turn(certifier, seed, 3)
        first, before = next(in_turn), len(calls)
        assert before < len(targets)
        assert [first, *in_turn] == [goals[i] for i in np.argsort(ranks, kind="stable")]
    far = Pose((9.0, 0.0, 0.0))
    unreached = Certifier(Setup.of(aimed(scene, *(PoseTarget(link, far, free_rotation=turn) for turn in ("z", "all")))))
    with pytest.raises(UnsolvableError, match="cannot be brought there"):
        next(goals_in_turn(unreached))


@pytest.mark.parametrize("name", ["planar_arm", "panda_corridor", "ur5_table"])
def test_absent_is_absent(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One configuration as goal: nothing of this is called, shown or written, and a choice of one changes nothing."""
    scene = load_scene(name)
    robot, goal = load_scene_robot(scene), scene.goal
    assert isinstance(goal, JointTarget)
    chosen = plan(aimed(scene, goal))

    def never(*_: object) -> None:
        raise AssertionError("called")

    for part in ("reaching", "_free", "kinematics_of"):
        monkeypatch.setattr(goal_search, part, never)
    result = plan(scene)
    setup = Setup.of(scene, robot)
    assert settled(setup) is setup
    assert "goal" not in result.summary()
    assert not any("goal" in note for note in result.notes)
    assert [key for key, _ in explain(build(scene))["scene"] if key.startswith("goal")] == []
    np.testing.assert_array_equal(result.trajectory.positions[-1], Setup.of(scene, robot).query.goal)
    summary, positions, steps = bytes_of(chosen)
    assert summary.pop("goal")["of"] == "goal"
    summary["notes"] = [note for note in summary["notes"] if "goal" not in note]
    assert (summary, positions, steps) == bytes_of(result)


def test_a_pose_out_of_reach_does_not_keep_from_the_others() -> None:
    scene = load_scene("ur5_table")
    robot = load_scene_robot(scene)
    far = PoseTarget("tool0", Pose((3.0, 0.0, 0.5)), free_rotation="all", field="goal.poses[0]")
    place = place_of(robot, "tool0", Setup.of(scene, robot).query.goal)
    near = PoseTarget("tool0", pose_at(place), field="goal.poses[1]")
    result = plan(aimed(scene, far, near))
    assert result.certified
    assert result.goal is not None
    assert result.goal.field == "goal.poses[1]"
    assert any(note.startswith("goal.poses[0]: link 'tool0' cannot be brought there") for note in result.notes)


def test_without_time_the_best_there_is_is_given_back() -> None:
    scene = load_scene("panda_grasp")
    result = plan(scene, time_limit=1e-6)
    assert result.attempts >= 1
    assert certify(scene, result.trajectory).status is not Status.WRONG_ENDS
