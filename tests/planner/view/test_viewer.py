"""Messages of the server, without a browser: places, closest points, planning, dragging, comparing."""

from __future__ import annotations

import dataclasses
import html
import json
import math
import socket
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.retiming import Retimer
from hdplan.planner.view import player as player_module
from hdplan.planner.view.drawing.handle import pose_of
from hdplan.planner.view.drawing.motion import as_pose
from hdplan.planner.view.drawing.nodes import RobotNodes
from hdplan.planner.view.drawing.skins import ENDLESS, INSET, smaller
from hdplan.planner.view.drawing.timeline import PATH_DURATION
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.things import GOAL
from hdplan.planner.view.viewer import Viewer
from hdplan.planner.view.words import OUTDATED
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import PathConstraints, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Sphere
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.view.events import Opener, active_of, by_worker, straight
from tests.threads import together
from tests.waiting import until


def planned(viewer: Viewer) -> None:
    viewer.panel.planning.start()
    until(lambda: not viewer.panel.planning.running, "the plan ends")
    assert viewer.worker.settle(20)


def assert_posed(nodes: RobotNodes, q: np.ndarray) -> None:
    """Every joint's frame stands where Pinocchio's kinematics has it."""
    robot = nodes.robot
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.pin_q(q))
    for joint, frame in nodes.frames.items():
        np.testing.assert_allclose(pose_of(frame).matrix, data.oMi[joint].homogeneous, rtol=0, atol=1e-9)


def test_the_slider_moves_the_robot(viewer: Viewer, trajectory: Trajectory) -> None:
    for now in (0.0, 0.31, 1.0):
        viewer.show(now)
        assert_posed(viewer.stage.robot, trajectory.at(now))
    assert_posed(viewer.stage.start, trajectory.positions[0])
    assert_posed(viewer.stage.goal, trajectory.positions[-1])


def test_the_segment_is_as_long_as_the_stated_clearance(viewer: Viewer) -> None:
    viewer.show(0.5)
    to_obstacle, _ = viewer.certifier.closest(viewer.configuration)
    assert to_obstacle is not None
    points = np.asarray(viewer.stage.closest.lines[0].points)[0]
    assert np.linalg.norm(points[0] - points[1]) == pytest.approx(to_obstacle.distance, abs=2e-5)
    assert f"{to_obstacle.distance * 1e3:.1f} mm" in viewer.stage.closest.label.text


class Clock:
    """A clock that stands still except in sleep."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def seconds_played(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> float:
    """Play to the end; the time that passed by the player's clock [s]."""
    monkeypatch.setattr(player_module, "time", clock := Clock())
    viewer.panel.player.play()
    until(lambda: not viewer.panel.player.playing, "the end")
    assert viewer.panel.player.time == viewer.panel.player.timeline.end
    assert viewer.panel.player.button.label == "Play"
    return clock.now


@pytest.mark.parametrize("speed", ["0.5", "4"])
def test_a_path_plays_to_its_end_and_stops(viewer: Viewer, speed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    viewer.panel.player.speed.value = speed
    wanted = PATH_DURATION / float(speed)
    assert seconds_played(viewer, monkeypatch) == pytest.approx(wanted, abs=player_module.FRAME)


# --- motions in time --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drifting(scene: Scene) -> Scene:
    """The arm's scene, in which a ball crosses and a bar swings."""
    crossing = SteadyMotion((0.0, 0.3, 0.0), (0.0, 0.0, 1.0))
    ball = Obstacle("crossing", Sphere(0.08), Pose((1.2, -0.5, 0.1)), motion=crossing)
    poses = (Pose((0.0, 1.4, 0.1)), Pose((0.3, 1.4, 0.1), (0.0, 0.0, 0.6, 0.8)))
    bar = Obstacle("bar", Box((0.3, 0.05, 0.1)), poses[0], motion=TimedPoses((0.3, 1.1), poses))
    return dataclasses.replace(scene, obstacles=(*scene.obstacles, ball, bar), timing=Timing(duration=1.5))


@pytest.fixture(scope="module")
def timed(drifting: Scene, trajectory: Trajectory) -> Trajectory:
    return Retimer(Setup.of(drifting))(trajectory).trajectory


def test_moving_obstacles_are_where_they_are_at_the_sliders_time(
    opened: Opener, drifting: Scene, timed: Trajectory
) -> None:
    viewer = opened(drifting, timed=timed)
    assert (viewer.panel.player.slider.min, viewer.panel.player.slider.max) == (0.0, 1.5)
    for now in (0.0, 0.412, 1.5):
        viewer.show(now)
        for node in viewer.stage.obstacles:
            wanted = ObstacleMotion.of(node.obstacle).at(np.array([now]))[0]
            np.testing.assert_allclose(pose_of(node.frame).matrix, wanted, rtol=0, atol=1e-12)
        q = timed.at(timed.curve.parameter_of(now))
        assert_posed(viewer.stage.robot, q)
        nearest, _ = viewer.certifier.nearest(q, time=now)
        assert nearest is not None
        assert f"{nearest.distance * 1e3:.1f} mm" in viewer.stage.closest.label.text
        assert f'data-moment="{now:.3f} s"' in viewer.panel.clearance.content


def test_a_moving_obstacle_is_dragged_at_time_0_and_moves_on_from_there(
    opened: Opener, drifting: Scene, timed: Trajectory
) -> None:
    viewer = opened(drifting, timed=timed)
    viewer.show(0.7)
    handles, index = viewer.panel.handles, len(drifting.obstacles) - 2
    handles.choice.value = "obstacle crossing"
    viewer.worker.settle(20)
    assert viewer.panel.player.time == 0.0
    pose = Pose((1.4, -0.5, 0.1))
    by_worker(viewer, lambda: handles.drag(pose))
    by_worker(viewer, handles.let_go)
    assert pose_of(viewer.stage.obstacles[index].frame).position == pytest.approx(pose.position)
    viewer.show(1.0)
    assert pose_of(viewer.stage.obstacles[index].frame).position == pytest.approx((1.4, -0.2, 0.1))
    assert viewer.scene.obstacles[index].motion == drifting.obstacles[index].motion


def test_a_motion_plays_in_real_time(
    opened: Opener, drifting: Scene, timed: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer = opened(drifting, timed=timed)
    assert seconds_played(viewer, monkeypatch) == pytest.approx(1.5, abs=player_module.FRAME)


def test_motions_of_different_durations_share_the_seconds(
    opened: Opener, drifting: Scene, timed: Trajectory, scene: Scene, trajectory: Trajectory
) -> None:
    assert timed.times is not None
    slow = dataclasses.replace(timed, times=2 * timed.times, velocities=None, accelerations=None)
    viewer = opened(scene, timed=timed, slow=slow, path=trajectory)
    assert viewer.panel.player.slider.max == 3.0
    viewer.show(1.5)
    assert_posed(viewer.stage.robot, timed.positions[-1])
    assert_posed(viewer.motion_nodes.of(viewer.motions.shown[1]).robot, slow.at(slow.curve.parameter_of(1.5)))
    assert_posed(viewer.motion_nodes.of(viewer.motions.shown[2]).robot, trajectory.at(0.5))
    viewer.show(3.0)
    assert_posed(viewer.stage.robot, timed.positions[-1])
    assert "1.500 s in" in viewer.panel.verdict
    assert "3.000 s in" in viewer.panel.verdict


def test_moving_obstacles_can_be_watched_before_there_is_a_motion(opened: Opener, drifting: Scene) -> None:
    viewer = opened(drifting)
    assert not viewer.panel.player.slider.disabled
    viewer.show(1.0)
    ball = viewer.stage.obstacles[-2]
    assert pose_of(ball.frame).position == pytest.approx((1.2, -0.2, 0.1))


def test_an_obstacle_fades_as_it_moves_between_the_eye_and_the_robot(opened: Opener, drifting: Scene) -> None:
    motion = SteadyMotion((-2.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    screen = Obstacle("screen", Box((0.02, 3.0, 3.0)), Pose((5.0, 0.0, 0.0)), motion=motion)
    viewer = opened(dataclasses.replace(drifting, obstacles=(screen,)))
    by_worker(viewer, lambda: setattr(viewer.panel.looking, "eye", np.array([3.0, 0.0, 0.3])))
    for now, faded in ((0.0, False), (1.4, True), (0.5, False)):
        viewer.show(now)
        assert (viewer.stage.obstacles[0].opacity is not None) == faded


def test_layers_come_and_go(viewer: Viewer) -> None:
    viewer.show(0.4)
    for name in ("outer bodies", "collision meshes"):
        by_worker(viewer, lambda name=name: viewer.panel.layers.set(name, True))
        nodes = viewer.panel.layers.bodies[name]
        assert nodes.visible
        assert_posed(nodes, viewer.configuration)
    for name in ("robot", "path", "start and goal", "obstacles", "closest pair"):
        viewer.panel.layers.set(name, False)
    viewer.worker.settle(20)
    shown = viewer.motions.shown[0]
    hidden = [
        viewer.motion_nodes.of(shown).robot,
        viewer.stage.start,
        viewer.stage.goal,
        viewer.stage.robot,
        viewer.motion_nodes.of(shown).path.node,
        viewer.stage.closest.root,
    ]
    assert not any(node.visible for node in hidden)


def test_the_ground_is_drawn_below_what_stands(viewer: Viewer) -> None:
    """Below the ball, whose lowest point is below the base."""
    node = viewer.server.scene._handle_from_node_name["/ground"]
    np.testing.assert_allclose(node.position, [0.0, 0.0, -0.02], atol=1e-9)


def test_ghosts_are_smaller_than_the_robot_and_than_each_other(viewer: Viewer) -> None:
    """Surfaces in one place flicker, as those of a link do that turns about its own axis."""
    for start, goal in zip(viewer.stage.start.links, viewer.stage.goal.links, strict=True):
        skin, edges = start.skin.vertices, [np.ptp(link.mesh.vertices, axis=0) for link in (start, goal)]
        for edge, inset in zip(edges, (INSET, 2 * INSET), strict=True):
            np.testing.assert_allclose(np.ptp(skin, axis=0) - edge, 2 * inset, atol=1e-5)
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1e-4], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(np.ptp(smaller(flat, 0.01), axis=0), [0.98, 0.98, 5e-5])
    np.testing.assert_array_equal(smaller(flat, 0.0), flat)


def test_a_ghost_makes_room_for_the_robot(viewer: Viewer) -> None:
    for now, start, goal in ((0.0, False, True), (0.5, True, True), (1.0, True, False)):
        viewer.show(now)
        assert (viewer.stage.start.visible, viewer.stage.goal.visible) == (start, goal)


def test_planning_streams_its_motions_and_ends_with_a_verdict(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene)
    assert viewer.motions.active is None
    assert viewer.panel.player.slider.disabled
    planned(viewer)
    result = active_of(viewer).result
    assert result is not None
    assert len(viewer.panel.planning.iterates) == result.iterations
    assert active_of(viewer).motion.name == NAME
    assert "certified" in viewer.panel.planning.text.content
    assert not viewer.panel.player.slider.disabled
    viewer.show(0.3)
    assert_posed(viewer.stage.robot, result.trajectory.at(0.3))


def test_saved_files_can_be_planned_and_checked(opened: Opener, scene: Scene, tmp_path: Path) -> None:
    viewer = opened(scene)
    with pytest.raises(HdplanError, match="no motion"):
        viewer.panel.saving.motion_file()
    planned(viewer)
    (tmp_path / "scene.yaml").write_bytes(viewer.panel.saving.scene_file())
    (tmp_path / "motion.json").write_bytes(viewer.panel.saving.motion_file())
    saved = load_scene(tmp_path / "scene.yaml")
    motion = Trajectory.load(tmp_path / "motion.json")
    again = opened(saved, motion=motion)
    assert again.motions.shown[0].motion.certificate.certified
    assert [obstacle.pose for obstacle in saved.obstacles] == [obstacle.pose for obstacle in scene.obstacles]


def test_the_goal_follows_its_handle(viewer: Viewer) -> None:
    viewer.panel.handles.choice.value = str(GOAL)
    viewer.worker.settle(20)
    before = viewer.stage.tip.placement(viewer.edited.goal)
    near = viewer.stage.tip.placement(viewer.edited.goal + [0.05, -0.1, 0.08][: viewer.robot.n])
    by_worker(viewer, lambda: viewer.panel.handles.drag(as_pose(near)))
    by_worker(viewer, viewer.panel.handles.let_go)
    after = viewer.stage.tip.placement(viewer.edited.goal).translation
    assert np.linalg.norm(after - near.translation) < 1e-3 < np.linalg.norm(after - before.translation)
    assert_posed(viewer.stage.goal, viewer.edited.goal)
    assert viewer.motions.shown[0].motion.certificate.status.value == "wrong_ends"


def test_an_obstacle_dragged_onto_the_goal_is_reported_in_place_and_refused(viewer: Viewer) -> None:
    handles, index = viewer.panel.handles, 0
    obstacle = viewer.scene.obstacles[index]
    handles.choice.value = f"obstacle {obstacle.name}"
    viewer.worker.settle(20)
    tip = viewer.stage.tip.placement(viewer.edited.goal).translation
    pose = dataclasses.replace(obstacle.pose, position=tuple(tip.tolist()))
    by_worker(viewer, lambda: handles.drag(pose))
    by_worker(viewer, handles.let_go)
    assert viewer.scene.obstacles[index].pose == pose
    assert pose_of(viewer.stage.obstacles[index].frame).position == pose.position
    contacts = viewer.edited.contacts[1]
    assert obstacle.name in {contact.other for contact in contacts}
    assert obstacle.name in viewer.stage.labels[1].text
    assert "goal is in collision" in viewer.panel.verdict
    planned(viewer)
    assert "collision" in viewer.panel.planning.text.content
    by_worker(viewer, lambda: handles.drag(obstacle.pose))
    assert viewer.edited.contacts == ((), ())


def test_several_motions_stand_side_by_side(opened: Opener, scene: Scene, trajectory: Trajectory) -> None:
    line = straight(trajectory)
    viewer = opened(scene, found=trajectory, line=line)
    assert [shown.motion.name for shown in viewer.motions.shown] == ["found", "line"]
    assert [shown.motion.certificate.certified for shown in viewer.motions.shown] == [True, False]
    viewer.show(0.5)
    assert_posed(viewer.stage.robot, trajectory.at(0.5))
    assert_posed(viewer.motion_nodes.of(viewer.motions.shown[1]).robot, line.at(0.5))
    viewer.document.choose("line")
    viewer.worker.settle(20)
    assert viewer.motions.active is viewer.motions.shown[1]
    np.testing.assert_allclose(viewer.configuration, line.at(0.5))


def test_the_box_of_a_path_constraint_is_shown_where_there_is_one(viewer: Viewer, opened: Opener, scene: Scene) -> None:
    assert viewer.stage.region is None
    box = Within("forearm", (0.02, math.inf, 0.5), Pose((0.1, 0.0, 0.2), (0.0, 0.0, 1.0, 0.0)))
    region = opened(dataclasses.replace(scene, path=PathConstraints(position=box))).stage.region
    assert region.dimensions == (0.02, ENDLESS, 0.5)
    np.testing.assert_array_equal([*region.position, *region.wxyz], [0.1, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0])
    assert region.opacity < 0.5


def test_a_trajectory_of_another_robot_is_refused(scene: Scene) -> None:
    stranger = Trajectory(("elbow",), np.zeros((2, 1)))
    with pytest.raises(InputError, match=r"stranger: trajectory: joint .* is missing"):
        open_viewer(scene, [("stranger", stranger)], port=8180)


def test_a_path_without_times_is_refused_where_obstacles_move(drifting: Scene, trajectory: Trajectory) -> None:
    with pytest.raises(InputError, match="found: trajectory: has no times, and obstacle 'crossing' moves"):
        open_viewer(drifting, [("found", trajectory)], port=8180)


def test_the_viewer_listens_on_this_machine_alone_at_the_next_free_port(opened: Opener, scene: Scene) -> None:
    first, second = opened(scene), opened(scene)
    assert first.port != second.port
    with socket.create_connection(("127.0.0.1", second.port), timeout=5):
        pass
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {"127.0.0.1"}
    for address in others:
        if not str(address).startswith("127."):
            with pytest.raises(OSError, match=r"refused|timed out"):
                socket.create_connection((address, second.port), timeout=2).close()


def test_a_host_elsewhere_is_refused(scene: Scene) -> None:
    for host in ("192.0.2.1", "no.such.host.invalid"):
        with pytest.raises(InputError, match="is not an address of this machine"):
            open_viewer(scene, host=host)


# --- messages and files are about the scene as it is ------------------------------------------------------------------


def saved_pair(viewer: Viewer, folder: Path) -> tuple[Scene, Path]:
    (folder / "scene.yaml").write_bytes(viewer.panel.saving.scene_file())
    (folder / "motion.json").write_bytes(viewer.panel.saving.motion_file())
    return load_scene(folder / "scene.yaml"), folder / "motion.json"


def assert_true(viewer: Viewer, folder: Path) -> str:
    """Shown and saved verdicts are those of a certificate of the saved motion in the saved scene; returns the
    status that the file says, if it says any."""
    scene, file = saved_pair(viewer, folder)
    certificate = certify(scene, Trajectory.load(file))
    verdict = json.loads(file.read_text(encoding="utf-8")).get("verdict", {})
    if verdict:
        assert (verdict["status"], verdict["text"]) == (certificate.status.value, certificate.text)
        assert verdict["clearance_m"] == certificate.clearance
    assert "certified: at least" not in viewer.panel.planning.text.content or certificate.certified
    assert viewer.panel.rows.html.content.count(OUTDATED) == sum(
        not viewer.document.holds(shown) for shown in viewer.motions.shown
    )
    for shown in viewer.motions.shown:
        if viewer.document.holds(shown):
            text = certify(scene, shown.motion.trajectory).text
            assert html.escape(text) in viewer.panel.verdict
    return str(verdict.get("status"))


def test_an_obstacle_dragged_into_the_arm_takes_the_verdict_with_it(
    opened: Opener, scene: Scene, tmp_path: Path
) -> None:
    """From the first move on, and in the file, whether the obstacle was let go or not."""
    viewer = opened(scene)
    planned(viewer)
    assert assert_true(viewer, tmp_path) == "certified"
    middle = active_of(viewer).motion.tip[len(active_of(viewer).motion.tip) // 2]
    handles, ball = viewer.panel.handles, next(o for o in scene.obstacles if o.name == "ball")
    handles.choice.value = "obstacle ball"
    viewer.worker.settle(20)
    by_worker(viewer, lambda: handles.drag(dataclasses.replace(ball.pose, position=tuple(middle.tolist()))))
    assert OUTDATED in viewer.panel.verdict
    assert "certified" not in viewer.panel.planning.text.content
    assert assert_true(viewer, tmp_path) == "in_contact"
    by_worker(viewer, handles.let_go)
    assert "in contact" in viewer.panel.verdict
    assert assert_true(viewer, tmp_path) == "in_contact"
    by_worker(viewer, lambda: handles.drag(ball.pose))
    assert assert_true(viewer, tmp_path) == "certified"


def test_verdicts_stay_true_in_any_order_of_drags_plans_and_saves(
    opened: Opener, drifting: Scene, timed: Trajectory, tmp_path: Path
) -> None:
    """At random: obstacles that stand and that move, and the goal; let go or not; planned, also while it is dragged."""
    rng = np.random.default_rng(11)
    still = dataclasses.replace(drifting, obstacles=drifting.obstacles[:1], timing=None)
    statuses: list[str] = []
    moving = dataclasses.replace(drifting, obstacles=drifting.obstacles[1:])
    for scene, limit in ((still, 4), (moving, 2)):
        viewer = opened(scene, found=timed)
        viewer.panel.settings.time_limit.value = 0.5  # a plan that fails has a verdict, too
        planned(viewer)
        handles = viewer.panel.handles
        choices = [str(GOAL), *(f"obstacle {obstacle.name}" for obstacle in scene.obstacles)]

        def drag(handles: Handles = handles, viewer: Viewer = viewer) -> None:
            if handles.choice.value == str(GOAL):
                handles.drag(viewer.stage.tip.pose(viewer.edited.goal + rng.normal(0.0, 0.05, viewer.robot.n)))
                return
            (obstacle,) = (o for o in viewer.scene.obstacles if f"obstacle {o.name}" == handles.choice.value)
            position = np.array(obstacle.pose.position) + rng.normal(0.0, 0.1, 3) * [1, 1, 0]
            handles.drag(dataclasses.replace(obstacle.pose, position=tuple(position.tolist())))

        for _ in range(limit):
            handles.choice.value = str(rng.choice(choices))
            viewer.worker.settle(20)
            match rng.choice(["drag", "let go", "plan", "drag while planning"], p=[0.5, 0.25, 0.1, 0.15]):
                case "drag":
                    by_worker(viewer, drag)
                case "let go":
                    by_worker(viewer, drag)
                    by_worker(viewer, handles.let_go)
                case "plan":
                    planned(viewer)
                case "drag while planning":
                    viewer.panel.planning.start()
                    by_worker(viewer, drag)
                    while viewer.panel.planning.running:
                        by_worker(viewer, drag)
                    assert viewer.worker.settle(20)
            statuses.append(assert_true(viewer, tmp_path))
    assert len(set(statuses)) > 1


def test_a_motion_that_was_not_planned_here_is_saved_without_a_verdict(viewer: Viewer, tmp_path: Path) -> None:
    assert assert_true(viewer, tmp_path) == "None"


def test_a_scene_that_does_not_fit_moves_nothing(viewer: Viewer) -> None:
    before = viewer.edited, viewer.panel.verdict
    with pytest.raises(InputError, match="outside its limits"):
        viewer.document.change(viewer.edited.ending_at(viewer.robot.upper + 1.0))
    with pytest.raises(InputError, match="outside its limits"):
        viewer.document.change(viewer.edited.starting_at(viewer.robot.lower - 1.0))
    assert (viewer.edited, viewer.panel.verdict) == before


def test_a_handle_that_is_no_pose_is_one_line(viewer: Viewer) -> None:
    """As a browser may send anything."""
    for position, wxyz in (((np.nan, 0, 0), (1, 0, 0, 0)), ((0, 0, 0), (0, 0, 0, 0)), ((0, np.inf, 0), (1, 0, 0, 0))):
        handle = SimpleNamespace(position=position, wxyz=wxyz, remove=lambda: None)
        viewer.panel.handles.choice.value = str(GOAL)
        viewer.worker.settle(20)
        viewer.panel.handles.grip.node = handle
        before = viewer.scene
        viewer.panel.handles.grip.moved(SimpleNamespace(target=handle, phase="update", client_id=1))
        assert viewer.worker.settle(20)
        assert "handle: found position" in viewer.panel.verdict
        assert "\n" not in viewer.panel.verdict
        assert viewer.scene is before


def test_two_browsers_that_press_plan_at_once_get_one_motion(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene)
    together(lambda _: viewer.panel.planning.start(), 3)
    until(lambda: not viewer.panel.planning.running, "the plan ends")
    assert viewer.worker.settle(20)
    assert "certified: at least" in viewer.panel.planning.text.content
    assert viewer.panel.planning.button.label == "Plan"
    assert [shown.motion.name for shown in viewer.motions.shown] == [NAME]


MORE = [pytest.param(name, marks=pytest.mark.slow) for name in ("panda_carry", "ur5_payload")]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["panda_grasp", "panda_conveyor", *MORE])
def test_other_scenes_are_saved_as_they_are(opened: Opener, name: str, tmp_path: Path) -> None:
    viewer = opened(load_scene(name))
    planned(viewer)
    assert assert_true(viewer, tmp_path) == "certified"


def test_layers_that_are_off_stay_off_for_new_motions(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene)
    viewer.panel.layers.set("robot", False)
    viewer.panel.layers.set("path", False)
    planned(viewer)
    assert not viewer.motion_nodes.of(viewer.motions.shown[0]).path.node.visible
    assert not viewer.motion_nodes.of(viewer.motions.shown[0]).robot.visible
