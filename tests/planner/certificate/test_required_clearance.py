"""The scene alone sets the required clearance, for every command that certifies: plan, check, plot, view."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hdplan import Scene, Trajectory, load_scene, plan
from hdplan.planner.certificate.certifier import ENDS_KEEP, Certifier, certify
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.pictures.plot import Subject
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion

ROUNDING = 1e-9  # [m]


def with_clearance(scene: Scene, clearance: float) -> Scene:
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, clearance=clearance))


def bent(motion: Trajectory, rng: np.random.Generator) -> Trajectory:
    """The same ends by another way: a random bump over it all."""
    bump = np.sin(np.linspace(0.0, np.pi, len(motion)))
    size = rng.normal(scale=0.04, size=motion.positions.shape[1])
    return dataclasses.replace(motion, positions=motion.positions + np.outer(bump, size))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["panda_corridor", "ur5_table", "planar_arm"])
def test_only_motions_that_keep_the_required_clearance_are_certified(name: str) -> None:
    """Exact distances at samples judge: certified with at least what must be kept, and too close only where less is
    kept; less than the scene's is required only with a note, and never less than the share of its closest end."""
    scene, rng = load_scene(name), np.random.default_rng(13)
    robot = load_scene_robot(scene)
    query, seen = Setup.of(scene, robot).query, set()
    planned = plan(scene, robot=robot).trajectory
    for clearance in (0.005, 0.02, 0.06, 0.15):
        asking = with_clearance(scene, clearance)
        certifier = Certifier(Setup.of(asking, robot))
        at_ends = [certifier.nearest(q)[0] for q in (query.start, query.goal)]
        closest = min(place.distance for place in at_ends if place)
        allowed = clearance if closest >= clearance else ENDS_KEEP * closest
        for _ in range(6):
            motion = bent(planned, rng)
            found = certifier.certify(motion)
            assert bool(found.notes) == (allowed < clearance)
            if found.certified:
                assert found.clearance is not None
                assert found.clearance >= allowed - ROUNDING
            if found.status is Status.TOO_CLOSE:
                assert found.worst is not None
                assert 0 < found.worst.distance < allowed + ROUNDING
            free = certifier.certify(motion, required=0.0)
            assert free.certified >= found.certified
            seen.add(found.status)
    assert seen >= {Status.CERTIFIED, Status.TOO_CLOSE}


def test_every_door_says_the_same_as_plan() -> None:
    scene = with_clearance(load_scene("panda_table_pick"), 0.05)
    robot = load_scene_robot(scene)
    result = plan(scene, robot=robot)
    certifier = Certifier(Setup.of(scene, robot))
    doors = [
        certify(scene, result.trajectory, robot),
        certify(scene, result.trajectory, robot, check_ends=False),
        Subject.of(certifier, result.trajectory, (), "motion").certificate,
        ShownMotion.of("motion", result.trajectory, certifier).certificate,
    ]
    for certificate in doors:
        assert (certificate.status, certificate.text) == (result.certificate.status, result.certificate.text)
        assert certificate.notes
        assert set(certificate.notes) <= set(result.notes)


def test_less_than_required_is_too_close_and_both_numbers_are_reported() -> None:
    scene = load_scene("panda_bookshelf")  # planned as it is, the motion keeps less than its ends do
    found = certify(with_clearance(scene, 0.06), plan(scene).trajectory)
    assert found.status is Status.TOO_CLOSE
    assert "60 mm are required" in found.text
    assert 0.0 < found.worst.distance < 0.06
    assert found.notes == ()
