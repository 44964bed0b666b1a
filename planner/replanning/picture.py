"""The world as it was last seen: each obstacle with the time of its picture, and all of them at one time.

An obstacle that was seen at t₀ with a speed v may be, at t, anywhere within its sizes and v (t − t₀) of its place on
its expected course. A picture is the scene of all obstacles at the time of the latest of them: those that were seen
before have moved on until then, and are less certain by as much. Its certificate counts times from there, so that what
it proves of a motion holds whatever the obstacles do until the robot stands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.replanning.nominal import Rows
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import FieldError, InputError, nearest
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, Seen, SteadyMotion, obstacles_of
from hdplan.scenes.poses import AnyPose, Pose, placement
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.shapes import Solid
from hdplan.scenes.sizes import Uncertainty
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.values import checked, instance

SHORTEST_PART = 2.0**-5  # of the time between two rows, for which a proof examines a place: it has to be found quickly
LARGEST_UNCERTAINTY = 1.0  # [m] by which an obstacle may be uncertain; one that may be farther off may be anywhere


@dataclass(frozen=True)
class Sighting:
    """An obstacle, where it was at a time."""

    obstacle: Obstacle
    at: float  # [s]

    def later(self, at: float) -> Obstacle | None:
        """Return the obstacle at a later time, as uncertain as it then is; None if it may be anywhere."""
        obstacle, age = self.obstacle, at - self.at
        if not obstacle.moves or age <= 0.0:
            return obstacle
        sizes = obstacle.uncertainty or Uncertainty()
        position = sizes.position + sizes.speed * age
        if position > LARGEST_UNCERTAINTY:
            return None
        return replace(obstacle, pose=moved_on(obstacle, age), uncertainty=replace(sizes, position=position))

    def frozen(self, at: float, margin: float) -> Obstacle:
        """Return the obstacle where it is expected at a time, standing, with room for what it may go in `margin` [s],
        to plan a way past it; without one, at its nominal pose."""
        obstacle, age = self.obstacle, max(at - self.at, 0.0)
        if not obstacle.moves:
            return obstacle
        sizes = obstacle.uncertainty or Uncertainty()
        speed = sizes.speed
        if isinstance(obstacle.motion, SteadyMotion):
            speed += float(np.linalg.norm(obstacle.motion.velocity))
        unknown = (
            Uncertainty(min(sizes.position + speed * margin, LARGEST_UNCERTAINTY), sizes.orientation)
            if margin
            else None
        )
        return replace(obstacle, pose=moved_on(obstacle, age), motion=None, uncertainty=unknown)


def moved_on(obstacle: Obstacle, age: float) -> Pose:
    """Return the pose of an obstacle after `age` [s]."""
    if obstacle.motion is None:
        return obstacle.pose
    matrix = ObstacleMotion.of(obstacle).at(np.array([age]))[0]
    turn = scipy.spatial.transform.Rotation.from_matrix(matrix[:3, :3]).as_quat()
    return Pose(tuple(matrix[:3, 3].tolist()), tuple(turn.tolist()))


@dataclass(frozen=True)
class Sightings:
    """All that is known of the world: the scene's own obstacles, what was seen beside them, and what a camera saw."""

    scene: Scene
    at: float  # [s] when the latest of it was seen
    known: Mapping[str, Sighting] = field(default_factory=dict)
    seen: Mapping[str, Sighting] = field(default_factory=dict)
    cloud: Sighting | None = None

    @classmethod
    def of(cls, scene: Scene, at: float) -> Sightings:
        """Return the scene's own obstacles, as seen at a time [s]."""
        for i, obstacle in enumerate(scene.obstacles):
            _refuse_timed(obstacle, f"{scene.source}: obstacles[{i}]")
        return cls(scene, at, {each.name: Sighting(each, at) for each in scene.obstacles})

    @property
    def all(self) -> dict[str, Sighting]:
        """Every obstacle once, by its name."""
        found = {**self.known, **self.seen}
        return found if self.cloud is None else {**found, self.cloud.obstacle.name: self.cloud}

    def updated(
        self,
        at: float,
        obstacles: Sequence[Obstacle | Solid | Seen] | None,
        cloud: Cloud | Obstacle | None,
        poses: Mapping[str, AnyPose] | None,
    ) -> Sightings:
        """Return a copy with what was seen at a time. Raises InputError as `Replanner.update`."""
        if at < self.at:
            raise InputError(f"at: must be no earlier than the last picture, {self.at:.6g} s, found {at:.6g} s")
        known, seen, clouded = dict(self.known), dict(self.seen), self.cloud
        if obstacles is not None:
            seen = {}
            for i, each in enumerate(checked(obstacles_of, obstacles, "obstacles")):
                _refuse_timed(each, f"obstacles[{i}]")
                if each.name in seen:
                    raise FieldError(
                        f"the name {each.name!r} is taken by an earlier one; names must differ", f"obstacles[{i}]"
                    )
                seen[each.name] = Sighting(each, at)
        if cloud is not None:
            given = obstacles_of([cloud if isinstance(cloud, Obstacle) else _named(cloud)])[0]
            if not isinstance(given.shape, Cloud):
                raise InputError("cloud: must be a Cloud, or an Obstacle with one for its shape")
            _refuse_timed(given, "cloud")
            clouded = Sighting(given, at)
        for name, pose in _mapping(poses).items():
            which = seen if name in seen else known
            if name not in which:
                raise InputError(f"poses: unknown obstacle {name!r}{nearest(str(name), [*known, *seen])}")
            placed = checked(placement, pose, f"poses.{name}")
            which[name] = Sighting(replace(which[name].obstacle, pose=placed), at)
        clouds = {name for name, each in known.items() if isinstance(each.obstacle.shape, Cloud)} - set(seen)
        if clouded is not None and (name := clouded.obstacle.name) in {*known, *seen} - clouds:
            raise InputError(f"cloud: its name {name!r} is that of an obstacle; names must differ")
        return Sightings(self.scene, at, known, seen, clouded)


def _refuse_timed(obstacle: Obstacle, where: str) -> None:
    if obstacle.motion is not None and not isinstance(obstacle.motion, SteadyMotion):
        raise InputError(
            f"{where}: motion: poses at known times are of a single motion; a replanner takes a velocity and a spin, "
            "and uncertainty.speed for what is not known of them"
        )


def _named(cloud: object) -> Obstacle:
    instance(cloud, Cloud, "cloud")
    assert isinstance(cloud, Cloud)
    return Obstacle(cloud.name or "cloud", replace(cloud, name=None, pose=None), cloud.pose or Pose())


def _mapping(poses: object) -> Mapping[str, AnyPose]:
    if poses is None:
        return {}
    if not isinstance(poses, Mapping):
        raise InputError("poses: must be a mapping from the names of obstacles to their poses")
    return poses


class Picture:
    """A scene at one time, with its certificate."""

    def __init__(self, sightings: Sightings, robot: Robot, q: Array) -> None:
        """Prepare it; q (n,) is where the robot was at that time, whose own points a cloud may leave out. Raises
        InputError for what no scene can have."""
        self.at = sightings.at
        found = {name: sighting.later(self.at) for name, sighting in sightings.all.items()}
        self.lost = tuple(name for name, obstacle in found.items() if obstacle is None)
        obstacles = tuple(obstacle for obstacle in found.values() if obstacle is not None)
        scene = derived(sightings.scene, obstacles=obstacles, start=JointTarget("start", tuple(q.tolist())))
        self.certifier = Certifier(Setup.of(scene, robot))

    def prove(self, rows: Rows, begins: float, h: float, settling: float, required: float) -> Certificate:
        """Certify a motion, given by rows h [s] apart, from a time `begins` [s] until it stands, and `settling` [s]
        longer."""
        robot, (position, velocity, acceleration) = self.certifier.robot, rows
        times = begins - self.at + h * np.arange(len(position), dtype=np.float64)
        if settling > 0.0:
            position = np.concatenate([position, position[-1:]])
            velocity, acceleration = (
                np.concatenate([each, np.zeros_like(each[-1:])]) for each in (velocity, acceleration)
            )
            times = np.append(times, times[-1] + settling)
        first, *rates = (tuple(each[0].tolist()) for each in (position, velocity, acceleration))
        start = JointTarget("start", first, velocity=rates[0], acceleration=rates[1])
        goal = JointTarget("goal", tuple(position[-1].tolist()))
        motion = Trajectory(robot.joint_names, position, robot.locked, times, velocity, acceleration)
        ends = len(position) - 2, 1.0  # where most is unknown: what cannot be proven mostly fails there
        certifier = self.certifier.between(start, goal)
        return certifier.certify(motion, required=required, suspect=ends, shortest=SHORTEST_PART, measured=False)
