"""The proof of a job: one file with a proof for every world that is to be free, which `hdplan verify` checks by itself.

The checker derives these worlds by itself, from the job's scene and the motion's marks, so the file has nothing to say
about what is held, where objects lie, and what may touch.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass

from hdplan.planner.job.certify import JobCertificate, certify_job, standing
from hdplan.planner.job.stage_scenes import stage_source
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.proof.proof import NotProvenError, certified, proof_of, writing
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.output import write_output
from hdplan.scenes.stage import ArmStage
from hdplan.scenes.values import FilePath, checked, path_of
from hdplan.scenes.yaml_format.reader import find_scene, load_scene
from hdplan.verify.checking import check_job, check_part
from hdplan.verify.job import read_job
from hdplan.verify.kernel import JOB_MAGIC


@dataclass(frozen=True)
class JobProof:
    """A proof that a job's motion is free, as `hdplan.verify` reads it."""

    data: bytes  # the file's content
    text: str  # what is proven, in the checker's words
    certificate: JobCertificate  # that it was made from

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
    scene_file, motion_file = find_scene(scene), checked(path_of, trajectory, "trajectory")
    robot_name = None if robot is None else str(checked(path_of, robot, "robot"))
    asked, motion = load_scene(scene_file, robot=robot_name), Trajectory.load(motion_file)
    for number, stage in enumerate(asked.job.stages if asked.job is not None else ()):
        if isinstance(stage, ArmStage) and stage.blend:
            raise InputError(
                f"{stage_source(asked, number)}: blend: no proof file holds stages that go over into one another; "
                "hdplan check proves them"
            )
    with naming(motion_file):
        certificate = certify_job(asked, motion)
    if not certificate.certified:
        raise NotProvenError(certificate.text)
    driven = list(_driven(certificate))
    planned = [world_of(*each) for each in driven]
    proofs = []
    with writing():
        parts = read_job(scene_file, motion_file, planned, robot_name)
        for part, told, (setup, piece) in zip(parts, planned, driven, strict=True):
            check_part(part, told)
            try:
                proofs.append(proof_of(setup, told, part.reading, *certified(setup, piece)).data)
            except NotProvenError as error:
                raise NotProvenError(f"{part.name}: {error}") from None
        head = json.dumps({"lengths": [len(each) for each in proofs]}, separators=(",", ":"))
        data = JOB_MAGIC + f"{head}\n".encode() + b"".join(proofs)
        verdict, _ = check_job(scene_file, motion_file, data, robot_name)
    return JobProof(data, verdict.text, certificate)


def _driven(certificate: JobCertificate) -> Iterator[tuple[Setup, Trajectory]]:
    """Yield what is to be free, in the order of the stages: each motion, and after one of the fingers the arm that
    stands still meanwhile."""
    for stage in certificate.stages:
        yield Setup.of(stage.scene), stage.trajectory
        if stage.arm is not None:
            setup = Setup.of(stage.arm)
            yield setup, standing(setup.robot, setup.robot.configuration(stage.arm.start), 1.0)
