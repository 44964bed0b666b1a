"""Random motions: paths and curves in time, at rest and abrupt, slow and fast, right at the limits."""

from __future__ import annotations

import numpy as np

from sieges.machine import Machine
from sieges.rows import Rows


def random_rows(rng: np.random.Generator, machine: Machine, names: tuple[str, ...], timed: bool) -> Rows:
    """Return a motion of these joints, mostly within their limits."""
    count = int(rng.integers(2, 9))
    low, high = machine.reach(names, 3.0)
    if timed or rng.random() < 0.5:  # curves swing out between their rows
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        low, high = middle - 0.75 * half, middle + 0.75 * half
    span = rng.choice([0.02, 0.2, 0.6, 1.5], p=[0.2, 0.3, 0.3, 0.2]) * (high - low) / 4.0
    start = rng.uniform(low, high)
    q = np.clip(start + np.cumsum(rng.normal(size=(count, len(names))) * span, axis=0), low, high)
    if rng.random() < 0.1:
        step = rng.choice([1e-12, 1e-6, 9e-4, 1e-2]) * rng.choice([-1, 1])
        q[int(rng.integers(count)), int(rng.integers(len(names)))] += step
    if rng.random() < 0.05:
        q[:] = q[0]
    if not timed and rng.random() < 0.6:
        return Rows(names, q)
    scale = rng.choice([1.0, 1e-3, 1e3, 1e-6, 1e6], p=[0.8, 0.05, 0.05, 0.05, 0.05])
    width = scale * rng.uniform(0.05, 1.0, count - 1)
    begin = rng.choice([0.0, 0.0, 0.0, 0.5, 100.0])
    times = begin + np.concatenate([[0.0], np.cumsum(width)])
    rule = int(rng.integers(0, 4))
    if rule == 0:
        return Rows(names, q, times)
    v = np.gradient(q, times, axis=0) * rng.choice([0.0, 1.0, 1.0, 3.0])
    a = np.gradient(v, times, axis=0) * rng.choice([0.0, 0.0, 1.0, -1.0])
    if rng.random() < 0.8:
        v[[0, -1]], a[[0, -1]] = 0.0, 0.0
    return Rows(names, q, times, v, None if rule == 1 else a)


def varied(rng: np.random.Generator, base: Rows) -> Rows:
    """Return a motion smaller or larger, slower or faster than another, often by very little."""
    size = float(rng.choice([0.3, 0.9, 0.9999, 1.0, 1.0 + 1e-6, 1.001]))
    slower = float(rng.choice([0.99, 1.0 - 1e-6, 1.0, 1.0001, 1.5, 3.0]))
    middle = base.positions.mean(axis=0)
    times = None if base.times is None else base.times[0] + slower * (base.times - base.times[0])
    rates = [
        None if rate is None else rate * (size / slower**order)
        for order, rate in enumerate((base.velocities, base.accelerations), start=1)
    ]
    return Rows(base.names, middle + size * (base.positions - middle), times, *rates)
