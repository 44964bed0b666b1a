"""A motion as its file says, by the judge's own reading: rows, and the polynomials that join them."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array


@dataclass(frozen=True, eq=False)
class Rows:
    """Content of a motion's file: rows of n joints, and their times and rates where it has them."""

    names: tuple[str, ...]
    positions: Array
    times: Array | None = None
    velocities: Array | None = None
    accelerations: Array | None = None

    def coefficients(self) -> Array:
        """Return (N − 1, 6, n): q(s) = Σ c_k s^k between two rows, s from 0 to 1."""
        p, q = self.positions[:-1], self.positions[1:]
        zero, change = np.zeros_like(p), q - p
        if self.velocities is None or self.times is None:
            return np.stack([p, change, zero, zero, zero, zero], axis=1)
        width = np.diff(self.times)[:, None]
        u, w = self.velocities[:-1] * width, self.velocities[1:] * width
        if self.accelerations is None:
            return np.stack([p, u, 3 * change - 2 * u - w, u + w - 2 * change, zero, zero], axis=1)
        a, b = self.accelerations[:-1] * width**2, self.accelerations[1:] * width**2
        third = 10 * change - 6 * u - 4 * w - 1.5 * a + 0.5 * b
        fourth = -15 * change + 8 * u + 7 * w + 1.5 * a - b
        fifth = 6 * change - 3 * u - 3 * w - 0.5 * a + 0.5 * b
        return np.stack([p, u, a / 2, third, fourth, fifth], axis=1)

    def at(self, interval: NDArray[np.int64], s: Array, order: int = 0) -> Array:
        """Return the joints' values (k, n) at parts s (k,) of intervals (k,), or their derivatives by time."""
        coefficients = self.coefficients()[interval]
        value = np.zeros((len(s), len(self.names)))
        for power in range(5, order - 1, -1):
            factor = float(np.prod(np.arange(power - order + 1, power + 1)))
            value = value * s[:, None] + factor * coefficients[:, power]
        width = np.ones(len(s)) if self.times is None else np.diff(self.times)[interval]
        return np.asarray(value / width[:, None] ** order)

    def when(self, interval: NDArray[np.int64], s: Array) -> Array:
        """Return the times (k,) [s]; of a path without times, 0."""
        if self.times is None:
            return np.zeros(len(s))
        return np.asarray(self.times[interval] + s * np.diff(self.times)[interval])

    def grid(self, most: int) -> tuple[NDArray[np.int64], Array]:
        """Return about `most` places, evenly over all intervals, their ends among them."""
        count = len(self.positions) - 1
        each = int(np.clip(most // count, 4, 64))
        parts = np.linspace(0.0, 1.0, each + 1)
        return np.repeat(np.arange(count), each + 1), np.tile(parts, count)


def write(path: Path, rows: Rows, locked: dict[str, float] | None = None) -> None:
    """Write them as the file's ending says."""
    rates = {"velocities": rows.velocities, "accelerations": rows.accelerations}
    if path.suffix == ".json":
        content: dict[str, Any] = {"hdplan_trajectory": 1, "joint_names": list(rows.names)}
        content |= {"positions": rows.positions.tolist(), "locked": locked or {}}
        content |= {} if rows.times is None else {"times": rows.times.tolist()}
        content |= {key: values.tolist() for key, values in rates.items() if values is not None}
        path.write_text(json.dumps(content))
    elif path.suffix == ".npz":
        arrays: dict[str, Any] = {"joint_names": np.array(rows.names), "positions": rows.positions}
        arrays |= {} if rows.times is None else {"times": rows.times}
        arrays |= {key: values for key, values in rates.items() if values is not None}
        np.savez(path, **arrays)
    else:
        columns = {name: rows.positions[:, i] for i, name in enumerate(rows.names)}
        for key, ending in (("velocities", ".velocity"), ("accelerations", ".acceleration")):
            values = rates[key]
            if values is not None:
                columns |= {name + ending: values[:, i] for i, name in enumerate(rows.names)}
        if rows.times is not None:
            columns = {"time": rows.times, **columns}
        with open(path, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))


def read(path: Path) -> Rows:
    """Read a motion's file."""
    if path.suffix == ".csv":
        head, *lines = csv.reader(path.read_text().splitlines())
        table = {name: np.array([float(line[i]) for line in lines]) for i, name in enumerate(head)}
        names = tuple(name for name in head if name != "time" and not name.endswith((".velocity", ".acceleration")))
        rates = [
            np.stack([table[name + ending] for name in names], axis=1) if names[0] + ending in table else None
            for ending in (".velocity", ".acceleration")
        ]
        return Rows(names, np.stack([table[name] for name in names], axis=1), table.get("time"), *rates)
    content: Any = json.loads(path.read_text()) if path.suffix == ".json" else dict(np.load(path))
    arrays = [content.get(key) for key in ("positions", "times", "velocities", "accelerations")]
    positions, *rest = (None if array is None else np.array(array, dtype=float) for array in arrays)
    assert positions is not None
    return Rows(tuple(str(name) for name in content["joint_names"]), positions, *rest)
