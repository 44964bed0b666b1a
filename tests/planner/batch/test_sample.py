"""Sampled problems are free at their ends, equal at every run, and valid in every scene of their set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hdplan import InputError, PoseTarget, check_configuration, load_robot, load_scene
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.sample import sample
from hdplan.planner.batch.sources import jobs_of
from tests.commands import in_process

ARM = Path("planar_arm")


def scene_of(row: dict[str, Any], scene: Path) -> Any:
    fields = {key: value for key, value in row.items() if key != "name"}
    return Job(row["name"], "", scene, fields=tuple(fields.items())).load()


@pytest.mark.parametrize("scene", ["planar_arm", "panda_cage"])
def test_both_ends_are_free(scene: str) -> None:
    drawn = sample(Path(scene), 12, seed=2, jitter=0.05, resize=0.2)
    robot = load_robot(load_scene(scene).robot)
    for row in drawn.rows:
        changed = scene_of(row, Path(scene))
        assert changed.obstacles != load_scene(scene).obstacles
        for end in (changed.start, changed.goal):
            assert check_configuration(changed, robot, robot.configuration(end)) == ()
    assert sum(drawn.rejected.values()) > 0
    assert drawn.text.startswith("12 problems; rejected: ")


def test_the_same_again_and_a_longer_table_begins_with_a_shorter() -> None:
    short, long = (sample(ARM, count, seed=3, jitter=0.02, resize=0.1).rows for count in (4, 7))
    assert long[:4] == short
    assert len({tuple(row.values()) for row in long}) == 7
    assert sample(ARM, 4, seed=4).rows != sample(ARM, 4, seed=3).rows


def test_goals_may_be_poses() -> None:
    for row in sample(Path("panda_cage"), 3, goal="pose").rows:
        scene = scene_of(row, Path("panda_cage"))
        (goal,) = scene.goal.targets
        assert isinstance(goal, PoseTarget)


@pytest.mark.core
def test_jitter_and_resize_stay_within_their_bounds() -> None:
    plain = load_scene(ARM).obstacles
    for row in sample(ARM, 20, jitter=0.03, resize=0.25).rows:
        for old, new in zip(plain, scene_of(row, ARM).obstacles, strict=True):
            assert np.abs(np.subtract(new.pose.position, old.pose.position)).max() <= 0.03
            if hasattr(old.shape, "radius"):
                assert 0.75 <= new.shape.radius / old.shape.radius <= 1.25


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"count": 0}, ["n: ", "0"]),
        ({"goal": "pse"}, ["goal", "'pse'", "'pose'"]),
        ({"jitter": -1.0}, ["jitter", "-1"]),
        ({"jitter": float("nan")}, ["jitter", "finite"]),
        ({"resize": 1.0}, ["resize", "0.9"]),
        ({"seed": -1}, ["seed", "-1"]),
        ({"scene": Path("panda_cag")}, ["panda_cag", "'panda_cage'"]),
    ],
)
def test_bad_values_are_refused(values: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        sample(**{"scene": ARM, "count": 2, **values})
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_world_without_free_configurations_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = yaml.safe_load(Path(load_scene(ARM).source).read_text())
    folder = Path(load_scene(ARM).source).parent
    content["robot"] = {"urdf": str(folder / "planar_arm.urdf"), "srdf": str(folder / "planar_arm.srdf")}
    everything = {"name": "all", "shape": {"type": "sphere", "radius": 5.0}, "pose": {"position": [0, 0, 0]}}
    content["obstacles"] = [everything]
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.setattr("hdplan.planner.batch.sample.MOST_TRIES", 50)
    with pytest.raises(InputError, match=r"no free start in 50 draws"):
        sample(tmp_path / "s.yaml", 1)


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_the_table_is_what_batch_reads(
    ending: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = in_process(monkeypatch, capsys)
    code, out, err = command("sample", "planar_arm", "-n", "3", "--seed", "5", "--jitter", "0.01", "-o", "t" + ending)
    assert (code, err) == (0, "")
    assert out.startswith("3 problems; rejected: ")
    rows = sample(ARM, 3, seed=5, jitter=0.01).rows
    jobs = jobs_of(["t" + ending], "planar_arm")
    assert [job.name for job in jobs] == [row["name"] for row in rows]
    assert [dict(job.fields) for job in jobs] == [{k: v for k, v in row.items() if k != "name"} for row in rows]
    for arguments, words in (
        (("-o", "t.txt"), "'.txt'"),
        (("-o", "no/t.csv"), "the folder no does not exist"),
        (("-o", "u.csv", "-n", "0"), "at least 1"),
        (("-o", "u.csv", "--goal", "pse"), "'pose'"),
        (("-o", "u.csv", "--jitter", "-1"), "-1"),
    ):
        code, out, err = command("sample", "planar_arm", *arguments)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert words in err
    assert {file.name for file in Path().iterdir()} == {"t" + ending}
