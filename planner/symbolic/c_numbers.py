"""hdplan's own numbers for the test of generated C: by Pinocchio and by the planner's loops, not by the symbols."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hdplan.distance.poses import placement_rows
from hdplan.planner.collision.collision_model import SELF_ACTIVATION
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.symbolic.kinematics import link_places
from hdplan.planner.symbolic.pairs import ScenePairs
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy

TURN, WAY = 0.5, 0.3  # [rad] and [m] by which obstacles are moved from where they are


class Numbers(NamedTuple):
    """At B configurations of n joints, with the m obstacles at B places."""

    q: Array  # (B, n)
    obstacles: Array  # (B, m, 4, 4)
    poses: Array  # (B, links, 4, 4)
    distance: Array  # (B, P)
    slope: Array  # (B, n) the sum of D's gradients, that of pair p by 1 / (1 + p)
    penalty: Array  # (B,)
    pull: Array  # (B, n) the penalty's gradient


def hdplans_numbers(found: ScenePairs, count: int) -> Numbers:
    """Draw configurations and places of the obstacles, always the same, and evaluate them."""
    robot, rng, movable = found.setup.robot, np.random.default_rng(0), found.poses
    q = robot.draw(rng, count)
    turns = scipy.spatial.transform.Rotation.from_rotvec(rng.normal(0, TURN, (count * len(movable), 3)))
    obstacles = np.tile(movable, (count, 1, 1, 1))
    if len(movable):
        obstacles[..., :3, :3] = turns.as_matrix().reshape(count, -1, 3, 3) @ obstacles[..., :3, :3]
        obstacles[..., :3, 3] += rng.normal(0, WAY, (count, len(movable), 3))
    kinematics = found.model.kinematics.evaluate(robot.expand(q))
    placements = np.concatenate([kinematics.placements, placement_rows(obstacles)], axis=1)
    met = KinematicsBatch(placements, kinematics.columns)
    distance, gradient = _distances(found, met, activated=False)
    grown, pulls = _distances(found, met, activated=True)
    depth = np.minimum(grown, 0.0)
    shares = 1.0 / (1.0 + np.arange(len(found.names)))
    return Numbers(
        q,
        obstacles,
        _poses(found, q),
        distance,
        np.einsum("p,bpn->bn", shares, gradient),
        0.5 * (depth**2).sum(axis=1),
        np.einsum("bp,bpn->bn", depth, pulls),
    )


def _distances(found: ScenePairs, met: KinematicsBatch, activated: bool) -> tuple[Array, Array]:
    """Return D (B, P) and its gradient (B, P, n)."""
    count, robot, settings = len(met.placements), found.setup.robot, found.setup.scene.planner
    values, slopes = [np.empty((count, 0))], [np.empty((count, 0, robot.n))]
    for group in found.groups:
        of_obstacles = group.joint_b.max() >= found.model.kinematics.nj
        pairs = group.enlarged((settings.activation if of_obstacles else SELF_ACTIVATION) * activated)
        sample, pair = np.divmod(np.arange(count * len(pairs)), len(pairs))
        value, wrench, _ = HdsdfPairs(pairs, settings.gamma, settings.shaping_length)(met, sample, pair)
        slope = (met.columns[sample] @ wrench[:, :, None])[:, :, 0] * pairs.moves[pair]
        values.append(value.reshape(count, -1))
        slopes.append(robot.fold(slope).reshape(count, -1, robot.n))
    return np.concatenate(values, axis=1), np.concatenate(slopes, axis=1)


def _poses(found: ScenePairs, q: Array) -> Array:
    """Return the links' poses (B, links, 4, 4), by Pinocchio."""
    robot = found.setup.robot
    data, poses = robot.model.createData(), []
    for each in robot.pin_q(q):
        pin.forwardKinematics(robot.model, data, each)
        poses.append([data.oMi[joint].homogeneous @ place for joint, place in link_places(robot).values()])
    return np.array(poses)
