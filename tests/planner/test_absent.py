"""Absent means absent: a scene without an effect's section is what it is in a build without the effect's modules.

One child process plans scenes again and again, each time with a fresh hdplan in which some modules cannot be imported.
A scene that does call for the effect shows that it lives in these modules: there, importing them fails.
"""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from hdplan.planner.build import build
from hdplan.planner.problem.problem import Problem
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import SelfCollision
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene

# Effect -> its modules, and a shipped scene that calls for it.
EFFECTS = {
    "moving obstacles": (
        [
            *("planner.problem.moving_clearance", "planner.problem.velocity_penalty", "scenes.obstacle_motion"),
            "planner.search.space_time",
        ],
        "panda_gate",
    ),
    "times": (["planner.timing.retiming", "planner.certificate.rate_check"], "ur5_pallet"),
    "torques and loads": (
        [
            *("planner.kinematics.inverse_dynamics", "planner.robot.loads", "planner.problem.gravity_torque"),
            *("planner.certificate.torque_check", "planner.certificate.torque_bounds", "planner.timing.torque_limit"),
        ],
        "ur5_payload",
    ),
    "path constraints": (
        ["planner.problem.path_terms", "planner.certificate.path_check", "planner.certificate.path_bounds"],
        "panda_cup",
    ),
    "held objects": (["planner.robot.attached"], "panda_carry"),
    "choice of goals": (["planner.search.goals", "planner.certificate.pose_goals"], "panda_grasp"),
    "self-collision": (["planner.collision.separation_bounds"], "panda_cage"),
}
ALSO = {  # what else these scenes require; a path constraint finds its link as a goal's pose does
    "panda_gate": {"times"},
    "ur5_pallet": {"held objects"},
    "ur5_payload": {"times", "held objects"},
    "panda_cup": {"held objects", "choice of goals"},
}
PLAIN = ("panda_cage", "planar_arm")  # without any effect but obstacles and self-collision
CHILD = Path(__file__).with_name("absent_child.py")


def child(*runs: tuple[list[str], list[str]]) -> list[dict[str, Any]]:
    """Plan scenes, run after run: (modules that cannot be imported, scenes) -> scene -> what came of it."""
    done = subprocess.run([sys.executable, str(CHILD)], input=json.dumps(runs), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def test_scenes_without_an_effect_are_those_of_a_build_without_it() -> None:
    """Terms, pairs, instructions, nodes, and the plan's bytes."""
    alone = [name for name in EFFECTS if name != "self-collision"]
    whole, none, *others, links, unlinked = child(
        ([], list(PLAIN)),
        ([module for name in alone for module in EFFECTS[name][0]], list(PLAIN)),
        *((EFFECTS[name][0], [EFFECTS[name][1]]) for name in alone),
        ([], ["panda_cage without self-collision"]),
        (EFFECTS["self-collision"][0], ["panda_cage without self-collision", "panda_cage"]),
    )
    assert none == whole
    assert all(found["status"] == "certified" for found in whole.values())
    for name, found in zip(alone, others, strict=True):
        (message,) = found.values()
        assert message["status"] == "cannot import", name
    assert unlinked.pop("panda_cage")["status"] == "cannot import"
    assert unlinked == links


def test_a_module_that_does_not_exist_cannot_be_blocked() -> None:
    """Absent anyway, it would make the test say nothing."""
    done = subprocess.run(
        [sys.executable, str(CHILD)], input='[[["planner.no_such"], []]]', capture_output=True, text=True
    )
    assert "no such module: planner.no_such" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in EFFECTS if name != "self-collision"])
def test_each_effect_needs_each_of_its_modules(name: str) -> None:
    modules, scene = EFFECTS[name]
    for module, found in zip(modules, child(*(([each], [scene]) for each in modules)), strict=True):
        assert found[scene]["status"] == "cannot import", module


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in EFFECTS if name != "self-collision"])
def test_each_effect_is_absent_from_scenes_with_other_effects(name: str) -> None:
    scenes = [
        scene
        for other, (_, scene) in EFFECTS.items()
        if other not in (name, "self-collision") and name not in ALSO.get(scene, ())
    ]
    whole, without = child(([], scenes), (EFFECTS[name][0], scenes))
    assert without == whole
    assert all(found["status"] == "certified" for found in whole.values())


# --- in this process --------------------------------------------------------------------------------------------------


def sizes(problem: Problem) -> dict[str, tuple[int, ...]]:
    """Pairs of every term, and instructions and nodes of every function that it compiled."""
    found: dict[str, tuple[int, ...]] = {"kinematics": counts(problem.kinematics.state)}
    for term in problem.terms:
        found[term.name] = (len(term.pairs),) if hasattr(term, "pairs") else ()
        for function in term.functions.values():
            found[term.name] += counts(function)
    return found


def counts(function: Any) -> tuple[int, ...]:
    if function.is_a("MXFunction"):
        function = function.expand()  # into scalar operations
    return function.n_instructions(), function.n_nodes()


def without(scene: Scene, section: str) -> Scene:
    match section:
        case "obstacles[].motion":
            return dataclasses.replace(scene, obstacles=tuple(o for o in scene.obstacles if o.motion is None))
        case "path":
            return dataclasses.replace(scene, path=PathConstraints())
        case "limits.torque":
            return dataclasses.replace(scene, limits=dataclasses.replace(scene.limits, torque=None), payload=None)
        case "attached":
            return dataclasses.replace(scene, attached=())
        case "self_collision":
            return dataclasses.replace(scene, self_collision=SelfCollision(checked=False))
        case _:
            return dataclasses.replace(scene, obstacles=())


@pytest.mark.parametrize(
    ("scene", "section", "terms"),
    [
        ("panda_conveyor", "obstacles[].motion", {"moving obstacles", "velocity"}),
        ("panda_cup", "path", {"path.upright"}),
        ("ur5_scan", "path", {"path.position"}),
        ("panda_heavy", "limits.torque", {"static torque"}),
        ("panda_cage", "self_collision", {"self-collision"}),
        ("panda_cage", "obstacles", {"obstacles"}),
    ],
)
def test_without_its_section_an_effects_terms_are_not_there(scene: str, section: str, terms: set[str]) -> None:
    """The others are as large as before, pairs, instructions and nodes."""
    problem = build(load_scene(scene))
    whole, less = sizes(problem), sizes(build(without(problem.scene, section)))
    assert whole.keys() - less.keys() == terms
    assert less == {name: size for name, size in whole.items() if name not in terms}


def test_a_held_object_is_in_no_pair_of_a_scene_without_it() -> None:
    carry = load_scene("panda_carry")
    whole, less = build(carry), build(without(carry, "attached"))
    assert {body.link for body in whole.bodies} - {body.link for body in less.bodies} == {"bottle"}
    for one, other in zip(whole.terms.pairs, less.terms.pairs, strict=True):
        first, second = (
            {
                (problem.bodies[a].link, bodies[b].link if own else bodies[b].name)
                for a, b in zip(term.pairs.body.tolist(), term.pairs.halfspace_body.tolist(), strict=True)
            }
            for problem, term in ((whole, one), (less, other))
            for own in (term.name == "self-collision",)
            for bodies in (problem.bodies if own else problem.halfspace_bodies,)
        )
        assert second == {pair for pair in first if "bottle" not in pair}


def test_settings_equal_to_their_defaults_change_nothing() -> None:
    """A clearance that is the planner's, ranges that are the robot's: the same problem, to the last byte."""
    scene = load_scene("panda_cage")
    problem = build(scene)
    changed = dataclasses.replace(
        scene,
        obstacles=tuple(
            dataclasses.replace(obstacle, clearance=scene.planner.clearance) for obstacle in scene.obstacles
        ),
        limits=Limits(
            position={
                joint: (float(low), float(high))
                for joint, low, high in zip(
                    problem.robot.joint_names, problem.robot.lower, problem.robot.upper, strict=True
                )
            }
        ),
    )
    again = build(changed)
    for one, other in zip(problem.terms.pairs, again.terms.pairs, strict=True):
        for name in ("body_table", "half_sizes", "boxes", "body", "halfspace_body"):
            assert getattr(one.pairs, name).tobytes() == getattr(other.pairs, name).tobytes()
        for slots, table in one.pairs.plane_tables.items():
            assert table.tobytes() == other.pairs.plane_tables[slots].tobytes()


def test_the_explanation_of_a_scene_shows_no_effect_that_it_lacks() -> None:
    rows = explain(build(load_scene("empty")))
    off = dict(rows["off"])
    for effect in ("moving obstacles", "held objects", "loads", "path.upright", "path.position", "limits of torque"):
        assert off[effect].startswith("needs ")
        assert effect not in {name for title, part in rows.items() if title != "off" for name, _ in part}
    assert [name for name, _ in rows["trial evaluation"]] == [
        *("measured", "kinematics", "smoothness", "self-collision", "all, with derivatives")
    ]
