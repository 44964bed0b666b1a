"""Obstacles that move, as a world writes them: joints that follow the time.

Three of them slide along the world's axes, and each turn has one of its own, the last turn first. `docs/world.md` has
the rule, which the checker's own reading follows, too.
"""

from __future__ import annotations

import itertools
from typing import assert_never

import numpy as np

from hdplan.planner.proof.world_values import Plain, frame, numbers, off
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses

LEAST_TURN = 1e-9  # from one pose to the next; what turns less does not turn

Turn = tuple[Array, list[float], list[float], float]  # axis times angle; at which times what share of it; its bound


def tracks_of(obstacle: Obstacle, first: int, rows: Array) -> tuple[list[Plain], Plain]:
    """Return the joints that carry an obstacle which moves, numbered from `first` on, and its frame in the last one's.
    `rows` are the times of the robot's motion."""
    match motion := obstacle.motion:
        case SteadyMotion():
            times, poses, spin = numbers(rows[[0, -1]]), [obstacle.pose.matrix], np.array(motion.spin)
            places = poses[0][:3, 3] + np.outer(times, motion.velocity)
            turns: list[Turn] = [(spin, times, times, 0.0)] if spin.any() else []
        case TimedPoses():
            times, poses = numbers(motion.times), [pose.matrix for pose in motion.poses]
            places = np.array([pose[:3, 3] for pose in poses])
            turns = _turns(times, [pose[:3, :3] for pose in poses])
        case None:
            raise ValueError(f"{obstacle.name} does not move")
        case _:
            assert_never(motion)
    slides = [("prismatic", way, times, numbers(x), off(x)) for way, x in zip(np.eye(3), places.T, strict=True)]
    every = [*slides, *(("revolute", *turn) for turn in reversed(turns))]
    joints = [
        {
            "name": obstacle.name,
            "parent": first + i - 1 if i else -1,
            "kind": kind,
            "way": numbers(way),
            "times": span,
            "values": values,
            "off": bound,
        }
        for i, (kind, way, span, values, bound) in enumerate(every)
    ]
    return joints, {"joint": first + len(joints) - 1, **frame(poses[0][:3, :3], np.zeros(3))}


def _turns(times: list[float], rotations: list[Array]) -> list[Turn]:
    """Return the turns between rotations at times."""
    found: list[Turn] = []
    for i, (one, two) in enumerate(itertools.pairwise(rotations)):
        change = two @ one.T
        if np.linalg.norm(change - np.eye(3)) <= LEAST_TURN:
            continue
        across = np.array([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]]) / 2.0
        sin = float(np.linalg.norm(across))
        way = across * (np.arctan2(sin, (np.trace(change) - 1.0) / 2.0) / sin)
        found.append((way, times[i : i + 2], [0.0, 1.0], off(way, np.linalg.norm(way) / sin)))
    return found
