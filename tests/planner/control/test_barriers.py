"""Laws of the barriers: values and derivatives in three independent ways."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from hdplan import ConvexBody, Obstacle, Pose, Robot, SteadyMotion
from hdplan.control import Barriers, BarrierSettings, scene_barriers
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.numpy_reference.hdsdf import hdsdf, hdsdf_derivatives
from hdplan.planner.collision.halfspace_bodies import from_obstacle
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.shapes import Box

from .rooms import link_and_obstacle, random_boxes, random_pose, scene_of

DISTANCES = (
    BarrierSettings(),
    BarrierSettings("hdsdf-boxes", shaping_length=0.03, normals="paper"),
    BarrierSettings("hdsdf-boxes", shaping_length=0.01, normals="paper-multiset"),
    BarrierSettings("euclidean"),
    BarrierSettings("gdf"),
)


@pytest.mark.parametrize("settings", DISTANCES, ids=lambda s: f"{s.distance}-{s.normals}")
def test_gradients_are_those_of_finite_differences(settings: BarrierSettings, robot: Robot) -> None:
    rng = np.random.default_rng(1)
    barriers = scene_barriers(scene_of(*random_boxes(rng, 4)), robot, settings)
    step, loose = (1e-4, 2e-2) if settings.distance == "gdf" else (1e-6, 1e-5)  # the GDF's iteration ends roughly
    errors = []
    for q in robot.draw(rng, 4):
        rows = barriers.evaluate(q)
        for j, unit in enumerate(np.eye(robot.n)):
            ahead, behind = barriers.evaluate(q + step * unit).value, barriers.evaluate(q - step * unit).value
            errors.append(np.abs((ahead - behind) / (2 * step) - rows.gradient[:, j]))
    # exact distances have kinks, and the GDF none where bodies meet: a few differences may straddle one
    assert np.quantile(np.concatenate(errors), 0.99) < loose
    if settings.distance.startswith("hdsdf"):
        assert np.max(errors) < loose


@pytest.mark.core
def test_gradients_are_those_of_the_reference(robot: Robot) -> None:
    """NumPy's closed form by the body's twist, times Pinocchio's own Jacobian: nothing shared with the kernels."""
    rng = np.random.default_rng(9)
    box, obstacle = ConvexBody.box([0.08, 0.12, 0.2]), Obstacle("wall", Box((0.3, 0.1, 0.4)), random_pose(rng))
    wall, data = ConvexBody.box([0.3, 0.1, 0.4]), robot.model.createData()
    for normals in ("paper", "paper-multiset"):
        settings = BarrierSettings("hdsdf-boxes", 2, 0.02, 0.0, 0.0, normals)
        barriers = link_and_obstacle(robot, box, obstacle, settings)
        for q in robot.draw(rng, 10):
            jacobian = pin.computeJointJacobian(robot.model, data, q, 5)  # of the joint's twist, in its own frame
            pin.forwardKinematics(robot.model, data, q)
            by_twists = hdsdf_derivatives(
                box, data.oMi[5].homogeneous, wall, obstacle.pose.matrix,
                gamma=2, shaping_length=0.02, normals=normals,
            ).gradient  # fmt: skip
            rows = barriers.evaluate(q)
            np.testing.assert_allclose(rows.gradient[0], by_twists[:6] @ jacobian, atol=1e-9)


def test_barriers_are_their_distances(robot: Robot) -> None:
    rng, box = np.random.default_rng(3), ConvexBody.box([0.08, 0.12, 0.2])
    obstacle = random_boxes(rng, 1)[0]
    other = ConvexBody.box(obstacle.shape.size)
    for q in robot.draw(rng, 10):
        state, pose = kinematics_of(robot).evaluate(q), np.eye(4)
        pose[:3, :3], pose[:3, 3] = state.rotations[0, 5], state.translations[0, 5]
        for settings in (*DISTANCES[1:3], DISTANCES[4]):  # FclPairs has its own tests
            rows = link_and_obstacle(robot, box, obstacle, replace(settings, growth=0.01)).evaluate(q)
            if settings.distance == "gdf":
                expected = gdf(box, pose, other, obstacle.pose.matrix, tolerance=2e-4, iterations=300).distance - 0.01
            else:
                expected = float(hdsdf(
                    box, pose, other.inflated(0.01), obstacle.pose.matrix,
                    gamma=2, shaping_length=settings.shaping_length, normals=settings.normals,
                ))  # fmt: skip
            assert rows.value[0] == pytest.approx(expected, abs=1e-9)


def test_a_moving_obstacle_enters_with_its_own_speed(robot: Robot) -> None:
    motion = SteadyMotion((0.1, -0.3, 0.05), (0.2, -0.1, 0.7))
    obstacle = Obstacle("it", Box((0.1, 0.2, 0.3)), Pose((0.5, 0.2, 0.4)), motion=motion)
    rng = np.random.default_rng(4)
    moved = [(ObstacleMotion.of(obstacle), from_obstacle(Obstacle("it", Box((0.1, 0.2, 0.3))))[0])]
    links = [LinkBody("five", 5, ConvexBody.box([0.08, 0.12, 0.2]))]
    for settings in DISTANCES[:2]:
        barriers = Barriers(robot, kinematics_of(robot), links, [], [], settings, moved)
        for q, time in zip(robot.draw(rng, 8), rng.uniform(0, 1, 8), strict=True):
            rows = barriers.evaluate(q, time)
            ahead, behind = barriers.evaluate(q, time + 1e-6).value, barriers.evaluate(q, time - 1e-6).value
            np.testing.assert_allclose(rows.drift, (ahead - behind) / 2e-6, atol=1e-6)
