"""The study of what accuracy costs in time, for planning: written as CSV, Markdown and PNG, and summarized in words.

In: scenes. Out: files in a folder, and a `Report` with one line for each variant of the settings.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.studies.report import (
    Cell,
    Report,
    Reporter,
    Stopper,
    check_report,
    csv_text,
    markdown_text,
    png,
    short,
    write_report,
)
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.studies.planning_runs import Run, Runs, Variant

LEAST_REFERENCE = 1.0  # [rad, rad²] the least path or acceleration in a ratio: that of a straight line would be 0
FILES = tuple(f"planning_{name}" for name in ("study.csv", "study.md", "study.png", "quality.csv", "quality.png"))
LEGEND = """\
Each line changes one setting; all others stand at their defaults. Certified: proven within {limit:g} s; first guess:
from the straight line. Lost: the exact distance of the real meshes less the planner's lower bound D̃ of it, at {near}
random free configurations within {reach:g} cm of an obstacle, the same for all lines: median / 95 %. D off: |D - D̃| of
the deepest pair where the penalty acts, median. Path and acceleration: length in joint space and integrated squared
acceleration (less than {little:g} rad² counts as that), in % of the default's motion in the same scene, geometric mean
over the scenes that both solve. Time: of a whole plan, warm, on the processor, median / largest over all the scenes.
Pair: one pair's distance with derivative, median.
"""
QUALITY = """\
## What quality costs in time

The best certified motion after a time, in % of the first one's, geometric mean over {scenes} scenes, while rounds of
`planner.polish` continue; within the scene's limits of rates, or those of cuRobo's published results.
"""
GUESSES = """\
## What guesses cost in time

With the defaults: scenes that are certified by so many first guesses at most, and what those plans take on the
processor, median / largest.
"""
MORE_GUESSES = 2  # factor from one row of that table to the next


@dataclass(frozen=True)
class Summary:
    """One variant over all scenes."""

    variant: Variant
    scenes: int
    certified: int
    first: int  # certified from the first guess
    lost: tuple[float, float]  # clearance lost to conservativeness, median and 95th percentile [m]
    off: float  # |D − D̃|, median [m]
    length: float | None  # of the path, relative to the default's; None where no scene compares
    acceleration: float | None  # integrated squared, likewise
    seconds: float  # of a plan, processor time, median [s]
    slowest: float  # the same, largest [s]
    kernel: float  # one pair's distance with derivative, median [s]
    clearance: float | None  # proven, median over what is certified [m]


def summaries(found: Runs) -> tuple[Summary, ...]:
    """Summarize each variant that was measured, the defaults first."""
    default = found.of(found.variants[0])
    return tuple(_summary(found.of(variant), default) for variant in found.variants)


def study_planning(folder: Path, scenes: Sequence[Scene], quick: bool, report: Reporter, stop: Stopper) -> Report:
    """Measure on ``scenes``, and write FILES into ``folder``; for ``quick`` fewer settings, each plan timed once.

    Raises InputError for a folder that cannot be written, a missing matplotlib, and if no scene can be planned;
    KeyboardInterrupt if it is stopped before the defaults are measured.
    """
    from hdplan.planner.studies.anytime import anytime_curves, anytime_rows, shares
    from hdplan.planner.studies.planning_runs import NEAR_CONTACT, TIME_LIMIT, measure

    paths = check_report(folder, FILES)
    begin = perf_counter()
    found = measure(scenes, quick, report=report, stop=stop)
    if not found.runs:
        if found.complete:
            raise InputError(f"no scene can be planned: {'; '.join(found.refused) or 'there is none'}")
        raise KeyboardInterrupt
    curves, left_out = anytime_curves(scenes, quick, report=report, stop=stop)
    complete = found.complete and not stop()
    from hdplan.planner.studies.anytime_sheet import anytime_sheet
    from hdplan.planner.studies.planning_sheet import planning_sheet

    rows = summaries(found)
    notes = [*_about(found), *_advice(rows)]
    if left_out:
        notes.append(("without quality over time", "; ".join(left_out)))
    took = f"{perf_counter() - begin:.0f} s on {os.cpu_count()} processors"
    notes.append(("measured", f"in {took}{'' if complete else ', interrupted: what there was until then'}"))
    text = "".join(f"- **{what}**: {words}\n" for what, words in notes)
    near = sum(len(run.lost) for run in found.of(found.variants[0]))
    legend = LEGEND.format(limit=TIME_LIMIT, near=near, reach=100 * NEAR_CONTACT, little=LEAST_REFERENCE)
    tables = {
        "one setting changed at a time": [_short_row(summary) for summary in rows],
        "what guesses cost in time": by_guesses(found.of(found.variants[0])),
    }
    first, second = map(markdown_text, tables.values())
    parts = ["# What accuracy costs in time, for planning\n", text, legend, first, GUESSES, second]
    pictures: list[str | bytes] = [png(planning_sheet(rows, complete))]
    if curves:
        tables["what quality costs in time"] = shares(curves)
        parts += [QUALITY.format(scenes=len(curves)), markdown_text(tables["what quality costs in time"])]
        pictures += [csv_text(anytime_rows(curves)), png(anytime_sheet(curves, complete))]
    contents = [csv_text([_row(run) for run in found.runs]), "\n".join(parts), *pictures]
    write_report(paths := paths[: len(contents)], contents)
    return Report(tables, notes, paths, complete)


def by_guesses(runs: Sequence[Run]) -> list[dict[str, Cell]]:
    """Return the table: of runs with one setting, how many are certified by how many guesses, and in which time."""
    rows: list[dict[str, Cell]] = []
    most, before = 1, -1
    while before < sum(run.certified for run in runs):
        seconds = [run.seconds for run in runs if run.certified and run.attempts <= most]
        if len(seconds) > before:
            times = f"{short(1e3 * float(np.median(seconds)))} / {short(1e3 * max(seconds))}" if seconds else ""
            rows.append({"guesses": most, "certified": f"{len(seconds)} of {len(runs)}", "time [ms]": times})
        most, before = MORE_GUESSES * most, len(seconds)
    return rows


def label(variant: Variant) -> str:
    """Return a short name of a variant."""
    value, factor = variant.value, variant.factor
    match factor:
        case "":
            return "defaults"
        case "gamma":
            return f"gamma {value}"
        case "shaping_length":
            return f"shaping {1e3 * float(value):g} mm"
        case "waypoints":
            return f"{value} waypoints"
        case "normals":
            return f"normals: {value}"
        case "swept":
            return "swept" if value else "sampled"
    return str(value)


def _summary(runs: Sequence[Run], default: Sequence[Run]) -> Summary:
    lost, off = (np.concatenate([getattr(run, name) for run in runs]) for name in ("lost", "off"))
    seconds = [run.seconds for run in runs]
    proven = [run.clearance for run in runs if run.clearance is not None]
    return Summary(
        variant=runs[0].variant,
        scenes=len(runs),
        certified=sum(run.certified for run in runs),
        first=sum(run.first for run in runs),
        lost=(_quantile(lost, 0.5), _quantile(lost, 0.95)),
        off=_quantile(off, 0.5),
        length=_relative([(run.length, other.length) for run, other in zip(runs, default, strict=True)]),
        acceleration=_relative([(run.acceleration, o.acceleration) for run, o in zip(runs, default, strict=True)]),
        seconds=float(np.median(seconds)),
        slowest=max(seconds),
        kernel=_quantile(np.array([run.kernel for run in runs if run.kernel is not None]), 0.5),
        clearance=float(np.median(proven)) if proven else None,
    )


def _quantile(values: np.ndarray, part: float) -> float:
    return float(np.quantile(values, part)) if len(values) else float("nan")


def _relative(pairs: Sequence[tuple[float | None, float | None]]) -> float | None:
    """Return the geometric mean of the ratios of the pairs that have both."""
    ratios = [max(a, LEAST_REFERENCE) / max(b, LEAST_REFERENCE) for a, b in pairs if a is not None and b is not None]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else None


def _about(found: Runs) -> list[tuple[str, str]]:
    about = [("scenes", f"{len(found.scenes)}: {', '.join(found.scenes[:12])}{', …' * (len(found.scenes) > 12)}")]
    if found.refused:
        about.append(("left out", "; ".join(found.refused)))
    return about


def _advice(rows: Sequence[Summary]) -> list[tuple[str, str]]:
    """Put the numbers into words: those of the defaults, and of variants that beat them in one respect."""
    default, *others = rows
    advice = [("defaults", _words(default))]
    good = [row for row in others if row.certified >= default.certified]
    measures: dict[str, Callable[[Summary], float]] = {
        "faster": lambda row: row.seconds,
        "tighter": lambda row: row.lost[0],
        "smoother": lambda row: np.inf if row.acceleration is None else row.acceleration,
    }
    for what, measure in measures.items():
        best = min([default, *good], key=measure)
        if best is not default:
            advice.append((what, f"{label(best.variant)}: {_words(best)}"))
    if worse := [f"{label(row.variant)} {row.certified}" for row in others if row.certified < default.certified]:
        advice.append(("fewer certified", f"{', '.join(worse)} of {default.scenes}"))
    return advice


def _words(row: Summary) -> str:
    smooth = ""
    if row.acceleration is not None and row.variant.factor:
        smooth = f", {100 * row.acceleration:.0f} % of the acceleration"
    return (
        f"{row.certified} of {row.scenes} certified, {short(1e3 * row.lost[0])} mm lost "
        f"(95 %: {short(1e3 * row.lost[1])}), {short(1e3 * row.seconds)} ms{smooth}"
    )


def _row(run: Run) -> dict[str, Cell]:
    """Return a run with full precision, for the CSV."""
    return {
        "setting": run.variant.factor or "defaults",
        "value": run.variant.value,
        "scene": run.scene,
        "certified": int(run.certified),
        "attempts": run.attempts,
        "iterations": run.iterations,
        "seconds": run.seconds,
        "solve_s": run.solve,
        "certify_s": run.certify,
        "pair_us": None if run.kernel is None else 1e6 * run.kernel,
        "proven_clearance_m": run.clearance,
        "lost_median_m": float(np.median(run.lost)) if len(run.lost) else None,
        "lost_95_percent_m": float(np.quantile(run.lost, 0.95)) if len(run.lost) else None,
        "off_median_m": float(np.median(run.off)) if len(run.off) else None,
        "path_length_rad": run.length,
        "squared_acceleration_rad2": run.acceleration,
    }


def _short_row(row: Summary) -> dict[str, Cell]:
    """Return a variant for reading."""
    percent = [None if part is None else f"{100 * part:.0f}" for part in (row.length, row.acceleration)]
    return {
        "setting": label(row.variant),
        "certified": f"{row.certified} of {row.scenes}",
        "first guess": row.first,
        "lost [mm]": f"{short(1e3 * row.lost[0])} / {short(1e3 * row.lost[1])}",
        "D off [mm]": short(1e3 * row.off),
        "path [%]": percent[0],
        "acceleration [%]": percent[1],
        "time [ms]": f"{short(1e3 * row.seconds)} / {short(1e3 * row.slowest)}",
        "pair [µs]": short(1e6 * row.kernel),
    }
