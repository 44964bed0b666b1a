"""A robot's description as URDF, whatever its language: URDF itself, xacro, or MJCF.

File -> the root element of its URDF, the files that it includes, and the pairs of links that it excludes itself.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import read_file
from hdplan.scenes.robot_files.link_pairs import LinkPair
from hdplan.scenes.robot_files.mjcf import Converted, as_urdf
from hdplan.scenes.robot_files.packages import Packages
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_files.xacro_text import expand_xacro
from hdplan.scenes.robot_files.xml_text import parse
from hdplan.scenes.robot_spec import PlanarBase

BASE_JOINTS = ("base_x", "base_y", "base_yaw")  # of a planar base
ENDINGS = (".urdf", ".xacro", ".xml")  # of files that hold a robot
XACRO = ".xacro"
LANGUAGES: dict[str, Callable[[ElementTree.Element, Path], Converted]] = {  # by the root element of their XML
    "mujoco": as_urdf,
}


@dataclass(frozen=True)
class Description:
    """A robot's file as URDF."""

    root: ElementTree.Element
    files: tuple[Path, ...]  # its sources: the file itself, and those that it includes
    excluded: frozenset[LinkPair] = frozenset()  # pairs of links that it says are not to be checked
    notes: tuple[str, ...] = ()  # what was ignored


def read_description(source: Source) -> Description:
    """Read a robot's description, its root link carried by the joints of a mobile base, if there is one.

    Raises InputError for a file that is missing, not XML, or no robot, for what of an MJCF cannot be had as URDF, and
    where xacro cannot be read.
    """
    path = source.urdf
    with naming(f"robot.urdf: {path}"):
        data = read_file(path)
        files: tuple[Path, ...] = (path,)
        if path.suffix.lower() == XACRO:
            data, included = expand_xacro(path, Packages(path, source.package_dirs), dict(source.xacro_args))
            files = (path, *included)
        elif source.xacro_args:
            raise InputError(f"robot.xacro_args: the file is not xacro ({XACRO})")
        root = parse(data, ("robot", *LANGUAGES))
        excluded, notes = frozenset[LinkPair](), tuple[str, ...]()
        if root.tag in LANGUAGES:
            model = LANGUAGES[root.tag](root, path)
            root, excluded, notes, files = model.root, model.excluded, model.notes, (*files, *model.files)
        if source.base_joints is not None:
            _carry(root, source.base_joints)
        return Description(root, files, excluded, notes)


def _carry(root: ElementTree.Element, base: PlanarBase) -> None:
    """Put the joints of a planar base under the root link. URDF wants limits of effort and velocity; 0 stands for none.

    Raises InputError where the description has such joints or links.
    """
    children = {child.get("link") for child in root.findall("joint/child")}
    below = next((link.get("name", "") for link in root.findall("link") if link.get("name") not in children), "")
    steps = (("x", "prismatic", "1 0 0"), ("y", "prismatic", "0 1 0"), ("yaw", "revolute", "0 0 1"))
    links = ("base_origin", "base_at_x", "base_at_y")
    taken = {each.get("name") for tag in ("link", "joint") for each in root.findall(tag)}
    if clash := taken & {*links, *BASE_JOINTS}:
        raise InputError(f"robot.base_joints: the description has a '{min(map(str, clash))}' of its own")
    for parent, child, (axis, kind, along) in zip(links, (*links[1:], below), steps, strict=True):
        ElementTree.SubElement(root, "link", name=parent)
        joint = ElementTree.SubElement(root, "joint", name=f"base_{axis}", type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        ElementTree.SubElement(joint, "axis", xyz=along)
        low, high = getattr(base, axis)
        ElementTree.SubElement(joint, "limit", lower=repr(low), upper=repr(high), effort="0", velocity="0")
