"""The paper's robot experiment: its bodies, its task, its claim, and what is written of it."""

from __future__ import annotations

import csv
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdplan import InputError, Obstacle, Pose, Sphere, SteadyMotion
from hdplan.control import BarrierSettings, Controller, ControlSettings, standing
from hdplan.planner.control.rollout import fast_energy, simulate, total_variation
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.studies import paper_corridor as reproduce_corridor
from hdplan.planner.studies.corridor_experiment import (
    AS_SAFE,
    EXACT_EVERY,
    NAMES,
    START,
    TARGET,
    TOOL,
    VARIANTS,
    Outcome,
    corridor_scene,
    link_boxes,
    run_variant,
    sweep,
    tool_task,
)
from hdplan.scenes.array_types import Array


@pytest.fixture(scope="module")
def exact() -> Outcome:
    return run_variant(VARIANTS[0], 3.0)


@pytest.fixture(scope="module")
def smooth() -> Outcome:
    return run_variant(VARIANTS[NAMES.index(AS_SAFE)], 3.0)


def moved(axis: str, angle: float, way: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    c, s, matrix = np.cos(angle), np.sin(angle), np.eye(4)
    matrix[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]] if axis == "x" else [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    matrix[:3, 3] = way
    return matrix


def published_frames(q: Array) -> list[Array]:
    """The Denavit-Hartenberg frames of the published robot."""
    half = np.pi / 2
    table = (
        (0.333, -half, 0.0), (0.0, half, 0.0), (0.316, half, 0.0825), (0.0, -half, -0.0825), (0.384, half, 0.0),
        (0.0, half, 0.088), (TOOL, 0.0, 0.0),
    )  # fmt: skip
    frames = [np.eye(4)]
    for angle, (along, twist, across) in zip(q.tolist(), table, strict=True):
        frames.append(frames[-1] @ moved("z", angle, (0, 0, along)) @ moved("x", twist) @ moved("x", 0, (across, 0, 0)))
    return frames[1:]


BALL = Obstacle("ball", Sphere(0.08), Pose((0.35, -0.45, 0.6)), motion=SteadyMotion((0.0, 0.2, 0.0)))
READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("barriers", [BarrierSettings(), BarrierSettings("euclidean")], ids=["hdsdf", "euclidean"])
@pytest.mark.parametrize("passing", [False, True], ids=["between walls", "a ball that comes"])
def test_limits_of_acceleration_make_commands_no_rougher(barriers: BarrierSettings, passing: bool) -> None:
    """Once under way, commands vary about as without limits. By rows of where the arm would come to rest alone they
    shook at the greatest jerk: with 15 to 60 times the variation and thousands of times the energy above 5 Hz."""
    scene = corridor_scene()
    begin, found = START, []
    if passing:
        begin, scene = READY, replace(scene, obstacles=(BALL,))
    for rise in (0.0, ControlSettings().rise):
        controller = Controller.of(scene, ControlSettings(barriers, rise=rise))
        task = standing(np.array(begin)) if passing else tool_task(controller.robot)
        run = simulate(controller, np.array(begin), task, 2.5, until_met=False)
        commands = run.velocities[round(0.25 / run.period) :]
        found.append((total_variation(commands), fast_energy(commands, run.period)))
    assert (np.array(found[1]) <= np.array(found[0]) * (1.2, 2.0)).all()


def test_boxes_stand_where_the_published_ones_do() -> None:
    rng = np.random.default_rng(0)
    robot = load_scene_robot(corridor_scene())
    boxes = (
        (1, moved("x", 0), (0.112, 0.112, 0.28)),
        (2, moved("x", 0, (0, 0, 0.18)), (0.1106, 0.1106, 0.25)),
        (3, moved("x", 0), (0.1092, 0.1092, 0.24)),
        (4, moved("x", 0, (0, 0, 0.13)), (0.1092, 0.1092, 0.2)),
        (5, moved("x", -np.pi / 2, (0, -0.103, -0.09)) @ moved("x", -0.24), (0.08, 0.05, 0.23)),
        (5, moved("x", 0, (0, 0, -0.03)), (0.102, 0.102, 0.198)),
        (6, moved("x", 0, (0, 0, 0.02)), (0.09, 0.09, 0.21)),
        (7, moved("z", -np.pi / 4, (0, 0, -0.05)), (0.05, 0.21, 0.1)),
        (7, moved("x", 0, (0.03, 0.03, -0.095)), (0.1, 0.09, 0.034)),
    )
    for q in robot.draw(rng, 3):
        frames, state = published_frames(q), kinematics_of(robot).evaluate(q)
        for (joint, place, sides), body in zip(boxes, link_boxes(), strict=True):
            world = body.body.vertices @ state.rotations[0, body.joint].T + state.translations[0, body.joint]
            pose = frames[joint - 1] @ place
            local = (world - pose[:3, 3]) @ pose[:3, :3]
            expected = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * sides
            np.testing.assert_allclose(sorted(local.round(9).tolist()), sorted(expected.round(9).tolist()), atol=1e-8)
        tool = frames[6] @ moved("z", -np.pi / 4)
        np.testing.assert_allclose(tool_task(robot).at(q), tool, atol=1e-9)


def test_the_task_is_its_own_gradient() -> None:
    """f is half the gradient of K r·r by the joints, plus nothing: by finite differences of r."""
    robot = load_scene_robot(corridor_scene())
    task = tool_task(robot)

    def residual(q: Array) -> Array:
        tool = task.at(q)
        return np.append(tool[:3, 3] - TARGET[:3, 3], 1.0 - (tool[:3, :3] * TARGET[:3, :3]).sum(axis=0))

    for q in robot.draw(np.random.default_rng(1), 5):
        jacobian = np.stack(
            [(residual(q + 1e-6 * unit) - residual(q - 1e-6 * unit)) / 2e-6 for unit in np.eye(7)], axis=1
        )
        hessian, linear = task.objective(q, 0.0)
        np.testing.assert_allclose(hessian, jacobian.T @ jacobian + 0.01 * np.eye(7), atol=1e-7)
        np.testing.assert_allclose(linear, 0.4 * jacobian.T @ residual(q), atol=1e-7)


def test_the_euclidean_distance_chatters_and_the_hd_sdf_does_not(exact: Outcome, smooth: Outcome) -> None:
    assert exact.variation(3.0, -1) >= 10.0 * smooth.variation(3.0, -1)
    assert exact.variation(3.0) >= 10.0 * smooth.variation(3.0)
    assert exact.energy(3.0, -1) >= 100.0 * smooth.energy(3.0, -1)
    assert exact.jumps.sum() > 10
    assert smooth.jumps.sum() == 0
    for outcome in (exact, smooth):  # on their way, and free
        assert outcome.missing < 0.6
        assert outcome.clearances.min() > 0.02
        assert outcome.between_links.min() > 0.0
        assert outcome.mesh_clearance > 0.0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("turn", [0.0, 0.12])
def test_fitted_bodies_are_commanded_as_smoothly_as_by_the_exact_distance(turn: float) -> None:
    """Walls parallel and turned, our controller and its defaults, at about the same clearance."""
    place, robot = corridor_scene(), load_scene_robot(corridor_scene())
    walls = []
    for number, wall in enumerate(place.obstacles):
        half = 0.5 * turn * (-1) ** number  # the walls away from each other
        pose = Pose(wall.pose.position, (0.0, 0.0, float(np.sin(half)), float(np.cos(half))))
        walls.append(replace(wall, pose=pose))
    scene = replace(place, obstacles=tuple(walls))
    ours = ControlSettings(period=0.01)
    fitted = Controller.of(scene, ours, robot)
    bare = BarrierSettings("euclidean", growth=0.0, self_growth=0.0)
    exact = Controller.of(scene, replace(ours, barriers=bare, margin=0.02, self_margin=1e-4), robot)
    seconds, runs, clearances = 4.0, [], []
    for controller in (fitted, exact):
        run = simulate(controller, np.array(START), tool_task(robot), seconds, until_met=False)
        seen = [exact.barriers.evaluate(q).value[: exact.barriers.obstacle_pairs].min() for q in run.positions[::10]]
        runs.append(run)
        clearances.append(min(seen))
    assert clearances[0] == pytest.approx(clearances[1], abs=0.005)
    assert clearances[0] < 0.04  # the walls are near
    assert total_variation(runs[0].velocities) <= 1.1 * total_variation(runs[1].velocities)
    assert fast_energy(runs[0].velocities, 0.01) <= 2.0 * fast_energy(runs[1].velocities, 0.01)


def test_the_clearance_proven_of_a_margin_holds_and_the_published_setting_is_refused(smooth: Outcome) -> None:
    proven = smooth.variant.clearance
    assert proven is not None
    assert smooth.run.slacks.min() >= 0.0
    assert smooth.clearances.min() >= proven
    by_name = dict(zip(NAMES, VARIANTS, strict=True))
    assert "lets bodies touch" in (by_name["HD-SDF, code"].refused or "")
    assert by_name["HD-SDF, text"].refused is None
    flat = [variant for words, variant in sweep() if words == "δ 0 mm"]
    assert "flat spot" in (flat[0].refused or "")
    with pytest.raises(InputError, match="control"):
        replace(by_name["HD-SDF, code"].settings, as_published=False)


def test_the_controller_that_looks_ahead_does_the_same_here() -> None:
    variant = VARIANTS[NAMES.index(AS_SAFE)]
    settings = replace(variant.settings, look_ahead=True)
    assert isinstance(settings, ControlSettings)
    plain, careful = (run_variant(replace(variant, settings=each), 0.5) for each in (variant.settings, settings))
    np.testing.assert_allclose(plain.run.positions, careful.run.positions, atol=1e-9)
    np.testing.assert_array_equal(plain.run.positions[0], START)
    assert callable(simulate)


def test_report(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(reproduce_corridor, "VARIANTS", tuple(VARIANTS[k] for k in (0, NAMES.index(AS_SAFE))))
    monkeypatch.setattr(reproduce_corridor, "NAMES", (NAMES[0], AS_SAFE))
    for name, seconds in (("CRITICAL_PHASE", 0.3), ("DURATION", 0.4), ("SWEPT", 0.2)):
        monkeypatch.setattr(reproduce_corridor, name, seconds)
    changes = sweep()[:8:4]  # the base, and one that is refused
    monkeypatch.setattr(reproduce_corridor, "sweep", lambda: changes)
    seen: list[str] = []
    found = reproduce_corridor.reproduce_corridor(
        tmp_path, False, lambda done, of, what: seen.append(f"{done} {of} {what}"), lambda: False
    )
    assert found.complete
    assert len(seen) == 2 + len(changes)
    assert found.notes[0][0] == "claim"
    assert {path.name for path in found.files} == {path.name for path in tmp_path.iterdir()}
    with (tmp_path / "corridor.csv").open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert [line["distance"] for line in lines] == ["Euclidean", AS_SAFE]
    assert all(float(line["clearance_boxes_m"]) > 0 for line in lines)
    with (tmp_path / "corridor_settings.csv").open(encoding="utf-8") as file:
        rules = {line["setting"]: line["rule"] for line in csv.DictReader(file)}
    assert rules["δ 0 mm"] == "refused"
    assert "safe" in rules.values()
    with pytest.raises(KeyboardInterrupt):
        reproduce_corridor.reproduce_corridor(tmp_path, True, lambda *_: None, lambda: True)


def test_the_picture_says_how_many_times_and_is_not_cut_off(exact: Outcome, smooth: Outcome) -> None:
    pytest.importorskip("matplotlib")
    from matplotlib.text import Text

    from hdplan.planner.studies.corridor_sheet import corridor_sheet

    figure = corridor_sheet([exact, smooth])
    figure.draw_without_rendering()
    assert "times as much" in figure.get_suptitle()
    for text in figure.findobj(Text):
        box = text.get_window_extent()
        assert not text.get_text() or figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1, text.get_text()


def test_the_snapshots_show_where_the_nearest_points_are(exact: Outcome) -> None:
    pytest.importorskip("matplotlib")
    from hdplan.planner.studies.corridor_snapshots import SNAPSHOT_INTERVAL, arm_sheet, witness_sheet, witnesses

    every = round(EXACT_EVERY / exact.run.period)
    for sample in (0, 40, 100):
        found = witnesses(exact.run.positions[sample * every])
        gap = float(np.linalg.norm(found.points[0] - found.points[1]))
        assert gap == pytest.approx(exact.clearances[sample], abs=1e-6)
    assert f"Within {1e3 * SNAPSHOT_INTERVAL:.0f} ms" in witness_sheet(exact).get_suptitle()
    assert len(arm_sheet(exact).axes) == 2
