"""The study of accuracy against time: measured, written as CSV, Markdown and PNG, and summarized in a few lines."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from hdplan.planner.studies.report import (
    Cell,
    Report,
    Reporter,
    Stopper,
    check_report,
    csv_text,
    length_text,
    markdown_text,
    png,
    short,
    write_report,
)
from hdplan.scenes.planner_settings import PlannerSettings

if TYPE_CHECKING:
    from hdplan.distance.studies.accuracy import Entry, Study
    from hdplan.distance.studies.unions import Cut

FILES = ("distance_study.csv", "distance_study.md", "distance_study.png")
UNIONS_FILE = "distance_unions.csv"
GAP = 1e-2  # [m] at which settings are compared
GAMMA = 2  # to take: the least with second derivatives, which the optimizer needs
DEFAULTS = PlannerSettings()
UNIONS_LEGEND = """\
A box in slices and a ring of hulls, against a box, with paper+edges, gamma 2, shaping length 1 mm: false positives as
above; the median of D/d beyond 5 cm and of d - D within it, d the exact distance of the finest cut; and times.
"""
LEGEND = """\
Times are per query [µs], on {block} poses at once, half of them near contact; the geometric mean over the pairs of
bodies. Everything else is the mean. float64 runs as generated C on one core, float32 as a JAX batch on whatever JAX
finds. False positives: D <= 0 although the bodies are at least so far apart, in % of the random poses that are. Errors:
the median and the 95th percentile of |D - d| [mm], d the exact distance: apart (d > 5 cm), near (|d| <= 5 cm), deep
(d < -5 cm). Sign lost: D <= 0 although D̃ > 0, in % of all poses: there D is too small for a number. Bend: how fast the
gradient turns near contact, the root mean square of D's largest curvature along a translation.
"""


def study_distance(folder: Path, quick: bool, report: Reporter, stop: Stopper) -> Report:
    """Measure, and write FILES and UNIONS_FILE into ``folder``; for ``quick`` one pair of bodies, two orders, and
    neither Hessians nor unions.

    Raises InputError for a folder that cannot be written and a missing matplotlib, KeyboardInterrupt if it is stopped
    before there is anything to show.
    """
    from hdplan.distance.studies.accuracy import BLOCK, FULL_PLAN, QUICK, best_buy, study
    from hdplan.distance.studies.unions import BODIES, PIECES, study_unions

    paths = check_report(folder, FILES if quick else (*FILES, UNIONS_FILE))
    begin = perf_counter()
    plan = QUICK if quick else FULL_PLAN
    if importlib.util.find_spec("jax") is None:
        plan = replace(plan, kernels=tuple(kernel for kernel in plan.kernels if kernel[2] != "float32"))
    found = study(plan, report=report, stop=stop)
    means = found.means()
    eligible = [e for e in means if e.setting.gamma == GAMMA and e.setting.precision == "float64"]
    if not eligible:
        raise KeyboardInterrupt
    from hdplan.planner.studies.distance_sheet import study_sheet

    cuts = study_unions(report=report, stop=stop) if found.complete and not quick else []
    complete = found.complete and (quick or len(cuts) == len(BODIES) * len(PIECES))
    choice = best_buy(eligible, GAP, "gradient", found.plan.random * len(found.bodies))
    notes = [*_about(found), *_advice(means, choice)]
    title = "# What accuracy of the distance costs in time\n"
    text = "".join(f"- **{what}**: {words}\n" for what, words in notes)
    took = f"{perf_counter() - begin:.0f} s on {os.cpu_count()} processors"
    measured = f"- **measured** in {took}{'' if complete else ', interrupted: what there was until then'}\n"
    markdown = "\n".join(
        [title, text + measured, LEGEND.format(block=BLOCK), markdown_text([_short_row(e) for e in means])]
    )
    every = [_row(entry) for entry in (*found.entries, *means)]
    contents: list[str | bytes] = [csv_text(every), markdown, png(study_sheet(found, choice))]
    unions = [union_row(each) for each in cuts]
    if unions:
        contents[1] = f"{markdown}\n## Unions of pieces\n\n{UNIONS_LEGEND}\n{markdown_text(unions)}"
        contents.append(csv_text([_union_record(each) for each in cuts]))
    paths = paths[: len(contents)]
    write_report(paths, contents)
    rungs = [_summary(e) for e in means if _is_default(e)]
    words = f"gamma {DEFAULTS.gamma}, shaping length {length_text(DEFAULTS.shaping_length)}, float64"
    tables = {f"sets of normals at {words}": rungs, "unions of pieces": unions}
    return Report({title: rows for title, rows in tables.items() if rows}, notes, paths, complete)


def union_row(each: Cut) -> dict[str, Cell]:
    """Return the results for a body cut into pieces, as a row of a table."""
    return {
        "body": each.body,
        "pieces": each.pieces,
        **{f"> {length_text(gap)} [%]": 100.0 * rate for gap, rate in each.false_positives.items()},
        "D/d": each.ratio,
        "near: d - D [mm]": 1e3 * each.near_error,
        **{f"{order} [µs]": 1e6 * time for order, time in each.seconds.items()},
    }


def _union_record(each: Cut) -> dict[str, Cell]:
    """Return a copy with full precision, for the CSV."""
    return {
        "body": each.body,
        "pieces": each.pieces,
        **{f"false_positives_at_{gap:g}_m_percent": 100.0 * rate for gap, rate in each.false_positives.items()},
        "contacts_called_free": each.missed,
        "median_ratio": each.ratio,
        "near_median_error_m": each.near_error,
        **{f"{order}_us": 1e6 * time for order, time in each.seconds.items()},
    }


def _about(found: Study) -> list[tuple[str, str]]:
    plan = found.plan
    bodies = ", ".join(found.bodies)
    about = [("bodies", f"{bodies}; {plan.random} random poses each and {plan.near} close to contact")]
    if all(precision != "float32" for *_, precision in plan.kernels):
        about.append(("not measured", "float32: it runs in JAX, which is not installed: pip install jax"))
    return about


def _advice(means: Sequence[Entry], choice: Entry) -> list[tuple[str, str]]:
    """Put the numbers into words."""
    double = [e for e in means if e.setting.precision == "float64"]
    paper = [e for e in double if (e.setting.gamma, e.setting.normals) == (GAMMA, "paper")]
    others = [e for e in double if e.setting.normals == choice.setting.normals]
    advice = [
        ("take", f"{describe(choice)}: {_rate(choice)}, {_us(choice.seconds['gradient'])} for value and gradient")
    ]
    if paper and choice.setting.normals != "paper":
        time = _us(paper[0].seconds["gradient"])
        advice.append(
            ("normals", f"the least product of time and false positives; paper alone: {_rate(paper[0])}, {time}")
        )
    for what, some in (
        ("gamma", [e for e in others if e.setting.shaping_length == choice.setting.shaping_length]),
        ("shaping length", [e for e in others if e.setting.gamma == GAMMA]),
    ):
        reads = ", ".join(_near(e, what) for e in some)
        why = "the least with second derivatives" if what == "gamma" else "the largest that reads as well as smaller"
        advice.append((what, f"{why}; error near contact{', bend' * (choice.bend is not None)}: {reads}"))
    worst = max(means, key=lambda e: e.sign_lost)
    kept = "is that of D̃ at every pose and setting"
    lost = f"is lost by underflow at up to {_percent(worst.sign_lost)} of the poses ({describe(worst)}): use D̃ there"
    return [*advice, ("sign of D", lost if worst.sign_lost else kept)]


def _rate(entry: Entry) -> str:
    return f"{_percent(entry.false_positives[GAP])} of gaps over {length_text(GAP)} taken for contact"


def _near(entry: Entry, what: str) -> str:
    """Return error and bend near contact at one gamma or shaping length."""
    at = str(entry.setting.gamma) if what == "gamma" else length_text(entry.setting.shaping_length)
    bend = "" if entry.bend is None else f" and {entry.bend:.0f}/m"
    return f"{entry.median_error['near'] * 1e3:.3g} mm{bend} at {at}"


def describe(entry: Entry) -> str:
    """Describe a setting."""
    s = entry.setting
    return f"{s.normals}, gamma {s.gamma}, {length_text(s.shaping_length)}, {s.precision}"


def _is_default(entry: Entry) -> bool:
    s = entry.setting
    return (s.gamma, s.shaping_length, s.precision) == (DEFAULTS.gamma, DEFAULTS.shaping_length, "float64")


def _summary(entry: Entry) -> dict[str, Cell]:
    orders = {"gradient": "+gradient", "hessian": "+Hessian"}
    return {
        "normals": entry.setting.normals,
        **{f"> {length_text(gap)} [%]": short(100.0 * entry.false_positives[gap]) for gap in (1e-3, 1e-2, 1e-1)},
        "near [mm]": short(1e3 * entry.median_error["near"]),
        **{f"{orders.get(order, order)} [µs]": short(1e6 * time) for order, time in entry.seconds.items()},
    }


def _row(entry: Entry) -> dict[str, Cell]:
    """Return an entry with full precision, for the CSV."""
    from hdplan.distance.studies.accuracy import ORDERS, RUNS_IN

    return {
        "bodies": entry.bodies,
        "normals": entry.setting.normals,
        "gamma": entry.setting.gamma,
        "shaping_length_m": entry.setting.shaping_length,
        "precision": entry.setting.precision,
        "runs_in": RUNS_IN[entry.setting.precision],
        **{f"false_positives_at_{gap:g}_m_percent": 100.0 * rate for gap, rate in entry.false_positives.items()},
        "sign_lost_percent": 100.0 * entry.sign_lost,
        **{f"{band}_bias_m": value for band, value in entry.bias.items()},
        **{f"{band}_median_error_m": value for band, value in entry.median_error.items()},
        **{f"{band}_95_percent_error_m": value for band, value in entry.high_error.items()},
        "near_bend_per_m": entry.bend,
        **{f"{order}_us": 1e6 * entry.seconds[order] if order in entry.seconds else None for order in ORDERS},
    }


def _short_row(entry: Entry) -> dict[str, Cell]:
    """Return an entry for reading, for the Markdown table."""
    return {
        "normals": entry.setting.normals,
        "gamma": entry.setting.gamma,
        "shaping length": length_text(entry.setting.shaping_length),
        "precision": entry.setting.precision,
        **{f"> {length_text(gap)} [%]": 100.0 * rate for gap, rate in entry.false_positives.items()},
        "sign lost [%]": 100.0 * entry.sign_lost,
        **{
            f"{band} [mm]": f"{short(1e3 * entry.median_error[band])} / {short(1e3 * entry.high_error[band])}"
            for band in entry.median_error
        },
        **({} if entry.bend is None else {"bend [1/m]": entry.bend}),
        **{f"{order} [µs]": 1e6 * time for order, time in entry.seconds.items()},
    }


def _us(seconds: float) -> str:
    return f"{seconds * 1e6:.3g} µs"


def _percent(part: float) -> str:
    return f"{100.0 * part:.2g} %" if part else "none"
