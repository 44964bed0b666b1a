"""`hdplan view`: show a scene and motions in the browser, or write them as one page."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.terminal.console import printing, waiting
from hdplan.planner.terminal.interrupts import until_ctrl_c
from hdplan.planner.terminal.session import complain
from hdplan.planner.terminal.tables import table
from hdplan.planner.view.front import check_installed, check_proof, check_recording, motion_names
from hdplan.scenes.yaml_format.reader import find_scene, load_scene


def run_view(
    scene: str,
    trajectories: Sequence[Path],
    request: Path | None,
    robot: str | None,
    *,
    proof: Path | None,
    record: Path | None,
    host: str,
    port: int,
) -> int:
    """Serve until Ctrl-C, or write the page `record`. Returns the exit code: 0."""
    check_installed()
    if record is not None:
        check_recording(record, trajectories)
    if proof is not None:
        check_proof(proof, trajectories, request, robot)
    problem = load_scene(scene, request=request, robot=robot)
    names = motion_names(trajectories)
    motions = [(name, Trajectory.load(file)) for name, file in zip(names, trajectories, strict=True)]

    read = None if proof is None else ReadProof(find_scene(scene), trajectories[0], proof)

    from hdplan.planner.view.server import open_viewer  # needs viser

    with waiting("loading the robot's meshes"):
        arm = load_scene_robot(problem)
        viewer = open_viewer(problem, motions, robot=arm, host=host, port=port, complain=complain)
    if read is not None:
        viewer.show_proof(read)
    with contextlib.closing(viewer), until_ctrl_c(), printing() as show:
        if record is not None:
            viewer.record(record)
            show(table([("written", str(record))]))
            return 0
        taken = f" (port {port} is taken)" if viewer.port != port else ""
        show(f"{problem.name} at http://{host}:{viewer.port}{taken}, until Ctrl-C")
        sys.stdout.flush()
        threading.Event().wait()
    return 0
