"""How far the planner stays from what it does not quite know: the clearance, and what the scene's sizes take of it.

What is proven is the certificate's; here bounds over all configurations do, as they are only to keep the motion where
it can be proven. A body that may leave at some speed needs room that grows with time: in each of some spans of the
motion it is enlarged by what it may have gone at the end of that span, and elsewhere in the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.sizes import lengths, lever
from hdplan.planner.certificate.solids import link_bodies, obstacle_bodies
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.tracking import tracking_of_all
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import made_once
from hdplan.scenes.sizes import Calibration, chord

STEP, MOST_SPANS = 0.01, 48  # [m] by which a body grows from one span to the next; how many there are at most
AWAY = 1e4  # [m] where a body is in spans that are not its own


def kept(setup: Setup) -> dict[str, float]:
    """Return how far links are to be kept from each obstacle at time 0, by its name [m]."""
    own = of_robot(setup)[0]
    return {
        each.name: setup.scene.clearances[each.name] + sum(of_obstacle(each)[:2]) + own
        for each in setup.scene.obstacles
    }


def of_obstacle(obstacle: Obstacle) -> tuple[float, float, float]:
    """Return how far points of an obstacle may be from where it is said to be, for its position and its turn [m], and
    its speed [m/s]."""
    unknown = obstacle.uncertainty
    turns = unknown is not None and unknown.orientation > 0.0
    farthest = max(lever(body, obstacle) for body in obstacle_bodies(obstacle)) if turns else 0.0
    return lengths(unknown, farthest)


def of_robot(setup: Setup) -> tuple[float, float]:
    """Return how far points of links may be from where they are said to be, in the world and from other links [m]."""
    scene, robot = setup.scene, setup.robot
    off, base = tracking_of_all(scene, robot), scene.robot.calibration or Calibration()
    if not off.any() and base == Calibration():
        return 0.0, 0.0
    reach, far, carried = _reach(robot)
    moved = base.position + chord(base.orientation) * far.max(initial=0.0) + (reach @ off).max(initial=0.0)
    links = {link: row for row, link in enumerate(robot.links)}
    apart = 0.0
    for one, other in robot.self_pairs:
        a, b = links[one], links[other]
        apart = max(apart, float((reach[a] * (carried[a] & ~carried[b]) + reach[b] * (carried[b] & ~carried[a])) @ off))
    return float(moved), apart


@made_once(8)
def _reach(robot: Robot) -> tuple[Array, Array, Mask]:
    """Return for each link (L,) how far it may be from each joint's axis (L, m), and from the base's origin (L,) [m],
    and which joints carry it (L, m)."""
    chain = Chain.of(robot.model)
    low, high = robot.unfolded.lower, robot.unfolded.upper
    travel = np.clip(np.stack([low, high], axis=1), -1e3, 1e3)
    slid = np.where(chain.revolute, 0.0, np.abs(travel).max(axis=1))
    offset = np.zeros(robot.model.njoints)
    for joint in range(1, robot.model.njoints):
        parent = int(robot.model.parents[joint])
        placed = np.array(robot.model.jointPlacements[joint].translation)
        if not parent:
            placed = placed - np.array(robot.base.position)
        offset[joint] = offset[parent] + float(np.linalg.norm(placed)) + slid[joint - 1]
    reach = np.zeros((len(robot.links), len(chain.axes)))
    far = np.zeros(len(robot.links))
    rows = {link: row for row, link in enumerate(robot.links)}
    for body in link_bodies(robot):
        row, place = rows[body.name], body.placement
        points = body.piece.vertices @ place[:3, :3].T + place[:3, 3]
        reach[row] = np.maximum(reach[row], chain.reach(body.joint, points, body.piece.sweep, travel))
        own = points if body.joint else points - np.array(robot.base.position)
        most = float(np.linalg.norm(own, axis=1).max()) + body.piece.sweep
        far[row] = max(far[row], offset[body.joint] + most)
    carried = chain.carried_by[[robot.link_joint[link] for link in robot.links]]
    return reach, far, carried


@dataclass(frozen=True, eq=False)
class Span:
    """Where an obstacle is in one span of time, and how much larger [m]; elsewhere it is far away."""

    motion: ObstacleMotion
    begin: float  # [s]
    end: float
    growth: float

    def at(self, times: Array) -> Array:
        """Return the obstacle's poses (k, 4, 4) at times (k,) [s]."""
        places = self.motion.at(times)
        places[~((times >= self.begin) & (times <= self.end)), 2, 3] += AWAY
        return places


def spans(obstacle: Obstacle, duration: float) -> tuple[Span, ...]:
    """Return the spans of a motion in which an obstacle grows, the first and the last without an end."""
    motion, speed = ObstacleMotion.of(obstacle), of_obstacle(obstacle)[2]
    count = int(np.clip(np.ceil(speed * duration / STEP), 1, MOST_SPANS))
    edges = np.linspace(0.0, duration, count + 1)
    growth = (speed * edges[1:]).tolist()
    edges[0], edges[-1] = -np.inf, np.inf
    return tuple(Span(motion, *each) for each in zip(edges[:-1].tolist(), edges[1:].tolist(), growth, strict=True))
