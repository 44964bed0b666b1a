"""What all tests need."""

from __future__ import annotations

import threading

import pytest

from hdplan.planner.terminal import console


@pytest.fixture(autouse=True)
def no_step_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """However slow the machine is: what commands print must not hang on it."""
    monkeypatch.setattr(console, "LONG", threading.TIMEOUT_MAX)
