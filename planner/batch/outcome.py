"""One problem solved: a row of results, and the motion. Every worker runs this."""

from __future__ import annotations

import faulthandler
import os
import platform
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import metadata
from typing import Any

import numpy as np

from hdplan.planner.batch.files import motion_file, proven, scene_file
from hdplan.planner.batch.job import Job
from hdplan.planner.causes import cause_of_refusal, cause_of_verdict
from hdplan.planner.diagnosis import MOST_TOGETHER, diagnose
from hdplan.planner.job.planning import plan_job
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.result import CUT_SHORT, PlanResult
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.idle_core import one_core
from hdplan.scenes.deadline import time_limit as limited
from hdplan.scenes.errors import HdplanError, InputError, debugging
from hdplan.scenes.scene import Scene

PATIENCE = 2.0, 10.0  # times the limit, and [s] more, after which a process that does not return is ended


@dataclass(frozen=True)
class Options:
    """Facts that hold for all problems of a run."""

    solver: str = "gauss_newton"
    time_limit: float = 60.0  # [s] for everything that a problem needs
    files: bool = False  # also scene and motion as files
    proofs: bool = False  # and the proof of it, if there is one
    diagnose: bool = False  # and what would help, where there is no certified motion

    @property
    def longest(self) -> float:
        """Time after which a process that does not return is ended [s]."""
        return PATIENCE[0] * self.time_limit + PATIENCE[1] + (MOST_TOGETHER if self.diagnose else 0.0)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of one problem."""

    problem: str
    status: str  # of the certificate, or "not_certified" for a job; "refused" for bad input, "failed" for a process
    # that ended, "error"
    cause: str  # a code of `causes`; empty if certified
    text: str  # the certificate's sentence, with what the time limit ended; or the error's
    trajectory: Trajectory | None = None
    figures: dict[str, Any] = field(default_factory=dict)  # the other columns of its row (COLUMNS)
    files: dict[str, bytes] = field(default_factory=dict)  # by ending, where they are requested

    @property
    def certified(self) -> bool:
        """True if the motion is proven free."""
        return self.status == "certified"


def solve(job: Job, options: Options) -> Outcome:
    """Plan one problem. Every result becomes an outcome, except when the process ends: a crash, too much memory,
    and a problem that does not return long after its time limit."""
    began = time.perf_counter()
    files: dict[str, bytes] = {}
    scene = None
    with _ended_from_outside(options.longest), one_core():
        try:
            with limited(options.time_limit):
                scene = job.load()
                read = time.perf_counter() - began
                if options.files:
                    files |= scene_file(scene)
                if scene.job is not None:
                    return _of_job(job, scene, options, read, files)
                result = plan(scene, solver=options.solver, seed=job.seed, time_limit=options.time_limit)
                if options.files:
                    files |= motion_file(result.trajectory)
                proof = proven(files, result) if options.proofs and result.certified else None
            outcome = _of_result(job, result, read, proof, files)
            return outcome if outcome.certified else _diagnosed(outcome, scene, result, job, options)
        except HdplanError as error:
            outcome = _without_motion(job, "refused", cause_of_refusal(error), str(error), began, files)
            return outcome if scene is None else _diagnosed(outcome, scene, error, job, options)
        except Exception as error:
            words = " ".join(f"{type(error).__name__}: {error}".split())
            text = f"internal error, please report it: {traceback.format_exc() if debugging() else words}"
            return _without_motion(job, "error", "internal", text, began, files)


def _diagnosed(
    outcome: Outcome, scene: Scene, failure: PlanResult | HdplanError, job: Job, options: Options
) -> Outcome:
    """Return an outcome with a diagnosis of its cause and of what would help, if requested."""
    if not options.diagnose or scene.job is not None:  # whose stages say what failed
        return outcome
    found = diagnose(scene, failure, solver=options.solver, seed=job.seed, time_limit=options.time_limit)
    return replace(outcome, cause=found.cause, figures={**outcome.figures, "advice": found.advice})


def failed(job: Job, cause: str, text: str) -> Outcome:
    """Return the outcome of a problem whose process ended."""
    return Outcome(job.name, "failed", cause, text, figures={**_common(job), "timed_out": cause == "hung"})


def _of_result(job: Job, result: PlanResult, read: float, proof: str | None, files: dict[str, bytes]) -> Outcome:
    certificate, motion = result.certificate, result.trajectory
    worst, own = certificate.worst, certificate.self_worst
    times = vars(result.times)
    figures = {
        **_common(job),
        "robot": result.robot,
        "clearance": certificate.clearance,
        "self_clearance": certificate.self_clearance,
        "worst_link": worst and worst.link,
        "worst_other": worst and worst.other,
        "self_worst_link": own and own.link,
        "self_worst_other": own and own.other,
        "worst_parameter": worst and worst.parameter,
        "motion_time": motion.duration,
        "length": _length(motion),
        "attempts": result.attempts,
        "iterations": result.iterations,
        "timed_out": result.timed_out,
        "proof": proof,
        **{f"time_{name}": seconds + (read if name == "load" else 0.0) for name, seconds in times.items()},
    }
    cause = "" if result.certified else cause_of_verdict(certificate, CUT_SHORT in result.notes)
    text = f"{certificate.text}; {result.ended}" if result.ended else certificate.text
    return Outcome(job.name, certificate.status.value, cause, text, motion, figures, files)


def _of_job(job: Job, scene: Scene, options: Options, read: float, files: dict[str, bytes]) -> Outcome:
    """Plan a problem that holds a job of several stages."""
    if options.solver != Options.solver:
        raise InputError(f"--solver {options.solver}: plans a single motion, and {job.name} holds a job")
    result = plan_job(scene, seed=job.seed, time_limit=options.time_limit)
    motion = result.trajectory
    if options.files:
        files |= motion_file(motion)
    figures = {
        **_common(job),
        "robot": Setup.of(result.certificate.stages[0].scene).robot.name,
        "clearance": result.certificate.clearance,
        "motion_time": motion.duration,
        "length": _length(motion),
        "timed_out": False,
        "proof": proven(files, result) if options.proofs and result.certified else None,
        "time_load": read,
        "time_solve": result.seconds,
    }
    status, cause = ("certified", "") if result.certified else ("not_certified", "stage_failed")
    return Outcome(job.name, status, cause, result.text, motion, figures, files)


def _length(motion: Trajectory) -> float:
    return float(np.linalg.norm(np.diff(motion.positions, axis=0), axis=1).sum())


def _without_motion(job: Job, status: str, cause: str, text: str, began: float, files: dict[str, bytes]) -> Outcome:
    figures = {**_common(job), "time_load": time.perf_counter() - began, "timed_out": cause == "time"}
    return Outcome(job.name, status, cause, text, None, figures, files)


def _common(job: Job) -> dict[str, Any]:
    return {"group": job.group, "seed": job.seed, "sha256": job.hashed, "versions": _versions()}


@cache
def _versions() -> str:
    packages = ("hdplan", "numpy", "casadi", "pin", "coal")
    return f"python {platform.python_version()} " + " ".join(f"{x} {metadata.version(x)}" for x in packages)


@contextmanager
def _ended_from_outside(seconds: float) -> Iterator[None]:
    """End this process if the block takes longer: by a thread of C, which waits for no interpreter."""
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
