"""Laws of the parts of links: together they contain the link's geometry, and each lies in its outer body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from hdplan.planner.collision import link_parts as module
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.collision.hull_distance import distance_to_hull
from hdplan.planner.collision.link_bodies import enclosed, in_joint, link_bodies, link_triangles
from hdplan.planner.collision.link_parts import link_parts
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.robot_spec import RobotSpec

ROUNDING = 1e-9  # [m]


@pytest.fixture(scope="module", params=["panda", "ur5", pytest.param("baxter", marks=pytest.mark.slow)])
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(RobotSpec(request.param))


def on_surface(rng: np.random.Generator, triangles: Array, count: int) -> Array:
    """Points of triangles (T, 3, 3), corners among them."""
    weights = rng.dirichlet(np.full(3, 0.3), count)
    return np.einsum("kc,kci->ki", weights, triangles[rng.integers(len(triangles), size=count)])


def beyond(part: Array, points: Array) -> Array:
    """How far points (k, 3) are beyond the farthest face of a part's hull [m], negative inside."""
    faces = ConvexHull(part).equations
    outside: Array = (points @ faces[:, :3].T + faces[:, 3]).max(axis=1)
    return outside


def test_parts_contain_the_link_and_lie_in_their_bodies(robot: Robot) -> None:
    rng = np.random.default_rng(4)
    for link in robot.links:
        parts, bodies = link_parts(robot, link), [each for each in link_bodies(robot) if each.link == link]
        assert len(parts) == len(bodies)
        for part, each in zip(parts, bodies, strict=True):
            assert (distance_to_hull(part, each.body.vertices)[0] <= each.body.radius + ROUNDING).all()
        points = in_joint(robot, link, on_surface(rng, link_triangles(robot, link), 300))
        assert np.min([beyond(part, points) for part in parts], axis=0).max() <= ROUNDING, link


def test_planes_contain_the_parts_and_are_no_wider_than_the_bodies(robot: Robot) -> None:
    model = collision_model_of(robot, "fitted", "box")
    parts = [part for link in robot.links for part in link_parts(robot, link)]
    for body, planes, part in zip(model.bodies, model.planes, parts, strict=True):
        assert (planes.normals @ part.T <= planes.supports[:, None] + ROUNDING).all()
        widest = (planes.normals @ body.body.vertices.T).max(axis=1) + body.body.radius
        assert (planes.supports <= widest + ROUNDING).all()


@pytest.mark.parametrize("geometry", ["hull", "box", "capsule", "outer-4", "outer-12"])
def test_bodies_of_every_kind_have_parts(geometry: str) -> None:
    """The link's own hull, of hundreds of corners, has parts, too."""
    robot = load_robot(RobotSpec("panda"))
    for link in robot.links:
        points = in_joint(robot, link, link_triangles(robot, link).reshape(-1, 3))
        parts = link_parts(robot, link, geometry)
        assert np.min([beyond(part, points) for part in parts], axis=0).max() <= ROUNDING, link


def test_parts_that_cannot_be_shown_leave_the_bodies(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path))
    link = next(name for name in robot.links if len(enclosed(robot, name)) > 1)
    smaller = tuple(type(each)(0.5 * each.vertices, 0.5 * each.radius) for each in enclosed(robot, link))
    monkeypatch.setattr(module, "enclosed", lambda *_: smaller)
    monkeypatch.setattr(module, "DEPTH", 3)
    assert link_parts(robot, link) == ()
