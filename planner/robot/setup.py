"""A scene with its robot, and what follows from both: made once and passed to everything."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.opened import opened
from hdplan.planner.robot.end_rates import EndRates, end_rates
from hdplan.planner.robot.joint_limits import joint_limits
from hdplan.planner.robot.link_frame import end_effector
from hdplan.planner.robot.robot import SAME_PLACE, Robot
from hdplan.planner.robot.scene_robot import check_robot, load_scene_robot
from hdplan.planner.robot.self_filter import self_filtered
from hdplan.planner.robot.units import unlikely_units
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.once import ReadOnly, read_only
from hdplan.scenes.scene import Scene, derived, unknown_in
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget
from hdplan.scenes.values import instance


@dataclass(frozen=True)
class Query(ReadOnly):
    """The two ends of a plan, as joint values."""

    start: Array  # (n,)
    goal: Array  # (n,)


@dataclass(frozen=True, eq=False)
class Setup:
    """A scene with its robot, the content of its files in memory: nothing behind it opens them again. Properties are
    computed on first use and kept."""

    scene: Scene  # its shapes read (`geometry.opened`)
    robot: Robot
    aimed: bool = False  # at just this goal: joints without limits take its values as they stand
    units: tuple[str, ...] = ()  # notes on meshes that were hardly meant in metres
    ignored: tuple[str, ...] = ()  # notes on points of clouds that were left out
    filtered_points: Array | None = None  # (m, 3) those points, in the world [m]
    requested: Scene = None  # type: ignore[assignment]  # the scene with the names of its files, to be shown and saved

    def __post_init__(self) -> None:
        """Read the files that the scene names. Raises InputError for one that cannot be used."""
        if self.scene.job is not None:
            raise InputError(
                f"{self.scene.source}: job: holds several motions, and here one is needed; `hdplan plan` and "
                "hdplan.plan_job plan it, hdplan.certify_job checks it, and each stage of their results has its own "
                "scene"
            )
        object.__setattr__(self, "requested", self.requested or self.scene)
        object.__setattr__(self, "scene", opened(self.scene))

    def __repr__(self) -> str:
        """Name the scene and its robot."""
        return f"<Setup of {self.scene.name}: {self.robot!r}>"

    @classmethod
    def of(cls, scene: Scene, robot: Robot | None = None) -> Setup:
        """Load a scene's robot, or take `robot` if it is already loaded.

        Raises InputError for a robot that cannot be loaded, one that is not the scene's (`check_robot`), and for
        arguments of another type.
        """
        instance(scene, Scene, "scene")
        if robot is None:
            robot = load_scene_robot(scene)
        else:
            instance(robot, Robot, "robot")
            check_robot(scene, robot)
        return cls._read(scene, robot)

    @classmethod
    def _read(cls, scene: Scene, robot: Robot) -> Setup:
        """Read the files of a scene with its robot, and leave out the points that it ignores."""
        requested = _with_links(scene, robot)
        read = opened(requested)
        seen = self_filtered(requested, read, robot)
        left = {old.name: new for old, new in zip(read.obstacles, seen.scene.obstacles, strict=True) if new is not old}
        if left:
            requested = derived(requested, obstacles=tuple(left.get(each.name, each) for each in requested.obstacles))
        units = tuple(unlikely_units(seen.scene, robot))
        return cls(seen.scene, robot, units=units, ignored=seen.notes, filtered_points=seen.points, requested=requested)

    def seeing(self, requested: Scene) -> Setup:
        """Return this robot, which was checked, in an updated scene: with other obstacles, or another start.
        Raises InputError for files that cannot be used."""
        return Setup._read(requested, self.robot)

    def aiming_at(self, goal: JointTarget) -> Setup:
        """Return a copy with another goal."""
        return replace(self if goal is self.scene.goal else self.changed(goal=goal), aimed=True)

    def changed(self, **fields: Any) -> Setup:
        """Return a copy with other fields of its scene. Raises InputError for what no scene can have, and for files
        that cannot be used."""
        requested = derived(self.requested, **fields)
        return replace(
            self,
            scene=requested if self.scene is self.requested else derived(self.scene, **fields),
            requested=requested,
        )

    @cached_property
    def query(self) -> Query:
        """The scene's start and goal, which joints without limits reach the short way round, a whole turn away from its
        value or more. Raises InputError, naming the scene's file, for ends that do not fit the robot.

        A goal that leaves a choice (`Goals`) is not a single configuration: `search.goals.settled` chooses one.
        """
        scene, robot = self.scene, self.robot
        if isinstance(scene.goal, Goals):
            raise InputError(f"{scene.source}: {scene.goal.field}: leaves a choice; one configuration is needed here")
        with naming(scene.source):
            start, goal = (robot.configuration(target, scene.from_request) for target in (scene.start, scene.goal))
        return Query(start, goal if self.aimed else robot.nearest_turn(goal, start))

    @cached_property
    def rates(self) -> tuple[EndRates | None, EndRates | None]:
        """Rates of the robot at the scene's start and goal; None for an end at rest.
        Raises InputError, naming the scene's file, for rates that do not fit the robot."""
        scene = self.scene
        with naming(scene.source):
            start, goal = (end_rates(self.robot, end, scene.from_request) for end in (scene.start, scene.goal))
        return start, goal

    @property
    def moving_ends(self) -> tuple[EndRates, ...]:
        """Rates of the start and goal at which the robot is not at rest."""
        return tuple(rates for rates in self.rates if rates is not None and rates.moving)

    def rates_around(self, order: int) -> tuple[Array, Array]:
        """The joints' derivatives (n,) of an order just before the start and just after the goal: the velocity and
        acceleration that the scene gives, and 0 of all else."""
        none = np.zeros(self.robot.n)
        before, after = (
            none if each is None else {1: each.velocity, 2: each.acceleration}.get(order, none) for each in self.rates
        )
        return before, after

    def refuse_moving_ends(self, who: str) -> None:
        """Raise InputError for a scene whose robot does not begin and end at rest, for `who` cannot do otherwise."""
        for rates in self.moving_ends:
            raise InputError(f"{self.scene.source}: {rates.field}.velocity: is not 0, and {who}")

    def refuse_sizes(self, who: str) -> None:
        """Raise InputError for a scene in which something is unknown, which is more than `who` knows."""
        for field in unknown_in(self.scene):
            raise InputError(f"{self.scene.source}: {field}: is not 0, and {who}")

    @property
    def limits(self) -> dict[str, Array]:
        """The limits (n,) of every limited quantity, by name; see `joint_limits`. A copy of what is kept."""
        return dict(self._limits)

    @cached_property
    def _limits(self) -> dict[str, Array]:
        return {name: read_only(limit) for name, limit in joint_limits(self.scene, self.robot).items()}

    @property
    def loaded_model(self) -> pin.Model:
        """The robot's model with the scene's loads; see `loads.loaded_model`. A copy of what is kept."""
        return self._loaded_model.copy()

    @cached_property
    def _loaded_model(self) -> pin.Model:
        from hdplan.planner.robot.loads import loaded_model

        return loaded_model(self.scene, self.robot)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user on what was changed, assumed or left out."""
        return (*self.scene.notes, *self.robot.notes, *self.units, *self.ignored, *self.left_out, *self.turned)

    @property
    def turned(self) -> tuple[str, ...]:
        """A note on goals of joints without limits that are reached whole turns away from their values."""
        scene, robot = self.scene, self.robot
        if self.aimed or isinstance(scene.goal, Goals) or not np.isinf(robot.lower).any():
            return ()
        goal = self.query.goal  # first, as it checks the values
        given = robot.configuration(scene.goal, scene.from_request)
        off = [
            f"{joint} at {goal[i]:.6g} instead of {given[i]:.6g}"
            for i, joint in enumerate(robot.joint_names)
            if goal[i] != given[i]
        ]
        return (f"{scene.goal.field}: whole turns away, by the short way round: {', '.join(off)}",) if off else ()

    @property
    def left_out(self) -> tuple[str, ...]:
        """Notes on values of the scene's start and goal that are not used: for joints that the robot does not have, and
        those of a named state for joints that are held at another value by default."""
        scene, robot = self.scene, self.robot
        ends = [target for target in (scene.start, scene.goal) if isinstance(target, JointTarget)]
        named = [joint for target in ends for joint in target.by_name or ()]
        unknown = [
            joint
            for joint in dict.fromkeys(named)
            if joint not in (*robot.joint_names, *robot.followers, *robot.locked)
        ]
        notes = [f"left out, as {robot.name} has no such joints: {', '.join(unknown)}"] if unknown else []
        for target in ends:
            state = robot.named_states.get(target.state or "", {})
            by_default = {joint: at for joint, at in robot.locked.items() if joint not in scene.robot.locked}
            off = [joint for joint, at in by_default.items() if abs(state.get(joint, at) - at) > SAME_PLACE]
            if off:
                held = ", ".join(f"{joint} at {state[joint]:g}, held at {robot.locked[joint]:g}" for joint in off)
                notes.append(f"{target.field}: state '{target.state}' has {held}")
        return tuple(notes)


def _with_links(scene: Scene, robot: Robot) -> Scene:
    """Return the scene with the end effector named in goal poses that name no link."""
    goal = scene.goal
    if isinstance(goal, JointTarget) or all(getattr(target, "link", "") is not None for target in goal.targets):
        return scene
    with naming(scene.source):
        targets = [
            replace(target, link=end_effector(robot, target.field))
            if isinstance(target, PoseTarget) and target.link is None
            else target
            for target in goal.targets
        ]
    return derived(scene, goal=replace(goal, targets=targets))  # type: ignore[arg-type]
