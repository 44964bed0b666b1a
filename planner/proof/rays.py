"""Rays that show what is outside of a divided mesh: proposed here, examined by the kernel's own `Motion.outside`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdplan.planner.proof.planes import COARSE, whole
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import check_time
from hdplan.scenes.once import read_only
from hdplan.verify.kernel import NARROWEST, Motion
from hdplan.verify.world import World

FAR_APART = 8  # rows that are tried first
AROUND = read_only(np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(60, 3))]))  # directions


def rays(world: World) -> Iterator[tuple[int, Array] | None]:
    """Yield, for each entry of `world.outside`, the row and direction (3,) of a ray; None if none was found.

    Where the hulls are apart, one of any two opposite directions will do.
    """
    rows = np.arange(len(world.control.mid))
    rows = rows[np.argsort(rows % max(1, len(rows) // FAR_APART), kind="stable")]
    motions = dict[int, Motion]()
    numbers = {piece.body: i for i, piece in enumerate(world.pieces)}
    for mesh, pieces in world.outside:
        joint, body = world.pieces[numbers[mesh]].joint, pieces[0]
        surface, corners = world.surfaces[mesh], np.concatenate([piece.corners for piece in pieces])
        local = body.pose[0].mid @ corners.mean(axis=0) + body.pose[1].mid
        found = None
        for row in rows.tolist():
            check_time("writing the proof")
            if row not in motions:
                motions[row] = Motion(world, np.array([[row, row + NARROWEST]]))
            turn, at = motions[row].turn.mid[0], motions[row].at.mid[0]
            away = (turn[body.joint] @ local + at[body.joint] - at[joint]) @ turn[joint] - surface[0].mid.mean(axis=0)
            ways = whole(np.concatenate([[away], AROUND]), COARSE)
            found = next(((row, way) for way in ways if motions[row].outside(surface, joint, pieces, way)), None)
            if found:
                break
        yield found
