"""Cells of the benchmarks' tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdplan.scenes.array_types import Array


def quantiles(values: Sequence[float] | Array, shares: Sequence[float] = (0.5, 0.95), digits: int = 0) -> str:
    """Quantiles of some values; nothing for none."""
    return " / ".join(f"{x:.{digits}f}" for x in np.quantile(values, shares)) if len(values) else ""


def milliseconds(seconds: Sequence[float] | Array, shares: Sequence[float] = (0.5, 0.95), digits: int = 0) -> str:
    """Quantiles of times [s] in ms; nothing for none."""
    return quantiles(1e3 * np.asarray(seconds), shares, digits)
