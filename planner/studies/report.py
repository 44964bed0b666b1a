"""Reports: rows as CSV and Markdown and a picture as PNG in one folder, every file whole or not at all.

In: rows, one mapping per line, all with the same keys; the keys include units. Out: files.
"""

from __future__ import annotations

import csv
import importlib.util
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdplan.scenes.errors import InputError
from hdplan.scenes.output import check_writable, write_output

Cell = str | int | float | None  # None: not measured
Rows = Sequence[Mapping[str, Cell]]
Reporter = Callable[[int, int, str], None]  # is called with (steps done, all of them, what comes next)
Stopper = Callable[[], bool]  # says whether to stop with the results so far


@dataclass(frozen=True)
class Report:
    """The results, to be read."""

    tables: Mapping[str, Rows]  # by title
    notes: Sequence[tuple[str, str]]  # topic and text
    files: Sequence[Path]  # written
    complete: bool  # False after an interruption: tables and files hold what there was


ENDINGS = (".csv", ".md", ".png")


def check_report(folder: Path, names: Sequence[str]) -> list[Path]:
    """Return the paths of the files ``names`` in ``folder``, which is made if it is not there.

    It fails early rather than after the measurement. Raises InputError for a folder that cannot be made, files that
    cannot be written, and a missing matplotlib.
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be made ({error.strerror or error})") from error
    paths = [folder / name for name in names]
    for path in paths:
        check_writable(path, ENDINGS)
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError(f"{folder}: pictures need matplotlib, which is not installed: pip install matplotlib")
    return paths


def write_report(paths: Sequence[Path], contents: Sequence[str | bytes]) -> None:
    """Write one content to each path. Raises InputError saying why not."""
    for path, content in zip(paths, contents, strict=True):
        write_output(path, content.encode() if isinstance(content, str) else content)


def csv_text(rows: Rows) -> str:
    """Return the rows as CSV under their keys; numbers with six digits, None as an empty cell."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(rows[0])
    table.writerows([_plain(cell) for cell in row.values()] for row in rows)
    return text.getvalue()


def markdown_text(rows: Sequence[Mapping[str, object]]) -> str:
    """Return the rows as a Markdown table under their keys; numbers with three digits, None as a dash."""
    lines = [list(rows[0]), ["---"] * len(rows[0]), *([short(cell) for cell in row.values()] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def short(cell: object) -> str:
    """Return a cell for reading: numbers with three digits, never in powers of ten that a reader has to unfold."""
    if cell is None:
        return "-"
    if not isinstance(cell, float):
        return str(cell)
    digits = f"{cell:.3g}"
    return f"{float(digits):g}" if abs(cell) < 1e-4 else f"{float(digits):,.12g}".replace(",", " ")


def length_text(metres: float, _: object = None) -> str:
    """Return a length in words, also for the ticks of an axis."""
    return f"{metres * 1e3:g} mm" if metres < 0.01 else f"{metres * 1e2:g} cm"


def png(figure: Any) -> bytes:
    """Return a matplotlib figure as PNG."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


def _plain(cell: Cell) -> str:
    return "" if cell is None else f"{cell:.6g}" if isinstance(cell, float) else str(cell)
