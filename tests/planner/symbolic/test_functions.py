"""Kinematics, dynamics and clearance in CasADi are Pinocchio's and the planner's own numbers, with two derivatives."""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import hdplan
from hdplan import symbolic
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.clearance import PairTerm
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.second_order import by_joints
from hdplan.planner.robot.loads import carrying
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.robot_files.library import robot_names
from tests.threads import together

from ..linkage import linkage_urdf

SHIPPED = Path(__file__).resolve().parents[3] / "scenes" / "shipped"
EXACT = 1e-10  # [m], [Nm], [kg m²] agreement with Pinocchio
CLOSE = 1e-9  # relative, of derivatives
SCENES = ("planar_arm", "panda_carry", "panda_vase", "panda_conveyor", "ur5_ceiling")
PLANNED = ("panda", "simple_humanoid", "double_pendulum_continuous")
INERTIA = (
    '<inertial><origin xyz="0.1 -0.02 0.05" rpy="0.3 0 1"/><mass value="1.5"/>'
    '<inertia ixx="0.03" ixy="0.001" ixz="-0.002" iyy="0.04" iyz="0.003" izz="0.05"/></inertial>'
)


def full(value: Any) -> Array:
    return np.array(value, dtype=float)


def links_of(robot: Robot) -> list[str]:
    return [str(frame.name) for frame in robot.model.frames if frame.type == pin.FrameType.BODY]


def agrees(robot: Robot, source: Robot | hdplan.Scene, payload: hdplan.Payload | None, seed: int = 0) -> None:
    """Pose of some links, torques and mass matrix are those of Pinocchio's model with the loads."""
    rng = np.random.default_rng(seed)
    links, q = links_of(robot), robot.draw(rng, 4)
    chosen = [*rng.choice(links, min(4, len(links)), replace=False).tolist(), *(held.name for held in robot.attached)]
    data = robot.model.createData()
    for link in chosen:
        pose = symbolic.kinematics(source, link)
        held = next((each for each in robot.attached if each.name == link), None)
        frame = robot.model.getFrameId(link if held is None else held.link, pin.FrameType.BODY)
        for each in q:
            pin.framesForwardKinematics(robot.model, data, robot.pin_q(each))
            expected = data.oMf[frame].homogeneous @ (np.eye(4) if held is None else held.pose.matrix)
            np.testing.assert_allclose(full(pose(each)), expected, rtol=0, atol=EXACT)
    model = carrying(robot, payload, robot.attached, "this")
    data, spread = model.createData(), np.eye(robot.n) if robot.linkage is None else robot.linkage.matrix
    function = symbolic.dynamics(source)
    for each in q:
        v, a = rng.normal(0, 2, robot.n), rng.normal(0, 8, robot.n)
        tau, mass = map(full, function(each, v, a))
        expected = spread.T @ pin.rnea(model, data, robot.pin_q(each), spread @ v, spread @ a)
        upper = np.triu(pin.crba(model, data, robot.pin_q(each)))
        np.testing.assert_allclose(tau[:, 0], expected, rtol=0, atol=EXACT)
        np.testing.assert_allclose(mass, spread.T @ (upper + np.triu(upper, 1).T) @ spread, rtol=0, atol=EXACT)


@pytest.mark.parametrize("name", ["panda_heavy", "ur5_payload", "panda_carry", "ur5_ceiling"])
def test_a_scenes_robot_moves_and_weighs_as_pinocchios_with_what_it_holds(name: str) -> None:
    scene = hdplan.load_scene(name)
    agrees(Setup.of(scene).robot, scene, scene.payload)


@pytest.mark.parametrize("name", PLANNED)
def test_a_robot_by_name_agrees_with_pinocchio(name: str) -> None:
    robot = hdplan.load_robot(name)
    agrees(robot, robot, None)


@pytest.mark.slow
def test_every_robot_agrees_with_pinocchio() -> None:
    for name in robot_names():
        try:
            robot = hdplan.load_robot(name)
            symbolic.dynamics(robot)
        except hdplan.InputError:  # nothing to plan, or no masses
            continue
        agrees(robot, robot, None)


def test_joints_that_follow_others_move_along_and_their_forces_add_up(tmp_path: Path) -> None:
    file = linkage_urdf(tmp_path)
    text = file.read_text()
    for link in ("shoulder", "upper", "barrel", "stem", "fore", "bar", "sled", "wrist", "hand"):
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{INERTIA}')
    file.write_text(text)
    hanging = hdplan.Pose((0.3, 0.2, 2.0), (0.0, 1.0, 0.0, 0.0))
    robot = hdplan.load_robot(hdplan.RobotSpec(urdf=file, base=hanging))
    assert robot.followers
    agrees(robot, robot, None)
    function, (q, v) = symbolic.dynamics(robot), np.random.default_rng(1).uniform(-0.5, 0.5, (2, robot.n))
    power, energy = full(function(q, v, 0 * v)[0])[:, 0] @ v, lambda t: 0.5 * v @ full(function(q + t * v, v, v)[1]) @ v
    still = full(function(q, 0 * v, 0 * v)[0])[:, 0] @ v  # against gravity
    assert power - still == pytest.approx((energy(1e-5) - energy(-1e-5)) / 2e-5, abs=1e-7)  # work is energy


# --- clearance --------------------------------------------------------------------------------------------------------


def by_the_planner(problem: Problem, q: Array) -> tuple[Array, Array, Array]:
    """D (B, P) of the planner's own pairs, its gradient (B, P, n) and Hessian (B, P, n, n)."""
    robot, found = problem.robot, []
    kinematics = problem.kinematics.evaluate(robot.expand(q))
    terms = (problem.terms.obstacles, problem.terms.moving_obstacles, problem.terms.self_collision)
    for term in (term for term in terms if isinstance(term, PairTerm)):
        met: KinematicsBatch = term.met(kinematics, np.zeros(len(q)))
        count, settings = len(term.pairs), term.distance
        assert isinstance(settings, HdsdfPairs)
        sample, pair = np.divmod(np.arange(len(q) * count), count)
        value, wrench, hessian = settings.with_hessian(met, sample, pair)
        columns, moves = met.columns[sample], term.pairs.moves[pair]
        gradient = robot.fold((columns @ wrench[:, :, None])[:, :, 0] * moves)
        curved = by_joints(columns, moves, wrench, hessian)
        curved = curved if robot.linkage is None else robot.linkage.fold_blocks(curved)
        parts = value, gradient, curved
        found.append([part.reshape(len(q), count, *part.shape[1:]) for part in parts])
    first, second, third = (np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))
    return first, second, third


def derivatives(found: symbolic.SceneClearance, weights: Array, poses: Array) -> ca.Function:
    """D, dD/dq and the Hessian of a weighted sum of D."""
    q = ca.MX.sym("q", found.function.size1_in("q"))
    distance = found.function(q, poses)
    return ca.Function("all", [q], [distance, ca.jacobian(distance, q), ca.hessian(ca.dot(weights, distance), q)[0]])


@pytest.mark.core
@pytest.mark.parametrize("name", SCENES)
def test_the_distances_are_the_planners_with_both_derivatives(name: str) -> None:
    scene = hdplan.load_scene(name)
    problem, found, rng = hdplan.build(scene), symbolic.clearance(scene, activated=True), np.random.default_rng(0)
    weights, q = rng.normal(size=len(found.pairs)), np.vstack([problem.robot.draw(rng, 3), problem.start])
    function = derivatives(found, weights, found.poses)
    for each, value, gradient, hessian in zip(q, *by_the_planner(problem, q), strict=True):
        ours = [full(part) for part in function(each)]
        np.testing.assert_allclose(ours[0][:, 0], value, rtol=CLOSE, atol=1e-12)
        np.testing.assert_allclose(ours[1], gradient, rtol=CLOSE, atol=CLOSE * np.abs(gradient).max())
        expected = np.tensordot(weights, hessian, 1)
        np.testing.assert_allclose(ours[2], expected, rtol=0, atol=CLOSE * np.abs(hessian).max() * len(weights))


@pytest.fixture(scope="module")
def made() -> hdplan.Scene:
    """A scene made in Python: a robot that hangs and holds a rod, a box, and a mesh that is not convex."""
    hook = hdplan.Mesh(SHIPPED / "hook.obj", name="hook", pose=hdplan.Pose((-0.4, 0.2, 0.6), (0.6, 0, 0.8, 0)))
    return hdplan.Scene(
        robot=hdplan.RobotSpec(name="ur5", base=hdplan.Pose((0, 0, 1.2), (0.0, 1.0, 0.0, 0.0))),
        obstacles=[
            hdplan.Box([0.2, 0.3, 0.1], name="box", pose=[0.4, 0.1, 0.7]),
            hook,
            hdplan.Sphere(0.1, name="far", pose=[8.0, 0.0, 0.0]),
        ],
        attached=[hdplan.Attached("rod", "wrist_3_link", hdplan.Capsule(0.02, 0.3), [0, 0, 0.2], mass=0.8)],
        start=[0.0, -1.0, 1.0, 0.0, 0.0, 0.0],
        goal=[0.5, -1.0, 1.0, 0.0, 0.0, 0.0],
    )


def posed(rng: np.random.Generator) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-0.6, 0.6, 3)
    return pose


def as_pose(matrix: Array) -> hdplan.Pose:
    return hdplan.Pose(matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_quat())


def test_an_obstacle_that_is_moved_is_as_if_the_scene_had_it_there(made: hdplan.Scene) -> None:
    rng, found = np.random.default_rng(0), symbolic.clearance(made, movable=["hook", "far"])
    assert found.movable == ("hook", "far")
    for _ in range(4):
        hook, far, q = posed(rng), posed(rng), rng.uniform(-1.5, 1.5, 6)
        there = {"hook": hook, "far": far}
        obstacles = [
            dataclasses.replace(each, pose=as_pose(there[each.name])) if each.name in there else each
            for each in made.obstacles
        ]
        still = symbolic.clearance(made.with_obstacles(obstacles))
        ours, theirs = full(found.function(q, np.hstack([hook, far])))[:, 0], full(still.function(q, []))[:, 0]
        for pair in set(still.pairs):  # less the pieces that the link cannot reach there
            one, other = (
                values[[each == pair for each in pairs]]
                for values, pairs in ((ours, found.pairs), (theirs, still.pairs))
            )
            assert np.abs(one[:, None] - other).min(axis=0).max() < 1e-9, pair
        assert len(ours) > len(theirs)


def test_derivatives_by_an_obstacles_pose_are_those_by_finite_steps(made: hdplan.Scene) -> None:
    found, rng = symbolic.clearance(made, movable=["box"]), np.random.default_rng(2)
    q, twist, weights = rng.uniform(-1, 1, 6), ca.MX.sym("twist", 6), rng.normal(size=len(found.pairs))
    turn = ca.skew(twist[3:])
    small = ca.MX.eye(3) + turn + turn @ turn / 2  # to second order, where derivatives are taken
    motion = ca.vertcat(ca.horzcat(small, twist[:3]), ca.MX(ca.DM([[0, 0, 0, 1]])))
    distance = ca.dot(weights, found.function(q, motion @ found.poses))
    slope, curve = ca.gradient(distance, twist), ca.hessian(distance, twist)[0]
    function = ca.Function("f", [twist], [slope, curve])

    def at(step: Array) -> float:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix()
        pose[:3, 3] = step[:3]
        return float(weights @ full(found.function(q, pose @ found.poses))[:, 0])

    gradient, hessian = map(full, function(np.zeros(6)))
    for way in rng.normal(size=(4, 6)):
        ahead, here, back = at(1e-4 * way), at(0 * way), at(-1e-4 * way)
        turned = np.concatenate([np.zeros(3), way[3:]])
        assert gradient[:, 0] @ way == pytest.approx((ahead - back) / 2e-4, rel=1e-5, abs=1e-5)
        assert way @ hessian @ way == pytest.approx((ahead - 2 * here + back) / 1e-8, rel=1e-3, abs=1e-3), turned


def test_a_pair_at_an_aligned_pose_has_the_right_derivatives() -> None:
    """CasADi's own derivatives would be those of one branch where vertices tie."""
    scene = hdplan.load_scene("planar_arm")
    found, q = symbolic.clearance(scene), np.zeros(2)
    function = derivatives(found, np.ones(len(found.pairs)), found.poses)
    _, jacobian, hessian = map(full, function(q))
    for k, step in enumerate(1e-6 * np.eye(2)):
        ahead, back = (function(q + sign * step) for sign in (1, -1))
        np.testing.assert_allclose(jacobian[:, k], full(ahead[0] - back[0])[:, 0] / 2e-6, rtol=1e-6, atol=1e-7)
        change = (full(ahead[1]) - full(back[1])).sum(axis=0) / 2e-6
        np.testing.assert_allclose(hessian[k], change, rtol=1e-5, atol=1e-5)


def test_a_third_derivative_is_refused() -> None:
    found, q = symbolic.clearance(hdplan.load_scene("planar_arm")), ca.MX.sym("q", 2)
    curve = ca.hessian(ca.sum1(found.function(q, found.poses)), q)[0]
    with pytest.raises(RuntimeError):
        ca.Function("third", [q], [ca.jacobian(curve, q)])


def test_not_a_number_gives_not_a_number() -> None:
    found = symbolic.clearance(hdplan.load_scene("planar_arm"))
    for q in ([np.nan, 0.0], [0.0, np.inf]):
        distance = full(found.function(q, found.poses))[:, 0]
        assert np.isnan(distance[[link == "forearm" for link, _ in found.pairs]]).all()


def test_poses_that_are_not_rigid_give_no_number(made: hdplan.Scene) -> None:
    found = symbolic.clearance(made, movable=["box"])
    for wrong in (2 * np.eye(4), np.zeros((4, 4)), np.diag([1.0, 1, -1, 1]), found.poses.T):
        assert np.isnan(full(found.function(made.start.positions, wrong))).all()
    assert np.isnan(full(found.function(q=made.start.positions)["distance"])).all()  # the poses were forgotten


def nodes(function: ca.Function) -> Iterator[ca.Function]:
    yield function
    yield from function.find_functions()


def test_there_is_no_callback_and_all_can_be_saved(made: hdplan.Scene, tmp_path: Path) -> None:
    found = symbolic.clearance(made, movable=["hook"])
    q = np.linspace(-1, 1, 6)
    for function, given in (
        (found.function, (q, found.poses)),
        (symbolic.kinematics(made), (q,)),
        (symbolic.dynamics(made), (q, q, q)),
    ):
        assert {each.class_name() for each in nodes(function)} <= {"MXFunction", "SXFunction", "Map", "Switch"}
        expected = [full(each).tobytes() for each in function.call(list(map(ca.DM, given)))]
        function.save(str(tmp_path / "function.casadi"))
        for again in (ca.Function.load(str(tmp_path / "function.casadi")), pickle.loads(pickle.dumps(function))):
            assert [full(each).tobytes() for each in again.call(list(map(ca.DM, given)))] == expected
            assert again.name_in() == function.name_in()
            assert again.name_out() == function.name_out()
    again = pickle.loads(pickle.dumps(found))
    values = ca.MX.sym("q", 6)
    ours, theirs = (
        ca.Function("h", [values], [ca.hessian(ca.sum1(each.function(values, each.poses)), values)[0]])(q)
        for each in (found, again)
    )
    assert full(ours).tobytes() == full(theirs).tobytes()
    assert (again.pairs, again.movable, again.unresolved) == (found.pairs, found.movable, found.unresolved)


def test_only_the_output_that_is_used_is_computed() -> None:
    dynamics = symbolic.dynamics(hdplan.load_robot("panda"))
    q, v, a = (ca.MX.sym(name, 7) for name in "qva")
    torque = ca.Function("torque", [q, v, a], [dynamics(q=q, v=v, a=a)["tau"]])
    assert "mass_matrix" not in {each.name() for each in nodes(torque)}


def test_threads_that_ask_together_get_the_same_numbers(made: hdplan.Scene) -> None:
    q = np.linspace(-1, 1, 6)

    def work(_: int) -> list[bytes]:
        found, pose, tau = symbolic.clearance(made), symbolic.kinematics(made), symbolic.dynamics(made)
        return [full(each).tobytes() for each in (found.function(q, []), pose(q), *tau(q, q, q))]

    first, *others = together(work, 3)
    assert all(each == first for each in others)


def test_distance_is_the_one_of_two_bodies() -> None:
    assert symbolic.distance is hdplan.distance.hdsdf_function


def test_mistakes_are_one_line_that_names_them(made: hdplan.Scene, tmp_path: Path) -> None:
    robot = hdplan.load_robot("panda")
    exact = dataclasses.replace(made, planner=dataclasses.replace(made.planner, distance="fcl"))
    without = tmp_path / "light.urdf"
    without.write_text(linkage_urdf(tmp_path).read_text())
    for call, message in (
        (
            lambda: symbolic.kinematics(robot, "panda_hamd"),
            "link: unknown link 'panda_hamd' .did you mean 'panda_hand'",
        ),
        (lambda: symbolic.kinematics(robot, 3), "link: must be a text"),
        (lambda: symbolic.kinematics("panda"), "robot: must be of the class Robot"),
        (lambda: symbolic.dynamics(None), "robot: must be of the class Robot"),
        (lambda: symbolic.dynamics(hdplan.load_robot(hdplan.RobotSpec(urdf=without))), "moves no mass"),
        (lambda: symbolic.clearance(robot), "scene: must be of the class Scene"),
        (lambda: symbolic.clearance(made, movable=["hooc"]), "movable: .* no obstacle 'hooc' .did you mean 'hook'"),
        (lambda: symbolic.clearance(made, movable="hook"), "movable: must be"),
        (lambda: symbolic.clearance(made, movable=[3]), r"movable\[0\]: must be a text"),
        (lambda: symbolic.clearance(made, activated=1), "activated: must be of the class bool"),
        (lambda: symbolic.clearance(exact), "planner.distance: must be hdsdf"),
    ):
        with pytest.raises(hdplan.InputError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
