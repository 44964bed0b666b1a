"""Clearance along a motion at chosen path parameters, for plots: exact, and by the planner's outer bodies.

Trajectory → for each path parameter the closest places by the real meshes and shapes (exact), and the separation D̃ of
the planner's outer bodies from the obstacles' planes, a lower bound of the exact distance. Lengths in [m], negative in
contact. Nothing is proven between the path parameters: the certificate does that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Place
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.scene import derived

GREATEST_ACTIVATION = 1.0  # [m] the greatest activation distance of the planner's settings
FARTHER, FARTHER_BY = 1.2, 0.01  # D̃ is searched for within the greatest exact distance times this, plus [m]


@dataclass(frozen=True, eq=False)
class Clearances:
    """Distances at k path parameters of a motion [m]."""

    parameter: Array  # (k,) 0 start to 1 goal
    closest: tuple[Place, ...]  # (k,) to obstacles; empty without obstacles
    between_links: Array  # (k,) exact; empty for a robot without pairs of links
    outer: Array  # (k,) D̃ of the planner's bodies to obstacles, inf where none is near; empty without obstacles

    @property
    def to_obstacles(self) -> Array:
        """The exact distance (k,) to obstacles."""
        return np.array([place.distance for place in self.closest])

    @classmethod
    def along(cls, certifier: Certifier, curve: Curve, parameter: Array) -> Clearances:
        """Evaluate a motion, with its joints in the robot's order, at `parameter` (k,); moving obstacles are where they
        are then."""
        positions, times = curve.at_parameter(parameter), curve.time_of(parameter)
        closest, between_links = exact(certifier, positions, times)
        outer = np.empty(0)
        if closest:
            within = max(place.distance for place in closest) * FARTHER + FARTHER_BY
            outer = outer_clearance(certifier.setup, positions, times, max(within, FARTHER_BY))
        return cls(parameter, closest, between_links, outer)


def outer_clearance(setup: Setup, positions: Array, times: Array, within: float) -> Array:
    """Return the least D̃ (k,) [m] of the planner's link bodies and obstacles at configurations (k, n) and times (k,)
    [s].

    Lower bounds of the exact distance, with the bodies, normals and distance of the scene's settings; links that do not
    move are ignored. Pairs farther apart than `within` [m], or GREATEST_ACTIVATION, are left out, for speed: inf where
    no pair is left.
    """
    from hdplan.planner.build import problem_of  # with the planner

    scene = setup.scene
    settings = replace(scene.planner, clearance=0.0, activation=min(within, GREATEST_ACTIVATION), swept=False)
    problem = problem_of(Setup.of(derived(scene, planner=settings), setup.robot))
    least = np.full(len(positions), np.inf)
    kinematics = problem.placed(positions)
    for term in (problem.terms.obstacles, problem.terms.moving_obstacles):
        if term:
            inside = term.inside(term.met(kinematics, times))
            margin = term.pairs.margins[term.pairs.halfspace_body[inside.pair]]  # `within` + own clearance
            np.minimum.at(least, inside.sample, margin + inside.separation)
    return least


def exact(certifier: Certifier, positions: Array, times: Array) -> tuple[tuple[Place, ...], Array]:
    """Return the closest places to obstacles and the distances between links at configurations (k, n) and times (k,)
    [s], each empty if there are none."""
    to_obstacles, between_links = zip(*certifier.nearest_along(positions, times), strict=True)
    return (
        tuple(place for place in to_obstacles if place),
        np.array([place.distance for place in between_links if place]),
    )
