"""A scene file becomes a `Scene`: hdplan's own YAML, or a MoveIt planning scene with its motion plan request."""

from __future__ import annotations

import dataclasses
import difflib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.errors import InputError, listed
from hdplan.scenes.fields import Field, read_document
from hdplan.scenes.files import leads_nowhere
from hdplan.scenes.moveit.geometry_text import ENDING, read_geometry
from hdplan.scenes.moveit.planning_scene import is_moveit_request, is_moveit_scene, read_moveit
from hdplan.scenes.obstacles import Obstacle, TimedPoses
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.pose_fields import read_pose
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_files.urdf_text import ENDINGS
from hdplan.scenes.robot_spec import PlanarBase, RobotSpec
from hdplan.scenes.scene import Scene, as_read, derived
from hdplan.scenes.sizes import Calibration, Tracking
from hdplan.scenes.values import FilePath, checked, path_of
from hdplan.scenes.yaml_format.effects import (
    read_limits,
    read_motion,
    read_path,
    read_self_collision,
    read_timing,
    read_uncertainty,
    sizes_of,
)
from hdplan.scenes.yaml_format.job import read_job
from hdplan.scenes.yaml_format.seen import read_cloud, read_depth, read_octomap, read_voxels
from hdplan.scenes.yaml_format.shape_fields import read_shape
from hdplan.scenes.yaml_format.targets import read_goal, read_target

VERSION = 1
SHOWN_SCENES = 12  # shipped scenes that an error names
SOLIDS: Mapping[str, Callable[[Field], object]] = MappingProxyType(
    {"shape": read_shape, "cloud": read_cloud, "depth": read_depth, "octomap": read_octomap, "voxels": read_voxels}
)
"""Kinds of an obstacle, by their keys."""
ROBOT_KEYS = (
    *("name", "urdf", "srdf", "package_dirs", "xacro_args", "group", "base", "base_joints", "locked"),
    *("ignore_pairs", "check_pairs", "tracking", "calibration"),
)


def load_scene(path: FilePath, request: FilePath | None = None, robot: FilePath | RobotSpec | None = None) -> Scene:
    """Read one planning problem.

    Args:
        path: a hdplan scene, the bare name of a shipped one (``panda_corridor``), or a MoveIt planning scene: the
            message as YAML, or the text that RViz exports (``.scene``).
        request: the MoveIt motion plan request for a MoveIt planning scene.
        robot: the name of a robot, its description, a YAML file with a `robot` section, or a RobotSpec; it replaces
            the whole robot section of the scene. A MoveIt scene needs it.

    Raises:
        InputError: any error in these files, in one line: file, field, what was found, what is allowed. Names of
            joints, links and states are checked when the robot is loaded.
    """
    for name, given in (("path", path), ("request", request), ("robot", robot)):
        if name == "path" or not (given is None or (name == "robot" and isinstance(given, RobotSpec))):
            checked(path_of, given, name)
    file = find_scene(path)
    if file.suffix.lower() in ENDINGS:
        raise InputError(
            f"{file}: is a robot's description, not a scene: name it in a scene (robot: {{urdf: {file.name}}}, with "
            "start and goal), or give it beside a scene as its robot (--robot)"
        )
    top = read_geometry(file) if file.suffix.lower() == ENDING else read_document(file)
    keys = top.mapping()
    spec, notes = (robot, ()) if robot is None or isinstance(robot, RobotSpec) else read_robot(robot)
    if "hdplan" not in keys and is_moveit_scene(keys):
        if request is None or spec is None:
            gaps = [("has no goal", "its motion plan request (--request FILE)")] if request is None else []
            gaps += [("does not say where its robot is found", "--robot NAME or FILE")] if spec is None else []
            lacking, wanted = (" and ".join(words) for words in zip(*gaps, strict=True))
            raise top.error(f"is a MoveIt planning scene, which {lacking}: give {wanted} too")
        return _with_notes(read_moveit(top, Path(request), spec), notes)
    if "hdplan" not in keys and is_moveit_request(keys):
        wanted_too = "" if spec else ", and the robot with --robot NAME or FILE"
        raise top.error(
            "is a MoveIt motion plan request; name the planning scene first and give this file with --request"
            f"{wanted_too}"
        )
    if request is not None:
        raise top.error("is not a MoveIt planning scene, so it takes no request (--request)")
    return _with_notes(_read_hdplan(top, spec), notes)


def read_obstacles(path: FilePath) -> tuple[Obstacle, ...]:
    """Read the section `obstacles` of a file that may hold nothing else of a scene. Raises InputError as
    `load_scene`."""
    keys = read_document(checked(path_of, path, "path")).mapping(("obstacles",), required=["obstacles"])
    return _obstacles(keys["obstacles"])


def shipped_scenes() -> dict[str, Path]:
    """Return the scenes of single motions shipped with hdplan, by their bare names."""
    return {file.stem: file for file in sorted((Path(__file__).parents[1] / "shipped").glob("*.yaml"))}


def shipped_jobs() -> dict[str, Path]:
    """Return the scenes shipped with hdplan that hold a job, by their bare names."""
    return {file.stem: file for file in sorted((Path(__file__).parents[1] / "shipped" / "jobs").glob("*.yaml"))}


def find_scene(path: FilePath) -> Path:
    """Return the file that `path` names: itself if it exists, else the shipped scene of that bare name.

    Raises:
        InputError: neither exists, not even as a link that leads nowhere; the nearest shipped scene is suggested.
    """
    file = Path(path)
    if os.path.exists(file) or leads_nowhere(file):  # unlike Path.exists, no error for names that are too long
        return file
    shipped = shipped_scenes() | shipped_jobs()
    if str(file) in shipped:
        return shipped[str(file)]
    close = difflib.get_close_matches(file.stem, shipped, n=1)
    hint = (
        f"did you mean the shipped scene '{close[0]}'?" if close else f"shipped scenes: {listed(shipped, SHOWN_SCENES)}"
    )
    raise InputError(f"{file}: no such file ({hint})")


def read_robot(robot: FilePath) -> tuple[RobotSpec, tuple[str, ...]]:
    """Read a robot given beside the scene: a name in example-robot-data, a YAML file with a `robot` section, or the
    robot's description itself.

    Returns:
        The robot, and notes for the user on what was changed.

    Raises:
        InputError: bad file or section. Whether a robot of that name exists is checked when it is loaded.
    """
    file = Path(robot)
    is_name = len(file.parts) == 1 and not file.suffix
    if is_name and not os.path.isfile(file):
        return RobotSpec(name=str(robot), source="--robot"), ()
    if file.suffix.lower() in ENDINGS:
        if not os.path.isfile(file):
            raise InputError(f"{file}: no such file")
        return RobotSpec(urdf=file, source=str(file)), ()
    top = read_document(file)
    spec = _robot(top.mapping(SECTIONS, required=["robot"])["robot"])
    spec = dataclasses.replace(spec, source=str(file))
    return spec, tuple(top.document.notes)


def _with_notes(scene: Scene, notes: tuple[str, ...]) -> Scene:
    return as_read(derived(scene, notes=(*notes, *scene.notes)), scene.source)


def read_scene(top: Field, name: str) -> Scene:
    """Read a hdplan scene from its document. Raises InputError as `load_scene`."""
    return derived(_read_hdplan(top, None), name=name)


def _robot(section: Field) -> RobotSpec:
    keys = section.mapping(ROBOT_KEYS)
    base = read_pose(keys["base"]) if "base" in keys else Pose()
    values: dict[str, object] = {**keys, "base": base}
    if "base_joints" in keys:
        values["base_joints"] = keys["base_joints"].read(PlanarBase)
    if "tracking" in keys:
        values["tracking"] = sizes_of(Tracking, keys["tracking"])
    if "calibration" in keys:
        values["calibration"] = sizes_of(Calibration, keys["calibration"])
    spec = section.make(RobotSpec, **values)
    directories = keys["package_dirs"].items(of="directories") if "package_dirs" in keys else []
    folders = tuple(directory.path(directory=True) for directory in directories)
    urdf, srdf = (keys[name].path() if name in keys else None for name in ("urdf", "srdf"))
    return dataclasses.replace(spec, urdf=urdf, srdf=srdf, package_dirs=folders)


def _obstacles(section: Field) -> tuple[Obstacle, ...]:
    obstacles = []
    readers = (("pose", read_pose), ("motion", read_motion), ("uncertainty", read_uncertainty))
    for i, entry in enumerate(section.items(of="obstacles")):
        keys = entry.mapping(("name", *SOLIDS, "pose", "clearance", "motion", "uncertainty"))
        given = [word for word in SOLIDS if word in keys]
        if len(given) != 1:
            missing = f"the key 'shape' is missing (required: {' or '.join(SOLIDS)})"
            raise entry.error(f"has more than one of {', '.join(given)}" if given else missing)
        shape = SOLIDS[given[0]](keys.pop(given[0]))
        values: dict[str, object] = {"name": f"obstacle{i}", **keys, "shape": shape}
        values |= {key: read(keys[key]) for key, read in readers if key in keys}
        if "pose" in keys and isinstance(values.get("motion"), TimedPoses):
            raise keys["pose"].error("is given twice: motion.poses give the obstacle's poses, so leave it out")
        obstacles.append(entry.make(Obstacle, **values))
    return tuple(obstacles)


def _attached(section: Field) -> tuple[Attached, ...]:
    attached = []
    for i, entry in enumerate(section.items(of="held objects")):
        keys = entry.mapping(("name", "link", "shape", "pose", "touch_links", "mass"), required=["link", "shape"])
        values: dict[str, object] = {"name": f"attached{i}", **keys, "shape": read_shape(keys["shape"])}
        if "pose" in keys:
            values["pose"] = read_pose(keys["pose"])
        attached.append(entry.make(Attached, **values))
    return tuple(attached)


READERS: Mapping[str, Callable[[Field], object]] = MappingProxyType(
    {
        "obstacles": _obstacles,
        "attached": _attached,
        "start": read_target,
        "goal": read_goal,
        "from_request": Field.boolean,
        "self_collision": read_self_collision,
        "limits": read_limits,
        "payload": lambda section: section.read(Payload),
        "path": read_path,
        "timing": read_timing,
        "planner": lambda section: section.read(PlannerSettings),
        "job": read_job,
    }
)
"""Sections that are fields of a scene."""
SECTIONS = ("hdplan", "robot", *READERS)


def _read_hdplan(top: Field, robot: RobotSpec | None) -> Scene:
    keys = top.mapping(SECTIONS)
    if "hdplan" not in keys:
        raise top.error(f"is not a hdplan scene: the line 'hdplan: {VERSION}' is missing")
    version = keys["hdplan"]
    if not isinstance(version.value, int) or isinstance(version.value, bool) or version.value != VERSION:
        raise version.wrong(f"{VERSION}, the version of the scene format that this hdplan reads")
    top.mapping(SECTIONS, required=["start"] if "job" in keys else ["start", "goal"])
    if "job" in keys and "goal" in keys:
        raise keys["goal"].error("the stages of the job define the goals: leave it out")
    written = _robot(keys["robot"]) if "robot" in keys else None  # read even if replaced: an error in it is an error
    spec = robot or written
    if spec is None:
        raise top.error("the key 'robot' is missing; write the section, or name a robot with --robot")
    scene = top.make(
        Scene,
        name=top.document.file.stem,
        source=top.document.file,
        robot=spec,
        **{name: read(keys[name]) for name, read in READERS.items() if name in keys},
        notes=tuple(top.document.notes),
    )
    top.make(scene.check_effects)
    return scene
