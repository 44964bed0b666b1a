"""A scheduler and two workers as separate processes, as on a cluster, for all tests of one process."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hdplan.planner.batch.local_cluster import SETTINGS
from hdplan.planner.batch.worker_pool import worker_pool
from tests.waiting import until

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@contextlib.contextmanager
def dask(*arguments: str, **settings: str) -> Iterator[None]:
    """Run a command of dask's within the block."""
    within = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *filter(None, sys.path)]), **settings}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen([sys.executable, "-P", "-m", "dask", *arguments], env=within, **quiet) as process:
        try:
            yield
        finally:
            process.terminate()


def address_in(file: Path) -> str:
    """The address in a scheduler's file; empty until it is written whole."""
    try:
        return str(json.loads(file.read_text())["address"])
    except (OSError, ValueError):
        return ""


@pytest.fixture(scope="session")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Give the address of a scheduler with two workers, which can import `planted`."""
    file = tmp_path_factory.mktemp("dask") / "scheduler.json"
    settings = {f"DASK_{key.replace('.', '__').replace('-', '_').upper()}": str(x) for key, x in SETTINGS.items()}
    here = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with dask("scheduler", *here, "--scheduler-file", str(file), **settings):
        until(lambda: address_in(file), "the scheduler has an address")
        address = address_in(file)
        with dask("worker", address, "--nworkers", "2", "--nthreads", "1", "--no-dashboard", **settings):
            yield address


@pytest.fixture(scope="session")
def two_workers(cluster: str) -> Iterator[Any]:
    """Give a client of two workers, which can import `planted`."""
    sys.path.insert(0, str(HERE))
    try:
        with worker_pool(cluster) as client:
            client.wait_for_workers(2)
            yield client
    finally:
        sys.path.remove(str(HERE))
