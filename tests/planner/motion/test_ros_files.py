"""Laws of the ROS formats: what is written reads back the same, to the nanosecond; all else is refused in one line."""

from __future__ import annotations

import copy
import importlib.util
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hdplan import InputError, Trajectory, certify, load_scene, plan
from hdplan.planner.certificate.rate_check import RateCheck
from hdplan.planner.motion import ros_bag
from hdplan.planner.motion.ros_message import joint_trajectory, read_message, robot_trajectory
from hdplan.planner.motion.trajectory_files import FORMATS, WRITERS, check_length, check_output
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup

ROS = tuple(ending for ending in FORMATS if ending not in (".json", ".csv", ".npz"))
NAMES = (
    "a", "b joint", "ç", "关节", "🤖", '"', "'", "\\", "#", "- ", ": {", "true", "1e-05", "~", "*x", "\u3000.", "time",
)  # fmt: skip
HALF_NANOSECOND = 0.5e-9


def random_motion(seed: int, count: int = 2) -> Trajectory:
    """A motion of joints with awkward names, through rows of numbers of all sizes, at whole nanoseconds; `count` of
    velocities and accelerations are given."""
    rng = np.random.default_rng(seed)
    names = tuple(rng.permutation(NAMES)[: rng.integers(1, 8)])
    shape = (int(rng.integers(2, 40)), len(names))
    steps = rng.integers(1, 10 ** rng.integers(1, 10), shape[0])
    given = [rng.normal(size=shape) * 10.0 ** rng.integers(-300, 1, size=shape) for _ in range(count)]
    return Trajectory(names, rng.normal(size=shape), {}, np.cumsum(steps) / 1e9, *given)


@pytest.mark.parametrize("ending", ROS)
@pytest.mark.parametrize("count", range(3))
def test_whole_nanoseconds_keep_every_bit_of_the_rows(tmp_path: Path, ending: str, count: int) -> None:
    for seed in range(15):
        before = random_motion(seed, count)
        before.save(tmp_path / f"m{ending}")
        after = Trajectory.load(tmp_path / f"m{ending}")
        assert_same(before, after)
        np.testing.assert_allclose(after.times, before.times, rtol=4e-16, atol=0)
        assert [file.name for file in tmp_path.iterdir()] == [f"m{ending}"]


def assert_same(before: Trajectory, after: Trajectory) -> None:
    assert after.joint_names == before.joint_names
    for key in ("positions", "velocities", "accelerations"):
        kept, read = getattr(before, key), getattr(after, key)
        assert (kept is None and read is None) or kept.tobytes() == read.tobytes()


@pytest.mark.parametrize("ending", ROS)
def test_paths_keep_every_bit_and_have_no_times(tmp_path: Path, ending: str) -> None:
    for seed in range(15):
        before = replace(random_motion(seed, 0), times=None)
        before.save(tmp_path / f"m{ending}")
        after = Trajectory.load(tmp_path / f"m{ending}")
        assert_same(before, after)
        assert after.times is None


@pytest.mark.parametrize("count", range(3))
def test_times_between_nanoseconds_are_read_off_the_same_motion(count: int) -> None:
    """Nothing moves any more once they are whole."""
    for seed in range(15):
        before = random_motion(seed, count)
        before = replace(before, times=np.cumsum(np.random.default_rng(seed).uniform(0.01, 0.1, len(before))))
        after = Trajectory(**read_message(joint_trajectory(before)))
        assert before.times is not None
        assert after.times is not None
        assert np.abs(after.times - before.times).max() <= HALF_NANOSECOND * 1.001
        assert before.positions[[0, -1]].tobytes() == after.positions[[0, -1]].tobytes()
        for order, key in enumerate(("positions", "velocities", "accelerations")[: count + 1]):
            fastest = before.curve.over_time(order + 1).largest() if count else np.zeros(1)
            moved = np.abs(getattr(after, key) - getattr(before, key)).max(axis=0)
            assert (moved <= HALF_NANOSECOND * 1.001 * fastest + 1e-12).all()
        assert joint_trajectory(after) == joint_trajectory(Trajectory(**read_message(joint_trajectory(after))))
        assert_same(after, Trajectory(**read_message(joint_trajectory(after))))


@pytest.mark.parametrize("rate", [100, 333, 700, 997])
def test_rounding_takes_no_more_of_a_limit_than_the_margin_that_is_left(rate: int) -> None:
    """The retimer leaves a millionth of velocity, acceleration and jerk (`retiming.MARGIN`). Rows that were kept while
    their times moved would take a thousand times as much."""
    scene = load_scene("ur5_pallet")
    robot = load_scene_robot(scene)
    duration = 1.2345678901234
    share = np.linspace(0.0, 1.0, int(duration * rate))[:, None]
    step = np.array([-0.5, 0.2, -0.3, 0.4, 0.1, 0.6])
    motion = Trajectory(  # a quintic from rest to rest
        robot.joint_names,
        (10 * share**3 - 15 * share**4 + 6 * share**5) * step,
        {},
        share[:, 0] * duration,
        (30 * share**2 - 60 * share**3 + 30 * share**4) * step / duration,
        (60 * share - 180 * share**2 + 120 * share**3) * step / duration**2,
    )
    after = Trajectory(**read_message(joint_trajectory(motion)))
    kept = replace(motion, times=after.times)
    check = RateCheck(Setup.of(scene, robot))
    found = (check.check(moved.curve).uses for moved in (motion, after, kept))
    shares, rounded, careless = ([use.share for use in uses] for uses in found)
    np.testing.assert_allclose(rounded, shares, rtol=1e-6)
    assert len(shares) == 3
    assert rate == 100 or not np.allclose(careless, shares, rtol=1e-5, atol=0)


@pytest.mark.parametrize("name", ["planar_arm", "panda_heavy"])
def test_shipped_scenes_keep_verdict_and_rows(tmp_path: Path, name: str) -> None:
    scene = load_scene(name)
    result = plan(scene)
    assert result.certified
    for ending in ROS:
        result.save(tmp_path / f"m{ending}")
        after = Trajectory.load(tmp_path / f"m{ending}")
        for key, off in (("positions", 2e-9), ("velocities", 2e-8), ("accelerations", 1e-6)):
            kept, read = getattr(result.trajectory, key), getattr(after, key)  # rows move to whole nanoseconds
            assert (kept is None and read is None) or np.abs(kept - read).max() < off
        assert certify(scene, after).certified


# --- what ROS makes of them -------------------------------------------------------------------------------------------


def test_yaml_is_what_ros2_reads() -> None:
    """`ros2 topic pub` loads YAML 1.1 by PyYAML and wants the fields of the message, of their types."""
    motion = random_motion(3)
    for ending, message in ((".joint_trajectory.yaml", joint_trajectory), (".robot_trajectory.yaml", robot_trajectory)):
        data = WRITERS[ending](motion, {})
        assert yaml.safe_load(data) == message(motion)
    inner = robot_trajectory(motion)["joint_trajectory"]
    assert list(inner) == ["header", "joint_names", "points"]
    for point in inner["points"]:
        assert list(point) == ["positions", "velocities", "accelerations", "effort", "time_from_start"]
        duration = point["time_from_start"]
        assert isinstance(duration["sec"], int)
        assert 0 <= duration["nanosec"] < 10**9


def test_the_librarys_own_decoder_reads_the_bag(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    motion = random_motion(5)
    motion.save(tmp_path / "m.mcap")
    with (tmp_path / "m.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        ((schema, channel, record, message),) = list(reader.iter_decoded_messages())
        assert reader.get_header().profile == "ros2"
    assert schema is not None
    assert (schema.name, schema.encoding) == ("trajectory_msgs/msg/JointTrajectory", "ros2msg")
    assert (channel.topic, channel.message_encoding, record.log_time) == ("/joint_trajectory", "cdr", 0)
    assert tuple(message.joint_names) == motion.joint_names
    assert motion.times is not None
    for i, point in enumerate(message.points):
        assert list(point.positions) == motion.positions[i].tolist()
        assert point.time_from_start.sec + point.time_from_start.nanosec * 1e-9 == pytest.approx(motion.times[i])


def test_a_bag_with_much_else_in_it(tmp_path: Path) -> None:
    """Other topics are passed over; MoveIt's message is read too; two trajectories are one too many."""
    motion = random_motion(7)
    robot = {"moveit_msgs/RobotTrajectory": "trajectory_msgs/JointTrajectory joint_trajectory", **ros_bag.PARTS}
    definition = f"\n{'=' * 80}\nMSG: ".join(f"{name}\n{text}" for name, text in robot.items()).partition("\n")[2]
    whole = {"joint_trajectory": joint_trajectory(motion)}
    moveit, text = ("moveit_msgs/msg/RobotTrajectory", definition, whole), ("x/msg/T", "string s", {"s": "?"})
    file = tmp_path / "m.mcap"
    file.write_bytes(bag(text, moveit, text))
    assert_same(motion, Trajectory.load(file))
    for messages, words in (((moveit, moveit), "one message of .* is expected, found 2"), ((text,), "of x/msg/T")):
        file.write_bytes(bag(*messages))
        with pytest.raises(InputError, match=words):
            Trajectory.load(file)


def bag(*messages: tuple[str, str, Any]) -> bytes:
    from mcap_ros2.writer import Writer

    file = io.BytesIO()
    with Writer(file) as writer:
        schemas = {name: writer.register_msgdef(name, text) for name, text, _ in messages}
        for name, _, message in messages:
            writer.write_message(f"/{name}", schemas[name], message, log_time=0)
    return file.getvalue()


# --- what others write ------------------------------------------------------------------------------------------------

ECHO = """\
header:
  stamp:
    sec: 12
    nanosec: 5
  frame_id: base
joint_names:
- a
- b
points:
- positions:
  - 0.0
  - 1e-05
  velocities: []
  accelerations: []
  effort: []
  time_from_start:
    sec: 0
    nanosec: 0
- positions: [1, -2]
  effort: [3.0, 4.0]
  time_from_start: {sec: 1, nanosec: 500000000}
---
"""


@pytest.mark.parametrize("name", ["m.yaml", "m.yml", "M.YAML", "m.joint_trajectory.yaml"])
def test_the_print_of_ros2_topic_echo_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(ECHO)
    motion = Trajectory.load(tmp_path / name)
    assert motion.joint_names == ("a", "b")
    np.testing.assert_array_equal(motion.positions, [[0.0, 1e-5], [1.0, -2.0]])
    np.testing.assert_array_equal(motion.times, [0.0, 1.5])
    assert motion.velocities is None


def test_ros_1_counts_secs_and_nsecs(tmp_path: Path) -> None:
    text = ECHO.replace("nanosec:", "nsecs:").replace("sec:", "secs:").replace("nsecss", "nsecs")
    (tmp_path / "m.yaml").write_text(text)
    np.testing.assert_array_equal(Trajectory.load(tmp_path / "m.yaml").times, [0.0, 1.5])


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.core
@pytest.mark.parametrize("ending", ROS)
def test_a_file_that_was_cut_off_is_refused(tmp_path: Path, ending: str) -> None:
    """A cut file is never read as a shorter motion."""
    before = random_motion(11)
    before.save(tmp_path / f"whole{ending}")
    data = (tmp_path / f"whole{ending}").read_bytes()
    cut = tmp_path / f"cut{ending}"
    rng = np.random.default_rng(0)
    for size in {0, 1, len(data) // 2, *rng.integers(0, len(data), 60).tolist()}:
        cut.write_bytes(data[:size])
        if (error := refusal(cut)) is None:  # only what says nothing of the motion is missing
            assert ending != ".mcap"
            assert_same(before, Trajectory.load(cut))
        else:
            assert error.startswith(f"{cut}: ")
            assert "\n" not in error
    cut.write_bytes(data[: len(data) // 2])
    assert refusal(cut) is not None


def refusal(path: Path) -> str | None:
    """Why a file is not read; None where it is."""
    try:
        Trajectory.load(path)
    except InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize("ending", ROS)
def test_bytes_that_were_changed_never_end_in_a_traceback(tmp_path: Path, ending: str) -> None:
    random_motion(13).save(tmp_path / f"whole{ending}")
    data = (tmp_path / f"whole{ending}").read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(60):
        broken = bytearray(data)
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            broken[place] = int(rng.integers(0, 256))
        (tmp_path / f"m{ending}").write_bytes(broken)
        assert "\n" not in (refusal(tmp_path / f"m{ending}") or "")


def changed(change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    message = copy.deepcopy(joint_trajectory(random_motion(17)))
    change(message)
    return message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m.update(positions=[]), r"unknown key 'positions' \(did you mean 'points'"),
        (lambda m: m.pop("points"), "is neither a trajectory_msgs/JointTrajectory"),
        (lambda m: m.update(points=[]), "points: must be a list of points"),
        (lambda m: m.update(points=m["points"][:1]), "at least 2"),
        (lambda m: m.update(joint_names="abc"), "joint_names: must be a list of joint names, found the text"),
        (lambda m: m["joint_names"].append("x"), r"points\[0\]\.positions: must be \d numbers, .* found"),
        (lambda m: m["points"][1].update(positions=[]), r"points\[1\]\.positions: must be"),
        (lambda m: m["points"][1].update(velocities=[]), r"points\[1\]\.velocities: .* while others have some"),
        (lambda m: m["points"][1]["positions"].__setitem__(0, float("nan")), r"points\[1\]\.positions\[0\]: must be a"),
        (lambda m: m["points"][1]["positions"].__setitem__(0, True), r"points\[1\]\.positions\[0\]: must be a"),
        (lambda m: m["points"][1].update(effort_=[]), r"points\[1\]: unknown key 'effort_'"),
        (lambda m: m["points"].__setitem__(1, [1, 2]), r"points\[1\]: must be a mapping"),
        (lambda m: m["points"][1].pop("time_from_start"), "times must increase"),
        (lambda m: m["points"][1].update(time_from_start=1.5), r"points\[1\]\.time_from_start: must be a mapping"),
        (lambda m: m["points"][1]["time_from_start"].update(nanosec=10**9), "nanosec: must be a whole number 0 to"),
        (lambda m: m["points"][1]["time_from_start"].update(sec=-1), "sec: must be a whole number 0 to"),
        (lambda m: m["points"][1]["time_from_start"].update(secs=1), r"time_from_start: unknown key '(nano)?sec'"),
    ],
)
def test_messages_that_are_not_trajectories_are_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], words: str
) -> None:
    message = changed(change)
    for whole in (message, {"joint_trajectory": message}):
        (tmp_path / "m.yaml").write_text(yaml.safe_dump(whole))
        if whole is not message and "is neither " in words:
            continue
        with pytest.raises(InputError, match=words) as caught:
            Trajectory.load(tmp_path / "m.yaml")
        assert str(caught.value).startswith(f"{tmp_path / 'm.yaml'}: ")


def test_another_message_is_named(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text("name: [a]\nposition: [1.0]\n")
    with pytest.raises(InputError, match=r"is neither a trajectory_msgs/JointTrajectory.* found name, position"):
        Trajectory.load(tmp_path / "m.yaml")
    whole = robot_trajectory(random_motion(19))
    whole["multi_dof_joint_trajectory"] = {"joint_names": ["base"], "points": []}
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(whole))
    with pytest.raises(InputError, match="multi_dof_joint_trajectory: moves a base"):
        Trajectory.load(tmp_path / "m.yaml")


@pytest.mark.parametrize("ending", ROS)
@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([-1.0, 0.0], "0 to 2147483647 s"),
        ([0.0, 3e9], "0 to 2147483647 s"),
        ([0.0, 1e-10], "waypoints 0 and 1 are 1e-10 s apart"),
    ],
)
def test_times_that_ros_cannot_hold_are_refused(tmp_path: Path, ending: str, times: list[float], words: str) -> None:
    motion = Trajectory(("a",), np.array([[0.0], [1.0]]), {}, np.array(times))
    with pytest.raises(InputError, match=words):
        motion.save(tmp_path / f"m{ending}")
    assert not list(tmp_path.iterdir())


def test_more_rows_than_yaml_is_read_of_are_refused(tmp_path: Path) -> None:
    motion = Trajectory(("a",), np.zeros((70_000, 1)), {}, np.arange(70_000.0))
    with pytest.raises(InputError, match=r"write \.mcap"):
        motion.save(tmp_path / "m.joint_trajectory.yaml")


@pytest.mark.parametrize("joints", [1, 7])
@pytest.mark.parametrize("ending", FORMATS)
def test_a_motion_too_long_for_its_file_is_refused_before_it_is_planned(
    tmp_path: Path, ending: str, joints: int
) -> None:
    """The words are those of the writer."""
    most, file = 1_000_000 // (3 * joints + 16), tmp_path / f"m{ending}"
    check_length(file, most, joints)
    if not ending.endswith(".yaml"):
        check_length(file, 100_000, joints)
        return
    rows = np.zeros((most + 1, joints))
    motion = Trajectory(tuple(f"j{i}" for i in range(joints)), rows, {}, np.arange(most + 1.0), rows, rows)
    with pytest.raises(InputError) as late:
        motion.save(file)
    with pytest.raises(InputError) as early:
        check_length(file, most + 1, joints)
    assert str(early.value) == str(late.value)


def test_the_ending_says_which_message(tmp_path: Path) -> None:
    for name in ("m.yaml", ".joint_trajectory.yaml", "m.bag"):
        with pytest.raises(InputError, match=r"\.joint_trajectory\.yaml, \.robot_trajectory\.yaml, \.mcap"):
            check_output(tmp_path / name)
    for ending in FORMATS:
        check_output(tmp_path / f"m{ending}")
    assert not list(tmp_path.iterdir())


def test_a_bag_is_refused_at_once_without_the_libraries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = random_motion(23)
    motion.save(tmp_path / "m.mcap")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for call in (check_output, motion.save, Trajectory.load):
        with pytest.raises(InputError, match=r"m\.mcap: ROS 2 bags need mcap, .*: pip install mcap mcap-ros2-support"):
            call(tmp_path / "m.mcap")
    motion.save(tmp_path / "m.robot_trajectory.yaml")
