"""How soon `hdplan view` shows its first picture, and what it takes after a thousand drags.

    python benchmarks/view_endures.py [--first SCENE ...] [--drags N] [--runs N]

With --first, for each scene: from the command's start to the address that it writes, to the panel with its words in a
browser that waits for it, and to the first picture with the robot in it; and the command's processor time, which does
not depend on what else the machine does as the others do; medians of a few runs. The page does all it
does but fill triangles, which a graphics card does elsewhere. It needs chromium and playwright.

With --drags, one scene is dragged so often (each a press, three movements and a release, with the motion that follows),
without a browser: the time of a drag at the beginning and at the end, and the memory of the process before and after;
then all of it is undone. After 13 minutes, at Ctrl-C or SIGTERM, it stops and writes its results.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import signal
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from chromium import browser

from hdplan.planner.plan import plan
from hdplan.planner.studies.report import markdown_text
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.things import Thing, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Pose
from hdplan.scenes.yaml_format.reader import load_scene

SCENES = ("panda_cage", "ur5_table", "panda_camera")
DRAGGED = ("panda_cage", "bar4")  # scene and obstacle
MOVES, WAY = 3, 0.02  # movements of a drag, and [m] of them
FIRST = (
    *("address written [s]", "panel says something [s]", "robot drawn [s]"),
    *("processor time of the command until the address [s]", "until the robot [s]"),
)
LONGEST, LINE_EVERY = 780.0, 100  # [s] of all drags, and after how many of them a line is written
SHARE = 10  # the first and the last of so many parts are compared
RUNS = 3
ROBOT = 1500  # indices of a mesh that is one of the robot's, and not a grid or a label
SEEN = """for (const name of ["drawElements", "drawElementsInstanced"]) {
  WebGL2RenderingContext.prototype[name] = (mode, count) => { if (count > LEAST) window.seen ??= Date.now(); };
}
for (const name of ["drawArrays", "drawArraysInstanced"]) WebGL2RenderingContext.prototype[name] = () => {};
""".replace("LEAST", str(ROBOT))


def processor(process: int) -> float:
    """Return the processor time that a process has taken [s]."""
    user, system = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def first(name: str, browser: Any) -> tuple[float, ...]:
    """Return how long after the command [s] the address is written, the panel says something, the robot is drawn; and
    the command's processor time [s] until the address is written, and until the robot is drawn."""
    page = browser.new_page(viewport={"width": 1400, "height": 820})
    page.add_init_script(SEEN)
    command = [sys.executable, "-m", "hdplan.cli", "view", name, "--port", "8390"]
    began = time.time()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        address = re.search(r"http://\S+(?<!,)", child.stdout.readline())
        served, to_serve = time.time() - began, processor(child.pid)
        assert address is not None
        page.goto(address[0], wait_until="commit")
        page.locator(".hd-two").first.wait_for(state="attached")
        reported = time.time() - began
        page.wait_for_function("window.seen")
        drawn, to_draw = page.evaluate("window.seen") / 1e3 - began, processor(child.pid)
        page.close()
        child.terminate()  # Ctrl-C is not heard by what a shell runs in the background
        child.wait()
    return served, reported, drawn, to_serve, to_draw


def firsts(names: list[str], runs: int) -> list[dict[str, str]]:
    """Measure the first pictures; return rows of the table."""
    rows = []
    with browser() as opened:
        for name in names:
            found = [first(name, opened) for _ in range(runs)]
            medians = [statistics.median(column) for column in zip(*found, strict=True)]
            rows.append({"scene": name} | {words: f"{value:.2f}" for words, value in zip(FIRST, medians, strict=True)})
    return rows


def memory() -> float:
    """Return the memory that this process holds [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def dragged(viewer: Viewer, thing: Thing, way: np.ndarray) -> float:
    """Drag a thing along a way (3,) [m], and let it go; return the processor time of it all [s]."""
    handles, began = viewer.panel.handles, time.process_time()
    at = np.array(place_of(viewer.edited, thing, viewer.stage.tip).position)
    for move in range(1, MOVES + 1):
        x, y, z = (at + move / MOVES * way).tolist()
        viewer.worker.ask("drag", lambda pose=Pose((x, y, z)): handles.drag(pose))  # type: ignore[misc]
        viewer.worker.settle()
        viewer.panel.live.settle(10.0)
    handles.grip.release()
    viewer.worker.settle()
    return time.process_time() - began


def drags(count: int) -> dict[str, str]:
    """Drag an obstacle so often, and undo it all; return a row of the table."""
    scene = load_scene(DRAGGED[0])
    thing, rng = Thing("obstacle", DRAGGED[1]), np.random.default_rng(0)
    viewer = open_viewer(scene, [(NAME, plan(scene).trajectory)], port=8390)
    viewer.panel.live.set(True)
    viewer.worker.ask("select", lambda: viewer.panel.handles.select(thing))
    viewer.worker.settle()
    first = np.array(place_of(viewer.edited, thing, viewer.stage.tip).position)
    spent, held = list[float](), list[float]()
    end = time.monotonic() + LONGEST
    with contextlib.suppress(KeyboardInterrupt):
        while len(spent) < count and time.monotonic() < end:
            aim = first + WAY * np.array([*rng.normal(size=2), 0.0])
            spent.append(dragged(viewer, thing, aim - place_of(viewer.edited, thing, viewer.stage.tip).position))
            held.append(memory())
            if len(spent) % LINE_EVERY == 0:
                print(f"{len(spent)} drags: {held[-1]:.0f} MB", file=sys.stderr, flush=True)
    if not spent:
        sys.exit("ended before the first drag")
    done, part = len(spent), max(len(spent) // SHARE, 1)
    before, after = held[part - 1], held[done - 1]  # first, caches fill
    viewer.panel.handles.grip.release()
    viewer.worker.settle()
    began = time.process_time()
    while viewer.document.history.can_undo:
        viewer.worker.ask("undo", viewer.document.undo)
        viewer.worker.settle()
    undone = time.process_time() - began
    back = viewer.edited is viewer.document.first
    viewer.close()
    return {
        "drags": f"{done:,}" + (f" of {count:,}" if done < count else ""),
        f"of the first {part}, median [ms]": f"{1e3 * statistics.median(spent[:part]):.0f}",
        f"of the last {part}, median [ms]": f"{1e3 * statistics.median(spent[-part:]):.0f}",
        f"memory after {part} [MB]": f"{before:.0f}",
        "memory after all [MB]": f"{after:.0f}",
        "a drag's memory [kB]": f"{1e3 * (after - before) / max(done - part, 1):.1f}",
        "undone in [s]": f"{undone:.1f}" + ("" if back else ", not whole"),
    }


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", nargs="*", metavar="SCENE", help=f"by default {', '.join(SCENES)}")
    parser.add_argument("--drags", type=int, metavar="N")
    parser.add_argument("--runs", type=int, default=RUNS)
    options = parser.parse_args()
    if options.drags:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        print(markdown_text([drags(options.drags)]))
    if options.first is not None:
        print(markdown_text(firsts(options.first or list(SCENES), options.runs)))


if __name__ == "__main__":
    main()
