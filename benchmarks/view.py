"""How fast `hdplan view` follows its slider and a mouse that drags an obstacle, measured on the server.

    python benchmarks/view.py [SCENE ...] [--picture FILE.png] [--drag SECONDS [--obstacles N ...] [--points N ...]]

For each scene: the time until it is served (meshes read and smoothed, the first time in a process), the time of one
frame (kinematics, closest pair, panels, all messages; no browser is connected), and frames a second. The picture is the
first scene's page half-way, as chromium draws it.

With --drag, a scripted mouse in chromium drags the post of a Panda's scene of so many obstacles (and of one with so
many points of a table and a wall) to and fro, through pixels, while the motion plays: certified motions a second; the
time from a move's arrival to the certified motion shown for it; the slider's frames a second; and how much of the
processor the server gets. The page does all it does but fill triangles, which a graphics card does elsewhere and here
would take the processor that is measured. Pictures and dragging need chromium and playwright.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from cells import milliseconds
from chromium import browser
from scaling import scene_of

sys.path.append(str(Path(__file__).resolve().parent.parent))  # of tests
from hdplan.planner.plan import plan
from hdplan.planner.studies.report import markdown_text
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.things import Thing, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.view.in_page import complete, grip, gripped, handled, look, seen
from tests.waiting import PATIENCE

FRAMES = 200
MOMENT = 0.5  # of the picture
SIZE = {"width": 1400, "height": 820}  # [px]
WAYPOINTS = 32  # of the scenes in which the post is dragged
FEW = 5  # obstacles beside a cloud
TABLE, WALL = (-0.35, 1.3), 1.15  # [m] height and reach of the cloud's table, and how far its wall is away
POST, WAY = Thing("obstacle", "post"), 0.25  # [m] to and fro along y
PERIOD = 4.0  # [s]
EYE, TARGET = (0.4, 0.9, 2.6), (0.4, 0.1, 0.4)  # [m] of the page meanwhile: nothing stands before the handle
SMALL = {"width": 760, "height": 360}  # [px] while it is dragged
UNFILLED = """for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"])
    WebGL2RenderingContext.prototype[name] = () => {}"""


@contextlib.contextmanager
def opened(viewer: Viewer, size: dict[str, int], script: str = "") -> Iterator[Any]:
    """A viewer's page in chromium."""
    with browser() as found:
        page = found.new_page(viewport=size)
        page.set_default_timeout(1e3 * PATIENCE)
        page.add_init_script(script)
        page.goto(viewer.address())
        page.get_by_text("certified: at least").first.wait_for()
        yield page


def photograph(name: str, file: Path) -> None:
    """Draw a scene's page into a file."""
    scene = load_scene(name)
    viewer = open_viewer(scene, [(name, plan(scene).trajectory)], port=8380)
    with opened(viewer, SIZE) as page:
        viewer.show(MOMENT)
        page.locator(f'[data-moment="{MOMENT:.3f}"]').wait_for()
        for button in page.locator(".mantine-Notification-closeButton").all():  # "Software WebGL rendering detected"
            button.click()
        complete(page, viewer.server, viewer.panel.looking)
        page.screenshot(path=file)
    viewer.close()


class Shown:
    """When the moves arrive, and when a certified motion is shown for each; and how often the slider's moment is."""

    def __init__(self, viewer: Viewer) -> None:
        """Listen to a viewer."""
        self.frames = self.moves = 0
        self.waits: list[float] = []
        handles, live, player = viewer.panel.handles, viewer.panel.live, viewer.panel.player
        ask, drag, take, draw = viewer.worker.ask, handles.drag, live._take, viewer.draw
        came: dict[int, tuple[float, Any]] = {}  # when the move to a scene came, and the scene
        newest = 0.0

        def counted(kind: str, job: Any, urgent: bool = False) -> None:
            nonlocal newest
            if kind == "drag":
                newest = time.perf_counter()
            ask(kind, job, urgent)

        def dragged(pose: Any) -> None:
            when = newest
            drag(pose)
            self.moves += 1
            came[id(viewer.scene)] = when, viewer.scene

        def taken(edited: Any, result: Any, turn: int) -> None:
            count = live.count
            take(edited, result, turn)
            if live.count > count:
                self.waits.append(time.perf_counter() - came[id(edited.scene)][0])

        def drawn(now: float) -> None:
            self.frames += 1
            draw(now)

        viewer.worker.ask, handles.drag, live._take, player._show = counted, dragged, taken, drawn  # type: ignore[method-assign]


def clouded(points: int) -> Scene:
    """The scene of FEW obstacles on a table, before a wall, that a camera sees with so many points."""
    scene, rng = scene_of(WAYPOINTS, FEW), np.random.default_rng(0)
    height, reach = TABLE
    found = rng.uniform(-reach, reach, (points, 3))
    found[: points // 2, 2] = height
    found[points // 2 :, 0] = WALL
    return derived(scene, obstacles=(*scene.obstacles, Obstacle("seen", Cloud(found, radius=0.005))))


def drag(scene: Scene, seconds: float, points: int = 0) -> dict[str, str]:
    """Drag the post by the mouse while the motion plays; return a row of the table."""
    viewer = open_viewer(scene, [(NAME, plan(scene).trajectory)], port=8380)
    with opened(viewer, SMALL, UNFILLED) as page:
        look(page, viewer, EYE, TARGET)
        viewer.worker.ask("select", lambda: viewer.panel.handles.select(POST))
        handled(page, viewer)
        held = grip(page, place_of(viewer.edited, POST, viewer.stage.tip).matrix, 1)
        begin = np.array(seen(page, held))
        way = seen(page, held + np.array([0.0, WAY, 0.0])) - begin
        gripped(page, begin.tolist())
        viewer.panel.player.speed.value = "0.25"
        viewer.panel.player.play()
        shown, began, processor = Shown(viewer), time.perf_counter(), time.process_time()
        while (spent := time.perf_counter() - began) < seconds:
            share = 0.5 - 0.5 * np.cos(2 * np.pi * spent / PERIOD)
            page.mouse.move(*(begin + share * way))
            if not viewer.panel.player.playing:
                viewer.panel.player.play()
        processor = time.process_time() - processor
        page.mouse.up()
    viewer.close()
    return {
        "obstacles": str(len(scene.obstacles) - bool(points)) + (f" and {points:,} points" if points else ""),
        "moves a second": f"{shown.moves / spent:.1f}",
        "certified motions a second": f"{len(shown.waits) / spent:.1f}",
        "latency median / p95 [ms]": milliseconds(shown.waits),
        "the slider's frames a second": f"{shown.frames / spent:.0f}",
        "processor of the server [s/s]": f"{processor / spent:.2f}",
        "of it for each certified motion [ms]": f"{1e3 * processor / max(len(shown.waits), 1):.0f}",
    }


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["panda_cage", "panda_table_pick", "ur5_table"])
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--drag", type=float, metavar="SECONDS", help="drag an obstacle by the mouse for so long")
    parser.add_argument("--obstacles", type=int, nargs="*", default=[20], metavar="N")
    parser.add_argument("--points", type=int, nargs="*", default=[], metavar="N")
    options, rows = parser.parse_args(), []
    if options.picture:
        photograph(options.scenes[0], options.picture)
    if options.drag:
        rows = [drag(scene_of(WAYPOINTS, count), options.drag) for count in options.obstacles]
        rows += [drag(clouded(count), options.drag, count) for count in options.points]
        print(markdown_text(rows))
        return
    for name in options.scenes:
        scene = load_scene(name)
        trajectory = plan(scene).trajectory
        began = time.perf_counter()
        viewer = open_viewer(scene, [("found", trajectory)], port=8380)
        served = time.perf_counter() - began
        spent = []
        for now in np.linspace(0.0, 1.0, FRAMES).round(3).tolist():
            before = time.perf_counter()
            viewer.show(now)
            spent.append(time.perf_counter() - before)
        viewer.close()
        row = {"scene": name, "until served [s]": f"{served:.1f}"}
        row |= {"frame median / p95 [ms]": milliseconds(spent, digits=1)}
        rows.append(row | {"frames a second": f"{FRAMES / sum(spent):.0f}"})
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
