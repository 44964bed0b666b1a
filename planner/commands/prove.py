"""`hdplan prove`: write the proof that a motion is free."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hdplan.planner.proof.proof import Proof, prove
from hdplan.planner.terminal.console import printing, say, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.tables import table
from hdplan.scenes.errors import InputError, NotProvenError
from hdplan.scenes.output import check_writable
from hdplan.scenes.robot_spec import RobotSpec

ENDINGS = (".proof",)
MOTIONS = (".json", ".csv")  # of which there can be proofs
WITH_ARGUMENTS = "--proof: a proof refers to files, so --xacro-arg is not allowed: give robot.xacro_args in a file"


def run_prove(scene: GivenScene, trajectory: Path, *, output: Path) -> int:
    """Write the proof of a motion, or of the stages of a job. Returns the exit code: 0 if there is one, else 1."""
    check_writable(output, ENDINGS)
    if scene.load().job is not None:
        from hdplan.planner.commands.job import run_prove_job

        return run_prove_job(scene, trajectory, output)
    with waiting("proving", shown=True):
        proof = written(lambda: prove(scene.scene, trajectory, scene.request, scene.robot_file), output)
    if proof is None:
        return 1
    with printing() as show:
        show(f"proof: {proof.certificate.text}")
        size = f"{len(proof.data) / 1e3:.1f} kB"
        show(table([("leaves", str(proof.leaves)), ("size", size), ("written", str(output))]))
    return 0


def check_proof_of_plan(proof: Path, output: Path | None, robot: str | RobotSpec | None) -> None:
    """Raise InputError, before a motion is planned, if no proof of it could be written."""
    check_writable(proof, ENDINGS)
    if output is None or output.suffix.lower() not in MOTIONS:
        raise InputError(f"--proof: a proof needs the motion's file: write it too, -o FILE with {' or '.join(MOTIONS)}")
    if isinstance(robot, RobotSpec):
        raise InputError(WITH_ARGUMENTS)


def written(make: Callable[[], Proof], output: Path) -> Proof | None:
    """Write a proof, or say why there is none."""
    try:
        proof = make()
    except NotProvenError as error:
        say(f"no proof: {error}", "red")
        return None
    proof.save(output)
    return proof
