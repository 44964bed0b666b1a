"""The commands, with a scene that holds a job: plan, check and simulate take it, others refuse it in one line."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from tests.commands import Command, in_process

SCENE = """
hdplan: 1
robot: {name: panda}
start: {state: default}
limits: {acceleration: 4}
job:
  - {name: down, line: {by: [0, 0, -0.05]}}
  - {name: stand, wait: 0.1}
"""


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run a command in a folder with the scene; return code, output and errors."""
    monkeypatch.chdir(tmp_path)
    Path("job.yaml").write_text(SCENE, encoding="utf-8")
    run = in_process(monkeypatch, capsys)
    return lambda line: run(*shlex.split(line))


def test_commands_take_a_job_or_refuse_it(command: Command) -> None:
    code, out, _ = command("plan job.yaml -o motion.json --json")
    content = json.loads(out)
    assert (code, content["status"], [each["stage"] for each in content["stages"]]) == (
        0,
        "certified",
        ["down", "stand"],
    )
    code, out, _ = command("check job.yaml motion.json")
    assert (code, out.splitlines()[0]) == (0, f"{content['text']}")
    for line in (
        "follow job.yaml motion.json",
        "explain job.yaml",
        "codegen job.yaml -o folder",
    ):
        code, out, err = command(line)
        assert (code, out) == (2, ""), line
        assert "job: holds several motions" in err, line
    code, out, _ = command("simulate job.yaml motion.json")
    assert (code, out.splitlines()[0]) == (0, "replayed: all 2 stages, within all limits of the scene")
    ball = "shape: {type: sphere, radius: 0.1}, pose: {position: [2, 0, 0]}"
    unknown = f"obstacles: [{{{ball}, uncertainty: {{position: 0.01}}}}]\n"
    Path("unknown.yaml").write_text(SCENE.replace("start:", unknown + "start:"), encoding="utf-8")
    code, out, _ = command("simulate unknown.yaml motion.json")
    nominal = "; in the nominal world, without obstacles[0].uncertainty.position"
    assert (code, out.splitlines()[0].endswith(f"limits of the scene{nominal}")) == (0, True)
    code, out, _ = command("simulate job.yaml motion.json --json")
    content = json.loads(out)
    assert (code, [each["kind"] for each in content["stages"]], content["plant"]) == (0, ["line", "wait"], None)
    code, _, err = command("simulate job.yaml motion.json --plot rates.png")
    assert (code, "--plot: is about a single motion" in err) == (2, True)
    code, _, err = command("view job.yaml motion.json motion.json")
    assert (code, "one motion at a time is shown of a job, 2 are given" in err) == (2, True)
    code, _, err = command("view job.yaml motion.json --proof job.proof")
    assert (code, "--proof: job.proof is drawn for a single motion" in err) == (2, True)
    code, _, err = command("sample job.yaml -o table.csv")
    assert (code, "whose places are drawn: give --jitter" in err) == (2, True)
    code, _, err = command("sample job.yaml -o table.csv --jitter 0.01")
    assert (code, "grips nothing" in err) == (2, True)
    for option in ("--diagnose", "--solver ipopt"):
        code, _, err = command(f"plan job.yaml -o other.json {option}")
        assert code == 2, option
        assert err.endswith("is about a single motion, and this scene holds a job: leave it out\n")
    code, _, err = command("plan job.yaml -o other.csv --proof a.proof")
    assert (code, "--proof: a job's proof refers to the motion's JSON file" in err) == (2, True)
    assert not Path("other.json").exists()
    assert not Path("other.csv").exists()


def test_plan_writes_proof_and_sheet(command: Command) -> None:
    """The proof is that of the files, as of a single motion, the sheet a picture of the stages."""
    Path("job.yaml").write_text(SCENE, encoding="utf-8")
    code, out, _ = command("plan job.yaml -o motion.json --proof job.proof --plot sheet.svg")
    assert code == 0
    assert all(name in out for name in ("motion.json", "job.proof", "sheet.svg"))
    assert "<svg" in Path("sheet.svg").read_text(encoding="utf-8")
    code, out, _ = command("verify job.yaml motion.json job.proof")
    assert (code, out.startswith("accepted: a job of")) == (0, True)
    code, out, _ = command("plot job.yaml motion.json -o again.svg")
    assert (code, out.startswith("certified: all 2 stages")) == (0, True)
    assert Path("again.svg").exists()


def test_a_stage_that_fails_keeps_what_was_planned(command: Command) -> None:
    Path("job.yaml").write_text(SCENE + "  - {name: away, line: {by: [1, 0, 0]}}\n", encoding="utf-8")
    code, out, _ = command("plan job.yaml -o motion.json")
    assert code == 1
    assert out.startswith("not certified: stage 'away': panda_hand_tcp cannot follow the curve beyond")
    code, out, _ = command("check job.yaml motion.json")
    assert code == 1
    assert out.startswith("not whole: 2 stages are proven, 'away' has no motion")
    assert command("prove job.yaml motion.json -o job.proof")[0] == 1
    assert not Path("job.proof").exists()
