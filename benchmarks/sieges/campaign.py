"""A campaign: many seeded cases in workers of their own, with limits of time and memory for each.

A worker is a child process that takes numbers of cases from its input and answers each with one line. A worker that
dies, hangs or grows too large is ended, the case that it was at is a finding, and another takes its place.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import selectors
import shutil
import subprocess
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from memory import most_memory

Attack = Callable[[np.random.Generator, Path], "Outcome"]  # a case: its random numbers, and an empty folder for it

SCRIPT = Path(__file__).parents[1] / "siege.py"
MEMORY = 6 << 30  # [bytes] of data that a worker may allocate
GROWN = 3 << 30  # [bytes] in memory at which a worker is ended, and what it was at is a finding
PATIENCE = 6.0  # times its limit that a case may take by the clock, as other processes run beside it
SIGNS = {"tracebacks": "traceback", "signals": "signal ", "over": "limit of "}  # of findings, by their words
SILENCE = 300.0  # [s] that a worker may take to get ready


@dataclass(frozen=True)
class Outcome:
    """Outcome of one case."""

    kind: str  # a row of the table: "certified", "refused", ..
    finding: str = ""  # what is wrong, in words; empty: nothing
    count: int = 1  # how much was tried: motions, poses, steps
    notes: dict[str, Any] = field(default_factory=dict)  # the judge's figures; numbers are summed up in the table
    kinds: dict[str, int] = field(default_factory=dict)  # how often each row of the table, where a case is of several


@dataclass
class Tally:
    """Outcomes of all cases."""

    cases: int = 0
    tried: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    sums: Counter[str] = field(default_factory=Counter)
    findings: list[tuple[int, str]] = field(default_factory=list)
    remarks: list[tuple[int, str]] = field(default_factory=list)  # no faults, but worth a look
    slowest: list[tuple[float, int]] = field(default_factory=list)
    seconds: float = 0.0

    def take(self, index: int, answer: dict[str, Any]) -> None:
        """Count one case."""
        self.cases += 1
        self.tried += answer["count"]
        self.kinds.update(answer.get("kinds") or {answer["kind"]: answer["count"]})
        self.sums.update({name: value for name, value in answer["notes"].items() if isinstance(value, int | float)})
        self.slowest = sorted([*self.slowest, (answer["seconds"], index)], reverse=True)[:5]
        self.remarks += [(index, name) for name, value in answer["notes"].items() if value and "judge" in name]
        if answer["finding"]:
            self.findings.append((index, answer["finding"]))

    def faults(self) -> dict[str, int]:
        """Return the number of findings of each kind."""
        kinds = [next((kind for kind, sign in SIGNS.items() if sign in words), "wrong") for _, words in self.findings]
        return {kind: kinds.count(kind) for kind in ("wrong", *SIGNS)}

    def words(self, name: str) -> str:
        """Return the campaign's results for a person."""
        rows: list[tuple[str, object]] = [("cases", self.cases), ("tried", self.tried), *sorted(self.kinds.items())]
        rows += [(f"sum of {name}", round(value, 6)) for name, value in sorted(self.sums.items())]
        rows += [("findings", len(self.findings)), ("seconds", round(self.seconds, 1))]
        rows += [("worst times [s]", ", ".join(f"{seconds:.2f} (case {index})" for seconds, index in self.slowest))]
        lines = [f"{name}: {key} {value}" for key, value in rows]
        return "\n".join([*lines, *(f"* case {index}: {words}" for index, words in self.findings + self.remarks)])


def run(
    name: str,
    count: int,
    seed: int,
    output: Path,
    limit: float,
    *,
    seconds: float = float("inf"),
    jobs: int = 1,
    first: int = 0,
    script: Path = SCRIPT,
) -> Tally:
    """Attack with cases `first` to `first + count`, each of at most `limit` [s] of processor time.

    No case is begun after `seconds`. Findings are kept in `output`. `script`: what a worker runs.
    """
    began, tally = time.monotonic(), Tally()
    output.mkdir(parents=True, exist_ok=True)
    waiting = iter(range(first, first + count))
    shown = began
    with selectors.DefaultSelector() as selector:

        def begun() -> _Worker:
            worker = _Worker(script, name, seed, output)
            selector.register(worker.answers, selectors.EVENT_READ, worker)
            return worker

        pool = [begun() for _ in range(jobs)]
        while any(worker.busy for worker in pool):
            for key, _ in selector.select(timeout=0.2):
                worker = key.data
                answer = worker.hear()
                if answer is not None and worker.index is not None:
                    tally.take(worker.index, answer)
                    worker.index, worker.leaving = None, bool(answer.get("last"))
            now = time.monotonic()
            for place, worker in enumerate(pool):
                if worker.leaving:  # it had grown too large
                    selector.unregister(worker.answers)
                    worker.tell(None)
                    pool[place] = begun()
                elif worker.busy and (worker.dead or worker.over(limit)):
                    selector.unregister(worker.answers)
                    words = worker.end(over=not worker.dead)
                    if worker.index is None:
                        raise RuntimeError(f"a worker of {name} does not start: {words}")
                    answer = {"kind": words.split(" ", 1)[0], "finding": words, "count": 1, "notes": {}}
                    tally.take(worker.index, {**answer, "seconds": now - worker.since})
                    _keep(output, worker.folder, worker.index, words, {})
                    shutil.rmtree(worker.folder, ignore_errors=True)
                    pool[place] = begun()
                elif worker.ready and worker.index is None and worker.busy:
                    index = next(waiting, None) if now - began < seconds else None
                    if index is None:
                        selector.unregister(worker.answers)
                    worker.tell(index)
            if now - shown > 10.0:
                shown = now
                words = f"{tally.cases} of {count} cases, {len(tally.findings)} findings, {now - began:.0f} s"
                print(f"{name}: {words}", file=sys.stderr, flush=True)
    tally.seconds = time.monotonic() - began
    return tally


def serve(attack: Attack, name: str, seed: int, folder: Path) -> None:
    """A worker's loop: each incoming number is answered by the outcome of that case."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    quiet = os.open(folder / "printed.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(quiet, 1)  # what libraries print is no answer
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if name not in ("distance",):  # XLA asks for more than it takes
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    print(json.dumps({"ready": True}), file=answers)
    for line in sys.stdin:
        index = int(line)
        case = folder / "case"
        shutil.rmtree(case, ignore_errors=True)
        case.mkdir(parents=True)
        began = time.perf_counter()
        outcome = attempt(attack, name, seed, index, case)
        answer = {**vars(outcome), "seconds": time.perf_counter() - began}
        if most_memory() > GROWN:
            answer["finding"] = (answer["finding"] + "; over the limit of memory").strip("; ")
            answer["last"] = True
        if answer["finding"]:
            _keep(folder.parent, folder, index, answer["finding"], outcome.notes)
        print(json.dumps(answer, default=str), file=answers)
        if answer.get("last"):
            return


def attempt(attack: Attack, name: str, seed: int, index: int, case: Path) -> Outcome:
    """Run one case; what the attack itself raises is a finding too, of whichever side."""
    numbers = np.random.default_rng([seed, sum(map(ord, name)), index])
    try:
        return attack(numbers, case)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        words = f"{type(error).__name__} in {Path(where.filename).name}:{where.lineno}: {error}"
        (case / "traceback.txt").write_text(traceback.format_exc())
        return Outcome("traceback", f"traceback {words}"[:500])


def _keep(output: Path, folder: Path, index: int, words: str, notes: dict[str, Any]) -> None:
    """Keep a case's folder, with what the judge found."""
    kept = output / f"case_{index:06d}"
    shutil.rmtree(kept, ignore_errors=True)
    if (folder / "case").is_dir():
        shutil.copytree(folder / "case", kept, symlinks=True, ignore_dangling_symlinks=True)
    kept.mkdir(exist_ok=True)
    (kept / "judge.json").write_text(json.dumps({"finding": words, "notes": notes}, indent=1, default=str) + "\n")


class _Worker:
    """A child process and its current task."""

    def __init__(self, script: Path, name: str, seed: int, output: Path) -> None:
        self.folder = output / f"worker_{os.getpid()}_{time.monotonic_ns()}"
        self.folder.mkdir(parents=True)
        command = [sys.executable, str(script), name, "--seed", str(seed), "--worker", str(self.folder)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        with open(self.folder / "errors.txt", "w") as errors:
            self.child = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
            )
        assert self.child.stdout is not None
        self.answers: IO[str] = self.child.stdout
        self.index: int | None = None
        self.spent = 0.0
        self.ready, self.leaving, self.busy, self.since = False, False, True, time.monotonic()

    @property
    def dead(self) -> bool:
        """True if the worker has died."""
        return self.child.poll() is not None

    def over(self, limit: float) -> bool:
        """True if the worker's case has taken more processor time than the limit, or much more time by the clock."""
        waited = time.monotonic() - self.since
        if self.index is None:
            return waited > SILENCE
        return waited > PATIENCE * limit or (waited > limit and self._spent() - self.spent > limit)

    def _spent(self) -> float:
        try:
            words = Path(f"/proc/{self.child.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

    def hear(self) -> dict[str, Any] | None:
        """Read an answer; None for none."""
        line = self.answers.readline()
        answer: dict[str, Any] | None = json.loads(line) if line else None
        if answer is not None and answer.get("ready"):
            self.ready, answer = True, None
        return answer

    def tell(self, index: int | None) -> None:
        """Give it a case, or none: then it ends."""
        if index is None:
            self.busy = False
            self.close()
            self.child.wait()
            shutil.rmtree(self.folder, ignore_errors=True)
        else:
            assert self.child.stdin is not None
            self.index, self.since, self.spent = index, time.monotonic(), self._spent()
            with contextlib.suppress(BrokenPipeError):  # it is found dead the next time
                self.child.stdin.write(f"{index}\n")
                self.child.stdin.flush()

    def close(self) -> None:
        """Close what leads to it and from it."""
        assert self.child.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.child.stdin.close()
        self.answers.close()

    def end(self, over: bool) -> str:
        """End it, and say what happened."""
        self.child.kill()
        code = self.child.wait()
        self.close()
        lines = (self.folder / "errors.txt").read_text(errors="replace").strip().splitlines()
        last = lines[-1][:300] if lines else ""
        return f"limit of time reached {last}" if over else f"signal {-code} {last}"
