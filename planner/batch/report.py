"""What became of a run: success by group, times, clearances, and failures by cause with a problem to look at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hdplan.planner.batch.causes import CAUSES
from hdplan.planner.studies.report import markdown_text

PHASES = ("load", "build", "compile", "solve", "certify")


def report_text(rows: Sequence[dict[str, Any]], of: int) -> str:
    """Return the report as Markdown: of `rows` of results, of a run of `of` problems."""
    done = f"{len(rows)} of {of} problems" if len(rows) < of else f"{of} problems"
    certified = sum(row["status"] == "certified" for row in rows)
    parts = [f"{done}: {certified} certified", markdown_text(_groups(rows))]
    if failed := [row for row in rows if row["status"] != "certified"]:
        parts.append(markdown_text(_failures(failed)))
    return "\n\n".join(part.rstrip() for part in parts)


def _groups(rows: Sequence[dict[str, Any]]) -> list[dict[str, object]]:
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(row["group"], []).append(row)
    if len(groups) > 1:
        groups["**all**"] = list(rows)
    found: list[dict[str, object]] = []
    for name, some in groups.items():
        good = [row for row in some if row["status"] == "certified"]
        took = [sum(row[f"time_{phase}"] or 0.0 for phase in PHASES) for row in some]
        clearances = [1e3 * row["clearance"] for row in good if row["clearance"] is not None]
        durations = [row["motion_time"] for row in good if row["motion_time"] is not None]
        found.append(
            {
                "group": name,
                "problems": len(some),
                "certified": len(good),
                "time median / 95 % / most [ms]": _spread(1e3 * np.array(took), (0.5, 0.95, 1.0)),
                "clearance 5 % / median [mm]": _spread(clearances, (0.05, 0.5)),
                "motion time median / most [s]": _spread(durations, (0.5, 1.0), ".2f"),
                "length median [rad]": _spread([row["length"] for row in good], (0.5,), ".2f"),
            }
        )
    return found


def _failures(failed: Sequence[dict[str, Any]]) -> list[dict[str, object]]:
    causes: dict[str, list[dict[str, Any]]] = {}
    for row in failed:
        causes.setdefault(row["cause"], []).append(row)
    ordered = sorted(causes.items(), key=lambda each: -len(each[1]))
    return [
        {
            "cause": f"{code}: {CAUSES.get(code, code)}",
            "problems": len(some),
            "look at": some[0]["problem"],
            "which says": some[0]["text"],
        }
        for code, some in ordered
    ]


def _spread(values: Any, shares: Sequence[float], form: str = ".0f") -> str | None:
    return " / ".join(f"{x:{form}}" for x in np.quantile(values, shares)) if len(values) else None
