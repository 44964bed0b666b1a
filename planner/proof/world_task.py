"""The task of a scene as a world writes it: path constraints, start and goal."""

from __future__ import annotations

from typing import assert_never

from hdplan.planner.proof.world_values import Plain, bounds, frame_of, numbers, off
from hdplan.planner.robot.end_rates import EndRates
from hdplan.planner.robot.link_frame import end_effector
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import naming
from hdplan.scenes.path_constraints import AXES, Follow, PathConstraint, Relative, Upright, Within
from hdplan.scenes.targets import AllOf, Goals, JointTarget, PoseTarget

FOLLOWED = (  # numbers of a curve that is followed, by their names there
    *("position_tolerance", "orientation_tolerance", "begin_tolerance", "end_tolerance"),
    *("speed", "acceleration"),
)


def plain_path(setup: Setup) -> list[Plain]:
    """Return the path constraints. Raises InputError for one of which a proof holds nothing."""
    with naming(setup.scene.source):
        return [_constraint(each, setup.scene.from_request) for each in setup.scene.path.given.values()]


def _constraint(constraint: PathConstraint, from_request: bool) -> Plain:
    match constraint:
        case Upright():
            # a request narrows the tolerance of a slanted axis
            exact = constraint.axis in AXES.values() and not from_request
            return {
                "kind": "upright",
                "link": constraint.link,
                "axis": numbers(constraint.axis),
                "off": 0.0 if exact else off(constraint.axis, constraint.tolerance),
                "tolerance": constraint.tolerance,
            }
        case Within():
            place = {"point": numbers(constraint.point), "size": bounds(constraint.size), **frame_of(constraint.pose)}
            return {"kind": "position", "link": constraint.link, **place}
        case Relative():
            return {
                "kind": "relative",
                "link": constraint.link,
                "to": constraint.to,
                "frame": None if constraint.pose is None else frame_of(constraint.pose),
                "position_tolerance": constraint.position_tolerance,
                "orientation_tolerance": constraint.orientation_tolerance,
            }
        case Follow():
            return {
                "kind": "follow",
                "link": constraint.link,
                "free": constraint.free_rotation,
                "poses": [frame_of(pose) for pose in constraint.poses],
                **{name: getattr(constraint, name) for name in FOLLOWED},
            }
        case _:
            assert_never(constraint)


def plain_start(setup: Setup) -> list[Plain]:
    """Return the start. Raises InputError for one that does not fit the robot."""
    scene = setup.scene
    with naming(scene.source):
        return [{**_values(setup, scene.start, scene.from_request), **_rates(setup.rates[0])}]


def plain_goal(setup: Setup) -> list[Plain]:
    """Return the targets of the goal, one of which is to be reached. Raises InputError for one that does not fit the
    robot."""
    scene = setup.scene
    with naming(scene.source):
        match goal := scene.goal:
            case JointTarget():
                return [{**_values(setup, goal, scene.from_request), **_rates(setup.rates[1])}]
            case Goals():
                return [_target(setup, each) for each in goal.targets]
            case _:
                assert_never(goal)


def _rates(rates: EndRates | None) -> Plain:
    """Return the robot's rates at an end, where the scene has them."""
    return {} if rates is None else {name: numbers(values) for name, values in rates.given.items()}


def _target(setup: Setup, target: JointTarget | PoseTarget | AllOf) -> Plain:
    match target:
        case JointTarget():
            return _values(setup, target)
        case PoseTarget() | AllOf():
            return {"poses": [_pose(setup.robot, each) for each in target.poses]}
        case _:
            assert_never(target)


def _values(setup: Setup, target: JointTarget, from_request: bool = False) -> Plain:
    """Return joint values, and those that the target has for joints that are held or follow; where `robot.locked` says
    where a joint stands, a named state does not."""
    robot = setup.robot
    named = target.by_name or robot.named_states.get(target.state or "", {})
    placed = setup.scene.robot.locked if target.state is not None else {}
    others = {x: at for x, at in named.items() if x in (*robot.locked, *robot.followers) and x not in placed}
    return {"joints": numbers(robot.configuration(target, from_request)), "others": others}


def _pose(robot: Robot, target: PoseTarget) -> Plain:
    return {
        "link": end_effector(robot, target.field) if target.link is None else target.link,
        **frame_of(target.pose),
        "position_tolerance": target.position_tolerance,
        "orientation_tolerance": target.orientation_tolerance,
        "free": target.free_rotation,
    }
