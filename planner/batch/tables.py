"""The results of a run as tables: Parquet, read by pandas, polars, DuckDB and the like."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.batch.outcome import Outcome
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import check_file

if TYPE_CHECKING:
    import pyarrow

RESULTS, MOTIONS = "results.parquet", "motions.parquet"
AT_ONCE = 100  # outcomes of a row group

COLUMNS = {  # of results, and what they hold
    **dict.fromkeys(("problem", "group", "status", "cause", "text", "advice", "proof", "robot"), "string"),
    **dict.fromkeys(("worst_link", "worst_other", "self_worst_link", "self_worst_other"), "string"),
    **dict.fromkeys(("clearance", "self_clearance", "worst_parameter", "motion_time", "length"), "double"),
    **dict.fromkeys(("seed", "attempts", "iterations"), "int64"),
    "timed_out": "bool",
    **dict.fromkeys(("time_load", "time_build", "time_compile", "time_solve", "time_certify"), "double"),
    **dict.fromkeys(("sha256", "versions"), "string"),
}
OF_MOTIONS = {
    **{"problem": "string", "row": "int32", "joint": "string", "time": "double", "position": "double"},
    **{"velocity": "double", "acceleration": "double", "stage": "string"},
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
                results.write_table(pyarrow.Table.from_pylist([row_of(each) for each in some], results.schema))
                if found := [_motion(each, motions.schema) for each in some if each.trajectory is not None]:
                    motions.write_table(pyarrow.concat_tables(found))
        for file, whole in zip(half, files, strict=True):
            os.replace(file, whole)
    except OSError as error:
        words = error.strerror or str(error).rpartition("] ")[2]  # Arrow's own, after its details
        raise InputError(f"{folder}: cannot be written ({words})") from None
    finally:
        for file in half:
            file.unlink(missing_ok=True)


def read_rows(file: Path) -> list[dict[str, Any]]:
    """Return the rows of a Parquet file. Raises InputError if it cannot be read."""
    import pyarrow
    import pyarrow.parquet

    with naming(file):
        check_file(file)
        try:
            rows: list[dict[str, Any]] = pyarrow.parquet.read_table(file).to_pylist()
        except (OSError, pyarrow.ArrowException) as error:
            raise InputError(f"is not a Parquet table ({str(error).splitlines()[0]})") from None
    return rows


def table_bytes(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return rows as a Parquet file, with a column for every key."""
    import pyarrow
    import pyarrow.parquet

    columns = dict.fromkeys(name for row in rows for name in row)
    table = pyarrow.table({name: [row.get(name) for row in rows] for name in columns})
    sink = io.BytesIO()
    pyarrow.parquet.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def _pieces(outcomes: Iterable[tuple[int, Outcome]]) -> Iterator[list[Outcome]]:
    left = iter(outcomes)
    while some := [each for _, each in islice(left, AT_ONCE)]:
        yield some


def row_of(outcome: Outcome) -> dict[str, Any]:
    """Return the row of results of a problem (COLUMNS)."""
    own = {"problem": outcome.problem, "status": outcome.status, "cause": outcome.cause, "text": outcome.text}
    held = {**outcome.figures, **own}
    return {name: held.get(name) for name in COLUMNS}


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
        "stage": np.repeat(np.array(motion.stage_names, dtype=object), n),
    }
    arrays = [pyarrow.array(x, kind, from_pandas=True) for x, kind in zip(columns.values(), schema.types, strict=True)]
    return pyarrow.Table.from_arrays(arrays, schema=schema)
