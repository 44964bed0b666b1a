"""`hdplan view` as it is typed: what it refuses in one line, what it writes, and how Ctrl-C ends it."""

from __future__ import annotations

import importlib.util
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hdplan import prove
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.front import motion_names
from tests.commands import Command, refused

LOADING = "hdplan: loading the robot's meshes ...\n"  # written where loading takes long


def without(*missing: str) -> Callable[..., Any]:
    """Finder of libraries, except these."""
    found = importlib.util.find_spec
    return lambda name, *rest: None if name in missing else found(name, *rest)


def test_a_missing_viser_is_reported_in_one_line(hdplan: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", without("viser"))
    refused(hdplan("view", "planar_arm"), "pip install viser")


@pytest.mark.parametrize(
    ("arguments", "message"),
    {
        "port": (["planar_arm", "--port", "70000"], "1 to 65535"),
        "host": (["planar_arm", "--host", "192.0.2.1"], "is not an address of this machine"),
        "scene": (["planar_arms"], "did you mean"),
        "trajectory": (["planar_arm", "missing.json"], "missing.json"),
        "nothing to record": (["planar_arm", "--record", "page.html"], "no motion to record"),
        "ending": (["planar_arm", "m.json", "--record", "page.txt"], "allowed are .html"),
        "no film": (["planar_arm", "--video", "film.gif"], "no motion to record"),
        "ending of a film": (["planar_arm", "m.json", "--video", "film.avi"], "allowed are .mp4, .gif"),
        "folder": (["planar_arm", "m.json", "--video", "none/film.gif"], "none"),
        "both": (["planar_arm", "m.json", "--proof", "p.proof", "--record", "p.html"], "--proof: applies to"),
        "no server": (["planar_arm", "m.json", "--video", "f.gif", "--port", "8081"], "--port: applies to the viewer"),
    }.values(),
)
def test_bad_input_is_one_line(arguments: list[str], message: str, hdplan: Command) -> None:
    refused(hdplan("view", *arguments), message)


def test_a_page_and_a_film_are_written_without_viser(
    trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hdplan: Command
) -> None:
    trajectory.save(tmp_path / "motion.json")
    page, film = tmp_path / "page.html", tmp_path / "film.gif"
    monkeypatch.setattr(importlib.util, "find_spec", without("viser"))
    monkeypatch.setattr("hdplan.planner.page.film.find_browser", lambda: None)
    monkeypatch.setattr("hdplan.planner.page.film.RATES", {".gif": 1})
    monkeypatch.setattr("hdplan.planner.page.film.SIZE", (320, 180))
    done = hdplan("view", "planar_arm", tmp_path / "motion.json", "--record", page, "--video", film)
    assert done.code == 0
    printed = "".join(done.out.split())  # long names may be broken over lines
    assert f"written{page}" in printed
    assert f"written{film},drawnbymatplotlib,asthereisnoChromiumorChrome" in printed
    assert page.read_bytes().startswith(b"<!doctype html>")
    assert film.read_bytes().startswith(b"GIF89a")


def test_a_film_that_is_interrupted_is_no_film(
    trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hdplan: Command
) -> None:
    """The command ends with the exit code of Ctrl-C, not with that of a film that was written, and leaves nothing."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    trajectory.save(tmp_path / "motion.json")
    monkeypatch.setattr("hdplan.planner.page.film.find_browser", lambda: None)
    monkeypatch.setattr("hdplan.planner.page.film._drawings", interrupted)
    assert hdplan("view", "planar_arm", tmp_path / "motion.json", "--video", tmp_path / "film.gif").code == 130
    assert [path.name for path in tmp_path.iterdir()] == ["motion.json"]


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.skipif(sys.platform == "win32", reason="no Ctrl-C for a child there")
def test_ctrl_c_ends_it_and_a_taken_port_is_reported() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "hdplan.cli", "view", "planar_arm", "--port", str(port)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            line = child.stdout.readline()
            served = re.search(r"http://127\.0\.0\.1:(\d+)", line)
            assert served, line + (child.stderr.read() if child.stderr else "")
            assert int(served[1]) != port
            assert f"port {port} is taken" in line
            with socket.create_connection(("127.0.0.1", int(served[1])), timeout=5):
                child.send_signal(signal.SIGINT)
                out, err = child.communicate(timeout=20)
        assert (child.returncode, out, err.replace(LOADING, "")) == (0, "", "")


def test_motions_get_names_that_differ() -> None:
    names = motion_names([Path("a/one.json"), Path("b/one.json"), Path("two.csv"), Path("two.csv")])
    assert names == ["a/one.json", "b/one.json", "two.csv", "two.csv (2)"]


def test_a_proof_of_another_motion_is_refused(trajectory: Trajectory, tmp_path: Path, hdplan: Command) -> None:
    motion, other, proof = (tmp_path / name for name in ("motion.json", "other.json", "motion.proof"))
    trajectory.save(motion)
    other.write_text(motion.read_text().replace("0.", "0.0", 1))
    prove("planar_arm", motion).save(proof)
    for arguments, message in (
        (["planar_arm", other, "--proof", proof], "not the file that was proven"),
        (["planar_arm", motion, "--proof", tmp_path / "none.proof"], "no such file"),
        (["planar_arm", motion, "--proof", motion], "not a proof"),
        (["planar_arm", "--proof", proof], "about one motion, but none"),
        (["planar_arm", motion, other, "--proof", proof], "about one motion, but 2"),
        (["panda_cage", motion, "--proof", proof], "motion.proof"),
    ):
        done = hdplan("view", *arguments)
        refused(done._replace(err=done.err.replace(LOADING, "")), message)


HEAVY = (
    "scipy",
    "trimesh",
    "matplotlib",
    "jax",
    "hdplan.planner.proof",
    "hdplan.verify",
    "hdplan.planner.job.planning",
)
LATER = ("hdplan.planner.plan", "hdplan.planner.solvers", "hdplan.planner.problem", "hdplan.planner.collision")
FIRST = """import sys
from hdplan.planner.commands import view
from hdplan.planner.view.server import open_viewer
from hdplan.scenes.yaml_format.reader import load_scene
viewer = open_viewer(load_scene("planar_arm"), port=8480, found=lambda viewer: print(viewer.port, *sys.modules))
viewer.close()
print(*sys.modules)
"""


def test_address_and_first_picture_wait_for_nothing_that_they_do_not_need() -> None:
    """The address is known, and a browser can load its part, before what plans is loaded and anything is drawn."""
    done = subprocess.run([sys.executable, "-c", FIRST], capture_output=True, text=True, check=True).stdout
    found, shown = (line.split() for line in done.splitlines())
    assert "viser" in found
    assert not [name for name in found if name.startswith(LATER)]
    assert not [name for name in shown if name.startswith(HEAVY)]
