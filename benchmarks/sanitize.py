"""Run the loops' suites on loops that watch themselves: every read and write beyond an array, every overflow of a whole
number and every other step outside of C's rules ends the run.

    python benchmarks/sanitize.py [TEST ...]      # by default, the suites below

Needs gcc with its sanitizers (libasan). Not for tests with CasADi's solvers, which those cannot watch. Leaks of
Python are left to the laws of the border.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SUITES = (
    "tests/distance/test_border.py",
    "tests/planner/test_loop_twins.py",
    "tests/planner/control/test_loop_twins.py",
    "tests/planner/problem/test_loops.py",
    "tests/planner/motion/test_reach_loop.py",
    "tests/planner/collision/test_broad_phase.py",
    "tests/planner/collision/test_exact.py",
    "tests/planner/collision/test_hdsdf.py",
    "tests/planner/search/test_arms.py",
    "tests/planner/search/test_trees.py",
    "tests/planner/timing/test_time_optimal.py",
    "tests/planner/kinematics/test_closed_form.py",
    "tests/planner/kinematics/test_inverse.py",
    "tests/planner/certificate/test_interval_bounds.py",
)
FLAGS = ("-std=c11", "-O1", "-g", "-fno-omit-frame-pointer", "-ffp-contract=off", "-fvisibility=hidden")
# Clones are chosen before a sanitizer has begun.
WATCHED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-DHDPLAN_NO_CLONES")


def library_of(compiler: str, name: str) -> str:
    """A library that comes with the compiler."""
    done = subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def main() -> int:
    """Build, run, and return pytest's exit code."""
    compiler = os.environ.get("CC", "gcc")
    with tempfile.TemporaryDirectory(prefix="hdplan-") as folder:
        package = Path(folder) / "hdplan"  # the same package by links, with loops of its own
        package.mkdir()
        for each in (ROOT / "src/hdplan").iterdir():
            if not each.name.startswith("_loops"):
                (package / each.name).symlink_to(each.resolve())
        sources = [*(ROOT / "src/hdplan").glob("*.c"), *ROOT.glob("distance/**/*.c"), *ROOT.glob("planner/**/*.c")]
        into = ["-shared", "-fPIC", f"-I{sysconfig.get_paths()['include']}", "-lm"]
        output = ["-o", str(package / "_loops.abi3.so")]
        subprocess.run([compiler, *FLAGS, *WATCHED, *map(str, sources), *into, *output], check=True)
        # The second, as other modules throw exceptions, which the first must have seen.
        first = [library_of(compiler, name) for name in ("libasan.so", "libstdc++.so.6")]
        environment = {
            **os.environ,
            **{"ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1", "PYTHONMALLOC": "malloc"},
            **{"LD_PRELOAD": " ".join(first), "PYTHONPATH": folder},
        }
        tests = sys.argv[1:] or SUITES
        options = ["-q", "-p", "no:xdist", "-o", "addopts=--import-mode=importlib", "--capture=sys"]
        command = [sys.executable, "-m", "pytest", *options, *tests]
        return subprocess.run(command, env=environment, cwd=ROOT).returncode


if __name__ == "__main__":
    sys.exit(main())
