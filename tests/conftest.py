"""What all tests need."""

from __future__ import annotations

import os
import threading

import pytest

from hdplan.planner.terminal import console


def pytest_configure(config: pytest.Config) -> None:
    """Have XLA compile without optimizing: what the default suite compiles runs once or twice. The slow laws and the
    benchmarks run it as users do."""
    if config.option.markexpr == "not slow":
        os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")


@pytest.fixture(autouse=True)
def no_step_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """However slow the machine is: what commands print must not hang on it."""
    monkeypatch.setattr(console, "LONG_WAIT", threading.TIMEOUT_MAX)
