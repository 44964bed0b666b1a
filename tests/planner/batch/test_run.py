"""A run loses nothing: wherever it stops, the same command continues there and ends with the same files."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pyarrow.parquet
import pytest

import hdplan
from hdplan import InputError, Trajectory
from hdplan.planner.batch import run
from hdplan.planner.batch.files import place_of
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.journal import Journal, read_journal
from hdplan.planner.batch.outcome import Options, Outcome, solve
from hdplan.planner.batch.sources import jobs_of
from hdplan.planner.batch.tables import COLUMNS, OF_MOTIONS, read_rows, row_of, write_tables
from hdplan.planner.commands import batch
from hdplan.scenes.yaml_format.writer import scene_text
from hdplan.verify import verify
from tests.commands import Command, in_process

ARM = hdplan.load_scene("planar_arm")
COMMAND = [sys.executable, "-m", "hdplan.cli", "batch"]


def table(count: int, seed: int = 0) -> list[Job]:
    """Write a table of the planar arm with other goals, some of them in collision, as its problems."""
    rows = np.random.default_rng(seed).uniform(-2.0, 2.0, (count, 2))
    text = "".join(f"{x!r},{y!r}\n" for x, y in rows.tolist())
    Path("t.csv").write_text(f"goal.joints.shoulder,goal.joints.elbow\n{text}")
    return jobs_of(["t.csv"], "planar_arm")


def content(folder: Path | str) -> tuple[list[dict[str, Any]], bytes]:
    """The results without times, and the bytes of the motions."""
    rows = read_rows(Path(folder) / "results.parquet")
    kept = [{key: value for key, value in row.items() if not key.startswith("time_")} for row in rows]
    return kept, (Path(folder) / "motions.parquet").read_bytes()


@pytest.fixture
def run_here(two_workers: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., bool]:
    """Do runs with the two workers that are there."""
    monkeypatch.setattr(run, "worker_pool", lambda *_: contextlib.nullcontext(two_workers))
    return functools.partial(run.run_into, workers=2)


def outcome(i: int, motion: Trajectory | None = None) -> Outcome:
    return Outcome(f"p {i} ü", "certified" if motion else "refused", "" if motion else "bad_input", "text", motion, {})


MOTION = Trajectory(("a", "b.c"), [[0.1, 1 / 3], [-0.0, 1e-300]], {"held": 0.2}, [0, 0.7], [[0, 1], [2, 3]])


# --- the journal ------------------------------------------------------------------------------------------------


def test_outcomes_come_back_from_the_journal_as_they_were() -> None:
    with contextlib.closing(Journal(Path("j"))) as journal:
        for i in (3, 0, 2):
            journal.add(i, outcome(i, MOTION if i else None))
    with contextlib.closing(Journal(Path("j"))) as journal:
        found = dict(journal)
    assert list(found) == [0, 2, 3]
    assert found[0].trajectory is None
    motion = found[3].trajectory
    assert motion is not None
    assert (motion.joint_names, dict(motion.locked)) == (MOTION.joint_names, dict(MOTION.locked))
    for name in ("positions", "times", "velocities"):
        assert getattr(motion, name).tobytes() == getattr(MOTION, name).tobytes()
    assert motion.accelerations is None
    assert [each.problem for each in read_journal(Path("j"))] == ["p 0 ü", "p 2 ü", "p 3 ü"]


def test_a_journal_cut_anywhere_keeps_what_is_whole() -> None:
    with contextlib.closing(Journal(Path("j"))) as journal:
        ends = []
        for i in range(3):
            journal.add(i, outcome(i, MOTION))
            ends.append(journal.end)
    whole = Path("j").read_bytes()
    near = {end + shift for end in (0, *ends) for shift in range(-12, 13) if 0 <= end + shift <= len(whole)}
    for cut in sorted(near | {*random.Random(0).sample(range(len(whole)), 40)}):
        Path("j").write_bytes(whole[:cut])
        kept = sum(end <= cut for end in ends)
        assert len(read_journal(Path("j"))) == kept
        with contextlib.closing(Journal(Path("j"))) as journal:
            assert [number for number, _ in journal] == list(range(kept))
            for i in range(kept, 3):
                journal.add(i, outcome(i, MOTION))
        assert Path("j").read_bytes() == whole


def test_a_byte_that_changed_ends_what_is_believed() -> None:
    with contextlib.closing(Journal(Path("j"))) as journal:
        for i in range(3):
            journal.add(i, outcome(i, MOTION))
            end = journal.end
    whole = Path("j").read_bytes()
    drawn = random.Random(1)
    for _ in range(200):
        place = drawn.randrange(end)
        changed = bytearray(whole)
        changed[place] ^= 1 << drawn.randrange(8)
        Path("j").write_bytes(changed)
        assert {each.problem for each in read_journal(Path("j"))} <= {outcome(i).problem for i in range(3)}
        assert len(read_journal(Path("j"))) <= whole[:place].count(b"\n") + (place == end - 1)


def test_a_full_disk_stops_with_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    with contextlib.closing(Journal(Path("j"))) as journal:
        journal.add(0, outcome(0))
        full = Mock(wraps=journal.file, write=lambda data: 5)
        monkeypatch.setattr(journal, "file", full)
        with pytest.raises(InputError, match=r"^j: cannot be written \(No space left on device\)$"):
            journal.add(1, outcome(1))
    assert len(read_journal(Path("j"))) == 1


def test_a_disk_that_is_full_when_tables_are_written_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    words = "Error writing bytes to file. Detail: [errno 28] No space left on device"  # Arrow's
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError(words)))
    Path("r").mkdir()
    with pytest.raises(InputError, match=r"^r: cannot be written \(No space left on device\)$"):
        write_tables(Path("r"), [(0, outcome(0, MOTION))])
    assert not list(Path("r").iterdir())


# --- runs -------------------------------------------------------------------------------------------------------


def test_a_run_that_stops_goes_on_where_it_was(
    run_here: Callable[..., bool], capsys: pytest.CaptureFixture[str]
) -> None:
    jobs, options, seen = table(12), Options(), list[str]()
    assert run_here(Path("whole"), jobs, options)
    stop = lambda: len(seen) >= 5  # noqa: E731
    assert not run_here(Path("cut"), jobs, options, report=lambda done, of, each: seen.append(each.problem), stop=stop)
    assert len(read_rows(Path("cut/results.parquet"))) == 5
    certified = sum(row["status"] == "certified" for row in read_rows(Path("cut/results.parquet")))
    batch.show_report(Path("cut"), None)
    counted = f"{certified} of 12 problems certified, {5 - certified} not, 7 not planned yet\n"
    assert capsys.readouterr().out.startswith(counted)
    lines = Path("cut/journal").read_bytes()
    Path("cut/journal").write_bytes(lines[:-7])
    assert run_here(Path("cut"), jobs, options, report=lambda done, of, each: seen.append(each.problem))
    assert len(seen) == 5 + 8
    assert content("cut") == content("whole")
    assert {row["status"] for row in content("whole")[0]} >= {"certified", "refused"}
    before = {file: file.read_bytes() for file in Path("whole").iterdir()}
    assert run_here(Path("whole"), jobs, options, report=lambda *_: pytest.fail("planned again"))
    assert {file: file.read_bytes() for file in Path("whole").iterdir()} == before
    assert {file.name for file in Path("whole").iterdir()} == {
        "run.json",
        "journal",
        "results.parquet",
        "motions.parquet",
    }


def test_tables_hold_what_a_loop_finds(run_here: Callable[..., bool]) -> None:
    jobs = table(6)
    run_here(Path("r"), jobs, Options())
    rows, alone = read_rows(Path("r/results.parquet")), [solve(job, Options()) for job in jobs]
    assert list(rows[0]) == list(COLUMNS)
    assert [row["problem"] for row in rows] == [job.name for job in jobs]
    assert [(row["status"], row["cause"], row["text"]) for row in rows] == [
        (each.status, each.cause, each.text) for each in alone
    ]
    assert all(row["clearance"] == each.figures.get("clearance") for row, each in zip(rows, alone, strict=True))
    assert sum(each.certified for each in alone) >= 2
    motions = pyarrow.parquet.read_table("r/motions.parquet")
    assert motions.column_names == list(OF_MOTIONS)
    for each in alone:
        if each.trajectory is not None:
            mine = motions.filter(pyarrow.compute.equal(motions["problem"], each.problem))
            positions = np.array(mine["position"]).reshape(-1, 2)
            assert positions.tobytes() == each.trajectory.positions.tobytes()
            assert mine["joint"].to_pylist()[:2] == list(each.trajectory.joint_names)


def test_a_diagnosis_is_part_of_the_row(run_here: Callable[..., bool]) -> None:
    inside = ARM.with_goal([0.06, 0.0])  # the ball
    run_here(Path("r"), [Job("in", "", inside), Job("free", "", ARM)], Options(diagnose=True))
    blocked, free = read_rows(Path("r/results.parquet"))
    assert (blocked["status"], blocked["cause"]) == ("refused", "end_in_contact")
    assert blocked["advice"].startswith("within ")
    assert (free["cause"], free["advice"]) == ("", None)


def test_a_row_that_the_clock_ended_says_so() -> None:
    """Rows that differ between two runs say why."""
    wall = hdplan.Obstacle("wall", hdplan.Box([2.4, 0.05, 0.5]), hdplan.Pose([1.4, 0.0, 0.1]))
    blocked = dataclasses.replace(ARM, obstacles=(wall,))
    cases = [(ARM, 30.0), (ARM.with_goal([0.06, 0.0]), 30.0), (blocked, 1e-9), (blocked, 2.0)]
    rows = [row_of(solve(Job("one", "", scene), Options(time_limit=each))) for scene, each in cases]
    assert [row["timed_out"] for row in rows] == [False, False, True, True]
    free, refused, hurried, searched = rows
    assert (searched["status"], searched["cause"]) == ("in_contact", "local_minimum")
    assert searched["text"].endswith(f" reached after {searched['attempts']} guesses; more time may help")
    assert (hurried["status"], hurried["cause"]) == ("refused", "time")
    assert (free["cause"], refused["cause"]) == ("", "end_in_contact")


def test_a_folder_holds_one_run(run_here: Callable[..., bool]) -> None:
    jobs = table(2)
    run_here(Path("r"), jobs, Options())
    for other, options, words in (
        (jobs[::-1], Options(), "other problems, or in another order"),
        ([dataclasses.replace(jobs[0], seed=1), jobs[1]], Options(), "other problems, or in another order"),
        (jobs[:1], Options(), "problems: 2"),
        (jobs, Options(time_limit=5.0), "time_limit: 60.0"),
    ):
        with pytest.raises(InputError, match=f"^r: holds a run with {words}; name another folder$"):
            run_here(Path("r"), other, options)
    with (
        contextlib.closing(Journal(Path("r/journal"))),
        pytest.raises(InputError, match="r: another process is writing this run"),
    ):
        run_here(Path("r"), jobs, Options())
    Path("mine").mkdir()
    Path("mine/thesis.tex").write_text("x")
    with pytest.raises(InputError, match="mine: holds files that do not belong to a run"):
        run_here(Path("mine"), jobs, Options())
    assert [file.name for file in Path("mine").iterdir()] == ["thesis.tex"]
    Path("file").write_text("x")
    with pytest.raises(InputError, match="file: cannot be written"):
        run_here(Path("file"), jobs, Options())


def test_files_are_those_of_the_problem_and_the_same_again(run_here: Callable[..., bool]) -> None:
    jobs = [*table(3), Job("../up", "", ARM), Job("bad", "", Path("no/such.yaml"))]
    options = Options(files=True, proofs=True)
    run_here(Path("r"), jobs, options)
    run_here(Path("again"), jobs, options)
    made, again = (
        {str(file.relative_to(run)): file.read_bytes() for file in Path(run, "motions").rglob("*") if file.is_file()}
        for run in ("r", "again")
    )
    assert made == again
    for row, job in zip(read_rows(Path("r/results.parquet")), jobs, strict=True):
        place = str(place_of(Path("motions"), job.name))
        assert (f"{place}.yaml" in made) == (job.name != "bad")
        assert (f"{place}.json" in made) == (row["status"] == "certified")
        assert row["proof"] == ("written" if row["status"] == "certified" else None)
        if row["status"] == "certified":
            scene, motion, proof = (Path("r", place + ending) for ending in (".yaml", ".json", ".proof"))
            assert hdplan.certify(hdplan.load_scene(scene), Trajectory.load(motion)).text == row["text"]
            assert verify(scene, motion, proof).text.startswith("accepted")
    assert Path("r/motions/%2E%2E/up.proof").is_file()


def test_names_of_outputs_are_unique_and_stay_in_the_folder() -> None:
    drawn, names = (
        random.Random(6),
        {"", ".", "..", "/", "//", "/a", "a", "a/", "%2E", "a\0b", "ü/ ", "a b", "..a", "con:x"},
    )
    names |= {"".join(drawn.choices("./a%", k=drawn.randrange(1, 6))) for _ in range(300)}
    places = [place_of(Path("/run"), name) for name in names]
    assert len({*map(str, places)}) == len(names)
    assert all(os.path.normpath(place) == str(place) and place.is_relative_to("/run") for place in places)
    assert all("\0" not in str(place) for place in places)


# --- the command ------------------------------------------------------------------------------------------------


@pytest.fixture
def command(run_here: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run `hdplan` in this process."""
    return in_process(monkeypatch, capsys)


def test_the_command_plans_and_reports(command: Callable[..., tuple[int, str, str]]) -> None:
    Path("bad.yaml").write_text("hdplan: 1\n")
    code, out, err = command("batch", "planar_arm", "bad.yaml", "-o", "r")
    assert (code, err) == (1, "")
    assert out.startswith("1 of 2 problems certified\n")
    printed = "".join(out.split())  # wherever lines wrap
    assert "1failedafileoravalueisinvalid,suchasbad:" in printed
    assert "bad.yaml:thekey'start'ismissing" in printed
    assert command("batch", "--report", "r") == (1, out, "")
    code, drawn, err = command("batch", "--report", "r", "--plot", "r.png")
    assert (code, drawn, err) == (1, out + "  written   r.png\n", "")
    assert Path("r.png").read_bytes().startswith(b"\x89PNG")
    assert command("batch", "planar_arm", "-o", "good")[0] == 0
    Path("far.yaml").write_text(scene_text(ARM.with_goal([1.0, 9.0])))
    code, out, err = command("batch", "far.yaml", "planar_arm", "-o", "files", "--motions", "files")
    assert "hdplan view files/motions/far.yaml\n" in out
    assert Path("files/motions/planar_arm.json").is_file()


def test_a_run_is_exported_as_a_data_set(command: Callable[..., tuple[int, str, str]]) -> None:
    limits = hdplan.Limits(velocity=2.0, acceleration=8.0)
    timed = dataclasses.replace(ARM, timing=hdplan.Timing(), limits=limits)
    timed.save("timed.yaml")
    code, out, err = command("batch", "timed.yaml", "-o", "r", "--export", "lerobot", "--fps", "20")
    assert (code, err) == (0, "")
    assert "r/lerobot\n" in out
    rows = read_rows(Path("r/results.parquet"))
    frames = read_rows(Path("r/lerobot/data/chunk-000/file-000.parquet"))
    assert len(frames) == int(np.ceil(rows[0]["motion_time"] * 20)) + 1
    assert json.loads(Path("r/lerobot/meta/info.json").read_text())["robot_type"] == rows[0]["robot"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "r"], ["needs SOURCE and --output RUN, or --report RUN"]),
        (["planar_arm"], ["needs SOURCE and --output RUN"]),
        (["planar_arm", "-o", "r", "--report", "r"], ["--report RUN takes no SOURCE"]),
        (["--report", "nowhere"], ["nowhere", "not the folder of a run"]),
        (["no/*.yaml", "-o", "r"], ["no/*.yaml", "no such file"]),
        (["planar_arm", "-o", "r", "--workers", "0"], ["--workers", "at least 1", "'0'"]),
        (
            ["planar_arm", "-o", "r", "--workers", "1", "--scheduler", "tcp://x:1"],
            ["--workers, --scheduler", "one of them"],
        ),
        (["planar_arm", "-o", "r", "--cluster", "no.yaml"], ["no.yaml: no such file"]),
        (["planar_arm", "-o", "r", "--plot", "r.jpg"], ["r.jpg", "'.jpg'", ".png"]),
        (["planar_arm", "-o", "r", "--motions", "file"], ["motions", "'file'", "'files'"]),
        (["planar_arm", "-o", "r", "--export", "lerobt"], ["export", "'lerobt'", "'lerobot'"]),
        (["planar_arm", "-o", "r", "--export", "lerobot"], ["planar_arm", "no times", "`timing`"]),
        (["planar_arm", "-o", "r", "--solver", "ipop"], ["'ipop'", "'ipopt'"]),
        (["planar_arm", "-o", "r", "--time-limit", "nan"], ["--time-limit", "finite"]),
        (["planar_arm", "-o", "r", "--scene", "planar_arm"], ["--scene", "no source is a table"]),
        (["t.csv", "-o", "r", "--scene", "planar_arm"], ["t.csv", "'strat.state'", "'start'"]),
    ],
)
def test_bad_arguments_are_one_line(
    command: Callable[..., tuple[int, str, str]], arguments: list[str], words: list[str]
) -> None:
    Path("t.csv").write_text("strat.state\nright\n")
    code, out, err = command("batch", *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("hdplan: ")
    assert all(word in err for word in words), err
    assert not Path("r").exists()


def test_a_broken_description_is_one_line(command: Callable[..., tuple[int, str, str]]) -> None:
    command("batch", "planar_arm", "-o", "r")
    whole = Path("r/run.json").read_text()
    for text in ("", whole[:-3], "[]", "{}", '{"problems": "x"}', "\x00"):
        Path("r/run.json").write_text(text)
        for arguments in (["--report", "r"], ["planar_arm", "-o", "r"]):
            code, out, err = command("batch", *arguments)
            assert (code, out, err.count("\n")) == (2, "", 1), (text, arguments, err)


# --- killed -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_with_the_same_files() -> None:
    table(60)
    arguments = [*COMMAND, "t.csv", "--scene", "planar_arm", "--workers", "2", "-o"]
    subprocess.run([*arguments, "whole"], stdout=subprocess.DEVNULL, check=False)
    drawn = random.Random(4)
    for _ in range(50):
        driver = subprocess.Popen([*arguments, "killed"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with contextlib.suppress(subprocess.TimeoutExpired):
            driver.wait(drawn.uniform(1.0, 5.0))
        driver.send_signal(signal.SIGKILL)
        driver.wait()
    subprocess.run([*arguments, "killed"], stdout=subprocess.DEVNULL, check=False)
    assert content("killed") == content("whole")
    assert len(content("whole")[0]) == 60
    assert not [file for file in Path("killed").iterdir() if file.name.endswith(".tmp")]
    shutil.rmtree("killed")


@pytest.mark.slow
def test_workers_that_are_killed_cost_no_result() -> None:
    import psutil

    table(60)
    arguments = [*COMMAND, "t.csv", "--scene", "planar_arm", "--workers", "2", "-o"]
    subprocess.run([*arguments, "whole"], stdout=subprocess.DEVNULL, check=False)
    driver = subprocess.Popen([*arguments, "killed"], stdout=subprocess.DEVNULL)
    drawn = random.Random(5)
    while driver.poll() is None:
        time.sleep(drawn.uniform(0.5, 2.0))
        with contextlib.suppress(psutil.NoSuchProcess, OSError):
            workers = [
                each
                for each in psutil.Process(driver.pid).children(recursive=True)
                if "spawn_main" in str(each.cmdline())
            ]
            if workers and Path("killed/journal").stat().st_size:
                drawn.choice(workers).kill()
    mine, whole = content("killed"), content("whole")
    unlike = [row for row, other in zip(mine[0], whole[0], strict=True) if row != other]
    assert all(row["cause"] == "ended" for row in unlike), "only one that was killed twice may be lost"
    assert len(unlike) <= 2
    assert json.loads(Path("killed/run.json").read_text())["problems"] == 60
