"""A data set holds the motions as the format has them (LeRobotDataset v3.0): files, indices, columns, numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from hdplan import InputError, Outcome, Trajectory
from hdplan.planner.batch import lerobot
from hdplan.planner.batch.lerobot import samples_of, write_lerobot

FPS = 25


def motion(seed: int, duration: float, joints: int = 3, begin: float = 0.0) -> Trajectory:
    drawn = np.random.default_rng(seed)
    times = begin + np.linspace(0.0, duration, 6)
    return Trajectory([f"j{i}" for i in range(joints)], drawn.uniform(-2, 2, (6, joints)), times=times)


def outcome(name: str, trajectory: Trajectory | None, status: str = "certified") -> Outcome:
    return Outcome(name, status, "", "", trajectory, {"robot": "arm"})


def outcomes_of(*motions: Trajectory) -> list[tuple[Outcome, str]]:
    return [(outcome(f"p{i}", each), f"task {i % 2}") for i, each in enumerate(motions)]


def read(folder: Path) -> tuple[dict[str, Any], list[dict[str, Any]], pyarrow.Table]:
    about = json.loads((folder / "meta/info.json").read_text())
    episodes = pyarrow.parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    places = sorted({(each["data/chunk_index"], each["data/file_index"]) for each in episodes})
    files = [folder / about["data_path"].format(chunk_index=chunk, file_index=file) for chunk, file in places]
    assert sorted((folder / "data").rglob("*.parquet")) == files
    return about, episodes, pyarrow.concat_tables([pyarrow.parquet.read_table(file) for file in files])


@pytest.mark.parametrize("most", [10**6, 60])
@pytest.mark.parametrize("joints", [1, 3])
def test_every_sample_is_where_the_format_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, joints: int
) -> None:
    monkeypatch.setattr(lerobot, "MOST_FRAMES", most)
    monkeypatch.setattr(lerobot, "CHUNK", 2)
    motions = [motion(i, duration, joints, i) for i, duration in enumerate((1.0, 2.013, 0.5, 1.999, 0.04))]
    failed = [(outcome("x", motion(9, 1.0, joints), "in_contact"), "task 0"), (outcome("y", None, "refused"), "task 0")]
    assert write_lerobot(tmp_path / "set", [*failed, *outcomes_of(*motions)], FPS) == 5
    about, episodes, data = read(tmp_path / "set")
    assert (about["codebase_version"], about["fps"], about["robot_type"]) == ("v3.0", FPS, "arm")
    assert (about["total_episodes"], about["total_frames"], about["total_tasks"]) == (5, len(data), 2)
    assert about["splits"] == {"train": "0:5"}
    assert set(about["features"]) == set(data.column_names)
    kept = pyarrow.float32() if joints == 1 else pyarrow.list_(pyarrow.float32(), joints)
    assert data.schema.field("observation.state").type == data.schema.field("action").type == kept
    assert data["index"].to_pylist() == list(range(len(data)))
    tasks = pyarrow.parquet.read_table(tmp_path / "set/meta/tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0, 1], "__index_level_0__": ["task 0", "task 1"]}
    assert b"pandas" in tasks.schema.metadata
    first = 0
    for i, (episode, planned) in enumerate(zip(episodes, motions, strict=True)):
        assert (episode["episode_index"], episode["tasks"]) == (i, [f"task {i % 2}"])
        assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (first, first + episode["length"])
        rows = data.slice(first, episode["length"]).to_pydict()
        first += episode["length"]
        state, action = (np.reshape(rows[key], (-1, joints)) for key in ("observation.state", "action"))
        assert rows["frame_index"] == list(range(len(state)))
        assert set(rows["episode_index"]) == {i}
        assert set(rows["task_index"]) == {i % 2}
        assert np.array_equal(rows["timestamp"], (np.arange(len(state)) / FPS).astype(np.float32))
        assert np.array_equal(action[:-1], state[1:])
        assert np.array_equal(action[-1], state[-1])
        assert np.array_equal(state, samples_of(planned, FPS).astype(np.float32))
    assert first == len(data)


def test_samples_begin_and_end_with_the_motion() -> None:
    for seed, duration in enumerate((0.04, 0.05, 1.0, 1.2345, 1e-3)):
        planned = motion(seed, duration, begin=3.0)
        rows = samples_of(planned, FPS)
        assert len(rows) == int(np.ceil(duration * FPS - 1e-9)) + 1
        assert np.allclose(rows[0], planned.positions[0], atol=1e-12)
        assert np.allclose(rows[-1], planned.positions[-1], atol=1e-12)
        inner = np.arange(len(rows) - 1) / FPS
        assert np.allclose(rows[:-1], planned.at(inner / duration), atol=1e-9)


def test_statistics_are_those_of_all_samples(tmp_path: Path) -> None:
    write_lerobot(tmp_path / "set", outcomes_of(motion(1, 1.0), motion(2, 1.5)), FPS)
    _, episodes, data = read(tmp_path / "set")
    statistics = json.loads((tmp_path / "set/meta/stats.json").read_text())
    assert set(statistics) == set(data.column_names)
    values = np.array(data["action"].to_pylist())
    assert np.allclose(statistics["action"]["min"], values.min(0))
    assert np.allclose(statistics["action"]["mean"], values.mean(0))
    assert np.allclose(statistics["action"]["std"], values.std(0))
    assert np.allclose(statistics["action"]["q90"], np.quantile(values, 0.9, axis=0))
    assert statistics["index"]["count"] == [len(data)]
    own = values[episodes[1]["dataset_from_index"] : episodes[1]["dataset_to_index"]]
    assert np.allclose(episodes[1]["stats/action/max"], own.max(0))
    assert episodes[1]["stats/index/min"] == [episodes[1]["dataset_from_index"]]


def test_motions_that_cannot_be_exported_are_refused_and_the_last_data_set_stays(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    write_lerobot(folder, outcomes_of(motion(1, 1.0)), FPS)
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    path = Trajectory(("j0", "j1", "j2"), [[0, 0, 0], [1, 1, 1]])
    for given, words in (
        (outcomes_of(motion(1, 1.0), path, path), "2 motions have no times, .*: p1, p2"),
        (outcomes_of(motion(1, 1.0), motion(1, 1.0, 2)), "p1: moves j0, j1, the motions before it j0, j1, j2"),
        ([(outcome("x", None, "refused"), "t")], "no motion is certified"),
    ):
        with pytest.raises(InputError, match=words):
            write_lerobot(folder, given, FPS)
        assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before
    assert list(tmp_path.iterdir()) == [folder]
    write_lerobot(folder, outcomes_of(motion(4, 1.0)), FPS)
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} != before
