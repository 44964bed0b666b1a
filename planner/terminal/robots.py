"""Tables about robots: those known by name, and the parts of one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hdplan.distance.compiled.cache import content_key, load, store
from hdplan.planner.collision.link_bodies import fit_report
from hdplan.planner.kinematics.closed_form import closed_form
from hdplan.planner.robot.link_frame import end_effector
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import stamps_of
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_files.library import RobotFiles, robot_names
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.targets import PoseTarget
from hdplan.scenes.yaml_format.reader import read_robot

Rows = list[dict[str, Any]]

COUNTS = {**dict.fromkeys(("joints", "held", "links", "pairs"), int), "named_states": str}  # of a robot in the list
VERSION = "1"  # to be changed with anything that changes what the list says, so that old cache entries are not used


def listing() -> dict[str, Rows]:
    """Return tables of the robots that are known by name: joints planned and held fixed, links with collision geometry,
    pairs of links to check, named states; and of those that do not load, with the reason."""
    robots: Rows = []
    unusable: Rows = []
    for name, files in robot_names().items():
        try:
            robots.append({"name": name, **_counts(name, files)})
        except InputError as error:
            unusable.append({"name": name, "reason": str(error)})
    return {"robots": robots, "not_usable": unusable}


def _counts(name: str, files: RobotFiles) -> dict[str, Any]:
    """Return the numbers for one robot: kept on disk while the content of every file that it is read from is the
    same."""
    key = content_key(VERSION, name, str(files.urdf), str(files.srdf))
    known = load("robots", key, _kept)
    if known is not None:
        return known
    robot = load_robot(RobotSpec(name=name))
    counts: dict[str, Any] = {
        "joints": robot.n,
        "held": len(robot.locked),
        "links": len(robot.links),
        "pairs": len(robot.self_pairs),
        "named_states": ", ".join(robot.named_states),
    }
    read = [file for file, *_ in robot.files]
    if stamps_of(read) == robot.files:
        store("robots", key, {"files": read, "content": _content(read), "counts": counts})
    return counts


def _kept(value: Any) -> dict[str, Any] | None:
    counts = dict(value["counts"])
    same = {name: type(count) for name, count in counts.items()} == COUNTS
    return counts if same and _content(value["files"]) == value["content"] else None


def _content(files: list[str]) -> str | None:
    try:
        return content_key(*(Path(file).read_bytes() for file in files))
    except OSError:
        return None


def named_or_read(robot: str | RobotSpec) -> RobotSpec:
    """Return the robot of a name, or of a file: a description, or YAML with a `robot` section."""
    if isinstance(robot, RobotSpec):
        return robot
    return RobotSpec(name=robot) if robot in robot_names() else read_robot(robot)[0]


def describe(name: str | RobotSpec) -> dict[str, Rows]:
    """Return tables for one robot, by its name or its file: joints, joints held fixed, groups, end effectors, named
    states, and outer bodies: their volume over that of the link's hull, and how far they stick out of it [mm].

    Raises InputError for an unknown name, or a file that cannot be read.
    """
    robot = load_robot(named_or_read(name))
    unit = ["rad" if turns else "m" for turns in robot.turning]
    joints: Rows = [
        {"joint": joint, "unit": unit[i], "lower": _limit(robot.lower[i]), "upper": _limit(robot.upper[i])}
        for i, joint in enumerate(robot.joint_names)
    ]
    held: Rows = [{"joint": joint, "at": round(value, 6)} for joint, value in robot.locked.items()]
    moving = {*robot.joint_names, *robot.followers, *robot.locked}
    groups: Rows = [
        {"group": group, "joints": ", ".join(joint for joint in members if joint in moving)}
        for group, members in robot.semantics.groups.items()
    ]
    hands: Rows = [
        {"end_effector": hand.name, "link": hand.link, "group": hand.group, "of": hand.parent_group}
        for hand in robot.semantics.end_effectors
    ]
    states: Rows = [
        {
            "state": state,
            "group": group,
            "values": ", ".join(f"{joint} = {value:.4g}" for joint, value in values.items()),
        }
        for state, of_groups in robot.semantics.states.items()
        for group, values in of_groups.items()
    ]
    bodies: Rows = [
        {
            "link": row.link,
            "bodies": row.bodies,
            "vertices": row.vertices,
            "volume": round(row.volume_ratio, 2),
            "mean_mm": round(1e3 * row.mean_outside, 1),
            "p95_mm": round(1e3 * row.p95_outside, 1),
            "hold_the_mesh": "yes" if row.contained else "NO",
        }
        for row in fit_report(robot)
    ]
    notes = [*robot.notes, *inverse_kinematics_notes(robot)]
    if bodies:
        notes.append(
            "outer bodies: their volume over that of the link's hull; how far their surface lies outside it, on "
            "average and at the 95th percentile"
        )
    else:
        notes.append("no link has collision geometry: every motion of this robot is collision-free")
    return {
        "joints": joints,
        "joints_held": held,
        "groups": groups,
        "end_effectors": hands,
        "named_states": states,
        "outer_bodies": bodies,
        "notes": [{"note": note} for note in notes],
    }


def inverse_kinematics_notes(robot: Robot) -> list[str]:
    """Return the method, in words, of the end effector's inverse kinematics, if there is one."""
    try:
        target = PoseTarget(end_effector(robot, "link"), Pose())
    except InputError:
        return []
    form = closed_form(robot, target)
    return [f"inverse kinematics of {target.link}: {form.words(robot) if form else 'by search from many starts'}"]


def _limit(value: float) -> float | str:
    return round(float(value), 5) if np.isfinite(value) else "none"
