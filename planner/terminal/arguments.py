"""Arguments of the commands: their help, and how their values are read."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hdplan.scenes.number_text import read_number, read_whole

if TYPE_CHECKING:
    from hdplan.scenes.robot_spec import RobotSpec

SEARCH_TIME = 30.0  # [s] for solving and certifying, where no time limit is given
STUDY_FOLDER = Path("out")  # where the files of a study go, if no folder is given


def _whole_number(text: str, least: int = 0) -> int:
    with contextlib.suppress(ValueError):
        if text.isascii() and text.isdigit() and (number := int(text)) >= least:
            return number
    raise typer.BadParameter(f"must be a whole number of at least {least}, found '{text}'")


def _above_zero(text: str) -> int:
    return _whole_number(text, least=1)


def _port(text: str) -> int:
    with contextlib.suppress(ValueError):
        if 1 <= (number := read_whole(text)) <= 65535:
            return number
    raise typer.BadParameter(f"must be a port from 1 to 65535, found '{text}'")


def _seconds(text: str) -> float:
    with contextlib.suppress(ValueError):
        if 0.0 < (number := read_number(text)) < math.inf:
            return number
    raise typer.BadParameter(f"must be a finite number of seconds greater than 0, found '{text}'")


def _number(text: str) -> float:
    with contextlib.suppress(ValueError):
        return read_number(text)
    raise typer.BadParameter(f"must be a number, found '{text}'")


# nearly all commands
SceneFile = Annotated[
    str,
    typer.Argument(metavar="SCENE", help="A hdplan scene (YAML), a shipped scene's name, or a MoveIt planning scene."),
]
Motion = Annotated[
    Path,
    typer.Argument(
        metavar="TRAJECTORY",
        help="JSON, CSV (joint names in its header), NPZ or a ROS message (.yaml, .mcap), from any planner.",
    ),
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
        help="Robot to use instead of the scene's: a name of `hdplan robots`, a robot description, or a YAML "
        "file with a `robot` section.",
    ),
]
XacroArguments = Annotated[
    list[str] | None,
    typer.Option(
        "--xacro-arg",
        metavar="NAME:=VALUE",
        help="An argument of the xacro file that is the robot; may be given several times.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]


def robot_with(robot: str | None, arguments: list[str] | None) -> str | RobotSpec | None:
    """Return the robot of --robot with the arguments of --xacro-arg. Raises InputError for arguments without a xacro
    file, and for one that is not NAME:=VALUE."""
    if not arguments:
        return robot
    from dataclasses import replace

    from hdplan.scenes.errors import InputError
    from hdplan.scenes.robot_files.urdf_text import XACRO
    from hdplan.scenes.yaml_format.reader import read_robot

    if robot is None or not robot.lower().endswith(XACRO):
        raise InputError(f"--xacro-arg: goes with a robot in xacro ({XACRO}); elsewhere robot.xacro_args has them")
    values: dict[str, str] = {}
    for argument in arguments:
        name, given, value = argument.partition(":=")
        if not given or not name.strip():
            raise InputError(f"--xacro-arg: must be NAME:=VALUE, found '{argument}'")
        if name in values:
            raise InputError(f"--xacro-arg: '{name}' is given twice")
        values[name] = value
    return replace(read_robot(robot)[0], xacro_args=values)


# plan
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="Write the trajectory: .json, .csv, .npz, .joint_trajectory.yaml, .robot_trajectory.yaml (messages of "
        "ROS and MoveIt) or .mcap (a ROS 2 bag).",
    ),
]
Solver = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="gauss_newton (damped steps, banded; the fastest), fatrop or ipopt (interior point, on the CasADi "
        "program) or chomp (covariant gradient descent).",
    ),
]
Distance = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="Distance used by the penalty: hdsdf, or fcl (exact, Euclidean); by default the scene's."
    ),
]
Seed = Annotated[int, typer.Option(metavar="N", help="Seed of the random guesses.", parser=_whole_number)]
TimeLimit = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Time for everything, reading and building included. By default solving and certifying take at most "
        f"{SEARCH_TIME:g} s over all attempts.",
        parser=_seconds,
    ),
]
Sheet = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Draw scene, joints, clearance and convergence: .png, .pdf or .svg.")
]
ProofToWrite = Annotated[
    Path | None,
    typer.Option(
        "--proof", metavar="FILE.proof", help="Write a proof of the motion too, for `hdplan verify`; it needs -o."
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]

Diagnose = Annotated[
    bool, typer.Option("--diagnose", help="Find the reason for a failure, by trying changes that would help.")
]

# prove, verify
Proof = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="FILE.proof", help="File of the proof; for a job, one file for all stages."),
]
ProofToCheck = Annotated[
    Path, typer.Argument(metavar="PROOF", help="A proof, as `hdplan prove` and `hdplan plan --proof` write it.")
]
World = Annotated[
    Path | None, typer.Option("--world", metavar="FILE.json", help="Write the checker's world to a file, too.")
]

# follow, simulate, plot
Executed = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="Write the executed motion, in any format of plan -o."),
]
BarrierRate = Annotated[
    float | None,
    typer.Option(
        "--rate",
        metavar="1/S",
        parser=_number,
        help="Greatest speed of approach to a margin, as a share of it per second.",
    ),
]
Margin = Annotated[
    float | None,
    typer.Option("--margin", metavar="M", parser=_number, help="Distance at which the controller stops the robot [m]."),
]
JointLimit = Annotated[
    list[str] | None,
    typer.Option(
        "--limits",
        metavar="NAME=NUMBER",
        help="A limit of all joints in place of the scene's: velocity, acceleration or jerk. May be repeated.",
    ),
]
Plant = Annotated[
    str | None,
    typer.Option(
        metavar="mujoco|FILE",
        help="Execute the motion by a body with masses and drives: by MuJoCo, made of the scene's robot or of a MuJoCo "
        "model file (.xml).",
    ),
]
RatesSheet = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Draw rates, torques and tracking over time, as .png, .pdf or .svg.")
]
Picture = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE", help="File of the picture: .png, .pdf or .svg.")
]

# view
Motions = Annotated[
    list[Path] | None, typer.Argument(metavar="TRAJECTORY", help="Motions to show; give several to compare them.")
]
Page = Annotated[
    Path | None,
    typer.Option("--record", metavar="FILE.html", help="Write the motion as one page that needs no server, and exit."),
]
Film = Annotated[
    Path | None,
    typer.Option(
        "--video", metavar="FILE.mp4|.gif", help="Write the motion as a film, drawn in an installed browser, and exit."
    ),
]
ProofToShow = Annotated[
    Path | None,
    typer.Option(
        "--proof", metavar="FILE.proof", help="Show the planes of this proof of the motion, as plan --proof writes it."
    ),
]
Watched = Annotated[
    bool, typer.Option("--view", help="Show the planner at work in the browser, and serve the motion until Ctrl-C.")
]
Host = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Address of the server, by default 127.0.0.1; 0.0.0.0 admits other machines."),
]
Port = Annotated[
    int | None,
    typer.Option(metavar="N", help="Port of the server, or the next free one; by default 8080.", parser=_port),
]
Share = Annotated[
    bool, typer.Option("--share", help="Write a second address, by which others see everything and change nothing.")
]

# robots
RobotName = Annotated[
    str | None,
    typer.Argument(
        metavar="NAME|FILE", help="Show this robot's joints, groups and bodies; FILE as for --robot elsewhere."
    ),
]
SrdfFile = Annotated[
    Path | None,
    typer.Option(
        "--srdf",
        metavar="OUT",
        help="Write an SRDF for a robot that has none: the link pairs that always or never touch, or are neighbours.",
    ),
]

# batch, sample
Sources = Annotated[
    list[str] | None,
    typer.Argument(metavar="SOURCE", help="Scenes, a pattern of files in quotes, a folder, or a table (CSV, Parquet)."),
]
Run = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="RUN", help="Folder of the results; an interrupted run resumes there."),
]
TableScene = Annotated[
    str | None, typer.Option("--scene", metavar="SCENE", help="The scene that the rows of a table vary.")
]
Workers = Annotated[
    int | None,
    typer.Option(metavar="N", help="Processes on this machine; by default one for each core.", parser=_above_zero),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS", help="Use the workers of this dask scheduler instead, such as tcp://10.0.0.1:8786."
    ),
]
Cluster = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Start the workers of a cluster by one of dask's cluster classes, given in FILE."
    ),
]
EachTimeLimit = Annotated[
    float,
    typer.Option(
        "--time-limit",
        metavar="SECONDS",
        help="Time limit for each problem, reading and building included.",
        parser=_seconds,
    ),
]
MotionsAs = Annotated[
    str,
    typer.Option(metavar="HOW", help="parquet: one table; files: each problem's scene and motion as files as well."),
]
Proofs = Annotated[bool, typer.Option("--proof", help="Write files, and the proof of every certified motion.")]
Export = Annotated[
    str | None,
    typer.Option(metavar="FORMAT", help="lerobot: the certified motions as a data set for imitation learning, too."),
]
Rate = Annotated[
    int, typer.Option("--fps", metavar="N", help="Samples per second of the data set.", parser=_above_zero)
]
Report = Annotated[Path | None, typer.Option(metavar="RUN", help="Only print the report of a run, finished or not.")]
RunSheet = Annotated[
    Path | None, typer.Option("--plot", metavar="FILE", help="Draw the report, as .png, .pdf or .svg.")
]
TableFile = Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="File of the table: .csv or .parquet.")]
ProblemSeed = Annotated[
    int, typer.Option("--seed", metavar="N", help="Seed of the random problems.", parser=_whole_number)
]
Count = Annotated[int, typer.Option("--count", "-n", metavar="N", help="Number of problems.", parser=_above_zero)]
GoalKind = Annotated[
    str, typer.Option(metavar="KIND", help="joints: goals are configurations; pose: poses of the end effector.")
]
Jitter = Annotated[
    float,
    typer.Option(metavar="METRES", help="Shift each obstacle by up to this much along each axis.", parser=_number),
]
Resize = Annotated[
    float, typer.Option(metavar="SHARE", help="Change each size of an obstacle by up to this share.", parser=_number)
]

# study, reproduce
NewFolder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder of the files, a new one.")]
Folder = Annotated[
    Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder of the files, created if it does not exist.")
]
Quick = Annotated[bool, typer.Option("--quick", help="Measure less, in about a minute.")]
Problems = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Plan these MoveIt problems as well: every scene*.yaml below DIR, its request*.yaml beside it, and a "
        "robot.yaml in the nearest folder above it.",
    ),
]
Every = Annotated[int, typer.Option(metavar="K", help="Take every K-th problem.", parser=_whole_number)]
