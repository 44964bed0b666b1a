"""The result of planning: the trajectory, its certificate, and how they were found."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.html_page import HtmlPage
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.solvers.solution import Iteration
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import read_file
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget

if TYPE_CHECKING:
    from hdplan.planner.proof.proof import Proof
    from hdplan.planner.search.objective import Achieved

CUT_SHORT = "the time limit passed: unproven parts may only need finer checks"
"""The note on a certificate that the time limit ended."""

_FIGURES = tuple(field.name for field in fields(Iteration))


@dataclass(frozen=True)
class Times:
    """Durations of the phases of planning [s]."""

    load: float  # reading scene, robot and meshes
    build: float  # laying out the problem, fitting link bodies if they are not in the cache
    compile: float  # compiling the distance, or finding it in the cache
    solve: float  # all attempts together
    certify: float  # all attempts together


@dataclass(frozen=True, eq=False)
class PlanResult:
    """The best motion found, and what is proven about it."""

    scene: str
    robot: str
    trajectory: Trajectory
    certificate: Certificate
    solver: str
    seed: int
    attempts: int  # guesses tried until one was certified
    iterations: int  # steps of the solver, all attempts together
    steps: tuple[Iteration, ...]  # the solver's steps of the attempt that is returned
    times: Times
    notes: tuple[str, ...]  # on what was assumed or left out
    objective: Achieved  # the quantity by which certified motions were compared, and its value
    goal: JointTarget | None = None  # the chosen goal, if the scene leaves a choice
    requested: Scene | None = None  # the planned scene
    ended: str = ""  # what the time limit ended, in words; empty if it ended nothing

    def __post_init__(self) -> None:
        """Let the certificate give its proof."""
        object.__setattr__(self, "certificate", replace(self.certificate, prover=self._proof))

    def _proof(self) -> Proof:
        return self._proven

    @cached_property
    def _proven(self) -> Proof:
        from hdplan.planner.proof.proof import prove_planned
        from hdplan.scenes.yaml_format.reader import load_scene

        assert self.requested is not None
        with tempfile.TemporaryDirectory() as folder:
            scene, motion = self.requested.source, Path(folder) / "motion.json"
            self.save(motion)
            try:
                same = load_scene(scene) == self.requested
            except InputError:  # made in Python, or one of MoveIt's
                same = False
            if not same:
                scene = Path(folder) / "scene.yaml"
                self.requested.save(scene)
            return prove_planned(self, scene, motion)

    def __repr__(self) -> str:
        """Give the scene, the robot and the verdict."""
        return f"<PlanResult of {self.scene} with {self.robot}: {self.certificate.text}>"

    def _repr_html_(self) -> str:
        """Return the HTML of a notebook: the verdict, and a small plot of the motion if matplotlib is installed."""
        import hdplan.planner

        return str(hdplan.planner.result_html(self))

    def show(self) -> HtmlPage:
        """Return the motion as a page of HTML that plays it in three dimensions: a notebook shows it, and `save` writes
        it as a file that any browser opens, offline. Raises InputError if the result does not hold its scene."""
        import hdplan.planner

        page: HtmlPage = hdplan.planner.result_page(self)
        return page

    @property
    def certified(self) -> bool:
        """True if the motion is proven free."""
        return self.certificate.certified

    @property
    def timed_out(self) -> bool:
        """True if the time limit ended the search, or the improvement of its motion: another run may find another
        motion."""
        return bool(self.ended)

    def summary(self) -> dict[str, Any]:
        """Return the result as one JSON object: status, clearance [m], worst place, times [s], counts; the objective,
        by which motions were compared, and its value; the duration of the motion [s] if it has times; the chosen goal,
        if the scene leaves a choice; whether the time limit ended the search; and the notes."""
        goal = {"goal": {"of": self.goal.field, "joints": self.goal.positions}} if self.goal else {}
        return {
            "status": self.certificate.status.value,
            "text": self.certificate.text,
            "scene": self.scene,
            "robot": self.robot,
            "solver": self.solver,
            "joint_names": list(self.trajectory.joint_names),
            "waypoints": len(self.trajectory),
            **how_long(self.trajectory),
            "objective": self.objective._asdict(),
            **goal,
            **verdict(self.certificate),
            "time_s": {name: round(seconds, 6) for name, seconds in vars(self.times).items()},
            "iterations": self.iterations,
            "attempts": self.attempts,
            "seed": self.seed,
            "timed_out": self.timed_out,
            "notes": list(self.notes),
        }

    def save(self, path: str | Path) -> None:
        """Write the trajectory; JSON also holds the summary, as `verdict`, and the solver's `steps`, a list for each of
        their figures. Raises InputError if it cannot be written."""
        steps = {name: [getattr(step, name) for step in self.steps] for name in _FIGURES}
        self.trajectory.save(path, self.summary(), steps)


def how_long(trajectory: Trajectory) -> dict[str, float]:
    """Return the duration of a motion for JSON; nothing for a path without times."""
    return {} if trajectory.duration is None else {"duration_s": trajectory.duration}


def verdict(certificate: Certificate) -> dict[str, Any]:
    """Return the certificate's figures for JSON: proven clearances [m] (null without proof or obstacles); the closest
    place found, by its path parameter (0 to 1) and time (null for a path without times); and, if the scene has any, the
    greatest share that the motion uses of each limit (null: infinite, at a jump) with its joint, and how well the path
    constraints are kept [rad] or [m]."""
    worst = certificate.worst
    limits = [
        {
            "quantity": use.quantity,
            "share": use.share if np.isfinite(use.share) else None,
            "joint": use.joint,
            "limit": use.limit,
        }
        for use in certificate.uses
    ]
    path = [
        {"constraint": kept.field, "link": kept.link, "worst": kept.worst, "allowed": kept.allowed}
        for kept in certificate.path
    ]
    return {
        "clearance_m": certificate.clearance,
        "self_clearance_m": certificate.self_clearance,
        "worst": worst
        and {
            "parameter": worst.parameter,
            "seconds": worst.seconds,
            "link": worst.link,
            "obstacle": worst.other,
            "distance_m": worst.distance,
            **({"unknown_m": worst.unknown} if worst.unknown else {}),
        },
        **({"limits": limits} if limits else {}),
        **({"path": path} if path else {}),
    }


def read_steps(path: str | Path) -> tuple[Iteration, ...]:
    """Read the solver's steps from a trajectory file; none if it has none.

    Raises InputError naming the file if they are not lists of numbers of equal length.
    """
    path = Path(path)
    content = json.loads(read_file(path)) if path.suffix.lower() == ".json" else {}
    if "steps" not in content:
        return ()
    columns = content["steps"]
    try:
        table = np.array([columns[name] for name in _FIGURES], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        table = np.array(np.nan)
    if table.ndim != 2 or not np.isfinite(table).all():
        raise InputError(f"{path}: steps: lists of numbers of equal length are expected: {', '.join(_FIGURES)}")
    return tuple(Iteration(round(number), *figures) for number, *figures in table.T.tolist())
