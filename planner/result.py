"""What planning gives back: the trajectory, its certificate, and how they were found."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdplan.planner.certificate import Certificate
from hdplan.planner.solvers.solution import Step
from hdplan.planner.trajectory import Trajectory


@dataclass(frozen=True)
class Times:
    """Where the time went [s]."""

    load: float  # reading scene, robot and meshes
    build: float  # laying out the problem, fitting link bodies if they are not in the cache
    compile: float  # compiling the distance, or finding it in the cache
    solve: float  # all attempts together
    certify: float  # all attempts together


@dataclass(frozen=True, eq=False)
class PlanResult:
    """The best motion found and what is proven about it."""

    scene: str
    robot: str
    trajectory: Trajectory
    certificate: Certificate
    solver: str
    seed: int
    attempts: int  # first guesses tried
    iterations: int  # of the solver, all attempts together
    steps: tuple[Step, ...]  # of the attempt that is given back
    times: Times
    notes: tuple[str, ...]  # what was assumed or left out, in words

    @property
    def certified(self) -> bool:
        """Whether the motion is proven free."""
        return self.certificate.certified

    def summary(self) -> dict[str, Any]:
        """The result as one JSON object: status, clearance [m], worst place, times [s], counts."""
        return {
            "status": self.certificate.status.value,
            "text": self.certificate.text,
            "scene": self.scene,
            "robot": self.robot,
            "solver": self.solver,
            "joint_names": list(self.trajectory.joint_names),
            "waypoints": len(self.trajectory),
            **verdict(self.certificate),
            "time_s": {name: round(seconds, 6) for name, seconds in vars(self.times).items()},
            "iterations": self.iterations,
            "attempts": self.attempts,
            "seed": self.seed,
        }

    def save(self, path: str | Path) -> None:
        """Write the trajectory, with this summary where the format has room. Raises InputError if it cannot be
        written."""
        self.trajectory.save(path, self.summary())


def verdict(certificate: Certificate) -> dict[str, Any]:
    """The certificate's figures as JSON: proven clearances [m] (null without proof or obstacles) and the closest
    place."""
    worst = certificate.worst
    return {
        "clearance_m": certificate.clearance,
        "self_clearance_m": certificate.self_clearance,
        "worst": worst
        and {"time": worst.time, "link": worst.link, "obstacle": worst.other, "distance_m": worst.distance},
    }
