"""`hdplan simulate`: replay a motion, or the stages of a job, with dynamics where the scene limits torques."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from rich.text import Text

from hdplan.planner.control.simulation import Plant, fitting, replay
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.plot import check_picture, plot_simulation
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.tables import rates_table, simulation_rows, table, torques_table
from hdplan.scenes.errors import InputError, naming

MUJOCO, MODELS = "mujoco", (".xml", ".mjcf")  # plants: of hdplan's robot, or of a file


def run_simulate(scene: GivenScene, trajectory: Path, *, plot: Path | None, plant: str | None, as_json: bool) -> int:
    """Replay a motion, executed by a plant if one is named. Returns the exit code: 0 if it succeeds, else 1."""
    if plot is not None:
        check_picture(plot)
    body = None if plant is None else _plant(plant)
    problem = scene.load()
    if problem.job is not None:
        from hdplan.planner.commands.job import refuse_options, run_simulate_job

        refuse_options({"--plot": plot})
        return run_simulate_job(problem, trajectory, body, plant_name=plant, as_json=as_json)
    motion = Trajectory.load(trajectory)
    setup = Setup.of(problem)
    arm = setup.robot
    with naming(trajectory):
        fitting(setup, motion, body)
    with waiting("simulating", shown=not as_json):
        simulation = replay(setup, motion, body)
        if plot is not None:
            with naming(trajectory):  # it may have no times
                plot_simulation(simulation, f"{trajectory.name} in {problem.name}", plot)
    with printing() as show:
        if as_json:
            about = {"plant": plant, "scene": problem.name, "robot": arm.name, "trajectory": str(trajectory)}
            show(json.dumps({**simulation.summary(), **about}))
        else:
            show(Text(simulation.text, style="green" if simulation.succeeded else "red"))
            written = [] if plot is None else [("written", str(plot))]
            notes = [("note", note) for note in setup.notes]
            show(table([*simulation_rows(simulation, problem, arm.name), *notes, *written]))
            show(rates_table(simulation.joints))
            if simulation.execution is not None:
                show(torques_table(simulation.joints))
    return 0 if simulation.succeeded else 1


def _plant(name: str) -> Plant:
    """Return the body in MuJoCo that executes a motion, of hdplan's robot or of a model file."""
    if name != MUJOCO and Path(name).suffix.lower() not in MODELS:
        raise InputError(f"--plant: must be '{MUJOCO}' or a MuJoCo model file ({', '.join(MODELS)}), found '{name}'")
    from hdplan.planner.control.mujoco_arm import execute_in_mujoco

    return partial(execute_in_mujoco, model=None if name == MUJOCO else Path(name))
