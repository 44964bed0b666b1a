"""The commands that measure: what they print and write, exit codes, bad folders, Ctrl-C; on few and light cases."""

from __future__ import annotations

import contextlib
import csv
import os
import pty
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from hdplan import cli
from hdplan.distance import conservativeness, query_time, study
from hdplan.planner import reproduce

pytest.importorskip("matplotlib")

COMMAND = [sys.executable, "-m", "hdplan.cli"]
LIGHT = (("tetrahedron", "tetrahedron"), ("cube", "cube"))


@dataclass(frozen=True)
class Done:
    """What a run left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def hdplan(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., Done]:
    """Run `hdplan` in this process, in a folder of its own, on less than --quick would measure."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(conservativeness, "PLATONIC_PAIRS", LIGHT)
    monkeypatch.setattr(reproduce, "QUICK_CONFIGURATIONS", 3000)
    monkeypatch.setattr(reproduce, "QUICK_PAIRS", LIGHT)
    kernels = (("paper", 2, "float64"), ("paper+centre", 2, "float64"))
    monkeypatch.setattr(study, "QUICK", replace(study.QUICK, kernels=kernels, random=study.BLOCK))
    methods = {name: query_time.METHODS[name] for name in ("coal", "interpreter", "compiled")}
    monkeypatch.setattr(query_time, "METHODS", methods)

    def run(*arguments: str | Path) -> Done:
        monkeypatch.setattr(sys, "argv", ["hdplan", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        return Done(int(end.value.code or 0), out, err)

    return run


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_study_distance(hdplan: Callable[..., Done]) -> None:
    done = hdplan("study", "distance", "--quick")
    assert (done.code, done.err) == (0, "")
    assert "  take " in done.out
    assert {path.name for path in Path("out").iterdir()} == {f"distance_study.{end}" for end in ("csv", "md", "png")}
    table = rows(Path("out/distance_study.csv"))
    assert {row["normals"] for row in table} == {"paper", "paper+centre"}
    assert all(float(row["gradient_us"]) > 0 and row["hessian_us"] == "" for row in table)
    told = Path("out/distance_study.md").read_text(encoding="utf-8")
    assert told.startswith("# What accuracy")
    assert "| paper+centre | 2 | 1 mm | float64 |" in told


def test_reproduce_time(hdplan: Callable[..., Done]) -> None:
    done = hdplan("reproduce", "time", "--quick", "-o", "here")
    assert (done.code, done.err) == (0, "")
    for words in ("cube-cube", "5 ms", "here/time.csv", "here/time.png"):
        assert words in done.out
    assert {row["pair"]: row["complexity"] for row in rows(Path("here/time.csv"))} == {
        "tetra-tetra": "128",
        "cube-cube": "1024",
    }
    assert Path("here/time.png").read_bytes().startswith(b"\x89PNG")


def test_reproduce_conservativeness(hdplan: Callable[..., Done]) -> None:
    done = hdplan("reproduce", "conservativeness", "--quick")
    assert (done.code, done.err) == (0, "")
    for words in ("paper+edges", "around 0.7", "below 0.2", "3000 of 3000, 0 contacts called free"):
        assert words in done.out
    table = rows(Path("out/conservativeness.csv"))
    assert max(float(row["percent_of_all"]) for row in table) < 5.0


def test_reproduce_kinks(hdplan: Callable[..., Done]) -> None:
    done = hdplan("reproduce", "kinks")
    assert (done.code, done.err) == (0, "")
    assert "its rate jumps 5 times" in done.out
    assert "no jump" in done.out
    assert Path("out/kinks.png").read_bytes().startswith(b"\x89PNG")
    assert len(rows(Path("out/kinks.csv"))) == 1601


@pytest.mark.parametrize("command", [("study", "distance"), ("reproduce", "time"), ("reproduce", "kinks")])
def test_bad_folders_are_one_line_before_the_work(hdplan: Callable[..., Done], command: tuple[str, ...]) -> None:
    Path("file").write_text("")
    for folder, words in (("file", "cannot be made"), ("missing/folder", "cannot be made")):
        done = hdplan(*command, "-o", folder)
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
        assert f"{folder}: " in done.err
        assert words in done.err


def test_missing_matplotlib_is_said_before_the_work(
    hdplan: Callable[..., Done], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    done = hdplan("reproduce", "conservativeness")
    assert done.code == 2
    assert "pip install hdplan[plot]" in done.err


@pytest.mark.parametrize("group", ["study", "reproduce"])
def test_unknown_names_are_refused(hdplan: Callable[..., Done], group: str) -> None:
    done = hdplan(group, "distances")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert f"hdplan {group} --help" in done.err


def test_ctrl_c_leaves_what_was_counted_and_says_so(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [*COMMAND, "reproduce", "conservativeness", "-o", str(tmp_path / "out")]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, text=True, start_new_session=True)
    os.close(theirs)
    shown = b""
    while b"tetrahedron-cube" not in shown:  # the first pair is done
        shown += os.read(ours, 1 << 12)
    os.killpg(child.pid, signal.SIGINT)  # as a terminal does: to all processes
    reader = threading.Thread(target=_read_on, args=(ours,))
    reader.start()  # the bar goes on moving, and a full terminal would hold it up
    out, _ = child.communicate(timeout=60)
    reader.join()
    os.close(ours)
    assert child.returncode == 1
    assert "\x1b" not in out
    assert "partial" in out
    assert " of 500000, 0 contacts called free" in out
    assert rows(tmp_path / "out" / "conservativeness.csv")


def _read_on(terminal: int) -> None:
    with contextlib.suppress(OSError):  # closed at the other end
        while os.read(terminal, 1 << 12):
            pass
