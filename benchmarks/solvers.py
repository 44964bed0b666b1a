"""The shipped scenes by every solver: certified or not, proven clearance, smoothness, iterations, time.

    python benchmarks/solvers.py [SOLVER ...] [--time-limit S]

Prints a Markdown table; warm, one run each.
"""

from __future__ import annotations

import argparse

import hdplan
from hdplan.planner.solvers import SOLVERS
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import shipped_scenes


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("solvers", nargs="*", default=["gauss_newton", "chomp"], help=f"of {', '.join(SOLVERS)}")
    parser.add_argument("--time-limit", type=float, default=30.0)
    options = parser.parse_args()
    print(
        "| scene | solver | status | proven clearance [mm] | smoothness | iterations | attempts | solve + certify [s] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name in shipped_scenes():
        scene = hdplan.load_scene(name)
        hdplan.build(scene)  # fits and compiles what is not in the cache
        for solver in options.solvers:
            try:
                result = hdplan.plan(scene, solver=solver, time_limit=options.time_limit)
            except InputError as error:  # ipopt cannot have every effect
                print(f"| {name} | {solver} | refused: {error} | | | | | |", flush=True)
                continue
            clearance = result.certificate.clearance
            print(
                f"| {name} | {solver} | {result.certificate.status.value} "
                f"| {'–' if clearance is None else f'{1e3 * clearance:.1f}'} | {result.steps[-1].smoothness:.2f} "
                f"| {result.iterations} | {result.attempts} | {result.times.solve + result.times.certify:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
