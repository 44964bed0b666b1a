"""An SRDF for a robot that has none: which pairs of links need no check, as is proven.

Read back beside the description it gives the same pairs as the description alone.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.pin_model import read_model
from hdplan.planner.robot.planned_joints import range_of, with_range
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING, NEIGHBOURS, NEVER_TOUCHING
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_files.description import read_tree
from hdplan.scenes.robot_files.library import description_of, source_of
from hdplan.scenes.robot_spec import RobotSpec

MADE_HERE = "made by hdplan;"  # a comment in each
REASONS = {NEIGHBOURS: "Adjacent", ALWAYS_TOUCHING: "Always", NEVER_TOUCHING: "Never"}  # as MoveIt calls them


def srdf_of(spec: RobotSpec) -> tuple[str, dict[str, int]]:
    """Return the text of an SRDF that excludes pairs of links, and how many for which reason.

    Excluded is what holds whatever joints are planned: neighbours; pairs that are proven always to touch,
    with the joints held that are held by default as well as with all of them moving; pairs that are proven never to
    touch.

    Raises:
        InputError: a robot that cannot be loaded, or that has an SRDF.
    """
    source = source_of(spec)
    name, _, srdf, _ = description_of(spec)
    if srdf is not None:
        raise InputError(f"--srdf: {name} has an SRDF: {srdf}")
    tree = read_tree(source)
    robot = load_robot(spec)
    full, _, _ = read_model(source)
    movable = with_range({joint: range_of(full, joint) for joint in list(map(str, full.names))[1:]}, tree)
    whole = load_robot(replace(spec, group=tuple(movable), locked={}))
    found = {
        pair: REASONS[reason]
        for pair, reason in sorted(whole.unchecked.items())
        if reason in REASONS and pair in robot.unchecked
    }
    root = ElementTree.Element("robot", name=tree.name)
    reasons = "always and never: by proof; adjacent: at one joint"
    root.append(ElementTree.Comment(f" {MADE_HERE} link pairs that are not checked, {reasons} "))
    for (a, b), reason in found.items():
        ElementTree.SubElement(root, "disable_collisions", link1=a, link2=b, reason=reason)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode", xml_declaration=False)
    counts = {reason: list(found.values()).count(reason) for reason in REASONS.values()}
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n', counts
