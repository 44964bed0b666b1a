"""Pairs of links in contact at every sampled configuration, and the proof that some of these pairs always touch.

Both are found once for a robot and kept on disk by the content of everything that determines them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.distance.compiled.cache import content_key, load, store
from hdplan.planner.robot.always_touching import always_touching
from hdplan.planner.robot.content import Parts, geometry_content, tree_content
from hdplan.planner.robot.self_pairs import CONTACT_SAMPLES, LIMIT_EXCESS, in_contact
from hdplan.scenes.robot_files.link_pairs import LinkPair

if TYPE_CHECKING:
    from hdplan.planner.robot.robot import Robot

VERSION = "1"  # to be changed with anything that changes which pairs are found, so that old cache entries are not used
FIRST_SAMPLES = 20  # samples at which most pairs are seen apart, in a moment


def lasting_contacts(robot: Robot, pairs: Iterable[LinkPair]) -> tuple[tuple[LinkPair, ...], tuple[LinkPair, ...]]:
    """Return the pairs that touch at each of CONTACT_SAMPLES random configurations (fixed seed), and the pairs among
    these with a proof that they always touch (`always_touching`), up to LIMIT_EXCESS beyond the limits."""
    samples = robot.draw(np.random.default_rng(0), CONTACT_SAMPLES)
    left = in_contact(robot, pairs, samples[:FIRST_SAMPLES])
    if not left:
        return (), ()
    content = _content(robot, left)
    key = None if content is None else content_key(VERSION, *content)
    known = None if key is None else load("lasting_contacts", key, lambda value: _pairs(value, left))
    if known is not None:
        return known
    touch = in_contact(robot, left, samples[FIRST_SAMPLES:])
    always = always_touching(robot, touch, LIMIT_EXCESS)
    if key is not None:
        store("lasting_contacts", key, [touch, always])
    return touch, always


def _pairs(value: Any, known: tuple[LinkPair, ...]) -> tuple[tuple[LinkPair, ...], tuple[LinkPair, ...]]:
    """Return the pairs of an entry. Raises ValueError for other pairs than those that are known."""
    touching, proven = (tuple(known[known.index((a, b))] for a, b in row) for row in value)
    return touching, proven


def _content(robot: Robot, pairs: Iterable[LinkPair]) -> Parts | None:
    """Return the data that determine the result: the tree, the limits, the joints that follow others, the pairs, and
    their links' geometry; None where a geometry is of an unknown kind."""
    model = robot.model
    limits = (robot.lower, robot.upper, model.lowerPositionLimit, model.upperPositionLimit)
    parts: Parts = [*tree_content(model), *(limit.tobytes() for limit in limits)]
    if robot.linkage is not None:
        parts += [robot.linkage.matrix.tobytes(), robot.linkage.offset.tobytes()]
    for link in dict.fromkeys(link for pair in pairs for link in pair):
        items = [geometry_content(robot.collision.geometryObjects[index]) for index in robot.link_geometry[link]]
        for item in items:
            if item is None:
                return None
            parts += item
        parts += [link, str(len(items))]
    return [*parts, *(link for pair in pairs for link in pair)]
