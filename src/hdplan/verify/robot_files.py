"""The files of a robot: URDF, SRDF, and the folders of its meshes."""

from __future__ import annotations

import functools
import os
import re
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from .balls import need
from .scene import SECTIONS, word
from .text import Files, listing, mapping, yaml_of

DESCRIPTIONS = (".urdf", ".xacro", ".xml")


@dataclass(frozen=True)
class RobotFiles:
    """URDF and SRDF, and the folders of its meshes."""

    urdf: Path
    srdf: Path | None
    folders: tuple[Path, ...]  # of packages
    folder: Path  # of the file that names the robot

    def mesh(self, address: str, where: str) -> Path:
        """The file of a mesh; where it is looked for does not matter to what is proven, as the two worlds are
        compared."""
        scheme, separator, rest = address.partition("://")
        packaged = bool(separator) and scheme in ("package", "model")
        name = rest.lstrip("/") if packaged else rest or scheme
        inner, beside = name.partition("/")[2], (x / name for x in (self.urdf.parent, self.folder))
        places = (x / y for x in self.folders for y in (name, inner)) if packaged else beside
        found = next((x for x in places if x.is_file()), None)
        need(found, f"{where}: mesh '{name}' is not found")
        return Path(found or "")


def is_name(robot: str) -> bool:
    """True if a robot is given by its name, and not by a file."""
    path = Path(robot)
    return len(path.parts) == 1 and not path.suffix and not path.is_file()


def given_robot(robot: str, files: Files) -> tuple[Any, Path]:
    """The robot section that is given beside a scene, and the folder of its file: by a robot's name, its description,
    or a file that has such a section."""
    path = Path(robot)
    if is_name(robot):
        return {"name": robot}, Path()
    if path.suffix.lower() in DESCRIPTIONS:
        return {"urdf": path.name}, path.absolute().parent
    top = mapping(yaml_of(files.read("robot", path)), robot, SECTIONS)
    need("robot" in top, f"{robot}: has no robot")
    return top["robot"], path.absolute().parent


def find_robot(spec: dict[str, Any], folder: Path) -> RobotFiles:
    """The files of the robot that a section names, which stands in a file of a folder."""
    listed = [Path(x) for x in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if x]
    named = [folder / word(x, "package_dirs") for x in listing(spec.get("package_dirs"), "package_dirs")]
    if "name" in spec:
        need("urdf" not in spec, "robot: either a name or a file is expected")
        library = robot_library()
        urdf, srdf = robot_of(library, word(spec["name"], "robot.name"))
        folders = [*named, library.parent.parent, library, *listed]
    else:
        urdf, srdf = (folder / word(spec.get("urdf"), "robot.urdf")).resolve(), None
        folders = [*named, *urdf.parents, *listed]
    if "srdf" in spec:
        srdf = folder / word(spec["srdf"], "robot.srdf")
    return RobotFiles(urdf, srdf, tuple(folders), folder)


@functools.cache
def robot_library() -> Path:
    """The folder of example-robot-data."""
    package = metadata.distribution("example-robot-data")
    some = re.search(r"^(.*/robots)/.*\.urdf,", package.read_text("RECORD") or "", re.MULTILINE)
    need(some, "robot: its library is not installed")
    return Path(str(package.locate_file(some[1] if some else "")))


@functools.lru_cache(maxsize=256)  # where files are; what they hold is read each time
def robot_of(library: Path, name: str) -> tuple[Path, Path | None]:
    """URDF and SRDF of a robot of example-robot-data, of which a proof must not choose the one it likes. Its name is
    its file's, without `_robot`, or its folder's, without `_description`, where several folders have such a file; of
    two such files in a folder it is the larger one. Its SRDF is that of its name, or of the longest beginning of it.
    Any file goes by FOLDER/FILE, without SRDF."""
    stems, found = dict[str, set[Path]](), list[Path]()
    listed = [x for folder in ("urdf", "robots") for x in library.glob(f"*/{folder}/*.urdf")]
    files = [(x, x.parents[1], x.stem.removesuffix("_robot")) for x in listed]
    for _, folder, stem in files:
        stems.setdefault(stem, set()).add(folder)
    for file, folder, stem in files:
        plain = stem if len(stems[stem]) == 1 else folder.name.removesuffix("_description")
        found += [file] * (name in (plain, f"{folder.name}/{file.name}"))
    need(found and len({x.parents[1] for x in found}) == 1, f"robot: '{name}' is not the name of one robot")
    urdf = max(found, key=lambda x: x.stat().st_size)
    srdfs = {x.stem: x for x in (urdf.parents[1] / "srdf").glob("*.srdf") if "/" not in name}
    begins = max((x for x in srdfs if name.startswith(x)), key=len, default="")
    return urdf, srdfs.get(urdf.stem if urdf.stem in srdfs else begins)
