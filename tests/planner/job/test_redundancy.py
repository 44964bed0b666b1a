"""Laws of ways along a curve: at every place the pose, near the last one, within the limits, and free."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan.planner.job import redundancy
from hdplan.planner.job.following import NotFollowedError
from hdplan.planner.job.redundancy import LARGEST_STEP, Layers, inner_limits, ways_along
from tests.loops import in_numpy, needs_loops

from ..links import place_of

TOOL = "panda_hand_tcp"
READY = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.7])


@pytest.mark.parametrize("fixed", [True, False])
def test_ways_are_followed_freely(fixed: bool) -> None:
    robot = hdplan.load_robot("panda")
    begins = place_of(robot, TOOL, READY).homogeneous
    ends = begins.copy()
    ends[:3, 3] += [0.1, 0.25, 0.05]
    poses = [hdplan.Pose(each[:3, 3], pin.Quaternion(each[:3, :3]).coeffs()) for each in (begins, ends)]
    follow = hdplan.Follow(TOOL, poses)
    calls: list[np.ndarray] = []

    def free(rows: np.ndarray) -> np.ndarray:
        """Nothing is free where the elbow is turned to one side."""
        calls.extend(rows)
        return np.asarray(rows[:, 2] < 0.4)

    start, quick = READY if fixed else None, np.ones(robot.n)
    found = list(itertools.islice(ways_along(robot, start, follow, 0.27, quick, 0, free), 2))
    low, high = inner_limits(robot)
    assert len(found) == (1 if fixed else 2)
    assert calls
    for way in found:
        if fixed:
            assert np.array_equal(way[0], READY)
        assert np.abs(np.diff(way, axis=0)).max() <= LARGEST_STEP
        assert (way >= low).all()
        assert (way <= high).all()
        assert (way[:, 2] < 0.4).all()
        for share, q in zip(np.linspace(0, 1, len(way)), way, strict=True):
            place = place_of(robot, TOOL, q).homogeneous
            np.testing.assert_allclose(place[:3, 3], begins[:3, 3] + share * (ends - begins)[:3, 3], rtol=0, atol=1e-4)
            np.testing.assert_allclose(place[:3, :3], begins[:3, :3], rtol=0, atol=1e-3)
    for one, other in itertools.combinations(found, 2):
        assert np.abs(one[0] - other[0]).max() > 0.05


def test_there_is_no_way_where_nothing_is_free_or_in_reach() -> None:
    robot = hdplan.load_robot("panda")
    poses = [
        hdplan.Pose(place, pin.Quaternion(place_of(robot, TOOL, READY).homogeneous[:3, :3]).coeffs())
        for place in ([0.5, 0, 0.4], [0.5, 0, 2.0])
    ]
    quick = np.ones(robot.n)
    with pytest.raises(NotFollowedError, match=r"no joint values were found for \d\d% of the way"):
        next(ways_along(robot, None, hdplan.Follow(TOOL, poses), 1.6, quick, 0, lambda q: q[:, 0] < 9.0))
    near = [
        hdplan.Pose([0.5, 0, 0.4], poses[0].quaternion_xyzw),
        hdplan.Pose([0.5, 0.1, 0.4], poses[0].quaternion_xyzw),
    ]
    with pytest.raises(NotFollowedError, match="no free way was found along it beyond 0%"):
        next(ways_along(robot, None, hdplan.Follow(TOOL, near), 0.1, quick, 0, lambda q: q[:, 0] > 9.0))


@needs_loops
def test_steps_in_c_are_those_in_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of joints that turn without an end, and of what is not a number, which leads nowhere."""
    rng, high = np.random.default_rng(4), np.array([3.0, np.inf, 1.0, 7.0, np.inf])
    endless = np.isinf(high)
    robot: Any = SimpleNamespace(turning=np.arange(5) != 2, followed=np.zeros(5, dtype=bool), lower=-high, upper=high)
    middle, far = rng.uniform(-1.0, 1.0, 5), np.minimum(high, 20.0)
    rows = [np.clip(middle + rng.normal(scale=0.3, size=(count, 5)), -far, far) for count in (30, 1, 40, 25)]
    for each in rows:
        each[::3] += 2.0 * np.pi * rng.integers(-2, 3, (len(each[::3]), 1)) * endless
    rows[2][7, 3] = np.nan
    quick = rng.uniform(0.3, 1.0, 5)
    compiled = Layers(robot, rows, quick)._steps
    in_numpy(monkeypatch, redundancy)
    for found, expected in zip(compiled, Layers(robot, rows, quick)._steps, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert np.isfinite(compiled[1]).sum() > 5
    assert not np.isfinite(compiled[1][7]).any()
    assert not np.isfinite(compiled[2][:, 7]).any()
