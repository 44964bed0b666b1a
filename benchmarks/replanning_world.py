"""The worlds of `replanning.py`: people, boxes that come into sight, a conveyor, and who judges contacts in them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import coal
import numpy as np
import pinocchio as pin

import hdplan
from hdplan.planner.robot.setup import Setup

SPEED, SIGHT, OFF = 0.5, 1.5, 0.01  # [m/s] of people and boxes; [m] from the base; [m] by which pictures are off
BELT_SPEED, BELT_OFF = 0.2, 0.02  # [m/s] of the conveyor; how much faster or slower a box on it may be
FAR = 0.4  # [m] up to which distances are measured
LAG = 0.005  # [rad] by which a joint may be off
LIMITS = hdplan.Limits(
    velocity="urdf", acceleration=(15, 7.5, 10, 12.5, 15, 20, 20), jerk=(7500, 3750, 5000, 6250, 7500, 10000, 10000)
)
FLOOR = hdplan.Obstacle("floor", hdplan.Box([2.4, 2.4, 0.1]), pose=[0.0, 0.0, -0.1])


class Walker:
    """A body that goes where it likes: its points are never faster than a speed."""

    speed = SPEED  # [m/s] by which a picture says that it may leave where it would be

    def __init__(self, rng: np.random.Generator, name: str, kind: str) -> None:
        self.rng, self.name, self.kind = rng, name, kind
        angle = rng.uniform(-np.pi, np.pi)
        far = SIGHT if kind == "box" else rng.uniform(0.9, 1.4)
        self.at = np.array([far * np.cos(angle), far * np.sin(angle), rng.uniform(0.2, 0.9)])
        self.turn = pin.exp3(rng.uniform(-np.pi, np.pi) * np.array([0.0, 0.0, 1.0]))
        self.velocity, self.spin, self.until, self.turned = np.zeros(3), np.zeros(3), 0.0, -np.inf
        self.shape: Any
        if kind == "sphere":
            self.shape, self.lever = hdplan.Sphere(rng.uniform(0.08, 0.18)), 0.0
        elif kind == "capsule":
            length = rng.uniform(0.3, 0.9)
            self.shape, self.lever = hdplan.Capsule(rng.uniform(0.06, 0.15), length), length / 2
        else:
            size = rng.uniform(0.08, 0.3, 3)
            self.shape, self.lever = hdplan.Box(size), float(np.linalg.norm(size)) / 2
        self.begins = rng.uniform(0.0, 10.0) if kind == "box" else 0.0

    def decide(self, t: float, hand: Callable[[], np.ndarray]) -> None:
        """Take another way, maybe towards the robot's hand."""
        rng = self.rng
        self.until = t + rng.uniform(0.2, 1.5)
        share = rng.choice([0.0, 0.3, 1.0], p=[0.2, 0.2, 0.6])
        target = hand() if rng.uniform() < 0.1 else np.append(rng.uniform(-1.6, 1.6, 2), rng.uniform(0.1, 1.2))
        if self.kind == "box":
            stand = rng.uniform() < 0.5
            share = 0.0 if stand and np.linalg.norm(self.at[:2]) < 0.8 else share
        way = target - self.at
        spin = rng.normal(size=3)
        part = rng.uniform(0.5, 1.0) if self.lever else 1.0
        self.velocity = part * share * SPEED * way / max(np.linalg.norm(way), 1e-9)
        self.spin = (1.0 - part) * share * SPEED / max(self.lever, 1e-9) * spin / np.linalg.norm(spin)

    def go(self, t: float, dt: float, hand: Callable[[], np.ndarray]) -> None:
        if t >= self.until:
            self.decide(t, hand)
        self.at = self.at + dt * self.velocity
        self.turn = pin.exp3(dt * self.spin) @ self.turn

    def turn_back(self, t: float) -> None:
        """Turn around."""
        self.velocity, self.spin, self.until = -self.velocity, -self.spin, t + 1.0

    def there(self, t: float) -> bool:
        return t >= self.begins

    def seen(self, off: float | None) -> hdplan.Obstacle:
        """Return what a picture shows that is up to so much off; None: as far, but it does not say so, nor that
        anything moves."""
        way = self.rng.normal(size=3)
        away = self.rng.uniform(0.0, OFF if off is None else off) * way / np.linalg.norm(way)
        pose = hdplan.Pose(self.at + away, pin.Quaternion(self.turn).normalized().coeffs())
        sizes = hdplan.Uncertainty() if off is None else hdplan.Uncertainty(off, 0.0, self.speed)
        return hdplan.Obstacle(self.name, self.shape, pose, uncertainty=sizes)


class Rider(Walker):
    """A box on the conveyor, which runs past the robot."""

    speed = BELT_OFF

    def __init__(self, rng: np.random.Generator, name: str, at: float, side: float) -> None:
        super().__init__(rng, name, "box")
        self.at = np.array([at, side, 0.1 + rng.uniform(0.0, 0.1)])
        self.begins, self.until = 0.0, np.inf
        self.shape = hdplan.Box(rng.uniform(0.08, 0.2, 3))

    def go(self, t: float, dt: float, hand: Callable[[], np.ndarray]) -> None:
        if t >= self.until or self.until == np.inf:
            self.until = t + 0.5
            self.velocity = np.array([BELT_SPEED + self.rng.uniform(-1.0, 1.0) * BELT_OFF, 0.0, 0.0])
        self.at = self.at + dt * self.velocity

    def there(self, t: float) -> bool:
        return bool(abs(self.at[0]) < 1.4)

    def seen(self, off: float | None) -> hdplan.Obstacle:
        found = super().seen(off)
        motion = None if off is None else hdplan.SteadyMotion([BELT_SPEED, 0.0, 0.0])
        return hdplan.Obstacle(found.name, found.shape, found.pose, motion=motion, uncertainty=found.uncertainty)


class World:
    """Everything that moves in one run."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 1])
        kinds = [*rng.choice(["sphere", "capsule"], rng.integers(1, 4)), "box", "box"]
        self.walkers: list[Walker] = [Walker(rng, f"{kind}{i}", str(kind)) for i, kind in enumerate(kinds)]
        side = 0.65 * rng.choice([-1.0, 1.0])
        self.walkers += [Rider(rng, f"rider{i}", -1.3 - 0.8 * i, side) for i in range(5)]

    def go(self, t: float, dt: float, hand: Callable[[], np.ndarray]) -> None:
        for each in self.walkers:
            if each.there(t) or isinstance(each, Rider):
                each.go(t, dt, hand)

    def there(self, t: float) -> list[Walker]:
        return [each for each in self.walkers if each.there(t)]


def hull(geometry: Any) -> Any:
    """Return the convex hull of a mesh; other shapes are convex."""
    if not isinstance(geometry, coal.BVHModelBase):
        return geometry
    geometry.buildConvexHull(True, "Qt")
    return geometry.convex


def measured(one: Any, there: Any, other: Any, place: Any) -> Any:
    """Return the distance of two shapes and their closest points."""
    found = coal.DistanceResult()
    coal.distance(one, there, other, place, coal.DistanceRequest(), found)
    return found


def apart(one: Any, there: Any, other: Any, place: Any) -> float:
    """Return a lower bound of the distance of two convex shapes [m], whatever their closest points are worth: the gap
    between both along the way from one to the other; 0 where there is none."""
    found = measured(one, there, other, place)
    way = found.getNearestPoint2() - found.getNearestPoint1()
    if not np.linalg.norm(way) > 0.0:
        return 0.0
    way = way / np.linalg.norm(way)
    ours, theirs = extent(one, there, way), -extent(other, place, -way)
    return max(float(theirs - ours), 0.0) if np.isfinite(theirs - ours) else 0.0


def extent(shape: Any, place: Any, way: np.ndarray) -> float:
    """Return the support of a convex shape along a unit vector."""
    local = place.getRotation().T @ way
    at = float(way @ place.getTranslation())
    match shape:
        case coal.Box():
            return at + float(np.abs(local) @ shape.halfSide)
        case coal.Sphere():
            return at + float(shape.radius)
        case coal.Capsule():
            return at + float(shape.radius + abs(local[2]) * shape.halfLength)
        case coal.Cylinder():
            return at + float(shape.radius * np.hypot(*local[:2]) + abs(local[2]) * shape.halfLength)
    return at + float((np.asarray(shape.points()) @ local).max())


class Judge:
    """Distances of the robot's meshes from the world as it is, by Pinocchio and coal."""

    def __init__(self, robot: hdplan.Robot, floor: bool = True) -> None:
        self.robot, self.model, self.items = robot, robot.model, robot.collision
        self.data, self.places = self.model.createData(), self.items.createData()
        for each in self.items.geometryObjects:
            each.geometry.computeLocalAABB()
        self.moving = [i for i, each in enumerate(self.items.geometryObjects) if each.parentJoint]
        self.hulls = {i: hull(self.items.geometryObjects[i].geometry) for i in self.moving}
        at = coal.Transform3s(np.eye(3), np.array([0.0, 0.0, -0.1]))
        self.floor = [(coal.Box(2.4, 2.4, 0.1), at, 3.0, np.zeros(3))] if floor else []
        self.shapes: dict[str, Any] = {}

    def hand(self, q: np.ndarray) -> np.ndarray:
        self._place(q)
        return np.array(self.places.oMg[self.moving[-1]].translation)

    def levers(self) -> np.ndarray:
        """Return how far what each joint moves is from its axis at most (n,) [m], in any configuration of a robot whose
        n joints turn; those that are locked, such as fingers, may slide."""
        reach = np.zeros(self.model.njoints)
        for i in self.moving:
            item = self.items.geometryObjects[i]
            center = item.placement.act(np.array(item.geometry.aabb_center))
            reach[item.parentJoint] = max(reach[item.parentJoint], np.linalg.norm(center) + item.geometry.aabb_radius)
        for j in range(self.model.njoints - 1, 1, -1):
            parent, step = self.model.parents[j], np.linalg.norm(self.model.jointPlacements[j].translation)
            at, slides = self.model.idx_qs[j], self.model.joints[j].shortname().startswith("JointModelP")
            limits = self.model.lowerPositionLimit[at], self.model.upperPositionLimit[at]
            reach[parent] = max(reach[parent], step + reach[j] + (np.abs(limits).max() if slides else 0.0))
        return reach[1 : 1 + self.robot.n]

    def _place(self, q: np.ndarray) -> None:
        full = np.asarray(self.robot.unfolded.pin_q(self.robot.expand(q)[None])[0])
        pin.updateGeometryPlacements(self.model, self.data, self.items, self.places, full)

    def distance(self, q: np.ndarray, walkers: list[Walker], within: float = 0.1, floor: bool = True) -> float:
        """Return the least distance [m], if it is below `within`; 0 or less in contact. Links are measured only where
        their convex hulls are closer than the closest link so far."""
        self._place(q)
        others = (self.floor if floor else []) + [
            (self._shape(each), coal.Transform3s(each.turn, each.at), each.lever + 0.2, each.at) for each in walkers
        ]
        least, near = within, list[tuple[float, int, int]]()
        for i in self.moving:
            geometry, place = self.items.geometryObjects[i].geometry, self._there(i)
            center = place.transform(geometry.aabb_center)
            for k, (shape, other, radius, at) in enumerate(others):
                if math.dist(center, at) - geometry.aabb_radius - radius < within:
                    near.append((apart(self.hulls[i], place, shape, other), i, k))
        for bound, i, k in sorted(near):
            if bound >= least:
                break
            geometry, (shape, other, *_) = self.items.geometryObjects[i].geometry, others[k]
            least = min(least, measured(geometry, self._there(i), shape, other).min_distance)
        return least

    def _there(self, i: int) -> Any:
        return coal.Transform3s(self.places.oMg[i].rotation, self.places.oMg[i].translation)

    def _shape(self, walker: Walker) -> Any:
        if walker.name not in self.shapes:
            match walker.shape:
                case hdplan.Sphere(radius=radius):
                    self.shapes[walker.name] = coal.Sphere(radius)
                case hdplan.Capsule(radius=radius, length=length):
                    self.shapes[walker.name] = coal.Capsule(radius, length)
                case hdplan.Box(size=size):
                    self.shapes[walker.name] = coal.Box(*size)
        return self.shapes[walker.name]


class Gaps:
    """Lower bounds on the distance of the robot from each body: what was measured last, less what both have gone since.
    Measured again only where that does not suffice."""

    def __init__(self, judge: Judge, speed: float = SPEED) -> None:
        """Take the greatest speed of the bodies [m/s]."""
        self.judge, self.levers, self.speed = judge, judge.levers(), speed
        self.least: dict[str, float] = {}
        self.at: np.ndarray | None = None

    def move(self, q: np.ndarray, dt: float) -> None:
        """Note that the robot is at q now, and that the bodies have moved."""
        gone = self.speed * dt + (0.0 if self.at is None else float(np.abs(q - self.at) @ self.levers))
        self.at, self.least = q, {name: bound - gone for name, bound in self.least.items()}

    def below(self, walkers: list[Walker], most: float, floor: bool = False) -> float:
        """Return the least distance [m] of the robot from these bodies if it is below `most`, and otherwise that."""
        for name, group in [("floor", []), *((each.name, [each]) for each in walkers)][0 if floor else 1 :]:
            if self.least.get(name, -np.inf) < most:
                assert self.at is not None
                self.least[name] = self.judge.distance(self.at, group, FAR, floor=not group)
            most = min(most, self.least[name])
        return most


def scene_of(seed: int, lag: float = LAG) -> tuple[hdplan.Scene, list[np.ndarray]]:
    """Return the scene of a run and its goals: free of the floor and of the robot itself."""
    rng = np.random.default_rng([seed, 0])
    spec = hdplan.RobotSpec("panda", tracking=hdplan.Tracking(lag))
    start = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    scene = hdplan.Scene(robot=spec, obstacles=[FLOOR], start=start, goal=start, limits=LIMITS)
    robot = Setup.of(scene).robot
    goals: list[np.ndarray] = []
    while len(goals) < 60:
        q = np.array(start) + rng.uniform(-1.0, 1.0, 7) * [2.0, 0.9, 0.6, 0.8, 0.6, 0.8, 1.0]
        q = np.clip(q, robot.lower + 0.1, robot.upper - 0.1)
        if not hdplan.check_configuration(scene, robot, q) and (not goals or np.abs(q - goals[-1]).max() > 0.5):
            goals.append(q)
    return scene.with_goal(goals[0]), goals
