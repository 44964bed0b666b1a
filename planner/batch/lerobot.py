"""The certified motions of a run as a data set for imitation learning: LeRobotDataset v3.0, as lerobot reads it.

An episode is a motion, sampled at a fixed rate from its start: `observation.state` holds the joints' positions [rad
or m] and `action` those of the next sample, at the end its own. The last sample is the motion's end, also where that
lies between two. Statistics are over all samples. Of jobs, fingers are joints like others, so an action holds what the
gripper is to do; `subtask_index` is the stage of each sample, and `meta/subtasks.parquet` has the stages' names.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.batch.outcome import Outcome
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, listed

if TYPE_CHECKING:
    import pyarrow

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
TASKS, SUBTASKS = "meta/tasks.parquet", "meta/subtasks.parquet"
INFO, STATS = "meta/info.json", "meta/stats.json"
MOST_FRAMES = 1_000_000  # of a file: with seven joints about 100 MB before compression, as lerobot has them
WITHOUT_TIMES = "motions have no times, which a data set needs (the scene's section `timing` gives them)"
CHUNK = 1000  # files in a folder
VALUES = ("observation.state", "action")
COUNTERS, SUBTASK = ("frame_index", "episode_index", "index", "task_index"), "subtask_index"
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def write_lerobot(folder: Path, outcomes: Iterable[tuple[Outcome, str]], fps: int) -> int:
    """Write a data set into `folder`, in place of what is there, whole or not at all; returns the number of episodes.

    Args:
        folder: of the data set.
        outcomes: each with what the motion does, in words.
        fps: samples a second.

    Raises:
        InputError: no motion is certified, one has no times, they have different joints, or it cannot be written.
    """
    half = folder.with_name(f".{folder.name}.{os.getpid()}.tmp")
    try:
        try:
            episodes = _written(half, outcomes, fps)
            shutil.rmtree(folder, ignore_errors=True)
            os.replace(half, folder)
        finally:
            shutil.rmtree(half, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error})") from None
    return episodes


def samples_of(motion: Trajectory, fps: int) -> Array:
    """Return the positions (n, joints) of a motion with times at 0, 1/fps, ... and at its end."""
    return motion.curve.at_time(_times(motion, fps))


def _times(motion: Trajectory, fps: int) -> Array:
    assert motion.times is not None
    assert motion.duration is not None
    steps = np.arange(int(np.ceil(motion.duration * fps - 1e-9)) + 1) / fps
    return np.asarray(motion.times[0] + np.minimum(steps, motion.duration))


@dataclass(frozen=True)
class _Episode:
    """The samples of a motion."""

    states: Array  # (n, joints)
    stages: Rows | None  # (n,) numbers of the stages of a job
    number: int
    first: int  # sample of all
    task: int

    def __len__(self) -> int:
        return len(self.states)


def _stages(motion: Trajectory, fps: int, subtasks: dict[str, int]) -> Rows | None:
    """Return the stage of each sample, by its number among all stages; None for motions without stages."""
    if not motion.stages:
        return None
    assert motion.times is not None
    begin = motion.times[[mark.row for mark in motion.stages]]
    numbers = np.array([subtasks.setdefault(mark.name, len(subtasks)) for mark in motion.stages])
    return np.asarray(numbers[np.searchsorted(begin, _times(motion, fps), side="right") - 1])


def _written(folder: Path, outcomes: Iterable[tuple[Outcome, str]], fps: int) -> int:
    tasks: dict[str, int] = {}
    subtasks: dict[str, int] = {}
    episodes: list[dict[str, Any]] = []
    made: list[_Episode] = []
    names: tuple[str, ...] = ()
    robots = dict[str, None]()
    untimed, total = [], 0
    with contextlib.ExitStack() as stack:
        files = _Files(folder, stack)
        for outcome, does in outcomes:
            motion = outcome.trajectory
            if not outcome.certified or motion is None:
                continue
            if motion.times is None:
                untimed.append(outcome.problem)
                continue
            if names and motion.joint_names != names:
                raise InputError(
                    f"{outcome.problem}: moves {', '.join(motion.joint_names)}, the motions before it "
                    f"{', '.join(names)}; a data set is of one robot's joints: export each robot's problems alone"
                )
            names = motion.joint_names
            robots[str(outcome.figures.get("robot"))] = None
            task, stages = tasks.setdefault(does, len(tasks)), _stages(motion, fps, subtasks)
            episode = _Episode(samples_of(motion, fps), stages, len(episodes), total, task)
            if made and (stages is None) != (made[0].stages is None):
                raise InputError(f"{outcome.problem}: jobs and single motions are exported alone")
            made.append(episode)
            place = files.add(episode, fps)
            own = {"episode_index": len(episodes), "tasks": [does], "length": len(episode), **place}
            own |= {"dataset_from_index": total, "dataset_to_index": total + len(episode)}
            own |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
            episodes.append({**own, **_flat(_statistics([episode], fps))})
            total += len(episode)
    if untimed:
        raise InputError(f"--export lerobot: {len(untimed)} {WITHOUT_TIMES}: {listed(untimed)}")
    if not episodes:
        raise InputError("--export lerobot: no motion is certified, so there is nothing to export")
    features: dict[str, dict[str, Any]]
    features = {key: {"dtype": "float32", "shape": [len(names)], "names": list(names)} for key in VALUES}
    features |= {"timestamp": {"dtype": "float32", "shape": [1], "names": None}}
    counters = (*COUNTERS, *([SUBTASK] if subtasks else []))
    features |= {key: {"dtype": "int64", "shape": [1], "names": None} for key in counters}
    about = {
        **{"codebase_version": "v3.0", "robot_type": "+".join(robots), "total_episodes": len(episodes)},
        **{"total_frames": total, "total_tasks": len(tasks), "chunks_size": CHUNK, "data_files_size_in_mb": 100},
        **{"video_files_size_in_mb": 200, "fps": fps, "splits": {"train": f"0:{len(episodes)}"}},
        **{"data_path": DATA, "video_path": None, "features": features},
    }
    _write_meta(folder, about, _statistics(made, fps), episodes)
    _write_names(folder / TASKS, "task_index", tasks)
    if subtasks:
        _write_names(folder / SUBTASKS, SUBTASK, subtasks)
    return len(episodes)


class _Files:
    """The data, in files of at most MOST_FRAMES, each of whole episodes."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack) -> None:
        self.folder, self.stack, self.writer = folder, stack, None
        self.number, self.frames = -1, 0

    def add(self, episode: _Episode, fps: int) -> dict[str, int]:
        """Add an episode; returns where it is."""
        import pyarrow.parquet

        table = _table(episode, fps)
        if self.writer is None or self.frames + len(episode) > MOST_FRAMES:
            self.number, self.frames = self.number + 1, 0
            file = self.folder / DATA.format(**self._place())
            file.parent.mkdir(parents=True, exist_ok=True)
            self.writer = self.stack.enter_context(pyarrow.parquet.ParquetWriter(file, table.schema))
        assert self.writer is not None
        self.writer.write_table(table)
        self.frames += len(episode)
        return {f"data/{key}": value for key, value in self._place().items()}

    def _place(self) -> dict[str, int]:
        return {"chunk_index": self.number // CHUNK, "file_index": self.number % CHUNK}


def _columns(episode: _Episode, fps: int) -> Iterator[tuple[str, Any]]:
    states, count = episode.states, len(episode)
    yield VALUES[0], states.astype(np.float32)
    yield VALUES[1], np.vstack([states[1:], states[-1:]]).astype(np.float32)
    yield "timestamp", (np.arange(count) / fps).astype(np.float32)
    steps, every = np.arange(count), np.ones(count, dtype=np.int64)
    yield from zip(COUNTERS, (steps, episode.number * every, episode.first + steps, episode.task * every), strict=True)
    if episode.stages is not None:
        yield SUBTASK, episode.stages


def _table(episode: _Episode, fps: int) -> pyarrow.Table:
    import pyarrow

    columns = {}
    for key, values in _columns(episode, fps):
        column = pyarrow.array(np.ravel(values))
        if values.ndim == 2 and values.shape[1] > 1:  # lerobot keeps a single value as such
            column = pyarrow.FixedSizeListArray.from_arrays(column, values.shape[1])
        columns[key] = column
    return pyarrow.table(columns)


def _statistics(episodes: Iterable[_Episode], fps: int) -> dict[str, dict[str, list[float]]]:
    """Return least and greatest values, means, deviations, counts and quantiles of every column."""
    parts: dict[str, list[Any]] = {}
    for episode in episodes:
        for key, values in _columns(episode, fps):
            parts.setdefault(key, []).append(values)
    found = {}
    for key, some in parts.items():
        values = np.concatenate(some).astype(np.float64)
        values = values if values.ndim == 2 else values[:, None]
        summary = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
        summary |= {name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()}
        found[key] = {**{name: each.tolist() for name, each in summary.items()}, "count": [len(values)]}
    return found


def _flat(statistics: dict[str, dict[str, list[float]]]) -> dict[str, list[float]]:
    return {f"stats/{key}/{name}": value for key, summary in statistics.items() for name, value in summary.items()}


def _write_meta(folder: Path, about: Any, statistics: Any, episodes: list[dict[str, Any]]) -> None:
    import pyarrow
    import pyarrow.parquet

    for name, content in ((INFO, about), (STATS, statistics)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(json.dumps(content, indent=4, ensure_ascii=False), encoding="utf-8")
    (folder / EPISODES).parent.mkdir(parents=True, exist_ok=True)
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(episodes), folder / EPISODES)


def _write_names(file: Path, column: str, names: dict[str, int]) -> None:
    """Write the numbers of names, which are the table's index as pandas reads it."""
    import pyarrow
    import pyarrow.parquet

    index = "__index_level_0__"  # pandas' name of a table's index that has none
    table = pyarrow.table({column: list(names.values()), index: list(names)})
    plain = {"field_name": index, "name": None, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    number = {"field_name": column, "name": column, "pandas_type": "int64", "numpy_type": "int64"}
    schema = {"index_columns": [index], "column_indexes": [], "columns": [{**number, "metadata": None}, plain]}
    table = table.replace_schema_metadata({"pandas": json.dumps({**schema, "pandas_version": "2.2.0"})})
    pyarrow.parquet.write_table(table, file)
