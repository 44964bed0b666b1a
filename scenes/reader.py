"""A scene file becomes a `Scene`: hdplan's own YAML, or a MoveIt planning scene with its motion plan request."""

from __future__ import annotations

import dataclasses
import difflib
import os
from os import PathLike
from pathlib import Path

from hdplan.scenes.effects import (
    check_effects,
    read_clearance,
    read_limits,
    read_mass,
    read_motion,
    read_path,
    read_payload,
    read_self_collision,
    read_timing,
)
from hdplan.scenes.errors import InputError
from hdplan.scenes.fields import Field, read_document
from hdplan.scenes.model import (
    Attached,
    Limits,
    Obstacle,
    PathConstraints,
    PlannerSettings,
    Pose,
    RobotSpec,
    Scene,
    SelfCollision,
    TimedPoses,
)
from hdplan.scenes.moveit import is_moveit_request, is_moveit_scene, read_moveit
from hdplan.scenes.poses import read_pose
from hdplan.scenes.settings import read_settings
from hdplan.scenes.shapes import read_shape
from hdplan.scenes.targets import read_goal, read_target

VERSION = 1
SECTIONS = (
    "hdplan",
    "robot",
    "obstacles",
    "attached",
    "start",
    "goal",
    "from_request",
    "self_collision",
    "limits",
    "payload",
    "path",
    "timing",
    "planner",
)
ROBOT_KEYS = ("name", "urdf", "srdf", "package_dirs", "group", "base", "locked", "ignore_pairs")

FilePath = str | PathLike[str]


def load_scene(path: FilePath, request: FilePath | None = None, robot: FilePath | None = None) -> Scene:
    """Read one planning problem.

    Args:
        path: a hdplan scene, the bare name of a shipped one (``panda_corridor``), or a MoveIt planning scene.
        request: the MoveIt motion plan request that goes with a MoveIt planning scene.
        robot: the name of a robot, or a YAML file with a `robot` section; replaces the scene's robot whole.
            A MoveIt scene needs it.

    Raises:
        InputError: anything wrong with these files, in one line: file, field, what was found, what is allowed.
            Names of joints, links and states are checked when the robot is loaded.
    """
    top = read_document(find_scene(path))
    keys = top.mapping()
    spec, notes = (None, ()) if robot is None else read_robot(robot)
    if "hdplan" not in keys and is_moveit_scene(keys):
        if request is None:
            raise top.error(
                "is a MoveIt planning scene, which has no goal: give its motion plan request too (--request FILE)"
            )
        if spec is None:
            raise top.error(
                "is a MoveIt planning scene, which does not say where its robot is found: give --robot NAME or FILE"
            )
        return _with_notes(read_moveit(top, Path(request), spec), notes)
    if "hdplan" not in keys and is_moveit_request(keys):
        raise top.error(
            "is a MoveIt motion plan request; name the planning scene first and give this file with --request"
        )
    if request is not None:
        raise top.error("is no MoveIt planning scene, so no request goes with it (--request)")
    return _with_notes(_read_hdplan(top, spec), notes)


def shipped_scenes() -> dict[str, Path]:
    """Return the scenes that come with hdplan, by their bare names."""
    return {file.stem: file for file in sorted(Path(__file__).parent.glob("*.yaml"))}


def find_scene(path: FilePath) -> Path:
    """Return the file that `path` names: itself if it exists, else the shipped scene of that bare name.

    Raises:
        InputError: there is neither; the nearest shipped scene is offered.
    """
    file = Path(path)
    if os.path.exists(file):  # unlike Path.exists, no error for names that are too long
        return file
    shipped = shipped_scenes()
    if str(file) in shipped:
        return shipped[str(file)]
    close = difflib.get_close_matches(file.stem, shipped, n=1)
    hint = f"did you mean the shipped scene '{close[0]}'?" if close else f"shipped scenes: {', '.join(shipped)}"
    raise InputError(f"{file}: no such file ({hint})")


def read_robot(robot: FilePath) -> tuple[RobotSpec, tuple[str, ...]]:
    """Read a robot given beside the scene: a name of example-robot-data, or a YAML file with a `robot` section.

    Returns:
        The robot, and words for the user about what was changed.

    Raises:
        InputError: bad file or section. Whether a robot of that name exists is known when it is loaded.
    """
    file = Path(robot)
    is_name = len(file.parts) == 1 and not file.suffix
    if is_name and not os.path.isfile(file):
        return RobotSpec(name=str(robot), source="--robot"), ()
    top = read_document(file)
    spec = _robot(top.mapping(SECTIONS, required=["robot"])["robot"])
    spec = dataclasses.replace(spec, source=str(file))
    return spec, tuple(top.document.notes)


def _with_notes(scene: Scene, notes: tuple[str, ...]) -> Scene:
    return dataclasses.replace(scene, notes=(*notes, *scene.notes))


def _read_hdplan(top: Field, robot: RobotSpec | None) -> Scene:
    keys = top.mapping(SECTIONS)
    if "hdplan" not in keys:
        raise top.error(f"is no scene: the line 'hdplan: {VERSION}' is missing")
    version = keys["hdplan"]
    if not isinstance(version.value, int) or isinstance(version.value, bool) or version.value != VERSION:
        raise version.wrong(f"{VERSION}, the version of the scene format that this hdplan reads")
    top.mapping(SECTIONS, required=["start", "goal"])
    written = _robot(keys["robot"]) if "robot" in keys else None  # read even when replaced: a mistake in it is one
    spec = robot or written
    if spec is None:
        raise top.error("the key 'robot' is missing; write the section, or name a robot with --robot")
    obstacles = _obstacles(keys["obstacles"]) if "obstacles" in keys else ()
    scene = Scene(
        name=top.document.file.stem,
        source=top.document.file,
        robot=spec,
        obstacles=obstacles,
        attached=_attached(keys["attached"], obstacles) if "attached" in keys else (),
        start=read_target(keys["start"]),
        goal=read_goal(keys["goal"]),
        from_request=keys["from_request"].boolean() if "from_request" in keys else False,
        planner=read_settings(keys["planner"]) if "planner" in keys else PlannerSettings(),
        self_collision=read_self_collision(keys["self_collision"]) if "self_collision" in keys else SelfCollision(),
        limits=read_limits(keys["limits"]) if "limits" in keys else Limits(),
        payload=read_payload(keys["payload"]) if "payload" in keys else None,
        path=read_path(keys["path"]) if "path" in keys else PathConstraints(),
        timing=read_timing(keys["timing"]) if "timing" in keys else None,
        notes=tuple(top.document.notes),
    )
    check_effects(top, scene)
    return scene


def _robot(section: Field) -> RobotSpec:
    keys = section.mapping(ROBOT_KEYS)
    if ("name" in keys) == ("urdf" in keys):
        raise section.error(f"must have either 'name' or 'urdf', found {'both' if 'name' in keys else 'neither'}")
    for key in ("srdf", "package_dirs"):
        if "name" in keys and key in keys:
            raise keys[key].error("goes with 'urdf'; a robot given by name brings its own")
    directories = keys["package_dirs"].items(of="directories") if "package_dirs" in keys else []
    locked = keys["locked"].mapping() if "locked" in keys else {}
    pairs = keys["ignore_pairs"].items(of="link pairs") if "ignore_pairs" in keys else []
    return RobotSpec(
        name=keys["name"].text() if "name" in keys else None,
        urdf=keys["urdf"].path() if "urdf" in keys else None,
        srdf=keys["srdf"].path() if "srdf" in keys else None,
        package_dirs=tuple(directory.path(directory=True) for directory in directories),
        group=keys["group"].text() if "group" in keys else None,
        base=read_pose(keys["base"]) if "base" in keys else Pose(),
        locked={name: value.number(unit="rad or m") for name, value in locked.items()},
        ignore_pairs=tuple(_pair(pair) for pair in pairs),
    )


def _pair(entry: Field) -> tuple[str, str]:
    first, second = (item.text() for item in entry.items(2, "link names"))
    if first == second:
        raise entry.error(f"must name two different links, found {first!r} twice")
    return first, second


def _obstacles(section: Field) -> tuple[Obstacle, ...]:
    obstacles: dict[str, Obstacle] = {}
    for i, entry in enumerate(section.items(of="obstacles")):
        keys = entry.mapping(("name", "shape", "pose", "clearance", "motion"), required=["shape"])
        name = keys["name"].text() if "name" in keys else f"obstacle{i}"
        if name in obstacles:
            raise entry.error(f"the name {name!r} is taken by an earlier obstacle; names must differ")
        pose = read_pose(keys["pose"]) if "pose" in keys else Pose()
        motion = read_motion(keys["motion"]) if "motion" in keys else None
        if isinstance(motion, TimedPoses):
            if "pose" in keys:
                raise keys["pose"].error("stands beside motion.poses, which say where the obstacle is: leave it out")
            pose = motion.poses[0]
        clearance = read_clearance(keys["clearance"]) if "clearance" in keys else None
        obstacles[name] = Obstacle(name, read_shape(keys["shape"]), pose, clearance, motion)
    return tuple(obstacles.values())


def _attached(section: Field, obstacles: tuple[Obstacle, ...]) -> tuple[Attached, ...]:
    standing = {obstacle.name for obstacle in obstacles}
    attached: dict[str, Attached] = {}
    for i, entry in enumerate(section.items(of="held objects")):
        keys = entry.mapping(("name", "link", "shape", "pose", "touch_links", "mass"), required=["link", "shape"])
        name = keys["name"].text() if "name" in keys else f"attached{i}"
        if name in attached or name in standing:
            other = "obstacle" if name in standing else "earlier held object"
            raise entry.error(f"the name {name!r} is taken by an {other}; names must differ")
        pose = read_pose(keys["pose"]) if "pose" in keys else Pose()
        touching = keys["touch_links"].items(of="link names") if "touch_links" in keys else []
        links = tuple(link.text() for link in touching)
        mass = read_mass(keys["mass"]) if "mass" in keys else 0.0
        attached[name] = Attached(name, keys["link"].text(), read_shape(keys["shape"]), pose, links, mass)
    return tuple(attached.values())
