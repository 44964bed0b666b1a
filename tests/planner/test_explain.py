"""Laws of the explanation: what it says is what the built problem holds, and why."""

from __future__ import annotations

import dataclasses
import json

import pytest

from hdplan.planner.explain import explain
from hdplan.planner.problem import Problem, build
from hdplan.scenes.model import Box, Obstacle, PlannerSettings, Pose, Scene, SelfCollision
from hdplan.scenes.reader import load_scene

SECTIONS = ["scene", "joints", "terms", "obstacles", "pairs", "size", "settings", "notes"]
FAR_AWAY = Obstacle("far", Box((1.0, 1.0, 1.0)), Pose((5.0, 0.0, 0.0)))


def rows(problem: Problem, section: str) -> dict[str, str]:
    return dict(explain(problem)[section])


def arm(*obstacles: Obstacle, ignore: bool = False, clearance: float = 0.0) -> Scene:
    scene = load_scene("planar_arm")
    robot = dataclasses.replace(scene.robot, ignore_pairs=(("pedestal", "forearm"),) if ignore else ())
    own = SelfCollision(clearance=clearance)
    return dataclasses.replace(scene, obstacles=obstacles, robot=robot, self_collision=own)


@pytest.fixture(scope="module")
def planar() -> Problem:
    return build(load_scene("planar_arm"))


def test_sections_in_reading_order_as_plain_text(planar: Problem) -> None:
    said = explain(planar)
    assert list(said) == SECTIONS
    assert all(isinstance(name, str) and isinstance(value, str) for part in said.values() for name, value in part)
    assert json.loads(json.dumps(said))


@pytest.mark.parametrize(
    ("scene", "obstacles", "links"),
    [
        (arm(clearance=0.2), "off: the scene has no obstacles", "on: grows where two links come within 0.205 m"),
        (arm(FAR_AWAY), "off: every obstacle is out of the robot's reach", "off: every pair of links is proven"),
        (arm(FAR_AWAY, ignore=True), "off: every obstacle is out of the robot's reach", "off: no pair of links"),
        (
            load_scene("planar_arm"),
            "on: grows where a moving link comes within 0.02 m of an obstacle",
            "off: every pair",
        ),
    ],
    ids=["none", "out of reach", "nothing at all", "shipped"],
)
def test_terms_on_and_off_and_why(scene: Scene, obstacles: str, links: str) -> None:
    terms = rows(build(scene), "terms")
    assert terms["smoothness"].startswith("on, always")
    assert terms["obstacles"] == obstacles
    assert terms["self-collision"].startswith(links)


def test_joints_with_and_without_limits() -> None:
    kinova = build(load_scene("kinova_shelf"))
    turning = sum(1 for low in kinova.robot.lower if low == -float("inf"))
    assert 0 < turning < kinova.robot.n
    words = rows(kinova, "terms")["joint limits"]
    assert words == f"on: {kinova.robot.n - turning} joints kept within limits; {turning} joints without"
    joints = rows(kinova, "joints")
    assert [name.strip() for name in joints] == list(kinova.robot.joint_names)
    assert sum("turns freely" in value for value in joints.values()) == turning


def test_pairs_kept_and_pruned_add_up() -> None:
    problem = build(arm(*load_scene("planar_arm").obstacles, FAR_AWAY, clearance=0.2))
    moving = sum(body.joint > 0 for body in problem.bodies)
    kept = next(len(term.pairs) for term in problem.terms if term.name == "obstacles")
    assert moving <= 3 * moving - kept, "at least those of the far body are pruned"
    assert rows(problem, "pairs")["robot and obstacles"] == (
        f"{kept} of {3 * moving} pairs of bodies kept; {3 * moving - kept} can never meet within the joint limits"
    )
    by_obstacle = rows(problem, "obstacles")
    assert list(by_obstacle) == ["ball", "prism", "far"]
    assert by_obstacle["far"].endswith("out of reach, left out")
    of_ball, of_prism = (int(by_obstacle[name].split("; ")[1].split(" of ")[0]) for name in ("ball", "prism"))
    assert of_ball + of_prism == kept
    own = next(len(term.pairs) for term in problem.terms if term.name == "self-collision")
    assert rows(problem, "pairs")["links"].startswith(f"1 of 3 pairs checked, by {own} pairs of bodies")


def test_link_pairs_left_to_the_certificate_are_named() -> None:
    problem = build(load_scene("ur5_table"))
    said = rows(problem, "pairs")
    assert ("left to the certificate" in said) == bool(problem.unresolved)
    for a, b in problem.unresolved:
        assert f"{a}-{b}" in said["left to the certificate"]


def test_size_counts_the_unknowns(planar: Problem) -> None:
    size = rows(planar, "size")
    assert size["unknowns"].startswith(f"{(planar.waypoints - 2) * planar.robot.n}: ")
    assert size["looked at"].startswith(f"{len(planar.samples.weight)} configurations")
    assert size["distance"].startswith(("HD-SDF, compiled C", "HD-SDF, by CasADi’s interpreter"))
    assert rows(build(arm(ignore=True)), "size")["distance"] == "not needed"


def test_every_setting_is_shown_with_its_origin() -> None:
    scene = arm()
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=12, clearance=0.01))
    said = rows(build(scene), "settings")
    assert list(said) == [field.name for field in dataclasses.fields(PlannerSettings)]
    assert said["waypoints"] == "12 (scene)"
    assert said["clearance"] == "0.01 m (scene)"
    assert said["gamma"] == "2 (default)"


def test_scene_says_which_robot_and_which_ends() -> None:
    problem = build(load_scene("empty"))
    said = rows(problem, "scene")
    assert said["file"].endswith("empty.yaml")
    assert said["robot"] == "panda, 7 joints planned, 2 held"
    assert said["held"] == "panda_finger_joint1 = 0.04, panda_finger_joint2 = 0.04"
    joints = rows(problem, "joints")
    for value, start, goal in zip(joints.values(), problem.start, problem.goal, strict=True):
        first, last = value.split(" limits")[0].split("→")
        assert (float(first), float(last)) == pytest.approx((start, goal), rel=1e-3)


def test_pieces_of_meshes_are_counted_and_noted() -> None:
    problem = build(load_scene("panda_table_pick"))
    pieces = sum(body.name == "hook" for body in problem.plane_bodies)
    assert pieces > 1
    assert f"mesh hook.obj in {pieces} convex pieces" in rows(problem, "obstacles")["hook"]
    assert list(rows(problem, "obstacles")) == [obstacle.name for obstacle in problem.scene.obstacles]
    assert [note for _, note in explain(problem)["notes"]] == list(problem.notes)


def test_bodies_are_counted(planar: Problem) -> None:
    links = {body.link for body in planar.bodies}
    assert rows(planar, "scene")["outer bodies"].startswith(f"{len(planar.bodies)} around the {len(links)} links")
