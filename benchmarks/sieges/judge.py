"""Requirements of a certified motion at dense samples: places, limits, rates, torques. It can refute, not prove.

Rounding that is granted: `GRANTED` [m] in distances, `SHARE` of limits of rates and torques, `ANGLE` of positions.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array
from sieges import gjk, meshes, poses
from sieges.rows import Rows
from sieges.world import World

Index = NDArray[np.int64]

GRANTED = 1e-6  # [m], and as much for each metre that a body is away from the world's origin
SHARE = 1e-6  # of a limit
ANGLE = 2e-9  # [rad] or [m] beyond a limit of position
ROUNDING = 100 * float(np.finfo(float).eps)  # of positions, in what a polynomial's derivatives make of them
JUMP = 2e-6  # of a rate at a row, beyond which it is no rounding
SAMPLES = 257  # of a motion
COARSE = 25  # of them at which all bodies are compared at first
MOST = 2500  # pairs of pieces judged at once


@dataclass(frozen=True)
class Nearest:
    """Two bodies at one time, and what is known of their distance [m]."""

    pair: tuple[int, int]
    place: int
    low: float
    high: float


def refute(world: World, rows: Rows, clearance: float | None, own: float | None) -> list[str]:
    """Return the faults of a motion that claims to be certified with these clearances [m]."""
    interval, s = rows.grid(SAMPLES)
    q, times = rows.at(interval, s), rows.when(interval, s)
    found = [*limits(world, rows, interval, s), *_torques(world, rows, interval, s), *_path(world, rows, q)]
    return found + _places(world, rows, q, times, clearance or 0.0, own or 0.0)


def _places(world: World, rows: Rows, q: Array, times: Array, clearance: float, own: float) -> list[str]:
    if not world.pairs:
        return []
    less = _ends_are_closer(world, rows.names)
    required = np.array([_required(world, pair, clearance, own, less) for pair in world.pairs])
    places = world.places(rows.names, q, times)
    for pair, place in inside(world, places):
        return [f"{world.pair_name(pair)}: inside at {_when(rows, place, q)}"]
    chosen = np.unique(np.linspace(0, len(q) - 1, COARSE).round().astype(int))
    nearest: list[Nearest] = []
    for _ in range(3):
        nearest += closest(world, places, chosen, required)
        for each in nearest:
            reach = float(np.abs(places[list(each.pair), each.place, :3, 3]).max())
            must = required[world.pairs.index(each.pair)]
            if each.high < must - GRANTED * (1.0 + reach):
                where = _when(rows, each.place, q)
                return [f"{world.pair_name(each.pair)}: {each.high:.6g} m at {where}, claimed {must:.6g} m"]
        nearest = sorted(nearest, key=lambda each: each.high - required[world.pairs.index(each.pair)])[:4]
        step = max(1, len(q) // COARSE // 4)
        around = [each.place + move for each in nearest for move in (-2 * step, -step, step, 2 * step)]
        chosen = np.unique(np.clip(around, 0, len(q) - 1)) if around else np.arange(0)
        if not len(chosen):
            break
    return []


def closest(world: World, places: Array, chosen: Index, within: Array) -> list[Nearest]:
    """Return the distances, at some places of a motion, of the pairs of bodies that may be as near as `within` (P,)."""
    pieces = world.pieces
    starts = np.searchsorted(pieces.body, np.arange(len(world.bodies) + 1))
    at = places[:, chosen]  # (bodies, T, 4, 4)
    centres = np.einsum("ptij,pj->pti", at[pieces.body][..., :3, :3], pieces.centre) + at[pieces.body][..., :3, 3]
    balls = [_ball(centres[i:j], pieces.radius[i:j]) for i, j in itertools.pairwise(starts.tolist())]
    rows: list[tuple[Array, Index, Index, int, int]] = []  # gaps, pieces, pieces, pair, time
    for number, (a, b) in enumerate(world.pairs):
        near = max(float(within[number]), 1e-6)
        apart = np.linalg.norm(balls[a][0] - balls[b][0], axis=1) - balls[a][1] - balls[b][1]
        for time in np.flatnonzero(apart < near).tolist():
            sides = []
            for one, other in ((a, b), (b, a)):
                own = np.arange(starts[one], starts[one + 1])
                away = np.linalg.norm(centres[own, time] - balls[other][0][time], axis=1) - pieces.radius[own]
                sides.append(own[away < near + balls[other][1][time]])
            left, right = (side.ravel() for side in np.meshgrid(*sides))
            gaps = np.linalg.norm(centres[left, time] - centres[right, time], axis=1)
            gaps -= pieces.radius[left] + pieces.radius[right]
            kept = gaps < near
            rows.append((gaps[kept] - near, left[kept], right[kept], number, time))
    if not rows:
        return []
    gaps, left, right = (np.concatenate([row[k] for row in rows]) for k in range(3))
    numbers, times = (np.concatenate([np.full(len(row[0]), row[k]) for row in rows]) for k in (3, 4))
    if len(gaps) > MOST:
        kept = np.argpartition(gaps, MOST)[:MOST]
        left, right, numbers, times = left[kept], right[kept], numbers[kept], times[kept]
    a, b = at[pieces.body[left], times], at[pieces.body[right], times]
    low, high = gjk.distances(pieces, left, a, right, b, within[numbers])
    best: dict[tuple[int, int], Nearest] = {}
    for k, (pair, when) in enumerate(zip(numbers.tolist(), times.tolist(), strict=True)):
        key = (pair, when)
        if key not in best or high[k] < best[key].high:
            best[key] = Nearest(world.pairs[pair], int(chosen[when]), float(low[k]), float(high[k]))
    return list(best.values())


def _ball(centres: Array, radii: Array) -> tuple[Array, Array]:
    """Return a ball (T, 3), (T,) around the balls of a body's pieces."""
    if not len(radii):
        return np.zeros((centres.shape[1], 3)), np.zeros(centres.shape[1])
    middle = centres.mean(axis=0)
    return middle, (np.linalg.norm(centres - middle, axis=2) + radii[:, None]).max(axis=0)


def inside(world: World, places: Array, open_too: bool = False) -> list[tuple[tuple[int, int], int]]:
    """Return pairs, and when, of which one has a point within the other's closed mesh; of an open one, on request,
    where it winds around the point more than not."""
    found = []
    chosen = np.unique(np.linspace(0, places.shape[1] - 1, 5).round().astype(int))
    for pair in world.pairs:
        for outer, inner in (pair, pair[::-1]):
            mesh = world.bodies[outer].mesh
            if mesh is None or not (world.bodies[outer].closed or open_too):
                continue
            points = _points(world, inner)
            turned = np.linalg.inv(places[outer, chosen]) @ places[inner, chosen]
            local = np.einsum("tij,kj->tki", turned[:, :3, :3], points) + turned[:, None, :3, 3]
            low, high = mesh[0].min(axis=0), mesh[0].max(axis=0)
            within = np.argwhere(((local > low) & (local < high)).all(axis=2))[:24]
            if len(within) and (turns := np.abs(meshes.windings(mesh, local[within[:, 0], within[:, 1]]))).max() > 0.5:
                found.append((pair, int(chosen[within[int(turns.argmax()), 0]])))
    return found


def _points(world: World, body: int) -> Array:
    """Return a few points that surely belong to a body (k, 3)."""
    rows = world.bodies[body].rows
    points = np.concatenate([points for points, *_ in rows])
    if len(rows) == 1:
        return np.vstack([points.mean(axis=0), points[:4]])
    return points[:: max(1, len(points) // 8)]


def limits(world: World, rows: Rows, interval: Index, s: Array) -> list[str]:
    """Return the limits of positions and rates that do not hold."""
    found, section = [], world.content.get("limits") or {}
    q = rows.at(interval, s)
    for name in world.planned:
        joint, column = world.machine.by_name[name], q[:, rows.names.index(name)]
        low, high = (section.get("position") or {}).get(name, (-np.inf, np.inf))
        low, high = max(low, joint.low), min(high, joint.high)
        beyond = max(low - column.min(), column.max() - high)
        if beyond > ANGLE * max(1.0, abs(column).max()):
            found.append(f"joint {name}: {beyond:.3g} beyond its limits of position")
    for order, key in enumerate(("velocity", "acceleration", "jerk"), start=1):
        if key not in section:
            continue
        rate = rows.at(interval, s, order)
        shortest = 1.0 if rows.times is None else float(np.diff(rows.times).min())
        noise = ROUNDING * (1.0 + np.abs(q).max()) / shortest**order  # of equal positions a moment apart
        limit = per_joint(world, section[key], "speed")
        for name in world.planned:
            share = (np.abs(rate[:, rows.names.index(name)]).max() - noise) / limit[name]
            if share > 1.0 + SHARE:
                found.append(f"joint {name}: {key} {share:.6g} of its limit")
        if order > 1:
            found += [f"{key} infinite: {words}" for words in _jumps(rows, order - 1)]
    return found


def _jumps(rows: Rows, order: int) -> list[str]:
    """Return the rows at which a derivative jumps; before the first and after the last it is 0."""
    count = len(rows.positions) - 1
    every = np.arange(count)
    starts, ends = rows.at(every, np.zeros(count), order), rows.at(every, np.ones(count), order)
    zero = np.zeros_like(starts[:1])
    jumps = np.abs(np.concatenate([starts, zero]) - np.concatenate([zero, ends]))
    size = 1.0 + max(np.abs(starts).max(), np.abs(ends).max())
    return [f"derivative {order} jumps by {jumps.max():.3g}"] if jumps.max() > JUMP * size else []


def per_joint(world: World, limit: Any, urdf: str) -> dict[str, float]:
    """Return a limit for each planned joint in whichever of the scene's forms it comes."""
    own = {name: getattr(world.machine.by_name[name], urdf) for name in world.planned}
    if limit == "urdf":
        return own
    if isinstance(limit, dict):
        return {**own, **limit}
    values = limit if isinstance(limit, list) else [limit] * len(world.planned)
    order = [joint.name for joint in world.machine.order if joint.name in world.planned]
    return dict(zip(order, map(float, values), strict=True))


def _torques(world: World, rows: Rows, interval: Index, s: Array) -> list[str]:
    stated = (world.content.get("limits") or {}).get("torque")
    if stated is None:
        return []
    if rows.velocities is None:
        return ["torques: certified without velocities"]
    motion = world.motion(rows, interval, s)
    torques = np.abs(world.machine.torques(motion, world.masses(), world.planned)).max(axis=0)
    limit = per_joint(world, stated, "effort")
    found = [
        f"joint {name}: torque {torque:.6g}, its limit is {limit[name]:.6g}"
        for name, torque in zip(world.planned, torques, strict=True)
        if torque > limit[name] * (1.0 + SHARE)
    ]
    return found + [f"torques infinite: {words}" for words in _jumps(rows, 1)]


def _path(world: World, rows: Rows, q: Array) -> list[str]:
    """Return the constraint of the whole way that does not hold."""
    constraints, found = world.content.get("path") or {}, []
    if not constraints:
        return []
    frames = world.machine.frames(world.values(rows.names, q), world.base)
    if (upright := constraints.get("upright")) is not None:
        angle = tilt(frames[upright["link"]], np.array(upright.get("axis", [0, 0, 1]), dtype=float)).max()
        if angle > upright.get("tolerance", 0.1) + ANGLE:
            found.append(f"upright: tilted by {angle:.9g} rad")
    if (box := constraints.get("position")) is not None:
        points = frames[box["link"]] @ [*box.get("point", [0, 0, 0]), 1.0]
        local = (points @ np.linalg.inv(poses.of_scene(box)).T)[:, :3]
        beyond = (np.abs(local) - np.array(box["size"], dtype=float) / 2).max()
        if beyond > ANGLE * (1.0 + np.abs(points).max()):
            found.append(f"position: {beyond:.3g} m outside its box")
    return found


def tilt(frames: Array, axis: Array) -> Array:
    """Return by how much (T,) an axis of a frame is turned away from upwards [rad]."""
    turned = frames[:, :3, :3] @ (axis / np.linalg.norm(axis))
    return np.asarray(np.arctan2(np.linalg.norm(turned[:, :2], axis=1), turned[:, 2]))


def _required(world: World, pair: tuple[int, int], clearance: float, own: float, less: bool) -> float:
    if pair[1] < world.robot_count:
        return max(own, world.own_required)
    name = world.bodies[pair[1]].name
    return clearance if less and name not in world.insist else max(clearance, world.required[name])


def _ends_are_closer(world: World, names: tuple[str, ...]) -> bool:
    """True if the scene's own start or goal is closer than planner.clearance: less is required then."""
    clearance = (world.content.get("planner") or {}).get("clearance", 0.0)
    ends = [(world.content.get(end) or {}).get("joints") for end in ("start", "goal")]
    given = [end for end in ends if isinstance(end, dict)]
    if not clearance or len(given) < 2:
        return False
    q = np.array([[end[name] for name in names] for end in given])
    times = np.array([0.0, (world.content.get("timing") or {}).get("duration", 0.0)])
    places = world.places(names, q, times)
    if inside(world, places, open_too=True):
        return True
    near = closest(world, places, np.arange(2), np.full(len(world.pairs), clearance + 1e-6))
    outer = [each for each in near if each.pair[1] >= world.robot_count]
    return any(each.high < clearance + 1e-6 and world.bodies[each.pair[1]].name not in world.insist for each in outer)


def _when(rows: Rows, place: int, q: Array) -> str:
    interval, s = rows.grid(SAMPLES)
    return f"interval {interval[place]}, part {s[place]:.4g}"
