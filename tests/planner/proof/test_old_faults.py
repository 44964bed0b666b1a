"""Former faults of hdplan's certificate, and their siblings: whatever proof a faulty certificate would have written,
the checker rejects it, and names what is wrong."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.verify import RejectedError
from hdplan.verify.effects import check_torques
from hdplan.verify.reading import read_world
from hdplan.verify.verdict import statement

from .forging import LIMITS, Data, forge
from .worlds import read, scene_files, words_of

HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
LEFT = [0.5, *HOME[1:]]
PANDA: Data = {
    "robot": {"name": "panda", "locked": {"panda_finger_joint1": 0, "panda_finger_joint2": 0}},
    "start": {"joints": HOME}, "goal": {"joints": LEFT},
}  # fmt: skip
NAMES = [f"panda_joint{i}" for i in range(1, 8)]
ROD: Data = {
    "name": "rod", "shape": {"type": "box", "size": [3, 0.002, 0.002]}, "pose": {"position": [1.2, 0, 0.45]},
    "motion": {"spin": [0, 0, 20.0]},
}  # fmt: skip
ARM = """<robot name="r">
 <link name="base"><collision><origin xyz="{at}"/><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
 {yoke}
 <link name="arm"><collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.05 0.05"/></geometry></collision></link>
 <joint name="pan" type="revolute"><parent link="base"/><child link="yoke"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" velocity="2" effort="10"/></joint>
 <joint name="lift" type="revolute"><parent link="yoke"/><child link="arm"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" velocity="2" effort="10"/></joint>
</robot>
"""


def arm_of(place: str = "-3 0 0", yoke: str = '<link name="yoke"/>') -> dict[str, str]:
    return {"r.urdf": ARM.format(at=place, yoke=yoke)}


def turning(start: float, goal: float, **more: Any) -> Data:
    ends = {"start": {"joints": [start, 0]}, "goal": {"joints": [goal, 0]}}
    return {"robot": {"urdf": "r.urdf"}, **ends, **more}


def forged(folder: Path, scene: Data, motion: Data, others: dict[str, str] | None = None) -> str:
    """Verify a proof with one plane for each pair, which claims all that the scene may require."""
    files = scene_files(folder, scene, motion, others)
    reading = read_world(*files)
    claims = [*LIMITS, *["torque"] * ("torque" in scene.get("limits", {}))]
    return words_of(*files, forge(reading.world, reading.hashes, claims, depth=0))


@pytest.mark.parametrize(
    "yoke",
    ['<link name="yoke"/>', '<link name="yoke"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'],
)
@pytest.mark.parametrize("at", ["0.5 0 0", "0.7 0.1 0"])
def test_two_links_with_one_without_geometry_between_them_are_no_neighbours(yoke: str, at: str, tmp_path: Path) -> None:
    motion = {"joint_names": ["pan", "lift"], "positions": [[-1, 0], [1, 0]]}
    with pytest.raises(RejectedError, match=r"arm 0 and base 0: leaf 0, .* mm apart, not"):
        forged(tmp_path, turning(-1, 1), motion, arm_of(at, yoke))


@pytest.mark.parametrize(
    "motion",
    [
        {"positions": [HOME, LEFT], "times": [0.0, 1e10], "velocities": [[1e308] * 7] * 2},
        {"positions": [HOME, LEFT], "times": [0.0, 1.0], "velocities": [[float("nan")] * 7] * 2},
        {"positions": [HOME, [float("inf"), *HOME[1:]]]},
        {"positions": [HOME, LEFT], "times": [1.0, 1.0]},
    ],
)
def test_numbers_beyond_measure_prove_nothing(motion: Data, tmp_path: Path) -> None:
    with pytest.raises(RejectedError, match=r"finite|is not a number|must increase"):
        forged(tmp_path, PANDA, {"joint_names": NAMES, **motion})


@pytest.mark.parametrize("begin", [1e15, 1e10])
def test_times_so_late_that_they_leave_no_digits_are_rejected(begin: float, tmp_path: Path) -> None:
    motion = {"positions": [HOME, [0.001, *HOME[1:]]], "times": [begin, begin + 1.0]}
    with pytest.raises(RejectedError, match="finite"):
        forged(tmp_path, {**PANDA, "obstacles": [ROD]}, {"joint_names": NAMES, **motion})


def test_an_obstacle_that_spins_through_the_arm_is_not_kept_apart(tmp_path: Path) -> None:
    motion = {"positions": [HOME, [0.001, *HOME[1:]]], "times": [0.0, 1.0]}
    with pytest.raises(RejectedError, match="and obstacle rod: leaf"):
        forged(tmp_path, {**PANDA, "obstacles": [ROD]}, {"joint_names": NAMES, **motion})


@pytest.mark.parametrize("rates", [[0.5, 0.5], [0.5, 0.0], [0.0, 1e-3]])
def test_a_motion_that_begins_or_ends_at_speed_keeps_no_torque_limit(rates: list[float], tmp_path: Path) -> None:
    scene = turning(0, 0.5, limits={"torque": 1000}, payload={"link": "arm", "mass": 1})
    motion = {"joint_names": ["pan", "lift"], "positions": [[0, 0], [0.5, 0]], "times": [0.0, 1.0]}
    with pytest.raises(RejectedError, match=r"leaf|begins or ends with a jump"):
        forged(tmp_path, scene, {**motion, "velocities": [[rate, 0.0] for rate in rates]}, arm_of())
    world = read(tmp_path / "s.yaml", tmp_path / "m.json")
    with pytest.raises(RejectedError, match="begins or ends with a jump"):
        check_torques(world)


@pytest.mark.parametrize("over", [1e-3, 1e-6])
def test_a_joint_that_passes_its_limit_between_rows_is_beyond_it(over: float, tmp_path: Path) -> None:
    rate = 8 * (0.5 + over)  # so that the cubic's middle is that far beyond its ends
    motion = {"joint_names": ["pan", "lift"], "positions": [[2.5, 0], [2.5, 0]], "times": [0.0, 1.0]}
    motion |= {"velocities": [[rate / 2, 0.0], [-rate / 2, 0.0]]}
    world = read(*scene_files(tmp_path, turning(2.5, 2.5, limits={"acceleration": 100}), motion, arm_of()))
    with pytest.raises(RejectedError, match=r"limits\.position: joint 'pan' is beyond it"):
        statement(world, {"claims": ["limits"], "clearance": None, "self_clearance": 1e-3})


@pytest.mark.parametrize("rule", ['<mimic joint="pan"/>', ""])
@pytest.mark.parametrize("seed", range(6))
def test_joints_are_held_or_follow_between_rows_too(rule: str, seed: int, tmp_path: Path) -> None:
    """Rates that are as good as none swing a joint far if rows are hours apart."""
    rng = np.random.default_rng(seed)
    arm = ARM.replace('<axis xyz="0 1 0"/>', f'<axis xyz="0 1 0"/>{rule}')
    robot = {"urdf": "r.urdf", **({"group": ["pan"]} if rule else {"locked": {"lift": 0}})}
    scene = {"robot": robot, "start": {"joints": [0]}, "goal": {"joints": [0]}}
    seconds, (one, two) = 10.0 ** rng.uniform(1, 6), rng.uniform(0.1, 0.9, 2) * 1e-6

    def moved(rates: list[float]) -> None:
        rows = {"positions": [[0, 0]] * 2, "velocities": [[0, 0]] * 2, "accelerations": [[0, x] for x in rates]}
        motion = {"joint_names": ["pan", "lift"], "times": [0.0, seconds], **rows}
        read(*scene_files(tmp_path, scene, motion, {"r.urdf": arm.format(yoke='<link name="yoke"/>', at="-3 0 0")}))

    x = np.linspace(0.0, 1.0, 101)
    swing = seconds**2 * np.abs(one * x**2 * (1 - x) ** 3 + two * x**3 * (1 - x) ** 2).max() / 2
    moved([0.0, 0.0])
    refused = pytest.raises(RejectedError, match="'lift' moves otherwise in the world")
    with refused if swing > 1e-6 else nullcontext():
        moved([one, two])
