"""Paths of a robot's files: those that a scene names, or those of a robot in the package example-robot-data.

The package holds only data. Its files are found through its installed distribution, so no path is assumed.
"""

from __future__ import annotations

import glob
import os
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_files.urdf_text import ENDINGS
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.values import shorten

DISTRIBUTION = "example-robot-data"


@dataclass(frozen=True)
class RobotFiles:
    """Paths of a robot's description."""

    urdf: Path
    name: str | None  # of the robot, by which its SRDF is found; None where it has none

    @property
    def srdf(self) -> Path | None:
        """SRDF of the robot."""
        return None if self.name is None else _srdf_of(self.urdf, self.name)


@cache
def data_folder() -> Path:
    """Return the folder that contains one folder per robot. Raises InputError if the package is not installed."""
    try:
        package = metadata.distribution(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        raise InputError(f"robot names need the package '{DISTRIBUTION}', which is not installed") from None
    for line in (package.read_text("RECORD") or "").splitlines():
        file, _, _ = line.partition(",")
        if file.endswith(".urdf"):
            location = Path(str(package.locate_file(file)))
            return next(
                parent for parent in location.parents if parent.name == "robots" and parent.parent.name == DISTRIBUTION
            )
    raise InputError(f"the installed package '{DISTRIBUTION}' holds no URDF file")


def library_package_dirs() -> tuple[Path, ...]:
    """Return the folders in which package:// URIs of the library are looked up."""
    robots = data_folder()
    return (robots.parent.parent, robots)


def _srdf_of(urdf: Path, name: str) -> Path | None:
    """Return the SRDF for a URDF: of the same name, or else the one whose name is the longest prefix of the robot's."""
    found = {path.stem: path for path in sorted((urdf.parent.parent / "srdf").glob("*.srdf"))}
    prefixes = [stem for stem in found if name.startswith(stem)]
    best = next((stem for stem in (urdf.stem, name) if stem in found), max(prefixes, key=len, default=None))
    return found[best] if best is not None else None


@cache
def robot_names() -> dict[str, RobotFiles]:
    """Return name -> files of every URDF in the library, sorted by name; some may not load.

    A name is the file's stem without `_robot`. If two folders hold files of that name, the name is the folder's without
    `_description`; if one folder holds both `x.urdf` and `x_robot.urdf`, the larger file is x.
    """
    urdfs = sorted(
        data_folder() / file
        for folder in ("urdf", "robots")
        for file in glob.glob(f"*/{folder}/*.urdf", root_dir=data_folder())
    )
    by_name: dict[str, list[Path]] = {}
    for path in urdfs:
        by_name.setdefault(path.stem.removesuffix("_robot"), []).append(path)
    table: dict[str, RobotFiles] = {}
    for name, paths in by_name.items():
        folders = {path.parent.parent for path in paths}
        for folder in folders:
            own = [path for path in paths if path.parent.parent == folder]
            unique = name if len(folders) == 1 else folder.name.removesuffix("_description")
            best = max(own, key=lambda path: path.stat().st_size)
            table[unique] = RobotFiles(best, unique)
            for other in own:
                if other != best:
                    table[f"{folder.name}/{other.name}"] = RobotFiles(other, None)
    return dict(sorted(table.items()))


def find_robot(name: str) -> RobotFiles:
    """Return the files of a robot by name. Raises InputError with the nearest name."""
    table = robot_names()
    if name not in table:
        if name.lower().endswith(ENDINGS):
            raise InputError(f"robot.name: {shorten(repr(name))} is a file: it goes by urdf, as RobotSpec(urdf=...)")
        raise InputError(
            f"robot.name: unknown robot {shorten(repr(name))}{nearest(name, table, '`hdplan robots` lists them')}"
        )
    return table[name]


def description_of(spec: RobotSpec) -> tuple[str, Path, Path | None, tuple[Path, ...]]:
    """Return name, URDF, SRDF and the folders in which packages are sought first."""
    if spec.name is not None:
        files = find_robot(spec.name)
        return spec.name, files.urdf, spec.srdf or files.srdf, (*spec.package_dirs, *library_package_dirs())
    if spec.urdf is None:
        raise InputError("robot: neither name nor urdf is given")
    urdf = Path(os.path.realpath(spec.urdf))  # unlike Path.resolve, no error for links that lead to each other
    return urdf.stem.removesuffix(".urdf"), urdf, spec.srdf, spec.package_dirs


def source_of(spec: RobotSpec) -> Source:
    """Return the place of a robot's description and the way to read it."""
    _, urdf, _, folders = description_of(spec)
    return Source(urdf, folders, tuple(sorted(spec.xacro_args.items())), spec.base_joints)
