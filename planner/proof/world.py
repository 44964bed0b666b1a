"""The world in which hdplan planned and certified a motion, as in `docs/world.md`: from the objects in memory.

All of it comes from what the certificate uses: the robot's reduced model, its geometry and pairs, the scene's shapes,
limits and targets. No file is read again, so that a checker's own reading of the files is compared with what was
really planned.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.coal_shapes import mesh_of
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.proof.world_task import plain_goal, plain_path, plain_start
from hdplan.planner.proof.world_tracks import tracks_of
from hdplan.planner.proof.world_values import (
    Plain,
    bounds,
    frame,
    frame_of,
    numbers,
    off,
    ordered,
    plain_geometry,
    plain_mesh,
    plain_shape,
)
from hdplan.planner.robot.as_loaded import check_as_loaded
from hdplan.planner.robot.joint_limits import limits_of_all
from hdplan.planner.robot.pin_model import motion_axes
from hdplan.planner.robot.planned_joints import range_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING, MOVE_AS_ONE
from hdplan.planner.robot.setup import Setup
from hdplan.planner.robot.tracking import tracking
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import made_once
from hdplan.scenes.robot_files.link_pairs import link_pair
from hdplan.scenes.scene import Scene, derived, unknown_in

WORLD = 3  # the version of the form
LAGS = {"joints": "position", "rates": "velocity"}


def world_of(setup: Setup, trajectory: Trajectory) -> Plain:
    """Return the world of a motion in a scene, as plain JSON values.

    Raises InputError for what no world can hold yet, by name, and for a motion that is none of this robot.
    """
    scene, robot = setup.scene, setup.robot
    check_as_loaded(robot)
    around, tracks = _obstacles(setup, trajectory)
    joints, links, bodies = _parts(robot)
    return {
        "hdplan_world": WORLD,
        "joints": [dict(each) for each in joints],
        "held": dict(robot.locked),
        "links": {name: dict(each) for name, each in links.items()},
        "bodies": [*map(dict, bodies), *_held_bodies(robot), *around],
        "tracks": tracks,
        "not_compared": not_compared(setup),
        "clearances": {
            "obstacles": scene.planner.clearance,
            "own": {each.name: each.clearance for each in scene.obstacles if each.clearance is not None},
            "self": scene.self_collision.clearance,
        },
        "motion": _motion(robot, trajectory),
        "limits": _limits(setup),
        **_loads(setup),
        **_sizes(setup),
        "path": plain_path(setup),
        "start": plain_start(setup),
        "goal": plain_goal(setup),
        "duration": None if scene.timing is None else scene.timing.duration,
        "also": _also(scene),
    }


def _also(scene: Scene) -> list[str]:
    """Return the scene's further requirements, which no world can hold."""
    slower = scene.timing is not None and scene.timing.scale != 1.0
    return ["planner.objective"] * (scene.planner.objective is not None) + ["timing.scale"] * slower


# --- the robot --------------------------------------------------------------------------------------------------------


@made_once(8)
def _parts(robot: Robot) -> tuple[list[Plain], Plain, list[Plain]]:
    """Return joints, links and the links' bodies, once per robot, which is compared with what was loaded before
    (`check_as_loaded`)."""
    return [_joint(robot, index) for index in range(1, robot.model.njoints)], _links(robot), _links_bodies(robot)


def _joint(robot: Robot, index: int) -> Plain:
    """Return a joint of the model, by its index there: one more than its number in the world."""
    model = robot.model
    slide, turn = motion_axes(model.joints[index])
    follows: list[Any] = []
    if robot.linkage is not None and robot.linkage.follows[index - 1]:
        leader = int(robot.linkage.own[robot.linkage.leader[index - 1]])
        follows = [leader, float(robot.linkage.factor[index - 1]), float(robot.linkage.offset[index - 1])]
    return {
        "name": str(model.names[index]),
        "parent": int(model.parents[index]) - 1,
        "kind": "revolute" if turn.any() else "prismatic",
        **_placed(robot, int(model.parents[index]), model.jointPlacements[index], slide + turn, follows[1:] or 0.0),
        "axis": numbers(slide + turn),
        "follows": follows or None,
    }


def _placed(robot: Robot, joint: int, place: pin.SE3, *others: Any) -> Plain:
    """Return a frame of the model in that of a joint, in one group with `others`; in the world it is as far off as the
    base is turned wrongly."""
    far = () if joint else (robot.base.position,)
    return frame(place.rotation, place.translation, *others, *far)


def _links(robot: Robot) -> Plain:
    frames = [each for each in robot.model.frames if each.type == pin.FrameType.BODY]
    return {
        str(each.name): {"joint": int(each.parentJoint) - 1, **_placed(robot, int(each.parentJoint), each.placement)}
        for each in frames
    }


def _links_bodies(robot: Robot) -> list[Plain]:
    held = {each.name for each in robot.attached}
    links = sorted((link, rows) for link, rows in robot.link_geometry.items() if link not in held)
    items = enumerate(robot.collision.geometryObjects)  # hierarchies keep the order of their triangles
    meshes = {row: ordered(mesh_of(x.geometry)) for row, x in items if isinstance(x.geometry, coal.BVHModelBase)}
    found = list[Plain]()
    for link, row in ((link, row) for link, rows in links for row in rows):
        item = robot.collision.geometryObjects[row]
        shape = plain_mesh(meshes[row]) if row in meshes else plain_geometry(item.geometry)
        found.append(_body(robot, link, "link", item, shape))
    return found


def _held_bodies(robot: Robot) -> list[Plain]:
    """Return the held objects: their own shapes, as coal's hulls have lost the order of the points."""
    items = [(each, robot.collision.geometryObjects[robot.link_geometry[each.name][0]]) for each in robot.attached]
    return [_body(robot, each.name, "held", item, plain_shape(each.shape)) for each, item in items]


def _body(robot: Robot, name: str, kind: str, item: Any, shape: Plain) -> Plain:
    joint = int(item.parentJoint)
    return {"name": name, "kind": kind, "joint": joint - 1, **_placed(robot, joint, item.placement), "shape": shape}


def _loads(setup: Setup) -> Plain:
    """Return the load of each joint, up to the next ones, where torques are limited."""
    if "torque" not in setup.limits:
        return {}
    found = []
    for body in itertools.islice(setup.loaded_model.inertias, 1, None):
        mass, moment = float(body.mass), body.mass * body.lever
        about = body.inertia + mass * (body.lever @ body.lever * np.eye(3) - np.outer(body.lever, body.lever))
        six = about[np.triu_indices(3)]
        found.append({"mass": mass, "moment": numbers(moment), "inertia": numbers(six), "off": off(mass, moment, six)})
    return {"loads": found}


# --- obstacles and pairs ----------------------------------------------------------------------------------------------


def _obstacles(setup: Setup, trajectory: Trajectory) -> tuple[list[Plain], list[Plain]]:
    """Return the bodies of the obstacles, and the joints that carry those that move."""
    count, bodies, tracks = setup.robot.model.njoints - 1, list[Plain](), list[Plain]()
    for each in setup.scene.obstacles:
        place = {"joint": -1, **frame_of(each.pose)}
        if each.motion is not None:
            if trajectory.times is None:
                raise InputError(f"{setup.scene.source}: {each.name} moves, and the motion has no times")
            own, place = tracks_of(each, count + len(tracks), trajectory.times)
            tracks += own
        bodies.append({"name": each.name, "kind": "obstacle", **place, "shape": plain_shape(each.shape)})
    return bodies, tracks


def not_compared(setup: Setup) -> list[list[str]]:
    """Return the pairs of links and held objects that need not be kept apart, each with the first reason for it.

    Raises InputError for links that always touch: the checker has no proof of that.
    """
    scene, robot = setup.scene, setup.robot
    compared = {link_pair(*pair) for pair in (*robot.self_pairs, *robot.never_touching)}
    found = []
    for pair in (link_pair(*pair) for pair in itertools.combinations(robot.links, 2)):
        if not scene.self_collision.checked:
            found.append([*pair, "self_collision: false"])
        elif pair not in compared:
            found.append([*pair, _reason(setup, pair)])
    return sorted(found)


def _reason(setup: Setup, pair: tuple[str, str]) -> str:
    """Return the first reason why a pair of links or held objects is not checked."""
    robot, (a, b) = setup.robot, pair
    reason = robot.unchecked[pair]
    if reason == ALWAYS_TOUCHING:
        raise InputError(
            f"{setup.scene.source}: links {a} and {b} always touch, which the checker of proofs does not show: name "
            "them in robot.ignore_pairs"
        )
    if robot.link_joint[a] == robot.link_joint[b]:
        return MOVE_AS_ONE
    if {a, b} & {each.name for each in robot.attached}:  # of which no file speaks
        return reason
    if pair in {link_pair(*each) for each in setup.scene.robot.ignore_pairs}:
        return "robot.ignore_pairs"
    return "the SRDF" if pair in robot.semantics.disabled else reason


# --- motion and limits ------------------------------------------------------------------------------------------------


def _motion(robot: Robot, trajectory: Trajectory) -> Plain:
    """Return the rows of the motion, of the joints that follow none. Raises InputError as `curve_of`."""
    rule = curve_of(robot, trajectory).rule
    own = trajectory.of_joints(robot.joint_names, robot.locked)
    rates = {"velocities": own.velocities, "accelerations": own.accelerations}
    return {
        "rule": rule,
        "times": None if own.times is None else numbers(own.times),
        "positions": numbers(own.positions),
        **{key: numbers(rows) for key, rows in rates.items() if rows is not None},
    }


def _limits(setup: Setup) -> Plain:
    """Return the limits of all joints, from which nothing is taken for what they may be off: that is the checker's."""
    scene, robot = setup.scene, setup.robot
    if scene.robot.tracking is not None:
        scene = derived(scene, robot=replace(scene.robot, tracking=None))
        robot = load_scene_robot(scene)
    rates = {key: bounds(most) for key, most in limits_of_all(scene, robot).items()}
    return {"position": _ranges(scene, robot), **rates}


def _sizes(setup: Setup) -> Plain:
    """Return the sizes by which obstacles, joints and the robot's base may be off their nominal values, if any."""
    if not any(unknown_in(setup.scene)):
        return {}
    scene, base = setup.scene, setup.scene.robot.calibration
    around = {
        each.name: {
            "shift": each.uncertainty.position,
            "turn": each.uncertainty.orientation,
            "speed": each.uncertainty.speed,
        }
        for each in scene.obstacles
        if each.uncertainty is not None
    }
    stands = None
    if base is not None:
        stands = {"shift": base.position, "turn": base.orientation, "about": numbers(scene.robot.base.position)}
    lags = {key: numbers(tracking(scene, setup.robot, name)) for key, name in LAGS.items()}
    return {"sizes": {"around": around, "base": stands, **lags}}


def _ranges(scene: Scene, robot: Robot) -> list[Any]:
    """Return the position limits of all joints: where others follow one, those that it has itself."""
    model = robot.model
    every = [range_of(model, str(name)) for name in itertools.islice(model.names, 1, None)]
    for i, joint in enumerate(robot.joint_names):
        if not robot.followed[i] or joint in scene.limits.position:
            every[robot.coordinates[i]] = float(robot.lower[i]), float(robot.upper[i])
    return [bounds(each) for each in every]
