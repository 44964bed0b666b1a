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
from typing import Annotated, NamedTuple

import numpy as np

from hdplan.planner.collision.box_pairs import BoxPairs, GdfPairs
from hdplan.planner.collision.broad_phase import BodyPairs, body_pairs
from hdplan.planner.collision.cell_bodies import pieces_of
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.collision.euclidean import FclPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_link_body, from_obstacle
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.link_bodies import LinkBody, link_bodies
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.collision.pieces import Pieces
from hdplan.planner.collision.reach import levers, reach_of
from hdplan.planner.control.barrier_safety import guaranteed_clearance, least_distance
from hdplan.planner.control.movers import Movers
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import FieldError, naming, nearest
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.once import made_once
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import Checked, Choice, Number, Whole, instance, shorten, text

BARRIER_DISTANCES = ("hdsdf", "hdsdf-boxes", "euclidean", "gdf")
PROVEN = ("hdsdf", "euclidean")  # those of which the broad phase misses no pair


@dataclass(frozen=True)
class BarrierSettings(Checked):
    """Which distance, and between which bodies."""

    distance: Annotated[str, Choice(BARRIER_DISTANCES)] = "hdsdf"
    """hdsdf (planes of the obstacle), hdsdf-boxes (the paper's set), euclidean (exact) or gdf."""
    gamma: Annotated[int, Whole(1, 1000)] = 2  # order of differentiability of the HD-SDF
    shaping_length: Annotated[float, Number(above=0.0, unit="m")] = 1e-3  # width of its flat spot [m]
    growth: Annotated[float, Number(0.0, 1.0, unit="m")] = 0.006  # g, by which obstacles are grown [m]
    self_growth: Annotated[float, Number(0.0, 1.0, unit="m")] = 0.005  # the same for one link of a self pair [m]
    normals: Annotated[str, text] = "box"
    """Planes of an obstacle: faces, box or sphere; of hdsdf-boxes: paper or paper-multiset."""

    def _check_whole(self) -> None:
        known = ("paper", "paper-multiset") if self.distance == "hdsdf-boxes" else ("faces", "box", "sphere")
        if self.normals not in known:
            wanted = nearest(self.normals, known)
            raise FieldError(f"{shorten(repr(self.normals))} for {self.distance}{wanted}", "normals")


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
        grown = settings.growth + np.array([(clearances or {}).get(name, 0.0) for name in others.names])
        outer = _can_meet(robot, bodies, others, len(standing), grown)
        supports = np.vstack([kinematics.supports, np.zeros((len(movers), kinematics.n), dtype=np.bool_)])
        own = _own_pairs(kinematics, tuple(bodies), tuple(self_pairs), self.hulls, settings)
        self._levels = [own] if own else []  # pairs of obstacles, and of links
        if len(outer):
            self._levels.insert(0, _level(bodies, others, outer, grown, supports, self.hulls, others, settings))
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
    def groups(self) -> list[_Group]:
        """The pairs with obstacles, if there are any, and those of links."""
        return [level.outer for level in self._levels]

    def clearance(self, margin: float) -> float | None:
        """Return the true clearance [m] to obstacles that Δ ≥ margin [m] proves at that instant, with the planes
        of these obstacles: a lower bound; None if nothing is proven."""
        b = self.settings
        any_planes = guaranteed_clearance(b.distance, margin, b.growth, b.gamma, b.shaping_length, b.normals)
        if b.distance != "hdsdf":
            return any_planes
        proven = (least_distance(each, margin, b.growth, b.gamma, b.shaping_length) for each in self._directions)
        return min(proven, default=any_planes)

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
        exact = [level.exact for level in self._levels if level.exact]
        return self._evaluated(path, times, exact, sample, pair) if exact else self._empty(0)

    def _evaluated(
        self, path: Array, times: Array, groups: Sequence[tuple[_Group, Rows]], sample: Rows, pair: Rows
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


class _Group(NamedTuple):
    """Pairs with one kind of distance."""

    pairs: BodyPairs
    distance: PairDistance


class _Level:
    """Pairs of outer bodies, and the exact pairs of the links' hulls behind them."""

    def __init__(self, outer: _Group, exact: tuple[_Group, Rows] | None) -> None:
        """Take the pairs, and with the exact ones the row there of each pair."""
        self.outer, self.exact, self.pairs = outer, exact, outer.pairs
        self._enlarged: dict[float, BodyPairs] = {}

    def near(self, by: float) -> BodyPairs:
        """Return the pairs enlarged by a distance [m]."""
        if by not in self._enlarged:
            self._enlarged[by] = self.pairs.enlarged(by)
        return self._enlarged[by]


class _Moment(NamedTuple):
    """Robot and obstacles at k configurations and times."""

    kinematics: KinematicsBatch  # with the frames of the moving obstacles after the joints'
    joints: int  # number of the robot's joints, including the world
    twists: Array | None  # (k, m, 6) of the moving obstacles, if there are any

    def rows(self, group: _Group, sample: Rows, pair: Rows) -> BarrierRows:
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
    """Return the pairs (P, 2) of bodies that can touch within the joint limits, grown by `margins` [m]; the first
    `standing` of the others stand still.

    Fixed links are in no pair: if a moving obstacle hits one, no motion of the robot can prevent it.
    """
    boxes, half = others.boxes[:standing], others.half_sizes[:standing] + margins[:standing, None]
    found = [np.empty((0, 2), dtype=np.int64)]
    for a, body in enumerate(bodies):
        if body.joint > 0:
            met = np.flatnonzero(reach_of(robot.unfolded, body.joint, body.body).meets(boxes, half))
            met = np.concatenate([met, np.arange(standing, len(others))])
            found.append(np.column_stack([np.full(len(met), a), met]))
    return np.concatenate(found)


@made_once(16)
def _own_pairs(
    kinematics: Kinematics,
    bodies: tuple[LinkBody, ...],
    pairs: tuple[tuple[int, int], ...],
    hulls: tuple[LinkBody, ...],
    settings: BarrierSettings,
) -> _Level | None:
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
    return _level(bodies, planes, chosen, settings.self_growth, supports, hulls, solids, settings)


def _level(
    bodies: Sequence[LinkBody],
    others: Pieces,
    chosen: Rows,
    margin: float | Array,
    supports: Mask,
    hulls: Sequence[LinkBody],
    solids: Pieces,
    settings: BarrierSettings,
) -> _Level:
    """Lay out pairs (P, 2) of bodies with others, enlarged by a margin [m], and those of the hulls with `solids`: the
    others themselves, or where these are links their hulls."""
    pairs = body_pairs(bodies, others, chosen, margin, supports)
    outer = _Group(pairs, _distance(pairs, bodies, others, settings))
    if not hulls:
        return _Level(outer, None)
    row_of = {hull.link: row for row, hull in enumerate(hulls)}
    hull_of = np.array([row_of[body.link] for body in bodies])
    first, second = hull_of[chosen[:, 0]], chosen[:, 1] if solids is others else hull_of[chosen[:, 1]]
    unique, row = np.unique(first * len(solids) + second, return_inverse=True)
    exact = body_pairs(hulls, solids, np.column_stack(np.divmod(unique, len(solids))), 0.0, supports)
    return _Level(outer, (_Group(exact, FclPairs(exact, hulls, solids)), row))


def _distance(
    pairs: BodyPairs,
    bodies: Sequence[LinkBody],
    others: Sequence[HalfspaceBody],
    settings: BarrierSettings,
) -> PairDistance:
    match settings.distance:
        case "hdsdf":
            return HdsdfPairs(pairs, settings.gamma, settings.shaping_length)
        case "hdsdf-boxes":
            return BoxPairs(pairs, bodies, others, settings.gamma, settings.shaping_length, settings.normals)
        case "euclidean":
            return FclPairs(pairs, bodies, others)
        case "gdf":
            return GdfPairs(pairs, bodies, others)
    raise ValueError(f"no distance is known as {settings.distance!r}")


def scene_barriers(
    scene: Scene, robot: Robot, settings: BarrierSettings, hulls: Sequence[LinkBody] | None = None
) -> Barriers:
    """Return the barriers of a scene: the planner's outer bodies with every obstacle, which is grown also by its own
    clearance, and the robot's self pairs except for those whose outer bodies overlap anyway.

    settings: which distance, and between which bodies. Link bodies are those of the scene's `planner.link_bodies`, or
    boxes for the distances that take no others. hulls: the links', if they are known. Raises InputError for an obstacle
    that the distance cannot take.
    """
    instance(scene, Scene, "scene")
    instance(robot, Robot, "robot")
    instance(settings, BarrierSettings, "settings")
    setup = Setup.of(scene, robot)
    setup.refuse_sizes("barriers take the world as it is said to be")
    scene = setup.scene
    boxes = settings.distance in ("hdsdf-boxes", "gdf")
    planes = settings.normals if settings.distance == "hdsdf" else "box"
    collision_model = collision_model_of(robot, "box" if boxes else scene.planner.link_bodies, planes)
    standing: list[HalfspaceBody] = []
    clouds: list[Pieces] = []
    movers: list[tuple[ObstacleMotion, Sequence[HalfspaceBody]]] = []
    with naming(scene.source):
        for obstacle in scene.obstacles:
            if obstacle.motion is None and isinstance(obstacle.shape, Cloud):
                clouds.append(pieces_of(obstacle.name, obstacle.shape, obstacle.pose, planes))
            elif obstacle.motion is None:
                standing += from_obstacle(obstacle, planes, closely=True)[0]
            else:
                own = replace(obstacle, pose=Pose(), motion=None)
                movers.append((ObstacleMotion.of(obstacle), from_obstacle(own, planes)[0]))
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
