"""Shipped scenes that need an effect: planned without its section the motion is wrong by the scene's own certificate,
planned with it the motion is right."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import replace

import pytest

from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import certify
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.plan import plan
from hdplan.planner.result import verdict
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import SelfCollision
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene

Change = Callable[[Scene], Scene]


def no_path(scene: Scene) -> Scene:
    return replace(scene, path=PathConstraints())


def no_own_clearance(scene: Scene) -> Scene:
    return replace(scene, obstacles=tuple(replace(obstacle, clearance=None) for obstacle in scene.obstacles))


def no_self_collision(scene: Scene) -> Scene:
    return replace(scene, self_collision=SelfCollision(checked=False))


def no_base(scene: Scene) -> Scene:
    return replace(scene, robot=replace(scene.robot, base=Pose()))


def no_ranges(scene: Scene) -> Scene:
    return replace(scene, limits=replace(scene.limits, position={}))


def all_known(scene: Scene) -> Scene:
    obstacles = tuple(replace(obstacle, uncertainty=None) for obstacle in scene.obstacles)
    return replace(scene, obstacles=obstacles, robot=replace(scene.robot, tracking=None, calibration=None))


NEEDED: list[tuple[str, Change, Status, str]] = [
    ("panda_cup", no_path, Status.OFF_PATH, "path.upright: panda_hand is tilted by 0.59"),
    ("ur5_scan", no_path, Status.OFF_PATH, "path.position: the point of tool0 is "),
    ("panda_vase", no_own_clearance, Status.TOO_CLOSE, "vase come within "),
    ("panda_fold", no_self_collision, Status.IN_CONTACT, "panda_link0 and "),
    ("panda_cable", no_ranges, Status.OUTSIDE_LIMITS, "joint 'panda_joint4' at -2.6"),
    ("baxter_bimanual_carry", no_path, Status.OFF_PATH, "orientation_tolerance: right_gripper is turned by 0.3"),
    ("panda_person", all_known, Status.TOO_CLOSE, "and crate are "),
    ("ur5_ceiling", no_base, Status.IN_CONTACT, "divider overlap by "),
]


@pytest.mark.parametrize(("name", "without", "status", "message"), NEEDED, ids=[name for name, *_ in NEEDED])
def test_the_plan_is_wrong_without_the_section_and_right_with_it(
    name: str, without: Change, status: Status, message: str
) -> None:
    scene = load_scene(name)
    lacking = plan(without(scene))
    assert lacking.certified  # as far as that scene says
    judged = certify(scene, lacking.trajectory)
    assert judged.status is status
    assert message in judged.text
    result = plan(scene)
    assert result.certified, result.certificate.text
    assert certify(scene, result.trajectory).certified


@pytest.mark.parametrize(("name", "field"), [("panda_cup", "path.upright"), ("ur5_scan", "path.position")])
def test_path_constraints_are_reported_where_there_are_any(name: str, field: str) -> None:
    scene = load_scene(name)
    for each, present in ((scene, True), (no_path(scene), False)):
        problem = build(each)
        assert (field in dict(explain(problem)["on"])) is present
        assert (field in {term.name for term in problem.terms}) is present
    result = plan(scene)
    (kept,) = verdict(result.certificate)["path"]
    assert (kept["constraint"], kept["link"]) == (field, {"panda_cup": "panda_hand", "ur5_scan": "tool0"}[name])
    assert kept["worst"] <= kept["allowed"] + 1e-9
    assert "path" not in verdict(plan(no_path(scene)).certificate)


def test_a_path_that_constrains_nothing_leaves_the_plan_as_it_is() -> None:
    scene = load_scene("panda_cup")
    free = plan(no_path(scene))
    bound = plan(dataclasses.replace(scene, path=dataclasses.replace(scene.path, upright=None)))
    assert bound.trajectory.positions.tobytes() == free.trajectory.positions.tobytes()


def test_tiago_needs_its_group() -> None:
    """Without it all its joints are to be planned: the goal misses most of them, and one line names the remedy."""
    scene = load_scene("tiago_shelf")
    whole = replace(scene, robot=replace(scene.robot, group=None))
    with pytest.raises(InputError, match=r"start: no value for .* \d+ more; robot\.group .* robot\.locked"):
        plan(whole)


def test_pr2_needs_what_its_start_says_of_the_other_arm() -> None:
    """Held elsewhere, the left arm is in the right one's way."""
    scene = load_scene("pr2_shelf")
    assert scene.start.by_name is not None
    right = {joint: value for joint, value in scene.start.by_name.items() if joint.startswith("r_")}
    other = {**right, "l_shoulder_pan_joint": -0.6, "l_elbow_flex_joint": -0.2}
    with pytest.raises(InputError, match=r"in collision: .*l_.* and r_|in collision: .*r_.* and l_"):
        plan(scene.with_start({**other, "r_shoulder_pan_joint": 0.5, "r_elbow_flex_joint": -0.2}))
