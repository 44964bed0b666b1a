"""How fast `hdplan view` follows its slider, measured on the server.

    python benchmarks/view.py [SCENE ...] [--picture FILE.png]

For each scene: the time until it is served (meshes read and smoothed, the first time in a process), the time of one
frame (kinematics, closest pair, panels, all messages; no browser is connected), and frames a second. The picture is the
first scene's page half-way, as chromium draws it (it needs chromium and playwright).
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from pathlib import Path

import numpy as np

from hdplan.planner.plan import plan
from hdplan.planner.studies.report import markdown_text
from hdplan.planner.view.server import open_viewer
from hdplan.scenes.yaml_format.reader import load_scene

FRAMES = 200
MOMENT = 0.5  # of the picture
SIZE = {"width": 1400, "height": 820}  # [px]
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def photograph(name: str, file: Path) -> None:
    """Draw a scene's page into a file."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        sys.exit("a picture needs playwright: pip install playwright")
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        sys.exit("a picture needs chromium")
    scene = load_scene(name)
    viewer = open_viewer(scene, [(name, plan(scene).trajectory)], port=8380)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=SOFTWARE)
        page = browser.new_page(viewport=SIZE)
        page.goto(f"http://127.0.0.1:{viewer.port}")
        page.get_by_text("certified: at least").first.wait_for()
        viewer.show(MOMENT)
        page.locator(f'[data-moment="{MOMENT:.3f}"]').wait_for()
        for button in page.locator(".mantine-Notification-closeButton").all():  # "Software WebGL rendering detected"
            button.click()
        page.wait_for_timeout(10_000)  # until all meshes are drawn
        page.screenshot(path=file)
        browser.close()
    viewer.close()


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["panda_cage", "panda_table_pick", "ur5_table"])
    parser.add_argument("--picture", type=Path)
    options, rows = parser.parse_args(), []
    if options.picture:
        photograph(options.scenes[0], options.picture)
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
        median, p95 = np.percentile(spent, [50, 95])
        rows.append(
            {
                "scene": name,
                "until served [s]": f"{served:.1f}",
                "frame median / p95 [ms]": f"{1e3 * median:.1f} / {1e3 * p95:.1f}",
                "frames a second": f"{FRAMES / sum(spent):.0f}",
            }
        )
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
