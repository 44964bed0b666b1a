"""The body pairs and poses of the studies of distances: like those a planner meets, and some moved close to contact.

Poses are pairs of arrays (N, 4, 4), world from body [m], with the exact signed distances (N,) [m].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.studies.random_poses import paper_poses
from hdplan.distance.unions import Body
from hdplan.scenes.array_types import Array

NEAR_GAPS = (-0.12, 0.06)  # [m] range of the gaps that poses near contact should have
WAY_HALVINGS = 12  # of the way between the bodies' centres, to about a millimetre


def study_bodies() -> Mapping[str, tuple[ConvexBody, ConvexBody]]:
    """Return the body pairs by name: what links and obstacles look like to a planner.

    The link is a hull of six points swept by 4 cm, as those fitted around real links are; the cylinder a prism of 16
    sides.
    """
    lower, upper = [[-0.02, -0.03, 0.0], [0.02, -0.03, 0.0], [0.0, 0.03, 0.0]], [[-0.02, 0.0, 0.3], [0.02, -0.02, 0.3]]
    link = ConvexBody.from_points([*lower, *upper, [0.0, 0.04, 0.28]], radius=0.04)
    box, board = ConvexBody.box([0.3, 0.2, 0.15]), ConvexBody.box([0.8, 0.5, 0.02])
    return MappingProxyType(
        {
            "box - board": (box, board),
            "capsule - box": (ConvexBody.capsule(0.06, 0.3), box),
            "link - cylinder": (link, ConvexBody.cylinder(0.05, 0.2)),
        }
    )


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of one pair of bodies with the truth about them."""

    poses_a: Array  # (N, 4, 4)
    poses_b: Array  # (N, 4, 4)
    distances: Array  # (N,) [m] exact
    drawn: int  # the first so many are drawn at random, the others moved towards contact

    def of(self, some: slice) -> tuple[Array, Array]:
        """Return some of both poses."""
        return self.poses_a[some], self.poses_b[some]


def study_poses(body_a: Body, body_b: Body, random: int, near: int, rng: np.random.Generator) -> Poses:
    """Return ``random`` poses drawn as the paper does, scaled from solids of 1 m to these, and ``near`` ones close to
    contact.

    The latter are drawn likewise, and then A is moved along the line of centres until the gap is about one drawn
    uniformly from NEAR_GAPS, or the centres meet.
    """
    poses_a, poses_b = paper_poses(rng, random + near)
    scale = 0.5 * (body_a.reach + body_b.reach)
    for poses in (poses_a, poses_b):
        poses[:, :3, 3] *= scale
    aim = rng.uniform(*NEAR_GAPS, near)
    centres_a = poses_a[random:, :3, :3] @ body_a.centre
    centres_b = poses_b[random:, :3, :3] @ body_b.centre + poses_b[random:, :3, 3]
    apart = poses_a[random:, :3, 3] + centres_a - centres_b
    apart *= 2.5 * scale / np.linalg.norm(apart, axis=1, keepdims=True)
    low, high = np.zeros(near), np.ones(near)
    for _ in range(WAY_HALVINGS):
        middle = 0.5 * (low + high)
        poses_a[random:, :3, 3] = centres_b + middle[:, None] * apart - centres_a
        too_far = signed_distances(body_a, poses_a[random:], body_b, poses_b[random:]) > aim
        low, high = np.where(too_far, low, middle), np.where(too_far, middle, high)
    return Poses(poses_a, poses_b, signed_distances(body_a, poses_a, body_b, poses_b), random)
