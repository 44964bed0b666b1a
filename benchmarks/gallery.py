"""Every shipped scene as a page that needs no server, and the docs' gallery of their pictures.

    python benchmarks/gallery.py FOLDER [SCENE ...] [--processor-time]

Each scene is planned, its proof written, and FOLDER/SCENE.html made, with the planes of the proof; of a job, with its
stages. The docs' pictures, docs/gallery/SCENE.png, are drawn again, and, without names of scenes, docs/gallery.md with
all of them. The pictures need chromium and Pillow. The exit code is 1 if a scene has no certified motion, or a page of
more than 2 MB; docs/gallery.md stays as it is then.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from processor_time import add_processor_time, set_clock

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.html_page import HtmlPage
from hdplan.planner.job.planning import plan_job
from hdplan.planner.page.browser import Browser, find_browser
from hdplan.planner.page.job_page import ShownJob
from hdplan.planner.page.recorded_page import page_of
from hdplan.planner.plan import plan
from hdplan.planner.proof.proof import prove
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.yaml_format.reader import load_scene, shipped_jobs, shipped_scenes

DOCS = Path(__file__).resolve().parent.parent / "docs"
TIME_LIMIT = 120.0  # [s] at most for a plan
WINDOW, PICTURE, COLORS = (960, 720), (320, 240), 96  # [px], [px], of a picture's palette
MOMENT = 0.4  # of the motion, in a picture
LARGEST = 2_000_000  # [bytes] of a page
COLUMNS = 3
HEAD = """# Gallery

All shipped scenes, planned and certified. `python benchmarks/gallery.py out/gallery` writes a page of at most 2 MB for
each, which any browser opens, offline, also on a phone: turn it, play it, and watch the plane that separates the
closest pair move along. `hdplan view SCENE` opens a scene for editing.

"""


class Shown(NamedTuple):
    """A scene with its page."""

    name: str
    page: HtmlPage
    certified: bool
    words: str


def shown(name: str, file: Path) -> Shown:
    """Plan a scene and make its page."""
    scene = load_scene(name)
    if scene.job is not None:
        result = plan_job(scene, time_limit=TIME_LIMIT)
        job = ShownJob(scene, result.trajectory, result.certificate)
        return Shown(name, job.page, result.certified, result.certificate.text)
    planned = plan(scene, time_limit=TIME_LIMIT)
    setup, proof = Setup.of(scene), None
    with tempfile.TemporaryDirectory() as folder:
        motion = Path(folder) / "motion.json"
        planned.trajectory.save(motion)
        try:
            proof = ReadProof(file, motion, prove(file, motion).data)
        except HdplanError as error:
            print(f"{name}: no planes: {error}", file=sys.stderr)
    drawn = ShownMotion.of("planned", planned.trajectory, Certifier(setup), planned.certificate)
    return Shown(name, page_of(setup, [drawn], proof=proof), planned.certified, planned.certificate.text)


def photograph(program: str, page: HtmlPage, file: Path) -> None:
    """Draw the scene of a page into a small file."""
    with Browser(program) as browser:
        browser.show(page, WINDOW)
        browser.run("document.querySelector('aside').style.display = 'none', page.resize()")
        moment = f"data.timeline.begin + {MOMENT} * (data.timeline.end - data.timeline.begin)"
        browser.run(f"page.now = {moment}, page.resize(), page.paint()")
        picture = Image.open(io.BytesIO(browser.photograph())).convert("RGB")
    small = picture.resize(PICTURE, Image.Resampling.LANCZOS)
    small.quantize(COLORS, dither=Image.Dither.NONE).save(file, optimize=True)


def gallery(names: Sequence[str]) -> str:
    """Return the docs' page with the pictures of these scenes."""
    cells = [f"![{name}](gallery/{name}.png)<br/>`{name}`" for name in names]
    rows = [cells[i : i + COLUMNS] for i in range(0, len(cells), COLUMNS)]
    lines = [f"| {' | '.join([*row, *[''] * (COLUMNS - len(row))])} |" for row in rows]
    return "\n".join([HEAD + "| " * COLUMNS + "|", "|---" * COLUMNS + "|", *lines, ""])


def main() -> None:
    """Make the pages, and the gallery."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="*")
    add_processor_time(parser)
    options = parser.parse_args()
    set_clock(options)
    every = shipped_scenes() | shipped_jobs()
    program = find_browser()
    if program is None:
        sys.exit("pictures need chromium")
    options.folder.mkdir(parents=True, exist_ok=True)
    (DOCS / "gallery").mkdir(exist_ok=True)
    all_good = True
    for name in options.scenes or sorted(every):
        try:
            one = shown(name, every[name])
            one.page.save(options.folder / f"{name}.html")
            size = len(one.page.html.encode())
            print(f"{name}: {size / 1e6:.2f} MB, {one.words}", flush=True)
            good = one.certified and size <= LARGEST
            if good:
                photograph(program, one.page, DOCS / "gallery" / f"{name}.png")
        except HdplanError as error:
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            good = False
        all_good &= good
    if all_good and not options.scenes:
        (DOCS / "gallery.md").write_text(gallery(sorted(every)), encoding="utf-8")
    sys.exit(not all_good)


if __name__ == "__main__":
    main()
