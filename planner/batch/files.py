"""A problem as files: its scene, its motion and the proof of it, which `hdplan view` and `hdplan verify` take.

The same problem gives the same bytes: the motion's file holds no times of the planner.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from hdplan.planner.job.result import JobResult
from hdplan.planner.motion.json_format import write_json
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.result import PlanResult
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.output import write_output
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.writer import scene_text

SCENE, MOTION, PROOF = ".yaml", ".json", ".proof"
PLAIN_CHARACTERS = " ()[]{}+,;=@!$&'"  # characters of a name, beside letters and digits, that its file has too


def scene_file(scene: Scene) -> dict[str, bytes]:
    """Return a scene as a file. Raises InputError for one that no file can hold."""
    scene.check_effects()
    return {SCENE: scene_text(scene).encode()}


def motion_file(motion: Trajectory) -> dict[str, bytes]:
    """Return a motion as a file."""
    return {MOTION: write_json(motion, {})}


def proven(files: dict[str, bytes], result: PlanResult | JobResult) -> str:
    """Add the proof of a planned problem, whose files exist, and return its file's name or the reason for its
    absence."""
    from hdplan.planner.job.proof import prove_job
    from hdplan.planner.proof.proof import prove_planned

    with tempfile.TemporaryDirectory() as folder:
        scene, motion = Path(folder) / f"scene{SCENE}", Path(folder) / f"motion{MOTION}"
        scene.write_bytes(files[SCENE])
        motion.write_bytes(files[MOTION])
        try:
            if isinstance(result, PlanResult):
                files[PROOF] = prove_planned(result, scene, motion).data
            else:
                files[PROOF] = prove_job(scene, motion).data
        except HdplanError as error:
            return str(error).replace(f"{folder}/", "")
    return "written"


def place_of(folder: Path, name: str) -> Path:
    """Return the path of a problem's files, without ending: `/` in its name makes folders, and nothing leads out of
    `folder`."""
    parts = [quote(part, safe=PLAIN_CHARACTERS) for part in name.split("/")]
    return folder.joinpath(*(part if part.strip(".") else part.replace(".", "%2E") or "%2F" for part in parts))


def write_files(folder: Path, name: str, files: Mapping[str, bytes]) -> None:
    """Write a problem's files, each whole or not at all. Raises InputError."""
    if not files:
        return
    place = place_of(folder, name)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{place.parent}: cannot be written ({error.strerror})") from None
    for ending, data in files.items():
        write_output(place.with_name(place.name + ending), data)
