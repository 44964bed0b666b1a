"""Laws of the replay of a job: each stage as its own scene has it, and the arm as a plant executes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hdplan
from hdplan import JobResult, Scene
from hdplan.planner.control.computed_torque import LONGEST_STEP, Execution
from hdplan.planner.job.places import link_pose
from hdplan.planner.job.simulation import replay_job
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup


def test_each_stage_is_no_closer_than_it_is_proven(scene: Scene, planned: JobResult) -> None:
    """Pairs that may touch in a stage are not compared in it; the whole job succeeds."""
    done = replay_job(scene, planned.trajectory)
    assert done.succeeded, done.text
    assert [stage.name for stage, _ in done.stages] == [stage.name for stage in planned.certificate.stages]
    for stage, simulation in done.stages:
        assert stage.certificate.clearance is not None
        assert simulation.closest is not None
        assert simulation.closest.distance >= stage.certificate.clearance, stage.name
    assert done.tracking is None


def test_a_stage_that_meets_something_fails_by_its_name(scene: Scene, planned: JobResult) -> None:
    """A box in the way of the carried can alone, and a motion that ends too soon."""
    carry = next(stage for stage in planned.certificate.stages if stage.name == "carry")
    robot, middle = hdplan.load_robot(carry.scene.robot), carry.trajectory.at_time((carry.begins + carry.ends) / 2)
    columns = [carry.trajectory.joint_names.index(joint) for joint in robot.joint_names]
    can = link_pose(robot, middle.positions[columns], "panda_hand_tcp")[:3, 3]
    box = hdplan.Obstacle("late", hdplan.Box([0.02] * 3), can)
    done = replay_job(replace(scene, goal=None, obstacles=(*scene.obstacles, box)), planned.trajectory)
    assert done.text.startswith("failed: stage 'carry': ")
    assert "late touch" in done.text
    motion = planned.trajectory
    part = replace(motion.between(0, motion.stages[2].row), stages=motion.stages[:2])
    assert replay_job(scene, part).text == "failed: not whole: 'grip' has no motion"


@pytest.mark.parametrize("off", [1e-3, 0.3])
def test_a_plant_executes_the_arm_in_every_stage(scene: Scene, planned: JobResult, off: float) -> None:
    """Its greatest error in any stage is the job's, and contact in any of them a failure; fingers have no plant."""

    def plant(setup: Setup, curve: Curve) -> Execution:
        assert curve.times is not None
        times = np.arange(curve.times[0], curve.times[-1], LONGEST_STEP)
        errors = np.zeros((len(times), setup.robot.n))
        errors[:, 3] = off * (times > times.mean())
        return Execution(times, curve.at_time(times) - errors, errors, np.zeros_like(errors), False, 10 * errors)

    done = replay_job(scene, planned.trajectory, plant)
    assert [simulation.execution is None for _, simulation in done.stages] == [
        stage.kind in ("grip", "release") for stage, _ in done.stages
    ]
    assert done.tracking is not None
    np.testing.assert_allclose(done.tracking.position, off * (np.arange(7) == 3), rtol=0.02, atol=0)
    np.testing.assert_allclose(done.tracking.velocity, 10 * off * (np.arange(7) == 3), rtol=0.02, atol=0)
    assert done.succeeded == (off < 0.01), done.text
