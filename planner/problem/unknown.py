"""Distances that the planner keeps under uncertainty: the clearance, less the share of the scene's sizes.

What is proven is the certificate's; here what holds at the motion's ends does, as it only has to keep the motion where
that can be proven. A body that may leave at some speed needs room that grows with time: in each of some spans of the
motion it is enlarged by what it may have gone at the end of that span, and far away in the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.certificate.sizes import lengths, lever
from hdplan.planner.certificate.solids import link_bodies, obstacle_bodies
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.tracking import tracking_of_all
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import made_once
from hdplan.scenes.sizes import chord
from hdplan.scenes.targets import JointTarget

if TYPE_CHECKING:
    from hdplan.scenes.obstacle_motion import ObstacleMotion

GROWTH_STEP, MOST_SPANS = 0.01, 48  # [m] by which a body grows from one span to the next; how many there are at most
AWAY_DISTANCE = 1e4  # [m] where a body is in spans that are not its own


def kept(setup: Setup) -> dict[str, float]:
    """Return the distance to keep between links and each obstacle at time 0, by its name [m]."""
    own, clearances = of_robot(setup)[0], setup.scene.clearances
    return {each.name: clearances[each.name] + sum(of_obstacle(each)[:2]) + own for each in setup.scene.obstacles}


def of_obstacle(obstacle: Obstacle) -> tuple[float, float, float]:
    """Return the displacements of an obstacle's points from its nominal pose, by its position and its turn [m], and
    its speed [m/s]."""
    unknown = obstacle.uncertainty
    turns = unknown is not None and unknown.orientation > 0.0
    farthest = max(lever(body, obstacle) for body in obstacle_bodies(obstacle)) if turns else 0.0
    return lengths(unknown, farthest)


def of_robot(setup: Setup) -> tuple[float, float]:
    """Return the displacements of links' points from their nominal places, in the world and from other links [m]."""
    robot, off = setup.robot, tracking_of_all(setup.scene, setup.robot)
    moved = sum(of_base(setup)) + float(by_joints(setup).sum(axis=1).max(initial=0.0))
    if not off.any():
        return moved, 0.0
    reach, _, carried = _reach(setup)
    links = {link: row for row, link in enumerate(robot.links)}
    apart = 0.0
    for one, other in robot.self_pairs:
        a, b = links[one], links[other]
        apart = max(apart, float((reach[a] * (carried[a] & ~carried[b]) + reach[b] * (carried[b] & ~carried[a])) @ off))
    return moved, apart


def of_base(setup: Setup) -> tuple[float, float]:
    """Return the displacements of links' points by the base's position and its turn [m]."""
    base = setup.scene.robot.calibration
    if base is None:
        return 0.0, 0.0
    return base.position, chord(base.orientation) * float(_reach(setup)[1].max(initial=0.0))


def by_joints(setup: Setup) -> Array:
    """Return the displacements (L, m) of each link's points by the error of each joint [m]."""
    off = tracking_of_all(setup.scene, setup.robot)
    return _reach(setup)[0] * off if off.any() else np.zeros((0, len(off)))


def _reach(setup: Setup) -> tuple[Array, Array, Mask]:
    """Return for each link (L,) how far it may be from each joint's axis (L, m), and from the base's origin (L,) [m],
    at the ends that the scene names by joint values; and which joints carry it (L, m)."""
    scene, robot = setup.scene, setup.robot
    ends = [end for end in (scene.start, scene.goal) if isinstance(end, JointTarget)]
    return _reach_at(robot, tuple(tuple(robot.configuration(end, scene.from_request).tolist()) for end in ends))


@made_once(8)
def _reach_at(robot: Robot, ends: tuple[tuple[float, ...], ...]) -> tuple[Array, Array, Mask]:
    chain, bodies = Chain.of(robot.model), link_bodies(robot)
    q = robot.expand(np.array(ends))
    turned, moved = chain.frames(robot.unfolded.pin_q(q))
    joint = np.array([body.joint for body in bodies])
    local = np.array([(body.placement @ [*body.piece.center, 1.0])[:3] for body in bodies])
    radius = np.array([body.piece.radius for body in bodies])
    center = np.einsum("kgij,gj->kgi", turned[:, joint], local) + moved[:, joint]
    axes, points = np.einsum("knij,nj->kni", turned[:, 1:], chain.axes), np.ascontiguousarray(moved[:, 1:])
    everywhere, still = np.full((len(bodies), len(chain.axes)), np.inf), np.zeros(q.shape)
    near = chain.local_reach(everywhere, joint, center, radius, axes, points, still).max(axis=0)  # (g, m)
    away = (np.linalg.norm(center - np.array(robot.base.position), axis=2) + radius).max(axis=0)
    reach, far = np.zeros((len(robot.links), len(chain.axes))), np.zeros(len(robot.links))
    rows = [robot.links.index(body.name) for body in bodies]
    np.maximum.at(reach, rows, near)
    np.maximum.at(far, rows, away)
    return reach, far, chain.carried_by[[robot.link_joint[link] for link in robot.links]]


@dataclass(frozen=True, eq=False)
class Span:
    """Place of an obstacle in one span of time, and how much larger [m]; elsewhere it is far away."""

    motion: ObstacleMotion
    begin: float  # [s]
    end: float
    growth: float

    def at(self, times: Array) -> Array:
        """Return the obstacle's poses (k, 4, 4) at times (k,) [s]."""
        places = self.motion.at(times)
        places[~((times >= self.begin) & (times <= self.end)), 2, 3] += AWAY_DISTANCE
        return places


def spans(obstacle: Obstacle, duration: float) -> tuple[Span, ...]:
    """Return the spans of a motion in which an obstacle grows, the first and the last without an end."""
    from hdplan.scenes.obstacle_motion import ObstacleMotion

    motion, speed = ObstacleMotion.of(obstacle), of_obstacle(obstacle)[2]
    count = int(np.clip(np.ceil(speed * duration / GROWTH_STEP), 1, MOST_SPANS))
    edges = np.linspace(0.0, duration, count + 1)
    growth = (speed * edges[1:]).tolist()
    edges[0], edges[-1] = -np.inf, np.inf
    return tuple(Span(motion, *each) for each in zip(edges[:-1].tolist(), edges[1:].tolist(), growth, strict=True))
