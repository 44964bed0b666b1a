"""Laws of the controller's clouds: every ball within reach is inside a piece, in C as in NumPy, and as an object each
piece is what its arrays say."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.collision import cell_bodies
from hdplan.planner.collision.cell_bodies import from_balls, pieces_of
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_shape
from hdplan.planner.collision.pieces import Pieces
from hdplan.scenes.array_types import Array
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Box, Cylinder, Sphere
from tests.loops import in_numpy

TURNED = Pose((0.1, -0.2, 0.05), (0.1, 0.3, -0.3, 0.9))
EVERYWHERE = np.array([[0.0, 0.0, 0.0, 1e7]])


def inside(bodies: Pieces | tuple[HalfspaceBody, ...], world: Array, radii: Array) -> Array:
    """Tell which balls are wholly in one body, in its planes and in its box."""
    found = np.zeros(len(world), dtype=bool)
    for body in bodies:
        local = np.abs((world - body.box[:3, 3]) @ body.box[:3, :3])
        within = (world @ body.normals.T - body.supports).max(axis=1) + radii <= 1e-9
        found |= within & (local + radii[:, None] <= body.half_size + 1e-9).all(axis=1)
    return found


@pytest.mark.parametrize("in_c", [True, False])
@pytest.mark.parametrize(
    ("flat", "spread"), [([1, 1, 1], 0.3), ([1, 1, 0], 0.5), ([1, 0, 0], 0.5), ([0, 0, 0], 0.1), ([1, 1, 1], 9e5)]
)
def test_every_ball_within_reach_is_inside_a_piece(
    in_c: bool, flat: list[int], spread: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not in_c:
        in_numpy(monkeypatch, cell_bodies)
    rng = np.random.default_rng(0)
    points, radii = rng.uniform(-spread, spread, (900, 3)) * flat, rng.uniform(1e-3, 0.01, 900)
    world = points @ TURNED.matrix[:3, :3].T + TURNED.matrix[:3, 3]
    reached = np.array([[0.3, 0.0, 0.1, 0.25], [-0.3, 0.1, 0.0, 0.15]])
    near = (np.linalg.norm(world[:, None] - reached[:, :3], axis=2) <= reached[:, 3] + radii[:, None]).any(axis=1)
    for cloud in (Cloud(points, radii), Cloud(points, radii, voxel=0.03)):
        few = pieces_of("view", cloud, TURNED, "box", reached)
        assert inside(few, world[near], radii[near]).all()
        if spread < 1.0:
            assert len(few) <= len(pieces_of("view", cloud, TURNED, "box", EVERYWHERE))
            assert inside(pieces_of("view", cloud, TURNED, "box", EVERYWHERE), world, radii).all()
    assert not len(pieces_of("view", Cloud(points, radii), TURNED, "box", reached[:0]))


def test_pieces_are_about_as_tight_in_c_as_those_of_the_planner() -> None:
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(-0.5, 0.5, (8000, 3)) * [1, 1, 0], rng.uniform(-0.3, 0.3, (4000, 3))])
    ours = pieces_of("view", Cloud(points, 0.005), TURNED, "box", EVERYWHERE)
    theirs = from_balls("view", FixedArray(np.column_stack([points, np.full(len(points), 0.005)])), TURNED, "box", True)
    volume = [sum(float(np.prod(body.half_size)) for body in bodies) for bodies in (ours, theirs)]
    assert len(ours) == pytest.approx(len(theirs), rel=0.1)
    assert volume[0] == pytest.approx(volume[1], rel=0.1)


def test_pieces_are_the_bodies_that_they_were_made_of() -> None:
    rng = np.random.default_rng(2)
    bodies = [
        from_shape(f"it{k}", shape, Pose(tuple(rng.normal(size=3)), (0.1, 0.3, -0.3, 0.9)).matrix)
        for k, shape in enumerate((Box((0.1, 0.2, 0.3)), Sphere(0.1), Box((0.4, 0.2, 0.1)), Cylinder(0.1, 0.3)))
    ]
    cloud = pieces_of("view", Cloud(rng.normal(size=(50, 3)), 0.01), TURNED, "box", EVERYWHERE)
    whole = Pieces.joined([Pieces.of(bodies[:2]), cloud, Pieces.of([]), Pieces.of(bodies[2:])])
    again = Pieces.of(list(whole))
    assert len(whole) == len(again) == 4 + len(cloud)
    for made, body in zip(whole, (*bodies[:2], *cloud, *bodies[2:]), strict=True):
        assert (made.name, made.joint, made.solid) == (body.name, body.joint, body.solid)
        for field in ("normals", "supports", "box", "half_size", "placement"):
            np.testing.assert_array_equal(getattr(made, field), getattr(body, field))
    for each, other in ((whole, again), (again, whole)):
        for directions in each.directions:
            assert any(a.shape == directions.shape and np.allclose(a, directions) for a in other.directions)
    assert len(whole.directions) == 3  # of boxes, a ball and a cylinder
    for body in bodies:
        assert any(
            a.shape == body.directions.shape and np.allclose(a, body.directions, atol=1e-8) for a in whole.directions
        )
    with pytest.raises(IndexError):
        whole[len(whole)]
