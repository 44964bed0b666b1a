"""Laws of films: as long as the motion, drawn by what is there, whole or not at all."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.page import film as films
from hdplan.planner.page.browser import Browser, BrowserError, find_browser
from hdplan.planner.page.film import check_film, film
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.timeline import PATH_DURATION
from hdplan.scenes.errors import InputError

FEW = {".mp4": 3, ".gif": 2}  # frames a second


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films, "RATES", FEW)
    monkeypatch.setattr(films, "SIZE", (640, 360))


def frames_of(path: Path) -> list[np.ndarray]:
    """The pictures of a film, as another library reads it."""
    if path.suffix == ".gif":
        found = []
        with pytest.importorskip("PIL.Image").open(path) as image:
            for number in range(image.n_frames):
                image.seek(number)
                found.append(np.asarray(image.convert("RGB"), dtype=float))
        return found
    with pytest.importorskip("av").open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24").astype(float) for frame in container.decode(video=0)]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("ending", "browser"), [(".gif", True), (".gif", False), (".mp4", False)])
def test_a_film_shows_the_motion(
    setup: Setup, motion: ShownMotion, ending: str, browser: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if browser and find_browser() is None:
        pytest.skip("no browser found: apt-get install chromium")
    pytest.importorskip(films.FILMS[ending][0])
    if not browser:
        monkeypatch.setattr(films, "find_browser", lambda: None)
    path = tmp_path / f"film{ending}"
    note = film(setup, [motion], path)
    assert ("matplotlib" in note) != browser
    frames = frames_of(path)
    moving = round(FEW[ending] * PATH_DURATION)
    assert len(frames) == moving + 1 + round(FEW[ending] * films.REST) or ending == ".gif"  # equal ones are joined
    assert moving <= len(frames)
    for one, two in itertools.pairwise(frames[:moving]):
        assert np.abs(one - two).max() > 60.0  # something moves from each to the next
    assert {frame.shape for frame in frames} == {(360, 640, 3) if ending == ".mp4" else (180, 320, 3)}


def test_a_browser_that_fails_is_reported(
    setup: Setup, motion: ShownMotion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is left half-written, and what drew it instead is named."""
    monkeypatch.setattr(films, "find_browser", lambda: "/bin/true")
    assert film(setup, [motion], tmp_path / "film.gif") == "by matplotlib, as /bin/true has ended"
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "matplotlib" else found(name, *rest)
    )
    with pytest.raises(InputError, match="/bin/true has ended, and matplotlib"):
        film(setup, [motion], tmp_path / "other.gif")
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]


def test_bad_films_are_refused(
    setup: Setup, motion: ShownMotion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for bad, message in (("film.avi", "allowed are .mp4, .gif"), ("none/film.gif", "none")):
        with pytest.raises(InputError, match=message):
            check_film(tmp_path / bad)
    few, rows = motion.trajectory, len(motion.trajectory)
    slow = Trajectory(few.joint_names, few.positions, times=np.arange(rows) * 10.0)
    with pytest.raises(InputError, match="at most 120 s"):
        film(setup, [ShownMotion.of("slow", slow, Certifier(setup))], tmp_path / "film.gif")
    monkeypatch.setattr(films, "find_browser", lambda: None)
    with pytest.raises(InputError, match="one motion at a time"):
        film(setup, [motion, dataclasses.replace(motion, name="other")], tmp_path / "film.gif")
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "av" else found(name, *rest))
    with pytest.raises(InputError, match="pip install av"):
        check_film(tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_a_browser_that_is_none_is_an_error() -> None:
    for program in ("/bin/true", "/no/such/browser"):
        with pytest.raises(BrowserError, match="has ended"), Browser(program):
            pass
