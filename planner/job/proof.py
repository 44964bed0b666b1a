"""The proof of a job: one file with a proof for every world that is to be free, which `hdplan verify` checks by itself.

The checker derives these worlds by itself, from the job's scene and the motion's marks, so the file has nothing to say
about what is held, where objects lie, what may touch, and along which curves the tool moves.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.job.certify import JobCertificate, certify_job, standing
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.proof.proof import certified, proof_of, writing
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import NotProvenError, naming
from hdplan.scenes.output import write_output
from hdplan.scenes.values import FilePath, checked, path_of
from hdplan.scenes.yaml_format.reader import find_scene, load_scene
from hdplan.verify.bundle import MAGIC
from hdplan.verify.checking import check_job, check_part
from hdplan.verify.job import read_job


@dataclass(frozen=True)
class JobProof:
    """A proof that a job's motion is free, as `hdplan.verify` reads it."""

    data: bytes  # the file's content
    text: str  # what is proven, in the checker's words
    certificate: JobCertificate  # the origin of the proof

    def save(self, path: FilePath) -> None:
        """Write the file, whole or not at all. Raises InputError for a path that cannot be written."""
        write_output(checked(path_of, path, "path"), self.data)


def prove_job(scene: FilePath, trajectory: FilePath, robot: FilePath | None = None) -> JobProof:
    """Certify the motion of a job and write down why all its stages are free.

    A proof is about files: `scene` is one with a job, or a shipped one's name, `trajectory` the JSON file that was
    planned; a `robot` takes the place of the scene's, as in `load_scene`.

    Raises:
        NotProvenError: a stage is missing or not certified, or no planes are found; the message names it.
        InputError: as `certify_job`, and for what a proof cannot hold.
    """
    motion_file = checked(path_of, trajectory, "trajectory")
    robot_name = None if robot is None else str(checked(path_of, robot, "robot"))
    read, motion = load_scene(find_scene(scene), robot=robot_name), Trajectory.load(motion_file)
    with naming(motion_file):
        certificate = certify_job(read, motion)
    return prove_certified(certificate, scene, motion_file, robot_name)


def prove_certified(
    certificate: JobCertificate, scene: FilePath, trajectory: FilePath, robot: str | None = None
) -> JobProof:
    """Write down why the stages of a job are free that were certified in this process, in a scene read from these
    files. Raises as `prove_job`."""
    if not certificate.certified:
        raise NotProvenError(certificate.text)
    scene_file, motion_file = find_scene(scene), checked(path_of, trajectory, "trajectory")
    driven = list(_driven(certificate))
    planned = [world_of(each.setup, each.motion) for each in driven]
    proofs = []
    with writing():
        parts = read_job(scene_file, motion_file, planned, robot)
        for part, world, each in zip(parts, planned, driven, strict=True):
            check_part(part, world)
            try:
                proofs.append(proof_of(each.setup, world, part.reading, certified(*each)).data)
            except NotProvenError as error:
                raise NotProvenError(f"{part.name}: {error}") from None
        head = json.dumps({"lengths": [len(each) for each in proofs]}, separators=(",", ":"))
        data = MAGIC + f"{head}\n".encode() + b"".join(proofs)
        verdict, _ = check_job(scene_file, motion_file, data, robot)
    return JobProof(data, verdict.text, certificate)


class _Driven(NamedTuple):
    """A motion that is to be free."""

    setup: Setup
    motion: Trajectory
    certificate: Certificate | None  # None where it has none of its own
    passing: tuple[str, ...] = ()  # ends where the robot does not stop


def _driven(certificate: JobCertificate) -> Iterator[_Driven]:
    """Yield what is to be free, in the order of the stages: each motion, and after one of the fingers the arm that
    stands still meanwhile."""
    for stage in certificate.stages:
        alone = stage.certificate if stage.arm is None else None
        yield _Driven(Setup.of(stage.scene), stage.trajectory, alone, stage.passing)
        if stage.arm is not None:
            setup = Setup.of(stage.arm)
            yield _Driven(setup, standing(setup.robot, setup.robot.configuration(stage.arm.start), 1.0), None)
