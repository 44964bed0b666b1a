"""The arm in the corridor, drawn: where it enters and at its target (the paper's Figure 4), and the witness points of
the exact distance at two moments of the Euclidean run, between which they jump (Figure 5)."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import coal
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from hdplan.distance.baselines.coal import coal_hull
from hdplan.distance.bodies import ConvexBody
from hdplan.planner.collision.reach import reach_of
from hdplan.planner.kinematics.forward import Kinematics, kinematics_of
from hdplan.planner.pictures.style import GOAL, RC, START
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.corridor_experiment import CRITICAL_PHASE, WALLS, Outcome, corridor_scene, link_boxes
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy

SNAPSHOT_INTERVAL = 0.04  # [s] between the two moments, as in the paper
WITNESSES = ("#d0128e", "#00a8c6")  # on the robot, on the wall


def arm_sheet(outcome: Outcome) -> Figure:
    """Return the figure of the robot on its way, and where it reaches its target, or its run ends."""
    run, last = outcome.run, len(outcome.run.positions) - 1
    there = last if outcome.reached is None else min(round(outcome.reached / run.period), last)
    rows = (there // 2, there)
    moments = [(f"{row * run.period:.1f} s", run.positions[row], np.empty((0, 3))) for row in rows]
    return _sheet(f"The Panda of boxes in the corridor: {outcome.variant.name}", moments)


def witness_sheet(outcome: Outcome) -> Figure:
    """Return the figure of the two moments of the critical phase, SNAPSHOT_INTERVAL, between which the witness point on
    the robot moves farthest while the same two boxes are the nearest."""
    run, span = outcome.run, round(SNAPSHOT_INTERVAL / outcome.run.period)
    count = min(round(CRITICAL_PHASE / run.period), len(run.positions))
    found = [witnesses(q) for q in run.positions[:count]]
    pairs = [(before, after) for before, after in zip(found, found[span:], strict=False)]
    ways = [float(np.linalg.norm(b.points[0] - a.points[0])) if a.pair == b.pair else 0.0 for a, b in pairs]
    k = int(np.argmax(ways))
    rows = (k, k + span)
    moments = [(f"{row * run.period:.2f} s", run.positions[row], found[row].points) for row in rows]
    within = f"Within {1e3 * SNAPSHOT_INTERVAL:.0f} ms"
    return _sheet(f"{within} the witness point on the robot moves by {1e3 * ways[k]:.0f} mm", moments)


class Witnesses(NamedTuple):
    """The nearest points of robot and walls."""

    pair: tuple[int, int]  # box of the robot, wall
    points: Array  # (2, 3) on the robot, and on the wall


def witnesses(q: Array) -> Witnesses:
    """Return the nearest points of the links' boxes and the walls at a configuration (n,)."""
    state = _kinematics().evaluate(q[None])
    least, found = np.inf, Witnesses((-1, -1), np.empty((2, 3)))
    walls = list(WALLS.values())
    for i, j in _pairs():
        joint, (centre, sides) = link_boxes()[i].joint, walls[j]
        link = coal.Transform3s(state.rotations[0, joint], state.translations[0, joint])
        result, wall = coal.DistanceResult(), coal.Transform3s(np.eye(3), np.array(centre))
        distance = coal.distance(_hulls()[i], link, coal.Box(*sides), wall, coal.DistanceRequest(), result)
        if distance < least:
            points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
            least, found = distance, Witnesses((i, j), points)
    return found


@functools.cache
def _pairs() -> tuple[tuple[int, int], ...]:
    """Return the boxes of the links with the walls that they may touch, as the controller has them."""
    robot, found = Setup.of(corridor_scene()).robot, []
    for i, body in enumerate(link_boxes()):
        for j, (centre, sides) in enumerate(WALLS.values()):
            place = np.eye(4)
            place[:3, 3] = centre
            if reach_of(robot, body.joint, body.body).meets(place[None], np.array([sides]) / 2.0).all():
                found.append((i, j))
    return tuple(found)


@functools.cache
def _kinematics() -> Kinematics:
    return kinematics_of(Setup.of(corridor_scene()).robot)


@functools.cache
def _hulls() -> tuple[Any, ...]:
    return tuple(coal_hull(body.body) for body in link_boxes())


def _corners(q: Array) -> list[Array]:
    """Return the corners (8, 3) of each of the links' boxes in the world."""
    state = _kinematics().evaluate(q[None])
    return [
        body.body.vertices @ state.rotations[0, body.joint].T + state.translations[0, body.joint]
        for body in link_boxes()
    ]


def _sheet(title: str, moments: Sequence[tuple[str, Array, Array]]) -> Figure:
    with rc_context(RC):
        figure = Figure(figsize=(8.6, 4.8), dpi=150, facecolor="white", layout="constrained")
        figure.suptitle(title, fontsize=12, weight="bold", x=0.01, ha="left")
        for column, (words, q, points) in enumerate(moments):
            axis: Any = figure.add_subplot(1, len(moments), column + 1, projection="3d")
            for corners in _corners(q):
                axis.add_collection3d(_faces(corners, START, 0.55))
            for centre, sides in WALLS.values():
                axis.add_collection3d(_faces(ConvexBody.box(sides).vertices + centre, "#888888", 0.18))
            for point, color in zip(points, WITNESSES, strict=False):
                axis.scatter(*point, color=color, s=45, depthshade=False)
            if len(points):
                axis.plot(*points.T, color=GOAL, linewidth=1.2)
            axis.set(xlim=(-0.2, 0.9), ylim=(-0.55, 0.55), zlim=(0.0, 1.1), title=words)
            axis.set_box_aspect((1, 1, 1))
            axis.view_init(elev=24, azim=-118)
        return figure


def _faces(corners: Array, color: str, opacity: float) -> Poly3DCollection:
    triangles = corners[scipy.spatial.ConvexHull(corners).simplices]
    return Poly3DCollection(triangles, facecolor=color, edgecolor="none", alpha=opacity)
