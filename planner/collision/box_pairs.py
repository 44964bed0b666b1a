"""Distances of pairs of boxes at samples, as a `PairDistance`: the paper's own HD-SDF, and the GDF baseline.

Both take boxes only: links with the setting `link_bodies: box`, and obstacles that are boxes. `BoxPairs` is a lower
bound in sign and an approximation in value, `GdfPairs` an unsigned approximation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hdplan.distance.baselines.gdf_batch import gdf_boxes
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.poses import placement_rows
from hdplan.distance.symbolic.box_kernel import box_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import made_once
from hdplan.scenes.shapes import Box, Shape

RIGHT_ANGLE = 1e-9  # the cosine of a box's right angles is this close to 0


class _Boxes:
    """The pairs' boxes as rows [R (9) | t (3) | half sides (3)] in the frames of the joints that carry them."""

    def __init__(self, pairs: BodyPairs, bodies: Sequence[LinkBody], halfspace_bodies: Sequence[HalfspaceBody]) -> None:
        self.pairs, self.margins = pairs, pairs.margins[:, None]
        self.first = np.array([_box_row(body.body, np.eye(4), body.link) for body in bodies])
        self.second = np.array([_box_row(body.solid, body.placement, body.name) for body in halfspace_bodies])


class BoxPairs(_Boxes, PairDistance):
    """D with the paper's normals of both boxes, less the obstacle's margin. Raises InputError for a body that is no
    box."""

    def __init__(
        self,
        pairs: BodyPairs,
        bodies: Sequence[LinkBody],
        halfspace_bodies: Sequence[HalfspaceBody],
        gamma: int,
        shaping_length: float,
        normals: str = "paper",
    ) -> None:
        """Take the pairs and the bodies that they index; normals: "paper" or "paper-multiset"."""
        super().__init__(pairs, bodies, halfspace_bodies)
        self.kernel = _kernel(gamma, shaping_length, normals)

    @property
    def how(self) -> str:
        """Compiled or interpreted."""
        compiled = "compiled C" if self.kernel.is_compiled else "by CasADi’s interpreter: no C compiler"
        return f"HD-SDF of boxes with the paper's normals, {compiled}"

    @property
    def functions(self) -> Mapping[str, Any]:
        """The one function of the pairs."""
        return {"boxes": self.kernel.function}

    def __call__(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return D (S,) [m], its wrench (S, 6) and D̃ (S,) [m] for S pairs (row of the pairs) at samples."""
        batch, joints = kinematics.placements.shape[:2]
        placements = kinematics.placements.reshape(batch * joints, 12)
        values, wrenches, separations = self.kernel(
            [placements, placements, self.first, self.second, self.margins],
            [
                sample * joints + self.pairs.joint_a[pair],
                sample * joints + self.pairs.joint_b[pair],
                self.pairs.body[pair],
                self.pairs.halfspace_body[pair],
                self.pairs.halfspace_body[pair],
            ],
        )
        return values[:, 0], wrenches, separations[:, 0]


class GdfPairs(_Boxes, PairDistance):
    """The GDF of the boxes, less the obstacle's margin; its parameters are those of the published experiment."""

    @property
    def how(self) -> str:
        """The name of the method."""
        return "GDF (h 0.1, bulging 0.01), an approximation, by iteration"

    def __call__(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return D (S,) [m], its wrench (S, 6) and D again: it is no bound."""
        placed = []
        for boxes, index, joint in (
            (self.first, self.pairs.body[pair], self.pairs.joint_a[pair]),
            (self.second, self.pairs.halfspace_body[pair], self.pairs.joint_b[pair]),
        ):
            turn, row = kinematics.rotations[sample, joint], boxes[index]
            origin = (turn @ row[:, 9:12, None])[..., 0] + kinematics.translations[sample, joint]
            placed += [row[:, 12:], turn @ row[:, :9].reshape(-1, 3, 3), origin]
        distance, wrench = gdf_boxes(*placed)
        distance = distance - self.margins[self.pairs.halfspace_body[pair], 0]
        return distance, wrench, distance


def _box_row(shape: Shape | ConvexBody, placement: Array, name: str) -> Array:
    """A box as [R | t | half sides]; of a box swept by a ball, the box around it."""
    frame, half = np.eye(4), np.zeros(3)
    match shape:
        case Box(size):
            half = np.array(size) / 2
        case ConvexBody():
            axes = _box_axes(shape)
            if axes is None:
                raise InputError(f"'{name}': not a box; this distance takes boxes only, on both sides")
            heights = shape.vertices @ axes
            frame[:3, :3], half = axes, np.ptp(heights, axis=0) / 2 + shape.radius
            frame[:3, 3] = axes @ (heights.min(axis=0) + heights.max(axis=0)) / 2
        case _:
            raise InputError(f"'{name}': a {type(shape).__name__.lower()}; this distance takes boxes only")
    return np.append(placement_rows(placement @ frame), half)


def _box_axes(body: ConvexBody) -> Array | None:
    """The axes (3, 3) of a box, as columns; None for a body that is no box."""
    if len(body.vertices) != 8 or len(body.faces) != 6:
        return None
    x = body.faces[0]
    cosines = np.abs(body.faces @ body.faces.T)
    if np.minimum(cosines, np.abs(1.0 - cosines)).max() > RIGHT_ANGLE:
        return None
    y = body.faces[int(np.argmin(np.abs(body.faces @ x)))]
    return np.stack([x, y, np.cross(x, y)], axis=1)


@made_once(64)
def _kernel(gamma: int, shaping_length: float, normals: str) -> RowFunction:
    return RowFunction(box_distance(gamma, shaping_length, normals))
