"""Ways of a redundant arm along a whole curve: which of the configurations of each place to take, so that the curve can
be followed to its end, within the limits and free.

At each of some places, layers of configurations are found by inverse kinematics, from those of the place before and
from random ones. The cheapest way through the layers, by the squares of the joints' steps and by how close they come to
their limits, is looked for by dynamic programming, as in Morgan, Millard & Sukhatme, "CppFlow: Generative inverse
kinematics for efficient and robust Cartesian path planning" (2024). Whether a configuration is free is asked only once
a way leads through it; those near one that is not are left out with it. Then the way is evened, each configuration
towards the middle of its neighbours, as long as it stays free.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from hdplan.planner.job.following import POSE_ERROR, spread
from hdplan.planner.kinematics.inverse import Aim, damped_step
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.targets import PoseTarget

FEWEST, MOST = 16, 200  # layers
SPACING = 0.03  # [m] between layers, turns counted as lengths
FIRST, FRESH, KEPT = 300, 120, 200  # configurations: looked for at the first place, newly at others, kept at most
STEPS = 40  # of damped least squares
STEP = 0.45  # [rad] or [m] that a joint may move from layer to layer
INNER = 0.03  # [rad] or [m] from the limits of joints, of ways that are followed
NEAR_BLOCKED = 0.12  # [rad] or [m] around a configuration that is not free, where others of its layer are left out too
STEEP, LIMITS = 10, 0.05  # power and weight of how close joints are to their limits
SAME_BEGINNING = 0.3  # [rad] or [m] between the beginnings of two ways that are tried one after the other
ROUNDS, TIMES = 6, 8  # of evening, between which the way is looked at
LOOKS = 300  # ways that are looked at, at most


@dataclass(frozen=True, eq=False)
class Layers:
    """Configurations of places along a curve."""

    aims: list[Aim]  # of each place
    configurations: list[Array]  # (k, n) of each place
    costs: list[Array]  # (k,) of each; infinite where one is not free


def ways_along(
    robot: Robot, start: Array | None, follow: Follow, length: float, seed: int, free: Callable[[Array], bool]
) -> Iterator[Array]:
    """Yield ways (layers, n) along a curve, the best first: from `start` (n,), or from wherever it can be begun, in
    which case each begins elsewhere."""
    count = int(np.clip(np.ceil(length / SPACING), FEWEST, MOST))
    layers = _layers(robot, start, follow, count, np.random.default_rng(seed))
    if layers is None:
        return
    known: list[dict[int, bool]] = [{} for _ in range(count)]
    for _ in range(LOOKS):
        way = _cheapest(layers)
        if way is None:
            return
        blocked = False
        for place, chosen in enumerate(way):
            if chosen not in known[place]:
                known[place][chosen] = free(layers.configurations[place][chosen])
            if not known[place][chosen]:
                at = layers.configurations[place]
                layers.costs[place][np.abs(at - at[chosen]).max(axis=1) <= NEAR_BLOCKED] = np.inf
                blocked = True
        if blocked:
            continue
        found = np.array([layers.configurations[place][chosen] for place, chosen in enumerate(way)])
        yield _evened(robot, layers.aims, found, start is not None, free)
        if start is not None:
            return
        at = layers.configurations[0]
        layers.costs[0][np.abs(at - at[way[0]]).max(axis=1) <= SAME_BEGINNING] = np.inf


def _layers(robot: Robot, start: Array | None, follow: Follow, count: int, rng: np.random.Generator) -> Layers | None:
    """Return configurations of `count` places, evenly along the curve; None where one has none."""
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    found: list[Array] = []
    aims: list[Aim] = []
    for pose in spread(follow, count):
        aim = Aim.at(robot, PoseTarget(follow.link, pose, free_rotation=follow.free_rotation))
        aims.append(aim)
        fresh = rng.uniform(low, high, (FRESH if found else FIRST, robot.n))
        if not found and start is not None:
            found.append(start[None])
            continue
        reached = _reached(robot, aim, np.concatenate([found[-1], fresh]) if found else fresh)
        if not len(reached):
            return None
        if len(reached) > KEPT:
            reached = reached[rng.permutation(len(reached))[:KEPT]]
        found.append(reached)
    middle, half = 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
    bounded = np.isfinite(half)
    costs = []
    for rows in found:
        share = np.abs(rows[:, bounded] - middle[bounded]) / half[bounded]
        costs.append(LIMITS * (share**STEEP).sum(axis=1))
    return Layers(aims, found, costs)


def _evened(robot: Robot, aims: list[Aim], way: Array, fixed: bool, free: Callable[[Array], bool]) -> Array:
    """Return a way (layers, n) on which joints go more steadily, free where it was looked at."""
    low, high = robot.lower + INNER, robot.upper - INNER
    for _ in range(ROUNDS):
        moved = way.copy()
        for _ in range(TIMES):
            inner = moved[1:-1] + 0.5 * (0.5 * (moved[:-2] + moved[2:]) - moved[1:-1])
            ends = moved[:1] if fixed else moved[1:2], moved[-2:-1]
            moved = np.clip(np.concatenate([ends[0], inner, ends[1]]), low, high)
            for k in range(1 if fixed else 0, len(moved)):
                for _ in range(2):
                    error, jacobian = aims[k].linearized(moved[k : k + 1])
                    moved[k : k + 1] = damped_step(robot, moved[k : k + 1], error, jacobian)
        if not all(free(q) for q in moved):
            return way
        way = moved
    return way


def _reached(robot: Robot, aim: Aim, q: Array) -> Array:
    """Return those of some configurations (B, n) that reach the aim, brought there, within the limits."""
    for _ in range(STEPS):
        error, jacobian = aim.linearized(q)
        if _there(aim, error).all():
            break
        q = damped_step(robot, q, error, jacobian)
    error, _ = aim.linearized(q)
    inside = ((q >= robot.lower + INNER) & (q <= robot.upper - INNER)).all(axis=1)
    return np.asarray(q[_there(aim, error) & inside])


def _there(aim: Aim, error: Array) -> Mask:
    return np.asarray((aim.sizes(error) <= POSE_ERROR).all(axis=(1, 2)))


def _cheapest(layers: Layers) -> list[int] | None:
    """Return which configuration of each layer the cheapest way takes; None if no way leads through."""
    cost, before = layers.costs[0], []
    for last, rows, own in zip(layers.configurations[:-1], layers.configurations[1:], layers.costs[1:], strict=True):
        steps = rows[:, None] - last[None]
        total = np.where(np.abs(steps).max(axis=2) <= STEP, (steps**2).sum(axis=2), np.inf) + cost[None]
        best = total.argmin(axis=1)
        before.append(best)
        cost = total[np.arange(len(rows)), best] + own
    chosen = int(cost.argmin())
    if not np.isfinite(cost[chosen]):
        return None
    way = [chosen]
    for best in reversed(before):
        way.append(int(best[way[-1]]))
    return way[::-1]
