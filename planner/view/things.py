"""Things that can be selected and dragged: obstacles, the start and the goal; and what dragging does to the scene.

Pure functions of values: nothing here knows a browser. An end given by joint values follows the tip of the robot, a
goal pose its own link, and keeps its tolerance and free axis.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple, assert_never

import pinocchio as pin

from hdplan.planner.kinematics.inverse import Aim
from hdplan.planner.view.drawing.motion import Tip, as_pose
from hdplan.planner.view.drawing.reaching import follow_pose, follow_tip
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.ends import jogged, with_target
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Sphere
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget

REACHED_DISTANCE = 1e-3  # [m] by which the tip may miss its handle without a message
MEETS = "out of reach: {link} is {short:.0f} mm short"


class Thing(NamedTuple):
    """Something that can be selected."""

    kind: str  # "start", "goal" or "obstacle"
    name: str = ""  # of an obstacle; of the link, of a goal that has poses of several

    def __str__(self) -> str:
        """The thing's name in messages."""
        if self.kind == "obstacle":
            return f"obstacle {self.name}"
        return f"the {self.kind}" + (f" of {self.name}" if self.name else "")


START, GOAL = Thing("start"), Thing("goal")


def things(edited: Edited) -> tuple[Thing, ...]:
    """Return all that can be selected."""
    target = edited.target
    goals = [Thing("goal", str(pose.link)) for pose in target.poses] if isinstance(target, AllOf) else [GOAL]
    return (START, *goals, *(Thing("obstacle", obstacle.name) for obstacle in edited.scene.obstacles))


def place_of(edited: Edited, thing: Thing, tip: Tip) -> Pose:
    """Return the point at which a thing is grasped (world frame): an obstacle that moves, where it is at 0 s."""
    if thing.kind == "obstacle":
        return edited.obstacle(thing.name).pose
    if thing.kind == "goal" and (pose := _pose(edited, thing)) is not None:
        return pose.pose
    return tip.pose(edited.start if thing.kind == "start" else edited.goal)


def turns(edited: Edited, thing: Thing) -> bool:
    """True if turning a thing changes anything."""
    if thing.kind == "obstacle":
        return not isinstance(edited.obstacle(thing.name).shape, Sphere)
    pose = _pose(edited, thing) if thing.kind == "goal" else None
    return pose is None or pose.free_rotation != "all"


def dragged(
    edited: Edited, thing: Thing, pose: Pose, tip: Tip, begin: Edited | None = None, along: Collection[str] = ()
) -> tuple[Edited, str]:
    """Return the scene with a thing dragged to `pose` (world frame), and a word where it cannot follow. `begin` is what
    it was when dragging began: an arm that was pulled out of reach follows from there again. Obstacles `along` with one
    keep their places relative to it. Raises InputError for what the scene does not allow."""
    begin = begin or edited
    if thing.kind == "obstacle":
        # From where they were at first: small steps, one after the other, would add up to other distances.
        first = {each.name: each.pose for each in begin.scene.obstacles}
        way = pin.SE3(pose.matrix) * pin.SE3(first.get(thing.name, edited.obstacle(thing.name).pose).matrix).inverse()
        obstacles = [
            moved(each, pose)
            if each.name == thing.name
            else moved(each, as_pose(way * pin.SE3(first.get(each.name, each.pose).matrix)))
            if each.name in along
            else each
            for each in edited.scene.obstacles
        ]
        return edited.changed(obstacles=tuple(obstacles)), ""
    if thing.kind == "goal" and (old := _pose(edited, thing)) is not None:
        return _goal_pose_dragged(edited, old, pose, begin)
    postures = [edited.start, begin.start] if thing.kind == "start" else [edited.goal, begin.goal]
    q, off = follow_tip(tip, postures, pin.SE3(pose.matrix))
    words = MEETS.format(link="the tip", short=1e3 * off) if off > REACHED_DISTANCE else ""
    return jogged(edited, thing.kind, q), words


def _goal_pose_dragged(edited: Edited, old: PoseTarget, pose: Pose, begin: Edited) -> tuple[Edited, str]:
    """Move a goal pose, and the configuration shown after it."""
    goal, target = edited.scene.goal, edited.target
    assert isinstance(goal, Goals)
    assert isinstance(target, PoseTarget | AllOf)
    kept = replace(pose, quaternion_xyzw=Pose.quaternion_xyzw) if old.free_rotation == "all" else pose
    new = replace(old, pose=kept)
    whole = new if target is old else AllOf([new if pose is old else pose for pose in target.poses], target.field)
    q, reached, off = follow_pose(Aim.at(edited.robot, whole), [edited.goal, begin.goal])
    words = "" if reached else MEETS.format(link=old.link, short=1e3 * off) + " (of its posture; Plan tries all)"
    return edited.ending_at(q, with_target(goal, target, whole)), words


def _pose(edited: Edited, thing: Thing) -> PoseTarget | None:
    """The goal pose that is selected; None for a goal by joint values."""
    target = edited.target
    if isinstance(target, JointTarget):
        return None
    return next((pose for pose in target.poses if pose.link == thing.name), target.poses[0])


def moved(obstacle: Obstacle, pose: Pose) -> Obstacle:
    """Return an obstacle that is at `pose` at time 0; one that moves keeps its velocity and spin at every time."""
    match motion := obstacle.motion:
        case None | SteadyMotion():
            return replace(obstacle, pose=pose)
        case TimedPoses():
            return _rerouted(obstacle, motion, pose)
        case _:
            assert_never(motion)


def _rerouted(obstacle: Obstacle, motion: TimedPoses, pose: Pose) -> Obstacle:
    """Return an obstacle whose timed poses begin at `pose` and keep their places relative to the first."""
    shift = pose.matrix[:3, 3] - obstacle.pose.matrix[:3, 3]
    turn = scipy.spatial.transform.Rotation.from_quat(
        obstacle.pose.quaternion_xyzw
    ).inv() * scipy.spatial.transform.Rotation.from_quat(pose.quaternion_xyzw)
    poses = [
        Pose(
            tuple((each.matrix[:3, 3] + shift).tolist()),
            tuple((scipy.spatial.transform.Rotation.from_quat(each.quaternion_xyzw) * turn).as_quat().tolist()),
        )
        for each in motion.poses[1:]
    ]
    return replace(obstacle, pose=pose, motion=replace(motion, poses=(pose, *poses)))
