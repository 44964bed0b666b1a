"""The result of planning a job: one motion with marks where its stages begin, and one certificate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdplan.planner.job.certify import JobCertificate, as_json
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.scene import Scene


@dataclass(frozen=True, eq=False)
class JobResult:
    """The planned stages of a job and their certificate."""

    scene: Scene  # the scene with the job
    trajectory: Trajectory  # of all joints that the job moves, with marks; the first stages, where one failed
    certificate: JobCertificate
    failure: str  # the stage that could not be planned, and the reason; empty if all were
    seed: int
    notes: tuple[str, ...]  # on assumptions and abandoned choices
    seconds: float  # [s] that planning and certifying took

    def __repr__(self) -> str:
        """Give the scene and the verdict."""
        return f"<JobResult of {self.scene.name}: {self.text}>"

    @property
    def certified(self) -> bool:
        """True if all stages are proven."""
        return self.certificate.certified

    @property
    def text(self) -> str:
        """The verdict, in one sentence."""
        if not self.failure:
            return self.certificate.text
        return f"not certified: {self.failure}; {len(self.certificate.stages)} stages before it are planned"

    def summary(self) -> dict[str, Any]:
        """Return the result as one JSON object: verdict, duration [s], and what is proven of every stage."""
        return {
            "status": "certified" if self.certified else "not_certified",
            "text": self.text,
            "scene": self.scene.name,
            "joint_names": list(self.trajectory.joint_names),
            "waypoints": len(self.trajectory),
            "duration_s": self.trajectory.duration,
            "clearance_m": self.certificate.clearance,
            "stages": [as_json(stage) for stage in self.certificate.stages],
            "missing": list(self.certificate.missing),
            "time_s": round(self.seconds, 6),
            "seed": self.seed,
            "notes": list(self.notes),
        }

    def save(self, path: str | Path) -> None:
        """Write the motion with its stages, in a format that holds them; JSON also holds the summary, as `verdict`.
        Raises InputError if it cannot be written."""
        self.trajectory.save(path, self.summary())
