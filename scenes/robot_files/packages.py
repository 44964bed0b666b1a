"""ROS packages: the folders behind `$(find pkg)` in xacro and `package://pkg/..` in URDF, found without ROS.

Looked at are, in this order: the folders that are named (`robot.package_dirs`); those around the description, upward;
those of ROS (ROS_PACKAGE_PATH, AMENT_PREFIX_PATH); and the neighbours of the description's own package, as in a
workspace (src/*/package.xml, src/*/*/package.xml). A package is a folder whose package.xml has its name, or one of its
name, preferably not within another package.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

from hdplan.scenes.errors import InputError, listed

PACKAGE_FILE = "package.xml"
IGNORED = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")  # files that tell ROS to pass over a folder
OF_ROS = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
LEVELS = 3  # above a description's own package at which its neighbours are sought
SCHEMES = ("package", "model")  # of addresses in a package


class Packages:
    """The packages that one description may name. Made again each time it is read, so that nothing is remembered."""

    def __init__(self, description: Path, folders: tuple[Path, ...]) -> None:
        """Take the description's file and the folders that are examined first."""
        self.description, self.folders = Path(os.path.realpath(description)), folders
        self._found: dict[str, Path | None] = {}

    def find(self, name: str) -> Path:
        """Return the folder of a package. Raises InputError, with the folders that were searched."""
        if name not in self._found:
            self._found[name] = self._look_for(name)
        found = self._found[name]
        if found is None:
            around = self._own or self.description.parent
            places = [*map(str, self.folders), f"above and beside {around}", *map(str, _of_ros())]
            raise InputError(
                f"package '{name}' is not found in {listed(places)}; robot.package_dirs: [folder, ..] names more"
            )
        return found

    def file(self, address: str) -> Path:
        """Return the file of an address: package:// and model:// lead to a package, file:// is a full path, and any
        other is relative to the description's folder or else the working folder. Raises InputError where there is
        none."""
        scheme, separator, rest = address.partition("://")
        if not separator or scheme == "file":
            file = Path(rest or address)
            return next((each for each in (self.description.parent / file, file) if os.path.exists(each)), file)
        if scheme not in SCHEMES:
            raise InputError(f"mesh '{address}': '{scheme}://' is not known (allowed: package://, model://, file://)")
        name, _, below = rest.lstrip("/").partition("/")
        beside = [folder / name for folder in (*self.folders, *self.description.parents)]
        if not below and (alone := next(filter(os.path.exists, beside), None)):
            return alone  # without a package, as tools that know none write them
        try:
            file = self.find(name) / below.lstrip("/")
        except InputError as error:
            raise InputError(f"mesh '{address}': {error}") from None
        if not os.path.exists(file):
            raise InputError(f"mesh '{address}': no such file in the package, {file.parent}")
        return file

    @property
    def _own(self) -> Path | None:
        """The folder of the description's own package."""
        return next((folder for folder in self.description.parents if os.path.isfile(folder / PACKAGE_FILE)), None)

    def _look_for(self, name: str) -> Path | None:
        if not name or name in (os.curdir, os.pardir) or "\0" in name:
            return None
        upward = list(self.description.parents)
        outside = upward if self._own is None else upward[upward.index(self._own) + 1 :]
        nearest = _first(upward, name, named=True) if self._own else None
        return (
            _first(self.folders, name)
            or nearest
            or _first(outside, name)  # folders within a package are none as long as there is another
            or _first(_of_ros(), name)
            or self._neighbour(name)
            or _first(upward, name)
        )

    def _neighbour(self, name: str) -> Path | None:
        """Return the package of that name near the description's own. Raises InputError where there are two."""
        if self._own is None:
            return None
        for above in list(self._own.parents)[:LEVELS]:
            found = [folder for folder in _packages_below(above) if _name(folder) == name]
            if len(found) > 1:
                raise InputError(
                    f"package '{name}' is in two folders, {found[0]} and {found[1]}; robot.package_dirs says which"
                )
            if found:
                return found[0]
        return None


def _packages_below(folder: Path) -> Iterator[Path]:
    """Return the packages one and two levels below a folder, without those that are marked for ROS to skip."""
    for pattern in (f"*/{PACKAGE_FILE}", f"*/*/{PACKAGE_FILE}"):
        for about in sorted(folder.glob(pattern)):
            between = about.relative_to(folder).parents
            if not any((folder / each / mark).exists() for each in between for mark in IGNORED):
                yield about.parent


def _first(folders: Iterator[Path] | list[Path] | tuple[Path, ...], name: str, named: bool = False) -> Path | None:
    """Return the first of the folders that is the package, or holds it. `named`: its package.xml must have the name."""
    for folder in folders:
        if _name(folder) == name:
            return folder
        inside = folder / name
        if os.path.isdir(inside) and (not named or _name(inside) == name):
            return inside
    return None


def _name(folder: Path) -> str | None:
    """Return a package's name as its package.xml has it; None where there is no such file, or it does not say."""
    try:
        name = ElementTree.parse(folder / PACKAGE_FILE).getroot().findtext("name")
    except (OSError, ValueError, LookupError, ElementTree.ParseError):
        return None
    return (name or "").strip() or None


def _of_ros() -> list[Path]:
    """Return the folders in which ROS keeps packages."""
    ros, ament = ([Path(word) for word in os.environ.get(name, "").split(os.pathsep) if word] for name in OF_ROS)
    return [*ros, *(folder / "share" for folder in ament)]
