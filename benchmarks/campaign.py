"""Shared by campaigns of random changes: the files of a robot's meshes, and the table of outcomes."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.robot_files.library import library_package_dirs


def meshes_of(urdf: Path) -> dict[str, Path]:
    """The files of a description's collision meshes, by their names there."""
    meshes = ElementTree.parse(urdf).getroot().iterfind("link/collision/geometry/mesh")
    names = dict.fromkeys(mesh.get("filename", "") for mesh in meshes)
    places = {name: [folder / name.partition("://")[2] for folder in library_package_dirs()] for name in names}
    return {name: next(file for file in files if file.is_file()) for name, files in places.items()}


def table(found: Mapping[str, Counter[str]], columns: Sequence[str], what: str = "changed") -> str:
    """Markdown: a row per kind of change, and one for all."""
    rows = {**found, "all": sum(found.values(), Counter[str]())}
    return markdown_text([{what: kind, "cases": x.total(), **{c: x[c] for c in columns}} for kind, x in rows.items()])
