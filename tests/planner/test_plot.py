"""Pictures: written whole or not at all, not blank, for every kind of scene and verdict."""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner import plot
from hdplan.planner.certificate import Certifier
from hdplan.planner.clearances import Clearances
from hdplan.planner.plan import plan
from hdplan.planner.plot import Subject
from hdplan.planner.result import PlanResult, read_steps
from hdplan.planner.robot import Robot
from hdplan.planner.scene_robot import load_scene_robot
from hdplan.planner.trajectory import Trajectory
from hdplan.planner.verdict import Status
from hdplan.scenes.errors import InputError
from hdplan.scenes.model import Box, Capsule, Cylinder, Mesh, Obstacle, Points, Pose, Scene, Sphere
from hdplan.scenes.reader import load_scene

pytest.importorskip("matplotlib")

Planned = tuple[Scene, Robot, PlanResult]


@pytest.fixture(scope="module")
def planned() -> Planned:
    scene = load_scene("planar_arm")
    robot = load_scene_robot(scene)
    return scene, robot, plan(scene, robot=robot)


def pixels(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return np.asarray(imread(io.BytesIO(path.read_bytes())))[..., :3]


def assert_drawn(path: Path) -> None:
    image = pixels(path)
    height, width, _ = image.shape
    assert width > 1200
    assert height > 800
    for side in (image[height // 8 :, : width // 2], image[height // 8 :, width // 2 :]):  # curves, and the scene
        assert side.std() > 0.05
        assert len(np.unique(side.reshape(-1, 3), axis=0)) > 100


def test_certified_result_in_every_format(planned: Planned, tmp_path: Path) -> None:
    for suffix, begins in ((".png", b"\x89PNG"), (".pdf", b"%PDF"), (".SVG", b"<?xml")):
        plot.plot(Subject.planned(*planned), tmp_path / f"sheet{suffix}")
        assert (tmp_path / f"sheet{suffix}").read_bytes().startswith(begins)
    assert_drawn(tmp_path / "sheet.png")
    assert len(list(tmp_path.iterdir())) == 3


def test_without_obstacles_and_iterations(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    scene = replace(scene, obstacles=())
    certificate = Certifier(scene, robot).certify(result.trajectory)
    subject = Subject.planned(scene, robot, replace(result, certificate=certificate, steps=()))
    plot.plot(subject, tmp_path / "a.png")
    assert_drawn(tmp_path / "a.png")


def test_motion_of_no_length(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    stays = replace(result.trajectory, positions=result.trajectory.positions[[0, 0]])
    steps = tuple(replace(step, cost=0.0, smoothness=0.0, depth=0.0) for step in result.steps)
    plot.plot(Subject.of(Certifier(scene, robot), stays, steps, "stays"), tmp_path / "a.png")
    assert_drawn(tmp_path / "a.png")


def test_motion_in_contact_with_every_kind_of_shape(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    shapes = {
        "box": Box((0.2, 0.2, 0.1)),
        "sphere": Sphere(0.1),
        "cylinder": Cylinder(0.1, 0.3),
        "capsule": Capsule(0.1, 0.3),
        "points": Points(((0, 0, 0), (0.2, 0, 0), (0, 0.2, 0), (0, 0, 0.2))),
        "mesh": Mesh(scene.source.parent / "hook.obj"),
    }
    around = {name: (0.8 * np.cos(i), 0.8 * np.sin(i), 0.1) for i, name in enumerate(shapes)}
    obstacles = tuple(Obstacle(name, shape, Pose(around[name])) for name, shape in shapes.items())
    scene = replace(scene, obstacles=obstacles)
    ends = result.trajectory.positions[[0, -1]]
    trajectory = Trajectory(result.trajectory.joint_names, ends, result.trajectory.locked)
    subject = Subject.of(Certifier(scene, robot), trajectory, (), "ends")
    assert subject.certificate.status is Status.IN_CONTACT
    plot.plot(subject, tmp_path / "a.png")
    assert_drawn(tmp_path / "a.png")


def titles(subject: Subject) -> set[str]:
    from hdplan.planner.plot_sheet import sheet

    figure = sheet(subject)
    return {axis.get_title(loc="left").split(",")[0] for axis in figure.axes} - {""}


def test_a_panel_for_what_is_known_and_for_nothing_else(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    result.save(tmp_path / "a.json")
    loaded, steps = Trajectory.load(tmp_path / "a.json"), read_steps(tmp_path / "a.json")
    assert steps == result.steps
    certifier = Certifier(scene, robot)
    assert titles(Subject.of(certifier, loaded, steps, "a")) == {"joints", "clearance", "solver"}
    assert titles(Subject.of(certifier, loaded, (), "a")) == {"joints", "clearance"}
    timed = replace(loaded, times=np.linspace(0.0, 2.0, len(loaded)) ** 2)
    rates = {"velocity between waypoints", "acceleration at waypoints"}
    assert titles(Subject.of(certifier, timed, (), "a")) == {"joints", "clearance", *rates}
    assert read_steps(tmp_path / "a.csv") == ()


@pytest.mark.parametrize("steps", ["3", "[]", '{"cost": [1]}', '{"iteration": 1}', "{}"])
def test_steps_that_are_none_are_refused(tmp_path: Path, steps: str) -> None:
    (tmp_path / "a.json").write_text(f'{{"steps": {steps}}}')
    with pytest.raises(InputError, match=r"a\.json: steps: expected are lists of numbers"):
        read_steps(tmp_path / "a.json")


def test_rates_of_a_motion_that_speeds_up(planned: Planned) -> None:
    from hdplan.planner.plot_panels import rates

    _, robot, _ = planned
    times = np.array([0.0, 1.0, 3.0, 4.0])
    motion = Trajectory(robot.joint_names, np.stack([times**2, -times], axis=1), times=times)
    velocities, accelerations = rates(motion)
    np.testing.assert_allclose(velocities, [[1.0, -1.0], [4.0, -1.0], [7.0, -1.0]])  # a parabola's at the middles
    np.testing.assert_allclose(accelerations, [[2.0, 0.0], [2.0, 0.0]])


@pytest.mark.parametrize("name", ["planar_arm", "panda_cage"])
def test_the_planners_clearance_is_below_the_exact_one_and_that_not_below_the_proven(name: str) -> None:
    scene = load_scene(name)
    certifier = Certifier(scene, load_scene_robot(scene))
    result = plan(scene)
    parameter = np.linspace(0.0, 1.0, 40)
    positions = result.trajectory.at(parameter)
    found = Clearances.along(certifier, positions, parameter)
    singly = [certifier.nearest(q) for q in positions]
    np.testing.assert_array_equal(found.to_obstacles, [place.distance for place, _ in singly if place])
    np.testing.assert_array_equal(found.between_links, [place.distance for _, place in singly if place])
    assert (found.outer <= found.to_obstacles + 1e-9).all()
    assert result.certificate.clearance is not None
    assert found.to_obstacles.min() >= result.certificate.clearance


def test_names_are_written_as_they_are(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    scene = replace(scene, name="$\\frac$ " + 80 * "x")
    plot.plot(Subject.planned(scene, robot, result), tmp_path / "a.svg")
    assert (tmp_path / "a.svg").stat().st_size > 10_000


def test_unknown_ending_names_the_allowed_ones(planned: Planned, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.bmp.*\.png, \.pdf, \.svg"):
        plot.plot(Subject.planned(*planned), tmp_path / "a.bmp")
    assert not list(tmp_path.iterdir())


def test_nothing_half_written(planned: Planned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="folder"):
        plot.plot(Subject.planned(*planned), tmp_path / "missing" / "a.png")
    target = tmp_path / "a.png"
    target.write_bytes(b"before")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(InputError, match="No space left"):
        plot.plot(Subject.planned(*planned), target)
    assert target.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [target]


def test_missing_matplotlib_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install hdplan\[plot\]"):
        plot.check_picture(tmp_path / "a.png")


def test_planning_does_not_import_matplotlib() -> None:
    code = "import sys, hdplan.planner.plan, hdplan.planner.plot; sys.exit('matplotlib' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
