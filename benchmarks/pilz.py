"""Sequences from the tests of MoveIt's Pilz planner as jobs, against that planner's definition of their curves.

The definition is simulated here in steps of time, with nothing of hdplan: trapezoids of speed along lines and arcs
(KDL's, whose length counts turns by max_trans_vel/max_rot_vel), and Pilz' transition window between two of them. PTP
commands have no curve that is prescribed: where one is blended with a line or an arc, what lies within the radius is
left out of the comparison, and the certificate says that it does. Commands of the gripper set an output.
"""

from __future__ import annotations

import itertools
import time
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from blended_jobs import at_rest
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.robot.link_frame import link_poses

SPEED, ACCELERATION, TURNING = 1.0, 2.25, 1.57  # of the tool: cartesian_limits.yaml of both robots
FAR, ANGLE = 1e-5, 1e-3  # required and proven
STEP = 1e-4  # [s] of the simulation
PLACES = 1000
EQUAL = SPEED / TURNING  # [m] that a turn of 1 rad counts


@dataclass
class Command:
    """One command of a sequence."""

    name: str
    kind: str  # ptp, lin, circ or gripper
    element: Any  # its element
    radius: float


@dataclass
class Robot:
    """A robot of the files, its poses and its commands."""

    spec: hdplan.RobotSpec
    link: str
    acceleration: float  # [rad/s²]
    tree: Any

    def joints(self, pose: str) -> list[float]:
        """Return the joints of a pose of the file."""
        text = self.tree.find(f"./poses/pos[@name='{pose}']/joints").text
        return [float(word) for word in text.replace(",", " ").split()]

    def pose(self, name: str) -> tuple[np.ndarray, Rotation]:
        """Return a pose of the file."""
        found = self.tree.find(f"./poses/pos[@name='{name}']/xyzQuat")
        numbers = [float(word) for word in found.text.split()]
        return np.array(numbers[:3]), Rotation.from_quat(numbers[3:7])

    def sequences(self) -> dict[str, list[Command]]:
        """Return all sequences; radii before a command of another group are none, as in Pilz' planner."""
        kinds = {"ptp": "ptps/ptp", "lin": "lins/lin", "circ": "circs/circ", "gripper": "grippers/gripper"}
        found = {}
        for blend in self.tree.findall("./sequences/blend"):
            commands = []
            for entry in blend:
                kind = entry.get("type").split("_")[0]
                element = self.tree.find(f"./{kinds[kind]}[@name='{entry.get('name')}']")
                commands.append(Command(entry.get("name"), kind, element, float(entry.get("blend_radius"))))
            for one, other in itertools.pairwise(commands):
                one.radius *= (one.kind == "gripper") == (other.kind == "gripper")
            found[blend.get("name")] = commands
        return found


def robots_of(folder: Path, prbt: Path | None) -> dict[str, Robot]:
    """Return the robots of which there are sequences; PRBT's description is `prbt_support` in a folder."""
    panda = Robot(hdplan.RobotSpec(name="panda"), "panda_link8", 3.75, _tree(folder, "frankaemika_panda"))
    found = {"panda": panda}
    if prbt is not None:
        touching = ("link_1", "base_link"), ("link_4", "link_5"), ("flange", "link_5")
        ignored = [[f"prbt_{a}", f"prbt_{b}"] for a, b in touching]
        urdf = str(prbt / "prbt_support" / "urdf" / "prbt.xacro")
        spec = hdplan.RobotSpec(urdf=urdf, package_dirs=[str(prbt)], ignore_pairs=ignored)
        found["prbt"] = Robot(spec, "prbt_tcp", 3.49, _tree(folder, "prbt"))
    return found


def _tree(folder: Path, name: str) -> Any:
    return ET.parse(folder / f"{name}_testdata_sequence.xml").getroot()


def pace_of(robot: Robot, element: Any, length: float, turn: float) -> tuple[float, float]:
    """Return the speed and acceleration of the tool along a curve."""
    share = length / max(length, EQUAL * turn)
    return SPEED * float(element.find("vel").text) * share, ACCELERATION * float(element.find("acc").text) * share


def arc_of(begin: np.ndarray, end: np.ndarray, element: Any, robot: Robot) -> tuple[np.ndarray, np.ndarray, float]:
    """Return centre, axis and angle of an arc."""
    if element.find("centerPos") is not None:
        center = robot.pose(element.find("centerPos").text)[0]
        normal = np.cross(begin - center, end - center)
        cosine = (begin - center) @ (end - center) / np.linalg.norm(begin - center) / np.linalg.norm(end - center)
        return center, normal / np.linalg.norm(normal), float(np.arccos(cosine))
    point = robot.pose(element.find("intermediatePos").text)[0]
    a, b = point - begin, end - begin
    normal = np.cross(a, b)
    center = begin + np.linalg.solve(np.array([a, b, normal]), [a @ a / 2, b @ b / 2, 0.0])
    axis = normal / np.linalg.norm(normal)
    one, other = begin - center, end - center
    return center, axis, float(np.arctan2(np.cross(one, other) @ axis, one @ other) % (2 * np.pi))


def simulated(robot: Robot, command: Command, begin: tuple[np.ndarray, Rotation]) -> tuple[np.ndarray, Rotation]:
    """Return places and rotations along a line or an arc at every step of time."""
    at, turned = begin
    end, there = robot.pose(command.element.find("endPos").text)
    between = (there * turned.inv()).as_rotvec()
    if command.kind == "lin":
        length = float(np.linalg.norm(end - at))
    else:
        center, axis, angle = arc_of(at, end, command.element, robot)
        length = angle * float(np.linalg.norm(at - center))
    speed, acceleration = pace_of(robot, command.element, length, float(np.linalg.norm(between)))
    ramp = min(speed / acceleration, np.sqrt(length / acceleration))
    whole = length / (ramp * acceleration) + ramp
    now = np.append(np.arange(0.0, whole, STEP), whole)
    pace = np.clip(np.minimum(now, whole - now), 0.0, ramp) * acceleration
    share = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(now))])
    share = (share / share[-1])[:, None]
    if command.kind == "lin":
        places = at + share * (end - at)
    else:
        places = center + Rotation.from_rotvec(share * angle * axis).apply(at - center)
    return places, Rotation.from_rotvec(share * between) * turned


def blended(one: Any, other: Any, radius: float) -> tuple[Any, Any, Any]:
    """Return the remainders of two curves, and between them Pilz' transition window."""
    (x1, r1), (x2, r2) = one, other
    enters = int(np.flatnonzero(np.linalg.norm(x1 - x1[-1], axis=1) >= radius)[-1]) + 1
    leaves = int(np.flatnonzero(np.linalg.norm(x2 - x2[0], axis=1) >= radius)[0])
    align = len(x1) - leaves - 1 if len(x1) - enters > leaves + 1 else enters
    count = leaves + align - enters + 1
    k = np.arange(count)
    first, second = np.minimum(enters + k, len(x1) - 1), np.clip(enters + k - align, 0, leaves)
    s = (k + 1) / count
    alpha = 6 * s**5 - 15 * s**4 + 10 * s**3
    places = x1[first] + alpha[:, None] * (x2[second] - x1[first])
    between = (r2[second] * r1[first].inv()).as_rotvec()
    turns = Rotation.from_rotvec(alpha[:, None] * between) * r1[first]
    return (x1[:enters], r1[:enters]), (places, turns), (x2[leaves:], r2[leaves:])


def job_of(robot: Robot, commands: list[Command]) -> hdplan.Scene:
    """Return a sequence as a job."""
    loaded = hdplan.load_robot(robot.spec)
    moving = [x for x in commands if x.kind != "gripper"]
    start = robot.joints(moving[0].element.find("startPos").text if moving else "ZeroPose")
    at = tool_of(robot, loaded, np.array([start]))[0]
    stages: list[Any] = []
    for number, command in enumerate(commands):
        name = f"{number} {command.name}"
        if command.kind == "gripper":
            stages.append(hdplan.Set({"gripper": command.element.find("endPos").text}, name=name))
            continue
        end, there = robot.pose(command.element.find("endPos").text)
        if command.kind == "ptp":
            goal = hdplan.PoseTarget(robot.link, hdplan.Pose(end, there.as_quat()), 1e-6, 1e-5)
            speed = float(command.element.find("vel").text)
            stages.append(hdplan.Move(goal, name=name, blend=command.radius, speed=speed))
        else:
            begin, turned = at[:3, 3], Rotation.from_matrix(at[:3, :3])
            turn = float((there * turned.inv()).magnitude())
            more: dict[str, Any] = {"to": end, "rpy": there.as_euler("xyz"), "link": robot.link}
            more |= {"name": name, "blend": command.radius, "position_tolerance": FAR, "orientation_tolerance": ANGLE}
            if command.kind == "lin":
                length = float(np.linalg.norm(end - begin))
            else:
                center, _, angle = arc_of(begin, end, command.element, robot)
                length = angle * float(np.linalg.norm(begin - center))
            speed, acceleration = pace_of(robot, command.element, length, turn)
            more |= {"tool_speed": speed, "tool_acceleration": acceleration}
            if command.kind == "lin":
                stages.append(hdplan.Line(**more))
            else:
                names = {
                    "center": command.element.find("centerPos"),
                    "interim": command.element.find("intermediatePos"),
                }
                more |= {key: robot.pose(x.text)[0] for key, x in names.items() if x is not None}
                stages.append(hdplan.Circle(**more))
        at = np.eye(4)
        at[:3, :3], at[:3, 3] = there.as_matrix(), end
    limits = hdplan.Limits(velocity="urdf", acceleration=robot.acceleration, jerk=500.0)
    return hdplan.Scene(robot=robot.spec, start=start, limits=limits, job=hdplan.Job(stages))


def tool_of(robot: Robot, loaded: hdplan.Robot, rows: np.ndarray) -> np.ndarray:
    """Return the tool's poses (k, 4, 4), by Pinocchio."""
    return link_poses(loaded, rows, loaded.model.getFrameId(robot.link))


def compared(robot: Robot, commands: list[Command], result: hdplan.JobResult) -> tuple[float, float, int]:
    """Return how far the tool is from Pilz' curves at random places at most, in position [m] and turn [rad], and at how
    many; what is blended with a PTP command is left out within its radius."""
    loaded, motion = hdplan.load_robot(robot.spec), result.trajectory
    columns = [motion.joint_names.index(joint) for joint in loaded.joint_names]
    rng, worst, turned, count = np.random.default_rng(0), 0.0, 0.0, 0
    assert motion.times is not None
    ends = [float(motion.times[mark.row]) for mark in motion.stages] + [float(motion.times[-1])]
    curves: dict[int, Any] = {}
    for k, command in enumerate(commands):
        if command.kind not in ("lin", "circ"):
            continue
        if (k and commands[k - 1].kind != "gripper") or k > 1:
            begin = robot.pose(command.element.find("startPos").text)
        else:
            at = tool_of(robot, loaded, np.array([robot.joints(command.element.find("startPos").text)]))[0]
            begin = at[:3, 3], Rotation.from_matrix(at[:3, :3])
        curves[k] = [simulated(robot, command, begin)]
    for k in sorted(curves):
        if k + 1 in curves and commands[k].radius:
            first, middle, second = blended(curves[k][-1], curves[k + 1][0], commands[k].radius)
            curves[k][-1:], curves[k + 1][:1] = [first, middle], [middle, second]
    total = sum(ends[k + 1] - ends[k] for k in curves)
    for k, parts in curves.items():
        here = np.sort(rng.uniform(ends[k], ends[k + 1], int(np.ceil(PLACES * (ends[k + 1] - ends[k]) / total))))
        tool = tool_of(robot, loaded, motion.at_time(here).positions[:, columns])
        left = np.zeros(len(here), dtype=bool)
        for other, corner in ((k - 1, parts[0][0][0]), (k + 1, parts[-1][0][-1])):
            if 0 <= other < len(commands) and commands[other].kind == "ptp":
                left |= np.linalg.norm(tool[:, :3, 3] - corner, axis=1) <= commands[min(other, k)].radius
        places = np.concatenate([part[0] for part in parts])
        turns = Rotation.concatenate([part[1] for part in parts])
        for pose in tool[~left]:
            near = int(np.linalg.norm(places - pose[:3, 3], axis=1).argmin())
            steps = [(i, i + 1) for i in (near - 1, near) if 0 <= i < len(places) - 1]
            off = []
            for i, j in steps:
                way = places[j] - places[i]
                share = np.clip((pose[:3, 3] - places[i]) @ way / max(way @ way, 1e-300), 0.0, 1.0)
                off.append(float(np.linalg.norm(pose[:3, 3] - places[i] - share * way)))
            worst = max(worst, min(off))
            turned = max(turned, float((turns[near].inv() * Rotation.from_matrix(pose[:3, :3])).magnitude()))
        count += int((~left).sum())
    return worst, turned, count


def pilz(folder: Path, prbt: Path | None, only: str, time_limit: float) -> None:
    """Plan all sequences, and print what was found as a table."""
    head = "robot | sequence | verdict | from Pilz' curves [mm; rad] | places | at rest at both ends"
    print(f"| {head} | takes; with stops [s] | processor [s] |\n|" + " --- |" * 8)
    for name, robot in robots_of(folder, prbt).items():
        for sequence, commands in robot.sequences().items():
            if not sequence.startswith(only):
                continue
            began, label = time.process_time(), f"| {name} | {sequence} |"
            try:
                scene = job_of(robot, commands)
                result = hdplan.plan_job(scene, time_limit=time_limit)
                rested = hdplan.plan_job(at_rest(scene), time_limit=time_limit)
            except hdplan.HdplanError as error:
                print(f"{label} refused: {str(error).removeprefix('scene: ')[:250]} | | | | | |", flush=True)
                continue
            seconds = time.process_time() - began
            if not result.certified:
                print(f"{label} {result.text[:250]} | | | | | |", flush=True)
                continue
            curves = any(command.kind in ("lin", "circ") for command in commands)
            far, turn, count = compared(robot, commands, result) if curves else (0.0, 0.0, 0)
            still = float(np.abs(result.trajectory.velocities[[0, -1]]).max())  # type: ignore[index]
            ends = "yes" if still == 0.0 else "NO"
            off = f"{far * 1e3:.4f}; {turn:.5f} | {count}" if count else " | "
            times = f"{result.trajectory.duration:.2f}; {rested.trajectory.duration:.2f} | {seconds:.1f}"
            print(f"{label} certified | {off} | {ends} | {times} |", flush=True)
