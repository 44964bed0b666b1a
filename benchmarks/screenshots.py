"""The page of `hdplan view` for every shipped scene, in both themes, as a browser without a screen draws it.

    python benchmarks/screenshots.py FOLDER [SCENE ...] [--size 1400x820] [--theme light|dark] [--unplanned]

For each scene: FOLDER/SCENE-light.png and -dark.png, half-way along a planned motion (or, with --unplanned, as the page
comes without one). What the page's console complains of is printed, and ends the run with exit code 1.
It needs chromium and playwright.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hdplan.planner.plan import plan
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
THEMES = ("light", "dark")
TIME_LIMIT = 20.0  # [s] for planning
DRAWN, TURNED = 8_000, 1_500  # [ms] until all meshes are, and until the page has turned dark
PATIENCE = 120_000  # [ms]
SELDOM = "const frame = requestAnimationFrame; requestAnimationFrame = (draw) => setTimeout(frame, 300, draw)"  # 3 Hz


@contextmanager
def browser() -> Iterator[Any]:
    """Start the browser that is there."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        sys.exit("a picture needs playwright: pip install playwright")
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        sys.exit("a picture needs chromium")
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=chromium, args=SOFTWARE)
        yield found
        found.close()


@contextmanager
def opened(browser: Any, viewer: Viewer, size: tuple[int, int], complaints: list[str]) -> Iterator[Any]:
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
    page.wait_for_timeout(DRAWN)
    yield page
    page.close()


def photograph(page: Any, file: Path, theme: str) -> None:
    """Draw a page into a file."""
    page.emulate_media(color_scheme=theme)
    page.locator(f'[data-mantine-color-scheme="{theme}"]').wait_for(state="attached")
    page.wait_for_timeout(TURNED)
    page.screenshot(path=file)


def main() -> None:
    """Take the pictures from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="*", default=list(shipped_scenes()))
    parser.add_argument("--size", default="1400x820")
    parser.add_argument("--theme", choices=THEMES)
    parser.add_argument("--unplanned", action="store_true")
    options = parser.parse_args()
    width, height = (int(edge) for edge in options.size.split("x"))
    options.folder.mkdir(parents=True, exist_ok=True)
    complaints: list[str] = []
    with browser() as running:
        for name in options.scenes:
            scene = load_scene(name)
            motions = [] if options.unplanned else [("planned", plan(scene, time_limit=TIME_LIMIT).trajectory)]
            viewer = open_viewer(scene, motions, port=8380)
            timeline = viewer.panel.player.timeline
            viewer.show(0.5 * (timeline.begin + timeline.end))
            with opened(running, viewer, (width, height), complaints) as page:
                for theme in [options.theme] if options.theme else THEMES:
                    file = options.folder / f"{Path(name).stem}-{theme}.png"
                    photograph(page, file, theme)
                    print(file, flush=True)
            viewer.close()
    for complaint in complaints:
        print(complaint, file=sys.stderr)
    sys.exit(bool(complaints))


if __name__ == "__main__":
    main()
