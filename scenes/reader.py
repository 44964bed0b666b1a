"""A scene file becomes a `Scene`: hdplan's own YAML, or a MoveIt planning scene with its motion plan request."""

from __future__ import annotations

import dataclasses
import difflib
import math
import os
from os import PathLike
from pathlib import Path

import numpy as np

from hdplan.scenes.errors import InputError
from hdplan.scenes.fields import Field, read_document
from hdplan.scenes.model import (
    Attached,
    Box,
    Capsule,
    Cylinder,
    Goals,
    JointTarget,
    Mesh,
    Obstacle,
    PlannerSettings,
    Points,
    Pose,
    PoseTarget,
    RobotSpec,
    Scene,
    Shape,
    Sphere,
    Vector3,
)
from hdplan.scenes.moveit import is_moveit_request, is_moveit_scene, read_moveit
from hdplan.scenes.poses import pose_of, read_pose, read_vector
from hdplan.scenes.settings import read_settings

VERSION = 1
SECTIONS = ("hdplan", "robot", "obstacles", "attached", "start", "goal", "planner")
ROBOT_KEYS = ("name", "urdf", "srdf", "package_dirs", "base", "locked", "ignore_pairs")
SHAPE_KEYS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "points": ("points",),
    "mesh": ("file", "scale"),
}
"""Keys of each shape beside its type; all are required but a mesh's scale."""
GOAL_KEYS = ("joints", "state", "pose", "poses")
POSE_KEYS = (
    "link",
    "position",
    "quaternion_xyzw",
    "rpy",
    "position_tolerance",
    "orientation_tolerance",
    "free_rotation",
)
FREE_ROTATIONS = ("none", "x", "y", "z", "all")
FLAT = 1e-9  # thickness over size below which points lie in one plane

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
    return Scene(
        name=top.document.file.stem,
        source=top.document.file,
        robot=spec,
        obstacles=obstacles,
        attached=_attached(keys["attached"], obstacles) if "attached" in keys else (),
        start=_target(keys["start"]),
        goal=_goal(keys["goal"]),
        planner=read_settings(keys["planner"]) if "planner" in keys else PlannerSettings(),
        notes=tuple(top.document.notes),
    )


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
        base=read_pose(keys["base"]) if "base" in keys else Pose(),
        locked={name: value.number(unit="rad or m") for name, value in locked.items()},
        ignore_pairs=tuple(_pair(pair) for pair in pairs),
    )


def _pair(entry: Field) -> tuple[str, str]:
    first, second = (item.text() for item in entry.items(2, "link names"))
    if first == second:
        raise entry.error(f"must name two different links, found {first!r} twice")
    return first, second


def _target(section: Field) -> JointTarget:
    keys = section.mapping(("joints", "state"))
    if len(keys) != 1:
        raise section.error(f"must have either 'joints' or 'state', found {'both' if keys else 'neither'}")
    if "state" in keys:
        return JointTarget(section.key, state=keys["state"].text())
    return _joints(keys["joints"], section.key)


def _joints(joints: Field, name: str) -> JointTarget:
    match joints.value:
        case [_, *_]:
            return JointTarget(name, positions=joints.numbers(unit="rad or m"))
        case {**named} if named:
            values = {name: value.number(unit="rad or m") for name, value in joints.mapping().items()}
            return JointTarget(name, by_name=values)
        case _:
            raise joints.wrong("a list of joint values, or a mapping from joint names to values [rad or m]")


def _goal(section: Field) -> JointTarget | Goals:
    """Read one configuration, or what leaves a choice: several of them, a link's pose, or several poses."""
    keys = section.mapping(GOAL_KEYS)
    if len(keys) != 1:
        found = " and ".join(f"'{key}'" for key in keys) or "none of them"
        raise section.error(f"must have exactly one of the keys {', '.join(GOAL_KEYS)}, found {found}")
    if "pose" in keys:
        return Goals((_pose_target(keys["pose"]),))
    if "poses" in keys:
        return Goals(tuple(_pose_target(pose) for pose in _at_least_one(keys["poses"], "poses")))
    if "joints" in keys and isinstance(keys["joints"].value, list) and _holds_containers(keys["joints"].value):
        entries = keys["joints"].items(of="configurations")
        return Goals(tuple(_joints(joints, joints.key) for joints in entries))
    return _target(section)


def _holds_containers(values: list[object]) -> bool:
    return any(isinstance(value, list | dict) for value in values)


def _at_least_one(section: Field, of: str) -> list[Field]:
    entries = section.items(of=of)
    if not entries:
        raise section.wrong(f"a list of one or more {of}")
    return entries


def _pose_target(section: Field) -> PoseTarget:
    keys = section.mapping(POSE_KEYS, required=["link", "position"])
    free = keys["free_rotation"].choice(FREE_ROTATIONS) if "free_rotation" in keys else PoseTarget.free_rotation
    turn = next((keys[key] for key in ("quaternion_xyzw", "rpy", "orientation_tolerance") if key in keys), None)
    if free == "all" and turn is not None:
        raise turn.error("has no meaning with free_rotation: all, which lets the link turn as it likes; leave it out")
    if free != "all" and "quaternion_xyzw" not in keys and "rpy" not in keys:
        raise section.error("has no orientation: give 'quaternion_xyzw' or 'rpy', or free_rotation: all")
    tolerances = {
        key: keys[key].number(above=0.0, high=high, unit=unit)
        for key, high, unit in (("position_tolerance", 1.0, "m"), ("orientation_tolerance", math.pi, "rad"))
        if key in keys
    }
    return PoseTarget(section.key, keys["link"].text(), pose_of(section, keys), free_rotation=free, **tolerances)


def _obstacles(section: Field) -> tuple[Obstacle, ...]:
    obstacles: dict[str, Obstacle] = {}
    for i, entry in enumerate(section.items(of="obstacles")):
        keys = entry.mapping(("name", "shape", "pose"), required=["shape"])
        name = keys["name"].text() if "name" in keys else f"obstacle{i}"
        if name in obstacles:
            raise entry.error(f"the name {name!r} is taken by an earlier obstacle; names must differ")
        pose = read_pose(keys["pose"]) if "pose" in keys else Pose()
        obstacles[name] = Obstacle(name, _shape(keys["shape"]), pose)
    return tuple(obstacles.values())


def _attached(section: Field, obstacles: tuple[Obstacle, ...]) -> tuple[Attached, ...]:
    standing = {obstacle.name for obstacle in obstacles}
    attached: dict[str, Attached] = {}
    for i, entry in enumerate(section.items(of="held objects")):
        keys = entry.mapping(("name", "link", "shape", "pose", "touch_links"), required=["link", "shape"])
        name = keys["name"].text() if "name" in keys else f"attached{i}"
        if name in attached or name in standing:
            other = "obstacle" if name in standing else "earlier held object"
            raise entry.error(f"the name {name!r} is taken by an {other}; names must differ")
        pose = read_pose(keys["pose"]) if "pose" in keys else Pose()
        touching = keys["touch_links"].items(of="link names") if "touch_links" in keys else []
        attached[name] = Attached(
            name, keys["link"].text(), _shape(keys["shape"]), pose, tuple(link.text() for link in touching)
        )
    return tuple(attached.values())


def _shape(section: Field) -> Shape:
    every_key = {"type", *(key for keys in SHAPE_KEYS.values() for key in keys)}
    kind = section.mapping(every_key, required=["type"])["type"].choice(SHAPE_KEYS)
    required = [key for key in SHAPE_KEYS[kind] if key != "scale"]
    keys = section.mapping(("type", *SHAPE_KEYS[kind]), required)
    match kind:
        case "box":
            return Box(read_vector(keys["size"], above=0.0, unit="m"))
        case "sphere":
            return Sphere(keys["radius"].number(above=0.0, unit="m"))
        case "cylinder":
            return Cylinder(keys["radius"].number(above=0.0, unit="m"), keys["length"].number(above=0.0, unit="m"))
        case "capsule":
            return Capsule(keys["radius"].number(above=0.0, unit="m"), keys["length"].number(low=0.0, unit="m"))
        case "points":
            return Points(_points(keys["points"]))
        case _:
            return Mesh(keys["file"].path(), _scale(keys["scale"]) if "scale" in keys else (1.0, 1.0, 1.0))


def _points(entry: Field) -> tuple[Vector3, ...]:
    points = tuple(read_vector(item, unit="m") for item in entry.items(of="points"))
    spread = np.ptp(points, axis=0).max() if points else 0.0
    if not points or np.linalg.matrix_rank(np.subtract(points, points[0]), tol=FLAT * spread) < 3:
        raise entry.error(
            f"must be points that span a volume (four or more, not in one plane), found {len(points)} that do not"
        )
    return points


def _scale(entry: Field) -> Vector3:
    if isinstance(entry.value, list):
        return read_vector(entry, above=0.0)
    factor = entry.number(above=0.0)
    return factor, factor, factor
