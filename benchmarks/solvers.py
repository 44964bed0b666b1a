"""The shipped scenes by every solver: certified or not, proven clearance, smoothness, iterations, time.

    python benchmarks/solvers.py [SOLVER ...] [--time-limit S]

Prints a Markdown table; warm, one run each.
"""

from __future__ import annotations

import argparse
import sys

import hdplan
from hdplan.planner.solvers import SOLVERS
from hdplan.planner.studies.report import Cell, markdown_text
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import shipped_scenes


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("solvers", nargs="*", default=["gauss_newton", "chomp"], help=f"of {', '.join(SOLVERS)}")
    parser.add_argument("--time-limit", type=float, default=30.0)
    options = parser.parse_args()
    rows = []
    for name in shipped_scenes():
        scene = hdplan.load_scene(name)
        hdplan.build(scene)  # fits and compiles what is not in the cache
        for solver in options.solvers:
            rows.append({"scene": name, "solver": solver, **outcome(scene, solver, options.time_limit)})
            print(*rows[-1].values(), file=sys.stderr)
    print(markdown_text(rows))


def outcome(scene: hdplan.Scene, solver: str, time_limit: float) -> dict[str, Cell]:
    """Plan, and return what came of it."""
    try:
        result = hdplan.plan(scene, solver=solver, time_limit=time_limit)
    except InputError:  # ipopt cannot have every effect
        result = None
    clearance = result and result.certificate.clearance
    return {
        "status": "refused" if result is None else result.certificate.status.value,
        "proven clearance [mm]": None if clearance is None else f"{1e3 * clearance:.1f}",
        "smoothness": result and result.steps[-1].smoothness,
        "iterations": result and result.iterations,
        "attempts": result and result.attempts,
        "solve + certify [s]": result and f"{result.times.solve + result.times.certify:.2f}",
    }


if __name__ == "__main__":
    main()
