"""Attempts to break the proofs that pairs keep apart: random, extreme and searched configurations all keep the bound.

The witnesses are coal's distances and Pinocchio's poses, neither of which the bound is made of but for its normals.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

from hdplan.distance.baselines.coal import coal_hull, signed_distance
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.loops import C
from hdplan.planner.build import build
from hdplan.planner.collision import separation_bounds
from hdplan.planner.collision.broad_phase import body_pairs
from hdplan.planner.collision.collision_model import CollisionModel, collision_model_of
from hdplan.planner.collision.euclidean import FclPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_shape
from hdplan.planner.plan import plan
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import SelfCollision
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.yaml_format.reader import load_scene
from tests.loops import in_numpy, needs_loops

from ..urdf import joint_text, link_text, write_robot

ROBOTS = ("ur5", "kinova", "two arms", "gantry")
MORE = ("panda", "ur3_gripper", "ur5_gripper", "ur10", "xarm7", "z1", "panda_carry")
MANY, SOME = 100_000, 4_000
EXACT = 1e-6  # [m] of coal's distances


def arm(side: str, y: float, low: float, high: float, axis: str, kind: str = "revolute") -> tuple[str, ...]:
    upper, lower = f"{side}_upper", f"{side}_lower"
    return (
        link_text(upper, box="0.3 0.05 0.05", at="0.15 0 0"),
        link_text(lower, box="0.2 0.04 0.04", at="0.1 0 0"),
        joint_text(f"{side}_a", "base", upper, at=f"0 {y} 0.2", limits=(-0.9, 0.9)),
        joint_text(f"{side}_b", upper, lower, axis, kind=kind, at="0.35 0 0", limits=(low, high)),
    )


@cache
def robot(name: str, folder: Path | None = None) -> Robot:
    if name == "panda_carry":
        return load_scene_robot(load_scene(name))
    if folder is None:
        return load_robot(RobotSpec(name=name))
    how = (0.0, 0.2, "0.6 0 0.8", "prismatic") if name == "gantry" else (-0.5, 1.0, "0 0.6 0.8", "revolute")
    return two_arms(folder / f"{name.replace(' ', '_')}.urdf", arm("left", 0.6, *how), arm("right", -0.6, *how))


def two_arms(file: Path, *arms: tuple[str, ...]) -> Robot:
    return load_robot(RobotSpec(urdf=write_robot(file, link_text("base", box="0.2 0.6 0.2"), *arms[0], *arms[1])))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("robots")


def named(name: str, folder: Path) -> Robot:
    return robot(name, folder if name in ("two arms", "gantry") else None)


class Witness:
    """Exact distances of a robot's outer bodies, by coal, at poses by Pinocchio."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, collision_model_of(robot, "fitted", "box")
        self.hulls = [coal_hull(body.body) for body in self.model.bodies]
        self.data = robot.model.createData()

    def at(self, q: Array, pair: int) -> float:
        pin.forwardKinematics(self.robot.model, self.data, self.robot.pin_q(q))
        a, b = self.model.self_pairs[pair]
        return self.between(a, b, *(self.data.oMi[self.model.bodies[index].joint] for index in (a, b)))

    def between(self, a: int, b: int, place_a: pin.SE3, place_b: pin.SE3) -> float:
        placed = [coal.Transform3s(place.rotation, place.translation) for place in (place_a, place_b)]
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        found = coal.distance(self.hulls[a], placed[0], self.hulls[b], placed[1], request, result)
        return float(found) - self.model.bodies[a].body.radius - self.model.bodies[b].body.radius


def proven(model: CollisionModel) -> list[tuple[int, float]]:
    return [(pair, kept) for pair, kept in enumerate(model.distances_kept) if kept > 0.0]


def assert_kept(robot: Robot, count: int, seed: int) -> int:
    """No configuration has a pair below its bound: all at once by balls around the bodies, the near ones exactly."""
    witness, rng = Witness(robot), np.random.default_rng(seed)
    model, kinematics = witness.model, witness.model.kinematics
    looked = 0
    for q in np.array_split(robot.draw(rng, count), max(count // 5_000, 1)):
        batch = kinematics.evaluate(q)
        for pair, kept in proven(model):
            centres, radii = [], []
            for body in (model.bodies[index] for index in model.self_pairs[pair]):
                middle = body.body.vertices.mean(axis=0)
                centres.append(batch.rotations[:, body.joint] @ middle + batch.translations[:, body.joint])
                radii.append(np.linalg.norm(body.body.vertices - middle, axis=1).max() + body.body.radius)
            near = np.linalg.norm(centres[0] - centres[1], axis=1) - sum(radii) < kept
            for row in np.flatnonzero(near):
                looked += 1
                assert witness.at(q[row], pair) >= kept - EXACT
    return looked


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ROBOTS)
def test_random_configurations_keep_the_bound(name: str, folder: Path) -> None:
    arm = named(name, folder)
    assert proven(collision_model_of(arm, "fitted", "box"))
    assert assert_kept(arm, SOME, 1) > 100


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ROBOTS, *MORE])
def test_a_hundred_thousand_configurations_keep_the_bound(name: str, folder: Path) -> None:
    assert_kept(named(name, folder), MANY, 2)


def assert_searched(arm: Robot, starts: int) -> None:
    witness, rng = Witness(arm), np.random.default_rng(3)
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    for pair, kept in proven(witness.model):
        corners = np.where(rng.random((20, arm.n)) < 0.5, low, high)
        found = [witness.at(q, pair) for q in corners]
        for start in rng.uniform(low, high, size=(starts, arm.n)):
            bounds = list(zip(low, high, strict=True))
            end = minimize(witness.at, start, (pair,), "Powell", bounds=bounds, options={"maxfev": 600})
            found.append(witness.at(np.clip(end.x, low, high), pair))
        assert min(found) >= kept - EXACT


@pytest.mark.parametrize("name", ["kinova", "two arms", "gantry"])
def test_no_search_gets_below_the_bound(name: str, folder: Path) -> None:
    assert_searched(named(name, folder), 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ROBOTS, *MORE])
def test_no_long_search_gets_below_the_bound(name: str, folder: Path) -> None:
    assert_searched(named(name, folder), 12)


def by_loop(model: CollisionModel, moves: Array, pair: int, low: Array, high: Array) -> float:
    """The bound of the loop in C over one box."""
    a, b = (model.bodies[index] for index in model.self_pairs[pair])
    hulls = a.joint, a.body.vertices, b.joint, b.body.vertices
    tree, radii = model.kinematics.tree, a.body.radius + b.body.radius
    return C.separation(tree.struct, *hulls, radii, moves, low, high, -np.inf, 0.9, 1)[0]


@needs_loops
@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", range(40))
def test_the_loop_finds_the_distance_of_bodies_that_stand(seed: int) -> None:
    """Polytopes, needles and plates, near, far and one in the other: exact where apart, never positive where not."""
    arm, rng = robot("ur5"), np.random.default_rng(seed)
    model = collision_model_of(arm, "fitted", "box")
    for _ in range(25):
        flat = [np.where(rng.random(3) < 0.2, 0.0, 1.0) for _ in range(2)]
        a, b = (rng.normal(size=(int(rng.integers(1, 13)), 3)) * flat[k] * 10.0 ** rng.uniform(-3, 0) for k in (0, 1))
        b = b + rng.normal(size=3) * 10.0 ** rng.uniform(-4, 1)
        still = (np.zeros(arm.n),) * 3
        found, _ = C.separation(model.kinematics.tree.struct, 0, a, 0, b, 0.0, *still, 0.0, 0.9, 1)
        one, other = ConvexBody.from_points(a), ConvexBody.from_points(b)
        exact = signed_distance(one, np.eye(4), other, np.eye(4)).distance
        assert found <= max(exact, 0.0) + EXACT
        if exact > 1e-5:
            assert found >= exact - EXACT


@needs_loops
@pytest.mark.parametrize("name", ["panda", "ur5", "kinova", "two arms", "gantry"])
def test_a_box_keeps_its_stated_bounds(name: str, folder: Path) -> None:
    """The inequality of the module's head, at random places and corners of random boxes, of any pair at all."""
    arm, rng = named(name, folder), np.random.default_rng(4)
    witness = Witness(arm)
    model = witness.model
    assembled = body_pairs(model.bodies, model.planes, model.self_pairs, 0.0, model.kinematics.supports)
    distance = FclPairs(assembled, model.bodies, model.planes)
    search = separation_bounds.Search(arm, model.kinematics, model.bodies, model.self_pairs, distance)
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    tight = 0
    for _ in range(60):
        pair = int(rng.integers(len(model.self_pairs)))
        between = assembled.moves[pair] != 0
        half = np.where(between, (high - low) / 2 * rng.uniform(0, 1, arm.n) * 10.0 ** rng.uniform(-3, 0), 0.0)
        centre = rng.uniform(low + half, high - half)
        (exact,), (bound,), _ = search._look(pair, centre[None], half[None])
        looped = by_loop(model, assembled.moves[pair], pair, centre - half, centre + half)
        assert max(bound, looped) <= exact + EXACT
        inside = centre + half * np.vstack([rng.uniform(-1, 1, (20, arm.n)), rng.choice([-1.0, 1.0], (20, arm.n))])
        found = min(witness.at(q, pair) for q in inside)
        tight += min(bound, looped) > found - 0.01
        if found > 0.0:  # coal's depths are its own
            assert max(bound, looped) <= found + EXACT
    assert tight > 5


def test_a_wider_margin_brings_pairs_back_and_narrower_limits_take_more_out() -> None:
    scene = load_scene("ur5_table")

    def kept(scene: Scene) -> tuple[int, int]:
        problem = build(scene)
        own = [term for term in (problem.terms.self_collision,) if term]
        return sum(len(term.pairs) for term in own), len(problem.apart)

    pairs, apart = kept(scene)
    assert apart > 0
    wide = dataclasses.replace(scene, self_collision=SelfCollision(clearance=0.3))
    assert kept(wide) == (pairs + apart, 0)
    narrow = dataclasses.replace(scene, limits=Limits(position={"elbow_joint": (0.2, 2.5), "wrist_2_joint": (-2, -1)}))
    fewer, more = kept(narrow)
    assert (fewer + more, more > apart) == (pairs + apart, True)
    assert_kept(load_scene_robot(narrow), 1_000, 5)
    result = plan(narrow)
    assert result.certificate.certified
    assert plan(narrow).trajectory.positions.tobytes() == result.trajectory.positions.tobytes()


def test_bounds_are_kept_on_disk_by_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = robot("ur5")
    model = collision_model_of(arm, "fitted", "box")
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path))
    given = (model.kinematics, model.bodies, model.planes, model.self_pairs[:6])
    first = separation_bounds.distances_kept(arm, *given, 0.005)
    monkeypatch.setattr(separation_bounds, "FclPairs", None)  # nothing is computed any more
    np.testing.assert_array_equal(separation_bounds.distances_kept(arm, *given, 0.005), first)
    other = dataclasses.replace(arm, upper=arm.upper - 0.1)
    with pytest.raises(TypeError):
        separation_bounds.distances_kept(other, *given, 0.005)


def test_arms_that_turn_about_other_axes_have_other_entries(tmp_path: Path) -> None:
    """An axis may be none of x, y, z, which Pinocchio does not write into a joint's name."""
    arms = []
    for number, axis in enumerate(("0 0.6 0.8", "0 0.8 0.6")):
        sides = (arm(side, y, -1, 1, axis) for side, y in (("l", 1), ("r", -1)))
        arms.append(two_arms(tmp_path / f"{number}.urdf", *sides))
    one, other = (separation_bounds.content_of(arm, (), ()) for arm in arms)
    assert one != other


@pytest.mark.parametrize("way", [pytest.param("compiled", marks=needs_loops), "interpreted"])
def test_all_pairs_together_stay_within_the_budget(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot with both hands has thousands of pairs: each has its share, and what is proven with less still holds."""
    arm, looked = robot("kinova"), list[int]()
    bound, model = separation_bounds.Search.bound, collision_model_of(arm, "fitted", "box")

    def counted(self: separation_bounds.Search, pair: int, wanted: float, most: int) -> tuple[float, int]:
        found = bound(self, pair, wanted, most)
        looked.append(found[1])
        return found

    monkeypatch.setattr(separation_bounds.Search, "bound", counted)
    if way == "interpreted":
        in_numpy(monkeypatch, separation_bounds)
    monkeypatch.setattr(separation_bounds, "known_result", lambda kind, key, read: None)
    monkeypatch.setattr(separation_bounds, "store", lambda kind, key, value: None)
    given = arm, model.kinematics, model.bodies, model.planes, model.self_pairs, 0.005
    everything = separation_bounds.distances_kept(*given)
    if way == "compiled":
        np.testing.assert_array_equal(everything, model.distances_kept)
    for budget in (0, 300, 3_000):
        looked.clear()
        monkeypatch.setattr(separation_bounds, "BUDGET", budget)
        kept = separation_bounds.distances_kept(*given)
        assert sum(looked) <= budget + 2 * separation_bounds.BATCH * len(kept)
        assert (kept > 0.0).sum() <= (everything > 0.0).sum()
        assert (kept <= everything / separation_bounds.TIGHT_SHARE + EXACT).all()  # the least distance met is no less


# --- obstacles out of reach -------------------------------------------------------------------------------------------


def assert_out_of_reach(arm: Robot, count: int, seed: int) -> int:
    """Obstacles that a body's reach rules out stay outside their margin: by the ball around the body, or exactly."""
    rng, model, margin = np.random.default_rng(seed), collision_model_of(arm, "fitted", "box"), 0.025
    centre = np.mean([reach.centre for reach in model.reach], axis=0)
    size = max(reach.radius for reach in model.reach)
    planes: list[HalfspaceBody] = []
    for number in range(40):
        placement = np.eye(4)
        placement[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        placement[:3, 3] = centre + rng.normal(size=3) * size
        planes.append(from_shape(str(number), Box(tuple(rng.uniform(0.05, 0.5, 3))), placement))
    boxes, halves = np.array([body.box for body in planes]), np.array([body.half_size for body in planes])
    out = 0
    for q in np.array_split(arm.draw(rng, count), max(count // 5_000, 1)):
        batch = model.kinematics.evaluate(q)
        for body, reach in zip(model.bodies, model.reach, strict=True):
            ruled_out = np.flatnonzero(~reach.meets(boxes, halves + margin)) if body.joint else []
            out += len(ruled_out)
            vertices = np.einsum("kij,vj->kvi", batch.rotations[:, body.joint], body.body.vertices)
            vertices += batch.translations[:, body.joint, None]
            middle = vertices.mean(axis=1)
            ball = np.linalg.norm(vertices - middle[:, None], axis=2).max() + body.body.radius
            for b in ruled_out:
                off = np.maximum(np.abs((middle - boxes[b, :3, 3]) @ boxes[b, :3, :3]) - halves[b], 0.0)
                for row in np.flatnonzero(np.linalg.norm(off, axis=1) - ball <= margin):
                    pose = np.eye(4)
                    pose[:3, :3] = batch.rotations[row, body.joint]
                    pose[:3, 3] = batch.translations[row, body.joint]
                    other = ConvexBody.box(2 * halves[b])
                    assert signed_distance(body.body, pose, other, boxes[b]).distance > margin
    return out


@pytest.mark.parametrize("name", ["ur5", "gantry"])
def test_no_obstacle_out_of_reach_comes_near(name: str, folder: Path) -> None:
    assert assert_out_of_reach(named(name, folder), SOME, 6) > 10


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ROBOTS, *MORE])
def test_no_obstacle_out_of_reach_comes_near_in_a_hundred_thousand(name: str, folder: Path) -> None:
    assert assert_out_of_reach(named(name, folder), MANY, 7) > 10
