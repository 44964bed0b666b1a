"""The barriers of a controller: the pairs of bodies whose distance Δ it keeps, with exact derivatives.

In: outer link bodies, static and moving obstacles, the distance and the growth. Out, at (q, t): Δ (P,) [m], ∂Δ/∂q
(P, n) and ∂Δ/∂t (P,) [m/s] (`moment`).

A moving obstacle is one more frame after the joints', so that every `PairDistance` treats it like a link.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from hdplan.planner.collision.cell_bodies import pieces_of
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, from_link_body, from_obstacle
from hdplan.planner.collision.link_bodies import LinkBody, link_bodies
from hdplan.planner.collision.pieces import Pieces
from hdplan.planner.collision.reach import Reach, levers, reach_of
from hdplan.planner.control.barrier_safety import guaranteed_clearance, least_distance
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.control.moment import BarrierRows, Layout, Moment
from hdplan.planner.control.movers import Movers
from hdplan.planner.control.pair_level import PairGroup, PairLevel
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import naming
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.once import made_once, read_only
from hdplan.scenes.poses import IDENTITY
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import instance

PROVEN_DISTANCES = ("hdsdf", "euclidean")  # those of which the broad phase misses no pair
ALWAYS_APART = 0.05  # [m] from everything that stands is a link that is in no pair with it, whatever the robot does
CORNER_FACTOR = 2.0  # times as far: more than the corners of a box stand out that is enlarged along its axes
WORLD = read_only(np.array([*np.eye(3).ravel(), 0.0, 0.0, 0.0]))  # its placement, as `KinematicsBatch` has it


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
        """Assemble the pairs. `obstacles` are static; the bodies of a moving obstacle are given in its own frame.

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
        self.obstacle_speed = self.movers.fastest(owners, size)  # greatest speed of an obstacle [m/s]
        extra = dict.fromkeys(others.names, 0.0) | dict(clearances or {})
        grown = settings.growth + np.array([*map(extra.__getitem__, others.names)])
        outer = _can_meet(robot, bodies, others, len(standing), grown)
        supports = np.vstack([kinematics.supports, np.zeros((len(movers), kinematics.n), dtype=np.bool_)])
        own = _own_pairs(kinematics, tuple(bodies), tuple(self_pairs), self.hulls, settings)
        levels = [own] if own else []  # pairs of obstacles, and of links
        fixed, alone = [body for body in bodies if body.joint == 0], carried.on(1 + owners)  # in a world without joints
        met, still = np.indices((len(fixed), len(carried))).reshape(2, -1).T, np.zeros((1 + len(movers), 0), np.bool_)
        of_fixed = fixed, alone, met, grown[len(standing) :], still, (), alone, settings
        self._fixed = PairLevel(*of_fixed) if len(met) else None
        if len(outer):
            levels.insert(0, PairLevel(bodies, others, outer, grown, supports, self.hulls, others, settings))
        self._names = (bodies, others.names, outer, self_pairs)
        self.count = len(outer) + len(self_pairs)  # P
        self.obstacle_pairs = len(outer)  # number of pairs with obstacles, which come first among the P
        self.coming = np.zeros(self.count, dtype=np.bool_)  # (P,) whether it is a pair with a moving obstacle
        self.coming[: len(outer)] = outer[:, 1] >= len(standing)
        stands = (np.arange(self.count) < len(outer)) & ~self.coming
        proven = settings.distance in PROVEN_DISTANCES
        self.standing = stands & proven  # (P,) of which `Moment.within` is proven
        first = np.cumsum([0, *(len(level.pairs) for level in levels)]).tolist()
        self._layout = Layout(
            robot,
            kinematics.nj,
            tuple(zip(first, levels, strict=False)),
            np.concatenate([np.empty((0, kinematics.n)), *(level.pairs.moves for level in levels)]),
            np.concatenate([np.empty(0, np.int64), *(level.pairs.joint_b for level in levels)]),
            len(outer),
            self.standing,
            proven,
            bool(self.hulls),
        )
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
        """Return the number of pairs of each kind, in words."""
        own = self.count - self.obstacle_pairs
        return (
            f"<Barriers of {self.robot.name}: {self.obstacle_pairs} pairs with obstacles, {own} of links, "
            f"{self.settings.distance}>"
        )

    @property
    def groups(self) -> list[PairGroup]:
        """The pairs with obstacles, if there are any, and those of links."""
        return [level.outer for _, level in self._layout.levels]

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
        return min(found, b.growth + ALWAYS_APART)  # of links in no pair no more is known

    def evaluate(self, q: Array, time: float = 0.0) -> BarrierRows:
        """Return Δ and its derivatives of all pairs at configuration q (n,) and a time [s]."""
        return self.at(q[None], np.array([time])).rows(np.zeros(self.count, np.int64), np.arange(self.count))

    def of_fixed_links(self, times: Array, needed: float) -> float:
        """Return the least Δ [m] of links that no joint moves to moving obstacles, at times (k,) [s]: no command
        changes it, so these pairs have no row. Infinite if no pair may have a D̃ below `needed`."""
        if self._fixed is None:
            return np.inf
        placements = np.concatenate([np.tile(WORLD, (len(times), 1, 1)), self.movers.at(times)[0]], axis=1)
        kinematics = KinematicsBatch(placements, np.empty((len(times), 0, 6)))
        if self._layout.bounded:
            sample, pair = self._fixed.near(needed).close(kinematics)
        else:
            sample, pair = np.indices((len(times), len(self._fixed.pairs))).reshape(2, -1)
        return float(self._fixed.outer.distance(kinematics, sample, pair)[0].min(initial=np.inf))

    def at(self, path: Array, times: Array) -> Moment:
        """Return the pairs at configurations (k, n) and times (k,) [s]."""
        kinematics = self.kinematics.evaluate(self.robot.expand(path))
        if not len(self.movers):
            return Moment(self._layout, kinematics, None)
        placed, twists = self.movers.at(times)
        placements = np.concatenate([kinematics.placements, placed], axis=1)
        return Moment(self._layout, replace(kinematics, placements=placements), twists)


def _can_meet(robot: Robot, bodies: Sequence[LinkBody], others: Pieces, standing: int, margins: Array) -> Rows:
    """Return the pairs (P, 2) of bodies that can come as close as ALWAYS_APART within the joint limits, grown by
    `margins` [m]; the first `standing` of the others stand still.

    Fixed links are in no pair: if a moving obstacle hits one, no motion of the robot can prevent it (`of_fixed_links`).
    """
    boxes, half = others.boxes[:standing], others.half_sizes[:standing] + margins[:standing, None] + ALWAYS_APART
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
    """Return the barriers of a scene with its robot. hulls: the links', if they are known."""
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
                far = settings.growth + scene.clearances[obstacle.name] + ALWAYS_APART
                within = reached + [0.0, 0.0, 0.0, CORNER_FACTOR * far]
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
