"""Infeasibility proofs: that no motion of the joints leads from the start to the goal.

A ball inside a link (`inscribed_balls`) may never meet what stands. If obstacles, and the end of its reach, shut it off
(`barriers`, `seals`) from every place where a goal has it, no motion leads to that goal. The rest of the link, what the
joints cannot do together, and what moves are left out, all of which can only make motions fewer: where no proof is
found, there may be no motion either.

What must be kept from an obstacle is added to the ball's radius: then no motion keeps it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hdplan.planner.certificate.barriers import Reach, off_ends, points_of
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.inscribed_balls import InscribedBall, inscribed_ball, inscribed_balls
from hdplan.planner.certificate.intervals import Body
from hdplan.planner.certificate.seals import Barrier
from hdplan.planner.certificate.solids import link_bodies
from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import naming
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.sizes import chord
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget

MOST_POINTS = 12_000  # of a barrier: it takes half a second then
END_RADII = (20.0, 40.0, 80.0)  # radii from an end up to which there are points, if they are not too many
BALL_ERROR = 1e-4  # [m] by which a ball may be off where a configuration is reached up to rounding
BETWEEN_POINTS = 1.1  # radii from the nearest point within which a ball may touch what is between points
PLACES_BETWEEN = 4  # places of a ball examined between two waypoints
NAMED_OBSTACLES = 3  # obstacles in words

Target = JointTarget | PoseTarget | AllOf


class Region(NamedTuple):
    """A ball in which the centre of a link's ball is at the goal."""

    center: Array  # (3,) in the world
    radius: float  # [m]

    def excludes(self, point: Array) -> bool:
        """True if a point (3,) is outside it."""
        return float(np.linalg.norm(point - self.center)) > self.radius


class Shut(NamedTuple):
    """The seal that shuts a ball off from a goal."""

    words: str
    by: tuple[str, ...]  # the obstacles or links that the words name, those with most points of the seal first


def looks(
    certifier: Certifier, required: float, tried: Mapping[str, Sequence[Array]], suspects: Collection[str] = ()
) -> Iterator[tuple[Shut, ...] | None]:
    """Look at one ball after another; yield each time what shuts off the goals if no motion of the scene that keeps
    `required` [m] exists, and that is proven by then, or nothing. A look may take a second: None between its parts lets
    it be ended.

    tried: motions (N, n) to a goal, by its field, which were not certified. A ball that one of them certainly brings to
    the goal is skipped. suspects: links whose balls are examined first.
    """
    goal = certifier.scene.goal
    open_, found = list(goal.targets if isinstance(goal, Goals) else (goal,)), list[Shut]()
    for body in link_bodies(certifier.robot):
        inscribed_ball(body.piece)  # made once: all are at hand below
        yield None
    balls = inscribed_balls(certifier.robot)
    for ball in sorted(balls, key=lambda ball: certifier.sweep.bodies.names[ball.body] not in suspects):
        start = _centers(certifier, ball, _start(certifier)[None])[0]
        regions = [(target, _region(certifier, ball, target)) for target in open_]
        ends = [(target, region) for target, region in regions if region is not None and region.excludes(start)]
        if not ends:
            continue
        around = np.stack([start, *(region.center for _, region in ends)])
        if (cage := Cage.of(certifier, ball, required, around)) is not None:
            for target, region in ends:
                yield None
                ways = (_centers(certifier, ball, _between(rows)) for rows in tried.get(target.field, ()))
                if any(cage.clear(way) for way in ways):
                    continue
                if (seal := cage.barrier.seal(start, region.center, region.radius)) is not None:
                    open_.remove(target)
                    found.append(cage.shut(seal, target.field))
        yield () if open_ else tuple(found)
        if not open_:
            return


@dataclass(frozen=True, eq=False)
class Cage(ReadOnly):
    """A barrier around a link's ball: the obstacles that stand, and the end of its reach."""

    ball: InscribedBall
    link: str
    barrier: Barrier
    around: int  # how many points of the barrier are in obstacles, the first ones
    owner: Rows  # (n,) of the barrier's points: an index of `names`
    names: tuple[str, ...]
    keeps: Array  # (names,) how far the ball must keep off [m]

    @classmethod
    def of(cls, certifier: Certifier, ball: InscribedBall, required: float, ends: Array) -> Cage | None:
        """Gather it around centres (e, 3) of the ball, as far as there are not too many points; None where there is
        nothing."""
        bodies, pairs = certifier.sweep.bodies, certifier.sweep.pairs
        reach = Reach.of(bodies.chain, bodies.bodies[ball.body].joint, ball.center, _travel(certifier))
        own = np.flatnonzero((pairs.a == ball.body) | (pairs.b == ball.body))
        others = [bodies.bodies[row] for row in (pairs.a[own] + pairs.b[own] - ball.body).tolist()]
        floor = certifier.floor(required)[own].tolist()
        stands = [(body, keep) for body, keep in zip(others, floor, strict=True) if _stands(body)]
        for near in END_RADII:
            gathered = [points_of(body, ball.radius + keep, reach, ends, near) for body, keep in stands]
            counts = [len(points) for points, _ in gathered]
            if sum(counts) > MOST_POINTS:
                break
        if not sum(counts):
            return None
        points, radii = (np.concatenate(each) for each in zip(*gathered, strict=True))
        owner = np.repeat(np.arange(len(stands)), counts)
        order = off_ends(points, ends).argsort(kind="stable")[:MOST_POINTS]
        points, radii, owner = points[order], radii[order], owner[order]
        around = len(points)
        if reach is not None:
            outside, away = reach.around
            points, radii = np.concatenate([points, outside]), np.concatenate([radii, away])
            owner = np.append(owner, np.full(len(away), len(stands)))
        names = (*(body.name for body, _ in stands), "the end of its reach")
        keeps = np.array([*(keep for _, keep in stands), 0.0])
        return cls(ball, bodies.names[ball.body], Barrier(points, radii), around, owner, names, keeps)

    def clear(self, centers: Array) -> bool:
        """True if the ball with its centre at any of these points (k, 3) is clearly off the obstacles."""
        points, radii = self.barrier.points[: self.around], BETWEEN_POINTS * self.barrier.radii[: self.around]
        near = scipy.spatial.cKDTree(points).query_ball_point(centers, float(radii.max()))
        return all(
            bool((np.linalg.norm(points[rows] - center, axis=1) > radii[rows]).all())
            for center, rows in zip(centers, near, strict=True)
        )

    def shut(self, seal: Rows, field: str) -> Shut:
        """Return the obstacles that shut the ball off from a goal, in words."""
        counts = np.bincount(self.owner[seal], minlength=len(self.names))
        rows = [row for row in np.argsort(-counts, kind="stable").tolist() if counts[row]]
        names = list(dict.fromkeys(self.names[row] for row in rows))
        by = ", ".join(names[:NAMED_OBSTACLES]) + f" and {len(names) - NAMED_OBSTACLES} more" * (
            len(names) > NAMED_OBSTACLES
        )
        across = f"a ball {2e3 * self.ball.radius:.3g} mm across inside {self.link}"
        kept = ", with the clearance that it must keep," * bool(self.keeps[rows].any())
        return Shut(
            f"{across}{kept} cannot get from start to {field}, shut off by {by}", tuple(names[:NAMED_OBSTACLES])
        )


def _stands(body: Body) -> bool:
    return body.joint == 0 and body.obstacle_motion is None


def _start(certifier: Certifier) -> Array:
    with naming(certifier.scene.source):
        return certifier.robot.configuration(certifier.scene.start, certifier.scene.from_request)


def _travel(certifier: Certifier) -> Array:
    """Return from where to where each joint of the model may go (m, 2)."""
    robot = certifier.robot.unfolded
    return np.stack([robot.lower, robot.upper], axis=1)


def _between(rows: Array) -> Array:
    """Return configurations along a motion (N, n)."""
    steps = np.linspace(0.0, 1.0, PLACES_BETWEEN, endpoint=False)[:, None, None]
    return np.concatenate([*(rows[:-1] + steps * np.diff(rows, axis=0)), rows[-1:]])


def _centers(certifier: Certifier, ball: InscribedBall, rows: Array) -> Array:
    """Return the positions (k, 3) of a ball's centre at configurations (k, n)."""
    bodies, robot = certifier.sweep.bodies, certifier.robot
    joint = bodies.bodies[ball.body].joint
    turned, moved = bodies.chain.frames(bodies.to_pinocchio(robot.expand(rows)))
    return np.asarray(turned[:, joint] @ ball.center + moved[:, joint])


def _region(certifier: Certifier, ball: InscribedBall, target: Target) -> Region | None:
    """Return the region of a ball's centre at a goal; None where it is not known."""
    match target:
        case JointTarget():
            with naming(certifier.scene.source):
                q = certifier.robot.configuration(target, certifier.scene.from_request)
            return Region(_centers(certifier, ball, q[None])[0], BALL_ERROR)
        case PoseTarget() | AllOf():
            found = (_posed(certifier, ball, pose) for pose in target.poses)
            return next((region for region in found if region is not None), None)


def _posed(certifier: Certifier, ball: InscribedBall, target: PoseTarget) -> Region | None:
    robot = certifier.robot
    frame = robot.model.frames[link_frame(robot, target.link, target.field)]
    if frame.parentJoint != certifier.sweep.bodies.bodies[ball.body].joint:
        return None
    beside = frame.placement.actInv(ball.center)  # from the link's origin
    free = target.free_rotation
    kept = np.ones(3) if free == "none" else np.zeros(3) if free == "all" else np.array([free == axis for axis in AXES])
    middle, turns = kept * beside, float(np.linalg.norm((1.0 - kept) * beside))
    pose = target.pose.matrix
    tilts = chord(min(target.orientation_tolerance, np.pi)) * float(np.linalg.norm(beside)) if free != "all" else 0.0
    return Region(pose[:3, :3] @ middle + pose[:3, 3], turns + tilts + target.position_tolerance + BALL_ERROR)
