"""Threads that plan, certify and control at once get, bit for bit, what each gets alone; robots are loaded once."""

from __future__ import annotations

import os
import warnings
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.collision import convex_pieces, link_bodies
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.control.controller import Controller, Step
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.control.simulation import replay
from hdplan.planner.control.tasks import standing
from hdplan.planner.geometry.meshes import TriangleMesh, load_mesh
from hdplan.planner.kinematics.inverse_dynamics import dynamics_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.result import PlanResult
from hdplan.planner.robot import scene_robot
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.roadmap import seeds
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.shapes import Mesh
from hdplan.scenes.yaml_format.reader import load_scene
from tests.threads import THREADS, together

AMPLE = 300.0  # [s] that no plan here needs
CHECKED = ("panda_cage", "panda_carry", "ur5_payload", "panda_conveyor", "panda_cup")


def figures(certificate: Certificate) -> tuple[object, ...]:
    """All that a certificate says, but for how long it took."""
    values = {name: value for name, value in vars(certificate).items() if name != "seconds"}
    return tuple(map(repr, values.values()))


def motions(name: str, count: int = 4) -> list[Trajectory]:
    """Motions from the start of a scene to its goal: straight, and around; in time where the scene asks for it."""
    scene = load_scene(name)
    problem = build(scene)
    found = []
    for guess, _ in zip(seeds(problem, 1), range(count), strict=False):
        trajectory = Trajectory(problem.robot.joint_names, guess, problem.robot.locked)
        if scene.timed or scene.moving:
            from hdplan.planner.timing.retiming import Retimer

            trajectory = Retimer(Setup.of(scene, problem.robot))(trajectory).trajectory
        found.append(trajectory)
    return found


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", CHECKED)
def test_motions_are_certified_as_alone(name: str) -> None:
    """One certifier is shared by all, and each thread has one of its own."""
    scene, given = load_scene(name), motions(name, 2 if name == "panda_conveyor" else 4)
    shared = Certifier(Setup.of(scene))
    alone = [figures(shared.certify(motion)) for motion in given]

    def work(index: int) -> None:
        for k in np.random.default_rng(index).permutation(len(given)):
            assert figures(shared.certify(given[k])) == alone[k]
            assert figures(certify(scene, given[k])) == alone[k]

    together(work, 4)


@pytest.mark.parametrize("name", ["panda_cage", "ur5_payload", "panda_conveyor", "panda_cup"])
def test_one_problem_is_evaluated_as_alone(name: str) -> None:
    problem = build(load_scene(name))
    rng = np.random.default_rng(2)
    guess = next(seeds(problem, 0))
    tried = [problem.clip(guess + rng.normal(0.0, 0.1, guess.shape)) for _ in range(6)]
    alone = [problem.evaluate(positions, 6e3) for positions in tried]

    def work(index: int) -> None:
        for k in np.random.default_rng(index).permutation(len(tried)):
            found = problem.evaluate(tried[k], 6e3)
            for part, expected in zip(vars(found).values(), vars(alone[k]).values(), strict=True):
                np.testing.assert_array_equal(part, expected)

    together(work)


def test_dynamics_and_simulation_are_as_alone() -> None:
    scene = load_scene("ur5_payload")
    robot = load_scene_robot(scene)
    q, v, a = np.random.default_rng(4).normal(size=(3, 300, robot.n))
    alone = dynamics_of(Setup.of(scene, robot)).torques(q, v, a)
    (motion, *_) = motions("ur5_payload", 1)
    replayed = replay(Setup.of(scene, robot), motion).summary()

    def work(index: int) -> None:
        order = np.random.default_rng(index).permutation(len(q))
        np.testing.assert_array_equal(
            dynamics_of(Setup.of(scene, robot)).torques(q[order], v[order], a[order]), alone[order]
        )
        if index < 2:
            assert replay(Setup.of(scene, robot), motion).summary() == replayed

    together(work)


# --- the controller ---------------------------------------------------------------------------------------------------


def assert_same(step: Step, other: Step) -> None:
    assert (step.mode, step.slack, step.closest, step.proven) == (other.mode, other.slack, other.closest, other.proven)
    np.testing.assert_array_equal(step.velocity, other.velocity)
    for part, expected in zip(vars(step.rows).values(), vars(other.rows).values(), strict=True):
        np.testing.assert_array_equal(part, expected)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("distance", ["hdsdf", "euclidean", "hdsdf-boxes", "gdf"])
def test_steps_are_as_alone(distance: str) -> None:
    """One controller is shared by all, and each thread has one of its own."""
    scene = load_scene("panda_corridor")  # of boxes, which all distances know
    robot = load_scene_robot(scene)
    normals = "paper" if distance == "hdsdf-boxes" else "box"
    settings = ControlSettings(BarrierSettings(distance, normals=normals), as_published=True)
    shared = Controller.of(scene, settings, robot)
    start, task = Setup.of(scene, robot).query.start, standing(Setup.of(scene, robot).query.goal)
    count = 2 if distance == "gdf" else 8
    places = np.clip(start + np.random.default_rng(6).normal(0.0, 0.1, (count, robot.n)), robot.lower, robot.upper)
    alone = [shared.step(q, task) for q in places]

    def work(index: int) -> None:
        for controller in (shared, Controller.of(scene, settings, robot)):
            for k in np.random.default_rng(index).permutation(count):
                assert_same(controller.step(places[k], task), alone[k])

    together(work)


# --- whole plans ------------------------------------------------------------------------------------------------------


def assert_same_plan(found: PlanResult, alone: PlanResult) -> None:
    np.testing.assert_array_equal(found.trajectory.positions, alone.trajectory.positions)
    assert (found.attempts, found.iterations) == (alone.attempts, alone.iterations)
    assert figures(found.certificate) == figures(alone.certificate)


def plan_together(names: tuple[str, ...], times: int) -> None:
    """Each thread plans a scene that it has read itself."""
    alone = {name: plan(load_scene(name), time_limit=AMPLE) for name in names}

    def work(index: int) -> None:
        name = names[index % len(names)]
        for _ in range(times):
            assert_same_plan(plan(load_scene(name), time_limit=AMPLE), alone[name])

    together(work, max(len(names), 4))


def test_plans_are_as_alone() -> None:
    plan_together(("panda_cage", "panda_bookshelf", "planar_arm", "panda_cage"), 1)


@pytest.mark.slow
def test_many_plans_are_as_alone() -> None:
    plan_together(("panda_cage", "panda_bookshelf", "panda_carry", "ur5_payload", "panda_conveyor", "panda_grasp"), 5)
    plan_together(("panda_cup", "ur5_ceiling", "ur5_pallet", "panda_heavy", "kinova_shelf", "xarm7_post"), 3)


# --- loading ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """No robot is loaded yet, as in a fresh process."""
    monkeypatch.setattr(scene_robot, "_kept", OrderedDict())


@pytest.mark.usefixtures("nothing_kept")
def test_a_robot_is_loaded_once_and_the_error_stream_stays() -> None:
    error_stream, filters = os.fstat(2), list(warnings.filters)
    names = ("panda_cage", "panda_carry", "ur5_table", "panda_cable")

    def work(index: int) -> Robot:
        return load_scene_robot(load_scene(names[index % len(names)]))

    found = together(work)
    assert len(set(map(id, found))) == len(names)
    assert all(found[index] is found[index + len(names)] for index in range(THREADS - len(names)))
    assert os.path.samestat(os.fstat(2), error_stream)
    assert warnings.filters == filters


def test_meshes_are_cut_as_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two of them, neither of which is on disk yet; coacd draws at random."""

    def bent(height: float) -> TriangleMesh:
        """The union of two boxes, as a letter L."""
        import trimesh

        collision_model = [[0, 0], [0.4, 0], [0.4, 0.1], [0.1, 0.1], [0.1, 0.3], [0, 0.3]]
        corners, triangles = np.array(collision_model), [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
        mesh = trimesh.creation.extrude_triangulation(corners, triangles, height)
        return TriangleMesh.merged(mesh.vertices, mesh.faces)

    meshes = [bent(0.1), bent(0.2)]
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "alone"))
    alone = [convex_pieces.convex_pieces(mesh) for mesh in meshes]
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "together"))
    for index, pieces in enumerate(together(lambda index: convex_pieces.convex_pieces(meshes[index % 2]), 4)):
        assert len(pieces) == len(alone[index % 2]) > 1
        for piece, expected in zip(pieces, alone[index % 2], strict=True):
            np.testing.assert_array_equal(piece, expected)


def test_meshes_are_read_as_alone_and_warnings_stay(tmp_path: Path) -> None:
    import trimesh

    file = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=3).export(file)
    alone, filters = load_mesh(Mesh(file), "test"), list(warnings.filters)
    for mesh in together(lambda _: load_mesh(Mesh(file), "test")):
        np.testing.assert_array_equal(mesh.vertices, alone.vertices)
        np.testing.assert_array_equal(mesh.triangles, alone.triangles)
    assert warnings.filters == filters


@pytest.mark.slow
def test_bodies_are_fitted_as_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robots = [load_robot(RobotSpec(name=name)) for name in ("panda_collision", "quadruped")]
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "alone"))
    alone = [link_bodies.link_bodies(robot) for robot in robots]
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "together"))
    for index, bodies in enumerate(together(lambda index: link_bodies.link_bodies(robots[index % 2]), 4)):
        for body, expected in zip(bodies, alone[index % 2], strict=True):
            assert (body.link, body.joint, body.body.radius) == (expected.link, expected.joint, expected.body.radius)
            np.testing.assert_array_equal(body.body.vertices, expected.body.vertices)
