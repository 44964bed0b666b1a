"""The kernel's world for the certificate's fast bounds: its pieces and pairs, and where they are on spans of a motion.

The formulas are those of the kernel (`hdplan.verify.kernel.Motion`), in plain doubles: what they propose is checked by
the kernel before it is written. A span may reach over many rows, other than the certificate's own intervals.
"""

from __future__ import annotations

import functools
from functools import cached_property
from typing import Any

import numpy as np

from hdplan.planner.certificate.exact_proximity import Piece as Shape
from hdplan.planner.certificate.interval_bounds import Bounds
from hdplan.planner.certificate.intervals import Bodies, Body, Intervals, Pairs
from hdplan.planner.certificate.sizes import Sizes
from hdplan.planner.motion.motion_bounds import Chain, Motion
from hdplan.scenes.array_types import Array, Rows
from hdplan.verify.kernel import latest
from hdplan.verify.unknown import chord
from hdplan.verify.world import Piece, World

STRAY_DISTANCE = 1e3  # [m] stated for every body, as the kernel has no bound by travel alone


class Placed(Intervals):
    """The pieces on spans of the motion."""

    @cached_property
    def moved(self) -> Array:
        """The greatest motion of each piece (r,) [m], without its given deviation."""
        return np.asarray(super().moved - STRAY_DISTANCE)


class Spans:
    """The pieces of one world, prepared to be placed on spans of its motion."""

    def __init__(self, world: World, shapes: list[Any]) -> None:
        """Take the pieces, and coal's `shapes` of them."""
        self.world, joints = world, np.array([each.joint for each in world.pieces], dtype=np.int64)
        self.axes = world.axis.mid
        chain = Chain(None, self.axes.copy(), world.turning.copy(), np.roll(world.carried, 1, axis=0))
        bodies = [_body(piece, shape) for piece, shape in zip(world.pieces, shapes, strict=True)]
        self.bodies = Bodies(chain, bodies, lambda q: q, _sizes(world))
        first, second = world.pairs.T.copy()
        a, b = world.carried[joints[first]], world.carried[joints[second]]
        self.pairs = Pairs(first, second, world.within.astype(np.int64), a & ~b, b & ~a)
        self.bounds = Bounds(self.bodies, self.pairs)

    def on(self, low: Array, high: Array) -> Intervals:
        """Return the pieces on spans (k,) of rows."""
        middle, delta, deviation = self._joints(low, high)
        turn, at = self._frames(middle)
        bodies, count = self.bodies, len(low)
        moving = bodies.moving
        joint = bodies.joint[moving] - 1
        rotation = turn[:, joint] @ bodies.rotation[moving]
        origin = (turn[:, joint] @ bodies.origin[moving, :, None])[..., 0] + at[:, joint]
        center = (rotation @ bodies.center[moving, :, None])[..., 0] + origin
        axes, points = (turn[:, :-1] @ self.axes[:, :, None])[..., 0], np.ascontiguousarray(at[:, :-1])
        reach = self._reach(center, joint, axes, points, np.abs(delta) + deviation)
        places = len(bodies.bodies) + count * len(moving)
        still = np.zeros((places, 3))
        stray = Motion(still, still, np.full(places, STRAY_DISTANCE), np.zeros(places))
        standing = (*bodies.standing, np.zeros((len(bodies.bodies), delta.shape[1])))
        rotation, origin, center, reach = (
            np.concatenate([one, two.reshape(-1, *one.shape[1:])])
            for one, two in zip(standing, (rotation, origin, center, reach), strict=True)
        )
        none = np.zeros(count, dtype=np.int64)  # of the certificate's own intervals
        place = rotation, origin, center, reach, axes, points, stray
        times = np.zeros(0) if bodies.sizes is None else latest(self.world.times, np.stack([low, high], axis=1))
        return Placed(bodies, none, low, high - low, delta, deviation, *place, latest=times)

    def _joints(self, low: Array, high: Array) -> tuple[Array, Array, Array]:
        """Return the joints' middles, half their motion and by how much they stray from it (k, n), as the kernel."""
        control = self.world.control.mid
        degree, first = control.shape[1] - 1, np.floor(low).astype(np.int64)
        counts = np.ceil(high).astype(np.int64) - first
        begins = np.cumsum(counts) - counts
        row = np.arange(counts.sum()) - np.repeat(begins - first, counts)
        span = np.repeat(np.arange(len(low)), counts)
        start, end = (np.clip(x[span] - row, 0.0, 1.0)[:, None, None] for x in (low, high))
        made = []
        for i in range(degree + 1):  # blossoms: the control points of each part
            points = control[row]
            for step in range(degree):
                cut = end if step < i else start
                points = points[:, :-1] * (1.0 - cut) + points[:, 1:] * cut
            made.append(points[:, 0])
        part = np.stack(made, axis=1)
        delta = (part[begins + counts - 1, -1] - part[begins, 0]) / 2.0
        place = (row - low[span])[:, None] + start[:, 0] + (end - start)[:, 0] * np.arange(degree + 1) / degree
        over = part - (2.0 * place / (high - low)[span, None] - 1.0)[:, :, None] * delta[span, None]
        most, least = np.maximum.reduceat(over.max(axis=1), begins), np.minimum.reduceat(over.min(axis=1), begins)
        off = 0.0 if self.world.unknown is None else self.world.unknown.joints
        return (most + least) / 2.0, delta, (most - least) / 2.0 + off

    def _frames(self, middle: Array) -> tuple[Array, Array]:
        """Return the joints' rotations (k, n + 1, 3, 3) and origins (k, n + 1, 3); the last ones are the world's."""
        world, (count, n) = self.world, middle.shape
        cos, sin = (x[:, :, None, None] for x in (np.cos(middle), np.sin(middle)))
        still, once, twice = (each.mid for each in world.turns)
        steps = still + sin * once + (1.0 - cos) * twice
        shifts = world.origins.mid + world.along.mid * middle[:, :, None]
        turn, at = np.tile(np.eye(3), (count, n + 1, 1, 1)), np.zeros((count, n + 1, 3))
        for j, joint in enumerate(world.joints):
            before = turn[:, joint.parent]
            turn[:, j] = before @ steps[:, j]
            at[:, j] = (before @ shifts[:, j, :, None])[..., 0] + at[:, joint.parent]
        return turn, at

    def _reach(self, center: Array, joint: Rows, axes: Array, points: Array, most: Array) -> Array:
        """Return the greatest distances of pieces (k, m, n) from the joints' axes."""
        world, moving = self.world, self.bodies.moving
        x = [center[..., i] - points[..., i].T[:, :, None] for i in range(3)]  # each (n, k, m)
        z = [axes[..., i].T[:, :, None] for i in range(3)]
        reach = np.sqrt(sum((x[i - 2] * z[i - 1] - x[i - 1] * z[i - 2]) ** 2 for i in range(3)))
        after, carried = np.zeros(center.shape[:2]), world.carried[joint]
        for j in reversed(range(len(reach))):
            far = reach[j] + self.bodies.radius[moving] + after if world.turning[j] else 1.0
            reach[j] = np.where(carried[:, j], far, 0.0)
            after += most[:, j, None] * reach[j]
        return np.asarray(reach.transpose(1, 2, 0))


def _sizes(world: World) -> Sizes | None:
    """Return a world's uncertainties, in the certificate's form."""
    if (unknown := world.unknown) is None:
        return None
    around, everywhere = np.zeros((len(world.pieces), 3)), np.ones(len(world.pieces), dtype=bool)
    base = float(unknown.base[0]), float(chord(unknown.base[1]))
    own = unknown.shift.copy(), unknown.turn.copy(), unknown.speed.copy(), unknown.lever.copy()
    return Sizes(*own, around, everywhere, unknown.joints.copy(), base, unknown.about.mid.copy())


def _body(piece: Piece, shape: Any) -> Body:
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = piece.pose[0].mid, piece.pose[1].mid
    return Body(piece.name, _shape(piece.corners.tobytes(), piece.sweep.tobytes(), shape), piece.joint + 1, placement)


@functools.lru_cache(maxsize=4096)  # as coal's shapes
def _shape(corners: bytes, sweep: bytes, shape: Any) -> Shape:
    radii = np.frombuffer(sweep)
    return Shape(np.frombuffer(corners).reshape(-1, 3), shape, radii=radii if radii.any() else None)
