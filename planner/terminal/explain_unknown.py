"""The unknown of a scene, and how many millimetres each size costs at most: rows of the explanation."""

from __future__ import annotations

import itertools

from hdplan.planner.problem.unknown import by_joints, of_base, of_obstacle, of_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.obstacles import Obstacle

MOST_JOINTS = 3  # joints named


def unknown(setup: Setup) -> list[tuple[str, str]]:
    """Return a row for each obstacle that may be elsewhere, for the joints and for the base; none where all is
    known. Of the robot they are those at its start and goal: a certificate has those of its motion."""
    scene = setup.scene
    rows = [(each.name, _of(each, scene.end_time)) for each in scene.obstacles if each.uncertainty is not None]
    if (lag := scene.robot.tracking) is not None:
        if lag.position:
            rows.append(("tracking", _of_joints(setup)))
        if lag.of_rates:
            rows.append(("tracking, velocity", "subtracted from the velocity limits"))
    if scene.robot.calibration is not None:
        shift, turn = of_base(setup)
        words = [_mm(shift, "of position")] * bool(shift) + [_mm(turn, "of orientation", "up to ")] * bool(turn)
        rows.append(("calibration", ", ".join(words)))
    return rows


def _of(obstacle: Obstacle, duration: float) -> str:
    shift, turn, speed = of_obstacle(obstacle)
    words = [_mm(shift, "of position")] * bool(shift) + [_mm(turn, "of orientation", "up to ")] * bool(turn)
    return ", ".join(words + [_mm(speed * duration, f"of speed after {duration:g} s")] * bool(speed))


def _of_joints(setup: Setup) -> str:
    costs = by_joints(setup)
    link = int(costs.sum(axis=1).argmax())
    names = list(itertools.islice(setup.robot.model.names, 1, None))
    most = sorted(zip(costs[link].tolist(), names, strict=True), reverse=True)[:MOST_JOINTS]
    shares = ", ".join(f"{1e3 * cost:.3g} by {joint}" for cost, joint in most if cost)
    apart = of_robot(setup)[1]
    return (
        f"{_mm(costs[link].sum(), f'at {setup.robot.links[link]}', 'up to ')} ({shares}), {_mm(apart, 'between links')}"
    )


def _mm(length: float, of: str, before: str = "") -> str:
    return f"{before}{1e3 * length:.3g} mm {of}"
