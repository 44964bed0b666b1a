"""Two workers for all tests of one process."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hdplan.planner.batch.crew import crew


@pytest.fixture(scope="session")
def two_workers() -> Iterator[Any]:
    """Give a client of two workers, which can import `planted`."""
    sys.path.insert(0, str(Path(__file__).parent))
    try:
        with crew(2) as client:
            yield client
    finally:
        sys.path.remove(str(Path(__file__).parent))
