"""Random poses for tests and figures: the paper's randomization, and poses in contact by construction.

In: a random generator and a count. Out: poses of A and of B, two arrays (count, 4, 4), world from body [m].
"""

from __future__ import annotations

from itertools import combinations_with_replacement, permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from hdplan.distance.bodies import PLATONIC, SAME_PLANE, ConvexBody
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.once import read_only

PLATONIC_PAIRS = tuple(combinations_with_replacement(PLATONIC, 2))  # the 15 unordered pairs of names

TILTS = (-15.0, -3.0)  # powers of ten of the least and the largest tilt of bodies that are nearly aligned [rad]
SAME_HEIGHT = 1e-13  # of the body's size: corners this close to the farthest along a direction are as far
BLOCK = 8192  # poses made at once: what fits the processor's cache

# The 24 rotations that turn the axes into each other: exact, a permutation of the rows of the identity with signs.
_TURNS = [np.diag(signs)[list(order)] for order in permutations(range(3)) for signs in product((-1.0, 1.0), repeat=3)]
AXIS_TURNS = read_only(np.array([turn for turn in _TURNS if np.linalg.det(turn) > 0]))


def paper_poses(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return the paper's random poses (paper: section IV, filled in from its published code).

    Both translations uniform in [-2, 2]³ m, Euler angles (about x, y, z) uniform in [0, 2 pi].
    """
    poses_a, poses_b = (
        _poses(
            Rotation.from_euler("xyz", rng.uniform(0.0, 2.0 * np.pi, (count, 3))).as_matrix(),
            rng.uniform(-2.0, 2.0, (count, 3)),
        )
        for _ in range(2)
    )
    return poses_a, poses_b


def touching_poses(body_a: ConvexBody, body_b: ConvexBody, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return poses where the bodies share a point by construction: the signed distance is <= 0 but for rounding.

    That needs no oracle, so it tests the sign of any distance. Rotations: random; the axes of one along those of the
    other; a face or edge of one against a face or edge of the other; half of the latter two tilted by 1e-15 to 1e-3
    rad. Of each body a point is taken, and the two are placed on each other:

    * in half of the poses the farthest points along a direction g from B to A, so that a plane between them just
      touches both, d = 0. g is random, along a face or edge of A or of B, or across one of each.
    * in the other half any corner, or any point of an edge, of a face or of the whole body: they mostly overlap.

    Swept bodies: the points are set (r_A + r_B) g apart, so that the balls around them touch with opposed normals, or
    in a quarter of the poses by less.
    """
    counts = [min(BLOCK, count - start) for start in range(0, count, BLOCK)]
    blocks = [np.empty((2, 0, 4, 4)), *(_touching_block(body_a, body_b, rng, number) for number in counts)]
    poses_a, poses_b = np.concatenate(blocks, axis=1)
    return poses_a, poses_b


def _touching_block(body_a: ConvexBody, body_b: ConvexBody, rng: np.random.Generator, count: int) -> Array:
    turns_a = np.where(rng.random((count, 1, 1)) < 0.5, _any_turns(rng, count), AXIS_TURNS[rng.integers(0, 24, count)])
    turns_b = _facing_turns(body_a, turns_a, body_b, rng)
    g = _contact_directions(body_a, turns_a, body_b, turns_b, rng)
    just_touch = rng.random(count) < 0.5
    point_a, point_b = (
        _turned(_some_points(body, _turned(outward, np.swapaxes(turns, 1, 2)), just_touch, rng), turns)
        for body, turns, outward in ((body_a, turns_a, -g), (body_b, turns_b, g))
    )
    nearness = np.where(just_touch | (rng.random(count) < 0.5), 1.0, rng.random(count))
    offset = point_b - point_a + (nearness * (body_a.radius + body_b.radius))[:, None] * g
    size = body_a.reach + body_b.reach
    place_b = rng.uniform(-size, size, (count, 3)) * rng.integers(0, 2, (count, 1))  # half of them at the very origin
    return np.array([_poses(turns_a, place_b + offset), _poses(turns_b, place_b)])


def _facing_turns(body_a: ConvexBody, turns_a: Array, body_b: ConvexBody, rng: np.random.Generator) -> Array:
    """Return rotations (N, 3, 3) of B: random, along A's axes, or with a feature against one of A; a third each."""
    count = len(turns_a)
    along_axes = turns_a @ AXIS_TURNS[rng.integers(0, 24, count)]
    target = _frames(-_turned(_some_directions(body_a, rng, count), turns_a), rng)
    facing = target @ np.swapaxes(_frames(_some_directions(body_b, rng, count), rng), 1, 2)
    aligned = np.where(rng.random((count, 1, 1)) < 0.5, along_axes, facing)
    angles = 10.0 ** rng.uniform(*TILTS, (count, 1))
    tilted = Rotation.from_rotvec(angles * _units(rng, count)).as_matrix() @ aligned
    aligned = np.where(rng.random((count, 1, 1)) < 0.5, tilted, aligned)
    return np.where(rng.random((count, 1, 1)) < 1 / 3, _any_turns(rng, count), aligned)


def _contact_directions(
    body_a: ConvexBody, turns_a: Array, body_b: ConvexBody, turns_b: Array, rng: np.random.Generator
) -> Array:
    """Return unit vectors (N, 3) in the world: random, along a feature of A, of B, or across both; a quarter each."""
    count = len(turns_a)
    anywhere = _units(rng, count)
    along_a = -_turned(_some_directions(body_a, rng, count), turns_a)
    along_b = _turned(_some_directions(body_b, rng, count), turns_b)
    across = np.cross(along_a, along_b)
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(lengths > 0, across / np.where(lengths > 0, lengths, 1.0), anywhere)
    return np.stack([anywhere, along_a, along_b, across])[rng.integers(0, 4, count), np.arange(count)]


def _some_points(body: ConvexBody, outward: Array, farthest: Mask, rng: np.random.Generator) -> Array:
    """Return points (N, 3) of the polytope: where ``farthest``, the ones along ``outward`` (N, 3); else of any feature.

    A third are the feature's middle, a third a corner of it, a third any other point of it.
    """
    heights = outward @ body.vertices.T
    extreme = heights >= heights.max(1, keepdims=True) - SAME_HEIGHT * np.abs(body.vertices).max()
    features, share = _features(body)
    members = np.where(farthest[:, None], extreme, features[rng.choice(len(features), len(outward), p=share)])
    weights = members * (1.0 - rng.random(members.shape))  # in (0, 1]: never all of them 0
    kind = rng.integers(0, 3, len(outward))
    weights[kind == 0] = members[kind == 0]
    weights[kind == 1] = weights[kind == 1] == weights[kind == 1].max(1, keepdims=True)
    return np.asarray(weights @ body.vertices / weights.sum(1, keepdims=True))


def _features(body: ConvexBody) -> tuple[Mask, Array]:
    """Return which vertices (K, m) span each corner, edge, face and the whole, and how often to take it (K,)."""
    heights = body.faces @ body.vertices.T
    faces = heights >= heights.max(1, keepdims=True) - SAME_PLANE * np.abs(body.vertices).max()
    shared = faces.T.astype(int) @ faces.astype(int)  # two faces share the ends of an edge
    one, other = np.nonzero(np.triu(shared >= 2, 1))
    corners = np.eye(len(body.vertices), dtype=bool)
    kinds = [corners, corners[one] | corners[other], faces, np.ones((1, len(body.vertices)), dtype=bool)]
    kinds = [rows for rows in kinds if len(rows)]
    return np.vstack(kinds), np.concatenate([np.full(len(rows), 1.0 / len(rows) / len(kinds)) for rows in kinds])


def _some_directions(body: ConvexBody, rng: np.random.Generator, count: int) -> Array:
    """Return face normals and edge directions (count, 3) of the body; a point has the axes."""
    directions = np.vstack([body.faces, body.edges]) if len(body.edges) else np.eye(3)
    return np.asarray(directions[rng.integers(0, len(directions), count)])


def _frames(first: Array, rng: np.random.Generator) -> Array:
    """Return rotations (N, 3, 3) whose first columns are the unit vectors ``first`` (N, 3), otherwise random."""
    second = np.cross(first, _units(rng, len(first)))
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=2)


def _any_turns(rng: np.random.Generator, count: int) -> Array:
    """Return uniformly random rotations (count, 3, 3)."""
    return np.asarray(Rotation.from_quat(rng.normal(size=(count, 4))).as_matrix())


def _units(rng: np.random.Generator, count: int) -> Array:
    """Return uniformly random unit vectors (count, 3)."""
    vectors = rng.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _turned(vectors: Array, turns: Array) -> Array:
    """Return vectors (N, 3) turned by rotations (N, 3, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", turns, vectors))


def _poses(turns: Array, places: Array) -> Array:
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turns, places
    return poses
