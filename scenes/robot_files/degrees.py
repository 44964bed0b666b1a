"""Angles of a URDF beyond a whole turn: they are used unchanged, and a note asks whether they are in degrees."""

from __future__ import annotations

import contextlib
from xml.etree import ElementTree

from hdplan.scenes.number_text import read_numbers
from hdplan.scenes.poses import in_degrees

PLACES = ("origin", "collision/origin", "inertial/origin")


def angles_in_degrees(root: ElementTree.Element) -> tuple[str, ...]:
    """Return notes on the `rpy` of joints, collision geometry and inertias, once for each link or joint. What is no
    number is refused by `check_urdf`."""
    found = []
    for element in root:
        for origin in (each for place in PLACES for each in element.findall(place)):
            with contextlib.suppress(ValueError):
                if words := in_degrees(read_numbers(origin.get("rpy", "").split())):
                    found.append(f"{element.tag} '{element.get('name')}': origin: rpy: {words}")
    return tuple(dict.fromkeys(found))
