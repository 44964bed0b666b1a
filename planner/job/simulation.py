"""The motion of a job, replayed stage by stage: each in its own scene, with its held objects and allowed contacts.

Scene and motion -> `JobSimulation`. A plant (`control.simulation`) executes each stage of the arm from where it begins;
fingers have no drives there, and are replayed as the motion has them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hdplan.planner.control.loop import measured_tracking
from hdplan.planner.control.simulation import Plant, Simulation, nominal, replay
from hdplan.planner.job.certify import StageCertificate, certify_job
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import naming
from hdplan.scenes.scene import Scene, unknown_in
from hdplan.scenes.sizes import Tracking


@dataclass(frozen=True, eq=False)
class JobSimulation:
    """The outcome of the replay of a job."""

    stages: tuple[tuple[StageCertificate, Simulation], ...]  # as far as the motion goes
    missing: tuple[str, ...]  # the stages that the motion does not have
    unknown: tuple[str, ...] = ()  # fields of the job's scene that say how far it may be off, and were left out

    @property
    def succeeded(self) -> bool:
        """True if all stages are there and succeeded."""
        return not self.missing and all(simulation.succeeded for _, simulation in self.stages)

    @property
    def text(self) -> str:
        """The verdict in one line."""
        for stage, simulation in self.stages:
            if not simulation.succeeded:
                return f"failed: stage '{stage.name}': {'; '.join(simulation.failures)}"
        if self.missing:
            return f"failed: not whole: '{self.missing[0]}' has no motion"
        remark = nominal(self.unknown)
        if self.tracking is None:
            return f"replayed: all {len(self.stages)} stages, within all limits of the scene{remark}"
        worst = max(np.abs(each.errors).max() for each in self._executions)
        return (
            f"executed: all {len(self.stages)} stages, simulated with dynamics, tracked within {worst:.1e} rad{remark}"
        )

    @property
    def tracking(self) -> Tracking | None:
        """The largest errors of each of the arm's joints over all stages, rounded up; None without dynamics."""
        done = self._executions
        if not done:
            return None
        errors, velocity_errors = (
            np.concatenate([getattr(each, name) for each in done]) for name in ("errors", "velocity_errors")
        )
        return measured_tracking(errors, velocity_errors)

    @property
    def _executions(self) -> list[Any]:
        """The executions of the arm."""
        return [each.execution for stage, each in self.stages if stage.arm is None and each.execution is not None]

    def summary(self) -> dict[str, Any]:
        """Return all of it as one JSON object, each stage as `Simulation.summary` has it."""
        return {
            "status": "succeeded" if self.succeeded else "failed",
            "text": self.text,
            "tracking": None if self.tracking is None else asdict(self.tracking),
            "stages": [
                {"stage": stage.name, "kind": stage.kind, "begins_s": stage.begins, "ends_s": stage.ends}
                | {"held": list(stage.held)}
                | simulation.summary()
                for stage, simulation in self.stages
            ],
            "missing": list(self.missing),
        }


def replay_job(scene: Scene, trajectory: Trajectory, plant: Plant | None = None) -> JobSimulation:
    """Replay the motion of a job, its arm executed by a plant if there is one.

    Raises InputError as `certify_job` and `replay`, the latter naming the stage.
    """
    certificate = certify_job(scene, trajectory)
    found = []
    for stage in certificate.stages:
        with naming(f"stage '{stage.name}'"):
            body = plant if stage.arm is None else None
            found.append((stage, replay(Setup.of(stage.scene), stage.trajectory, body)))
    return JobSimulation(tuple(found), certificate.missing, tuple(unknown_in(scene)))
