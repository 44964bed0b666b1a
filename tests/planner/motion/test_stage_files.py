"""Laws of files of a job's motion: stages come back as they were, bags have a message for each, others refuse them."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan import InputError, StageMark, Trajectory
from hdplan.planner.motion.ros_stages import stage_messages

NAMES = ("up, down", 'say "so"', "1", "Höhe", "grip", " a ", "x.velocity", "time")


def job_motion(seed: int) -> Trajectory:
    """Arm and fingers in turn, of a job that begins at any time; some arm joints never move."""
    rng = np.random.default_rng(seed)
    arm, fingers = [f"a{i}" for i in range(4)], [f"f{i}" for i in range(int(rng.integers(1, 3)))]
    at, rows, marks = np.zeros(4 + len(fingers)), [np.zeros(4 + len(fingers))], []
    for number, name in enumerate(rng.permutation(NAMES)[: rng.integers(2, 8)]):
        marks.append(StageMark(str(name), len(rows) - 1))
        moving = slice(4, None) if number % 2 else slice(0, 3)
        for _ in range(int(rng.integers(1, 5))):
            at = at.copy()
            at[moving] += rng.uniform(0.1, 0.2, at[moving].shape)
            rows.append(at)
    times = rng.uniform(0, 2) + np.cumsum(rng.integers(10**6, 10**8, len(rows))) / 1e9
    return Trajectory([*arm, *fingers], np.array(rows), {"held": 0.1}, times, stages=tuple(marks))


@pytest.mark.parametrize("seed", range(20))
def test_stages_come_back(seed: int, tmp_path: Path) -> None:
    motion = job_motion(seed)
    for ending in ("json", "csv", "npz"):
        motion.save(tmp_path / f"job.{ending}")
        again = Trajectory.load(tmp_path / f"job.{ending}")
        assert again.stages == motion.stages
        assert np.array_equal(again.positions, motion.positions)
        assert again.joint_names == motion.joint_names
    for ending in ("joint_trajectory.yaml", "robot_trajectory.yaml"):
        with pytest.raises(InputError, match=f"this job has {len(motion.stages)} stages"):
            motion.save(tmp_path / f"job.{ending}")


@pytest.mark.parametrize("seed", range(20))
def test_every_stage_is_sent_when_it_begins(seed: int) -> None:
    motion = job_motion(seed)
    assert motion.times is not None
    sent = list(stage_messages(motion))
    rows = [*(mark.row for mark in motion.stages), len(motion) - 1]
    marks = [(now, message["data"]) for now, topic, message in sent if topic == "/stage"]
    begins = [round((motion.times[row] - motion.times[0]) * 1e9) for row in rows[:-1]]
    assert marks == list(zip(begins, [mark.name for mark in motion.stages], strict=True))
    arms = [(now, message) for now, topic, message in sent if topic == "/joint_trajectory"]
    assert [now for now, _ in arms] == begins[::2]
    for (_, message), first, last in zip(arms, rows[0:-1:2], rows[1::2], strict=True):
        assert message["joint_names"] == ["a0", "a1", "a2", "a3"]  # the one that never moves, too
        points = message["points"]
        np.testing.assert_array_equal([x["positions"] for x in points], motion.positions[first : last + 1, :4])
        took = [x["time_from_start"]["sec"] + x["time_from_start"]["nanosec"] / 1e9 for x in points]
        np.testing.assert_allclose(took, motion.times[first : last + 1] - motion.times[first], atol=1e-9)
        stamp = message["header"]["stamp"]
        assert stamp["sec"] * 10**9 + stamp["nanosec"] in begins
    hands = [(now, topic, message) for now, topic, message in sent if topic.startswith("/gripper_command")]
    fingers = motion.joint_names[4:]
    assert [now for now, _, _ in hands] == [now for now in begins[1::2] for _ in fingers]
    topics = ["/gripper_command"] if len(fingers) == 1 else [f"/gripper_command/{x}" for x in fingers]
    assert {topic for _, topic, _ in hands} == {*topics}
    for i, (_, _, message) in enumerate(hands):
        end = rows[2 + 2 * (i // len(fingers))]
        assert message == {"position": motion.positions[end, 4 + i % len(fingers)], "max_effort": 0.0}


def test_a_bag_of_a_job_is_read_by_others_and_refused_here(tmp_path: Path) -> None:
    pytest.importorskip("mcap_ros2")
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    motion = job_motion(1)
    motion.save(tmp_path / "job.mcap")
    data = (tmp_path / "job.mcap").read_bytes()
    found: list[Any] = list(make_reader(io.BytesIO(data), decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    assert {(channel.topic.split("/")[1], schema.name) for schema, channel, _, _ in found} == {
        ("joint_trajectory", "trajectory_msgs/msg/JointTrajectory"),
        ("gripper_command", "control_msgs/msg/GripperCommand"),
        ("stage", "std_msgs/msg/String"),
    }
    sent = list(stage_messages(motion))
    assert sorted((message.log_time, channel.topic) for _, channel, message, _ in found) == sorted(x[:2] for x in sent)
    with pytest.raises(InputError, match="holds the stages of a job"):
        Trajectory.load(tmp_path / "job.mcap")


def test_stages_that_a_table_cannot_hold_are_refused(tmp_path: Path) -> None:
    motion = job_motion(2)
    numbers = tuple(StageMark(str(i), mark.row) for i, mark in enumerate(motion.stages))
    joints = ("stage", *motion.joint_names[1:])
    for forged in (replace(motion, stages=numbers), replace(motion, joint_names=joints)):
        with pytest.raises(InputError, match=r"write \.json"):
            forged.save(tmp_path / "job.csv")
    plain = replace(motion, joint_names=joints, stages=())  # a joint of that name in numbers is one
    plain.save(tmp_path / "plain.csv")
    assert Trajectory.load(tmp_path / "plain.csv").joint_names == joints
