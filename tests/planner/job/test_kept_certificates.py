"""Laws of certificates that are kept from planning: only of equal stages, and equal to new ones."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import hdplan
from hdplan.planner.job import certify
from hdplan.planner.job.certify import JobCertificate, certified_job
from hdplan.planner.motion.trajectory import Trajectory


def statements(certificate: JobCertificate) -> list[str]:
    """All that it says, but how long it took; NaN is itself."""
    found = [certificate.text, repr(certificate.missing)]
    for stage in certificate.stages:
        found.append(repr(replace(stage, trajectory=None)))
        values = {each.name: getattr(stage.certificate, each.name) for each in fields(stage.certificate)}
        found.append(repr({**values, "seconds": 0.0}))
    return found


def some_job() -> hdplan.Scene:
    table = hdplan.Box([0.6, 1.0, 0.1], name="table", pose=[0.5, 0.0, -0.05])
    can = hdplan.Cylinder(radius=0.03, length=0.12, name="can", pose=[0.5, 0.0, 0.06])
    down = hdplan.Pose.from_rpy([0.5, 0.0, 0.2], [np.pi, 0.0, 0.0])
    fingers = ["panda_leftfinger", "panda_rightfinger"]
    closed = {"panda_finger_joint1": 0.03, "panda_finger_joint2": 0.03}
    opened = dict.fromkeys(closed, 0.04)
    job = hdplan.Job([
        hdplan.Move(hdplan.PoseTarget("panda_hand_tcp", down, free_rotation="z"), blend=0.03),
        hdplan.Line(by=[0.0, 0.0, -0.1], touch=[["can", fingers]]),
        hdplan.Grip(closed, object="can", link="panda_hand", touch=[["can", fingers]]),
        hdplan.Line(by=[0.0, 0.0, 0.1], touch=[["can", "table"]], blend=0.02),
        hdplan.Line(by=[0.0, 0.1, 0.0]),
        hdplan.Wait(0.1),
    ])  # fmt: skip
    robot = hdplan.RobotSpec(name="panda", locked=opened)
    limits = hdplan.Limits(acceleration=7.5, jerk=500.0)
    return hdplan.Scene(robot=robot, obstacles=[table, can], start="default", limits=limits, job=job)


def test_kept_certificates_equal_new_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, pieces = some_job(), []
    monkeypatch.setattr(
        "hdplan.planner.job.planning.certified_job",
        lambda *given: (pieces.extend(given[2]), certified_job(*given))[1],
    )
    result = hdplan.plan_job(scene)
    assert result.certified, result.text
    again = hdplan.certify_job(scene, result.trajectory)
    assert statements(again) == statements(result.certificate)

    made: list[int] = []
    anew = certify.certified_stage
    monkeypatch.setattr(certify, "certified_stage", lambda *given: (made.append(given[1]), anew(*given))[1])

    def made_anew(scene: hdplan.Scene, motion: Trajectory) -> list[int]:
        """The stages that were not kept; the text of all is the same."""
        made.clear()
        kept = certified_job(scene, motion, pieces)
        stages = [*made]
        assert statements(kept) == statements(hdplan.certify_job(scene, motion))
        return stages

    motion = result.trajectory
    before = set(made_anew(scene, motion))
    assert not before  # moves, too, where they are blended; and what is not blended, whatever else is
    changed: set[int] = set()
    assert scene.job is not None
    rng, columns = np.random.default_rng(0), range(len(motion.joint_names))
    begins = [*(mark.row for mark in motion.stages), len(motion) - 1]
    for number in range(0, len(scene.job.stages) - 1, 2):  # one row of one joint is elsewhere by the last bit
        positions, row = motion.positions.copy(), int(rng.integers(begins[number] + 1, begins[number + 1]))
        positions[row] = np.nextafter(
            positions[row], 9.0, where=np.arange(len(columns)) == rng.choice(columns), out=positions[row].copy()
        )
        others = set(made_anew(scene, replace(motion, positions=positions))) - before
        assert others <= {number}
        changed |= others
    assert len(changed) > 1
    assert motion.times is not None
    slower = replace(motion, times=np.where(np.arange(len(motion)) > begins[4] + 2, motion.times + 1e-12, motion.times))
    assert 4 in made_anew(scene, slower)
    for change in (
        {"obstacles": [*scene.obstacles, hdplan.Sphere(0.02, name="ball", pose=[0.0, 0.9, 0.2])]},
        {"limits": replace(scene.limits, jerk=499.0)},
    ):
        assert made_anew(replace(scene, goal=None, **change), motion)[0] == 0
    stages = [*scene.job.stages]
    stages[4] = hdplan.Line(by=[0.0, 0.1, 0.0], position_tolerance=5e-4, name=scene.job.names[4])
    other = replace(scene, goal=None, job=hdplan.Job(stages))
    assert set(made_anew(other, motion)) == {3, 4}  # it, and the one that goes over into it


def test_reports_of_torques_have_the_times_of_the_job() -> None:
    limits = hdplan.Limits(acceleration=5.0, torque="urdf")
    job = hdplan.Job([hdplan.Wait(0.5), hdplan.Line(by=[0.0, 0.0, -0.05]), hdplan.Wait(0.1)])
    result = hdplan.plan_job(hdplan.Scene(robot="panda", start="default", limits=limits, job=job))
    assert result.certified, result.text
    assert statements(hdplan.certify_job(result.scene, result.trajectory)) == statements(result.certificate)
    line = result.certificate.stages[1]
    assert line.begins <= float(line.certificate.text.rpartition(" at ")[2].split()[0]) <= line.ends
