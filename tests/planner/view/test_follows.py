"""Laws of what the viewer follows: a robot that reports its joints, and a plan that is made elsewhere."""

from __future__ import annotations

import itertools
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.view import reported
from hdplan.planner.view.drawing.motion import millimetres
from hdplan.planner.view.layers import PLANE
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene
from tests.planner.view.events import Opener, active_of, by_worker
from tests.waiting import until


def test_the_robot_is_where_it_reports_itself(viewer: Viewer, trajectory: Trajectory) -> None:
    """Robot and clearance are the report's, by order or by name; verdicts stay the motion's; without reports the motion
    comes back."""
    verdict, q = viewer.panel.verdict, np.array([0.3, -0.7])
    for given in (q, q.tolist(), {"elbow": -0.7, "shoulder": 0.3, "finger": 9.0}):
        viewer.state(None)
        viewer.state(given)
        assert viewer.worker.settle(20)
        np.testing.assert_array_equal(viewer.stage.robot.q, q)
    nearest = next(filter(None, viewer.certifier.closest(q)))
    assert millimetres(nearest.distance) in viewer.panel.clearance.content
    assert "the robot itself" in viewer.panel.clearance.content
    assert viewer.panel.verdict == verdict
    assert viewer.stage.report_label.visible
    (shown,) = viewer.motions.shown
    assert viewer.motion_nodes.of(shown).robot.visible
    np.testing.assert_array_equal(viewer.motion_nodes.of(shown).robot.q, trajectory.positions[0])
    viewer.show(1.0)
    np.testing.assert_array_equal(viewer.stage.robot.q, q)
    viewer.state(None)
    assert viewer.worker.settle(20)
    np.testing.assert_allclose(viewer.stage.robot.q, trajectory.positions[-1])
    assert not viewer.stage.report_label.visible
    assert not viewer.motion_nodes.of(shown).robot.visible
    assert "the robot itself" not in viewer.panel.clearance.content


def test_a_proof_says_nothing_of_a_report(viewer: Viewer) -> None:
    viewer.panel.layers.set(PLANE, True)
    until(lambda: viewer.panel.layers.plane.slab.visible, "no plane is shown")
    viewer.state([0.3, -0.7])
    assert viewer.worker.settle(20)
    assert not viewer.panel.layers.plane.slab.visible
    assert "proven" not in viewer.panel.layers.plane.text.content


def test_a_report_grows_old(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reported, "STALE", 0.0)
    viewer.state([0.3, -0.7])
    by_worker(viewer, viewer.pulse._beat)
    assert viewer.stage.report_label.text == "the robot itself, 0 s ago"


def test_reports_of_other_joints_are_refused(viewer: Viewer) -> None:
    reports: list[tuple[Any, str]] = [
        ([0.1], r"^state: shape \(1,\), must be \(2,\), for shoulder, elbow"),
        ([[0.1, 0.2]], r"^state: shape"),
        ([0.1, np.nan], "^state: nan for joint elbow"),
        ("default", "^state: must be 2 numbers"),
        ({"elbow": 0.1}, "^state: no value for shoulder"),
        ({"elbow": 0.1, "shoulder": "x"}, "^state: must be 2 numbers"),
    ]
    for q, message in reports:
        with pytest.raises(InputError, match=message):
            viewer.state(q)
    assert viewer.reported.newest is None


def test_reports_come_faster_than_pictures_and_from_two_threads(viewer: Viewer) -> None:
    def report(first: float) -> None:
        for i in range(500):
            viewer.state([first, 0.001 * i])

    threads = [threading.Thread(target=report, args=(first,)) for first in (0.1, 0.2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert viewer.worker.settle(20)
    assert viewer.stage.robot.q is not None
    assert viewer.stage.robot.q[1] == 0.499


def test_a_plan_elsewhere_is_seen_as_it_is_made(opened: Opener, scene: Scene) -> None:
    """Its iterations, its result with its own certificate; while it is made, Plan stops it."""
    viewer = opened(scene)
    pressed = []

    def run(seen: Callable[..., None], stop: Callable[[], bool]) -> Any:
        assert viewer.panel.planning.running
        pressed.append(stop())
        result = plan(scene, report=seen)
        viewer.panel.planning.toggle()
        pressed.append(stop())
        return result

    result = viewer.panel.planning.follow(scene, run)
    assert viewer.worker.settle(20)
    assert pressed == [False, True]
    assert not viewer.panel.planning.running
    assert viewer.panel.planning.iterates
    assert active_of(viewer).motion.certificate is result.certificate
    assert viewer.panel.planning.button.label == "Plan"


def test_a_plan_elsewhere_says_nothing_of_another_scene(opened: Opener, scene: Scene) -> None:
    """A box comes while it is made: the message is about the scene with it; and a failure is reported, and raised."""
    viewer = opened(scene)

    def run(seen: Callable[..., None], stop: Callable[[], bool]) -> Any:
        result = plan(scene, report=seen)
        by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
        return result

    result = viewer.panel.planning.follow(scene, run)
    assert viewer.worker.settle(20)
    motion = active_of(viewer).motion
    assert motion.certificate is not result.certificate
    assert motion.certificate.text == certify(viewer.scene, result.trajectory).text

    def fails(seen: Callable[..., None], stop: Callable[[], bool]) -> Any:
        raise InputError("start: is in collision")

    with pytest.raises(InputError):
        viewer.panel.planning.follow(scene, fails)
    assert viewer.worker.settle(20)
    assert "start: is in collision" in viewer.panel.verdict
    assert not viewer.panel.planning.running


@pytest.mark.slow
@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.skipif(sys.platform == "win32", reason="no Ctrl-C for a child there")
@pytest.mark.parametrize("name", ["planar_arm", "panda_pick_place"])
def test_plan_serves_until_ctrl_c(name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hdplan.cli", "plan", name, "--view", "-o", str(tmp_path / "motion.json")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stderr is not None
        served = next(filter(None, (re.search(r"http://127\.0\.0\.1:\d+/", line) for line in child.stderr)))
        lines = list(itertools.takewhile(lambda line: "written" not in line, child.stdout))
        assert lines[0].startswith("certified")
        assert Trajectory.load(tmp_path / "motion.json")
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=20)
    assert child.returncode == 0
    assert served
