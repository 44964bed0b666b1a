"""Laws of objectives: the winner is the best by its own measure, energy is the work of the torques, bounds are bounds,
and what cannot be compared is refused."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from hdplan import InputError, Limits, Payload, PlanResult, RobotSpec, Scene, Timing, Trajectory, build, plan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.kinematics.inverse_dynamics import dynamics_of
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.problem.assemble import assemble
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import goal_choice
from hdplan.planner.search.guesses import Guess
from hdplan.planner.search.objective import Energy
from hdplan.planner.search.search import Search
from hdplan.planner.solvers import solver_named
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.planner_settings import OBJECTIVES
from hdplan.scenes.yaml_format.reader import load_scene

from ..urdf import joint_text, link_text, write_robot

ENERGY = 1e-4  # [–] of the work, between sums over steps of 2 ms at most and of 0.05 ms
RATES = Limits(velocity="urdf", acceleration=15.0, jerk=500.0)


def asking(scene: Scene, objective: str | None, polish: int = 0) -> Scene:
    settings = dataclasses.replace(scene.planner, objective=objective, polish=polish)
    return dataclasses.replace(scene, planner=settings)


@pytest.fixture(scope="module")
def grasp() -> Scene:
    """Several goals, in time."""
    return dataclasses.replace(load_scene("panda_grasp"), limits=RATES)


def test_the_winner_is_the_best_by_its_own_measure_of_the_same_candidates(grasp: Scene) -> None:
    """One motion to each goal, timed; by each objective the least of them has the first rank, and no other's winner is
    better by it. No measure is below its bound."""
    certifier = Certifier(Setup.of(grasp))
    solver = solver_named("gauss_newton")
    found: dict[str, list[Search]] = {}
    for objective in OBJECTIVES:
        setup = Setup.of(asking(grasp, objective), certifier.robot)
        found[objective] = []
        for goal in goal_choice(certifier).goals:
            aim = setup.aiming_at(goal)
            problem = assemble(aim, aim.query, math.inf)
            search = Search(
                problem, certifier, Retimer(setup), solver, 0.0, math.inf, lambda event: None, lambda: False
            )
            search.attempt(Guess(problem.polyline()))
            found[objective].append(search)
    motions = [
        [search.best.trajectory.positions.tobytes() for search in searches if search.best]
        for searches in found.values()
    ]
    assert motions[0] == motions[1] == motions[2], "the objective compares motions, it does not change them"
    certified = [i for i, search in enumerate(found["time"]) if search.certified]
    assert len(certified) >= 2
    winners = {objective: min(certified, key=lambda i: searches[i].rank()) for objective, searches in found.items()}
    for objective, searches in found.items():
        own = searches[winners[objective]].value
        assert all(own <= searches[other].value for other in winners.values())
        assert all(own <= searches[i].value for i in certified)
        assert all((0.0, searches[i].objective.least(searches[i].problem)) <= searches[i].rank() for i in certified)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_rounds_make_it_no_worse_by_its_own_measure(grasp: Scene, objective: str) -> None:
    first, better = (plan(asking(grasp, objective, rounds)) for rounds in (0, 4))
    assert first.certified
    assert better.certified
    assert first.objective.name == better.objective.name == objective
    assert better.objective.value <= first.objective.value
    assert json.loads(json.dumps(better.summary()))["objective"] == better.objective._asdict()


@pytest.mark.parametrize(("scene", "objective"), [("panda_cage", "smoothness"), ("ur5_pallet", "time")])
def test_the_default_is_time_where_it_is_free_and_smoothness_elsewhere(scene: str, objective: str) -> None:
    default, stated = (plan(asking(load_scene(scene), each, polish=2)) for each in (None, objective))
    assert default.objective == stated.objective
    assert default.objective.name == objective
    assert default.trajectory.positions.tobytes() == stated.trajectory.positions.tobytes()


def test_with_a_fixed_duration_motions_differ_in_smoothness() -> None:
    scene = load_scene("panda_gate")
    assert scene.timing is not None
    assert scene.timing.duration is not None
    assert scene.objective == "smoothness"


# --- energy -------------------------------------------------------------------------------------------------------


def work(setup: Setup, motion: Trajectory) -> float:
    """Σ |τ·q̇| Δt by the planner's own recursive Newton-Euler algorithm, trapezoids of 0.05 ms."""
    curve = curve_of(setup.robot, motion)
    assert motion.times is not None
    times = np.linspace(motion.times[0], motion.times[-1], round(2e4 * (motion.times[-1] - motion.times[0])) + 1)
    q, v, a = (curve.at_time(times, order) for order in range(3))
    power = np.abs(dynamics_of(setup).torques(q, v, a) * v).sum(axis=1)
    return float(np.trapezoid(power, times))


def energy(setup: Setup, motion: Trajectory) -> float:
    return Energy(setup).value(motion.positions, motion)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["ur5_pallet", "ur5_payload", "panda_gate"])
def test_energy_is_the_work_of_the_torques(name: str) -> None:
    scene = asking(load_scene(name), "energy")
    setup, result = Setup.of(scene), plan(scene)
    assert result.objective.value == pytest.approx(work(setup, result.trajectory), rel=ENERGY)
    assert result.objective.value == energy(setup, result.trajectory)


def test_a_load_costs_energy_and_coming_back_costs_as_much_as_going(grasp: Scene) -> None:
    """Backwards in time velocities change their signs and torques do not."""
    motion = plan(grasp).trajectory
    assert motion.velocities is not None
    assert motion.accelerations is not None
    assert motion.times is not None
    back = dataclasses.replace(
        motion, positions=motion.positions[::-1], velocities=-motion.velocities[::-1],
        accelerations=motion.accelerations[::-1], times=motion.times[-1] - motion.times[::-1],
    )  # fmt: skip
    scene = asking(grasp, "energy")
    plain, loaded = (Setup.of(dataclasses.replace(scene, payload=load)) for load in (None, Payload("panda_hand", 3.0)))
    assert energy(plain, back) == pytest.approx(energy(plain, motion), rel=1e-9)
    assert energy(loaded, motion) > 1.1 * energy(plain, motion)
    loaded.scene.check_effects()  # a payload needs no limits of torque where energy is the objective


# --- what cannot be done ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"objective": "tim"}, r"objective: unknown value 'tim' \(did you mean 'time'\?\)"),
        ({"objective": 3}, r"objective: must be one of time, smoothness, energy, found"),
    ],
)
def test_values_that_are_none_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        dataclasses.replace(load_scene("panda_cage").planner, **changes)


@pytest.mark.parametrize(
    ("scene", "objective", "words"),
    [
        (load_scene("panda_cage"), "time", r"'time' .* limits\.acceleration is missing; allowed here: smoothness$"),
        (load_scene("panda_cage"), "energy", r"'energy' needs known times, .*allowed here: smoothness$"),
        (load_scene("panda_gate"), "time", r"'time' .* timing\.duration fixes it; allowed here: smoothness, energy$"),
    ],
)
def test_objectives_that_need_times_are_refused_without(scene: Scene, objective: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"^the scene made from {scene.name}: planner\.objective: {words}"):
        plan(asking(scene, objective))


def test_energy_is_refused_without_masses(tmp_path: Path) -> None:
    file = write_robot(
        tmp_path / "light.urdf", *map(link_text, ("base", "arm")), joint_text("turn", "base", "arm", effort=5)
    )
    scene = Scene("light", robot=RobotSpec(urdf=file), start=(0.0,), goal=(1.0,), timing=Timing(duration=2.0))
    result: PlanResult = plan(scene)
    assert result.certified
    with pytest.raises(InputError, match=r"light: planner\.objective: 'energy' .*joint 'turn' of light moves no mass"):
        plan(asking(scene, "energy"))
    with pytest.raises(InputError, match="moves no mass"):  # `hdplan explain` builds, and refuses it too
        build(asking(scene, "energy"))


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_a_file_keeps_it(tmp_path: Path, objective: str) -> None:
    scene = asking(load_scene("ur5_pallet"), objective)
    scene.save(tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml").planner == scene.planner
