"""The look of a robot: the visuals of its description, for pictures alone.

Nothing is proven about them, so what cannot be drawn of them is noted, and never keeps a robot from being planned.
"""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pinocchio as pin

from hdplan.planner.robot.pin_model import MeshElement, solid_of
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.number_text import read_numbers
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_files.urdf_check import check_body, read_origin
from hdplan.scenes.robot_files.urdf_text import read_description


@dataclass(frozen=True, eq=False)
class Visual:
    """A visual of a link: a mesh or a solid, or why it is neither."""

    link: str
    placement: pin.SE3 = field(default_factory=pin.SE3.Identity)  # in the link's frame
    mesh: MeshElement | None = None
    solid: Any = None  # one of coal's shapes
    color: tuple[float, ...] | None = None  # red, green and blue, each 0 to 1, where the description has one
    failed: str = ""


def read_visuals(source: Source) -> tuple[Visual, ...]:
    """Read all visuals of a robot. Raises InputError for a description that cannot be read at all."""
    root = read_description(source).root
    materials = {str(each.get("name")): each for each in root.findall("material")}
    found = []
    for link in root.findall("link"):
        for element in link.findall("visual"):
            name = link.get("name", "")
            try:
                with naming(f"link '{name}'"):
                    found.append(_visual(name, element, materials))
            except InputError as error:
                found.append(Visual(name, failed=str(error)))
    return tuple(found)


def _visual(link: str, element: ElementTree.Element, materials: Mapping[str, ElementTree.Element]) -> Visual:
    shape = check_body(element, "visual")
    placement, color = pin.SE3(read_origin(element, "visual").matrix), _color(element.find("material"), materials)
    if shape.tag == "mesh":
        return Visual(link, placement, mesh=MeshElement.of(shape, link), color=color)
    return Visual(link, placement, solid=solid_of(shape), color=color)


def _color(
    material: ElementTree.Element | None, materials: Mapping[str, ElementTree.Element]
) -> tuple[float, ...] | None:
    """Return the colour of a material, or that of the robot's material of its name; None where there is none."""
    if material is None:
        return None
    for each in (material, materials.get(material.get("name", ""))):
        color = each.find("color") if each is not None else None
        with contextlib.suppress(ValueError):
            if color is not None and len(rgba := read_numbers(color.get("rgba", "").split())) == 4:
                return rgba[:3]
    return None
