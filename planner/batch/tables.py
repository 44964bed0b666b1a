"""The results of a run as tables: Parquet, read by pandas, polars, DuckDB and the like."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.batch.outcome import Outcome
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    import pyarrow

RESULTS, MOTIONS = "results.parquet", "motions.parquet"
AT_ONCE = 1000  # outcomes of a row group

COLUMNS = {  # of results, and what they hold
    **dict.fromkeys(("problem", "group", "status", "cause", "text", "robot", "worst_link", "worst_other"), "string"),
    **dict.fromkeys(("clearance", "self_clearance", "worst_parameter", "motion_time", "length"), "double"),
    **dict.fromkeys(("seed", "attempts", "iterations"), "int64"),
    **dict.fromkeys(("time_load", "time_build", "time_compile", "time_solve", "time_certify"), "double"),
    **dict.fromkeys(("sha256", "versions"), "string"),
}
OF_MOTIONS = {
    **{"problem": "string", "row": "int32", "joint": "string", "time": "double", "position": "double"},
    **{"velocity": "double", "acceleration": "double"},
}


def write_tables(folder: Path, outcomes: Iterable[tuple[int, Outcome]]) -> None:
    """Write both tables from outcomes in the order of their problems, each file whole or not at all. Raises
    InputError."""
    import pyarrow
    import pyarrow.parquet

    kinds = (pyarrow.schema([(name, kind) for name, kind in each.items()]) for each in (COLUMNS, OF_MOTIONS))
    files = [folder / name for name in (RESULTS, MOTIONS)]
    half = [file.with_name(f".{file.name}.{os.getpid()}.tmp") for file in files]
    try:
        results, motions = (
            pyarrow.parquet.ParquetWriter(file, kind, compression="zstd")
            for file, kind in zip(half, kinds, strict=True)
        )
        with results, motions:
            for some in _pieces(outcomes):
                results.write_table(pyarrow.Table.from_pylist([_row(each) for each in some], results.schema))
                for each in some:
                    if each.trajectory is not None:
                        motions.write_table(_motion(each, motions.schema))
        for file, whole in zip(half, files, strict=True):
            os.replace(file, whole)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error})") from None
    finally:
        for file in half:
            file.unlink(missing_ok=True)


def read_results(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a run's results. Raises InputError if there are none."""
    import pyarrow
    import pyarrow.parquet

    file = folder / RESULTS
    try:
        rows: list[dict[str, Any]] = pyarrow.parquet.read_table(file).to_pylist()
    except FileNotFoundError:
        raise InputError(f"{folder}: is no folder of a run ({RESULTS} is missing)") from None
    except (OSError, pyarrow.ArrowException) as error:
        raise InputError(f"{file}: cannot be read ({str(error).splitlines()[0]})") from None
    return rows


def _pieces(outcomes: Iterable[tuple[int, Outcome]]) -> Iterator[list[Outcome]]:
    some: list[Outcome] = []
    for _, each in outcomes:
        some.append(each)
        if len(some) == AT_ONCE:
            yield some
            some = []
    yield some


def _row(outcome: Outcome) -> dict[str, Any]:
    own = {"problem": outcome.problem, "status": outcome.status, "cause": outcome.cause, "text": outcome.text}
    return {name: {**outcome.figures, **own}.get(name) for name in COLUMNS}


def _motion(outcome: Outcome, schema: pyarrow.Schema) -> pyarrow.Table:
    """Return a motion by joint and row."""
    import pyarrow

    motion = outcome.trajectory
    assert motion is not None
    rows, n = motion.positions.shape
    lacking = np.full(rows * n, np.nan)
    columns = {
        "problem": [outcome.problem] * (rows * n),
        "row": np.repeat(np.arange(rows, dtype=np.int32), n),
        "joint": list(motion.joint_names) * rows,
        "time": lacking if motion.times is None else np.repeat(motion.times, n),
        "position": motion.positions.ravel(),
        "velocity": lacking if motion.velocities is None else motion.velocities.ravel(),
        "acceleration": lacking if motion.accelerations is None else motion.accelerations.ravel(),
    }
    arrays = [pyarrow.array(x, kind, from_pandas=True) for x, kind in zip(columns.values(), schema.types, strict=True)]
    return pyarrow.Table.from_arrays(arrays, schema=schema)
