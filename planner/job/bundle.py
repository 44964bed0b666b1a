"""The proofs of a job: for every stage its scene, its motion, and a proof, which `hdplan verify` checks with nothing of
hdplan.

What the proofs do not say is that the scenes of the stages follow from one another: that an object is held as it was
taken, and lies where it was let go; nor that the arm is free where it stands while fingers move. That `certify_job`
derives, from the job's scene and the whole motion.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from hdplan.planner.job.certify import StageCertificate, certify_job
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.proof.proof import NotProvenError, prove
from hdplan.scenes.scene import Scene


def prove_job(scene: Scene, trajectory: Trajectory) -> dict[str, bytes]:
    """Return the files that prove the stages of a job, by name: "03_lift.yaml", "03_lift.json", "03_lift.proof".

    Raises:
        NotProvenError: a stage is missing or not certified, or no planes are found; the message names it.
        InputError: as `certify_job`, and for what a proof cannot hold.
    """
    certificate = certify_job(scene, trajectory)
    if not certificate.certified:
        raise NotProvenError(certificate.text)
    files: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number, stage in enumerate(certificate.stages):
            files |= _stage_files(Path(folder), f"{number:02}_{re.sub(r'[^A-Za-z0-9]+', '_', stage.name)}", stage)
    return files


def _stage_files(folder: Path, name: str, stage: StageCertificate) -> dict[str, bytes]:
    paths = {ending: folder / f"{name}.{ending}" for ending in ("yaml", "json", "proof")}
    stage.scene.save(paths["yaml"])
    stage.trajectory.save(paths["json"])
    try:
        prove(paths["yaml"], paths["json"]).save(paths["proof"])
    except NotProvenError as error:
        raise NotProvenError(f"stage '{stage.name}': {error}") from None
    return {path.name: path.read_bytes() for path in paths.values()}
