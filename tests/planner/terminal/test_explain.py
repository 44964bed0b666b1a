"""Laws of the explanation: what it says is what the built problem holds, and why."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import pytest

from hdplan.planner.build import build, problem_of
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.obstacles import Obstacle, SelfCollision
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.yaml_format.reader import load_scene

SECTIONS = ["scene", "joints", "on", "off", "obstacles", "pairs", "size", "trial evaluation", "settings"]
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
    rows_ = explain(planar)
    assert list(rows_) == SECTIONS
    assert all(isinstance(name, str) and isinstance(value, str) for part in rows_.values() for name, value in part)
    assert json.loads(json.dumps(rows_))


@pytest.mark.parametrize(
    ("scene", "obstacles", "links"),
    [
        (arm(clearance=0.2), "needs obstacles[]", "clearance 0.2 m; penalty where two links come within 0.205 m"),
        (arm(FAR_AWAY), "every obstacle is out of the robot's reach", "every pair of links is proven"),
        (arm(FAR_AWAY, ignore=True), "every obstacle is out of the robot's reach", "no pair of links can meet"),
        (load_scene("planar_arm"), "2; penalty where a moving link comes within 0.02 m of one", "every pair"),
    ],
    ids=["none", "out of reach", "nothing at all", "shipped"],
)
def test_effects_on_and_off_and_why(scene: Scene, obstacles: str, links: str) -> None:
    problem = build(scene)
    on, off = rows(problem, "on"), rows(problem, "off")
    terms = {term.name for term in problem.terms}
    assert on["smoothness"].startswith("always")
    assert not on.keys() & off.keys()
    for name, words in (("obstacles", obstacles), ("self-collision", links)):
        assert (name in on) == (name in terms)
        assert {**on, **off}[name].startswith(words)


EVERYTHING = """
hdplan: 1
robot: {name: panda, base: {position: [0, 0, 1.6], rpy: [3.141592653589793, 0, 0]}}
obstacles:
  - {name: wall, shape: {type: box, size: [0.1, 2, 0.3]}, pose: {position: [0.8, 0, 0.6]}, clearance: 0.05,
     uncertainty: {position: 0.001}}
  - {name: cart, shape: {type: sphere, radius: 0.1}, pose: {position: [0.4, -2, 0.5]}, motion: {velocity: [0, 0.3, 0]}}
attached:
  - {name: cup, link: panda_hand, shape: {type: sphere, radius: 0.03}, pose: {position: [0, 0, 0.12]}, mass: 0.4,
     touch_links: [panda_leftfinger, panda_rightfinger]}
self_collision: {clearance: 0.01}
limits: {position: {panda_joint1: [-2, 2]}, velocity: 1.5, acceleration: 8, jerk: 80, torque: urdf}
payload: {link: panda_hand, mass: 1.0}
path:
  upright: {link: panda_hand, tolerance: 0.5}
  position: {link: panda_hand, size: [.inf, 5, 5]}
  relative: {link: panda_hand, to: panda_link6, position_tolerance: 0.5, orientation_tolerance: 3}
timing: {duration: 4}
start: {state: default, velocity: {panda_joint1: 0.1}}
goal: {joints: [[0.5, -0.785, 0, -2.356, 0, 1.571, 0.785], [-0.5, -0.785, 0, -2.356, 0, 1.571, 0.785]]}
"""


def test_every_effect_has_its_line(tmp_path: Path) -> None:
    """Each effect is off in an empty scene, with the section that would switch it on, and on in a scene of all."""
    file = tmp_path / "everything.yaml"
    file.write_text(EVERYTHING)
    every, none = problem_of(Setup.of(load_scene(file))), build(load_scene("empty"))
    on, off = rows(every, "on"), rows(none, "off")
    assert "off" not in explain(every)
    assert set(on) == {*off, *rows(none, "on")}
    assert set(off) == set(on) - {"smoothness", "joint limits", "self-collision"}
    assert all(words.startswith("needs ") for words in off.values())
    for name, words in (
        ("loads", "1 kg on panda_hand, 0.4 kg of cup"),
        ("base", "stands at (0, 0, 1.6), upside down"),
        ("unknown", "obstacles[].uncertainty.position: planned and proven for every world within these sizes"),
        ("moving obstacles", "1; each sample of the motion uses their poses at its time"),
        ("path.upright", "axis (0, 0, 1) of panda_hand points up all the way, tilted by 0.5 rad at most"),
        ("path.relative", "panda_hand keeps its pose at panda_link6, within 500 mm and 3 rad"),
        ("times", "minimum jerk in 4 s, 100 rows per second"),
    ):
        assert on[name] == words
    terms = [term.name for term in every.terms]
    assert set(terms) <= rows(every, "trial evaluation").keys()
    assert all(any(row.startswith(term) for row in rows(every, "size")) for term in terms)
    assert dict(explain(every)["obstacles"])["cart"] == "sphere, radius 0.1 m; moves at 0.3 m/s; 11 pairs"


def test_pairs_excluded_and_why_add_up() -> None:
    for name in ("panda_carry", "ur5_table", "kinova_shelf"):
        problem = build(load_scene(name))
        found = rows(problem, "pairs")
        links = next(value for key, value in found.items() if key.startswith("links"))
        checked, total, reasons = re.fullmatch(r"(\d+) of (\d+) pairs checked; excluded: (.*)", links).groups()
        assert int(checked) == len(problem.robot.self_pairs)
        assert int(checked) + sum(int(part.split()[0]) for part in reasons.split(", ")) == int(total)
        own = problem.terms.self_collision
        assert found["bodies of links"].startswith(f"{len(own.pairs)} of {len(own.pairs) + len(problem.apart)} pairs")
        assert ("proven" in found["bodies of links"]) == bool(problem.apart)


def test_the_trial_is_shared_out_and_marked_as_measured(planar: Problem) -> None:
    found = rows(planar, "trial evaluation")
    assert next(iter(found)) == "measured"
    shares = [
        re.findall(r"(\d+) %", row) for name, row in found.items() if name not in ("measured", "all, with derivatives")
    ]
    assert sum(int(row[0]) for row in shares) == pytest.approx(100, abs=len(shares))
    assert sum(int(row[1]) for row in shares if len(row) > 1) == pytest.approx(100, abs=len(shares))


def test_joints_with_and_without_limits() -> None:
    kinova = build(load_scene("kinova_shelf"))
    turning = sum(1 for low in kinova.robot.lower if low == -float("inf"))
    assert 0 < turning < kinova.robot.n
    words = rows(kinova, "on")["joint limits"]
    assert words == f"{kinova.robot.n - turning} joints kept within limits; {turning} joints without"
    joints = rows(kinova, "joints")
    assert [name.strip() for name in joints] == list(kinova.robot.joint_names)
    assert sum("turns freely" in value for value in joints.values()) == turning


def test_pairs_kept_and_pruned_add_up() -> None:
    problem = build(arm(*load_scene("planar_arm").obstacles, FAR_AWAY, clearance=0.2))
    moving = sum(body.joint > 0 for body in problem.bodies)
    kept = len(problem.terms.obstacles.pairs)
    assert moving <= 3 * moving - kept, "at least those of the far body are pruned"
    assert rows(problem, "pairs")["robot and obstacles"] == (
        f"{kept} of {3 * moving} pairs of bodies kept; {3 * moving - kept} can never meet within the joint limits"
    )
    by_obstacle = rows(problem, "obstacles")
    assert list(by_obstacle) == ["ball", "prism", "far"]
    assert by_obstacle["far"].endswith("out of reach, left out")
    of_ball, of_prism = (int(by_obstacle[name].split("; ")[1].split(" of ")[0]) for name in ("ball", "prism"))
    assert of_ball + of_prism == kept
    own = len(problem.terms.self_collision.pairs)
    assert rows(problem, "pairs")["links"] == "1 of 3 pairs checked; excluded: 2 neighbours"
    assert rows(problem, "pairs")["bodies of links"] == f"{own} of {own} pairs kept"


def test_link_pairs_left_to_the_certificate_are_named() -> None:
    problem = build(load_scene("ur5_table"))
    found = rows(problem, "pairs")
    assert ("left to the certificate" in found) == bool(problem.unresolved)
    for a, b in problem.unresolved:
        assert f"{a}-{b}" in found["left to the certificate"]


def test_size_counts_the_unknowns(planar: Problem) -> None:
    size = rows(planar, "size")
    assert size["unknowns"].startswith(f"{(planar.waypoints - 2) * planar.robot.n}: ")
    assert size["sampled"].startswith(f"{len(planar.samples.weight)} configurations")
    assert size["distance"].startswith(("HD-SDF, compiled C", "HD-SDF, by CasADi’s interpreter"))
    assert rows(build(arm(ignore=True)), "size")["distance"] == "not needed"


@pytest.mark.core
def test_every_setting_is_shown_with_its_origin() -> None:
    scene = arm()
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=12, clearance=0.01))
    found = rows(build(scene), "settings")
    assert list(found) == [field.name for field in dataclasses.fields(PlannerSettings)]
    assert found["waypoints"] == "12 (scene)"
    assert found["clearance"] == "0.01 m (scene)"
    assert found["gamma"] == "2 (default)"


def test_scene_says_which_robot_and_which_ends() -> None:
    problem = build(load_scene("empty"))
    found = rows(problem, "scene")
    assert found["file"].endswith("empty.yaml")
    assert found["robot"] == "panda, 7 joints planned, 2 held"
    assert found["held"] == "panda_finger_joint1 = 0.04, panda_finger_joint2 = 0.04"
    joints = rows(problem, "joints")
    for value, start, goal in zip(joints.values(), problem.start, problem.goal, strict=True):
        first, last = value.split(" limits")[0].split("→")
        assert (float(first), float(last)) == pytest.approx((start, goal), rel=1e-3)


def test_pieces_of_meshes_are_counted_and_noted() -> None:
    problem = build(load_scene("panda_table_pick"))
    pieces = sum(body.name == "hook" for body in problem.halfspace_bodies)
    assert pieces > 1
    assert f"mesh hook.obj in {pieces} convex pieces" in rows(problem, "obstacles")["hook"]
    assert list(rows(problem, "obstacles")) == [obstacle.name for obstacle in problem.scene.obstacles]
    assert [note for _, note in explain(problem)["notes"]] == list(problem.notes)


def test_bodies_are_counted(planar: Problem) -> None:
    links = {body.link for body in planar.bodies}
    assert rows(planar, "scene")["outer bodies"].startswith(f"{len(planar.bodies)} around the {len(links)} links")
