"""A scene, a motion through it, its proof and its page as one archive: after unpacking it, anybody can plan, check and
view the same things.

Everything in it is about the files in it: they are written, read again, certified and proven before they are packed.
"""

from __future__ import annotations

import io
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.page.recorded_page import page_of
from hdplan.planner.proof.proof import prove
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import own_fields
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.scenes.yaml_format.writer import scene_text

MOTION, PROOF, PAGE, NOTE, MESHES = "motion.json", "motion.proof", "page.html", "README.txt", "meshes"
WHEN = (1980, 1, 1, 0, 0, 0)  # of every file, so that the same content is the same archive
WORDS = """{title}
{verdict}

{page}      shows it in any browser, offline
{scene}     the scene, {motion} the motion, {proof} the reasons why it is free

  hdplan verify {scene} {motion} {proof}     checks the proof
  hdplan view {scene} {motion} --proof {proof}     shows its planes
"""
OWN_ROBOT = "\nThe robot's own files are not packed: {urdf} has to be where it was.\n"

Save = Callable[[Path, Certificate], None]


@dataclass(frozen=True)
class Archive:
    """A zip file's content, and the verdict on its proof."""

    data: bytes
    text: str


def archive(scene: Scene, trajectory: Trajectory, save: Save | None = None) -> Archive:
    """Pack a scene and a certified motion with their proof and page. `save` writes the motion's file with more than
    the motion. The files of a robot that is not of the library stay where they are, which is noted.

    Raises InputError for a scene or motion that cannot be read again or proven; NotProvenError for a motion that is not
    certified in the scene that is written.
    """
    with tempfile.TemporaryDirectory(prefix="hdplan-archive-") as name:
        folder = Path(name)
        try:
            return _packed(folder, scene, trajectory, save)
        except HdplanError as error:
            raise type(error)(str(error).replace(f"{folder}/", "")) from None
        except OSError as error:  # a full disk, or a mesh that is gone
            raise InputError(f"{error.filename}: {error.strerror}") from None


def _packed(folder: Path, scene: Scene, trajectory: Trajectory, save: Save | None) -> Archive:
    name = re.sub(r"[^\w.-]", "_", scene.name).lstrip(".") or "scene"
    files = folder / f"{name}.yaml", folder / MOTION
    files[0].write_text(scene_text(_beside(scene, folder / MESHES)).replace(f"{folder}/", ""), encoding="utf-8")
    setup = Setup.of(load_scene(files[0]))
    certificate = Certifier(setup).certify(trajectory)
    if save is None:
        trajectory.save(files[1])
    else:
        save(files[1], certificate)
    read = Trajectory.load(files[1])
    proof = prove(*files)
    (folder / PROOF).write_bytes(proof.data)
    planes = ReadProof(*files, proof.data)
    motion = ShownMotion.of(MOTION.partition(".")[0], read, Certifier(setup), proof.certificate)
    page = page_of(setup, [motion], proof=planes)
    (folder / PAGE).write_text(page.html, encoding="utf-8")
    names = {"page": PAGE, "scene": files[0].name, "motion": MOTION, "proof": PROOF}
    note = WORDS.format(title=page.title, verdict=proof.certificate.text, **names)
    if scene.robot.urdf is not None:
        note += OWN_ROBOT.format(urdf=scene.robot.urdf)
    (folder / NOTE).write_text(note, encoding="utf-8")
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as made:
        for file in sorted(path for path in folder.rglob("*") if path.is_file()):
            entry = zipfile.ZipInfo(f"{name}/{file.relative_to(folder).as_posix()}", WHEN)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            made.writestr(entry, file.read_bytes())
    return Archive(packed.getvalue(), proof.certificate.text)


def _beside(scene: Scene, folder: Path) -> Scene:
    """Return a scene whose obstacles' and held objects' files lie in a new folder, each under a name of its own: proofs
    name meshes with the folder in which they are, and the archive's own may be called anything."""
    copies: dict[Path, Path] = {}

    def copied(file: Path) -> Path:
        if file not in copies:
            taken = {path.name for path in copies.values()}
            names = (file.name, *(f"{file.stem}_{number}{file.suffix}" for number in range(2, len(copies) + 3)))
            copies[file] = folder / next(name for name in names if name not in taken)
            folder.mkdir(exist_ok=True)
            shutil.copyfile(file, copies[file])
        return copies[file]

    def with_copies(each: Any) -> Any:
        files = {key: copied(value) for key, value in own_fields(each.shape).items() if isinstance(value, Path)}
        return replace(each, shape=replace(each.shape, **files)) if files else each

    return replace(
        scene, obstacles=tuple(map(with_copies, scene.obstacles)), attached=tuple(map(with_copies, scene.attached))
    )
