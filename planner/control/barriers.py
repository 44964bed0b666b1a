"""The barriers of a controller: the distance Δ of every pair of bodies at one configuration, with exact derivatives.

In: outer link bodies, static and moving obstacles, the distance and the growth. Out, at (q, t): Δ (P,) [m], ∂Δ/∂q
(P, n) and ∂Δ/∂t (P,) [m/s]. The derivative by q is the distance's wrench on the first body times the geometric
Jacobian; Δ depends on the relative pose only, so the second body's wrench is the opposite one, and a moving obstacle of
world twist (v, ω) gives ∂Δ/∂t = −(F·v + T·ω).

A moving obstacle is one more frame after the joints', so that every `PairDistance` treats it like a link.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hdplan.planner.collision.cell_bodies import pieces_of
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_link_body, from_obstacle
from hdplan.planner.collision.link_bodies import LinkBody, link_bodies
from hdplan.planner.collision.pieces import Pieces
from hdplan.planner.collision.reach import Reach, levers, reach_of
from hdplan.planner.control.barrier_safety import guaranteed_clearance, least_distance
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.control.movers import Movers
from hdplan.planner.control.pair_level import PairGroup, PairLevel
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import naming
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.once import made_once
from hdplan.scenes.poses import IDENTITY
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import instance

PROVEN = ("hdsdf", "euclidean")  # those of which the broad phase misses no pair
BEYOND = 0.05  # [m] from everything that stands is a link that is in no pair with it, whatever the robot does
WIDER = 2.0  # times as far: more than the corners of a box stand out that is enlarged along its axes


@dataclass(frozen=True, eq=False)
class BarrierRows:
    """Δ and its derivatives at one configuration and time, P pairs."""

    value: Array  # (P,) [m]
    gradient: Array  # (P, n) by the configuration
    drift: Array  # (P,) by time alone [m/s]
    separation: Array  # (P,) a lower bound of the true distance less the growth [m]; for the GDF no bound


class Barriers:
    """The pairs of bodies that a controller keeps apart: first robot and obstacles, then the robot's own links."""

    def __init__(
        self,
        robot: Robot,
        kinematics: Kinematics,
        bodies: Sequence[LinkBody],
        self_pairs: Sequence[tuple[int, int]],
        obstacles: Sequence[HalfspaceBody],
        settings: BarrierSettings,
        movers: Sequence[tuple[ObstacleMotion, Sequence[HalfspaceBody]]] = (),
        clearances: Mapping[str, float] | None = None,
        hulls: Sequence[LinkBody] = (),
        unguarded: Sequence[tuple[str, str]] = (),
    ) -> None:
        """Lay out the pairs. `obstacles` are static; the bodies of a moving obstacle are given in its own frame.

        clearances: [m], by obstacle, added to the settings' growth. hulls: the links' own hulls, for `nearness`.
        unguarded: pairs of links that are left out, for the report.
        """
        self.robot, self.kinematics, self.settings = robot, kinematics, settings
        self.hulls, self.unguarded = tuple(hulls), tuple(unguarded)
        self.movers = Movers([motion for motion, _ in movers])
        owners = np.repeat(np.arange(len(movers)), [len(moved) for _, moved in movers])
        standing, carried = Pieces.of(obstacles), Pieces.of([body for _, moved in movers for body in moved])
        others = Pieces.joined([standing, carried.on(kinematics.nj + owners)])
        size = np.linalg.norm(carried.boxes[:, :3, 3], axis=1) + np.linalg.norm(carried.half_sizes, axis=1)
        self.obstacle_speed = self.movers.fastest(owners, size)  # of any obstacle [m/s]
        extra = dict.fromkeys(others.names, 0.0) | dict(clearances or {})
        grown = settings.growth + np.array([*map(extra.__getitem__, others.names)])
        outer = _can_meet(robot, bodies, others, len(standing), grown)
        supports = np.vstack([kinematics.supports, np.zeros((len(movers), kinematics.n), dtype=np.bool_)])
        own = _own_pairs(kinematics, tuple(bodies), tuple(self_pairs), self.hulls, settings)
        self._levels = [own] if own else []  # pairs of obstacles, and of links
        if len(outer):
            self._levels.insert(0, PairLevel(bodies, others, outer, grown, supports, self.hulls, others, settings))
        self._names = (bodies, others.names, outer, self_pairs)
        self.count = len(outer) + len(self_pairs)  # P
        self.obstacle_pairs = len(outer)  # which come first among the P
        self.coming = np.zeros(self.count, dtype=np.bool_)  # (P,) whether it is a pair with a moving obstacle
        self.coming[: len(outer)] = outer[:, 1] >= len(standing)
        stands = (np.arange(self.count) < len(outer)) & ~self.coming
        self.standing = stands & (settings.distance in PROVEN)  # (P,) of which `within` is proven
        self._directions = others.directions
        self.corners = max((len(body.body.vertices) for body in bodies), default=1)  # most vertices of a link's body
        every = levers(robot.unfolded, tuple((body.joint, body.body) for body in bodies))
        self.levers = every if robot.linkage is None else every @ np.abs(robot.linkage.matrix)  # (n,) [m]

    @cached_property
    def names(self) -> tuple[tuple[str, str], ...]:
        """The pairs (P,): link and obstacle, or link and link."""
        bodies, others, outer, self_pairs = self._names
        first = [(bodies[a].link, others[b]) for a, b in outer.tolist()]
        return (*first, *((bodies[a].link, bodies[b].link) for a, b in self_pairs))

    def __repr__(self) -> str:
        """Say how many pairs of each kind there are."""
        own = self.count - self.obstacle_pairs
        return (
            f"<Barriers of {self.robot.name}: {self.obstacle_pairs} pairs with obstacles, {own} of links, "
            f"{self.settings.distance}>"
        )

    @property
    def groups(self) -> list[PairGroup]:
        """The pairs with obstacles, if there are any, and those of links."""
        return [level.outer for level in self._levels]

    def clearance(self, margin: float) -> float | None:
        """Return the true clearance [m] to obstacles that Δ ≥ margin [m] proves at that instant, with the planes
        of these obstacles: a lower bound; None if nothing is proven."""
        b = self.settings
        found = guaranteed_clearance(b.distance, margin, b.growth, b.gamma, b.shaping_length, b.normals)
        if found is None:
            return None
        if b.distance == "hdsdf":
            proven = (least_distance(each, margin, b.growth, b.gamma, b.shaping_length) for each in self._directions)
            found = min(proven, default=found)
        return min(found, b.growth + BEYOND)  # of links in no pair no more is known

    def within(self, path: Array, times: Array, horizon: float) -> Rows:
        """Return the pairs, ascending, that may have a D̃ below the horizon [m] at one of the configurations (k, n) and
        times (k,) [s]: not those of `standing` obstacles that are proven to have none."""
        if not self.standing.any() or not np.isfinite(horizon):
            return np.arange(self.count)
        found = ~self.standing
        found[self._levels[0].near(horizon).close(self._at(path, times).kinematics)[1]] = True
        return np.flatnonzero(found)

    def doubtful(self, path: Array, times: Array, needed: Sequence[float]) -> tuple[Rows, Rows]:
        """Return configurations and pairs (S,) that may have a D̃ below `needed` [m] (of pairs with obstacles, of pairs
        of links), at configurations (k, n) and times (k,) [s]; every other one is proven to have none."""
        if self.settings.distance not in PROVEN:
            every = np.indices((len(path), self.count)).reshape(2, -1)
            return every[0], every[1]
        kinematics, first, found = self._at(path, times).kinematics, 0, [(np.empty(0, np.int64),) * 2]
        for level in self._levels:
            sample, pair = level.near(needed[0 if first < self.obstacle_pairs else 1]).close(kinematics)
            found.append((sample, pair + first))
            first += len(level.pairs)
        sample, pair = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return sample, pair

    def evaluate(self, q: Array, time: float = 0.0, chosen: Rows | None = None) -> BarrierRows:
        """Return Δ and its derivatives at configuration q (n,) and a time [s], of `chosen` pairs, or of all."""
        chosen = np.arange(self.count) if chosen is None else chosen
        return self.along(q[None], np.array([time]), np.zeros(len(chosen), dtype=np.int64), chosen)

    def along(self, path: Array, times: Array, sample: Rows, pair: Rows) -> BarrierRows:
        """Return the same at configurations `sample` (S,) of the path (k, n) and times (k,) [s], of pairs (S,)."""
        every = [(group, np.arange(len(group.pairs))) for group in self.groups]
        return self._evaluated(path, times, every, sample, pair)

    def nearness(self, path: Array, times: Array, sample: Rows, pair: Rows) -> BarrierRows:
        """Return the exact distance of the links' hulls in pairs (S,), without growth, with its derivatives, as
        `along`; nothing if no hulls were given."""
        if not len(pair) or not self.hulls:
            return self._empty(0)
        return self._evaluated(path, times, [level.exact for level in self._levels], sample, pair)

    def _evaluated(
        self, path: Array, times: Array, groups: Sequence[tuple[PairGroup, Rows]], sample: Rows, pair: Rows
    ) -> BarrierRows:
        """Evaluate pairs, numbered through all groups; each group comes with its rows for its pairs."""
        result, first = self._empty(len(pair)), 0
        if not len(pair):
            return result
        scene = self._at(path, times)
        for group, rows in groups:
            own = np.flatnonzero((pair >= first) & (pair < first + len(rows)))
            if len(own):
                found = scene.rows(group, sample[own], rows[pair[own] - first])
                result.value[own], result.drift[own], result.separation[own] = (
                    found.value,
                    found.drift,
                    found.separation,
                )
                result.gradient[own] = self.robot.fold(found.gradient)
            first += len(rows)
        return result

    def _empty(self, count: int) -> BarrierRows:
        return BarrierRows(np.empty(count), np.empty((count, self.robot.n)), np.empty(count), np.empty(count))

    def _at(self, path: Array, times: Array) -> _Moment:
        kinematics = self.kinematics.evaluate(self.robot.expand(path))
        if not len(self.movers):
            return _Moment(kinematics, self.kinematics.nj, None)
        placed, twists = self.movers.at(times)
        placements = np.concatenate([kinematics.placements, placed], axis=1)
        return _Moment(replace(kinematics, placements=placements), self.kinematics.nj, twists)


class _Moment(NamedTuple):
    """Robot and obstacles at k configurations and times."""

    kinematics: KinematicsBatch  # with the frames of the moving obstacles after the joints'
    joints: int  # number of the robot's joints, including the world
    twists: Array | None  # (k, m, 6) of the moving obstacles, if there are any

    def rows(self, group: PairGroup, sample: Rows, pair: Rows) -> BarrierRows:
        """Evaluate some pairs of a group at some of the configurations."""
        pairs, distance = group
        value, wrench, separation = distance(self.kinematics, sample, pair)
        drift = np.zeros(len(pair))
        if self.twists is not None:
            carried = np.flatnonzero(pairs.joint_b[pair] >= self.joints)
            twists = self.twists[sample[carried], pairs.joint_b[pair[carried]] - self.joints]
            drift[carried] = -np.einsum("si,si->s", wrench[carried], twists)
        columns = self.kinematics.columns
        turned = wrench @ columns[0].T if len(columns) == 1 else np.einsum("sni,si->sn", columns[sample], wrench)
        return BarrierRows(value, turned * pairs.moves[pair], drift, separation)


def _can_meet(robot: Robot, bodies: Sequence[LinkBody], others: Pieces, standing: int, margins: Array) -> Rows:
    """Return the pairs (P, 2) of bodies that can come as close as BEYOND within the joint limits, grown by `margins`
    [m]; the first `standing` of the others stand still.

    Fixed links are in no pair: if a moving obstacle hits one, no motion of the robot can prevent it.
    """
    boxes, half = others.boxes[:standing], others.half_sizes[:standing] + margins[:standing, None] + BEYOND
    moving, found, gaps = np.arange(standing, len(others)), [np.empty((0, 2), dtype=np.int64)], dict[bytes, Array]()
    for a, body in enumerate(bodies):
        if body.joint > 0:
            reach = reach_of(robot.unfolded, body.joint, body.body)
            if (at := reach.centre.tobytes()) not in gaps:  # one for all links of an arm
                gaps[at] = reach.gaps(boxes, half)
            met = np.concatenate([np.flatnonzero(gaps[at] <= reach.radius), moving])
            found.append(np.stack([np.full(len(met), a), met], axis=1))
    return np.concatenate(found)


def _reached(robot: Robot, bodies: Sequence[LinkBody]) -> Array:
    """Return balls (k, 4) in which the bodies that move stay [m]."""
    farthest: dict[bytes, Reach] = {}
    for body in bodies:
        if body.joint > 0:
            reach = reach_of(robot.unfolded, body.joint, body.body)
            at = reach.centre.tobytes()
            farthest[at] = max(reach, farthest.get(at, reach), key=lambda each: each.radius)
    return np.array([[*reach.centre, reach.radius] for reach in farthest.values()]).reshape(-1, 4)


@made_once(16)
def _own_pairs(
    kinematics: Kinematics,
    bodies: tuple[LinkBody, ...],
    pairs: tuple[tuple[int, int], ...],
    hulls: tuple[LinkBody, ...],
    settings: BarrierSettings,
) -> PairLevel | None:
    """Return the pairs of links, the same in every world; None if there are none."""
    if not pairs:
        return None
    planes = Pieces.of(
        [
            from_link_body(b.link, b.joint, b.body, settings.normals if settings.distance == "hdsdf" else "box")
            for b in bodies
        ]
    )
    solids = Pieces.of([from_link_body(hull.link, hull.joint, hull.body) for hull in hulls])
    supports, chosen = kinematics.supports, np.array(pairs, dtype=np.int64)
    return PairLevel(bodies, planes, chosen, settings.self_growth, supports, hulls, solids, settings)


def scene_barriers(scene: Scene, robot: Robot, settings: BarrierSettings) -> Barriers:
    """Return the barriers of a scene: the planner's outer bodies with every obstacle, which is grown also by its own
    clearance, and the robot's self pairs except for those whose outer bodies overlap anyway.

    settings: which distance, and between which bodies. Link bodies are those of the scene's `planner.link_bodies`, or
    boxes for the distances that take no others. Raises InputError for an obstacle that the distance cannot take.
    """
    instance(scene, Scene, "scene")
    instance(robot, Robot, "robot")
    instance(settings, BarrierSettings, "settings")
    return setup_barriers(Setup.of(scene, robot), settings)


def setup_barriers(setup: Setup, settings: BarrierSettings, hulls: Sequence[LinkBody] | None = None) -> Barriers:
    """Return the same of a scene with its robot. hulls: the links', if they are known."""
    setup.refuse_sizes("barriers know only the nominal world")
    scene, robot = setup.scene, setup.robot
    boxes = settings.distance in ("hdsdf-boxes", "gdf")
    planes = settings.normals if settings.distance == "hdsdf" else "box"
    collision_model = collision_model_of(robot, "box" if boxes else scene.planner.link_bodies, planes)
    standing: list[HalfspaceBody] = []
    clouds: list[Pieces] = []
    movers: list[tuple[ObstacleMotion, Sequence[HalfspaceBody]]] = []
    reached = _reached(robot, collision_model.bodies)
    with naming(scene.source):
        for obstacle in scene.obstacles:
            if obstacle.motion is None and isinstance(obstacle.shape, Cloud):
                far = settings.growth + scene.clearances[obstacle.name] + BEYOND
                within = reached + [0.0, 0.0, 0.0, WIDER * far]
                clouds.append(pieces_of(obstacle.name, obstacle.shape, obstacle.pose, planes, within))
            elif obstacle.motion is None:
                standing += from_obstacle(obstacle, planes, closely=True)[0]
            else:
                movers.append((ObstacleMotion.of(obstacle), from_obstacle(obstacle, planes, pose=IDENTITY)[0]))
        return Barriers(
            robot,
            collision_model.kinematics,
            collision_model.bodies,
            collision_model.self_pairs,
            Pieces.joined([Pieces.of(standing), *clouds]),
            settings,
            movers,
            scene.clearances,
            link_bodies(robot, "hull") if hulls is None else hulls,
            collision_model.unresolved,
        )
