"""Laws of safe settings: bounds of the true distance by the barrier, and the refusal of what is provably unsafe."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hdplan import ConvexBody, InputError, Obstacle, Robot
from hdplan.control import BarrierSettings, ControlSettings, scene_barriers
from hdplan.distance.numpy_reference.hdsdf import hdsdf
from hdplan.planner.collision.box_pairs import BoxPairs
from hdplan.planner.control.barrier_safety import (
    separation_bound,
    shaped,
    straightened,
    sufficient_separation,
    touching_value,
    unshaped,
)
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Points, Sphere

from .rooms import link_and_obstacle, random_boxes, random_pose, scene_of


def test_shaping_is_inverted() -> None:
    for value in np.geomspace(1e-12, 10.0, 40).tolist():
        for gamma, length in ((1, 1e-3), (2, 0.03), (8, 1e-2)):
            assert shaped(unshaped(value, gamma, length), gamma, length) == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("normals", ["paper", "paper-multiset"])
def test_the_value_of_a_barrier_bounds_the_separation(normals: str, robot: Robot) -> None:
    """D ≥ δ leaves D̃ no less than `separation_bound`, wherever the boxes are, deep overlaps too."""
    rng = np.random.default_rng(5)
    length = 0.03
    settings = BarrierSettings("hdsdf-boxes", 2, length, 0.0, 0.0, normals)
    count = 12 * (1 if normals == "paper" else 5)
    tightest = np.inf
    for _ in range(12):
        body = ConvexBody.box(rng.uniform(0.03, 0.3, 3))
        barriers = link_and_obstacle(robot, body, random_boxes(rng, 1)[0], settings)
        _, distance = barriers.groups[0]
        assert isinstance(distance, BoxPairs)
        state = barriers.kinematics.evaluate(robot.draw(rng, 400))
        values, _, separations = distance(state, np.arange(400), np.zeros(400, dtype=np.int64))
        spare = separations - [separation_bound(value, 2, length, count, 4) for value in values.tolist()]
        assert spare.min() >= -1e-12
        tightest = min(tightest, spare.min())
    assert tightest < 0.05  # and it is not empty words


def test_a_vertex_that_touches_reads_no_less(robot: Robot) -> None:
    """The bound of `refuse_unsafe` for a touching vertex holds."""
    growth, length = 0.025, 0.03
    box, wall = ConvexBody.box([0.2, 0.2, 0.2]), ConvexBody.box([0.4 + 2 * growth] * 3)
    x = np.array([1.0, 1.0, 1.0]) / math.sqrt(3)  # the box stands on a corner
    y = np.array([1.0, -1.0, 0.0]) / math.sqrt(2)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(y, x), y, x])  # its diagonal along z
    pose[:3, 3] = [0, 0, 0.2 - (box.vertices @ pose[:3, :3].T)[:, 2].min()]  # touches the wall as it is
    for normals, alike in (("paper", 1), ("paper-multiset", 5)):
        value = float(hdsdf(box, pose, wall, np.eye(4), gamma=2, shaping_length=length, normals=normals))
        assert touching_value(growth, 2, length, 4, alike) - 1e-12 <= value < 0.0


def test_provably_unsafe_settings_are_refused_by_name() -> None:
    boxes = BarrierSettings("hdsdf-boxes", 2, 0.03, 0.025, 0.025, "paper-multiset")
    settings: tuple[tuple[dict[str, Any], str], ...] = (
        (dict(rate=300.0, period=0.005), "control.rate"),
        (dict(margin=0.0), "flat spot"),
        (dict(self_margin=0.0), "flat spot"),
        (dict(margin=-1e-9), "flat spot"),
        (dict(margin=-0.05), "lets bodies touch"),
        (dict(barriers=boxes, margin=-5e-3, self_margin=-1e-3), "lets bodies touch"),  # the paper's published code
        (dict(barriers=BarrierSettings("euclidean", growth=0.01, self_growth=0.0), margin=-0.02), "inside the true"),
        (dict(period=0.0), "ControlSettings.period"),
        (dict(speed=1.5), "ControlSettings.speed"),
        (dict(margin=math.nan), "ControlSettings.margin"),
    )
    for wrong, word in settings:
        with pytest.raises(InputError, match=word) as refused:
            ControlSettings(**wrong)
        assert "\n" not in str(refused.value)
    ControlSettings(margin=0.0, as_published=True)
    of_barriers: tuple[tuple[dict[str, Any], str], ...] = (
        (dict(distance="hdsd"), "hdsdf"),
        (dict(normals="paper"), "normals"),
        (dict(growth=-1.0), "growth"),
        (dict(gamma=0), "BarrierSettings.gamma"),
        (dict(shaping_length=-1.0), "BarrierSettings.shaping_length"),
    )
    for wrong, word in of_barriers:
        with pytest.raises(InputError, match=word):
            BarrierSettings(**wrong)


def test_sufficient_separation_bounds_the_distance(robot: Robot) -> None:
    """A D̃ of `sufficient_separation` leaves D no less than its δ, wherever the bodies are."""
    rng = np.random.default_rng(14)
    settings = BarrierSettings()
    barriers = scene_barriers(scene_of(*random_boxes(rng, 8)), robot, settings)
    tightest = np.inf
    for q in robot.draw(rng, 60):
        rows = barriers.evaluate(q)
        for delta in (1e-4, 4e-3, 5e-2):
            sure = rows.separation >= sufficient_separation(delta, 2, settings.shaping_length, barriers.corners)
            tightest = min(tightest, float((rows.value[sure] - delta).min(initial=np.inf)))
    assert 0.0 <= tightest < 2e-3  # and it is not empty words


def test_known_planes_of_an_obstacle_bound_the_distance(robot: Robot) -> None:
    """D ≥ δ keeps the true distance no less than `least_distance` of the obstacle's planes, and that is far more than
    what is proven of planes that are not known."""
    rng = np.random.default_rng(15)
    corner = tuple(map(tuple, rng.uniform(-0.1, 0.1, (12, 3)).tolist()))
    shapes = (Box((0.2, 0.1, 0.3)), Sphere(0.1), Cylinder(0.1, 0.3), Capsule(0.08, 0.2), Points(corner))
    tightest, exact = np.inf, BarrierSettings("euclidean", growth=0.0)
    for shape in shapes:
        for growth, delta, gamma, length in ((0.006, 0.014, 2, 1e-3), (0.0, 0.05, 1, 1e-2), (0.02, 4e-3, 4, 1e-3)):
            obstacle = Obstacle("it", shape, random_pose(rng))
            settings = BarrierSettings(gamma=gamma, shaping_length=length, growth=growth, self_growth=0.0)
            body = ConvexBody.from_points(rng.uniform(-0.1, 0.1, (4, 3)))
            made = [link_and_obstacle(robot, body, obstacle, each) for each in (settings, exact)]
            proven = made[0].clearance(delta)
            assert proven is not None
            assert proven >= separation_bound(delta, gamma, length, 50, 1) + growth - 1e-9
            for q in robot.draw(rng, 300):
                value, true = (barriers.evaluate(q).value[0] for barriers in made)
                if value >= delta:
                    assert true >= proven - 1e-6
                    tightest = min(tightest, true / proven)
    assert tightest < 2.0  # and it is not empty words


def test_straightened_is_the_shaping_undone() -> None:
    rng = np.random.default_rng(16)
    for u in (rng.choice([-1.0, 1.0], 40) * np.geomspace(1e-6, 1.0, 40)).tolist():
        for gamma, length in ((1, 1e-3), (2, 1e-3), (4, 1e-2)):
            read = [shaped(shaped(each, gamma, length), gamma, length) for each in (u, u * (1 + 1e-6), u * (1 - 1e-6))]
            found, slope = straightened(read[0], gamma, length)
            assert found == pytest.approx(u, rel=1e-6)
            assert slope == pytest.approx((read[1] - read[2]) / (2e-6 * u), rel=1e-5)
    assert [*map(float, straightened(0.0, 2, 1e-3))] == [0.0, 0.0]  # the flat spot
    for tiny in (5e-324, -1e-300, 1e-200, 0.0):  # where a distance underflows
        for gamma in (1, 2, 20, 1000):
            assert all(math.isfinite(each) for each in straightened(tiny, gamma, 1e-3))
