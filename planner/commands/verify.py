"""`hdplan verify`: check a proof with the checker that shares nothing with hdplan, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from hdplan.planner.terminal.console import printing
from hdplan.planner.terminal.declared import GivenScene
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import check_file, read_file
from hdplan.scenes.output import check_writable
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify.bundle import is_job
from hdplan.verify.kernel import IN_PART
from hdplan.verify.robot_files import is_name


def run_verify(scene: GivenScene, trajectory: Path, proof: Path, *, world: Path | None = None) -> int:
    """Check a proof, of a motion or a job, and say what it proves or why not; write the `world` that the checker read.
    Returns the exit code: 0 if the proof is accepted, 4 if it is accepted in part, else 1.

    The checker limits the memory and the time of its own process, which whoever wrote the files could else use up.
    """
    request, robot = scene.request, scene.robot_file
    files = [find_scene(scene.scene), trajectory, proof]
    beside = [Path(robot)] if robot is not None and not is_name(robot) else []
    beside += [] if request is None else [request]
    for path in (*files, *beside):  # what cannot be read is bad input, not a proof that is rejected
        with naming(path):
            check_file(path)
    for option, value in (("--world", world), ("--request", request)):
        if value is not None and is_job(read_file(proof)):
            raise InputError(f"{option}: is about a single motion, and {proof} is the proof of a job: leave it out")
    if world is not None:
        check_writable(world, (".json",))
    given = {"world": world, "request": request, "robot": robot}
    options = [f"--{key}={value}" for key, value in given.items() if value is not None]
    command = [sys.executable, "-X", "utf8", "-m", "hdplan.verify", *options, "--", *map(str, files)]
    # In a process group of its own: Ctrl-C is for this process, which ends the checker without a traceback.
    done = subprocess.run(command, stdout=subprocess.PIPE, encoding="utf-8", check=False, process_group=0)
    ended = done.returncode in (0, 1, IN_PART) and done.stdout
    text = done.stdout.rstrip() if ended else "rejected: the checker was stopped, it needs too much memory or time"
    with printing() as show:
        show(text)
    return done.returncode if ended else 1
