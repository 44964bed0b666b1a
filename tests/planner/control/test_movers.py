"""Laws of moving obstacles seen all at once: each is where its own motion has it, and moves as it does."""

from __future__ import annotations

import numpy as np

from hdplan import Obstacle, Pose, Sphere, SteadyMotion, TimedPoses
from hdplan.planner.control.movers import Movers
from hdplan.scenes.obstacle_motion import ObstacleMotion


def motions(rng: np.random.Generator) -> list[ObstacleMotion]:
    """Steady ones, one that stands, and ways of different lengths through timed poses."""

    def pose() -> Pose:
        turn = rng.normal(size=4)
        return Pose(tuple(rng.normal(size=3)), tuple(turn / np.linalg.norm(turn)))

    timed = [TimedPoses(np.cumsum(rng.uniform(0.2, 0.9, k)), [pose() for _ in range(k)]) for k in (2, 5)]
    steady = [SteadyMotion(rng.normal(size=3), rng.normal(size=3)) for _ in range(3)]
    each = [steady[0], timed[0], None, *steady[1:], timed[1]]
    obstacles = [
        Obstacle(f"it{k}", Sphere(0.1), Pose() if isinstance(motion, TimedPoses) else pose(), motion=motion)
        for k, motion in enumerate(each)
    ]
    return [ObstacleMotion.of(obstacle) for obstacle in obstacles]


def test_each_is_where_its_own_motion_has_it() -> None:
    rng = np.random.default_rng(0)
    each, times = motions(rng), rng.uniform(0.0, 4.0, 12)
    placements, twists = Movers(each).at(times)
    ahead, _ = Movers(each).at(times + 1e-7)
    for index, motion in enumerate(each):
        poses = motion.at(times)
        np.testing.assert_allclose(placements[:, index, :9], poses[:, :3, :3].reshape(-1, 9), atol=1e-12)
        np.testing.assert_allclose(placements[:, index, 9:], poses[:, :3, 3], atol=1e-12)
        velocity, spin = twists[:, index, :3], twists[:, index, 3:]
        moved = velocity + np.cross(spin, poses[:, :3, 3])
        np.testing.assert_allclose((ahead - placements)[:, index, 9:] / 1e-7, moved, atol=1e-5)
        turned = np.cross(spin[:, None], poses[:, :3, :3], axisb=1, axisc=1)
        np.testing.assert_allclose((ahead - placements)[:, index, :9] / 1e-7, turned.reshape(-1, 9), atol=1e-5)


def test_no_point_is_faster_than_the_bound() -> None:
    rng = np.random.default_rng(1)
    each = motions(rng)
    movers, owners, sizes = Movers(each), rng.integers(0, len(each), 8), rng.uniform(0.1, 2.0, 8)
    bound, found = movers.fastest(owners, sizes), 0.0
    for owner, size in zip(owners.tolist(), sizes.tolist(), strict=True):
        points = rng.normal(size=(200, 3))
        points *= size / np.linalg.norm(points, axis=1)[:, None]
        for time in rng.uniform(0.0, 4.0, 20).tolist():
            here, there = (each[owner].at(np.array([now])) for now in (time, time + 1e-7))
            moved = points @ (there - here)[0, :3, :3].T + (there - here)[0, :3, 3]
            found = max(found, float(np.linalg.norm(moved, axis=1).max()) / 1e-7)
    assert 0.5 * bound < found <= bound + 1e-5
    assert Movers([]).fastest(np.empty(0, np.int64), np.empty(0)) == 0.0
