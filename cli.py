"""The command line: parse, call the library, print. Exit codes: 0 certified, 1 nothing certified was found, 2 bad
input."""

from __future__ import annotations

import enum
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hdplan.scenes.errors import HdplanError

if TYPE_CHECKING:
    from hdplan.planner.plan import Event
    from hdplan.planner.result import PlanResult
    from hdplan.scenes.model import Scene

app = typer.Typer(
    help="Plan motions of robot arms with smooth signed distances, and prove them free against the real meshes.",
    epilog="Shipped scenes go by name: try `hdplan plan panda_cage -o motion.json`. Exit codes: 0 certified, "
    "1 nothing certified was found (the best attempt is still written), 2 bad input.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
PICTURES = (".png", ".pdf", ".svg")
out = Console(soft_wrap=True, highlight=False)
err = Console(stderr=True, soft_wrap=True, highlight=False)


class SolverName(enum.StrEnum):
    """The solvers by name."""

    gauss_newton = "gauss_newton"
    chomp = "chomp"
    ipopt = "ipopt"


SceneFile = Annotated[
    str,
    typer.Argument(metavar="SCENE", help="A hdplan scene (YAML), a shipped scene's name, or a MoveIt planning scene."),
]
Request = Annotated[
    Path | None,
    typer.Option("--request", metavar="FILE", help="The motion plan request that belongs to a MoveIt scene."),
]
RobotFile = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="NAME|FILE",
        help="Robot that supplies or replaces the scene's: a name, or a file with a `robot` section.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]


@app.command()
def plan(
    scene: SceneFile,
    request: Request = None,
    robot: RobotFile = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the trajectory: .json, .csv or .npz.")
    ] = None,
    solver: Annotated[
        SolverName, typer.Option(help="Which solver improves the first guesses.")
    ] = SolverName.gauss_newton,
    seed: Annotated[int, typer.Option(help="Seed of the random first guesses.", min=0)] = 0,
    time_limit: Annotated[
        float, typer.Option(metavar="SECONDS", help="Time for solving and certifying, all attempts together.", min=0.01)
    ] = 30.0,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a picture of the result (.png, .pdf, .svg).")
    ] = None,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Plan a motion from the scene's start to its goal and prove it free.

    The motion is smooth in joint space, straight between its waypoints, and certified over its whole course against
    the robot's collision meshes and the scene's own shapes. Ctrl-C ends with the best motion found so far.
    """
    from hdplan.planner.plan import plan as find
    from hdplan.planner.trajectory import check_writable

    if output is not None:
        check_writable(output)
    if plot is not None:
        check_writable(plot, PICTURES)
    problem = _load(scene, request, robot)
    with _Progress(shown=not quiet and not as_json and err.is_terminal) as progress:
        result = find(problem, solver=solver.value, seed=seed, time_limit=time_limit, report=progress)
    if output is not None:
        result.save(output)
    if plot is not None:
        from hdplan.planner.plot import plot_result
        from hdplan.planner.robot import load_scene_robot

        plot_result(problem, load_scene_robot(problem), result, plot)
    if as_json:
        print(json.dumps(result.summary()))
    elif not quiet:
        _print_result(result, [str(file) for file in (output, plot) if file is not None])
    raise typer.Exit(0 if result.certified else 1)


@app.command()
def check(
    scene: SceneFile,
    trajectory: Annotated[
        Path,
        typer.Argument(metavar="TRAJECTORY", help="JSON, CSV (joint names in its header) or NPZ; from any planner."),
    ],
    request: Request = None,
    robot: RobotFile = None,
    as_json: AsJson = False,
) -> None:
    """Certify a joint trajectory: is the whole motion along straight lines between its waypoints free?"""
    from hdplan.planner.certificate import certify
    from hdplan.planner.result import verdict
    from hdplan.planner.trajectory import Trajectory

    problem = _load(scene, request, robot)
    certificate = certify(problem, Trajectory.load(trajectory))
    if as_json:
        print(json.dumps({"status": certificate.status.value, "text": certificate.text, **verdict(certificate)}))
    else:
        style = "green" if certificate.certified else "red"
        out.print(f"[{style}]{escape(certificate.text)}[/]")
        out.print(
            f"{certificate.configurations} configurations, {certificate.exact_calls} exact distances, "
            f"{certificate.seconds:.2f} s"
        )
    raise typer.Exit(0 if certificate.certified else 1)


@app.command()
def explain(scene: SceneFile, request: Request = None, robot: RobotFile = None, as_json: AsJson = False) -> None:
    """Say what the problem of a scene will hold: terms on and off and why, bodies, pairs kept and left out,
    unknowns."""
    from hdplan.planner.explain import explain as sections_of
    from hdplan.planner.problem import build

    sections = sections_of(build(_load(scene, request, robot)))
    if as_json:
        print(json.dumps({title: dict(rows) for title, rows in sections.items()}))
        return
    for title, rows in sections.items():
        if rows:
            _print_table(f"[bold]{title}[/]", rows)


@app.command()
def robots(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A robot of which to show joints and bodies.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the robots that go by name, or show one: joints with limits, named states, how tightly its bodies fit."""
    from hdplan.planner.robot_listing import describe, listing

    if name is None:
        rows = listing()
        if as_json:
            print(json.dumps(rows))
        else:
            _print_rows("robots", rows)
        return
    tables = describe(name)
    if as_json:
        print(json.dumps(tables))
    else:
        for title, rows in tables.items():
            _print_rows(title, rows)


def main() -> None:
    """Run the command line; every error that a user can cause becomes one line and exit code 2."""
    try:
        app()
    except HdplanError as error:
        err.print(f"hdplan: {error}", style="red", markup=False)
        sys.exit(2)
    except KeyboardInterrupt:
        err.print("hdplan: interrupted before anything was found")
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output has gone, as with `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)


def _load(scene: str, request: Path | None, robot: str | None) -> Scene:
    from hdplan.scenes.reader import load_scene

    return load_scene(scene, request=request, robot=robot)


class _Progress:
    """One line on a terminal that follows the solver; silent elsewhere."""

    def __init__(self, shown: bool) -> None:
        self.status = err.status("building the problem") if shown else None
        self.verdict = ""

    def __enter__(self) -> _Progress:
        if self.status:
            self.status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.status:
            self.status.stop()

    def __call__(self, event: Event) -> None:
        """Show an event."""
        if not self.status:
            return
        if event.certificate is not None:
            self.verdict = event.certificate.status.value.replace("_", " ")
        if event.step is not None:
            step = event.step
            self.status.update(
                f"attempt {event.attempt} · iteration {step.iteration} · cost {step.cost:.4g} · "
                f"inside the margin by {step.depth * 1e3:.1f} mm"
                + (f" · last certificate: {self.verdict}" if self.verdict else "")
            )


def _print_result(result: PlanResult, files: list[str]) -> None:
    certificate, times = result.certificate, result.times
    style = "green" if result.certified else "red"
    out.print(f"[{style}]{escape(certificate.text)}[/]")
    worst = certificate.worst
    rows = [
        ("scene", f"{result.scene} with {result.robot}"),
        (
            "motion",
            f"{len(result.trajectory)} waypoints, {result.iterations} iterations, {result.attempts} attempt(s), "
            f"seed {result.seed}",
        ),
        (
            "closest",
            f"{worst.link} to {worst.other}, {worst.distance * 1e3:.2f} mm at time {worst.time:.3f}"
            if worst
            else "no obstacles",
        ),
        (
            "time",
            f"load {times.load:.2f} s, build {times.build:.2f} s, compile {times.compile:.2f} s, "
            f"solve {times.solve:.2f} s, certify {times.certify:.2f} s",
        ),
        *(("note", note) for note in result.notes),
        *(("written", file) for file in files),
    ]
    _print_table(None, rows)


def _print_table(title: str | None, rows: list[tuple[str, str]]) -> None:
    if title:
        out.print(title)
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    table.add_column()
    for name, value in rows:
        table.add_row(f"  {escape(name)}", escape(value))
    Console(highlight=False).print(table)


def _print_rows(title: str, rows: list[dict[str, Any]]) -> None:
    """Print a table whose rows have the same keys."""
    if not rows:
        return
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 2, 0, 0))
    for column in rows[0]:
        numeric = all(isinstance(row[column], int | float) for row in rows)
        table.add_column(column.replace("_", " "), justify="right" if numeric else "left")
    for row in rows:
        table.add_row(*(f"{value:.4g}" if isinstance(value, float) else escape(str(value)) for value in row.values()))
    Console(highlight=False).print(table)


if __name__ == "__main__":
    main()
