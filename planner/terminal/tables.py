"""Results as printed: rows of names and values, and tables, within the terminal's width."""

from __future__ import annotations

import math
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from hdplan.planner.certificate.verdict import share_of_limit

if TYPE_CHECKING:
    from hdplan.planner.certificate.verdict import Certificate, Place
    from hdplan.planner.control.simulation import JointUse, Peak, Simulation
    from hdplan.planner.result import PlanResult
    from hdplan.scenes.scene import Scene
    from hdplan.scenes.sizes import Tracking

STILL_RATE = 1e-6  # [rad/s etc.] below which a joint stands still, up to rounding
BAR = 14  # [columns] width of the bar for a torque at its limit
WIDTH = 80  # [columns] of tables where the output is not a terminal


def verdict_text(certificate: Certificate) -> Text:
    """Return a certificate's text, green or red."""
    return Text(certificate.text, style="green" if certificate.certified else "red")


def result_rows(result: PlanResult, files: list[str]) -> list[tuple[str, str]]:
    """Return rows that say how a motion was found, how close it comes, how much of its limits it uses, and where it was
    written."""
    attempts = f"{result.attempts} attempt" + "s" * (result.attempts != 1)
    return [
        ("scene", f"{result.scene} with {result.robot}"),
        ("motion", f"{result.trajectory.extent}, {result.iterations} iterations, {attempts}, seed {result.seed}"),
        ("objective", "{}, {:.4g} {}".format(*result.objective)),
        *closest_rows(result.certificate),
        *limit_rows(result.certificate),
        ("time [s]", ", ".join(f"{name} {seconds:.2f}" for name, seconds in vars(result.times).items())),
        *(("note", note) for note in result.notes),
        *(("written", file) for file in files),
    ]


def closest_rows(certificate: Certificate) -> list[tuple[str, str]]:
    """Return rows with the closest places that the proof has found: to an obstacle, and between links.

    Other places may be closer, down to the proven clearance.
    """
    places = {"closest found": certificate.worst, "closest links": certificate.self_worst}
    return [(name, _place(place)) for name, place in places.items() if place is not None]


def _place(place: Place) -> str:
    distance = f"about {abs(place.distance) * 1e3:.2f} mm{' deep' * (place.distance < 0)}"
    when = f"{place.parameter:.3f} of 1" if place.seconds is None else f"{place.seconds:.3f} s"
    return f"{place.link} to {place.other}, {distance} at {when}"


def limit_rows(certificate: Certificate) -> list[tuple[str, str]]:
    """Return rows that say how much of each limit the motion uses at most, and by which joint."""
    return [
        (
            use.quantity,
            f"at most {share_of_limit(use.share, 1)} of the limit, by {use.joint} (limit {use.limit:.4g})"
            if math.isfinite(use.share)
            else f"jumps, which no limit allows, of {use.joint} (limit {use.limit:.4g})",
        )
        for use in certificate.uses
    ]


def simulation_rows(simulation: Simulation, scene: Scene, robot: str) -> list[tuple[str, str]]:
    """Return rows that say what was replayed, and how close it came."""
    if simulation.duration is None:
        motion, when = "a path without times", "at {:.3f} of 1"
    else:
        motion, when = f"{simulation.duration:.3f} s", "at {:.3f} s"
    places = {"closest": simulation.closest, "own links": simulation.self_closest}
    return [
        ("motion", f"{motion} of {robot} in {scene.name}, {simulation.curve.rule} between rows"),
        *(
            (name, f"{close.link} to {close.other}, {close.distance * 1e3:.2f} mm {when.format(close.time)}")
            for name, close in places.items()
            if close is not None
        ),
        *(() if simulation.tracking is None else [("robot.tracking", tracking_text(simulation.tracking))]),
        ("sampled", f"{simulation.samples} configurations, with exact distances"),
        ("units", "rad, Nm and s; m and N where a joint slides"),
    ]


def tracking_text(tracking: Tracking) -> str:
    """Write measured errors as a scene takes them."""
    position, velocity = (
        f"[{', '.join(f'{value:g}' for value in values)}]" if isinstance(values, tuple) else f"{values:g}"
        for values in (tracking.position, tracking.velocity)
    )
    return f"{{position: {position}, velocity: {velocity}}}"


def rates_table(joints: Sequence[JointUse]) -> Table:
    """Tabulate how far and how fast each joint moved, and how much of its limits that uses."""
    rates = [what for what in joints[0].peaks if what != "torque"]
    table = _joint_table("travel", *rates)
    for joint in joints:
        table.add_row(joint.name, f"{joint.travel:.3f}", *(_peak(joint.peaks[what]) for what in rates))
    return table


def torques_table(joints: Sequence[JointUse]) -> Table:
    """Tabulate the torque of each joint, what is left of its limit, and how well the joint tracked."""
    table = _joint_table("torque", "", "left", "at [s]", "error", "rms")
    table.columns[2].justify = "left"
    for joint in joints:
        torque = joint.peaks["torque"]
        bar = Text("█" * round(BAR * min(torque.share or 0.0, 1.0)) or "▏", style=_style(torque))
        left = "" if torque.left is None else f"{torque.left:.3g}"
        figures = (left, f"{torque.time:.3f}", f"{joint.error:.1e}", f"{joint.error_rms:.1e}")
        table.add_row(joint.name, _peak(torque), bar, *figures)
    return table


def _joint_table(*columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=0, header_style="bold")
    table.add_column("joint", no_wrap=True)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def _peak(peak: Peak) -> Text:
    """Return a peak value with its share of the limit, if there is one."""
    value = f"{peak.value if peak.value > STILL_RATE else 0:.4g}"
    if peak.share is None:
        return Text(value)
    return Text.assemble(f"{value} ", (f"{100 * peak.share:4.0f} %", _style(peak)))


def _style(peak: Peak) -> str:
    """Colour a share of a limit by how close it is."""
    share = peak.share or 0.0
    return "red" if share > 1.001 else "yellow" if share > 0.95 else "green"


def table(rows: Sequence[tuple[str, str]]) -> str:
    """Return names and values in two columns; the values wrap within the terminal's width."""
    return _grid([("", *row) for row in rows], (False, False, False))


def columns(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows that share their keys as a table with the keys as head; a single column has no head."""
    cells = [[f"{value:.4g}" if isinstance(value, float) else str(value) for value in row.values()] for row in rows]
    head = [[key.replace("_", " ") for key in rows[0]]] if len(rows[0]) > 1 else []
    numeric = [all(isinstance(row[key], int | float) for row in rows) for key in rows[0]]
    return _grid([["", *row] for row in head + cells], [False, *numeric])


def _grid(rows: Sequence[Sequence[str]], numeric: Sequence[bool]) -> str:
    """Align columns of text, two spaces apart, numeric ones to the right; the last one wraps."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(cell_len, column)) for column in columns]
    indent = sum(widths[:-1]) + 2 * len(widths[:-1])
    room = max(shutil.get_terminal_size((WIDTH, 24)).columns - indent, 20)
    lines: list[str] = []
    for row in rows:
        gaps = [" " * (width - cell_len(cell)) for cell, width in zip(row, widths, strict=True)]
        *cells, last = (
            gap + cell if right else cell + gap for cell, gap, right in zip(row, gaps, numeric, strict=True)
        )
        first, *more = textwrap.wrap(last.rstrip(), room, drop_whitespace=False, break_on_hyphens=False) or [""]
        lines.append("  ".join([*cells, first]).rstrip())
        lines += [" " * indent + line.strip() for line in more]
    return "\n".join(lines)
