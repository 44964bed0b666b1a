"""Pairs of links that always or never touch: found where no SRDF says it, and written out as one."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

from hdplan import InputError, Robot, RobotSpec, Scene, SelfCollision, Trajectory, certify, load_robot
from hdplan.planner.commands.robots import run_robots
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING, LIMIT_EXCESS, NEVER_TOUCHING
from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.srdf import srdf_of

from ..urdf import joint_text, link_text, write_robot

SHAPES = ("<sphere radius='{r}'/>", "<box size='{r} {s} {s}'/>", "<cylinder radius='{r}' length='{s}'/>")


def random_robot(rng: np.random.Generator, folder: Path) -> RobotSpec:
    """A tree of bodies of several shapes, near enough to touch now and then; some joints are a hand's, or mimic one."""
    count, parts = int(rng.integers(4, 9)), []
    for i in range(count):
        shapes = []
        for _ in range(int(rng.integers(0, 3))):
            shape = rng.choice(SHAPES).format(r=rng.uniform(0.02, 0.2), s=rng.uniform(0.02, 0.3))
            x, y, z = rng.normal(size=3) * 0.1
            shapes.append(f"<collision><origin xyz='{x} {y} {z}'/><geometry>{shape}</geometry></collision>")
        parts.append(f"<link name='l{i}'>{''.join(shapes)}</link>")
    for i in range(1, count):
        parent = int(rng.integers(max(0, i - 3), i))
        kind = rng.choice(["fixed", "revolute", "prismatic", "continuous"])
        name = f"finger{i}" if i == count - 1 and i > 1 else f"j{i}"
        follows = f"<mimic joint='j{i - 1}' multiplier='1.5' offset='0.3'/>" if rng.uniform() < 0.15 and i > 1 else ""
        (x, y, z), (u, v, w) = rng.normal(size=3) * rng.choice([0.05, 0.3]), rng.normal(size=3)
        parts.append(
            f"<joint name='{name}' type='{kind}'><parent link='l{parent}'/><child link='l{i}'/>"
            f"<origin xyz='{x} {y} {z}' rpy='{u} {v} {w}'/><axis xyz='{v} {w} {u}'/>"
            f"<limit lower='-{rng.uniform(0, 1)}' upper='0.4' velocity='1' effort='1'/>{follows}</joint>"
        )
    path = folder / f"tree{rng.integers(1 << 40)}.urdf"
    path.write_text(f"<robot name='a &amp; b'>{''.join(parts)}</robot>")
    return RobotSpec(urdf=path)


def touching(robot: Robot, q: np.ndarray) -> set[tuple[str, str]]:
    data, geometry = robot.model.createData(), pin.GeometryData(robot.collision)
    pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry, robot.pin_q(q))
    items = robot.collision.geometryObjects

    def distance(i: int, j: int) -> float:
        poses = [coal.Transform3s(geometry.oMg[k].rotation, geometry.oMg[k].translation) for k in (i, j)]
        result = coal.DistanceResult()
        return coal.distance(items[i].geometry, poses[0], items[j].geometry, poses[1], coal.DistanceRequest(), result)

    return {
        (a, b)
        for a, b in itertools.combinations(sorted(robot.links), 2)
        if any(distance(i, j) <= 0 for i in robot.link_geometry[a] for j in robot.link_geometry[b])
    }


def robots(seed: int, count: int, folder: Path) -> list[RobotSpec]:
    """Random ones that have a joint left to plan."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        spec = random_robot(rng, folder)
        try:
            load_robot(spec)
        except InputError:
            continue
        found.append(spec)
    return found


def test_pairs_that_are_proven_never_to_touch_do_not(tmp_path: Path) -> None:
    """Random configurations and the corners of the limits are tried, also with held joints a little beyond theirs."""
    rng, seen = np.random.default_rng(5), 0
    for spec in robots(3, 40, tmp_path):
        free = load_robot(spec)
        ranges = zip(free.joint_names[:-1], np.maximum(free.lower, -2.0), np.minimum(free.upper, 2.0), strict=False)
        some = [each for each in ranges if rng.uniform() < 0.3]
        held = {name: rng.uniform(low - LIMIT_EXCESS, high + LIMIT_EXCESS) for name, low, high in some}
        for robot in (free, load_robot(replace(spec, locked=held))):
            never = {pair for pair, reason in robot.unchecked.items() if reason == NEVER_TOUCHING}
            seen += len(never)
            assert (f"never to touch, not checked: {len(never)}" in " ".join(robot.notes)) is bool(never)
            if not never:
                continue
            samples = robot.draw(rng, 60)
            corners = np.where(rng.uniform(size=samples.shape) < 0.5, robot.lower, robot.upper)
            samples[:20] = np.where(np.isfinite(corners), corners, samples)[:20]
            for q in samples:
                assert not never & touching(robot, q)
    assert seen > 40


def test_an_srdf_written_and_read_back_gives_the_same_pairs(tmp_path: Path) -> None:
    reasons = dict.fromkeys(("Adjacent", "Always", "Never"), 0)
    for spec in robots(7, 60, tmp_path):
        alone = load_robot(spec)
        text, counts = srdf_of(spec)
        out = tmp_path / "out.srdf"
        out.write_text(text)
        with_srdf = replace(spec, srdf=out)
        beside = load_robot(with_srdf)
        assert beside.self_pairs == alone.self_pairs
        assert beside.joint_names == alone.joint_names
        assert beside.locked == alone.locked
        for name, count in counts.items():
            assert text.count(f'reason="{name}"') == count
            reasons[name] += count
        with pytest.raises(InputError, match=r"--srdf: .* has an SRDF: .*out\.srdf"):
            srdf_of(with_srdf)
    assert min(reasons.values()) > 3, reasons


ARM = (
    link_text("base", sphere=0.1),
    link_text("upper"),
    link_text("tip", sphere=0.1),
    joint_text("a", "base", "upper", at="0 0 0.5"),
    joint_text("b", "upper", "tip"),
)


def test_pairs_that_never_touch_are_checked_where_more_is_required(tmp_path: Path) -> None:
    """Links 0.3 m apart at every configuration are not 0.4 m apart."""
    spec = RobotSpec(urdf=write_robot(tmp_path / "arm.urdf", *ARM))
    assert load_robot(spec).unchecked == {("base", "tip"): NEVER_TOUCHING}
    motion = Trajectory(("a", "b"), np.array([[0.0, 0.0], [0.5, 0.5]]))
    for clearance, certified in ((0.0, True), (0.25, True), (0.4, False)):
        scene = Scene(robot=spec, start=[0.0, 0.0], goal=[0.5, 0.5], self_collision=SelfCollision(clearance=clearance))
        judged = certify(scene, motion)
        assert judged.certified is certified, judged.text
        assert load_scene_robot(scene).self_pairs == ((("base", "tip"),) if clearance else ())
        if clearance:
            with pytest.raises(InputError, match="base and tip are not checked against each other, the scene's are"):
                Setup.of(scene, load_robot(spec))


def test_the_command_writes_the_file_whole_or_not_at_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, out = str(write_robot(tmp_path / "arm.urdf", *ARM)), tmp_path / "arm.srdf"
    for name, target, message in (
        (robot, tmp_path / "arm.xml", r"ending '\.xml', allowed are \.srdf"),
        (robot, tmp_path / "no" / "arm.srdf", "does not exist"),
        ("panda", out, "--srdf: panda has an SRDF"),
        ("pnda", out, "unknown robot 'pnda'"),
        (str(tmp_path / "leg.urdf"), out, r"leg\.urdf: no such file"),
        (None, out, "--srdf: of which robot"),
    ):
        with pytest.raises(InputError, match=message):
            run_robots(name, srdf=target, as_json=False)
        assert [path.name for path in tmp_path.iterdir()] == ["arm.urdf"]
    out.write_text("<robot name='arm'><group name='theirs'/></robot>")
    words = r"--srdf: .*arm\.srdf exists, and was not made by hdplan: it is not overwritten"
    with pytest.raises(InputError, match=words):
        run_robots(robot, srdf=out, as_json=False)
    assert "theirs" in out.read_text()
    out.unlink()
    assert run_robots(robot, srdf=out, as_json=False) == 0
    assert run_robots(robot, srdf=out, as_json=False) == 0
    assert "1 link pairs that need no check: 0 adjacent, 0 always, 1 never" in capsys.readouterr().out
    assert load_robot(RobotSpec(urdf=tmp_path / "arm.urdf", srdf=out)).unchecked == {("base", "tip"): "the SRDF"}


def test_a_pair_that_touches_only_while_a_hand_is_held_stays_checked_in_the_srdf(tmp_path: Path) -> None:
    """A finger, held closed by default, touches the other always; opened it does not."""
    opening: dict[str, Any] = {"kind": "prismatic", "limits": (0, 0.1)}
    path = write_robot(
        tmp_path / "hand.urdf",
        *map(link_text, ("base", "palm")),
        *(link_text(side, box="0.02 0.02 0.1") for side in ("left", "right")),
        joint_text("a", "base", "palm"),
        joint_text("finger_left", "palm", "left", "1 0 0", **opening),
        joint_text("finger_right", "palm", "right", "-1 0 0", **opening),
    )
    spec = RobotSpec(urdf=path, group=("a", "finger_left"))
    assert ALWAYS_TOUCHING not in load_robot(spec).unchecked.values()
    assert srdf_of(RobotSpec(urdf=path))[1] == {"Adjacent": 0, "Always": 0, "Never": 0}
