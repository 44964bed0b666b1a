"""The collision model of a robot, independent of the scene: kinematics, outer bodies, and the pairs of them to keep
apart.

Robot -> `CollisionModel`, made once per robot in a process and reused by the next plan with the same robot.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.cache import content_key, store
from hdplan.planner.collision.broad_phase import body_pairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_link_part
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.link_bodies import LinkBody, link_bodies
from hdplan.planner.collision.link_parts import link_parts
from hdplan.planner.collision.reach import Reach, reach_of
from hdplan.planner.collision.shipped_bodies import known_result
from hdplan.planner.kinematics.forward import Kinematics, kinematics_of
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.once import made_once, read_only

VERSION = "2"  # to be changed with anything that changes which bodies overlap, so that old cache entries are not used
TRIALS = 200  # random configurations at which pairs of outer bodies are tested for overlap
GAMMA, LENGTH = 2, 1e-3  # of the distance that tests them; its sign, which alone counts here, depends on neither
SELF_ACTIVATION = 0.005  # [m] links of one arm are close by design: their penalty sets in late
# share of TRIALS in which two links' outer bodies may overlap before they are left to the certificate
OVERLAP_SHARE = 0.5

NO_POINTS = read_only(np.empty((0, 3)))

BodyPair = tuple[int, int]  # rows of CollisionModel.bodies: the one that gives vertices, the one that gives planes
LinkPair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """Everything about a robot that does not depend on the scene around it."""

    kinematics: Kinematics
    bodies: tuple[LinkBody, ...]  # the links' outer bodies, from base to tip
    parts: tuple[LinkBody, ...]  # the hull of what each encloses of its link, or itself where that is not known
    planes: tuple[HalfspaceBody, ...]  # around the same, for the second side of a pair
    reach: tuple[Reach, ...]  # balls that they never leave
    self_pairs: tuple[BodyPair, ...]  # to be kept apart
    distances_kept: tuple[float, ...]  # [m] proven for each of them within the joint limits; 0 where none is
    unresolved: tuple[LinkPair, ...]  # link pairs left to the certificate, as their outer bodies overlap anyway


@made_once(8)
def collision_model_of(robot: Robot, geometry: str, planes: str) -> CollisionModel:
    """Return the collision model of a robot with the bodies and planes of these settings: one object for equal
    arguments."""
    kinematics, bodies = kinematics_of(robot), link_bodies(robot, geometry)
    parts = _parts(robot, bodies, geometry)
    enclosed = tuple(_enclosed(body, part, planes) for body, part in zip(bodies, parts, strict=True))
    reach = tuple(reach_of(robot.unfolded, body.joint, body.body) for body in bodies)
    pairs, unresolved = _separable_pairs(robot, kinematics, bodies, enclosed)
    kept = _distances_kept(robot, kinematics, bodies, enclosed, pairs)
    return CollisionModel(kinematics, bodies, parts, enclosed, reach, pairs, kept, unresolved)


def _parts(robot: Robot, bodies: tuple[LinkBody, ...], geometry: str) -> tuple[LinkBody, ...]:
    """Part of its link in each body. Only the corners of its hull are known, which suffice."""
    found: list[LinkBody] = []
    for link, own in itertools.groupby(bodies, lambda body: body.link):
        group = list(own)
        parts = link_parts(robot, link, geometry) or (NO_POINTS,) * len(group)
        for body, part in zip(group, parts, strict=True):
            hull = ConvexBody(part, NO_POINTS, NO_POINTS, np.empty(0)) if len(part) else body.body
            found.append(LinkBody(link, body.joint, hull))
    return tuple(found)


def _enclosed(body: LinkBody, part: LinkBody, planes: str) -> HalfspaceBody:
    """By planes what a body encloses of its link."""
    corners = NO_POINTS if part.body is body.body else part.body.vertices
    return from_link_part(body.link, body.joint, body.body, corners, planes)


def _distances_kept(
    robot: Robot,
    kinematics: Kinematics,
    bodies: tuple[LinkBody, ...],
    planes: tuple[HalfspaceBody, ...],
    pairs: tuple[BodyPair, ...],
) -> tuple[float, ...]:
    """The distances proven for each pair; those of the links first, which do not depend on held objects."""
    if not pairs:
        return ()
    from hdplan.planner.collision.separation_bounds import distances_kept

    held = {attached.name for attached in robot.attached}
    with_held = [not held.isdisjoint((bodies[a].link, bodies[b].link)) for a, b in pairs]
    result = np.zeros(len(pairs))
    for group in (np.flatnonzero(~np.array(with_held, dtype=bool)), np.flatnonzero(with_held)):
        chosen = [pairs[row] for row in group]
        result[group] = distances_kept(robot.unfolded, kinematics, bodies, planes, chosen, SELF_ACTIVATION)
    return tuple(result.tolist())


def _separable_pairs(
    robot: Robot, kinematics: Kinematics, bodies: tuple[LinkBody, ...], planes: tuple[HalfspaceBody, ...]
) -> tuple[tuple[BodyPair, ...], tuple[LinkPair, ...]]:
    """Body pairs of the robot's self pairs, and the link pairs whose outer bodies overlap so often that they would
    mislead."""
    of_link: dict[str, list[int]] = {}
    for index, body in enumerate(bodies):
        of_link.setdefault(body.link, []).append(index)
    pairs = []
    for a, b in robot.self_pairs:
        for i, j in itertools.product(of_link.get(a, []), of_link.get(b, [])):
            # the body with fewer vertices is the vertex side: vertices cost time, planes do not
            fewer, more = sorted((i, j), key=lambda index: len(bodies[index].body.vertices))
            pairs.append((fewer, more, a, b))
    if not pairs:
        return (), ()
    unresolved = _often_overlapping(robot, kinematics, bodies, planes, pairs)
    return tuple((i, j) for i, j, a, b in pairs if (a, b) not in unresolved), unresolved


def _often_overlapping(
    robot: Robot,
    kinematics: Kinematics,
    bodies: tuple[LinkBody, ...],
    planes: tuple[HalfspaceBody, ...],
    pairs: list[tuple[int, int, str, str]],
) -> tuple[LinkPair, ...]:
    """The links whose bodies, of these pairs, overlap in more than OVERLAP_SHARE of TRIALS; cached on disk by
    content."""
    from hdplan.planner.collision.separation_bounds import content_of

    rows, names = [(i, j) for i, j, _, _ in pairs], [(a, b) for _, _, a, b in pairs]
    key = content_key(VERSION, *content_of(robot, bodies, rows), *(name for pair in names for name in pair))
    known = known_result("overlaps", key, lambda value: tuple(names[names.index((a, b))] for a, b in value))
    if known is not None:
        return known
    assembled = body_pairs(bodies, planes, rows, 0.0, kinematics.supports)
    drawn = kinematics.evaluate(robot.expand(robot.draw(np.random.default_rng(0), TRIALS)))
    sample, pair = assembled.close(drawn)
    distance, _, _ = HdsdfPairs(assembled, GAMMA, LENGTH)(drawn, sample, pair)
    overlaps: dict[LinkPair, set[int]] = {}
    for s, p in zip(sample[distance < 0].tolist(), pair[distance < 0].tolist(), strict=True):
        overlaps.setdefault(names[p], set()).add(s)
    unresolved = tuple(links for links, seen in overlaps.items() if len(seen) > OVERLAP_SHARE * TRIALS)
    store("overlaps", key, unresolved)
    return unresolved
