"""What hdplan's certificate once got wrong, its siblings too: whatever proof a faulty certificate would have written,
the checker rejects it, and names what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hdplan.verify import RejectedError
from hdplan.verify.effects import check_torques
from hdplan.verify.kernel import VERSION, Motion
from hdplan.verify.reading import read_world
from hdplan.verify.verdict import statement
from hdplan.verify.world import World

from .worlds import packed, read, words_of

PANDA = (
    "robot: {name: panda, locked: {panda_finger_joint1: 0, panda_finger_joint2: 0}}\n"
    "start: {joints: [0, -0.785, 0, -2.356, 0, 1.571, 0.785]}\n"
)
GOAL = "goal: {joints: [0.5, -0.785, 0, -2.356, 0, 1.571, 0.785]}\n"
HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
NAMES = [f"panda_joint{i}" for i in range(1, 8)]

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


def forged(folder: Path, scene: str, names: list[str], motion: dict[str, object]) -> str:
    """Verify a proof in which one plane separates each pair, the best one of many at the first row, and which
    claims all that a scene may require."""
    (folder / "s.yaml").write_text("hdplan: 1\n" + scene)
    (folder / "m.json").write_text(json.dumps({"hdplan_trajectory": 1, "joint_names": names, **motion}))
    files = folder / "s.yaml", folder / "m.json"
    reading = read_world(*files)
    world = World(reading.world, {})
    count, rng = len(world.pairs), np.random.default_rng(0)
    start = Motion(world, np.array([[0.0, 2.0**-30]]))
    ways = np.rint(1e6 * rng.normal(size=(200, 3)))
    found = [start.gaps(np.zeros(len(ways), int), np.tile(pair, (len(ways), 1)), ways) for pair in world.pairs]
    best = np.array([ways[each.argmax()] for each in found]).reshape(-1, 3)
    own = world.within
    head = {
        "version": VERSION, "files": reading.hashes, "cuts": {}, "pairs": count,
        "clearance": None if own.all() else 1e-6, "self_clearance": 1e-6 if own.any() else None,
        "leaves": count, "rays": 0, "claims": ["limits", "start", "goal", *["torque"] * ("torque" in scene)],
    }  # fmt: skip
    arrays = np.ones(count, "<u4"), np.zeros(count, "<u1"), best.astype("<i4")
    return words_of(*files, packed(head, reading.world, b"".join(x.tobytes() for x in arrays)))


@pytest.mark.parametrize(
    "yoke",
    ['<link name="yoke"/>', '<link name="yoke"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'],
)
@pytest.mark.parametrize("at", ["0.5 0 0", "0.7 0.1 0"])
def test_two_links_with_one_without_geometry_between_them_are_no_neighbours(yoke: str, at: str, tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(ARM.format(yoke=yoke, at=at))
    scene = "robot: {urdf: r.urdf}\nstart: {joints: [-1, 0]}\ngoal: {joints: [1, 0]}\n"
    with pytest.raises(RejectedError, match=r"arm 0 and base 0: leaf 0, .* mm apart, not"):
        forged(tmp_path, scene, ["pan", "lift"], {"positions": [[-1, 0], [1, 0]]})


@pytest.mark.parametrize(
    "motion",
    [
        {"positions": [HOME, [0.5, *HOME[1:]]], "times": [0.0, 1e10], "velocities": [[1e308] * 7] * 2},
        {"positions": [HOME, [0.5, *HOME[1:]]], "times": [0.0, 1.0], "velocities": [[float("nan")] * 7] * 2},
        {"positions": [HOME, [float("inf"), *HOME[1:]]]},
        {"positions": [HOME, [0.5, *HOME[1:]]], "times": [1.0, 1.0]},
    ],
)
def test_numbers_beyond_measure_prove_nothing(motion: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(RejectedError, match=r"finite|is not a number|must increase"):
        forged(tmp_path, PANDA + GOAL, NAMES, motion)


@pytest.mark.parametrize("begin", [1e15, 1e10])
def test_times_so_late_that_they_leave_no_digits_are_rejected(begin: float, tmp_path: Path) -> None:
    rod = (
        "obstacles:\n- {name: rod, shape: {type: box, size: [3, 0.002, 0.002]}, pose: {position: [1.2, 0, 0.45]}, "
        "motion: {spin: [0, 0, 20.0]}}\n"
    )
    motion = {"positions": [HOME, [0.001, *HOME[1:]]], "times": [begin, begin + 1.0]}
    with pytest.raises(RejectedError, match="finite"):
        forged(tmp_path, rod + PANDA + GOAL, NAMES, motion)


def test_an_obstacle_that_spins_through_the_arm_is_not_kept_apart(tmp_path: Path) -> None:
    rod = (
        "obstacles:\n- {name: rod, shape: {type: box, size: [3, 0.002, 0.002]}, pose: {position: [1.2, 0, 0.45]}, "
        "motion: {spin: [0, 0, 20.0]}}\n"
    )
    motion = {"positions": [HOME, [0.001, *HOME[1:]]], "times": [0.0, 1.0]}
    with pytest.raises(RejectedError, match="and obstacle rod: leaf"):
        forged(tmp_path, rod + PANDA + GOAL, NAMES, motion)


@pytest.mark.parametrize("rates", [[0.5, 0.5], [0.5, 0.0], [0.0, 1e-3]])
def test_a_motion_that_begins_or_ends_at_speed_keeps_no_torque_limit(rates: list[float], tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(ARM.format(yoke='<link name="yoke"/>', at="-3 0 0"))
    scene = "robot: {urdf: r.urdf}\nstart: {joints: [0, 0]}\ngoal: {joints: [0.5, 0]}\nlimits: {torque: 1000}\n"
    scene += "payload: {link: arm, mass: 1}\n"
    motion = {"positions": [[0, 0], [0.5, 0]], "times": [0.0, 1.0], "velocities": [[rate, 0.0] for rate in rates]}
    with pytest.raises(RejectedError, match=r"leaf|begins or ends with a jump"):
        forged(tmp_path, scene, ["pan", "lift"], motion)
    world = read(tmp_path / "s.yaml", tmp_path / "m.json")
    with pytest.raises(RejectedError, match="begins or ends with a jump"):
        check_torques(world)


@pytest.mark.parametrize("over", [1e-3, 1e-6])
def test_a_joint_that_passes_its_limit_between_rows_is_beyond_it(over: float, tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(ARM.format(yoke='<link name="yoke"/>', at="-3 0 0"))
    rate = 8 * (0.5 + over)  # so that the cubic's middle is that far beyond its ends
    text = "robot: {urdf: r.urdf}\nstart: {joints: [2.5, 0]}\ngoal: {joints: [2.5, 0]}\nlimits: {acceleration: 100}\n"
    motion = {"positions": [[2.5, 0], [2.5, 0]], "times": [0.0, 1.0], "velocities": [[rate / 2, 0.0], [-rate / 2, 0.0]]}
    (tmp_path / "s.yaml").write_text("hdplan: 1\n" + text)
    (tmp_path / "m.json").write_text(json.dumps({"hdplan_trajectory": 1, "joint_names": ["pan", "lift"], **motion}))
    world = read(tmp_path / "s.yaml", tmp_path / "m.json")
    with pytest.raises(RejectedError, match=r"limits\.position: joint 'pan' is beyond it"):
        statement(world, {"claims": ["limits"], "clearance": None, "self_clearance": 1e-3})


@pytest.mark.parametrize("rule", ['<mimic joint="pan"/>', ""])
@pytest.mark.parametrize("seed", range(6))
def test_what_is_held_or_follows_does_so_between_rows_too(rule: str, seed: int, tmp_path: Path) -> None:
    """Rates that are as good as none swing a joint far if rows are hours apart."""
    rng = np.random.default_rng(seed)
    arm = ARM.replace('<axis xyz="0 1 0"/>', f'<axis xyz="0 1 0"/>{rule}')
    (tmp_path / "r.urdf").write_text(arm.format(yoke='<link name="yoke"/>', at="-3 0 0"))
    robot = "robot: {urdf: r.urdf, group: [pan]}" if rule else "robot: {urdf: r.urdf, locked: {lift: 0}}"
    (tmp_path / "s.yaml").write_text(f"hdplan: 1\n{robot}\nstart: {{joints: [0]}}\ngoal: {{joints: [0]}}\n")
    seconds, (one, two) = 10.0 ** rng.uniform(1, 6), rng.uniform(0.1, 0.9, 2) * 1e-6

    def moved(rates: list[float]) -> None:
        rows = {"positions": [[0, 0]] * 2, "velocities": [[0, 0]] * 2, "accelerations": [[0, x] for x in rates]}
        content = {"hdplan_trajectory": 1, "joint_names": ["pan", "lift"], "times": [0.0, seconds], **rows}
        (tmp_path / "m.json").write_text(json.dumps(content))
        read(tmp_path / "s.yaml", tmp_path / "m.json")

    x = np.linspace(0.0, 1.0, 101)
    swing = seconds**2 * np.abs(one * x**2 * (1 - x) ** 3 + two * x**3 * (1 - x) ** 2).max() / 2
    moved([0.0, 0.0])
    if swing > 1e-6:
        with pytest.raises(RejectedError, match="'lift' moves otherwise in the world"):
            moved([one, two])
    else:
        moved([one, two])
