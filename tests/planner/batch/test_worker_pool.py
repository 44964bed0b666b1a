"""Many problems are each of them alone: the same motions, and one that ends its process costs only itself."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import logging
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import hdplan
from hdplan.distance.compiled.cache import write_whole
from hdplan.planner.batch import many, outcome as outcome_module, worker_pool as crew_module
from hdplan.planner.batch.cluster_file import ClusterFile
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.outcome import Options, Outcome, solve
from hdplan.planner.batch.worker_pool import outcomes, worker_pool
from hdplan.scenes.errors import InputError
from hdplan.scenes.progress import listening
from tests.waiting import until

ARM = hdplan.load_scene("planar_arm")


def arms(count: int) -> list[Job]:
    """The planar arm with other goals; some of them are in collision."""
    drawn = np.random.default_rng(3).uniform(-2.0, 2.0, (count, 2))
    scenes = [dataclasses.replace(ARM, goal=q.tolist()) for q in drawn]
    return [Job(f"arm {i}", "", scene, seed=i) for i, scene in enumerate(scenes)]


def same(one: Outcome, other: Outcome) -> bool:
    """True if two outcomes are the same, times aside."""

    def plain(outcome: Outcome) -> tuple[Any, ...]:
        figures = {key: value for key, value in outcome.figures.items() if not key.startswith("time_")}
        motion = outcome.trajectory
        rows = b"" if motion is None else motion.positions.tobytes()
        return outcome.problem, outcome.status, outcome.cause, outcome.text, figures, rows

    return plain(one) == plain(other)


def test_workers_find_what_a_loop_finds(two_workers: Any) -> None:
    jobs, options = arms(8), Options(time_limit=60.0)
    found = dict(outcomes(two_workers, enumerate(jobs), options))
    assert sorted(found) == list(range(8))
    alone = [solve(job, options) for job in jobs]
    assert all(same(found[i], outcome) for i, outcome in enumerate(alone))
    assert {outcome.status for outcome in alone} >= {"certified", "refused"}
    assert all((outcome.cause == "") == outcome.certified for outcome in alone)


def test_a_failing_problem_costs_only_itself(two_workers: Any) -> None:
    from planted import Broken, Crashing

    planted = {1: Crashing("crash", "g", ARM), 5: Broken("broken", "g", ARM), 7: Job("gone", "g", Path("no/such.yaml"))}
    jobs = [planted.get(i, job) for i, job in enumerate(arms(8))]
    found = dict(outcomes(two_workers, enumerate(jobs), Options()))
    assert [found[i].status for i in planted] == ["failed", "error", "refused"]
    assert [found[i].cause for i in planted] == ["ended", "internal", "bad_input"]
    assert found[5].text == "internal error, please report it: ValueError: planted error"
    assert "no/such.yaml: no such file" in found[7].text
    assert all(found[i].problem == job.name and "\n" not in found[i].text for i, job in enumerate(jobs))
    assert all(same(found[i], solve(jobs[i], Options())) for i in range(8) if i not in planted)


def test_dask_says_nothing_of_its_own(two_workers: Any) -> None:
    """Also its loggers with levels of their own, such as the one that tells of a scheduler that went away."""
    loggers = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    assert "distributed.client" in loggers
    assert {logging.getLogger(name).getEffectiveLevel() for name in loggers} == {logging.CRITICAL}


def test_plan_many_tells_how_far_it_has_come(two_workers: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(many, "worker_pool", lambda *_: contextlib.nullcontext(two_workers))
    notes: list[str] = []
    with listening(notes.append):
        found = list(hdplan.plan_many(arms(4), workers=2))
    good = sum(outcome.certified for outcome in found)
    assert notes[0] == "starting the workers"
    assert notes[-1] == f"planned 4 of 4 problems: {good} certified, {4 - good} not"
    assert len(notes) == 5
    notes.clear()
    with listening(notes.append):
        list(hdplan.plan_many(iter(arms(1)), workers=1))
    assert notes[-1].startswith("planned 1 problems: ")


def test_workers_keep_no_samples_of_themselves(two_workers: Any) -> None:
    """Dask's profiler takes by default a quarter of a megabyte each second, for hours."""
    import dask

    assert set(two_workers.run(dask.config.get, "distributed.worker.profile.enabled").values()) == {False}


@pytest.mark.slow  # two workers start again
def test_a_hanging_problem_is_ended_from_outside(two_workers: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from planted import PATIENCE, Hanging

    monkeypatch.setattr(outcome_module, "PATIENCE", PATIENCE)
    jobs = [Hanging("hang", "g", ARM), *arms(2)]
    found = dict(outcomes(two_workers, enumerate(jobs), Options(time_limit=0.5)))
    assert (found[0].problem, found[0].status, found[0].cause) == ("hang", "failed", "hung")
    assert "failed" not in {found[1].status, found[2].status}


def test_problems_are_taken_as_workers_get_free(two_workers: Any) -> None:
    taken = itertools.count()
    endless = ((next(taken), job) for job in itertools.cycle(arms(1)))
    found = outcomes(two_workers, endless, Options())
    for _ in range(3):
        assert next(found)[1].problem == "arm 0"
    found.close()
    assert next(taken) <= 3 + 2 * crew_module.QUEUED_PROBLEMS + 1


def children(process: int) -> set[int]:
    """The clusters, or workers, that a process has begun."""
    return {child.pid for child in psutil.Process(process).children() if child.status() != psutil.STATUS_ZOMBIE}


def end(processes: set[int]) -> None:
    """Wait until processes have ended."""
    until(lambda: not any(map(alive, processes)), "they go on")


def alive(process: int) -> bool:
    try:
        return bool(psutil.Process(process).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def test_plan_many_keeps_the_order_and_leaves_nothing_behind() -> None:
    before = children(os.getpid())  # such as the cluster of other tests
    names = ["planar_arm", "no/such.yaml", ARM]
    found = hdplan.plan_many(itertools.cycle(names), workers=1, time_limit=30)
    assert children(os.getpid()) == before, "a worker started before the first task"
    first = [next(found) for _ in range(3)]
    assert [outcome.problem for outcome in first] == ["planar_arm/0", "such/1", "planar_arm/2"]
    assert [outcome.status for outcome in first] == ["certified", "refused", "certified"]
    assert isinstance(first[0].trajectory, hdplan.Trajectory)
    (cluster,) = children(os.getpid()) - before
    workers = children(cluster)
    assert workers
    found.close()
    assert children(os.getpid()) == before
    end({cluster, *workers})


def test_bad_arguments_are_refused_before_anything_starts() -> None:
    for address in ("nonsense", "zz://a:1", "tcp://127.0.0.1:x", "tls://127.0.0.1:1"):
        threads = threading.active_count()
        with pytest.raises(InputError, match=f"scheduler {address}: does not answer"):
            next(hdplan.plan_many([ARM], scheduler=address))
        assert threading.active_count() <= threads, "a client is left, which would complain at the end"


def test_without_dask_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("distributed", "pyarrow"):
        monkeypatch.setattr("importlib.util.find_spec", lambda wanted, name=name: None if wanted == name else wanted)
        with pytest.raises(InputError, match=f"need {name}, which is not installed: pip install distributed pyarrow"):
            hdplan.plan_many([ARM])


SCRIPT = """
import sys, hdplan
for outcome in hdplan.plan_many(["planar_arm"] * 1000, workers=1):
    print(outcome.status, flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow
@pytest.mark.parametrize("killed", [False, True])
def test_no_process_outlives_a_program_that_ends(killed: bool, tmp_path: Path) -> None:
    """A program without `if __name__ == "__main__"`, given on the command line: workers import nothing of it."""
    command, pipes = [sys.executable, "-c", SCRIPT], {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, cwd=tmp_path, text=True, **pipes) as program:
        assert program.stdout.readline() == "certified\n"
        (cluster,) = children(program.pid)
        workers = children(cluster)
        program.kill() if killed else program.terminate()
    end({cluster, *workers})


@pytest.mark.slow
def test_the_same_with_one_two_and_four_workers() -> None:
    jobs = arms(40)
    runs = []
    for workers in (1, 2, 4):
        with worker_pool(workers) as client:
            runs.append(dict(outcomes(client, enumerate(jobs), Options())))
    assert all(same(run[i], runs[0][i]) for run in runs for i in range(40))


# --- clusters ---------------------------------------------------------------------------------------------------

BAD_FILES = {
    "": ["cluster.yaml"],
    "workers: 2": ["'class' is missing"],
    "class: distributed.LocalCluster": ["'workers' is missing"],
    "{class: distributed.LocalCluster, workers: 0}": ["workers", "1 to 100000"],
    "{class: distributed.LocalCluster, workers: 1, option: {}}": ["'option'", "'options'"],
    "{class: distributed.LocalCluster, workers: 1, options: [1]}": ["options", "mapping"],
    "{class: dask_nowhere.SLURMCluster, workers: 1}": ["class: cannot be imported", "dask_nowhere"],
    "{class: distributed.NoCluster, workers: 1}": ["class: cannot be imported", "NoCluster"],
    "{class: SLURMCluster, workers: 1}": ["class: cannot be imported"],
    "{class: os.path, workers: 1}": ["class", "is not one of dask's cluster classes"],
    "{class: distributed.SpecCluster, workers: 1, options: {cors: 3}}": ["does not start", "cors"],
}


@pytest.mark.parametrize("text", BAD_FILES)
def test_a_bad_cluster_file_is_one_line(text: str, tmp_path: Path) -> None:
    file = tmp_path / "cluster.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as caught, ClusterFile.read(file).started():
        pass
    assert all(word in str(caught.value) for word in ("cluster.yaml", *BAD_FILES[text])), str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_cluster_is_started_and_ended(tmp_path: Path) -> None:
    file = tmp_path / "cluster.yaml"
    options = "{threads_per_worker: 1, dashboard_address: null}"
    file.write_text(f"{{class: distributed.LocalCluster, workers: 2, options: {options}}}")
    command = [sys.executable, "-m", "hdplan.cli", "batch", "planar_arm", "-o", str(tmp_path / "r")]
    done = subprocess.run([*command, "--cluster", str(file)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("1 of 1 problems certified")


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_one_line(tmp_path: Path) -> None:
    with contextlib.ExitStack() as stack:
        command = [sys.executable, "-P", str(Path(crew_module.__file__).with_name("local_cluster.py")), "1"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        server = stack.enter_context(subprocess.Popen(command, text=True, **pipes))
        client = stack.enter_context(worker_pool(server.stdout.readline().strip()))
        found = outcomes(client, enumerate(itertools.cycle(arms(1))), Options())
        next(found)
        server.kill()
        with pytest.raises(InputError, match="the scheduler disappeared; the results so far are kept"):
            list(found)


def test_data_travel_to_workers_and_code_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hdplan.planner.batch.caches import packed

    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "driver"))
    for name in ("compiled/f-0.so", "link_bodies/k.json", "robots/k.json"):
        assert write_whole(tmp_path / "driver" / name, b"{}")
    assert packed() == {"link_bodies/k.json": b"{}", "robots/k.json": b"{}"}
