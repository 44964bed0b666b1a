"""The world in which a stage of a job begins: the robot, its held objects, and the obstacles around it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.job.places import link_pose
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.curve_stages import Curve
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.job import Job
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.shapes import Solid
from hdplan.scenes.targets import JointTarget

Rates = tuple[tuple[float, ...], tuple[float, ...]]  # velocities and accelerations


@dataclass(frozen=True)
class Corner:
    """The end of a stage, had it not been blended into the next one."""

    radius: float  # [m]
    link: str  # of which the radius is meant
    pose: Pose  # of it, in the world
    free: str  # the axis about which it could turn as it liked
    curve: tuple[Pose, ...] = ()  # along which it would have got there; none of a move
    rates: tuple[float | None, float | None] = (None, None)  # speed [m/s] and acceleration [m/s²] of the tool there


@dataclass(frozen=True)
class World:
    """The robot, what it holds, and what stands around it."""

    scene: Scene  # of the job
    arm: tuple[tuple[str, float], ...]  # the planned joints and their values [rad] or [m]
    hand: tuple[tuple[str, float], ...]  # joints that are held, as far as the job says where
    obstacles: tuple[Obstacle, ...]
    held: tuple[Attached, ...]
    notes: tuple[str, ...] = ()  # on points of clouds that were left out
    rates: Rates | None = None  # the arm's, where it does not rest
    corner: Corner | None = None  # of the stage before, where that is blended into the next one
    taken: tuple[Attached, ...] = ()  # objects of two hands, as the second carries them once it has them alone

    @classmethod
    def at_first(cls, scene: Scene) -> World:
        """Return the world before the first stage. Raises InputError for a scene without a job that can be
        planned."""
        if scene.job is None:
            raise InputError(f"{scene.source}: job: is missing; hdplan.plan is for a single motion")
        if scene.limits.acceleration is None:
            raise InputError(f"{scene.source}: limits.acceleration: is missing: a job is timed, and a URDF has none")
        bare = derived(scene, job=None)
        bare.check_effects()
        setup = Setup.of(bare)  # leaves out of clouds what they are to ignore: once, where the job begins
        robot = setup.robot
        with naming(scene.source):
            q = robot.configuration(scene.start)
        named = {joint: robot.locked[joint] for joint in scene.start.by_name or () if joint in robot.locked}
        arm = tuple(zip(robot.joint_names, q.tolist(), strict=True))
        return cls(scene, arm, tuple(named.items()), _as_seen(setup), scene.attached, notes=setup.ignored)

    @property
    def job(self) -> Job:
        """The job, which `at_first` has found."""
        assert self.scene.job is not None
        return self.scene.job

    def curve(self, number: int) -> Curve:
        """Return a stage along a curve."""
        stage = self.job.stages[number]
        assert isinstance(stage, Curve)
        return stage

    @property
    def things(self) -> dict[str, Obstacle | Attached]:
        """Obstacles and held objects by name."""
        found: tuple[Obstacle | Attached, ...] = (*self.obstacles, *self.held)
        return {each.name: each for each in found}

    def place(self, name: str) -> Array:
        """Return the pose (4, 4) of an object in the world."""
        thing = self.things[name]
        if isinstance(thing, Obstacle):
            return thing.pose.matrix
        return np.asarray(link_pose(self.robot, self.q, thing.link) @ thing.pose.matrix)

    @property
    def q(self) -> Array:
        """The arm's joint values (n,)."""
        return np.array([value for _, value in self.arm])

    def standing(self, name: str) -> Obstacle:
        """Return an obstacle that can be touched, or gripped."""
        standing = {each.name: each for each in self.obstacles}
        if name in {each.name for each in self.held}:
            raise InputError(f"'{name}' is held")
        if name not in standing:
            raise InputError(f"there is no object '{name}'{nearest(name, standing)}")
        shape_of(standing[name])
        return standing[name]

    def holding(self, name: str) -> Attached:
        """Return a held object."""
        held = {each.name: each for each in self.held}
        if name not in held:
            raise InputError(f"release.object: '{name}' is not held; held: {', '.join(held) or 'nothing'}")
        return held[name]

    @property
    def start(self) -> JointTarget:
        """Configuration of the arm, and its rates there."""
        velocity, acceleration = self.rates or (None, None)
        return JointTarget("start", tuple(value for _, value in self.arm), velocity=velocity, acceleration=acceleration)

    @cached_property
    def setups(self) -> dict[int, Setup]:
        """The scenes of stages that were made from here, with their robots, by number."""
        return {}

    @cached_property
    def certifiers(self) -> dict[int, Certifier]:
        """Their certifiers, by number."""
        return {}

    @cached_property
    def robot(self) -> Robot:
        """The robot with the hand as it is, and what it holds."""
        robot = replace(self.scene.robot, locked={**self.scene.robot.locked, **dict(self.hand)})
        limits = Limits(position=self.scene.limits.position)
        held = tuple(replace(each, touch_links=()) for each in self.held)
        bare = {"job": None, "attached": held, "obstacles": (), "payload": None, "timing": None, "limits": limits}
        still = replace(self.start, velocity=None, acceleration=None)
        return load_scene_robot(derived(self.scene, robot=robot, start=still, goal=still, **bare))


def _as_seen(setup: Setup) -> tuple[Obstacle, ...]:
    """Return obstacles whose clouds have nothing more to ignore: later, the robot and what it moves are elsewhere, and
    what is near them there is no image of theirs."""
    return tuple(
        replace(each, shape=replace(each.shape, ignore_robot=0.0, ignore=())) if isinstance(each.shape, Cloud) else each
        for each in setup.requested.obstacles
    )


def shape_of(obstacle: Obstacle) -> Solid:
    """Return the shape of an obstacle that can be touched, or gripped. Raises InputError for all others."""
    if not isinstance(obstacle.shape, Solid):
        what = f"'{obstacle.name}' comes from a camera or a map, and is not an object"
        raise InputError(f"{what}: only shapes and meshes can be touched, or held")
    return obstacle.shape
