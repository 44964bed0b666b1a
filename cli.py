"""The command line: its commands, their arguments and their help.

The work of each is a function of `planner.commands`, loaded when the command runs, so that help appears at once.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from hdplan.planner.terminal.interrupts import end_at_once

if __name__ == "__main__" or Path(sys.argv[0]).stem == "hdplan":  # as a program, not as a module of another one
    end_at_once()

import typer

from hdplan import __version__
from hdplan.planner.terminal import arguments as given
from hdplan.planner.terminal.console import printing
from hdplan.planner.terminal.declared import command
from hdplan.planner.terminal.session import run

app = typer.Typer(
    help="Plan motions of robot arms with smooth signed distances, and prove them free against the real meshes.",
    epilog="""\b
Examples:
  hdplan plan panda_cage -o motion.json --plot motion.png
  hdplan check panda_cage motion.json
  hdplan simulate panda_cage motion.json
  hdplan plot panda_cage motion.json -o motion.pdf
  hdplan follow panda_cage motion.json -o executed.json
  hdplan view panda_cage motion.json
  hdplan batch problems/ -o run
  hdplan sample panda_cage -n 1000 -o problems.csv
  hdplan explain my_scene.yaml
  hdplan codegen panda_cage -o panda_cage_c
  hdplan robots panda
  hdplan study distance --quick
  hdplan study planning --quick
  hdplan reproduce conservativeness

Shipped scenes are called by their bare names: baxter_bimanual_carry, baxter_handover, empty,
kinova_shelf, panda_bookshelf, panda_cable, panda_cage, panda_camera, panda_carry,
panda_conveyor, panda_corridor, panda_cup, panda_fold, panda_gate, panda_grasp, panda_heavy,
panda_person, panda_pick_place, panda_seam, panda_table_pick, panda_vase, planar_arm, pr2_shelf,
tiago_shelf, ur5_ceiling, ur5_pallet, ur5_palletize, ur5_payload, ur5_scan, ur5_table, xarm7_post.

Exit codes: 0 certified; 1 no certified motion was found (plan still writes its best attempt, marked as such), a
simulated motion failed, or a study was interrupted (its results so far are written, marked as such); 2 bad input;
3 an internal error; 4 a proof is accepted in part.""",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
studies = typer.Typer(help="Measure the gain and the cost of each setting.", rich_markup_mode=None)
figures = typer.Typer(
    help="Reproduce the paper's figures, beside its numbers.",
    rich_markup_mode=None,
)
app.add_typer(studies, name="study")
app.add_typer(figures, name="reproduce")


def _version(wanted: bool) -> None:
    if wanted:
        with printing() as show:
            show(f"hdplan {__version__}")
        raise typer.Exit()


@app.callback()
def hdplan(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Take the options that need no command."""


@command(app, "plan.run_plan")
def plan(
    scene: given.SceneFile,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
    output: given.Output = None,
    solver: given.Solver = "gauss_newton",
    distance: given.Distance = None,
    seed: given.Seed = 0,
    time_limit: given.TimeLimit = None,
    plot: given.Sheet = None,
    proof: given.ProofToWrite = None,
    diagnosed: given.Diagnose = False,
    watched: given.Watched = False,
    as_json: given.AsJson = False,
    quiet: given.Quiet = False,
) -> None:
    """Plan a motion from start to goal and prove it collision-free.

    The motion is smooth in joint space: straight between its waypoints, or with times, velocities and accelerations
    where the scene needs them. It is certified over its whole length, not only at samples, against the robot's
    collision meshes and the scene's own shapes. Where the proof fails, planning continues from there or from another
    guess, until the time limit.

    In a scene with a job, all stages are planned, one after the other; the exit code is 1 if one of them fails.

    Ctrl-C stops with the best motion found so far. With --view the optimizer's work appears in the browser, at the
    address that is written to standard error; files are written once the motion is found, and Ctrl-C ends the server.
    """


@command(app, "check.run_check")
def check(
    scene: given.SceneFile,
    trajectory: given.Motion,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
    as_json: given.AsJson = False,
) -> None:
    """Certify a joint trajectory, hdplan's or another planner's.

    Proves that the whole motion is collision-free and
    keeps the clearance that the scene requires, or locates the violation. Between its waypoints the motion is
    straight, or the curve that the file's velocities define. Its ends must be the scene's start and goal; its joints
    are matched by name. In a job, every stage is certified.
    """


@command(app, "prove.run_prove")
def prove(
    scene: given.SceneFile,
    trajectory: given.Motion,
    output: given.Proof,
    request: given.Request = None,
    robot: given.RobotFile = None,
) -> None:
    """Write a proof that a motion is free, for others to check.

    Certifies the motion and writes separating planes for every pair of bodies along it. `hdplan verify`, or
    `python -m hdplan.verify`, checks the file against scene, robot and motion without any code of hdplan. A job has one
    proof of all its stages.

    The exit code is 1 if the motion is not certified, or if no planes are found.
    """


@command(app, "verify.run_verify")
def verify(
    scene: given.SceneFile,
    trajectory: given.Motion,
    proof: given.ProofToCheck,
    request: given.Request = None,
    robot: given.RobotFile = None,
    world: given.World = None,
) -> None:
    """Check the proof of a motion without any code of hdplan.

    The checker reads scene, robot, meshes and motion by itself into a world of plain numbers, which must equal the
    world of the proof, and then checks the proof in outward-rounded arithmetic. The output lists the proven claims and
    the assumptions, or the pair of bodies, the place and the reason of a failure.

    The exit code is 1 if the proof is rejected, 4 if it is accepted in part, as the scene requires more.
    """


@command(app, "follow.run_follow")
def follow(
    scene: given.SceneFile,
    trajectory: given.Motion,
    output: given.Executed = None,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
    rate: given.BarrierRate = None,
    margin: given.Margin = None,
    limits: given.JointLimit = None,
    as_json: given.AsJson = False,
) -> None:
    """Follow a joint trajectory and avoid obstacles on the way.

    A controller keeps the robot clear of obstacles, moving ones too, of itself and of its joint limits, and as close to
    the trajectory as that allows; the trajectory waits while the robot is delayed. The executed motion, with its times,
    is certified against the moving obstacles; `hdplan view` plays it and `hdplan check` reads it.

    Commands keep the scene's limits of velocity, acceleration and jerk; without a limit of acceleration, joints reach
    their greatest speed in 0.2 s at the soonest.

    The exit code is 1 if the robot does not arrive, or if its motion is not proven collision-free.
    """


@command(app, "simulate.run_simulate")
def simulate(
    scene: given.SceneFile,
    trajectory: given.Motion,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
    plot: given.RatesSheet = None,
    plant: given.Plant = None,
    as_json: given.AsJson = False,
) -> None:
    """Replay a joint trajectory, with or without dynamics.

    Without `limits.torque` in the scene the replay is kinematic: the motion is sampled a thousand times a second, as by
    a controller. With torque limits the robot and its loads are simulated under computed-torque control, with torques
    clipped at their limits.

    With --plant a body in MuJoCo executes the motion, each joint turned by a drive with its own servo. The tracking
    error is shown as `robot.tracking`, and a scene with this section can then be proven.

    In a job, each stage is replayed, or executed, in its own scene; fingers are only replayed.

    The exit code is 1 if tracking is lost or worse than the scene's `robot.tracking`, if a limit is exceeded, or if
    there is contact.
    """


@command(app, "plot.run_plot")
def plot(
    scene: given.SceneFile,
    trajectory: given.Motion,
    output: given.Picture,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
) -> None:
    """Draw a joint trajectory on one sheet.

    The trajectory may be hdplan's or another planner's. The sheet shows the joints with their limits, velocities and
    accelerations if the file has times, the clearance along the motion with its proven bound, the solver's progress if
    the file holds it, and the scene from two sides. The exit code is 0 for every verdict.
    """


@command(app, "view.run_view")
def view(
    scene: given.SceneFile,
    trajectories: given.Motions = None,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
    proof: given.ProofToShow = None,
    record: given.Page = None,
    video: given.Film = None,
    host: given.Host = None,
    port: given.Port = None,
    share: given.Share = False,
) -> None:
    """Show a scene and motions in the browser, and plan there.

    Drag an obstacle or the goal, press Plan and watch the optimizer at work. Needs viser (pip install viser).
    --record and --video write files instead, without viser.

    Ctrl-C stops the server.
    """


@command(app, "explain.run_explain")
def explain(
    scene: given.SceneFile,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
    as_json: given.AsJson = False,
) -> None:
    """Explain the planning problem of a scene.

    Lists the joints with start, goal and limits; which terms are on and off, and why; the bodies around links and
    obstacles; which pairs are checked and which are excluded; the unknowns; and the settings, with defaults in force.
    """


@command(app, "robots.run_robots")
def robots(
    robot: given.RobotName = None,
    xacro_arg: given.XacroArguments = None,
    srdf: given.SrdfFile = None,
    as_json: given.AsJson = False,
) -> None:
    """List the robots known by name, or show one of them.

    For one robot: its joints with limits, joints held fixed, groups, end effectors, named states, and how tightly its
    outer bodies fit. The bodies are fitted once and kept; the first time this takes some seconds.
    """


@command(app, "batch.run_batch")
def batch(
    sources: given.Sources = None,
    output: given.Run = None,
    scene: given.TableScene = None,
    workers: given.Workers = None,
    scheduler: given.Scheduler = None,
    cluster: given.Cluster = None,
    solver: given.Solver = "gauss_newton",
    seed: given.Seed = 0,
    time_limit: given.EachTimeLimit = 60.0,
    motions: given.MotionsAs = "parquet",
    proofs: given.Proofs = False,
    diagnosed: given.Diagnose = False,
    export: given.Export = None,
    fps: given.Rate = 30,
    plot: given.RunSheet = None,
    report: given.Report = None,
) -> None:
    """Plan many problems on every core, or on a cluster.

    A source is a scene file or a pattern of them, a folder (with MoveIt's pairs scene*.yaml and request*.yaml, and
    robot.yaml beside or above), or a table whose rows vary one scene (--scene; `hdplan sample` writes one). Results are
    written as they arrive; the same command resumes an interrupted run. A problem that crashes or hangs does not affect
    the others.

    Writes results.parquet (a row per problem) and motions.parquet into the folder, and prints a report. The exit code
    is 1 if some problem is not certified.

    Ctrl-C stops and keeps the results so far.
    """


@command(app, "batch.run_sample")
def sample(
    scene: given.SceneFile,
    output: given.TableFile,
    count: given.Count = 100,
    seed: given.ProblemSeed = 0,
    goal: given.GoalKind = "joints",
    jitter: given.Jitter = 0.0,
    resize: given.Resize = 0.0,
) -> None:
    """Draw random problems in a scene.

    Starts and goals are free, with the scene's clearance, and keep its path constraints. Writes a table with a row for
    each problem and a column for each field in which they differ from the scene; `hdplan batch` plans them.
    """


@command(app, "codegen.run_codegen")
def codegen(
    scene: given.SceneFile,
    output: given.NewFolder,
    request: given.Request = None,
    robot: given.RobotFile = None,
    xacro_arg: given.XacroArguments = None,
    as_json: given.AsJson = False,
) -> None:
    """Write a scene as C99 without dependencies, for a control loop.

    Forward kinematics of all links, the distance of every pair of bodies with its gradient, and the planner's penalty;
    the poses of all obstacles are inputs. Nothing is allocated, and the time of a call is bounded. A test program
    compares a hundred configurations with hdplan's own numbers.
    """


@command(app, "schema.run_schema")
def schema() -> None:
    """Print the scene format as a JSON Schema, for editors.

    The schema lists the keys of a scene, with the types and ranges of their values.
    """


@command(studies, "studies.run_distance_study")
def distance(output: given.Folder = given.STUDY_FOLDER, quick: given.Quick = False) -> None:
    """Measure the cost in time of an accurate distance.

    For every set of normals, order, shaping length and precision: the share of gaps reported as contact, the error
    against the exact distance, and the time per value, gradient and Hessian. Writes distance_study.csv, .md and .png,
    and recommends a setting. Takes a while; Ctrl-C stops and keeps the results so far.
    """


@command(studies, "studies.run_planning_study")
def planning(
    output: given.Folder = given.STUDY_FOLDER,
    quick: given.Quick = False,
    problems: given.Problems = None,
    every: given.Every = 10,
) -> None:
    """Measure the cost in time of accuracy in planning.

    One setting at a time is changed from the defaults on the shipped scenes: link bodies, normals, gamma, shaping
    length, waypoints, samples or swept bodies between them, solver. The results are the certified problems, the
    clearance lost to conservativeness, smoothness and time. Writes planning_study.csv, .md and .png. Takes a quarter of
    an hour; Ctrl-C stops and keeps the results so far.
    """


@command(figures, "studies.run_figure", name="time")
def time(output: given.Folder = given.STUDY_FOLDER, quick: given.Quick = False) -> None:
    """Time exact distances, GDF and the HD-SDF.

    Over all pairs of Platonic solids: exact by FCL and by coal; the HD-SDF by the interpreter, compiled, and in
    batches. Writes time.csv and time.png.
    """


@command(figures, "studies.run_figure", name="conservativeness")
def conservativeness(output: given.Folder = given.STUDY_FOLDER, quick: given.Quick = False) -> None:
    """Count how often a gap is taken for contact.

    Over 500,000 random configurations of Platonic solids, for the paper's set of normals and all other sets. Writes
    conservativeness.csv and conservativeness.png.
    """


@command(figures, "studies.run_figure", name="corridor")
def corridor(output: given.Folder = given.STUDY_FOLDER, quick: given.Quick = False) -> None:
    """Steer a Panda made of boxes into a corridor, with each distance.

    The paper's robot experiment: the same controller with the exact distance, the GDF and the HD-SDF, with the text's
    parameters and with its published code's; then one setting changed at a time, and which of them are safe. Writes
    corridor.csv, corridor_commands.csv, corridor_settings.csv and corridor.png. Takes some minutes; Ctrl-C stops
    and keeps the results so far.
    """


@command(figures, "studies.run_kinks")
def kinks(output: given.Folder = given.STUDY_FOLDER) -> None:
    """Follow the distances of two squares that pass each other.

    The Euclidean distance has kinks there and the HD-SDF has none. Writes kinks.csv and kinks.png: both over time, with
    their derivatives.
    """


def main() -> None:
    """Run the command line and end with its exit code."""
    run(app)


if __name__ == "__main__":
    main()
