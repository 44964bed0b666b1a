"""`hdplan plan`, `check`, `simulate`, `plot` and `prove` with a scene that holds a job."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.text import Text

from hdplan.planner.certificate.verdict import proven_length
from hdplan.planner.commands.watched import alone, also_seen, opened
from hdplan.planner.job.certify import JobCertificate, StageCertificate, as_json as verdict_of, certify_job
from hdplan.planner.job.planning import plan_job
from hdplan.planner.job.result import JobResult
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.motion.trajectory_files import check_stages
from hdplan.planner.terminal.console import printing, progress, say, waiting
from hdplan.planner.terminal.declared import GivenScene
from hdplan.planner.terminal.session import complain
from hdplan.planner.terminal.tables import columns, table, tracking_text
from hdplan.scenes.deadline import no_limit
from hdplan.scenes.errors import InputError, NotProvenError, naming
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.commands.watched import Report, Stop
    from hdplan.planner.control.simulation import Plant
    from hdplan.planner.job.simulation import JobSimulation

    Run = Callable[[Report, Stop], JobResult]


def refuse_options(given: Mapping[str, object]) -> None:
    """Raise InputError for options that were given and that a job does not take."""
    for option, value in given.items():
        if value:
            raise InputError(f"{option}: is about a single motion, and this scene holds a job: leave it out")


@dataclass(frozen=True)
class Written:
    """The files that are written of a planned job."""

    scene: GivenScene
    output: Path | None
    plot: Path | None
    proof: Path | None

    def check(self) -> None:
        """Raise InputError, before a job is planned, for files that cannot hold it."""
        if self.output is not None:
            check_stages(self.output)
        if self.proof is not None and (self.output is None or self.output.suffix.lower() != ".json"):
            raise InputError("--proof: a job's proof refers to the motion's JSON file: write one too, -o FILE.json")

    def write(self, result: JobResult) -> list[str]:
        """Write the files; a proof only of a certified job. Return their names. Raises NotProvenError."""
        if self.output is not None:
            result.save(self.output)
        if self.plot is not None:
            from hdplan.planner.job.sheet import plot_job

            plot_job(result.certificate, result.trajectory, self.plot)
        proven = self.proof is not None and self.output is not None and result.certified
        if proven and self.proof is not None and self.output is not None:
            from hdplan.planner.job.proof import prove_certified  # with the checker, which takes long to import

            prove_certified(result.certificate, self.scene.scene, self.output, self.scene.robot_file).save(self.proof)
        return [str(file) for file in (self.output, self.plot, self.proof if proven else None) if file is not None]


def run_plan_job(
    scene: Scene,
    files: Written,
    *,
    seed: int,
    time_limit: float,
    as_json: bool,
    quiet: bool,
    served: contextlib.ExitStack | None = None,
) -> int:
    """Plan a job. Browsers see it that are `served`. Returns the exit code: 0 if all its stages are certified, and
    proven where there is to be a proof, else 1."""
    files.check()
    follow = alone if served is None else _in_browsers(scene, served)
    with progress(scene.planner, shown=not quiet and not as_json) as (report, stop):
        result = follow(
            also_seen(
                lambda report, stop: plan_job(scene, seed=seed, time_limit=time_limit, report=report, stop=stop),
                report,
                stop,
            )
        )
    try:
        with no_limit():
            written = files.write(result)
    except NotProvenError as error:
        say(f"no proof: {error}", "red")
        return 1
    if quiet:
        return 0 if result.certified else 1
    with printing() as show:
        if as_json:
            show(json.dumps(result.summary()))
        else:
            show(Text(result.text, style="green" if result.certified else "red"))
            rows = [("scene", scene.name), ("motion", result.trajectory.extent), ("time [s]", f"{result.seconds:.2f}")]
            rows += [("note", note) for note in result.notes]
            show(columns(stage_rows(result.certificate)))
            show(table([*rows, *(("written", file) for file in written)]))
    return 0 if result.certified else 1


def _in_browsers(scene: Scene, served: contextlib.ExitStack) -> Callable[[Run], JobResult]:
    """Serve a scene with a job, say where, and return what makes a plan that browsers see."""
    from hdplan.planner.view.server import open_job_viewer

    return opened(scene.name, lambda: open_job_viewer(scene, complain=complain), served).follow


def run_check_job(scene: Scene, trajectory: Path, *, as_json: bool) -> int:
    """Certify the motion of a job. Returns the exit code: 0 if all its stages are certified, else 1."""
    motion = Trajectory.load(trajectory)
    with waiting("certifying", shown=not as_json), naming(trajectory):
        certificate = certify_job(scene, motion)
    with printing() as show:
        if as_json:
            status = "certified" if certificate.certified else "not_certified"
            stages = [verdict_of(stage) for stage in certificate.stages]
            about = {"status": status, "text": certificate.text, "scene": scene.name, "trajectory": str(trajectory)}
            show(
                json.dumps(
                    {**about, "stages": stages, "missing": list(certificate.missing), "notes": list(certificate.notes)}
                )
            )
        else:
            show(Text(certificate.text, style="green" if certificate.certified else "red"))
            show(columns(stage_rows(certificate)))
            if certificate.notes:
                show(table([("note", note) for note in certificate.notes]))
    return 0 if certificate.certified else 1


def run_plot_job(scene: Scene, trajectory: Path, output: Path) -> int:
    """Draw the motion of a job. Returns the exit code: 0 for every verdict."""
    from hdplan.planner.job.sheet import plot_job

    motion = Trajectory.load(trajectory)
    with waiting("drawing"):
        with naming(trajectory):
            certificate = certify_job(scene, motion)
        plot_job(certificate, motion, output)
    with printing() as show:
        show(Text(certificate.text, style="green" if certificate.certified else "red"))
        show(table([("written", str(output))]))
    return 0


def run_simulate_job(
    scene: Scene, trajectory: Path, plant: Plant | None, *, plant_name: str | None, as_json: bool
) -> int:
    """Replay the motion of a job, executed by a plant if there is one. Returns the exit code: 0 if all its stages
    succeed, else 1."""
    from hdplan.planner.job.simulation import replay_job

    motion = Trajectory.load(trajectory)
    with waiting("simulating", shown=not as_json), naming(trajectory):
        simulation = replay_job(scene, motion, plant)
    with printing() as show:
        if as_json:
            about = {"plant": plant_name, "scene": scene.name, "trajectory": str(trajectory)}
            show(json.dumps({**simulation.summary(), **about}))
        else:
            show(Text(simulation.text, style="green" if simulation.succeeded else "red"))
            show(columns(simulated_rows(simulation)))
            if simulation.tracking is not None:
                show(table([("tracking error", tracking_text(simulation.tracking))]))
    return 0 if simulation.succeeded else 1


def run_prove_job(scene: GivenScene, trajectory: Path, output: Path) -> int:
    """Write the proof of a job's motion. Returns the exit code: 0 if there is one, else 1."""
    from hdplan.planner.job.proof import prove_job  # imported here, as the checker with it takes long

    try:
        with waiting("proving", shown=True):
            proof = prove_job(scene.scene, trajectory, scene.robot_file)
    except NotProvenError as error:
        say(f"no proof: {error}", "red")
        return 1
    proof.save(output)
    with printing() as show:
        show(f"proof: {proof.certificate.text}")
        show(table([("size", f"{len(proof.data) / 1e3:.1f} kB"), ("written", str(output))]))
    return 0


def stage_rows(certificate: JobCertificate) -> Sequence[Mapping[str, object]]:
    """Return a row for each stage: when it is, what is held and may touch, and the verdict, in full where it is not
    certified."""
    return [
        {
            "stage": stage.name,
            "kind": stage.kind,
            "begins": f"{stage.begins:.3f}",
            "ends": f"{stage.ends:.3f}",
            "held": ", ".join(stage.held) or "-",
            "may_touch": ", ".join("-".join(pair) for pair in stage.touch) or "-",
            "verdict": _verdict(stage),
        }
        for stage in certificate.stages
    ]


def _verdict(stage: StageCertificate) -> str:
    certificate = stage.certificate
    if not certificate.certified or certificate.clearance is None:
        return certificate.text.partition(": ")[0] if certificate.certified else certificate.text
    return f"certified, {proven_length(certificate.clearance)}"


def simulated_rows(done: JobSimulation) -> Sequence[Mapping[str, object]]:
    """Return a row for each stage: when it is, what is held, the least distance that was met, how far the arm was off,
    and the verdict, in full where the stage failed."""
    rows = []
    for stage, simulation in done.stages:
        met = [each.distance for each in (simulation.closest, simulation.self_closest) if each is not None]
        off = [each.error for each in simulation.joints if each.error is not None]
        rows.append(
            {
                "stage": stage.name,
                "kind": stage.kind,
                "begins": f"{stage.begins:.3f}",
                "ends": f"{stage.ends:.3f}",
                "held": ", ".join(stage.held) or "-",
                "closest_[mm]": f"{1e3 * min(met):.2f}" if met else "-",
                "off": f"{max(off):.1e}" if off else "-",
                "verdict": "; ".join(simulation.failures) or ("executed" if off else "replayed"),
            }
        )
    return rows
