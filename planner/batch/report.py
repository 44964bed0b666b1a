"""The report of a run: success by group, times, clearances, and failures by cause, each with an example."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdplan.planner.causes import CAUSES
from hdplan.planner.studies.report import Cell

PHASES = ("load", "build", "compile", "solve", "certify")
Rows = Sequence[dict[str, Any]]  # of results (`tables.COLUMNS`)


def groups_of(rows: Rows) -> list[dict[str, Cell]]:
    """Return a row for each group of problems, and one for all of several: how many are certified; the time that a
    problem took, median and 95 %; medians of the certified motions' clearance, duration and length."""
    groups = defaultdict[str, list[dict[str, Any]]](list)
    for row in rows:
        groups[row["group"]].append(row)
    if len(groups) > 1:
        groups["all"] = list(rows)
    found: list[dict[str, Cell]] = []
    for name, some in groups.items():
        good = [row for row in some if row["status"] == "certified"]
        took = [1e3 * sum(row[f"time_{phase}"] or 0.0 for phase in PHASES) for row in some]
        found.append(
            {
                "problems": len(some),
                "certified": len(good),
                "median_ms": _quantile(took, 0.5),
                "95_%_ms": _quantile(took, 0.95),
                "clearance_mm": _quantile([1e3 * row["clearance"] for row in good if row["clearance"] is not None]),
                "motion_s": _quantile([row["motion_time"] for row in good if row["motion_time"] is not None]),
                "length_rad": _quantile([row["length"] for row in good]),
                "group": name or "-",
            }
        )
    return found


@dataclass(frozen=True)
class Failures:
    """Problems that failed of one cause."""

    cause: str  # in words
    count: int
    problem: str  # an example
    text: str  # what it says
    advice: str  # what would help it, where that was tried


def failures_of(rows: Rows) -> list[Failures]:
    """Return the failures by cause, the most frequent first."""
    causes = defaultdict[str, list[dict[str, Any]]](list)
    for row in rows:
        if row["status"] != "certified":
            causes[row["cause"]].append(row)
    ordered = sorted(causes.items(), key=lambda each: -len(each[1]))
    return [
        Failures(CAUSES[code], len(some), some[0]["problem"], some[0]["text"], some[0]["advice"] or "")
        for code, some in ordered
    ]


def _quantile(values: Sequence[float], share: float = 0.5) -> float | str:
    return float(f"{np.quantile(values, share):.3g}") if len(values) else "-"
