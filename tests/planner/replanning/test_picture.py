"""An obstacle that was seen before is, in a later picture, wherever it may be by then: the worlds are the same."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.replanning.picture import Picture, Sighting, Sightings
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.targets import JointTarget
from tests.planner.replanning.driving import limited


@pytest.mark.core
@pytest.mark.parametrize("seed", range(5))
def test_it_allows_the_same_worlds_as_the_sighting(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = hdplan.Pose.from_rpy(rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3))
    motion = hdplan.SteadyMotion(rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)) if seed else None
    sizes = hdplan.Uncertainty(rng.uniform(0, 0.1), rng.uniform(0, 0.5), rng.uniform(0.1, 0.5))
    seen = Sighting(hdplan.Obstacle("box", hdplan.Box([0.1, 0.2, 0.3]), pose, None, motion, sizes), rng.uniform(0, 9))
    at = seen.at + rng.uniform(0.0, 1.0)
    later = seen.later(at)
    assert later is not None
    assert later.uncertainty is not None
    times = at + np.array([0.0, 0.3, 2.0])
    places, others = (
        ObstacleMotion.of(each).at(times - zero) for each, zero in ((seen.obstacle, seen.at), (later, at))
    )
    np.testing.assert_allclose(places, others, atol=1e-12)
    assert later.uncertainty.orientation == sizes.orientation
    for t in times:
        reach = [each.position + each.speed * (t - zero) for each, zero in ((sizes, seen.at), (later.uncertainty, at))]
        np.testing.assert_allclose(*reach, rtol=1e-12)
    assert seen.later(seen.at + 1.1 / sizes.speed) is None  # it may be anywhere
    frozen = seen.frozen(at, 0.0)
    assert not frozen.moves
    np.testing.assert_allclose(frozen.pose.matrix, places[0], atol=1e-12)


def test_each_kind_of_picture_takes_the_place_of_its_own_kind() -> None:
    scene = limited("planar_arm")
    names = {each.name for each in scene.obstacles}
    box, ball = hdplan.Box([0.1, 0.1, 0.1], name="box", pose=[2, 0, 0]), hdplan.Sphere(0.1, name="ball", pose=[0, 2, 0])
    seen = Sightings.of(scene, 0.0).updated(1.0, [box], None, None)
    assert set(seen.all) == names | {"box"}
    seen = seen.updated(2.0, None, hdplan.Cloud([[3.0, 0.0, 0.0]], 0.01), {"box": [2.5, 0, 0]})
    assert set(seen.all) == names | {"box", "cloud"}
    assert (seen.all["box"].at, seen.all["ball"].at) == (2.0, 0.0)
    assert seen.all["box"].obstacle.pose.position == (2.5, 0.0, 0.0)
    seen = seen.updated(3.0, [ball], None, None)  # one of the scene's, seen again
    assert set(seen.all) == names | {"cloud"}
    assert seen.all["ball"].obstacle.pose.position == (0.0, 2.0, 0.0)


def test_a_picture_certifies_as_a_certifier_of_the_same_scene_does() -> None:
    scene = limited("planar_arm")
    found = hdplan.plan(scene).trajectory
    robot = Setup.of(scene).robot
    assert found.velocities is not None
    assert found.accelerations is not None
    rows = found.positions, found.velocities, found.accelerations
    assert found.times is not None
    h = float(found.times[1])
    sizes = hdplan.Uncertainty(0.001, 0.0, 0.003)
    moving = [dataclasses.replace(each, uncertainty=sizes) for each in scene.obstacles]
    at, begins = 2.0, 2.5
    picture = Picture(Sightings.of(scene.with_obstacles(moving), at), robot, found.positions[0])
    mine = picture.prove((rows[0], rows[1], rows[2]), begins, h, 0.2, 0.0)
    times = begins - at + h * np.arange(len(found) + 1)
    times[-1] = times[-2] + 0.2
    later = hdplan.Trajectory(
        found.joint_names,
        np.concatenate([rows[0], rows[0][-1:]]),
        found.locked,
        times,
        *(np.concatenate([each, 0 * each[-1:]]) for each in rows[1:]),
    )
    theirs = hdplan.certify(scene.with_obstacles(moving), later, robot, required=0.0)
    assert mine.certified
    assert theirs.certified
    assert mine.clearance is not None
    assert theirs.clearance is not None
    assert 0.0 < mine.clearance <= theirs.clearance + 0.05 * theirs.clearance + 5e-4
    for share in (0.5, 0.9):  # what is required is what is proven: it is not measured how much more there is
        more = picture.prove((rows[0], rows[1], rows[2]), begins, h, 0.2, share * theirs.clearance)
        assert more.certified
        assert more.clearance is not None
        assert more.clearance >= share * theirs.clearance
    assert not picture.prove((rows[0], rows[1], rows[2]), begins, h, 0.2, 1.1 * theirs.clearance + 5e-4).certified


def test_another_start_and_goal_are_checked_as_by_a_new_certifier() -> None:
    scene = limited("planar_arm")
    motion = hdplan.plan(scene).trajectory
    certifier = Certifier(Setup.of(scene.with_start([0.1, 0.1])))
    assert certifier.certify(motion).status.value == "wrong_ends"
    ends = (JointTarget(name, tuple(motion.positions[row].tolist())) for name, row in (("start", 0), ("goal", -1)))
    other = certifier.between(*ends)
    assert other.certify(motion).certified
    assert certifier.certify(motion).status.value == "wrong_ends"  # as before
    moving = JointTarget("start", tuple(motion.positions[0].tolist()), velocity=(0.1, 0.0))
    assert other.between(moving, other.scene.goal).certify(motion).status.value == "wrong_ends"


@pytest.mark.parametrize("cloud_first", [True, False])
def test_a_cloud_takes_the_place_of_no_obstacle_with_its_name(cloud_first: bool) -> None:
    seen = Sightings.of(limited("planar_arm"), 0.0)
    box, cloud = hdplan.Box([0.1, 0.1, 0.1], name="cloud", pose=[2, 0, 0]), hdplan.Cloud([[3.0, 0.0, 0.0]], 0.01)
    first: tuple[list[hdplan.Box] | None, hdplan.Cloud | None] = (None, cloud)
    second: tuple[list[hdplan.Box] | None, hdplan.Cloud | None] = ([box], None)
    if not cloud_first:
        first, second = second, first
    seen = seen.updated(1.0, *first, None)
    with pytest.raises(hdplan.InputError, match="cloud: its name 'cloud' is that of an obstacle; names must differ"):
        seen.updated(1.0, *second, None)
    with pytest.raises(hdplan.InputError, match="names must differ"):  # one that stands in the scene
        seen.updated(1.0, None, dataclasses.replace(cloud, name="ball"), None)
