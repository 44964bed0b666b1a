"""Pictures: written whole or not at all, not blank, for every kind of scene and verdict."""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures import plot
from hdplan.planner.pictures.clearances import Clearances, outer_clearance
from hdplan.planner.pictures.plot import Subject
from hdplan.planner.plan import plan
from hdplan.planner.result import PlanResult, read_steps
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, SteadyMotion
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Mesh, Points, Sphere
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene
from tests.extras import needs

pytestmark = needs("matplotlib")

Planned = tuple[Scene, Robot, PlanResult]


@pytest.fixture(scope="module")
def planned() -> Planned:
    scene = load_scene("planar_arm")
    robot = load_scene_robot(scene)
    return scene, robot, plan(scene, robot=robot)


def planned_subject(planned: Planned) -> Subject:
    scene, robot, result = planned
    return Subject.planned(Setup.of(scene, robot), result)


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
        assert len(np.unique((255 * side).astype(int) @ [65536, 256, 1])) > 100  # colours


def test_certified_result_in_every_format(planned: Planned, tmp_path: Path) -> None:
    for suffix, begins in ((".png", b"\x89PNG"), (".pdf", b"%PDF"), (".SVG", b"<?xml")):
        plot.plot(planned_subject(planned), tmp_path / f"sheet{suffix}")
        assert (tmp_path / f"sheet{suffix}").read_bytes().startswith(begins)
    assert_drawn(tmp_path / "sheet.png")
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("lines", [1, 3])
def test_nothing_lies_on_something_else(planned: Planned, lines: int) -> None:
    """The verdict ends above the panels, however long it is, and no legend lies on a curve."""
    from hdplan.planner.pictures.sheet import TITLE_WIDTH, sheet

    subject = planned_subject(planned)
    words = ("certified " * 100)[: (lines - 1) * TITLE_WIDTH + 40]
    figure = sheet(replace(subject, certificate=replace(subject.certificate, text=words)))
    figure.draw_without_rendering()
    panels = [axis for axis in figure.axes if axis.lines or axis.collections]
    verdict = figure.texts[-1]
    assert verdict.get_text().count("\n") == lines - 1
    titles = [axis.title.get_window_extent().y1 for axis in panels] + [axis.get_window_extent().y1 for axis in panels]
    assert verdict.get_window_extent().y0 > max(titles) + 5.0
    for axis in panels:
        if (legend := axis.get_legend()) is None:
            continue
        box = legend.get_window_extent()
        for curve in axis.lines:
            places = curve.get_transform().transform(curve.get_xydata())
            fine = np.linspace(0, len(places) - 1, 40 * len(places))
            x, y = (np.interp(fine, np.arange(len(places)), column) for column in places.T)
            assert not ((x > box.x0) & (x < box.x1) & (y > box.y0) & (y < box.y1)).any(), curve.get_label()


def test_the_planners_distance_below_zero_is_explained(planned: Planned, monkeypatch: pytest.MonkeyPatch) -> None:
    from hdplan.planner.pictures import panels
    from hdplan.planner.pictures.sheet import sheet

    found = Clearances.along
    for lowered in (0.0, 10.0):

        def along(*arguments: object, lowered: float = lowered) -> Clearances:
            real = found(*arguments)
            return replace(real, outer=real.outer - lowered)

        monkeypatch.setattr(Clearances, "along", along)
        figure = sheet(planned_subject(planned))
        texts = [text.get_text() for axis in figure.axes for text in axis.texts]
        assert (panels.BELOW_ZERO in texts) == (lowered > 0.0)


def test_without_obstacles_and_iterations(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    scene = replace(scene, obstacles=())
    certificate = Certifier(Setup.of(scene, robot)).certify(result.trajectory)
    subject = Subject.planned(Setup.of(scene, robot), replace(result, certificate=certificate, steps=()))
    plot.plot(subject, tmp_path / "a.png")
    assert_drawn(tmp_path / "a.png")


def test_motion_of_no_length(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    stays = replace(result.trajectory, positions=result.trajectory.positions[[0, 0]])
    steps = tuple(replace(step, cost=0.0, smoothness=0.0, depth=0.0) for step in result.steps)
    plot.plot(Subject.of(Certifier(Setup.of(scene, robot)), stays, steps, "stays"), tmp_path / "a.png")
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
    subject = Subject.of(Certifier(Setup.of(scene, robot)), trajectory, (), "ends")
    assert subject.certificate.status is Status.IN_CONTACT
    plot.plot(subject, tmp_path / "a.png")
    assert_drawn(tmp_path / "a.png")


def titles(subject: Subject) -> set[str]:
    from hdplan.planner.pictures.sheet import sheet

    figure = sheet(subject)
    return {axis.get_title(loc="left").split(",")[0] for axis in figure.axes} - {""}


def test_a_panel_for_what_is_known_and_for_nothing_else(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    result.save(tmp_path / "a.json")
    loaded, steps = Trajectory.load(tmp_path / "a.json"), read_steps(tmp_path / "a.json")
    assert steps == result.steps
    certifier = Certifier(Setup.of(scene, robot))
    assert titles(Subject.of(certifier, loaded, steps, "a")) == {"joints", "clearance", "solver"}
    assert titles(Subject.of(certifier, loaded, (), "a")) == {"joints", "clearance"}
    timed = replace(loaded, times=np.linspace(0.0, 2.0, len(loaded)) ** 2)
    rates = {"velocity between waypoints", "acceleration at waypoints"}
    assert titles(Subject.of(certifier, timed, (), "a")) == {"joints", "clearance", *rates}
    assert read_steps(tmp_path / "a.csv") == ()


@pytest.mark.parametrize("steps", ["3", "[]", '{"cost": [1]}', '{"iteration": 1}', "{}"])
def test_steps_that_are_none_are_refused(tmp_path: Path, steps: str) -> None:
    (tmp_path / "a.json").write_text(f'{{"steps": {steps}}}')
    with pytest.raises(InputError, match=r"a\.json: steps: lists of numbers of equal length are expected"):
        read_steps(tmp_path / "a.json")


def test_rates_of_a_motion_that_speeds_up(planned: Planned) -> None:
    from hdplan.planner.pictures.quantities import differences

    _, robot, _ = planned
    times = np.array([0.0, 1.0, 3.0, 4.0])
    motion = Trajectory(robot.joint_names, np.stack([times**2, -times], axis=1), times=times)
    velocities, accelerations = differences(motion)
    np.testing.assert_allclose(velocities, [[1.0, -1.0], [4.0, -1.0], [7.0, -1.0]])  # a parabola's at the middles
    np.testing.assert_allclose(accelerations, [[2.0, 0.0], [2.0, 0.0]])


@pytest.mark.core
@pytest.mark.parametrize("name", ["planar_arm", "panda_cage"])
def test_the_planners_clearance_is_below_the_exact_one_and_that_not_below_the_proven(name: str) -> None:
    scene = load_scene(name)
    certifier = Certifier(Setup.of(scene))
    result = plan(scene)
    parameter = np.linspace(0.0, 1.0, 40)
    positions = result.trajectory.at(parameter)
    found = Clearances.along(certifier, result.trajectory.curve, parameter)
    singly = [certifier.nearest(q) for q in positions]
    np.testing.assert_array_equal(found.to_obstacles, [place.distance for place, _ in singly if place])
    np.testing.assert_array_equal(found.between_links, [place.distance for _, place in singly if place])
    assert (found.outer <= found.to_obstacles + 1e-9).all()
    assert result.certificate.clearance is not None
    assert found.to_obstacles.min() >= result.certificate.clearance


@pytest.fixture(scope="module")
def crossed(planned: Planned) -> tuple[Certifier, Trajectory]:
    """The arm swings past a box that drifts and turns, one with a clearance of its own, and a post that stands."""
    scene, robot, result = planned
    box = Box((0.2, 0.1, 0.1))
    drift = SteadyMotion((-0.2, 0.1, 0.0), (0.0, 0.0, 2.0))
    obstacles = (
        Obstacle("box", box, Pose((0.9, -0.5, 0.1)), motion=drift),
        Obstacle("wide", box, Pose((-0.4, 0.9, 0.1)), clearance=0.05, motion=SteadyMotion((0.3, 0.0, 0.0))),
        Obstacle("post", Sphere(0.1), Pose((0.0, 1.2, 0.1)), clearance=0.02),
    )
    limits = Limits(velocity=3.0, acceleration=(9.0, 7.0), torque=50.0)
    scene = replace(scene, obstacles=obstacles, limits=limits, timing=Timing(duration=3.0))
    motion, _ = Retimer(Setup.of(scene, robot))(result.trajectory)
    return Certifier(Setup.of(scene, robot)), motion


def test_clearance_meets_what_moves_where_it_is_at_that_time(crossed: tuple[Certifier, Trajectory]) -> None:
    certifier, motion = crossed
    scene, robot = certifier.scene, certifier.robot
    parameter = np.linspace(0.0, 1.0, 9)
    found = Clearances.along(certifier, motion.curve, parameter)
    for k, seconds in enumerate(motion.curve.time_of(parameter).tolist()):
        frozen = tuple(replace(o, pose=pose_at(o, seconds), motion=None) for o in scene.obstacles)
        still = replace(scene, obstacles=frozen, timing=None, limits=Limits())
        q = motion.curve.at_parameter(parameter[k : k + 1])
        place, _ = Certifier(Setup.of(still, robot)).nearest(q[0])
        assert place is not None
        assert found.to_obstacles[k] == pytest.approx(place.distance, abs=1e-9)
        assert found.outer[k] == pytest.approx(
            outer_clearance(Setup.of(still, robot), q, np.zeros(1), 2.0)[0], abs=1e-9
        )
        assert found.outer[k] <= found.to_obstacles[k] + 1e-9


def pose_at(obstacle: Obstacle, seconds: float) -> Pose:
    matrix = ObstacleMotion.of(obstacle).at(np.array([seconds]))[0]
    return Pose(tuple(matrix[:3, 3].tolist()), tuple(Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()))


def test_the_drawn_motion_is_the_curve(crossed: tuple[Certifier, Trajectory]) -> None:
    """Velocities, accelerations and torques are those of the executed curve, and the certificate's bound holds them."""
    from hdplan.planner.pictures.quantities import rates

    certifier, motion = crossed
    subject = Subject.of(certifier, motion, (), "a")
    drawn = {rate.quantity: rate for rate in rates(motion, certifier.limits)}
    uses = {use.quantity: use for use in subject.certificate.uses}
    assert set(drawn) == set(uses) == {"velocity", "acceleration", "torque"}
    for order, quantity in ((1, "velocity"), (2, "acceleration")):
        rate = drawn[quantity]
        wanted = motion.curve.over_time(order).at_parameter(motion.curve.parameter_of(rate.times))
        np.testing.assert_allclose(rate.values, wanted, rtol=0, atol=1e-6)
    model, velocities = Setup.of(certifier.scene, certifier.robot).loaded_model, drawn["velocity"].values
    at_rest = pin.computeGeneralizedGravity(model, model.createData(), certifier.robot.pin_q(motion.positions[:1])[0])
    assert np.abs(velocities[[0, -1]]).max() < 1e-9
    np.testing.assert_allclose(drawn["torque"].values[0], at_rest, atol=1e-6)
    for quantity, rate in drawn.items():
        assert rate.limits is not None
        largest = float((np.abs(rate.values) / rate.limits).max())
        assert 0.9 * uses[quantity].share <= largest <= uses[quantity].share + 1e-12


def test_a_curve_that_jumps_is_drawn_on_both_sides(crossed: tuple[Certifier, Trajectory]) -> None:
    from hdplan.planner.pictures.quantities import rates

    certifier, motion = crossed
    assert motion.times is not None
    assert motion.velocities is not None
    cubic = replace(motion, accelerations=None)
    (_, acceleration, _) = rates(cubic, certifier.limits)
    for row in (1, len(motion) // 2):
        here = acceleration.values[np.isclose(acceleration.times, motion.times[row], atol=1e-9)]
        jump = cubic.curve.over_time(2).jumps()[row]
        np.testing.assert_allclose(np.abs(here[1] - here[0]), jump, atol=1e-6)
    bare = replace(cubic, velocities=None)
    scene = replace(certifier.scene, limits=replace(certifier.scene.limits, torque=None))
    stairs, _ = rates(bare, Certifier(Setup.of(scene, certifier.robot)).limits)
    assert (stairs.where, len(stairs.values)) == (" between waypoints", len(motion) - 1)


def test_the_drawn_scene_has_what_moves_where_it_is_when_the_robot_is_there(
    crossed: tuple[Certifier, Trajectory],
) -> None:
    from hdplan.planner.pictures.scene import DRIFTING_PAINTS, STANDING_PAINT, Picture

    certifier, motion = crossed
    picture = Picture.of(Setup.of(certifier.scene, certifier.robot), motion)
    assert picture.moves
    assert sum(paint is STANDING_PAINT for _, paint in picture.solids) == 1
    for parameter, paint in DRIFTING_PAINTS:
        seconds = np.array([float(motion.curve.time_of(parameter))])
        shown = [body.vertices for body, found in picture.solids if found is paint]
        for vertices, obstacle in zip(shown, certifier.scene.obstacles, strict=False):
            place = ObstacleMotion.of(obstacle).at(seconds)[0]
            in_frame = (vertices - place[:3, 3]) @ place[:3, :3]
            np.testing.assert_allclose(np.abs(in_frame), np.tile([0.1, 0.05, 0.05], (len(vertices), 1)), atol=1e-9)
    panels = {"joints", "velocity", "acceleration", "torque", "clearance"}
    assert titles(Subject.of(certifier, motion, (), "a")) == panels


def test_names_are_written_as_they_are(planned: Planned, tmp_path: Path) -> None:
    scene, robot, result = planned
    scene = replace(scene, name="$\\frac$ " + 80 * "x")
    plot.plot(Subject.planned(Setup.of(scene, robot), result), tmp_path / "a.svg")
    assert (tmp_path / "a.svg").stat().st_size > 10_000


def test_unknown_ending_names_the_allowed_ones(planned: Planned, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.bmp.*\.png, \.pdf, \.svg"):
        plot.plot(planned_subject(planned), tmp_path / "a.bmp")
    assert not list(tmp_path.iterdir())


def test_nothing_half_written(planned: Planned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="folder"):
        plot.plot(planned_subject(planned), tmp_path / "missing" / "a.png")
    target = tmp_path / "a.png"
    target.write_bytes(b"before")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(InputError, match="No space left"):
        plot.plot(planned_subject(planned), target)
    assert target.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [target]


def test_missing_matplotlib_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install matplotlib"):
        plot.check_picture(tmp_path / "a.png")


def test_planning_does_not_import_matplotlib() -> None:
    code = "import sys, hdplan.planner.plan, hdplan.planner.pictures.plot; sys.exit('matplotlib' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
