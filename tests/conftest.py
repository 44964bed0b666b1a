"""Fixtures and settings of all tests: the lanes of the suite, and what makes a test quick.

By default: every law, but of one marked `sampled(n)` each n-th of its parameters' product. `-m slow`: their rest,
and what takes long by itself. `-m core`: a law or two of every room, in less than a minute.
"""

from __future__ import annotations

import gc
import inspect
import os
import shutil
import signal
import sys
import threading
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from threadpoolctl import threadpool_limits

from hdplan.distance.studies import stopwatch
from hdplan.planner.terminal import console

if TYPE_CHECKING:
    from tests.commands import Command

LITTLE_XLA = (  # which compiles in a third of the time
    "--xla_backend_optimization_level=0",
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_cpu_parallel_codegen_split_count=1",
)
QUICK_CC = Path(__file__).with_name("quick_cc")  # which optimizes nothing


def core(config: pytest.Config) -> bool:
    return str(config.option.markexpr).startswith("core")


def pytest_configure(config: pytest.Config) -> None:
    """Have XLA and the C compiler optimize little: what the default suite and its child processes compile runs once or
    twice, and C to the same bits. The slow laws and the benchmarks run it as users do. Bytecode is kept, whatever the
    environment says: a hundred child processes import hdplan, and pytest rewrites the assertions of a file once."""
    if core(config):
        config.option.markexpr = "core and not slow"
    if config.option.markexpr.endswith("not slow"):
        os.environ.setdefault("XLA_FLAGS", " ".join(LITTLE_XLA))
        if shutil.which("cc"):
            os.environ.setdefault("CC", str(QUICK_CC))
        stopwatch.LEAST_TIME = 0.01  # the times of studies are not examined
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of child processes
    threadpool_limits(int(os.environ["OPENBLAS_NUM_THREADS"]), user_api="blas")  # threads wait where cores are few
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without collecting garbage: the tests' ten thousand objects hold none, and each pass visits all."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Read of the core only the files that have a part in it."""
    if not core(config) or collection_path.suffix != ".py":
        return None
    return "@pytest.mark.core\n" not in collection_path.read_text(encoding="utf-8") or None


@pytest.hookimpl(tryfirst=True)  # before those marked slow are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep each n-th of a law marked `sampled(n)`, always the same ones; the others are slow."""
    seen: Counter[str] = Counter()
    for item in items:
        mark = item.get_closest_marker("sampled")
        if mark and not item.get_closest_marker("slow"):
            law = item.nodeid.partition("[")[0]
            if seen[law] % mark.args[0]:
                item.add_marker(pytest.mark.slow)
            seen[law] += 1


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Say in words which law a test that failed holds, and of what."""
    report = yield
    if report.failed:
        test, _, values = item.name.partition("[")
        law = [test.removeprefix("test_").replace("_", " ").capitalize() + "."]
        law += [inspect.cleandoc(item.function.__doc__)] if item.function.__doc__ else []  # type: ignore[attr-defined]
        law += [f"Here: {values.removesuffix(']')}"] if values else []
        report.sections.insert(0, ("The law", "\n".join(law)))
    return report


@pytest.fixture
def ctrl_c_is_heard() -> Iterator[None]:
    """The test and its processes hear Ctrl-C: what a shell starts in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def no_step_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """Outputs of commands do not depend on the speed of the machine."""
    monkeypatch.setattr(console, "LONG_WAIT", threading.TIMEOUT_MAX)


@pytest.fixture(name="hdplan")
def _hdplan(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Run `hdplan` in this process, in a folder of its own."""
    from tests.commands import in_process  # which imports the command line: for the tests that use it

    monkeypatch.chdir(tmp_path)
    return in_process(monkeypatch, capsys)
