"""Waits for what another thread or process does: for a condition, never for a time."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE = 180.0  # [s] for what comes in moments where the processor has nothing else to do


def until(true: Callable[[], object], what: str, patience: float = PATIENCE) -> None:
    """Return once a condition holds; fail with these words if it never does."""
    deadline = time.monotonic() + patience
    while not true():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)
