"""Links that are kept apart, judged by walking random trees of joints, with and without geometry on the links."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from hdplan import RobotSpec, Scene, Trajectory, certify, load_robot
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.robot.self_pairs import MOVE_AS_ONE, NEIGHBOURS

from ..urdf import joint_text, link_text, write_robot


def random_tree(rng: np.random.Generator, folder: Path) -> tuple[RobotSpec, dict[int, tuple[int, bool]], set[int]]:
    """A robot of small balls a metre apart, its SRDF empty; for each link but the first its parent, and whether the
    joint between moves; and which links have geometry. Some joints that could move are held."""
    count = int(rng.integers(4, 10))
    shaped = {i for i in range(count) if rng.uniform() < 0.6}
    parents, parts, held = dict[int, tuple[int, bool]](), [], {}
    for i in range(count):
        parts.append(link_text(f"l{i}", sphere=0.01 if i in shaped else None))
    for i in range(1, count):
        parent = int(rng.integers(max(0, i - 3), i))
        kind = rng.choice(["fixed", "revolute", "prismatic", "continuous"])
        locked = kind != "fixed" and rng.uniform() < 0.2
        parents[i] = parent, kind != "fixed" and not locked
        if locked:
            held[f"j{i}"] = 0.1
        at = " ".join(map(str, rng.normal(size=3)))
        parts.append(joint_text(f"j{i}", f"l{parent}", f"l{i}", kind=str(kind), at=at))
    path = write_robot(folder / f"tree{rng.integers(1 << 30)}.urdf", *parts)
    path.with_suffix(".srdf").write_text("<robot name='tree'/>")
    return RobotSpec(urdf=path, srdf=path.with_suffix(".srdf"), locked=held), parents, shaped


def way(a: int, b: int, parents: dict[int, tuple[int, bool]]) -> tuple[int, set[int]]:
    """The number of joints that move between two links, and the links on the way: from the later one up, which is
    never an ancestor of the other."""
    moving, between, ends = 0, set(), {a, b}
    while a != b:
        later, a = max(a, b), min(a, b)
        b, moves = parents[later]
        moving += moves
        between.add(b)
    return moving, between - ends


def test_neighbours_have_one_moving_joint_and_no_geometry_between(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    seen = {"neighbours": 0, "one": 0, "checked": 0, "hidden": 0}
    for _ in range(60):
        spec, parents, shaped = random_tree(rng, tmp_path)
        if not any(moves for _, moves in parents.values()):
            continue
        robot = load_robot(spec)
        assert set(robot.links) == {f"l{i}" for i in shaped}
        checked = {frozenset(pair) for pair in robot.self_pairs}
        for i, j in itertools.combinations(sorted(shaped), 2):
            moving, between = way(i, j, parents)
            reason = robot.unchecked.get((f"l{i}", f"l{j}"))
            if moving == 0:
                assert reason == MOVE_AS_ONE
                seen["one"] += 1
            elif moving == 1 and not between & shaped:
                assert reason == NEIGHBOURS
                seen["neighbours"] += 1
            else:
                assert frozenset((f"l{i}", f"l{j}")) in checked
                seen["checked"] += 1
                seen["hidden"] += moving > 1 and not between & shaped
    assert min(seen.values()) > 10, seen


ARM = (
    link_text("base", box="0.2 0.2 0.2", at="0.5 0 0"),
    link_text("yoke"),
    link_text("arm", box="1 0.05 0.05", at="0.5 0 0"),
    joint_text("pan", "base", "yoke", limits=(-3, 3), velocity=2, effort=10),
    joint_text("lift", "yoke", "arm", "0 1 0", limits=(-3, 3), velocity=2, effort=10),
)


@pytest.mark.parametrize("held", [None, "lift"])
def test_an_arm_sweeps_through_its_base_unless_one_joint_alone_joins_them(held: str | None, tmp_path: Path) -> None:
    """Two joints with a bare link between them make a named contact. With one of them held they are neighbours."""
    urdf = write_robot(tmp_path / "arm.urdf", *ARM)
    spec = RobotSpec(urdf=urdf, locked={} if held is None else {held: 0.0})
    robot = load_robot(spec)
    ends = np.zeros((2, robot.n))
    ends[:, 0] = -1.0, 1.0
    verdict = certify(Scene(robot=spec, start=ends[0], goal=ends[1]), Trajectory(robot.joint_names, ends))
    assert verdict.certified is (held is not None)
    if held is None:
        assert verdict.status is Status.IN_CONTACT
        assert "arm and base" in verdict.text
