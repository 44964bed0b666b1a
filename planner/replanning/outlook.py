"""The outlook: whether the rest of the nominal motion is still free, and another way where it is not.

Checked beside the steps, as it takes longer than one. Obstacles stand here where they are expected now, larger by what
they may go while a motion that is held lasts: a way so far from them can mostly be driven, each piece of it proven as
they move. Nothing of this is trusted: whatever is driven is proven by the step (`replanner`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.replanning.nominal import Nominal
from hdplan.planner.replanning.picture import Sightings
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.limits import Limits
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.targets import Goals, JointTarget

ROOM_SHARES = (1.0, 0.4, 0.0)  # of the room for the obstacles' motion, tried in this order
FREE_SHARE = 0.8  # of that room, within which a way counts as free
BRAKING_ROOM = {"acceleration": 0.5, "jerk": 0.5}  # share of the limits that a way takes; the rest is for the law on it
PLANNING_LIMIT = 0.5  # [s] for one way


@dataclass(frozen=True, eq=False)
class Question:
    """The robot's way and the world, at one moment."""

    scene: Scene  # with the goal that is to be reached
    robot: Robot
    sightings: Sightings
    now: float  # [s]
    horizon: float  # [s] from a picture to the standstill of a motion that it proves
    nominal: Nominal | None  # that the robot drives
    new_goal: bool  # whether the goal has changed
    row: int  # of the nominal motion, from which on its rest may be replaced
    standing: Array | None  # (n,) where the robot will stand and start again; None: it continues at `row`
    stuck: bool  # whether the robot stands, though its way may be free

    @property
    def begins(self) -> float:
        """The time s of the nominal motion at which another one may take the place of its rest."""
        assert self.nominal is not None
        assert self.nominal.motion.times is not None
        return float(self.nominal.motion.times[self.row])


@dataclass(frozen=True, eq=False)
class Answer:
    """A way for the rest of the motion, if another one is needed."""

    question: Question
    way: Nominal | None  # from `row`, or from where the robot stands; None: none is needed, or none was found
    why: str = ""  # no way was found


def outlook(question: Question) -> Answer:
    """Return the verdict on whether the way is free, and another way if not."""
    nominal = question.nominal
    kept = nominal is not None and not question.new_goal and not (question.stuck and nominal.margin < question.horizon)
    if kept and _free(question):
        return Answer(question, None)
    why = ""
    moving = any(each.obstacle.moves for each in question.sightings.all.values())
    for share in ROOM_SHARES if moving else ROOM_SHARES[:1]:  # where nothing moves, no share makes another world
        margin = share * question.horizon
        try:
            return Answer(question, _way(question, margin))
        except HdplanError as error:
            why = str(error)
    return Answer(question, None, why)


def _world(question: Question, margin: float, start: JointTarget, goal: JointTarget | Goals) -> Scene:
    obstacles = tuple(each.frozen(question.now, margin) for each in question.sightings.all.values())
    return derived(question.scene, obstacles=obstacles, start=start, goal=goal)


def _free(question: Question) -> bool:
    """True if the rest of the nominal motion is free of obstacles where they are expected now."""
    nominal = question.nominal
    if nominal is None or (rest := nominal.rest(question.row)) is None:
        return True
    start, goal = _end("start", rest, 0), JointTarget("goal", tuple(rest.positions[-1].tolist()))
    try:
        scene = _world(question, FREE_SHARE * nominal.margin, start, goal)
        return Certifier(Setup.of(scene, question.robot)).certify(rest, required=nominal.required).certified
    except HdplanError:
        return False


def _way(question: Question, margin: float) -> Nominal:
    """Return a new way. Raises HdplanError if none is found."""
    nominal, standing, known = question.nominal, question.standing, question.sightings.all.values()
    guess = None if nominal is None or question.new_goal else nominal.rest(question.row)
    if standing is not None:
        start = JointTarget("start", tuple(standing.tolist()))
    else:
        assert nominal is not None
        start = _end("start", nominal.motion, question.row)
    scene = _world(question, margin, start, question.scene.goal)
    scene = derived(scene, limits=_less(Setup.of(scene, question.robot), scene))
    found = plan(scene, robot=question.robot, guess=guess, time_limit=PLANNING_LIMIT)
    if not found.certificate.certified:
        raise HdplanError(found.certificate.text)
    scene = derived(scene, obstacles=tuple(each.obstacle for each in known if not each.obstacle.moves))
    required, _ = Certifier(Setup.of(scene, question.robot)).required(curve_of(question.robot, found.trajectory))
    return Nominal(found.trajectory.of_joints(question.robot.joint_names, question.robot.locked), required, margin)


def _end(field: str, motion: Trajectory, row: int) -> JointTarget:
    assert motion.velocities is not None
    assert motion.accelerations is not None
    position, velocity, acceleration = (
        tuple(each[row].tolist()) for each in (motion.positions, motion.velocities, motion.accelerations)
    )
    if not np.any(velocity) and not np.any(acceleration):
        return JointTarget(field, position)
    return JointTarget(field, position, velocity=velocity, acceleration=acceleration)


def _less(setup: Setup, scene: Scene) -> Limits:
    """Return the limits of a way, on which the law may still speed up and brake."""
    most = setup.limits
    less: dict[str, Any] = {name: (share * most[name]).tolist() for name, share in BRAKING_ROOM.items() if name in most}
    return replace(scene.limits, **less)
