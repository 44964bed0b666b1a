"""What a scene does not know, in lengths: how much closer two bodies may be in a world within the scene's sizes.

Let x be a point of an obstacle, R its distance from the obstacle's origin, and t a time. It is within

    position + 2 sin(½ orientation) R + speed |t|

of where the scene has it: a turn by an angle moves it by a chord of that. A point of the robot is moved by its joints,
which may be off by p_j: a deviation like those of a curve from its straight line (`motion_bounds`), up to Σ_j p_j ρ_j.
The base may be off besides, by position + 2 sin(½ orientation) times the point's distance from the base's origin. All
of it is taken off the bounds on the distance of two bodies in the scene as it is said to be. It holds for solids that
would lie inside one another, too: let what is unknown grow from nothing, and no surfaces meet on the way there.

Balls about the origin do not turn, so the radius of a ball that sweeps a body is not in its R.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.motion.motion_bounds import Array
from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.tracking import tracking_of_all
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import freeze
from hdplan.scenes.sizes import Calibration, Uncertainty, chord

if TYPE_CHECKING:
    from hdplan.planner.certificate.intervals import Body, Index, Intervals, Pairs

UPWARD = 1.0 + 1e-12  # what is unknown is rounded up


@dataclass(frozen=True, eq=False)
class Sizes:
    """The sizes of one scene, for its g bodies and the m joints of its robot's model."""

    still: Array  # (g,) how far points of each body may be from where they are said to be at time 0 [m]
    speed: Array  # (g,) and how much farther after each second [m/s]
    levers: Array  # (g,) of each body about its obstacle's origin [m]
    joints: Array  # (m,) by how much each joint may be off [rad or m]
    position: float = 0.0  # of the robot's base [m]
    turn: float = 0.0  # of the robot's base: chord of a point, over its distance from the origin
    origin: Array = field(default_factory=lambda: np.zeros(3))  # of the base (3,)

    def __post_init__(self) -> None:
        """Share its arrays read-only."""
        freeze(self)

    @classmethod
    def of(cls, setup: Setup, bodies: Sequence[Body], own: int) -> Sizes | None:
        """Resolve a scene's sizes for bodies, the robot's `own` first; None for a scene that knows all."""
        scene = setup.scene
        given = {each.name: each for each in scene.obstacles if each.uncertainty is not None}
        joints = tracking_of_all(scene, setup.robot)
        if not given and scene.robot.calibration is None and not joints.any():
            return None
        still, speed, levers = np.zeros((3, len(bodies)))
        for g, body in enumerate(bodies[own:], own):
            if (obstacle := given.get(body.name)) is not None:
                levers[g] = lever(body, obstacle)
                parts = lengths(obstacle.uncertainty, float(levers[g]))
                still[g], speed[g] = UPWARD * (parts[0] + parts[1]), UPWARD * parts[2]
        base = scene.robot.calibration or Calibration()
        position, turn = UPWARD * base.position, UPWARD * chord(base.orientation)
        return cls(still, speed, levers, UPWARD * joints, position, turn, np.array(setup.robot.base.position))

    def elsewhere(self, nodes: Intervals, pairs: Pairs, node: Index, pair: Index) -> Array:
        """Return how much closer pairs (i,) of bodies may be on intervals (i,) because the obstacle, or the robot's
        base, is not where it is said to be (i,) [m]."""
        a, b = pairs.a[pair], pairs.b[pair]
        found = self.still[b] + self.speed[b] * nodes.latest[node]
        if self.position or self.turn:
            row = nodes.row(node, a)
            away = np.linalg.norm(nodes.center[row] - self.origin, axis=1) + nodes.bodies.radius[a] + nodes.moved[row]
            found = found + np.where(pairs.group[pair] == 0, self.position + UPWARD * self.turn * away, 0.0)
        return np.asarray(found)

    def at_middle(self, nodes: Intervals, pairs: Pairs, node: Index, pair: Index) -> Array:
        """Return how much closer pairs (i,) may be at the midpoints of intervals (i,) [m], what the joints may be off
        included."""
        there = nodes.instants
        one, other = (there.reach[there.row(node, body[pair])] for body in (pairs.a, pairs.b))
        moves = one * pairs.moves_a[pair] + other * pairs.moves_b[pair]
        return np.asarray(self.elsewhere(there, pairs, node, pair) + UPWARD * (moves @ self.joints))

    def most(self, nodes: Intervals, pairs: Pairs) -> Array:
        """Return a bound (P,) [m] on `elsewhere` for all pairs over all of these intervals."""
        found = self.still[pairs.b] + self.speed[pairs.b] * float(nodes.latest.max())
        if self.position or self.turn:
            links, first = np.unique(pairs.a, return_inverse=True)
            rows = nodes.row(np.arange(len(nodes.interval))[:, None], links)  # (k, links)
            away = np.linalg.norm(nodes.center[rows] - self.origin, axis=2) + nodes.moved[rows]
            away = away.max(axis=0) + nodes.bodies.radius[links]
            found = found + np.where(pairs.group == 0, (self.position + UPWARD * self.turn * away)[first], 0.0)
        return np.asarray(found)


def lengths(uncertainty: Uncertainty | None, lever: float) -> tuple[float, float, float]:
    """Return how far a point so far from an obstacle's origin may be for its position and its turn [m], and its speed
    [m/s]."""
    given = uncertainty or Uncertainty()
    return given.position, chord(given.orientation) * lever, given.speed


def lever(body: Body, obstacle: Obstacle) -> float:
    """Return how far what a ball sweeps to an obstacle's body is from the obstacle's origin at most [m]."""
    piece = body.piece
    own = body.placement if body.obstacle_motion is None else np.eye(4)
    origin = obstacle.pose.position if body.obstacle_motion is None else (0.0, 0.0, 0.0)
    points = piece.vertices @ own[:3, :3].T + own[:3, 3] - np.array(origin)
    if piece.grains is not None:  # balls of their own radii, in a hull swept by the least
        points = piece.grains[:, :3] @ own[:3, :3].T + own[:3, 3] - np.array(origin)
    beyond = piece.disc + (0.0 if piece.radii is None else float(piece.radii.max()))
    return float(np.linalg.norm(points, axis=1).max()) + beyond
