"""A joint trajectory and its files: JSON, CSV and NPZ, read from any planner, written atomically with every bit kept.

What a file holds is a curve (`curve`): straight lines between rows of positions; where each row also has its time and
velocities, cubics; with accelerations too, quintics. That motion is what the certificate proves, so it is also what
must be executed. JSON names the rule (`interpolation`) and holds `times`, `velocities` and `accelerations` as NPZ does;
in CSV they are the columns `time`, `JOINT.velocity` and `JOINT.acceleration`.
"""

from __future__ import annotations

import csv
import io
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.motion.curve import FARTHEST, LONGEST, SHORTEST, Curve
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.files import MOST_BYTES, read_file
from hdplan.scenes.model import MOST_ROWS
from hdplan.scenes.output import write_output
from hdplan.scenes.values import Named, Number, Row, checked, path_of, shorten, text

KEYS = (  # of a JSON file
    "hdplan_trajectory",
    "joint_names",
    "interpolation",
    "positions",
    "locked",
    "times",
    "velocities",
    "accelerations",
    "verdict",
    "steps",
)
SAME = 1e-9  # by which a path parameter may lie beyond its range: rounding
FORMATS = (".json", ".csv", ".npz")
TIMES = "times"
TIME = "time"  # the CSV column of the times
RATES = ("velocities", "accelerations")  # what rows may hold beside times and positions
RATE_COLUMNS = (".velocity", ".acceleration")  # of each joint in CSV, behind its name


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Waypoints in joint space, and the curve through them.

    Raises InputError when the shapes do not fit, a joint name comes twice, a number is not finite, there are fewer than
    2 rows, the times do not rise, or there are velocities without times or accelerations without velocities.
    """

    joint_names: tuple[str, ...]  # (n,) the columns
    positions: NDArray[np.float64]  # (N, n) one row per waypoint [rad] or [m]
    locked: Mapping[str, float] = field(default_factory=dict)  # joints that stand still -> value [rad] or [m]
    times: NDArray[np.float64] | None = None  # (N,) when each waypoint is reached, rising [s]; None for a path alone
    velocities: NDArray[np.float64] | None = None  # (N, n) there [rad/s] or [m/s]
    accelerations: NDArray[np.float64] | None = None  # (N, n) there [rad/s²] or [m/s²]

    def __post_init__(self) -> None:
        """Check and freeze."""
        names = checked(Row(text, of="joint names"), self.joint_names, "joint_names")
        positions = _numbers(self.positions, "positions")
        if positions.ndim != 2 or positions.shape[1] != len(names):
            raise InputError(
                f"positions: shape {positions.shape}, expected one row of {len(names)} values per waypoint"
            )
        if len(positions) > MOST_ROWS:
            raise InputError(f"positions: {len(positions)} waypoints, a trajectory has at most {MOST_ROWS}")
        if len(positions) < 2:
            raise InputError(f"positions: {len(positions)} waypoint(s), a trajectory has at least 2")
        if not names:
            raise InputError("joint_names: empty, a trajectory moves at least one joint")
        if repeated := [name for i, name in enumerate(names) if name in names[:i]]:
            raise InputError(f"joint_names: '{repeated[0]}' comes twice")
        _check_finite(positions, "positions", names)
        locked = checked(Named(Number(unit="rad or m")), self.locked, "locked")
        positions.setflags(write=False)
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "locked", locked)
        if self.times is not None:
            object.__setattr__(self, "times", _rising(self.times, len(positions)))
        for key, needed in zip(RATES, (TIMES, RATES[0]), strict=True):
            if (values := getattr(self, key)) is None:
                continue
            if getattr(self, needed) is None:
                raise InputError(f"{key}: need {needed}, which are missing")
            values = _numbers(values, key)
            if values.shape != positions.shape:
                raise InputError(f"{key}: shape {values.shape}, expected {positions.shape} as the positions have")
            _check_finite(values, key, names)
            self._check_small(values, key)
            values.setflags(write=False)
            object.__setattr__(self, key, values)

    def _check_small(self, rates: NDArray[np.float64], key: str) -> None:
        """Refuse rates that lead farther than FARTHEST until the next row, or from the last one."""
        assert self.times is not None
        widths = np.diff(self.times)
        widest = np.maximum(np.r_[widths, 0.0], np.r_[0.0, widths])[:, None]  # on both sides of each row
        most = FARTHEST / widest ** (1 + RATES.index(key))
        if (np.abs(rates) > most).any():
            row, column = (int(i) for i in np.argwhere(np.abs(rates) > most)[0])
            raise InputError(
                f"{key}: waypoint {row}, joint '{self.joint_names[column]}': {rates[row, column]:g} leads too far in "
                f"{widest[row, 0]:g} s; at most {most[row, 0]:.3g} is allowed"
            )

    @cached_property
    def curve(self) -> Curve:
        """The motion through the waypoints, to the last interpolation rule."""
        return Curve.through(self.positions, self.times, self.velocities, self.accelerations)

    def of_joints(self, names: tuple[str, ...], locked: Mapping[str, float]) -> Trajectory:
        """Return the same motion with the columns of these joints alone, in that order; raises InputError for a joint
        that it does not have."""
        for name in names:
            if name not in self.joint_names:
                raise InputError(f"joint_names: unknown joint '{name}'{nearest(name, self.joint_names)}")
        chosen = [self.joint_names.index(name) for name in names]
        rates = (None if values is None else values[:, chosen] for values in (self.velocities, self.accelerations))
        return Trajectory(names, self.positions[:, chosen], locked, self.times, *rates)

    @property
    def duration(self) -> float | None:
        """How long the motion takes [s]; None for a path alone."""
        return None if self.times is None else float(self.times[-1] - self.times[0])

    @property
    def extent(self) -> str:
        """How long it is, in words."""
        return f"{len(self)} waypoints" if self.duration is None else f"{self.duration:.3f} s in {len(self)} rows"

    def __len__(self) -> int:
        """Return the number of waypoints."""
        return len(self.positions)

    def at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the configurations (…, n) at path parameters `time` in [0, 1]; the waypoints stand at equal steps.

        Raises InputError for other parameters.
        """
        parameters = _numbers(time, "time")
        within = np.clip(parameters, 0.0, 1.0)
        if not (np.abs(parameters - within) <= SAME).all():
            raise InputError("time: path parameters lie in [0, 1], from the first waypoint to the last")
        return self.curve.at_parameter(within)

    def save(
        self,
        path: str | Path,
        verdict: Mapping[str, Any] | None = None,
        steps: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Write to `path`; its ending (.json, .csv, .npz) picks the format. The file is there whole, or not at all.

        JSON holds everything, the `verdict` and the solver's `steps`; NPZ holds the arrays; CSV holds the times and the
        planned joints alone, a column for each of their positions, velocities and accelerations. Raises InputError for
        another ending or a path that cannot be written.
        """
        path = path_of(path)
        about = {key: said for key, said in (("verdict", verdict), ("steps", steps)) if said}
        write_output(path, {".json": _to_json, ".csv": _to_csv, ".npz": _to_npz}[_format(path)](self, about))

    @staticmethod
    def load(path: str | Path) -> Trajectory:
        """Read a trajectory file of any of the three formats; raises InputError naming the file and what is wrong."""
        path = path_of(path)
        reader = {".json": _from_json, ".csv": _from_csv, ".npz": _from_npz}[_format(path)]
        with naming(path):
            return reader(read_file(path))


def _to_json(trajectory: Trajectory, about: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Write one line per key and per waypoint; Python's numbers are the shortest that read back bit for bit."""
    timed = [] if trajectory.times is None else [f'"times": {json.dumps(trajectory.times.tolist(), allow_nan=False)}']
    lines = [
        '"hdplan_trajectory": 1',
        f'"joint_names": {json.dumps(trajectory.joint_names)}',
        *([f'"interpolation": "{trajectory.curve.rule}"'] if timed else []),
        _rows("positions", trajectory.positions),
        f'"locked": {json.dumps(dict(trajectory.locked), allow_nan=False)}',
        *timed,
        *(_rows(key, values) for key in RATES if (values := getattr(trajectory, key)) is not None),
        *(f'"{key}": {json.dumps(dict(said), allow_nan=False)}' for key, said in about.items()),
    ]
    return ("{\n " + ",\n ".join(lines) + "\n}\n").encode()


def _rows(key: str, values: NDArray[np.float64]) -> str:
    rows = ",\n  ".join(json.dumps(row, allow_nan=False) for row in values.tolist())
    return f'"{key}": [\n  {rows}\n ]'


def _from_json(data: bytes) -> Trajectory:
    try:
        content = json.loads(data, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON ({error})") from error
    if not isinstance(content, dict) or content.get("hdplan_trajectory") != 1:
        raise InputError(
            "not a trajectory: an object with `hdplan_trajectory: 1`, `joint_names` and `positions` is expected"
        )
    for key in content:
        if key not in KEYS:
            raise InputError(f"unknown key {shorten(repr(key))}{nearest(key, KEYS)}")
    for key in ("joint_names", "positions"):
        if not isinstance(content.get(key), list):
            raise InputError(f"{key}: missing, or not a list")
    locked = content.get("locked", {})
    if not isinstance(locked, dict):
        raise InputError("locked: an object of joint names and numbers is expected")
    positions = _numbers(content["positions"], "positions")
    rates = (content.get(key) for key in RATES)
    found = Trajectory(content["joint_names"], positions, locked, content.get("times"), *rates)
    if content.get("interpolation", found.curve.rule) != found.curve.rule:
        raise InputError(
            f"interpolation: '{content['interpolation']}', but with what its rows hold it is {found.curve.rule}"
        )
    return found


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object; a key that stands twice would silently mean its last value."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"the key {shorten(repr(key))} stands twice")
        found[key] = value
    return found


def _to_csv(trajectory: Trajectory, _: Mapping[str, Mapping[str, Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names, rows = trajectory.joint_names, trajectory.positions
    for key, ending in zip(RATES, RATE_COLUMNS, strict=True):
        if (values := getattr(trajectory, key)) is not None:
            names = (*names, *(name + ending for name in trajectory.joint_names))
            rows = np.column_stack([rows, values])
    if trajectory.times is not None:
        names, rows = (TIME, *names), np.column_stack([trajectory.times, rows])
    writer.writerow(names)
    writer.writerows([repr(value) for value in row] for row in rows.tolist())
    return text.getvalue().encode()


def _from_csv(data: bytes) -> Trajectory:
    try:
        reader = csv.reader(io.StringIO(data.decode("utf-8-sig")))
        rows = [(reader.line_num, row) for row in reader if row]
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"not CSV ({error})") from error
    if not rows:
        raise InputError("empty, a header with the joint names and one row per waypoint are expected")
    (line, header), *rows = rows
    names = tuple(name.strip() for name in header)
    if any(_is_number(name) for name in names):
        raise InputError(f"line {line}: {', '.join(names[:3])}, … are numbers; the header must hold the joint names")
    for line, row in rows:
        if len(row) != len(names):
            raise InputError(f"line {line}: {len(row)} values, expected {len(names)} as in the header")
        if wrong := [value for value in row if not _is_number(value)]:
            raise InputError(f"line {line}: '{wrong[0]}' is not a number")
    values = np.array([[float(value) for value in row] for _, row in rows]).reshape(-1, len(names))
    columns = dict(zip(names, values.T, strict=True))
    if len(columns) < len(names):
        raise InputError(f"line 1: '{next(name for i, name in enumerate(names) if name in names[:i])}' comes twice")
    times = columns.pop(TIME, None)
    joints = tuple(name for name in columns if not name.endswith(RATE_COLUMNS))
    rates = []
    for ending in RATE_COLUMNS:
        given = [name for name in columns if name.endswith(ending)]
        if given and (lacking := [name for name in joints if name + ending not in columns]):
            raise InputError(f"line 1: column '{lacking[0]}{ending}' is missing beside '{given[0]}'")
        if unknown := [name for name in given if name.removesuffix(ending) not in joints]:
            raise InputError(f"line 1: column '{unknown[0]}' is of no joint with positions")
        rates.append(np.column_stack([columns[name + ending] for name in joints]) if given else None)
    positions = np.column_stack([columns[name] for name in joints]) if joints else values[:, :0]
    return Trajectory(joints, positions, {}, times, *rates)


def _to_npz(trajectory: Trajectory, _: Mapping[str, Mapping[str, Any]]) -> bytes:
    data = io.BytesIO()
    timed = {key: values for key in (TIMES, *RATES) if (values := getattr(trajectory, key)) is not None}
    np.savez(
        data,
        joint_names=np.array(trajectory.joint_names),
        positions=trajectory.positions,
        locked_names=np.array(list(trajectory.locked), dtype=str),
        locked_values=np.array(list(trajectory.locked.values()), dtype=np.float64),
        **timed,
    )
    return data.getvalue()


def _from_npz(data: bytes) -> Trajectory:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            arrays = {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in archive.infolist()}
    except InputError:
        raise
    except Exception as error:  # zip, its compressions, NumPy's headers: each has failures of its own
        raise InputError("not an NPZ archive of plain arrays") from error
    for key in ("joint_names", "positions"):
        if key not in arrays:
            raise InputError(f"{key}: missing (the archive holds {', '.join(arrays) or 'nothing'})")
    names, values = arrays.get("locked_names", np.array([], dtype=str)), arrays.get("locked_values", np.array([]))
    locked = dict(zip(names.ravel().tolist(), _numbers(values, "locked_values").ravel().tolist(), strict=False))
    if len(locked) != values.size:
        raise InputError(f"locked_names: {names.size} names for {values.size} locked_values")
    positions = _numbers(arrays["positions"], "positions")
    timed = (arrays.get(key) for key in (TIMES, *RATES))
    return Trajectory(tuple(arrays["joint_names"].ravel().tolist()), positions, locked, *timed)


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one array of an archive, once it is known that it is as large as its header says, and not too large."""
    if entry.file_size > MOST_BYTES:
        size, most = (f"{count / 1e6:.0f} MB" for count in (entry.file_size, MOST_BYTES))
        raise InputError(f"{entry.filename}: {size} large when unpacked; at most {most} are read")
    with archive.open(entry) as file:
        data = io.BytesIO(file.read(MOST_BYTES + 1))
    header = (
        np.lib.format.read_array_header_1_0
        if np.lib.format.read_magic(data) == (1, 0)
        else (np.lib.format.read_array_header_2_0)
    )
    shape, _, dtype = header(data)
    if dtype.hasobject:
        raise ValueError("objects")
    if math.prod(shape) * dtype.itemsize != len(data.getbuffer()) - data.tell():
        raise InputError(f"{entry.filename}: does not hold the array that its header says")
    data.seek(0)
    return np.asarray(np.lib.format.read_array(data, allow_pickle=False))


def _format(path: Path) -> str:
    """Return the ending that picks a file's format."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: ending '{path.suffix}', a trajectory file ends with one of {', '.join(FORMATS)}")
    return suffix


def _numbers(values: object, name: str) -> NDArray[np.float64]:
    try:
        numbers = np.array(values)
        if numbers.dtype.kind in "iuf" or not numbers.size:
            return numbers.astype(np.float64)
    except (TypeError, ValueError):  # rows of different lengths
        pass
    raise InputError(f"{name}: numbers are expected, equally many in each row")


def _check_finite(values: NDArray[np.float64], key: str, names: tuple[str, ...]) -> None:
    if not np.isfinite(values).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise InputError(
            f"{key}: waypoint {row}, joint '{names[column]}': {values[row, column]} is not a finite number"
        )


def _rising(values: object, count: int) -> NDArray[np.float64]:
    """Return the times (count,) frozen, if they are that many and rise."""
    times = _numbers(values, "times")
    if times.shape != (count,):
        raise InputError(f"times: shape {times.shape}, expected one for each of the {count} waypoints")
    if not np.isfinite(times).all():
        raise InputError(f"times: {times[~np.isfinite(times)][0]} is not a finite number")
    if not np.abs(times).max() <= LONGEST:
        raise InputError(
            f"times: {times[np.abs(times).argmax()]:g} s is too far from 0; at most {LONGEST:g} s are allowed"
        )
    if (np.diff(times) <= 0.0).any():
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise InputError(f"times: {times[row]:g} s at waypoint {row} comes after {times[row - 1]:g} s, times must rise")
    if not np.diff(times).min() >= SHORTEST:
        row = int(np.diff(times).argmin())
        raise InputError(
            f"times: {np.diff(times)[row]:g} s between waypoints {row} and {row + 1} is too short; "
            f"at least {SHORTEST:g} s are needed"
        )
    times.setflags(write=False)
    return times


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text  # Python's own numbers are more than CSV's
