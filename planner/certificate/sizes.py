"""The unknown of a scene, in lengths: how much closer two bodies may be in a world within the scene's sizes.

An obstacle is off by a shift of at most its `position`, a turn about its origin by at most its `orientation` θ, and
`speed` times the time t more. A turn moves a point by a chord, 2 sin(½ θ) times its distance from the origin. To turn
the obstacle is to turn the link the other way, so of obstacle and link the one whose points are closer to that origin
counts: with R the smaller of the two greatest distances, the two may be closer by

    position + 2 sin(½ θ) R + speed |t|.

The robot's base is off by a shift and a turn about its origin, to which the same applies, of the obstacle as it may
have turned itself. The joints may be off by p_j:
a deviation like that of a curve from its straight line (`motion_bounds`), up to Σ_j p_j ρ_j. All of it is subtracted
from the bounds on the distance of two bodies in the nominal scene. Nor is one solid within another: let what is unknown
grow from nothing to what it is, and no surfaces meet on the way.

Balls about the origin do not turn, so the radius of a ball that sweeps a body is not in its R.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.tracking import tracking_of_all
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.sizes import Calibration, Uncertainty, chord

if TYPE_CHECKING:
    from hdplan.planner.certificate.intervals import Body, Intervals, Pairs

ROUND_UP = 1.0 + 1e-12  # what is unknown is rounded up
FIELDS = (  # of a scene, in the order of what they cost
    *(f"obstacles[].uncertainty.{name}" for name in ("position", "orientation", "speed")),
    *(f"robot.calibration.{name}" for name in ("position", "orientation")),
    "robot.tracking.position",
)


@dataclass(frozen=True, eq=False)
class Sizes(ReadOnly):
    """The sizes of one scene, for its g bodies and the m joints of its robot's model."""

    position: Array  # (g,) how far each obstacle's body may be shifted [m]
    turn: Array  # (g,) the chord of its turn, over the distance from its origin
    speed: Array  # (g,) [m/s]
    lever: Array  # (g,) greatest distance of its points from its obstacle's origin [m]
    origin: Array  # (g, 3) of its obstacle, in the world, if that stands
    framed: Mask  # (g,) whether the body's frame is its obstacle's own, whose origin is then there
    joints: Array  # (m,) by how much each joint may be off [rad or m]
    base: tuple[float, float]  # shift [m] and chord of the robot's base
    stand: Array  # (3,) where the base is

    @classmethod
    def of(cls, setup: Setup, bodies: Sequence[Body], own: int) -> Sizes | None:
        """Resolve a scene's sizes for bodies, the robot's `own` first; None for a scene that knows all."""
        scene = setup.scene
        given = {each.name: each for each in scene.obstacles if each.uncertainty is not None}
        joints, base = tracking_of_all(scene, setup.robot), scene.robot.calibration or Calibration()
        if not given and base == Calibration() and not joints.any():
            return None
        position, turn, speed, levers = np.zeros((4, len(bodies)))
        origin = np.zeros((len(bodies), 3))
        for g, body in enumerate(bodies[own:], own):
            if (obstacle := given.get(body.name)) is not None and (sizes := obstacle.uncertainty) is not None:
                position[g], turn[g], speed[g] = sizes.position, chord(sizes.orientation), sizes.speed
                levers[g], origin[g] = lever(body, obstacle), obstacle.pose.position
        about = ROUND_UP * base.position, ROUND_UP * chord(base.orientation)
        stand = np.array(setup.robot.base.position)
        framed = np.array([body.obstacle_motion is not None for body in bodies], dtype=bool)
        return cls(position, ROUND_UP * turn, speed, ROUND_UP * levers, origin, framed, ROUND_UP * joints, about, stand)

    def elsewhere(self, nodes: Intervals, pairs: Pairs, node: Rows, pair: Rows) -> Array:
        """Return by how much pairs (i,) of bodies may be closer on intervals (i,) because the obstacle, or the robot's
        base, is not at its nominal pose (i,) [m]."""
        return np.asarray(ROUND_UP * self._shares(nodes, pairs, node, pair).sum(axis=0))

    def at_middle(self, nodes: Intervals, pairs: Pairs, node: Rows, pair: Rows) -> Array:
        """Return by how much pairs (i,) may be closer at the midpoints of intervals (i,) [m], errors of the joints
        included: the share of each of `FIELDS`, (6, i)."""
        there = nodes.instants
        one, other = (there.reach[there.row(node, body[pair])] for body in (pairs.a, pairs.b))
        moves = one * pairs.moves_a[pair] + other * pairs.moves_b[pair]
        return np.concatenate([self._shares(there, pairs, node, pair), [ROUND_UP * (moves @ self.joints)]])

    def _shares(self, nodes: Intervals, pairs: Pairs, node: Rows, pair: Rows) -> Array:
        """Return the summands of `elsewhere` (5, i) [m]."""
        a, b = pairs.a[pair], pairs.b[pair]
        one, other = nodes.row(node, a), nodes.row(node, b)
        moved = nodes.moved[one] + nodes.moved[other]
        origin = np.where(self.framed[b, None], nodes.origin[other], self.origin[b])
        lever = np.minimum(self.lever[b], _away(nodes, a, one, origin) + moved)
        found = [self.position[b], self.turn[b] * lever, self.speed[b] * nodes.latest[node]]
        if any(self.base):
            beside = _away(nodes, b, other, self.stand) + self.turn[b] * self.lever[b]  # as it may be turned itself
            lever = np.minimum(_away(nodes, a, one, self.stand), beside) + moved
            outside = pairs.group[pair] == 0
            found += [np.where(outside, self.base[0], 0.0), np.where(outside, self.base[1] * lever, 0.0)]
        return np.stack([*found, *np.zeros((5 - len(found), len(pair)))])

    def most(self, nodes: Intervals, pairs: Pairs) -> Array:
        """Return a bound (P,) [m] on `elsewhere` for all pairs over all of these intervals."""
        found = (self.position + ROUND_UP * self.turn * self.lever + self.speed * float(nodes.latest.max()))[pairs.b]
        if any(self.base):
            links, first = np.unique(pairs.a, return_inverse=True)
            rows = nodes.row(np.arange(len(nodes.interval))[:, None], links)  # (k, links)
            away = (np.linalg.norm(nodes.center[rows] - self.stand, axis=2) + nodes.moved[rows]).max(axis=0)
            base = self.base[0] + ROUND_UP * self.base[1] * (away + nodes.bodies.radius[links])
            found = found + np.where(pairs.group == 0, base[first], 0.0)
        return np.asarray(ROUND_UP * found)


def _away(nodes: Intervals, body: Rows, row: Rows, origin: Array) -> Array:
    """Return the greatest distance of points of bodies (i,), at these rows of their places, from origins [m]."""
    return np.asarray(np.linalg.norm(nodes.center[row] - origin, axis=1) + nodes.bodies.radius[body])


def lengths(uncertainty: Uncertainty | None, lever: float) -> tuple[float, float, float]:
    """Return the displacements by an obstacle's position and turn [m] of a point at `lever` from its origin, and its
    speed [m/s]."""
    given = uncertainty or Uncertainty()
    return given.position, chord(given.orientation) * lever, given.speed


def lever(body: Body, obstacle: Obstacle) -> float:
    """Return the greatest distance from an obstacle's origin to the sweep of a ball towards the obstacle's body [m]."""
    piece = body.piece
    own = body.placement if body.obstacle_motion is None else np.eye(4)
    origin = obstacle.pose.position if body.obstacle_motion is None else (0.0, 0.0, 0.0)
    points = piece.vertices @ own[:3, :3].T + own[:3, 3] - np.array(origin)
    if piece.grains is not None:  # balls of their own radii, in a hull swept by the least
        points = piece.grains[:, :3] @ own[:3, :3].T + own[:3, 3] - np.array(origin)
    beyond = piece.disc + (0.0 if piece.radii is None else float(piece.radii.max()))
    return float(np.linalg.norm(points, axis=1).max()) + beyond
