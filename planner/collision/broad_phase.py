"""The broad phase: tables of the pairs of bodies that can meet, and which of them are close at given configurations.

In: outer link bodies (vertices) and halfspace bodies (obstacles in the world, or links). Out: tables for the compiled
kernels of the distance, and for a batch of configurations the (sample, pair) that may be inside the margin; every other
D is guaranteed to be positive.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.compiled.loops import Record, twin_of
from hdplan.planner.collision import close_pairs
from hdplan.planner.collision.halfspace_bodies import BOX_PLANES, HalfspaceBody
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pieces import Pieces
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.once import read_only

# Every direction is within 27.6 degrees of one of a box's 26 directions whose support is attained at the same place of
# the box. So where a sphere of radius r is farther than r / cos(27.6°) from the box, one of the planes is sure to
# separate it: D > 0. Of its 6 faces alone, every direction is within acos(1/√3).
WIDEST, WIDEST_OF_FACES = 1.13, 3**0.5

LANES = 4  # numbers in a vector of the processor
FAR_SUPPORT = 1e30  # [m] support of a plane that fills a vector: its share in a maximum is below rounding


@dataclass(frozen=True)
class BodyPairs:
    """P pairs of a link body with a halfspace body, as tables."""

    body: Rows  # (P,) row of the link body in body_table
    halfspace_body: Rows  # (P,) index of the halfspace body
    plane_slots: Rows  # (P,) its number of plane slots: bodies with equal numbers share a table
    plane_row: Rows  # (P,) its row in the plane table of that many slots
    joint_a: Rows  # (P,) joint that carries the link body
    joint_b: Rows  # (P,) joint that carries the halfspace body, 0 for the world
    moves: Array  # (P, n) 1 where a joint moves only the first body, −1 only the second, else 0
    body_table: Array  # (A, 4 m + 1) vertices, weights, radius
    plane_tables: dict[int, Array]  # slots -> (·, 4 slots) normals and supports enlarged by the margin
    centres: Array  # (A, 3) of the link bodies' bounding spheres, in their joints' frames [m]
    radii: Array  # (A,) of those spheres [m]
    widest: float  # at this many radii from a box, one of the planes is sure to separate a sphere from it
    boxes: Array  # (B, 4, 4) the halfspace bodies' boxes, in their joints' frames
    half_sizes: Array  # (B, 3) of those boxes, enlarged by the margin [m]
    margins: Array  # (B,) by which each halfspace body is enlarged [m]

    def __len__(self) -> int:
        """The number of pairs."""
        return len(self.body)

    @property
    def vertex_slots(self) -> int:
        """m, the capacity of a row of `body_table` in vertices."""
        return (int(self.body_table.shape[1]) - 1) // 4

    def enlarged(self, by: float) -> BodyPairs:
        """These pairs with halfspace bodies enlarged by more [m]."""
        tables = {
            slots: np.hstack([table[:, : 3 * slots], table[:, 3 * slots :] + by])
            for slots, table in self.plane_tables.items()
        }
        return replace(self, plane_tables=tables, half_sizes=self.half_sizes + by, margins=self.margins + by)

    def close(self, kinematics: KinematicsBatch) -> tuple[Rows, Rows]:
        """Sample and pair indices (S,), samples ascending, whose bounding sphere reaches the enlarged box; with a C
        compiler, only those of them that no plane of the enlarged body separates.

        Misses no HD-SDF D < 0, by WIDEST, and no Euclidean distance below the margin: the sphere contains the link
        body, and the box, enlarged by the margin along its axes, contains every point within the margin of the other
        body.
        """
        sample, pair = self._close(kinematics)
        order = np.argsort(sample, kind="stable")
        return sample[order], pair[order]

    @twin_of(close_pairs.close)
    def _close(self, kinematics: KinematicsBatch) -> tuple[Rows, Rows]:
        centres, reach = _placed(kinematics, self._body_joints, self.centres), self.widest * self.radii
        found = self._close_to_standing(centres, reach), self._close_to_moving(centres, reach, kinematics)
        sample, pair = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return sample, pair

    def close_between(self, kinematics: KinematicsBatch) -> tuple[Rows, Rows]:
        """Close pairs on intervals between the configurations, (S,) intervals ascending, by a ball around a link body
        at both ends of each. Misses no D < 0 between the hull of the two and a static body."""
        centres = _placed(kinematics, self._body_joints, self.centres)
        half = np.linalg.norm(np.diff(centres, axis=1), axis=2).max(axis=1, initial=0.0) / 2
        reach, centres = self.widest * (self.radii + half), (centres[:, 1:] + centres[:, :-1]) / 2
        interval, pair = self._close_to_standing(centres, reach)
        order = np.argsort(interval, kind="stable")
        return interval[order], pair[order]

    @cached_property
    def tables(self) -> Record:
        """For the loops in C: their struct of that name."""
        first, width, planes = self._planes
        return Record(
            *("tables", int((self.joint_b == 0).sum()), self._body_joints, self._box_joints),
            *(np.argsort(self.joint_b > 0, kind="stable"), self.joint_a, self.joint_b, self.body, self.halfspace_body),
            *(first, width, self.centres, self.widest * self.radii, self.boxes[:, :3, 3], self._balls),
            *(self.boxes, self.half_sizes, self.body_table, planes),
        )

    @cached_property
    def _planes(self) -> tuple[Rows, Rows, Array]:
        """The planes of every halfspace body: where its four rows begin, normals by coordinate and enlarged supports,
        their width (B,), and the numbers of all. Planes too far away to count fill the last vector of every row."""
        slots = _spread(self.halfspace_body, self.plane_slots, len(self.boxes))
        row = _spread(self.halfspace_body, self.plane_row, len(self.boxes))
        width, first, planes, count = -(-slots // LANES) * LANES, np.zeros_like(slots), [], 0
        for number, table in self.plane_tables.items():
            wide = -(-number // LANES) * LANES
            padded = np.zeros((len(table), 4, wide))
            padded[:, 3] = FAR_SUPPORT
            padded[:, :3, :number] = table[:, : 3 * number].reshape(-1, number, 3).transpose(0, 2, 1)
            padded[:, 3, :number] = table[:, 3 * number :]
            first[slots == number] = count + 4 * wide * row[slots == number]
            planes.append(padded.ravel())
            count += padded.size
        return first, width, np.concatenate(planes)

    @cached_property
    def _body_joints(self) -> Rows:
        """The joint of each link body (A,); 0 for those that are in no pair."""
        return _spread(self.body, self.joint_a, len(self.centres))

    @cached_property
    def _box_joints(self) -> Rows:
        """The joint of each halfspace body (B,)."""
        return _spread(self.halfspace_body, self.joint_b, len(self.boxes))

    @cached_property
    def _standing(self) -> tuple[Rows, Rows, Rows]:
        """The pairs with a static body: rows, link bodies, boxes."""
        pair = np.flatnonzero(self.joint_b == 0)
        return pair, self.body[pair], self.halfspace_body[pair]

    @cached_property
    def _moving(self) -> tuple[Rows, Rows, Rows, Rows]:
        """The pairs with a body on a link: rows, link bodies, boxes, joints of the boxes."""
        pair = np.flatnonzero(self.joint_b > 0)
        return pair, self.body[pair], self.halfspace_body[pair], self.joint_b[pair]

    @cached_property
    def _balls(self) -> Array:
        """The radii of balls around the boxes (B,) [m]."""
        balls: Array = np.linalg.norm(self.half_sizes, axis=1)
        return balls

    @twin_of(close_pairs.close_to_standing)
    def _close_to_standing(self, centres: Array, reach: Array) -> tuple[Rows, Rows]:
        """`close` for the standing boxes; first all samples at once, by a ball around each body's whole motion."""
        pair, body, box = self._standing
        if not len(pair) or not centres.shape[1]:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        middle = (centres.min(axis=1) + centres.max(axis=1)) / 2  # (A, 3)
        travel = np.linalg.norm(centres - middle[:, None], axis=2).max(axis=1)
        local = ((middle[body] - self.boxes[box, :3, 3])[:, None] @ self.boxes[box, :3, :3])[:, 0]
        outside = np.maximum(np.abs(local) - self.half_sizes[box], 0.0)
        pair = pair[np.einsum("pi,pi->p", outside, outside) < (reach + travel)[body] ** 2]
        body, box = self.body[pair], self.halfspace_body[pair]
        gaps = centres[body] - self.boxes[box, None, :3, 3]  # (P, batch, 3)
        outside = np.abs(gaps @ self.boxes[box, :3, :3])
        outside -= self.half_sizes[box, None]
        np.maximum(outside, 0.0, out=outside)
        row, sample = np.nonzero(np.einsum("pbi,pbi->pb", outside, outside) < reach[body, None] ** 2)
        return sample, pair[row]

    def _close_to_moving(self, centres: Array, reach: Array, kinematics: KinematicsBatch) -> tuple[Rows, Rows]:
        """`close` for the boxes on links; first by the balls around the boxes."""
        pair, body, box, joint = self._moving
        if not len(pair):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        origins = _placed(kinematics, self._box_joints, self.boxes[:, :3, 3])  # (B, batch, 3)
        gaps = (centres[body] - origins[box]).transpose(1, 0, 2)  # (batch, P, 3)
        sample, row = np.nonzero(np.einsum("bpi,bpi->bp", gaps, gaps) < (reach[body] + self._balls[box]) ** 2)
        body, box, joint = body[row], box[row], joint[row]
        local = (gaps[sample, row, None] @ kinematics.rotations[sample, joint] @ self.boxes[box, :3, :3])[:, 0]
        outside = np.maximum(np.abs(local) - self.half_sizes[box], 0.0)
        near = np.einsum("si,si->s", outside, outside) < reach[body] ** 2
        return sample[near], pair[row[near]]


def _placed(kinematics: KinematicsBatch, joint: Rows, points: Array) -> Array:
    """Return points (k, 3) in the frames of joints (k,) in the world, at every sample (k, batch, 3)."""
    rotations, translations = kinematics.rotations[:, joint], kinematics.translations[:, joint]
    places: Array = (rotations @ points[:, :, None])[..., 0] + translations
    return places.transpose(1, 0, 2)


def _spread(rows: Rows, values: Rows, count: int) -> Rows:
    """Return `values` of rows, for `count` rows; 0 for rows without a value."""
    result = np.zeros(count, dtype=np.int64)
    result[rows] = values
    return result


def body_pairs(
    bodies: Sequence[LinkBody],
    halfspace_bodies: Sequence[HalfspaceBody],
    pairs: Sequence[tuple[int, int]] | Rows,
    margin: ArrayLike,
    supports: Mask,
) -> BodyPairs:
    """Assemble pairs (P, 2), indices of link body and halfspace body, as tables; `margin` [m] enlarges the halfspace
    bodies.

    margin: one for all halfspace bodies, or one for each (B,).
    supports: (nj, n) whether a joint moves what another joint carries (Kinematics.supports).
    """
    pieces = Pieces.of(halfspace_bodies)
    margins = np.full(len(pieces), margin, dtype=np.float64)
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    slots = max(len(bodies[a].body.vertices) for a in np.flatnonzero(np.bincount(first)).tolist())
    plane_slots, rows = np.zeros((2, len(pieces)), dtype=np.int64)
    tables = {}
    for own in pieces.planes:
        count = own.supports.shape[1]
        plane_slots[own.pieces], rows[own.pieces] = count, np.arange(len(own.pieces))
        enlarged = own.supports + margins[own.pieces, None]
        tables[count] = np.hstack([own.normals.reshape(len(enlarged), -1), enlarged])
    joint_a = np.array([body.joint for body in bodies], dtype=np.int64)[first]
    joint_b = pieces.joints[second]
    return BodyPairs(
        body=first,
        halfspace_body=second,
        plane_slots=plane_slots[second],
        plane_row=rows[second],
        joint_a=joint_a,
        joint_b=joint_b,
        moves=supports[joint_a].astype(float) - supports[joint_b],
        body_table=np.array([_body_row(body, slots) for body in bodies]),
        plane_tables=tables,
        centres=np.array([body.ball[0] for body in bodies]),
        radii=np.array([body.ball[1] for body in bodies]),
        widest=WIDEST if plane_slots.min() >= BOX_PLANES else WIDEST_OF_FACES,
        boxes=pieces.boxes,
        half_sizes=pieces.half_sizes + margins[:, None],
        margins=margins,
    )


@functools.lru_cache(maxsize=1024)
def _body_row(body: LinkBody, slots: int) -> Array:
    """Vertices, weights and radius in one row; unused slots repeat the first vertex with weight 0.

    A body with more vertices is in no pair on this side; its row is truncated and never read.
    """
    vertices = body.body.vertices[:slots]
    spare = slots - len(vertices)
    weights = np.append(np.ones(len(vertices)), np.zeros(spare))
    return read_only(np.concatenate([vertices.ravel(), np.tile(vertices[0], spare), weights, [body.body.radius]]))
