"""The commands that measure: what they print and write, exit codes, bad folders, Ctrl-C; on few and light cases."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import pty
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from hdplan.distance.studies import accuracy as study, conservativeness, query_time
from hdplan.planner.commands import studies
from hdplan.planner.studies import paper_figures, planning_runs
from tests.commands import Command, in_process, refused
from tests.extras import needs

pytestmark = needs("matplotlib")

COMMAND = [sys.executable, "-m", "hdplan.cli"]
LIGHT = (("tetrahedron", "tetrahedron"), ("cube", "cube"))


@pytest.fixture
def hdplan(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Run `hdplan` in this process, in a folder of its own, on less than --quick would measure."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(conservativeness, "PLATONIC_PAIRS", LIGHT)
    monkeypatch.setattr(paper_figures, "QUICK_CONFIGURATIONS", 3000)
    monkeypatch.setattr(paper_figures, "QUICK_PAIRS", LIGHT)
    kernels = (("paper", 2, "float64"), ("paper+centre", 2, "float64"))
    monkeypatch.setattr(study, "QUICK", replace(study.QUICK, kernels=kernels, random=study.BLOCK))
    methods = {name: query_time.METHODS[name] for name in ("coal", "interpreter", "compiled")}
    monkeypatch.setattr(query_time, "METHODS", methods)
    return in_process(monkeypatch, capsys)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_study_distance(hdplan: Command) -> None:
    done = hdplan("study", "distance", "--quick")
    assert (done.code, done.err) == (0, "")
    assert "  take " in done.out
    assert "  quick " in done.out
    assert "no Hessians, no unions" in " ".join(done.out.split())
    assert {path.name for path in Path("out").iterdir()} == {f"distance_study.{end}" for end in ("csv", "md", "png")}
    table = rows(Path("out/distance_study.csv"))
    assert {row["normals"] for row in table} == {"paper", "paper+centre"}
    assert all(float(row["gradient_us"]) > 0 and row["hessian_us"] == "" for row in table)
    text = Path("out/distance_study.md").read_text(encoding="utf-8")
    assert text.startswith("# What accuracy")
    assert "| paper+centre | 2 | 1 mm | float64 |" in text


def test_study_planning(hdplan: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """Planning is studied on one shipped scene and one of MoveIt's, named by its path."""
    monkeypatch.setattr(planning_runs, "QUICK_VALUES", {"solver": ("gauss_newton", "chomp")})
    monkeypatch.setattr(planning_runs, "QUICK_WANTED", 10)
    shipped = studies.shipped_with_obstacles(True)
    assert {scene.robot.name for scene in shipped} == {"panda"}
    assert {scene.name for scene in studies.shipped_with_obstacles(False)} > {scene.name for scene in shipped}
    monkeypatch.setattr(studies, "shipped_with_obstacles", lambda quick: shipped[:1] if quick else [])
    folder = Path("problems/a/set")
    folder.mkdir(parents=True)
    Path("problems/a/robot.yaml").write_text("robot: {name: panda}")
    corner = "{type: box, dimensions: [0.1, 0.1, 0.1]}"
    pose = "{position: [0.6, 0, 0.4], orientation: [0, 0, 0, 1]}"
    cube = f"{{id: cube, primitives: [{corner}], primitive_poses: [{pose}]}}"
    for k in range(3):
        scene = f"name: s\nworld:\n  collision_objects:\n    - {cube}\n"
        folder.joinpath(f"scene000{k}.yaml").write_text(scene)
        start, goal = ([side, -0.785, 0, -2.356, 0, 1.571, 0.785] for side in (-0.7, 0.7))
        names = [f"panda_joint{joint}" for joint in range(1, 8)]
        wanted = [{"joint_name": name, "position": value} for name, value in zip(names, goal, strict=True)]
        request = {
            "start_state": {"joint_state": {"name": names, "position": start}},
            "goal_constraints": [{"joint_constraints": wanted}],
        }
        folder.joinpath(f"request000{k}.yaml").write_text(json.dumps(request))
    done = hdplan("study", "planning", "--quick", "--problems", "problems", "--every", "2")
    assert (done.code, done.err) == (0, "")
    assert "  defaults " in done.out
    named = {f"planning_study.{end}" for end in ("csv", "md", "png")} | {"planning_quality.csv", "planning_quality.png"}
    assert {path.name for path in Path("out").iterdir()} == named
    table = rows(Path("out/planning_study.csv"))
    order = [shipped[0].name, "a/set/scene0000", "a/set/scene0002"]
    assert [(row["setting"], row["scene"]) for row in table] == [
        (setting, scene) for setting in ("defaults", "solver") for scene in order
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--problems", "missing"), "missing: no such file, folder"),
        (("--problems", "lonely"), "scene1.yaml: is empty"),
        (("--problems", "lonely", "--every", "0"), "at least 1"),
    ],
)
def test_bad_problems_are_one_line_before_the_work(hdplan: Command, arguments: tuple[str, ...], words: str) -> None:
    Path("lonely").mkdir()
    Path("lonely/scene1.yaml").write_text("")
    refused(hdplan("study", "planning", *arguments), words)


def test_reproduce_time(hdplan: Command) -> None:
    done = hdplan("reproduce", "time", "--quick", "-o", "here")
    assert (done.code, done.err) == (0, "")
    for words in ("cube-cube", "5 ms", "here/time.csv", "here/time.png"):
        assert words in done.out
    assert {row["pair"]: row["complexity"] for row in rows(Path("here/time.csv"))} == {
        "tetra-tetra": "128",
        "cube-cube": "1024",
    }
    assert Path("here/time.png").read_bytes().startswith(b"\x89PNG")


def test_reproduce_conservativeness(hdplan: Command) -> None:
    done = hdplan("reproduce", "conservativeness", "--quick")
    assert (done.code, done.err) == (0, "")
    for words in ("paper+edges", "around 0.7", "below 0.2", "3000 of 3000, 0 contacts called free"):
        assert words in done.out
    table = rows(Path("out/conservativeness.csv"))
    assert max(float(row["percent_of_all"]) for row in table) < 5.0


def test_reproduce_kinks(hdplan: Command) -> None:
    done = hdplan("reproduce", "kinks")
    assert (done.code, done.err) == (0, "")
    assert "its rate jumps 5 times" in done.out
    assert "no jump" in done.out
    assert Path("out/kinks.png").read_bytes().startswith(b"\x89PNG")
    assert len(rows(Path("out/kinks.csv"))) == 1601


@pytest.mark.parametrize(
    "command", [("study", "distance"), ("study", "planning"), ("reproduce", "time"), ("reproduce", "kinks")]
)
def test_bad_folders_are_one_line_before_the_work(hdplan: Command, command: tuple[str, ...]) -> None:
    Path("file").write_text("")
    for folder in ("file", "missing/folder"):
        refused(hdplan(*command, "-o", folder), f"{folder}: ", "cannot be made")


def test_missing_matplotlib_is_reported_before_the_work(hdplan: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    refused(hdplan("reproduce", "conservativeness"), "pip install matplotlib")


@pytest.mark.parametrize("group", ["study", "reproduce"])
def test_unknown_names_are_refused(hdplan: Command, group: str) -> None:
    refused(hdplan(group, "distances"), f"hdplan {group} --help")


@pytest.mark.usefixtures("ctrl_c_is_heard")
def test_ctrl_c_leaves_what_was_counted_and_says_so(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [*COMMAND, "reproduce", "conservativeness", "--quick", "-o", str(tmp_path / "out")]
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
    assert " of 15000, 0 contacts called free" in out
    assert rows(tmp_path / "out" / "conservativeness.csv")


def _read_on(terminal: int) -> None:
    with contextlib.suppress(OSError):  # closed at the other end
        while os.read(terminal, 1 << 12):
            pass
