"""The cost of a start: a wheel in fresh environments, with and without a C compiler, with and without loops.

    python benchmarks/start.py DIR [--repeat R]

DIR holds MotionBenchMaker's problems. The checkout's wheel is built twice, the second time without its C loops, and
each is installed in an environment of its own, with the versions of constraints.txt. All times are processor time of
panda_cage, medians of R runs that take turns, each in a process of its own: a first plan with an empty cache, a plan
with what the first one left, the imports of that plan (hdplan's modules and all that they import), `import hdplan`.
Then four scenes are planned in one process, with the loops and without, warm.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SETS = ("bookshelf_small", "cage", "table_pick")
IMPORTED = """
import contextlib, io, sys, hdplan.cli
sys.argv = ["hdplan", "plan", "panda_cage"]
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    hdplan.cli.main()
print(",".join(name for name in sys.modules if name.startswith("hdplan")))
"""
PLANS = """
import json, sys, time, warnings, hdplan
warnings.simplefilter("ignore")
printed = []
for files in json.loads(sys.argv[1]):
    scene, best = hdplan.load_scene(*files), float("inf")
    for _ in range(3):
        began = time.process_time()
        result = hdplan.plan(scene)
        best = min(best, time.process_time() - began)
    printed.append((best, result.certificate.status.value, result.trajectory.positions.ravel().tolist()))
print(json.dumps(printed))
"""


class Installed:
    """A wheel in an environment of its own."""

    def __init__(self, folder: Path, *, loops: bool) -> None:
        """Build it and install it."""
        self.folder = folder
        build = [sys.executable, "-m", "build", "-q", "--wheel", "--outdir", str(folder / "dist"), str(ROOT)]
        subprocess.run(build, env={**os.environ, "HDPLAN_BUILD_LOOPS": str(int(loops))}, check=True, stdout=sys.stderr)
        (self.wheel,) = (folder / "dist").glob("*.whl")
        subprocess.run([sys.executable, "-m", "venv", str(folder / "env")], check=True)
        pip = [str(folder / "env/bin/pip"), "install", "-q", "-c", str(ROOT / "constraints.txt"), str(self.wheel)]
        subprocess.run(pip, check=True, stdout=sys.stderr)

    def run(self, *command: str, cache: Path, compiler: bool) -> tuple[float, str]:
        """Run a program of the environment. Returns its processor time [s] and what it printed."""
        program, *arguments = command
        place = str(self.folder / "env/bin")
        env = {"PATH": os.pathsep.join([place, os.environ["PATH"]]) if compiler else place, "HDPLAN_CACHE": str(cache)}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        called = [f"{place}/{program}", *arguments]
        done = subprocess.run(
            called, env=env, cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise SystemExit(f"{' '.join(called[:3])} ended with {done.returncode}")
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def starts(wheel: Installed, repeat: int) -> dict[tuple[str, bool], float]:
    """Programs that are started, and whether there is a compiler -> processor time [s]."""
    cache, empty = wheel.folder / "cache", wheel.folder / "empty"
    _, names = wheel.run("python", "-c", IMPORTED, cache=cache, compiler=True)
    kinds = {
        "a first plan, with an empty cache": ("hdplan", "plan", "panda_cage"),
        "a plan from the shell, warm": ("hdplan", "plan", "panda_cage"),
        "what it imports": ("python", "-c", f"import {names.strip()}"),
        "`import hdplan`": ("python", "-c", "import hdplan"),
    }
    times: dict[tuple[str, bool], list[float]] = {}
    for _ in range(repeat):
        for kind, command in kinds.items():
            for compiler in (True, False):
                shutil.rmtree(empty, ignore_errors=True)
                seconds, _ = wheel.run(*command, cache=empty if "empty" in kind else cache, compiler=compiler)
                times.setdefault((kind, compiler), []).append(seconds)
    return {key: statistics.median(found) for key, found in times.items()}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problems", type=Path, metavar="DIR", help="MotionBenchMaker's problems")
    parser.add_argument("--repeat", type=int, default=9, metavar="R", help="runs of each kind (default: %(default)s)")
    options = parser.parse_args()
    panda = options.problems.resolve() / "panda"
    scenes = [["panda_cage"]]
    scenes += [[str(panda / each / f"{what}0002.yaml") for what in ("scene", "request")] for each in SETS]
    for pair in scenes[1:]:
        pair.append(str(panda / "robot.yaml"))
    with tempfile.TemporaryDirectory() as folder:
        with_loops = Installed(Path(folder) / "loops", loops=True)
        without = Installed(Path(folder) / "none", loops=False)
        print("| processor time [s] | with a C compiler | without |\n| --- | --- | --- |")
        found = starts(with_loops, options.repeat)
        for kind in dict.fromkeys(kind for kind, _ in found):
            print(f"| {kind} | {found[kind, True]:.3f} | {found[kind, False]:.3f} |")
        print(f"\nThe wheel has {with_loops.wheel.stat().st_size / 1e6:.2f} MB.\n")
        measured = []
        for each in (with_loops, without):
            command = ("python", "-c", PLANS, json.dumps(scenes))
            measured.append(json.loads(each.run(*command, cache=each.folder / "cache", compiler=False)[1]))
    print("| warm plan in one process | loops of C [s] | NumPy instead [s] | times as long | joints differ by [rad] |")
    print("| --- | --- | --- | --- | --- |")
    for files, (fast, status, motion), (slow, other, same) in zip(scenes, *measured, strict=True):
        name = "panda_cage" if len(files) == 1 else f"{Path(files[0]).parent.name} 2"
        differ = max((abs(a - b) for a, b in zip(motion, same, strict=True)), default=0.0)
        print(f"| {name}, {status}, {other} | {fast:.3f} | {slow:.3f} | {slow / fast:.0f} | {differ:.0e} |")


if __name__ == "__main__":
    main()
