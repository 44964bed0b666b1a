"""Stages that a table repeats, and outputs that a motion's marks hold."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import hdplan
from hdplan import InputError, StageMark
from hdplan.verify.balls import RejectedError
from hdplan.verify.stages import stages_of
from hdplan.verify.text import yaml_of

HEAD = """
hdplan: 1
robot: {name: panda}
start: {state: default}
limits: {acceleration: 4}
job:
"""
TABLE = """
  - repeat:
      over:
        - {hole: first, y: 0.05, depth: [0, 0, -0.03], full: true}
        - {hole: second, y: -0.05, depth: [0, 0, -0.02], full: false}
      stages:
        - {name: above $hole, line: {by: [0, $y, 0]}}
        - {name: into, line: {by: $depth}}
        - {name: glue $hole, set: {glue: $full, what: "$hole$$"}}
        - {wait: 0.1}
"""


def read(tmp_path: Path, text: str) -> hdplan.Scene:
    (tmp_path / "job.yaml").write_text(HEAD + text, encoding="utf-8")
    return hdplan.load_scene(tmp_path / "job.yaml")


def test_a_table_repeats_stages(tmp_path: Path) -> None:
    scene = read(tmp_path, TABLE)
    assert scene.job is not None
    expected = hdplan.Job([
        stage
        for number, hole, y, depth, full in ((1, "first", 0.05, -0.03, True), (2, "second", -0.05, -0.02, False))
        for stage in (
            hdplan.Line(by=[0, y, 0], name=f"above {hole}"),
            hdplan.Line(by=[0, 0, depth], name=f"into {number}"),
            hdplan.Set({"glue": full, "what": f"{hole}$"}, name=f"glue {hole}"),
            hdplan.Wait(0.1),
        )
    ])  # fmt: skip
    assert scene.job == expected
    scene.save(tmp_path / "whole.yaml")
    assert hdplan.load_scene(tmp_path / "whole.yaml").job == scene.job


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("by: [0, $y, 0]", "by: [0, $z, 0]", r"job\[0\].repeat.stages\[0\]: there is no column 'z'"),
        ("by: [0, $y, 0]", "by: [0, 0.1, 0]", r"job\[0\].repeat.over: the column 'y' is used in no stage"),
        ("by: [0, $y, 0]", "by: [0, $, 0]", r"a dollar sign marks the name of a column"),
        ("y: -0.05,", "", r"over\[1\]: has the columns hole, depth, full, the first row hole, y, depth, full"),
        ("y: 0.05,", "y: far,", r"job\[0\].repeat.stages\[0\].line.by\[1\]: must be a finite number"),
        ("hole: second", "hole: first", "the name 'above first' is that of stage 0 too"),
        ("over:", "rows:", "unknown key 'rows'"),
        ("      over:", "      touch: []\n      over:", "unknown key 'touch'"),
        ("  - repeat:", "  - name: x\n    repeat:", "unknown key 'name'"),
        ("$full", "[1]", r"set.glue|is used in no stage"),
    ],
)
def test_errors_of_a_table_are_reported_in_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in TABLE
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path, TABLE.replace(old, new))
    assert "\n" not in str(error.value)


def test_a_table_makes_no_more_stages_than_are_allowed(tmp_path: Path) -> None:
    rows = "\n".join(f"        - {{y: {i}}}" for i in range(501))
    with pytest.raises(InputError, match="makes 1002 stages, at most 1000"):
        read(tmp_path, f"  - repeat:\n      over:\n{rows}\n      stages: [{{wait: $y}}, {{wait: $y}}]\n")


def test_marks_hold_outputs_and_the_certificate_compares_them(tmp_path: Path) -> None:
    scene = read(tmp_path, "  - {wait: 0.2}\n  - {name: glue, set: {glue: true, rate: 1.0}}\n  - {wait: 0.2}\n")
    result = hdplan.plan_job(scene)
    assert result.certified, result.text
    result.save(tmp_path / "job.json")
    content = json.loads((tmp_path / "job.json").read_text())["stages"]
    assert [each.get("outputs") for each in content] == [None, {"glue": True, "rate": 1.0}, None]
    motion = hdplan.Trajectory.load(tmp_path / "job.json")
    assert motion.stages == result.trajectory.stages
    assert hdplan.certify_job(scene, motion).certified
    for outputs in ({}, {"glue": False, "rate": 1.0}, {"glue": 1.0, "rate": 1.0}, {"glue": True}):
        mark = StageMark("glue", motion.stages[1].row, outputs)
        forged = replace(motion, stages=(motion.stages[0], mark, motion.stages[2]))
        with pytest.raises(InputError, match="stage 'glue' sets"):
            hdplan.certify_job(scene, forged)
    silent = replace(motion, stages=tuple(replace(mark, outputs={"glue": True}) for mark in motion.stages))
    with pytest.raises(InputError, match="stage 'wait 0' sets"):
        hdplan.certify_job(scene, silent)
    moved = motion.positions.copy()
    moved[motion.stages[1].row : motion.stages[2].row, 0] += 1e-3
    assert not hdplan.certify_job(scene, replace(motion, positions=moved)).certified
    for bad in ({"glue": [1]}, {"glue": float("nan")}, {1: True}):
        with pytest.raises(InputError):
            hdplan.Set(bad)
    with pytest.raises(InputError, match="one output or more"):
        hdplan.Set({})


def test_the_checker_repeats_stages_by_itself(tmp_path: Path) -> None:
    """The same stages as those of a saved scene, which has them one by one; and false tables are rejected."""
    scene = read(tmp_path, TABLE)
    scene.save(tmp_path / "saved.yaml")
    one, other = (yaml_of((tmp_path / name).read_bytes()) for name in ("job.yaml", "saved.yaml"))
    found, expected = stages_of(one), stages_of(other)
    assert [(x.name, x.kind, x.touch, x.beside, x.blend) for x in found] == [
        (x.name, x.kind, x.touch, x.beside, x.blend) for x in expected
    ]
    assert [x.content for x in found if x.kind != "line"] == [x.content for x in expected if x.kind != "line"]
    assert [x.content["by"] for x in found if x.kind == "line"] == [
        x.content["by"] for x in expected if x.kind == "line"
    ]
    for old, new in (("$hole", "$where"), ("depth: [0, 0, -0.02], ", ""), ("repeat:", "name: a\n    repeat:")):
        with pytest.raises(RejectedError):
            stages_of(yaml_of((HEAD + TABLE).replace(old, new).encode()))
