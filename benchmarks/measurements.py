"""Write the measured parts of docs/measurements.md, docs/certificate.md, docs/install.md and README.md again, each by
its command.

    python benchmarks/measurements.py [NAME ...] [--problems DIR] [--jobs N] [--list]

A measured block lies between `<!-- measured by: COMMAND -->` and `<!-- end -->`. COMMAND is a benchmark with its
arguments, as it is called from the checkout's folder; DIR in it stands for the folder of MotionBenchMaker's problems,
beside which `kinova_arm` of zonopy-robots has to lie.
What the benchmark prints takes the block's place, with a line about machine, versions and time under it: the whole
block or, where the benchmark fails, nothing of it. NAME chooses the blocks whose command contains it; without a name
all are measured, N at a time, those with a browser alone, as they keep two cores busy; Ctrl-C keeps those that are
done. With `--jobs 2`, two cores need less than three hours for all. `--list` shows the commands, where and how long
each was measured, and the sum of these times. Exit code 1 if a block was left as it was.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock

from hdplan.scenes.output import write_output

ROOT = Path(__file__).resolve().parent.parent
PAGES = tuple(ROOT / page for page in ("docs/measurements.md", "docs/certificate.md", "docs/install.md", "README.md"))
BEGIN, END = "<!-- measured by: ", "<!-- end -->"
BLOCK = re.compile(rf"^{re.escape(BEGIN)}(.+) -->\n((?:(?!{re.escape(BEGIN)}).*\n)*?){re.escape(END)}$", re.MULTILINE)
PROBLEMS = "DIR"
BROWSER = "benchmarks/view"  # how commands begin that drive one
SPENT = re.compile(r" in (\d+) s, ")
PACKAGES = (  # those of them that are installed
    *("hdplan", "numpy", "casadi", "pin", "coal", "jax"),
    *("drake", "ompl", "roboplan", "hpp-core", "tesseract-robotics-nanobind"),
)


class Failed(Exception):
    """A benchmark gave nothing that could be shown."""


def blocks(page: str) -> dict[str, str]:
    """Return the content of each block of a page, by its command. Raises ValueError for a block without begin or
    end."""
    found = BLOCK.findall(page)
    if not len(found) == page.count(BEGIN) == page.count(END):
        raise ValueError(f"every '{BEGIN}COMMAND -->' needs its '{END}', each on a line of its own")
    return dict(found)


def replaced(page: str, command: str, content: str) -> str:
    """Return the page with `content` in the block of this command."""
    return BLOCK.sub(lambda block: f"{BEGIN}{command} -->\n{content}{END}" if block[1] == command else block[0], page)


def measured(command: str, problems: Path | None) -> str:
    """Run a benchmark and return what a page shows of it. Raises Failed."""
    words = shlex.split(command)
    for place, word in enumerate(words):
        folder, *below = word.split("/")
        if folder == PROBLEMS:
            if problems is None:
                raise Failed("it needs MotionBenchMaker's problems: --problems DIR")
            words[place] = str(problems.resolve().joinpath(*below))
    load, began = os.getloadavg()[0], time.monotonic()
    done = subprocess.run([sys.executable, *words], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    seconds = time.monotonic() - began
    if done.returncode:
        raise Failed(f"exit code {done.returncode}")
    if not done.stdout.strip():
        raise Failed("it printed nothing")
    found = done.stdout.strip()
    if problems is not None:
        found = found.replace(str(problems.resolve()), "DIR")  # the page names no folder of the machine's own
    return f"{found}\n\n*Measured by `{command}` in {seconds:.0f} s, {machine(load)}.*\n"


def machine(load: float) -> str:
    """Say on what machine and with which versions this runs, and how busy it was when the benchmark began."""
    information = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*: (.+)$", information.read_text() if information.is_file() else "", re.MULTILINE)
    found = {item.name: item.version for item in importlib.metadata.distributions()}
    versions = ", ".join(f"{package} {found[package]}" for package in PACKAGES if package in found)
    return (
        f"load average {load:.1f} before it, on {os.cpu_count()} cores of {names[0] if names else platform.machine()} "
        f"with Python {platform.python_version()}, {versions}"
    )


def renew(pages: Iterable[Path], command: str, problems: Path | None, writing: Lock) -> bool:
    """Measure by one command and write the pages; False where the benchmark failed, and they are left as they were."""
    print(command, file=sys.stderr)
    try:
        content = measured(command, problems)
    except Failed as reason:
        print(f"{command}: left as it was, {reason}", file=sys.stderr)
        return False
    with writing:
        for page in pages:
            text = page.read_text(encoding="utf-8")
            if command in blocks(text):
                write_output(page, replaced(text, command, content).encode())
    return True


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="of the blocks: part of their command")
    parser.add_argument("--problems", type=Path, metavar=PROBLEMS, help="MotionBenchMaker's problems")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="commands at a time")
    parser.add_argument("--list", action="store_true", help="show the blocks and measure nothing")
    options = parser.parse_args()
    contents = {command: text for page in PAGES for command, text in blocks(page.read_text(encoding="utf-8")).items()}
    for name in options.names:
        if not any(name in command for command in contents):
            parser.error(f"NAME '{name}' is in no command; there are:\n  " + "\n  ".join(contents))
    chosen = [command for command in contents if not options.names or any(name in command for name in options.names)]
    if options.list:
        lines = {command: contents[command].strip().splitlines()[-1].strip("*") for command in chosen}
        print("\n".join(f"{command}\n    {line}" for command, line in lines.items()))
        spent = [int(found[1]) for line in lines.values() if (found := SPENT.search(line))]
        print(f"{sum(spent) / 3600:.1f} h for {len(spent)} of {len(chosen)}")
        return 0
    done, writing = list[bool](), Lock()
    try:
        for jobs, browser in ((1, True), (options.jobs, False)):
            own = [command for command in chosen if command.startswith(BROWSER) == browser]
            with ThreadPoolExecutor(jobs) as pool:
                done += pool.map(lambda command: renew(PAGES, command, options.problems, writing), own)
    except KeyboardInterrupt:  # the pool begins nothing more
        print(f"interrupted; {sum(done)} of {len(chosen)} blocks are written", file=sys.stderr)
        return 130
    return int(not all(done))


if __name__ == "__main__":
    sys.exit(main())
