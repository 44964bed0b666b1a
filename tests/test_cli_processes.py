"""The command line in child processes: terminals, pipes, full disks, Ctrl-C, internal errors."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.commands import BLOCKED, Command, Done, arm_scene, obstacle, refused
from tests.waiting import until

COMMAND = [sys.executable, "-m", "hdplan.cli"]


def wrong(errors: str) -> list[str]:
    """Lines of the error stream beside the steps that took long, as they may on a slow machine."""
    return [line for line in errors.splitlines() if not (line.startswith("hdplan: ") and line.endswith(" ..."))]


def test_a_pipe_gets_plain_text_and_may_close_early() -> None:
    whole = subprocess.run([*COMMAND, "plan", "planar_arm"], capture_output=True, text=True)
    assert (whole.returncode, wrong(whole.stderr)) == (0, [])
    assert "\x1b" not in whole.stdout
    assert whole.stdout.splitlines()[0].endswith("over the whole motion")  # not wrapped
    child = subprocess.Popen(
        [*COMMAND, "plan", "planar_arm"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stderr is not None
    child.stdout.close()
    assert (wrong(child.stderr.read()), child.wait()) == ([], 0)
    child.stderr.close()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("words", [["explain", "planar_arm"], ["plan", "--help"]])
def test_a_full_disk_is_one_line(words: list[str]) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMMAND, *words], stdout=full, stderr=subprocess.PIPE, text=True)
    refused(Done(done.returncode, "", "\n".join([*wrong(done.stderr), ""])), "the output cannot be written")


def test_a_terminal_sees_progress() -> None:
    ours, theirs = pty.openpty()
    child = subprocess.Popen([*COMMAND, "plan", "planar_arm"], stdout=subprocess.PIPE, stderr=theirs, text=True)
    os.close(theirs)
    out, _ = child.communicate()
    shown = os.read(ours, 1 << 16).decode()
    os.close(ours)
    assert child.returncode == 0
    assert "\x1b" not in out
    assert "building the problem" in shown or "iteration" in shown  # whichever is on when the line is drawn


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", ["gauss_newton", "chomp", "fatrop", "ipopt"])
def test_ctrl_c_ends_with_the_best_so_far(tmp_path: Path, solver: str) -> None:
    scene, best = arm_scene(tmp_path, obstacles=[BLOCKED]), tmp_path / "best.json"
    ours, theirs = pty.openpty()
    command = [*COMMAND, "plan", str(scene), "--time-limit", "60", "--solver", solver, "-o", str(best)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, text=True)
    os.close(theirs)
    shown = ""
    while "iteration" not in shown:  # the solver is at work
        shown += os.read(ours, 1 << 12).decode()
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=20)
    os.close(ours)
    assert child.returncode == 1
    assert out.startswith("in contact: ")
    assert json.loads(best.read_text(encoding="utf-8"))["verdict"]["status"] == "in_contact"


def caught(status: str) -> int:
    """The signals that a process has handlers for, by its /proc/PID/status, as bits."""
    return int(status.split("SigCgt:")[1].split()[0], 16)


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are listed elsewhere")
def test_ctrl_c_ends_the_checker_of_proofs_without_its_traceback(tmp_path: Path) -> None:
    """A terminal sends it to both processes."""
    (tmp_path / "any.json").write_text("{}", encoding="utf-8")
    command = [*COMMAND, "verify", "planar_arm", str(tmp_path / "any.json"), str(tmp_path / "any.json")]
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    until(children.read_text, "the checker begins")
    status = Path(f"/proc/{children.read_text().split()[0]}/status")
    until(lambda: caught(status.read_text()) >> (signal.SIGINT - 1) & 1, "Python hears Ctrl-C, and imports libraries")
    os.killpg(child.pid, signal.SIGINT)
    _, message = child.communicate(timeout=20)
    assert message == "hdplan: interrupted before anything was found\n"


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.parametrize("command", ["plan", "check", "follow", "simulate", "plot", "explain", "view", "robots"])
def test_ctrl_c_that_python_drops_ends_every_command(
    hdplan: Command, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """An exception in a destructor is dropped; the command would run to its end."""

    class Last:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def endless(*_: object, **__: object) -> None:
        Last()
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            sum(range(100))

    Path("motion.csv").write_text("elbow,shoulder\n0.4,-0.8\n0.4,1.0\n", encoding="utf-8")
    work = {
        "plan": "plan", "check": "Certifier", "follow": "follow", "simulate": "replay", "plot": "plot",
        "explain": "problem_of", "view": "load_scene_robot", "robots": "listing",
    }  # fmt: skip
    motion = ["planar_arm", "motion.csv"]
    given = {"plan": motion[:1], "explain": motion[:1], "robots": [], "plot": [*motion, "-o", "motion.png"]}
    monkeypatch.setattr(f"hdplan.planner.commands.{command}.{work[command]}", endless)
    done = hdplan(command, *given.get(command, motion))
    assert (done.code, done.out) == (130, "")
    assert done.err.strip() == "hdplan: interrupted before anything was found"
    assert os.listdir() == ["motion.csv"]


def child(*arguments: str, **within: str) -> Done:
    """Run `hdplan` as a program of its own."""
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, env={**os.environ, **within}, check=False)
    return Done(done.returncode, done.stdout.decode(), done.stderr.decode())


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.parametrize("after", ["typer.main", "rich.text", "numpy.linalg"])
def test_ctrl_c_while_it_starts_is_one_line(after: str) -> None:
    """While libraries are imported, some of which make errors of their own of it."""
    telling = [sys.executable, "-X", "importtime", *COMMAND[1:], "plan", "panda_cage"]
    with subprocess.Popen(telling, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as started:
        assert started.stderr is not None
        while not started.stderr.readline().rstrip().endswith(after):
            assert started.poll() is None
        started.send_signal(signal.SIGINT)
        out, err = started.communicate(timeout=60)
    lines = [line for line in err.splitlines() if not line.startswith("import time:")]
    assert (out, lines) == ("", ["hdplan: interrupted before anything was found"])
    assert started.returncode in (130, -signal.SIGINT)


def test_characters_that_the_output_lacks_are_written_out(tmp_path: Path) -> None:
    scene = arm_scene(tmp_path, obstacles=obstacle("type: sphere, radius: 0.1", "[0, 0, 3]", name="Kübel"))
    done = child("plan", str(scene), PYTHONIOENCODING="ascii")
    assert done.code == 0
    assert "rad^2" in done.out
    assert "forearm to K\\xfcbel, about" in done.out or "to K\\xfcbel, about" in done.out
    assert done.out.isascii()


def test_a_cache_that_cannot_be_written_is_one_warning(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = child("plan", "planar_arm", HDPLAN_CACHE=str(tmp_path / "file" / "cache"))
    assert done.code == 0
    lines = [line for line in done.err.splitlines() if "cache" in line]
    (line,) = lines
    assert line.startswith(f"hdplan: note: the cache {tmp_path}/file/cache cannot be written (Not a directory), so ")
    assert "HDPLAN_CACHE" in line


def test_an_internal_error_is_shown_whole_where_that_is_requested(
    hdplan: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("hdplan.planner.commands.plan.plan", broken)
    monkeypatch.delenv("HDPLAN_DEBUG", raising=False)
    done = hdplan("plan", "planar_arm", "--quiet")
    assert (done.code, done.out, done.err.count("\n")) == (3, "", 1)
    assert done.err.endswith("; HDPLAN_DEBUG=1 shows it whole\n")
    monkeypatch.setenv("HDPLAN_DEBUG", "1")
    done = hdplan("plan", "planar_arm", "--quiet")
    assert done.code == 3
    assert done.err.startswith("Traceback (most recent call last):\n")
    assert "in broken" in done.err
    assert "hdplan: internal error" in done.err.splitlines()[-1]
