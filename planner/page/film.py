"""A motion as a film, frame by frame: the page as a browser shows it, or the scene drawn by matplotlib where there is
no browser.

Films are MP4 (H.264, by PyAV) or GIF (by Pillow); both libraries are optional.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.html_page import HtmlPage
from hdplan.planner.page.browser import Browser, BrowserError, find_browser
from hdplan.planner.page.recorded_page import page_of
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.scenes.errors import InputError
from hdplan.scenes.output import check_writable, write_output

FILMS = {".mp4": ("av", "av"), ".gif": ("PIL", "pillow")}  # ending: the library that writes it, and its package
SIZE = (1280, 720)  # [px]
RATES = {".mp4": 25, ".gif": 10}  # frames a second
REST = 1.0  # [s] for which the goal is shown at the end
LONGEST_FILM = 120.0  # [s] of a film: longer motions are to be cut first

Frame = NDArray[np.uint8]  # (height, width, 3)


def check_film(path: Path) -> None:
    """Check early that a film can be written. Raises InputError for another ending, a path that cannot be written, or a
    missing library."""
    check_writable(path, tuple(FILMS))
    module, package = FILMS[path.suffix.lower()]
    if importlib.util.find_spec(module) is None:
        raise InputError(f"{path}: such films need {package}, which is not installed: pip install {package}")
    if find_browser() is None and importlib.util.find_spec("matplotlib") is None:
        raise InputError(f"{path}: films need a browser (Chromium or Chrome) or matplotlib; neither is installed")


def film(setup: Setup, motions: Sequence[ShownMotion], path: Path, page: HtmlPage | None = None) -> str:
    """Write a film of motions, whole or not at all, and return what drew it, in words; of a `page` of theirs, if there
    is one already.

    Raises InputError as `check_film`, for motions that take longer than LONGEST_FILM, and for several motions where
    there is no browser.
    """
    check_film(path)
    timeline = Timeline.of(setup.scene, [motion.curve for motion in motions])
    if timeline.duration > LONGEST_FILM:
        raise InputError(
            f"{path}: the motion takes {timeline.duration:.0f} s; films of at most {LONGEST_FILM:g} s are made"
        )
    rate = RATES[path.suffix.lower()]
    count = max(round(rate * timeline.duration), 1) + 1
    moments = np.linspace(timeline.begin, timeline.end, count).tolist()
    program, why = find_browser(), "there is no Chromium or Chrome"
    if program is not None:
        try:
            data = _encoded(_photographs(program, page or page_of(setup, motions), moments), path, rate)
        except BrowserError as error:
            why = str(error)
        else:
            write_output(path, data)
            return f"by {Path(program).name}"
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError(f"{path}: {why}, and matplotlib, which would do, is not installed: pip install matplotlib")
    if len(motions) > 1:
        raise InputError(f"{path}: {why}, and matplotlib draws one motion at a time")
    write_output(path, _encoded(_drawings(setup, motions[0], timeline, moments), path, rate))
    return f"by matplotlib, as {why}"


def _photographs(program: str, page: HtmlPage, moments: Sequence[float]) -> Iterator[Frame]:
    """Yield the page as a browser shows it."""
    from PIL import Image

    with Browser(program) as browser:
        browser.show(page, SIZE)
        browser.run("document.body.classList.add('film')")
        for now in moments:
            browser.run(f"page.now = {now!r}; page.paint()")
            yield np.asarray(Image.open(io.BytesIO(browser.photograph())).convert("RGB"))


def _drawings(setup: Setup, motion: ShownMotion, timeline: Timeline, moments: Sequence[float]) -> Iterator[Frame]:
    """Yield the scene as matplotlib draws it."""
    from hdplan.planner.pictures.frames import drawn_frames

    trajectory = motion.trajectory.of_joints(setup.robot.joint_names, setup.robot.locked)
    frames = [(timeline.parameter(motion.curve, now), timeline.words(now)) for now in moments]
    yield from drawn_frames(setup, trajectory, motion.certificate, frames, SIZE)


def _encoded(frames: Iterable[Frame], path: Path, rate: int) -> bytes:
    rested = _rested(frames, round(REST * rate))
    return _mp4(rested, rate) if path.suffix.lower() == ".mp4" else _gif(rested, rate)


def _rested(frames: Iterable[Frame], count: int) -> Iterator[Frame]:
    """Yield frames, and the last one `count` times more."""
    last = None
    for last in frames:
        yield last
    if last is not None:
        yield from [last] * count


def _mp4(frames: Iterable[Frame], rate: int) -> bytes:
    """Return frames as H.264 that every player shows."""
    import av

    found = io.BytesIO()
    with av.open(found, "w", format="mp4") as container:
        stream: Any = container.add_stream("libx264", rate=rate, options={"crf": "20"})
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())
    return found.getvalue()


def _gif(frames: Iterable[Frame], rate: int) -> bytes:
    """Return frames as a GIF of half the size that plays again and again."""
    from PIL import Image

    half = (SIZE[0] // 2, SIZE[1] // 2)
    pictures = [Image.fromarray(frame).resize(half, Image.Resampling.LANCZOS) for frame in frames]
    some = pictures[len(pictures) // 2]
    palette = some.quantize(255, method=Image.Quantize.MAXCOVERAGE)  # in which words and lines keep their colours
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    found = io.BytesIO()
    small[0].save(found, format="gif", save_all=True, append_images=small[1:], duration=1000 // rate, loop=0)
    return found.getvalue()
