"""The paper's figures reproduced: measured, written as CSV and PNG, and compared with the paper.

Each function writes its files into ``folder`` and returns a report. All raise InputError for a folder that cannot be
written and a missing matplotlib, and KeyboardInterrupt if they are stopped before there is anything to show. ``report``
and ``stop`` are those of ``report.Reporter`` and ``Stopper``.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.studies.report import (
    Cell,
    Report,
    Reporter,
    Stopper,
    check_report,
    csv_text,
    png,
    short,
    write_report,
)
from hdplan.scenes.once import read_only

if TYPE_CHECKING:
    from hdplan.distance.studies.query_time import PairTimes

QUICK_CONFIGURATIONS, QUICK_NORMALS = 15_000, ("paper", "paper+edges")
QUICK_PAIRS = (("tetrahedron", "tetrahedron"), ("cube", "cube"), ("octahedron", "icosahedron"))
TOLERANCES = read_only(np.geomspace(1e-4, 0.3, 70))  # [m] of the curve
SHOWN = {"0.1 mm": 1e-4, "1 cm": 1e-2, "10 cm": 0.1, "30 cm": 0.3}  # gaps of the printed table [m]
# the paper's false positives [%], and our limit
PUBLISHED = (("0.1 mm", "around 0.7", 0.85), ("10 cm", "below 0.2", 0.2))
PAPER_RATIOS = (  # how many times as long the paper's HD-SDF takes on one core as others, at most
    ("HD-SDF slower than FCL, up to", "FCL", 500),
    ("HD-SDF slower than GDF, up to", "GDF uaibot", 50),
    ("batch faster than one core, up to", "JAX batch", 13),
)
HEADS = {
    "GDF uaibot": "uaibot",
    "interpreter": "interp.",
    "compiled, one pose a call": "1 pose",
    "compiled": "table",
    "JAX batch": "JAX",
}


def reproduce_conservativeness(folder: Path, quick: bool, report: Reporter, stop: Stopper) -> Report:
    """Count false positives over random configurations; for ``quick`` over fewer of them, and for fewer sets."""
    from hdplan.distance.normals import RUNGS
    from hdplan.distance.studies.conservativeness import CONFIGURATIONS, conservativeness

    paths = check_report(folder, ("conservativeness.csv", "conservativeness.png"))
    has_fcl = importlib.util.find_spec("fcl") is not None
    number, normals = (QUICK_CONFIGURATIONS, QUICK_NORMALS) if quick else (CONFIGURATIONS, RUNGS)
    found = conservativeness(number, normals, with_fcl=has_fcl, report=report, stop=stop)
    if not len(found.distances):
        raise KeyboardInterrupt
    from hdplan.planner.studies.conservativeness_sheet import conservativeness_sheet

    rates = [
        (100.0 * found.rates(rung, TOLERANCES), 100.0 * found.rates_of_all(rung, TOLERANCES)) for rung in found.rungs
    ]
    columns = ("normals", "tolerance_m", "percent_of_those_apart", "percent_of_all")
    lines: list[dict[str, Cell]] = [
        dict(zip(columns, (rung.normals, *map(float, numbers)), strict=True))
        for rung, rate in zip(found.rungs, rates, strict=True)
        for numbers in zip(TOLERANCES, *rate, strict=True)
    ]
    write_report(paths, [csv_text(lines), png(conservativeness_sheet(found, TOLERANCES))])
    rungs: list[dict[str, Cell]] = [
        {
            "normals": rung.normals,
            **{f"{gap} [%]": short(100.0 * float(found.rates(rung, tol))) for gap, tol in SHOWN.items()},
            "widest [cm]": short(100.0 * float(np.max(rung.gaps, initial=0.0))),
        }
        for rung in found.rungs
    ]
    own = found.rungs[0]
    paper: list[dict[str, Cell]] = []
    for gap, published, limit in PUBLISHED:
        among, of_all = (100.0 * float(rate(own, SHOWN[gap])) for rate in (found.rates, found.rates_of_all))
        verdict = ("met" if among < limit else "missed") if found.complete and not quick else "too few to say"
        own_rates = {"of those apart": short(among), "of all": short(of_all)}
        paper.append({"gap": gap, "the paper [%]": published, **own_rates, "": verdict})
    exact = "not held against FCL's, which is not installed: pip install python-fcl"
    if found.fcl_compared:
        exact = f"as FCL's to {found.fcl_difference:.1g} m, on {found.fcl_compared} configurations"
    counted = f"{len(found.distances)} of {found.planned}, {found.missed} contacts called free"
    notes = (("configurations", counted), ("exact distance", exact))
    tables = {"false positives beyond a gap, of those so far apart": rungs, "the paper's set of normals": paper}
    return Report(tables, notes, paths, found.complete)


def reproduce_kinks(folder: Path) -> Report:
    """Follow two squares past each other."""
    from hdplan.distance.studies.kinks import GAMMA, INSTANT, SHAPING_LENGTHS, kinks

    paths = check_report(folder, ("kinks.csv", "kinks.png"))
    found = kinks()
    from hdplan.planner.studies.kinks_sheet import kinks_sheet

    names = ("euclidean", *(f"hdsdf_{length * 100:g}cm" for length in SHAPING_LENGTHS))
    columns = {
        f"{name}_{unit}": column
        for name, curve in zip(names, (found.euclidean, *found.smooth), strict=True)
        for unit, column in (("m", curve.value), ("rate_m_per_s", curve.rate), ("second_m_per_s2", curve.second))
    }
    lines: list[dict[str, Cell]] = [
        {"time_s": float(time), **{name: _number(column[k]) for name, column in columns.items()}}
        for k, time in enumerate(found.times)
    ]
    write_report(paths, [csv_text(lines), png(kinks_sheet(found))])
    jumps: list[dict[str, Cell]] = [
        {
            "kink": number + 1,
            "time [s]": f"{kink.time:.3f}",
            "distance [m]": f"{kink.distance:.3f}",
            "rate before [m/s]": f"{kink.before:.3f}",
            "after": f"{kink.after:.3f}",
            "jump": f"{abs(kink.after - kink.before):.3f}",
        }
        for number, kink in enumerate(found.kinks)
    ]
    largest = max(abs(kink.after - kink.before) for kink in found.kinks)
    notes = (
        ("Euclidean", f"its rate jumps {len(found.kinks)} times, by up to {largest:.2g} m/s"),
        ("HD-SDF", f"gamma {GAMMA}: its rate changes by at most {found.largest_jump:.1g} m/s in {INSTANT * 1e9:g} ns, "
         "where it is steepest: no jump"),
        ("the paper", "kinks where closest points or separating normals are not unique, none in the HD-SDF"),
    )  # fmt: skip
    return Report({"kinks of the Euclidean distance": jumps}, notes, paths, True)


def reproduce_time(folder: Path, quick: bool, report: Reporter, stop: Stopper) -> Report:
    """Time every way to a distance over the pairs of Platonic solids; for ``quick`` over three of them."""
    from hdplan.distance.studies.query_time import METHODS, available_methods, batch_device, query_times
    from hdplan.distance.studies.random_poses import PLATONIC_PAIRS

    paths = check_report(folder, ("time.csv", "time.png"))
    found = query_times(QUICK_PAIRS if quick else PLATONIC_PAIRS, report=report, stop=stop)
    if not found.pairs:
        raise KeyboardInterrupt
    from hdplan.planner.studies.query_time_sheet import time_sheet

    names = available_methods()
    lines, shown = list[dict[str, Cell]](), list[dict[str, Cell]]()
    for each in found.pairs:
        about: dict[str, Cell] = {"pair": _names(each), "complexity": each.complexity}
        lines.append(about | {f"{name} [us]": 1e6 * each.seconds[name] for name in names})
        shown.append(about | {HEADS.get(name, name): short(1e6 * each.seconds[name]) for name in names})
    write_report(paths, [csv_text(lines), png(time_sheet(found))])
    slowest = max(found.pairs, key=lambda pair: pair.seconds["compiled"])
    worst = f"{1e6 * slowest.seconds['compiled']:.3g} µs"
    compare: list[dict[str, Cell]] = [
        {"": "slowest HD-SDF on one core", "paper": "5 ms", "here": worst, "pair": _names(slowest)}
    ]
    for words, other, published in PAPER_RATIOS:
        if other in names:
            ratio, pair = max((pair.ratio("compiled", other), _names(pair)) for pair in found.pairs)
            compare.append({"": words, "paper": f"{published} ×", "here": f"{ratio:.3g} ×", "pair": pair})
    missing = [name for name in METHODS if name not in names]
    notes = [("HD-SDF", "by CasADi's interpreter; compiled, one pose a call and a table of poses; in JAX batches")]
    if "JAX batch" in names:
        notes.append(
            ("JAX", f"runs on {batch_device()}, {os.cpu_count()} processors; the paper's batch on an RTX 4060")
        )
    if missing:
        notes.append(("not measured", f"{', '.join(missing)}: not installed"))
    return Report({"time per query [µs]": shown, "beside the paper": compare}, notes, paths, found.complete)


def _names(pair: PairTimes) -> str:
    return "-".join(name.removesuffix("hedron") for name in pair.names)


def _number(value: float) -> Cell:
    return None if np.isnan(value) else float(value)
