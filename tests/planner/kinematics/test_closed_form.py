"""Laws of closed forms: every branch is found, each reaches the pose, and none depends on where the base stands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from hdplan.planner.kinematics.closed_form import ClosedForm, Joints, Kind, choice, closed_form, joints_to
from hdplan.planner.robot.link_frame import link_frame, link_poses
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.search.inverse_kinematics import inverse_kinematics, reaching
from hdplan.planner.terminal.robots import inverse_kinematics_notes
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.targets import PoseTarget
from tests.loops import needs_loops

from ..urdf import joint_text, link_text, robot_text

pytestmark = needs_loops

# Origin and roll, pitch, yaw of each joint on the one before, and its axis; "slide" for the first one that slides.
Joint = tuple[str, str, str]
Z, Y, X = "0 0 1", "0 1 0", "1 0 0"
MADE: dict[str, list[Joint]] = {
    "iiwa14": [
        ("0 0 0.1575", "0 0 0", Z),
        ("0 0 0.2025", "1.5707963267949 0 3.14159265359", Z),
        ("0 0.2045 0", "1.5707963267949 0 3.14159265359", Z),
        ("0 0 0.2155", "1.5707963267949 0 0", Z),
        ("0 0.1845 0", "-1.5707963267949 3.14159265359 0", Z),
        ("0 0 0.2155", "1.5707963267949 0 0", Z),
        ("0 0.081 0", "-1.5707963267949 3.14159265359 0", Z),
    ],
    "gen3": [
        ("0 0 0.15643", "3.1416 0 0", Z),
        ("0 0.005375 -0.12838", "1.5708 0 0", Z),
        ("0 -0.21038 -0.006375", "-1.5708 0 0", Z),
        ("0 0.006375 -0.21038", "1.5708 0 0", Z),
        ("0 -0.20843 -0.006375", "-1.5708 0 0", Z),
        ("0 0.00017505 -0.10593", "1.5708 0 0", Z),
        ("0 -0.10593 -0.00017505", "-1.5708 0 0", Z),
    ],
    "fetch": [
        ("-0.086875 0 0.37743", "0 0 0", "slide"),
        ("0.119525 0 0.34858", "0 0 0", Z),
        ("0.117 0 0.06", "0 0 0", Y),
        ("0.219 0 0", "0 0 0", X),
        ("0.133 0 0", "0 0 0", Y),
        ("0.197 0 0", "0 0 0", X),
        ("0.1245 0 0", "0 0 0", Y),
        ("0.1385 0 0", "0 0 0", X),
    ],
    "jaco2": [
        ("0 0 0.15675", "0 3.14159 0", Z),
        ("0 0.0016 -0.11875", "-1.5708 0 3.14159", Z),
        ("0 -0.41 0", "0 3.14159 0", Z),
        ("0 0.2073 -0.0114", "-1.5708 0 3.14159", Z),
        ("0 0.03703 -0.06414", "1.0472 0 3.14159", Z),
        ("0 0.03703 -0.06414", "1.0472 0 3.14159", Z),
    ],
    "xarm6": [
        ("0 0 0.267", "0 0 0", Z),
        ("0 0 0", "-1.5708 0 0", Z),
        ("0.053 -0.2845 0", "0 0 0", Z),
        ("0.0775 0.3425 0", "-1.5708 0 0", Z),
        ("0 0 0", "1.5708 0 0", Z),
        ("0.076 0.097 0", "-1.5708 0 0", Z),
    ],
    "kr6": [
        ("0 0 0.4", "3.14159265358979 0 0", Z),
        ("0.025 0 0", "0 0 0", Y),
        ("0.455 0 0", "0 0 0", Y),
        ("0 0 0.035", "0 0 0", "-1 0 0"),
        ("0.42 0 0", "0 0 0", Y),
        ("0.08 0 0", "0 0 0", "-1 0 0"),
    ],
}
KINDS = {
    "ur5": Kind.PARALLEL,
    "z1": Kind.PARALLEL,
    "kinova": Kind.WRIST,
    "talos_left_arm": Kind.WRIST,
    "kr6": Kind.WRIST,
    "panda": Kind.WRIST,
    "xarm7": Kind.WRIST,
    "iiwa14": Kind.WRIST,
    "gen3": Kind.WRIST,
    "fetch": Kind.WRIST,
    "jaco2": Kind.MEETING,
    "xarm6": Kind.MEETING,
}
SEARCHED = {"jaco2", "xarm6"}  # along an angle, on which a branch may be found within a thousandth of a turn alone
Load = Callable[..., Robot]


def urdf_of(name: str, joints: list[Joint], off: float = 0.0) -> str:
    """A description, with every origin off by up to `off` [m]."""
    rng, parts = np.random.default_rng(4), [link_text("l0")]
    for i, (origin, turn, axis) in enumerate(joints):
        at = " ".join(repr(float(x) + off * rng.uniform(-1, 1)) for x in origin.split())
        one, other = f"l{i}", f"l{i + 1}"
        slides: dict[str, Any] = {"kind": "prismatic", "limits": (0, 0.38)}
        how = (Z, slides) if axis == "slide" else (axis, {"limits": (-3.1, 3.3)})
        parts += [joint_text(f"j{i}", one, other, how[0], at=at, rpy=turn, **how[1]), link_text(other)]
    return robot_text(*parts, name=name)


@pytest.fixture
def load(tmp_path: Path) -> Load:
    def loaded(name: str, off: float = 0.0, base: Pose | None = None) -> Robot:
        if name not in MADE:
            return load_robot(RobotSpec(name=name, base=base or Pose()))
        path = tmp_path / f"{name}.urdf"
        path.write_text(urdf_of(name, MADE[name], off))
        return load_robot(RobotSpec(urdf=path, base=base or Pose()))

    return loaded


def goal(robot: Robot, q: np.ndarray, free: str = "none") -> PoseTarget:
    """The pose of the last link at q, of the tightest tolerances that are written."""
    link = last_link(robot)
    (place,) = link_poses(robot, q[None], link_frame(robot, link, ""))
    return PoseTarget(link, pose_of(place), 1e-9, 1e-9, free)


def last_link(robot: Robot) -> str:
    return str([frame.name for frame in robot.model.frames if frame.type == pin.FrameType.BODY][-1])


def pose_of(place: np.ndarray) -> Pose:
    quaternion = pin.Quaternion(place[:3, :3])
    quaternion.normalize()
    return Pose(tuple(place[:3, 3].tolist()), tuple(quaternion.coeffs().tolist()))


def apart(robot: Robot, found: np.ndarray, q: np.ndarray) -> float:
    """How far q is from the nearest of what is found, whole turns aside."""
    way = np.where(robot.turning, (found - q + np.pi) % (2 * np.pi) - np.pi, found - q)
    return float(np.abs(way).max(axis=1).min()) if len(found) else np.inf


def form_of(robot: Robot, target: PoseTarget) -> ClosedForm:
    form = closed_form(robot, target)
    assert form is not None
    return form


def assert_reached(robot: Robot, target: PoseTarget, found: np.ndarray) -> None:
    """Pinocchio's kinematics confirm each to 1e-9, within the limits."""
    assert np.isfinite(found).all()
    assert np.all((robot.lower <= found) & (found <= robot.upper))
    off = np.linalg.inv(target.pose.matrix) @ link_poses(robot, found, link_frame(robot, target.link, ""))
    assert np.abs(off[:, :3, 3]).max(initial=0.0) <= 1e-9
    axes = ["xyz".index(target.free_rotation)] if target.free_rotation != "none" else [0, 1, 2]
    assert np.abs(off[:, :3, axes] - np.eye(3)[:, axes]).max(initial=0.0) <= 1e-9


@pytest.mark.parametrize("name", KINDS)
def test_whatever_the_configuration_its_branch_is_found(name: str, load: Load) -> None:
    """And every other one that is found reaches the pose too; no two are the same."""
    robot = load(name)
    rng, missed = np.random.default_rng(3), 0
    for q, seed in zip(robot.draw(rng, 40), robot.draw(rng, 40), strict=True):
        target = goal(robot, q)
        form = form_of(robot, target)
        assert form.ways[0].kind == KINDS[name]
        found = form.branches(robot, target, q if form.redundant else seed)
        assert_reached(robot, target, found)
        missed += apart(robot, found, q) > 1e-6
        way = np.abs(found[:, None] - found[None]).max(axis=2) + np.eye(len(found))
        assert way.min() > 1e-7
    assert missed <= (1 if name in SEARCHED else 0)


@pytest.mark.parametrize("name", ["ur5", "kinova", "kr6", "xarm6"])
def test_configurations_found_by_a_search_are_among_the_branches(name: str, load: Load) -> None:
    robot = load(name)
    rng, total, missed = np.random.default_rng(9), 0, 0
    for q in robot.draw(rng, 8):
        target = goal(robot, q)
        wide = PoseTarget(target.link, target.pose, 1e-6, 1e-6)
        found = form_of(robot, target).branches(robot, target, q)
        others, _ = reaching(robot, wide, q, rng)
        total += len(others)
        missed += sum(apart(robot, found, other) > 1e-3 for other in others)
    assert total >= 16
    assert missed <= (2 if name in SEARCHED else 0)


@pytest.mark.parametrize("name", ["ur5", "panda", "jaco2"])
def test_a_base_that_hangs_changes_nothing(name: str, load: Load) -> None:
    base = Pose.from_rpy([0.3, -0.2, 2.0], [np.pi, 0.1, 0.7])
    robot, hanging = load(name), load(name, base=base)
    for q in robot.draw(np.random.default_rng(5), 4):
        one, other = goal(robot, q), goal(hanging, q)
        found = form_of(robot, one).branches(robot, one, q)
        moved = form_of(hanging, other).branches(hanging, other, q)
        assert len(found) == len(moved) > 0
        assert all(apart(robot, moved, row) < 1e-6 for row in found)


@pytest.mark.parametrize("name", ["ur5", "kr6", "gen3"])
def test_an_arm_as_it_is_measured_has_its_branches_too(name: str, load: Load) -> None:
    """Axes that miss each other by parts of a millimetre."""
    robot = load(name, off=2e-4)
    missed = 0
    for q in robot.draw(np.random.default_rng(6), 40):
        target = goal(robot, q)
        found = form_of(robot, target).branches(robot, target, q)
        assert_reached(robot, target, found)
        missed += apart(robot, found, q) > 1e-6
    assert missed == 0


@pytest.mark.parametrize("free", ["x", "y", "z"])
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_free_rotation_is_one_more_joint(name: str, free: str, load: Load) -> None:
    robot = load(name)
    for q in robot.draw(np.random.default_rng(7), 4):
        target = goal(robot, q, free)
        found = form_of(robot, target).branches(robot, target, q)
        assert_reached(robot, target, found)
        assert apart(robot, found, q) < 1e-6


@pytest.mark.parametrize("name", ["ur5", "kinova", "panda", "iiwa14", "fetch", "xarm6"])
def test_branches_of_singular_arms_are_finite_and_true(name: str, load: Load) -> None:
    """Straight, folded, and with a wrist or a shoulder whose axes lie in one line."""
    robot = load(name)
    rng = np.random.default_rng(8)
    for each in range(12):
        q = robot.draw(rng, 1)[0]
        q[rng.random(robot.n) < (1.0, 0.5, 0.3)[each % 3]] = (0.0, np.pi / 2, -np.pi / 2)[each % 3]
        q = np.clip(q, robot.lower, robot.upper)
        target = goal(robot, q)
        assert_reached(robot, target, form_of(robot, target).branches(robot, target, q))
        found = inverse_kinematics(robot, target.pose, target.link, seed=robot.draw(rng, 1)[0], all_branches=True)
        assert np.isfinite(found).all()


def test_a_joint_takes_the_turn_nearest_to_the_seed(load: Load) -> None:
    robot = load("ur5")
    wide = robot.upper > 6.0  # two turns, either way; not the elbow
    assert wide.sum() == 5
    for q in robot.draw(np.random.default_rng(2), 10):
        target = goal(robot, q)
        seed = np.where(wide, q - np.copysign(2 * np.pi, q), q)
        found = inverse_kinematics(robot, target.pose, target.link, seed=seed + 1e-4, all_branches=True)
        np.testing.assert_allclose(found[0], seed, atol=2e-3)
        turned = found + 2 * np.pi * np.sign(seed - found)
        inside = wide & (turned >= robot.lower) & (turned <= robot.upper)
        assert np.all((np.abs(found - seed) <= np.abs(turned - seed) + 1e-9) | ~inside)


def test_arms_without_a_closed_form_are_searched(load: Load) -> None:
    planar, arm = load_robot("so100"), load("ur5")
    q = planar.draw(np.random.default_rng(0), 1)[0]
    assert closed_form(planar, goal(planar, q)) is None
    assert len(inverse_kinematics(planar, goal(planar, q).pose, last_link(planar), seed=q + 0.05)) == 1
    for name, method in (
        ("so100", "by search"),
        ("ur5", "by three parallel axes"),
        ("panda", "panda_joint5 at values"),
    ):
        assert any(method in note for note in inverse_kinematics_notes(load_robot(name)))
    place = PoseTarget("tool0", Pose((0.4, 0.1, 0.4)), 1e-3, free_rotation="all")
    assert closed_form(arm, place) is None


def test_a_chain_moved_as_a_whole_is_solved_in_the_same_way() -> None:
    """No rounding decides where several ways are equally good."""
    rng = np.random.default_rng(11)
    robot = load_robot(RobotSpec("panda"))
    chains = [joints_to(robot, robot.model.getFrameId("panda_hand"), free) for free in ("none", "x", "y", "z")]
    for k in rng.integers(6, 9, 12):
        at = rng.integers(-1, 2, (k, 3)) * 0.3
        chains.append(Joints(np.arange(k), np.ones(k, np.int64), np.eye(3)[rng.integers(0, 3, k)], at, np.eye(4)))
    several = 0
    for joints in chains:
        assert joints is not None
        ways = choice(joints)
        several += bool(ways)
        for rotation in Rotation.random(3, rng=rng).as_matrix():
            points = joints.points @ rotation.T + rng.uniform(-1.0, 1.0, 3)
            assert choice(joints._replace(directions=joints.directions @ rotation.T, points=points)) == ways
    assert several > 5
