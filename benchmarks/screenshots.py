"""The page of `hdplan view` for every shipped scene and job, at three widths and in both themes, as a browser without a
screen draws it.

    python benchmarks/screenshots.py FOLDER [SCENE ...] [--sizes 1400x820 ...] [--theme light|dark] [--unplanned]
        [--plain]

For each scene: FOLDER/SCENE-WIDTH-THEME.png, half-way along a planned motion (or, with --unplanned, as the page comes
without one); and FOLDER/SCENE.png, a sheet of them all; with --plain without reflections and shadows, which are four
fifths of the time. What the page's console complains of is printed, and ends the run with exit code 1. It needs
chromium, playwright and Pillow.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from chromium import SELDOM, browser

sys.path.append(str(Path(__file__).resolve().parent.parent))  # of tests
from hdplan.planner.job.planning import plan_job
from hdplan.planner.plan import plan
from hdplan.planner.view.job_viewer import JobViewer
from hdplan.planner.view.server import open_job_viewer, open_viewer
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.yaml_format.reader import load_scene, shipped_jobs, shipped_scenes
from tests.planner.view.in_page import complete, drawn

Size = tuple[int, int]  # [px]

THEMES = ("light", "dark")
TIME_LIMIT = 120.0  # [s] at most for a plan, also where the processor is shared
SIZES = ((1400, 820), (1000, 700), (600, 900))
SHEET = 800  # [px] at most of a picture's width on a sheet
PATIENCE = 120_000  # [ms]
AMBIENT = 1.5  # of the light in place of reflections


@contextmanager
def opened(browser: Any, viewer: Viewer | JobViewer, size: Size, complaints: list[str]) -> Iterator[Any]:
    """Open a viewer's page; what its console complains of is added to `complaints`."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.add_init_script(SELDOM)  # every pixel is drawn by the processor
    page.set_default_timeout(PATIENCE)
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(viewer.address())
    page.wait_for_selector("canvas")
    page.get_by_text("Software WebGL").wait_for()
    page.locator(".mantine-Notification-closeButton").dispatch_event("click")
    yield page
    page.close()


def photograph(page: Any, file: Path, theme: str) -> None:
    """Draw a page into a file."""
    page.emulate_media(color_scheme=theme)
    page.locator(f'[data-mantine-color-scheme="{theme}"]').wait_for(state="attached")
    drawn(page)
    page.screenshot(path=file)


def served(name: str, planned: bool) -> Viewer | JobViewer:
    """Serve a scene, half-way along a planned motion."""
    scene = load_scene(name)
    if scene.job is not None:
        jobs = open_job_viewer(scene, port=8380)
        if planned:
            jobs.show(plan_job(scene, time_limit=TIME_LIMIT))
            jobs.player.go_to(0.5 * jobs.player.timeline.end)
        return jobs
    motions = [("planned", plan(scene, time_limit=TIME_LIMIT).trajectory)] if planned else []
    viewer = open_viewer(scene, motions, port=8380)
    viewer.pulse.end()  # the same pictures each time
    timeline = viewer.panel.player.timeline
    viewer.show(0.5 * (timeline.begin + timeline.end))
    return viewer


def sheet(folder: Path, name: str, sizes: Sequence[Size], themes: Sequence[str]) -> None:
    """Put the pictures of one scene on a sheet, a row for each theme."""
    from PIL import Image

    height = min(SHEET * size[1] // size[0] for size in sizes)
    widths = [height * size[0] // size[1] for size in sizes]
    whole = Image.new("RGB", (sum(widths), len(themes) * height), "white")
    for row, theme in enumerate(themes):
        for column, size in enumerate(sizes):
            with Image.open(folder / f"{name}-{size[0]}-{theme}.png") as picture:
                small = picture.convert("RGB").resize((widths[column], height))
                whole.paste(small, (sum(widths[:column]), row * height))
    whole.save(folder / f"{name}.png")


def _size(text: str) -> Size:
    width, height = text.split("x")
    return int(width), int(height)


def main() -> None:
    """Take the pictures from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="*", default=[*shipped_scenes(), *shipped_jobs()])
    parser.add_argument("--sizes", nargs="+", type=_size, default=SIZES, metavar="WIDTHxHEIGHT")
    parser.add_argument("--theme", choices=THEMES)
    parser.add_argument("--unplanned", action="store_true")
    parser.add_argument("--plain", action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    complaints: list[str] = []
    themes = [options.theme] if options.theme else THEMES
    with browser() as running:
        for name in options.scenes:
            viewer = served(name, not options.unplanned)
            if options.plain:
                viewer.server.scene.configure_environment_map(None)
                viewer.server.scene.add_light_ambient("/ambient", intensity=AMBIENT)
                viewer.server.scene.configure_default_lights(cast_shadow=False)
            looking = viewer.looking if isinstance(viewer, JobViewer) else viewer.panel.looking
            with opened(running, viewer, options.sizes[0], complaints) as page:
                for width, height in options.sizes:
                    page.set_viewport_size({"width": width, "height": height})
                    complete(page, viewer.server, looking)
                    for theme in themes:
                        photograph(page, options.folder / f"{Path(name).stem}-{width}-{theme}.png", theme)
            viewer.close()
            sheet(options.folder, Path(name).stem, options.sizes, themes)
            print(name, flush=True)
    for complaint in complaints:
        print(complaint, file=sys.stderr)
    sys.exit(bool(complaints))


if __name__ == "__main__":
    main()
