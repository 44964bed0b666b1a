"""Tables of poses: CSV files with the columns x, y, z [m], qx, qy, qz and qw in any order, and maybe time, which is not
used."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from hdplan.scenes.errors import FieldError, InputError, naming
from hdplan.scenes.files import read_file
from hdplan.scenes.number_text import read_number
from hdplan.scenes.poses import Pose

COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
UNUSED = "time"


def read_pose_table(path: str | Path) -> tuple[Pose, ...]:
    """Return the poses of a file, one a row. Raises InputError for missing, unknown and repeated columns, for rows of
    another length, for values that are not numbers or unit quaternions, and for less than two poses."""
    path = Path(path)
    with naming(path):
        reader = csv.reader(read_file(path).decode("utf-8-sig", "replace").splitlines())
        try:
            rows = [(reader.line_num, row) for row in reader if row]
        except csv.Error as error:  # a field longer than it takes
            raise InputError(f"line {reader.line_num}: not CSV ({error})") from None
        head = [name.strip() for name in rows[0][1]] if rows else []
        if sorted(name for name in head if name != UNUSED) != sorted(COLUMNS) or len({*head}) != len(head):
            found = ", ".join(head)[:80] or "nothing"
            raise InputError(f"must have the columns {', '.join(COLUMNS)} in its first line, found {found}")
        if len(rows) < 3:
            raise InputError(f"must have two poses or more below its first line, found {len(rows) - 1}")
        return tuple(_pose(row, head, number) for number, row in rows[1:])


def _pose(row: list[str], head: list[str], number: int) -> Pose:
    if len(row) != len(head):
        raise InputError(f"line {number}: has {len(row)} values, {len(head)} are expected")
    given = dict(zip(head, row, strict=True))
    values = []
    for name in COLUMNS:
        try:
            values.append(read_number(given[name].strip()))
        except ValueError:
            values.append(math.nan)
        if not math.isfinite(values[-1]):
            raise InputError(f"line {number}: {name}: must be a finite number, found {given[name][:40]!r}")
    try:
        return Pose(values[:3], values[3:])
    except FieldError as error:
        raise InputError(f"line {number}: {error}") from None
