"""The pairs of link bodies and convex pieces of obstacles that are compared, and those of two link bodies.

An obstacle stands in the world, or is carried by a frame of its own, one more joint after the robot's; what is proven
of where it stands holds in the former case alone. Pairs (P, 2) are rows of link body and piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hdplan.planner.collision.collision_model import BodyPair, CollisionModel
from hdplan.planner.collision.convex_pieces import MOST_SECONDS
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_obstacle
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose


def pairs_within_reach(model: CollisionModel, pieces: Sequence[HalfspaceBody], margins: Array) -> Rows:
    """Return the pairs of moving link bodies with standing pieces, enlarged by margins (B,) [m], that can meet within
    the joint limits."""
    boxes = np.array([piece.box for piece in pieces]).reshape(-1, 4, 4)
    half_sizes = np.array([piece.half_size for piece in pieces]).reshape(-1, 3) + margins[:, None]
    met = [np.flatnonzero(reach.meets(boxes, half_sizes)) for reach in model.reach]
    found = [np.column_stack([np.full(len(b), a), b]) for a, b in enumerate(met) if model.bodies[a].joint > 0]
    return np.concatenate([np.empty((0, 2), np.int64), *found])


def all_pairs(bodies: Sequence[LinkBody], pieces: range) -> Rows:
    """Return the pairs of every moving link body with every one of these pieces, which may be anywhere."""
    pairs = [(a, b) for a, body in enumerate(bodies) if body.joint > 0 for b in pieces]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def carried_pieces(
    obstacle: Obstacle, joint: int, planes: str, seconds: float = MOST_SECONDS, closely: bool = False
) -> tuple[tuple[HalfspaceBody, ...], tuple[str, ...]]:
    """Enclose an obstacle in its own frame, which `joint` carries; otherwise as `from_obstacle`."""
    pieces, words = from_obstacle(replace(obstacle, pose=Pose(), motion=None), planes, seconds, closely)
    return tuple(replace(piece, joint=joint) for piece in pieces), words


def with_frames(supports: Mask, frames: int) -> Mask:
    """Return the coordinates that move joints, (nj, n), and then frames, which none moves."""
    return np.vstack([supports, np.zeros((frames, supports.shape[1]), dtype=np.bool_)])


def pairs_of_links(model: CollisionModel, margin: float) -> tuple[tuple[BodyPair, ...], tuple[BodyPair, ...]]:
    """Return the pairs of links that are compared, and those that are proven to keep a margin [m]."""
    found = zip(model.self_pairs, model.distances_kept, strict=True)
    kept = [(pair, distance > margin) for pair, distance in found]
    return tuple(pair for pair, proven in kept if not proven), tuple(pair for pair, proven in kept if proven)
