"""Clearance from moving obstacles: each sample of a motion sees them at their poses at the sample's time.

A moving obstacle is one more body that is carried, as a link is, but by no joint: its placement at each sample's time
is appended to those of the joints, and everything else is as for static obstacles. The time of a sample follows from
the time law (`timing.duration`), which does not depend on the motion.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.poses import placement_rows
from hdplan.planner.collision.broad_phase import BodyPairs, body_pairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.collision.scene_pairs import all_pairs, carried_pieces, with_frames
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.clearance import Clearance
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.terms import Penalty
from hdplan.planner.problem.unknown import Span, kept, spans
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.time_laws import MinimumJerk
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.obstacle_motion import ObstacleMotion

if TYPE_CHECKING:
    from hdplan.distance.symbolic.closed import ClosedForm
    from hdplan.planner.problem.symbolic_place import SymbolicPlace

Placed = ObstacleMotion | Span  # where a body is at a time


class MovingClearance(Clearance):
    """Clearance from moving obstacles at the times of the samples."""

    def __init__(
        self,
        pairs: BodyPairs,
        distance: PairDistance,
        pieces: Sequence[HalfspaceBody],
        motions: Sequence[Placed],
        law: MinimumJerk,
    ) -> None:
        """Take pairs and their second bodies, which are carried by joints beyond the robot's, one for each of the
        motions."""
        super().__init__("moving obstacles", pairs, distance, pieces)
        self.motions, self.law = tuple(motions), law

    def at_samples(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty:
        """The penalty at the samples of a motion."""
        return super().at_samples(self.met(kinematics, self.law.time_at(samples.parameter)), samples)

    def second_order(self, kinematics: KinematicsBatch, samples: Samples) -> Array:
        """Σ_pairs w_s D ∇²D at the samples; the obstacles' places do not depend on the motion."""
        return super().second_order(self.met(kinematics, self.law.time_at(samples.parameter)), samples)

    def written_at_sample(self, place: SymbolicPlace) -> ClosedForm:
        """Penalty of static obstacles, as the frames that carry these are where they are at the sample's time."""
        return super().written_at_sample(place)

    def depth(self, kinematics: KinematicsBatch, parameter: Array | None = None) -> Array:
        """Depth that the worst pair may have inside its margin (B,) [m] at path parameters; 0 where none are given."""
        if parameter is None:
            return np.zeros(len(kinematics.placements))
        return super().depth(self.met(kinematics, self.law.time_at(parameter)))

    def met(self, kinematics: KinematicsBatch, times: Array) -> KinematicsBatch:
        """The kinematics of configurations, with the obstacles' placements at times (B,) [s] after the joints'."""
        own = placement_rows(np.stack([each.at(times) for each in self.motions], axis=1))
        return KinematicsBatch(np.concatenate([kinematics.placements, own], axis=1), kinematics.columns)


def moving_clearance(
    setup: Setup,
    bodies: tuple[LinkBody, ...],
    supports: Mask,
    distance: Callable[[BodyPairs, tuple[LinkBody, ...], tuple[HalfspaceBody, ...]], PairDistance],
    deadline: float,
    closely: bool,
) -> tuple[MovingClearance, tuple[HalfspaceBody, ...], tuple[str, ...]]:
    """Assemble the pairs of every moving link body with every moving obstacle; also return the obstacles' convex
    pieces, and notes on how they were made.

    supports: (nj, n) as Kinematics.supports. distance: makes the pairs' distance. deadline: as `problem.build`'s.
    closely: as `assemble`'s.
    """
    scene, planes, first, clearances = setup.scene, setup.scene.planner.normals, len(supports), kept(setup)
    pieces, margins, motions, notes = list[HalfspaceBody](), list[float](), list[Placed](), list[str]()
    for obstacle in scene.moving:
        found, words = carried_pieces(obstacle, 0, planes, deadline - time.perf_counter(), closely)
        notes += words
        for span in spans(obstacle, scene.end_time):  # one, of all times, but where it may leave
            pieces += [replace(piece, joint=first + len(motions)) for piece in found]
            margins += [clearances[obstacle.name] + span.growth + scene.planner.activation] * len(found)
            motions.append(span if span.growth else span.motion)
    pairs = all_pairs(bodies, range(len(pieces)))
    assembled = body_pairs(bodies, pieces, pairs, np.array(margins), with_frames(supports, len(motions)))
    term = MovingClearance(
        assembled,
        distance(assembled, bodies, tuple(pieces)),
        pieces,
        motions,
        MinimumJerk(scene.end_time),
    )
    return term, tuple(pieces), tuple(notes)
