"""The command line: parse, call the library, print.

Exit codes: 0 certified, 1 nothing certified was found, 2 bad input, 3 a fault of hdplan itself, 130 interrupted before
there was anything to show, 143 terminated.
Results go to the output stream; errors, one line each, and progress go to the error stream.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import math
import os
import signal
import sys
import threading
import traceback
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from hdplan.planner.terminal.console import measuring, printing, progress, say, waiting
from hdplan.planner.terminal.tables import (
    closest_rows,
    columns,
    limit_rows,
    rates_table,
    result_rows,
    simulation_rows,
    table,
    torques_table,
    verdict_text,
)
from hdplan.scenes.deadline import time_limit as limited
from hdplan.scenes.errors import HdplanError, InputError, OutOfTime, naming

if TYPE_CHECKING:
    from hdplan.planner.studies.report import Report
    from hdplan.scenes.model import Scene

SEARCH = 30.0  # [s] for solving and certifying, where no time limit is given
INTERNAL = 3
INTERRUPTED, TERMINATED = 130, 143  # what shells say of a command ended by Ctrl-C, or by `kill`
TyperError: type[Exception] = typer.BadParameter.__mro__[2]  # ClickException, wherever this Typer keeps its click

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
  hdplan explain my_scene.yaml
  hdplan robots panda
  hdplan study distance --quick
  hdplan study planning --quick
  hdplan reproduce conservativeness

Shipped scenes go by their bare names: empty, kinova_shelf, panda_bookshelf,
panda_cable, panda_cage, panda_carry, panda_conveyor, panda_corridor, panda_cup,
panda_fold, panda_grasp, panda_heavy, panda_table_pick, panda_vase, planar_arm,
ur5_ceiling, ur5_pallet, ur5_payload, ur5_scan, ur5_table, xarm7_post.

Exit codes: 0 certified; 1 nothing certified was found (plan still writes its best attempt, marked as such), a
simulated motion failed, or a study was interrupted (what it had found is written, marked as such); 2 bad input;
3 a fault of hdplan itself.""",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
studies = typer.Typer(help="Measure what a setting gives and what it costs.", rich_markup_mode=None)
figures = typer.Typer(
    help="Make the paper's figures again, beside what it says.",
    rich_markup_mode=None,
)
app.add_typer(studies, name="study")
app.add_typer(figures, name="reproduce")


def _whole_number(text: str) -> int:
    with contextlib.suppress(ValueError):
        if (number := int(text)) >= 0:
            return number
    raise typer.BadParameter(f"must be a whole number of at least 0, found '{text}'")


def _port(text: str) -> int:
    with contextlib.suppress(ValueError):
        if 1 <= (number := int(text)) <= 65535:
            return number
    raise typer.BadParameter(f"must be a port from 1 to 65535, found '{text}'")


def _seconds(text: str) -> float:
    with contextlib.suppress(ValueError):
        if 0.0 < (number := float(text)) < math.inf:
            return number
    raise typer.BadParameter(f"must be a finite number of seconds greater than 0, found '{text}'")


SceneFile = Annotated[
    str,
    typer.Argument(metavar="SCENE", help="A hdplan scene (YAML), a shipped scene's name, or a MoveIt planning scene."),
]
Motion = Annotated[
    Path,
    typer.Argument(metavar="TRAJECTORY", help="JSON, CSV (joint names in its header) or NPZ, from any planner."),
]
Request = Annotated[
    Path | None,
    typer.Option("--request", metavar="FILE", help="Motion plan request that goes with a MoveIt planning scene."),
]
RobotFile = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="NAME|FILE",
        help="Robot that supplies or replaces the scene's: a name from `hdplan robots`, or a YAML file with a `robot` "
        "section.",
    ),
]
Folder = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="FOLDER", help="Where the files go; made if it is not there."),
]
Quick = Annotated[bool, typer.Option("--quick", help="Measure less of it, in about a minute.")]
OUT = Path("out")
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]


@app.command()
def plan(
    scene: SceneFile,
    request: Request = None,
    robot: RobotFile = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write the trajectory: .json, .csv, .npz, .joint_trajectory.yaml, .robot_trajectory.yaml (messages of "
            "ROS and MoveIt) or .mcap (a ROS 2 bag).",
        ),
    ] = None,
    solver: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="gauss_newton (exact derivatives, banded), chomp (covariant gradient descent) or ipopt (interior "
            "point, exact Hessians).",
        ),
    ] = "gauss_newton",
    distance: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Distance that the penalty takes: hdsdf, or fcl (exact, Euclidean); by default what the scene says.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the random first guesses.", parser=_whole_number)] = 0,
    time_limit: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Time for all of it, reading and building included. Without it solving and certifying take at most "
            f"{SEARCH:g} s, all attempts together.",
            parser=_seconds,
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw scene, joints, clearance and convergence, as .png, .pdf or .svg."),
    ] = None,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Plan a motion from start to goal and prove it free.

    The motion is smooth in joint space: straight between its waypoints, or with times, velocities and accelerations
    where the scene asks for them. It is certified over its whole course, not at samples, against the robot's collision
    meshes and the scene's own shapes. Where the proof fails, planning goes
    on there, or from another guess, until the time limit.

    Ctrl-C ends with the best motion found so far.
    """
    from hdplan.planner.motion.trajectory_files import check_output
    from hdplan.planner.pictures.plot import Subject, check_picture
    from hdplan.planner.pictures.plot import plot as draw
    from hdplan.planner.plan import plan as find
    from hdplan.planner.problem.lay_out import check_distance
    from hdplan.planner.robot.scene_robot import load_scene_robot
    from hdplan.planner.solvers import solver_named

    solver_named(solver)
    if distance is not None:
        check_distance(distance)
    if output is not None:
        check_output(output)
    if plot is not None:
        check_picture(plot)
    with limited(time_limit):
        problem = _load(scene, request, robot)
        if distance is not None:
            problem = replace(problem, planner=replace(problem.planner, distance=distance))
        with progress(problem.planner, shown=not quiet and not as_json) as (report, stop):
            longest = SEARCH if time_limit is None else time_limit
            result = find(problem, solver=solver, seed=seed, time_limit=longest, report=report, stop=stop)
    if output is not None:
        result.save(output)
    if plot is not None:
        draw(Subject.planned(problem, load_scene_robot(problem), result), plot)
    if not quiet:
        with printing() as show:
            if as_json:
                show(json.dumps(result.summary()))
            else:
                show(verdict_text(result.certificate))
                show(table(result_rows(result, [str(file) for file in (output, plot) if file is not None])))
    raise typer.Exit(0 if result.certified else 1)


@app.command()
def check(
    scene: SceneFile,
    trajectory: Motion,
    request: Request = None,
    robot: RobotFile = None,
    as_json: AsJson = False,
) -> None:
    """Certify a joint trajectory, ours or another planner's.

    Proves that the whole motion is free and keeps the clearance that the scene asks for, or says where it does not:
    straight lines between the waypoints, or the curve that the file's velocities say. Its ends must be the scene's
    start and goal; its joints are found by name.
    """
    from hdplan.planner.certificate.certifier import Certifier
    from hdplan.planner.motion.trajectory import Trajectory
    from hdplan.planner.result import how_long, verdict
    from hdplan.planner.robot.scene_robot import load_scene_robot, notes_on

    problem = _load(scene, request, robot)
    motion = Trajectory.load(trajectory)
    certifier = Certifier(problem, load_scene_robot(problem))
    with naming(trajectory):  # its joints may not fit
        certificate = certifier.certify(motion)
    notes = [*notes_on(problem, certifier.robot), *certificate.notes]
    with printing() as show:
        if as_json:
            about = {
                "status": certificate.status.value,
                "text": certificate.text,
                "scene": problem.name,
                "robot": certifier.robot.name,
                "trajectory": str(trajectory),
                "joint_names": list(motion.joint_names),
                "waypoints": len(motion),
                **how_long(motion),
                "notes": notes,
            }
            times = {"certify": round(certificate.seconds, 6)}
            show(json.dumps({**about, **verdict(certificate), "time_s": times}))
        else:
            show(verdict_text(certificate))
            effort = (
                f"{certificate.configurations} configurations, {certificate.exact_calls} exact distances, "
                f"{certificate.seconds:.2f} s"
            )
            motion_row = ("motion", f"{motion.extent} of {certifier.robot.name} in {problem.name}")
            rows = [motion_row, *closest_rows(certificate), *limit_rows(certificate), ("proof", effort)]
            show(table([*rows, *(("note", note) for note in notes)]))
    raise typer.Exit(0 if certificate.certified else 1)


@app.command()
def follow(
    scene: SceneFile,
    trajectory: Motion,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write the executed motion, in any format of plan -o."),
    ] = None,
    request: Request = None,
    robot: RobotFile = None,
    as_json: AsJson = False,
) -> None:
    """Follow a joint trajectory, giving way to what comes.

    A controller keeps the robot clear of obstacles, moving ones too, of itself and of its joint limits, and as close to
    the trajectory as that allows; the trajectory waits while it is held up. The executed motion, with its times, is
    certified against the moving obstacles; `hdplan view` plays it and `hdplan check` reads it.

    Exit code 1 where the robot does not arrive, or is not proven free all the way.
    """
    from hdplan.planner.control.follow import follow as run
    from hdplan.planner.motion.trajectory import Trajectory
    from hdplan.planner.motion.trajectory_files import check_output
    from hdplan.planner.result import verdict
    from hdplan.planner.robot.scene_robot import load_scene_robot, notes_on

    if output is not None:
        check_output(output)
    problem = _load(scene, request, robot)
    motion = Trajectory.load(trajectory)
    arm = load_scene_robot(problem)
    with waiting("following", shown=not as_json), naming(trajectory):  # it may not fit the scene
        found = run(problem, motion, arm)
    if output is not None:
        found.trajectory.save(output, verdict(found.certificate))
    with printing() as show:
        if as_json:
            about = {"scene": problem.name, "robot": arm.name, "trajectory": str(trajectory)}
            show(json.dumps({**about, **found.summary()}))
        else:
            show(Text(found.text, style="green" if found.succeeded else "red"))
            show(verdict_text(found.certificate))
            notes = [("note", note) for note in (*notes_on(problem, arm), *found.certificate.notes)]
            rows = [*found.rows(), *closest_rows(found.certificate), *notes]
            show(table([*rows, *([("written", str(output))] if output is not None else [])]))
    raise typer.Exit(0 if found.succeeded else 1)


@app.command()
def simulate(
    scene: SceneFile,
    trajectory: Motion,
    request: Request = None,
    robot: RobotFile = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw rates, torques and tracking over time, as .png, .pdf or .svg."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Replay a joint trajectory, with dynamics if there are any.

    Without `limits.torque` in the scene the motion is kinematics alone, read a thousand times a second as a controller
    would. With it the robot is simulated with its loads under computed-torque control, torques cut at their limits.

    Exit code 1 where tracking is lost, a limit is exceeded, or something touches.
    """
    from hdplan.planner.control.replay import fitting, replay
    from hdplan.planner.motion.trajectory import Trajectory
    from hdplan.planner.pictures.plot import check_picture, plot_simulation
    from hdplan.planner.robot.scene_robot import load_scene_robot, notes_on

    if plot is not None:
        check_picture(plot)
    problem = _load(scene, request, robot)
    motion = Trajectory.load(trajectory)
    arm = load_scene_robot(problem)
    with naming(trajectory):
        fitting(problem, motion, arm)
    with waiting("simulating", shown=not as_json):
        simulation = replay(problem, motion, arm)
        if plot is not None:
            with naming(trajectory):  # it may have no times
                plot_simulation(simulation, f"{trajectory.name} in {problem.name}", plot)
    with printing() as show:
        if as_json:
            about = {"scene": problem.name, "robot": arm.name, "trajectory": str(trajectory)}
            show(json.dumps({**simulation.summary(), **about}))
        else:
            show(Text(simulation.text, style="green" if simulation.succeeded else "red"))
            written = [] if plot is None else [("written", str(plot))]
            notes = [("note", note) for note in notes_on(problem, arm)]
            show(table([*simulation_rows(simulation, problem, arm.name), *notes, *written]))
            show(rates_table(simulation.joints))
            if simulation.execution is not None:
                show(torques_table(simulation.joints))
    raise typer.Exit(0 if simulation.succeeded else 1)


@app.command()
def plot(
    scene: SceneFile,
    trajectory: Motion,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where the picture goes: .png, .pdf or .svg.")
    ],
    request: Request = None,
    robot: RobotFile = None,
) -> None:
    """Draw a joint trajectory in one sheet.

    Of ours or another planner's: joints with their limits, velocities and accelerations where the file has times, the
    clearance along the motion with what is proven of it, the solver's progress where the file holds it, and the scene
    from two sides. The exit code is 0 whatever the verdict.
    """
    from hdplan.planner.certificate.certifier import Certifier
    from hdplan.planner.motion.trajectory import Trajectory
    from hdplan.planner.pictures.plot import Subject, check_picture
    from hdplan.planner.pictures.plot import plot as draw
    from hdplan.planner.result import read_steps
    from hdplan.planner.robot.scene_robot import load_scene_robot

    check_picture(output)
    problem = _load(scene, request, robot)
    motion, steps = Trajectory.load(trajectory), read_steps(trajectory)
    with waiting("drawing"):
        certifier = Certifier(problem, load_scene_robot(problem))
        with naming(trajectory):  # its joints may not fit
            subject = Subject.of(certifier, motion, steps, trajectory.name)
        draw(subject, output)
    with printing() as show:
        show(verdict_text(subject.certificate))
        show(table([("written", str(output))]))


@app.command()
def view(
    scene: SceneFile,
    trajectories: Annotated[
        list[Path] | None,
        typer.Argument(metavar="TRAJECTORY", help="Motions to show, several at once to compare them."),
    ] = None,
    request: Request = None,
    robot: RobotFile = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record", metavar="FILE.html", help="Write the motion as one page that needs no server, and end."
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to serve on; 0.0.0.0 lets other machines in.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(metavar="N", help="Port to serve on, or the next free one.", parser=_port)
    ] = 8080,
) -> None:
    """Show a scene and motions in the browser, and plan there.

    Drag an obstacle or the goal, press Plan and watch the optimizer at work. Needs viser (pip install viser).

    Ctrl-C ends it.
    """
    from hdplan.planner.motion.trajectory import Trajectory
    from hdplan.planner.robot.scene_robot import load_scene_robot
    from hdplan.planner.view.front import check_installed, check_recording, motion_names

    files = trajectories or []
    check_installed()
    if record is not None:
        check_recording(record, files)
    problem = _load(scene, request, robot)
    motions = [(name, Trajectory.load(file)) for name, file in zip(motion_names(files), files, strict=True)]

    from hdplan.planner.view.server import open_viewer

    with waiting("loading the robot's meshes"):
        arm = load_scene_robot(problem)
        viewer = open_viewer(problem, motions, robot=arm, host=host, port=port, complain=_complain)
    with contextlib.closing(viewer), contextlib.suppress(KeyboardInterrupt), printing() as show:
        if record is not None:
            viewer.record(record)
            show(table([("written", str(record))]))
            return
        taken = f" (port {port} is taken)" if viewer.port != port else ""
        show(f"{problem.name} at http://{host}:{viewer.port}{taken}, until Ctrl-C")
        sys.stdout.flush()
        threading.Event().wait()


@app.command()
def explain(scene: SceneFile, request: Request = None, robot: RobotFile = None, as_json: AsJson = False) -> None:
    """Say what the problem of a scene will hold, and why.

    Joints with start, goal and limits; terms that are on and off; the bodies around links and obstacles; which pairs
    are kept and left out; unknowns; settings, with the defaults in force.
    """
    from hdplan.planner.build import build
    from hdplan.planner.terminal.explain import explain as sections_of

    problem = _load(scene, request, robot)
    with waiting("building the problem"):
        sections = sections_of(build(problem))
    with printing() as show:
        if as_json:
            show(json.dumps({title: dict(rows) for title, rows in sections.items()}))
            return
        for title, rows in sections.items():
            if rows:
                show(Text(title, style="bold"))
                show(table(rows))


@app.command()
def robots(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Show this robot's joints and bodies.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the robots that go by name, or show one of them.

    Of one robot: joints with limits, joints held, named states, and how tightly its outer bodies fit. The bodies are
    fitted once and kept, which takes up to a few minutes the first time.
    """
    from hdplan.planner.terminal.robots import describe, listing

    with waiting("loading every robot" if name is None else f"loading {name}"):
        tables = listing() if name is None else describe(name)
    with printing() as show:
        if as_json:
            show(json.dumps(tables))
            return
        for title, rows in tables.items():
            if rows:
                show(Text(title.replace("_", " "), style="bold"))
                show(columns(rows))


@studies.command()
def distance(output: Folder = OUT, quick: Quick = False) -> None:
    """Show what accuracy of the distance costs in time.

    For every set of normals, order, shaping length and precision: how often a gap is taken for contact, the error
    against the exact distance, and the time per value, gradient and Hessian. Writes distance_study.csv, .md and .png,
    and says which setting to take. Takes a good while; Ctrl-C ends with what was found so far.
    """
    from hdplan.planner.studies.distance import study_distance

    with measuring() as (report, stop):
        found = study_distance(output, quick, report, stop)
    _show_report(found)


@studies.command()
def planning(
    output: Folder = OUT,
    quick: Quick = False,
    problems: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Plan these MoveIt problems as well: every scene*.yaml below DIR, its request*.yaml beside it, and a "
            "robot.yaml in the nearest folder above it.",
        ),
    ] = None,
    every: Annotated[
        int, typer.Option(metavar="K", help="Take every K-th of the problems.", parser=_whole_number)
    ] = 10,
) -> None:
    """Show what accuracy costs in time, for planning.

    One setting at a time is changed from the defaults on the shipped scenes: link bodies, normals, gamma, shaping
    length, waypoints, samples or swept bodies between them, solver. Shown is what is certified, the clearance lost to
    conservativeness, smoothness and time. Writes planning_study.csv, .md and .png. Takes a quarter of an hour; Ctrl-C
    ends with what was found so far.
    """
    from hdplan.planner.studies.planning import study_planning

    scenes = [*_shipped(quick), *(_problems(problems, every) if problems else [])]
    with measuring() as (report, stop):
        found = study_planning(output, scenes, quick, report, stop)
    _show_report(found)


@figures.command()
def time(output: Folder = OUT, quick: Quick = False) -> None:
    """Time exact distances, GDF and the HD-SDF.

    Over all pairs of Platonic solids: exact by FCL and by coal; the HD-SDF by the interpreter, compiled, and in
    batches. Writes time.csv and time.png.
    """
    from hdplan.planner.studies.paper_figures import reproduce_time

    with measuring() as (report, stop):
        found = reproduce_time(output, quick, report, stop)
    _show_report(found)


@figures.command()
def conservativeness(output: Folder = OUT, quick: Quick = False) -> None:
    """Count how often a gap is taken for contact.

    Over 500,000 random configurations of Platonic solids, for the paper's set of normals and all the others. Writes
    conservativeness.csv and conservativeness.png.
    """
    from hdplan.planner.studies.paper_figures import reproduce_conservativeness

    with measuring() as (report, stop):
        found = reproduce_conservativeness(output, quick, report, stop)
    _show_report(found)


@figures.command()
def corridor(output: Folder = OUT, quick: Quick = False) -> None:
    """Steer a Panda of boxes into a corridor, under each distance.

    The paper's robot experiment: the same controller with the exact distance, the GDF and the HD-SDF, with the text's
    parameters and with its published code's; then one setting changed at a time, and which of them are safe. Writes
    corridor.csv, corridor_commands.csv, corridor_settings.csv and corridor.png. Takes some minutes; Ctrl-C ends with
    what was found so far.
    """
    from hdplan.planner.studies.paper_corridor import reproduce_corridor

    with measuring() as (report, stop):
        found = reproduce_corridor(output, quick, report, stop)
    _show_report(found)


@figures.command()
def kinks(output: Folder = OUT) -> None:
    """Follow two squares past each other.

    The Euclidean distance has kinks there and the HD-SDF has none. Writes kinks.csv and kinks.png: both over time with
    their derivatives.
    """
    from hdplan.planner.studies.paper_figures import reproduce_kinks

    with waiting("following the squares"):
        found = reproduce_kinks(output)
    _show_report(found)


def main() -> None:
    """Run the command line; every error becomes one line: exit code 2 for what a user can cause, else 3."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as with `>&-`
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names of files and obstacles hold any character
            stream.reconfigure(errors="backslashreplace")
    signal.signal(signal.SIGTERM, _terminated)
    warnings.showwarning = lambda message, *_, **__: say(f"note: {message}", "yellow")  # a line, not a source location
    try:
        code = app(sys.argv[1:] or ["--help"], prog_name="hdplan", standalone_mode=False)
    except OutOfTime as error:
        say(str(error), "red")
        code = 1
    except HdplanError as error:
        code = _complain(str(error))
    except TyperError as error:
        command = context.command_path if (context := getattr(error, "ctx", None)) else "hdplan"
        code = _complain(f"{error.format_message().rstrip('.')} (see {command} --help)")  # type: ignore[attr-defined]
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except OSError as error:  # of a help text; what hdplan prints itself looks after itself
        if error.errno not in (errno.EPIPE, errno.ENOSPC):
            code = _internal(error)
        else:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 0 if error.errno == errno.EPIPE else _complain(f"the output cannot be written ({error.strerror})")
    except Exception as error:
        code = _internal(error)
    if code == INTERRUPTED:
        _complain("interrupted before anything was found")
    sys.exit(code)


def _terminated(*_: object) -> None:
    """End as asked, after files under way are taken away."""
    sys.exit(TERMINATED)


def _internal(error: Exception) -> int:
    """Print one line about an error that should not be and return its exit code."""
    say(f"internal error, please report it to the project with scene and command: {_fault(error)}", "red")
    return INTERNAL


def _fault(error: Exception) -> str:
    """Name an error that should not be, and the line of hdplan from which it came."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if {"planner", "distance", "scenes"} & set(Path(frame.filename).parts)]
    place = next((f" ({Path(frame.filename).stem}, line {frame.lineno})" for frame in reversed(own)), "")
    return f"{type(error).__name__}: {' '.join(str(error).split())}{place}"


def _load(scene: str, request: Path | None, robot: str | None) -> Scene:
    from hdplan.scenes.yaml_format.reader import load_scene

    return load_scene(scene, request=request, robot=robot)


def _shipped(only_panda: bool) -> list[Scene]:
    """The shipped scenes that have obstacles."""
    from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

    scenes = [load_scene(file) for file in shipped_scenes().values()]
    return [scene for scene in scenes if scene.obstacles and (not only_panda or scene.robot.name == "panda")]


def _problems(folder: Path, every: int) -> list[Scene]:
    """Every K-th MoveIt problem below a folder, named by its path in it."""
    from hdplan.scenes.yaml_format.reader import load_scene

    if every < 1:
        raise InputError(f"--every: found {every}, allowed is a whole number of at least 1")
    scenes = []
    for file in sorted(folder.rglob("scene*.yaml"))[::every]:
        request = file.with_name(file.name.replace("scene", "request", 1))
        robots = [above / "robot.yaml" for above in file.parents if above.is_relative_to(folder)]
        robot = next((robot for robot in robots if robot.is_file()), None)
        if robot is None:
            raise InputError(f"{file}: there is no robot.yaml in its folder or in one above it, up to {folder}")
        scene = load_scene(file, request=request, robot=robot)
        scenes.append(replace(scene, name=str(file.relative_to(folder).with_suffix(""))))
    if not scenes:
        raise InputError(f"{folder}: no scene*.yaml in it or below it")
    return scenes


def _complain(text: str) -> int:
    """Print one line and return the exit code of bad input."""
    say(text, "red")
    return 2


def _show_report(report: Report) -> None:
    """Print what was measured. Exit code 1 if it was interrupted."""
    with printing() as show:
        for title, rows in report.tables.items():
            show(Text(title, style="bold"))
            show(columns(rows))
        partial = [] if report.complete else [("partial", "interrupted: tables and files hold what was found so far")]
        show(table([*partial, *report.notes, *(("written", str(file)) for file in report.files)]))
    raise typer.Exit(0 if report.complete else 1)


if __name__ == "__main__":
    main()
