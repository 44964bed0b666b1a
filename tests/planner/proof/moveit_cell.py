"""A cell in MoveIt's words: a robot, a planning scene, a request and a motion, as files whose parts may be changed."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import hdplan
from hdplan import HdplanError, Trajectory
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.verify import RejectedError
from hdplan.verify.checking import Verdict, check
from hdplan.verify.compare import check_equal
from hdplan.verify.reading import Reading, read_world

from .worlds import packed, unpacked

Data = dict[str, Any]

BOX = '<geometry><box size="0.05 0.05 0.4"/></geometry>'
LIMIT = '<limit lower="-2" upper="2" velocity="1.5" effort="30"/>'
URDF = f"""<robot name="r"><link name="floor"/>
<link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="up"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="fore"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="hand"><collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.03"/></geometry></collision></link>
<link name="finger"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="foot" type="fixed"><origin xyz="0 0 0.05"/><parent link="floor"/><child link="base"/></joint>
<joint name="a" type="revolute"><parent link="base"/><child link="up"/><axis xyz="0 1 0"/>{LIMIT}</joint>
<joint name="b" type="revolute"><origin xyz="0 0 0.6"/><parent link="up"/><child link="fore"/><axis xyz="0 1 0"/>{LIMIT}
</joint><joint name="c" type="revolute"><origin xyz="0 0 0.6"/><parent link="fore"/><child link="hand"/>
<axis xyz="1 0 0"/>{LIMIT}</joint>
<joint name="f" type="prismatic"><origin xyz="0 0.1 0.1"/><parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.1" velocity="0.2" effort="30"/></joint></robot>"""
SRDF = """<robot name="r"><group name="arm"><joint name="a"/><joint name="b"/><joint name="c"/></group>
<group name="two"><joint name="a"/><joint name="b"/></group>
<disable_collisions link1="base" link2="fore" reason="Never"/>
<disable_collisions link1="base" link2="hand" reason="Never"/>
<disable_collisions link1="finger" link2="fore" reason="Never"/></robot>"""
ROBOT: Data = {"urdf": "r.urdf", "srdf": "r.srdf", "base": {"position": [0.1, 0, 0.2], "rpy": [0, 0, 0.5]}}
HALF = [0, 0, 0.6, 0.8]


def solid(kind: Any, sizes: list[float], *place: float, turn: Any = HALF) -> Data:
    pose = {"position": [*place], "orientation": turn}
    return {"primitives": [{"type": kind, "dimensions": sizes}], "primitive_poses": [pose]}


SCENE: Data = {
    "name": "a cell",
    "robot_model_name": "r",
    "robot_state": {
        "joint_state": {"name": ["a", "f"], "position": [0.3, 0.02], "velocity": [0.0, 0.0]},
        "multi_dof_joint_state": {
            "joint_names": ["virtual"], "transforms": [{"translation": [0, 0, 0], "rotation": [0, 0, 0, 1]}],
        },
        "attached_collision_objects": [
            {
                "link_name": "hand",
                "object": {"header": {"frame_id": "hand"}, "id": "cup", **solid("box", [0.03, 0.03, 0.1], 0, 0, 0.2)},
                "touch_links": ["fore"], "weight": 0.5,
            }
        ],
    },
    "fixed_frame_transforms": [
        {
            "header": {"frame_id": "base"}, "child_frame_id": "/room",
            "transform": {"translation": {"x": 1.2, "y": 0.1}, "rotation": {"z": 0.6, "w": 0.8}},
        }
    ],
    "allowed_collision_matrix": {
        "entry_names": ["base", "fore", "up"],
        "entry_values": [[False, False, True], [False, False, True], [True, True, False]],
        "default_entry_names": ["finger"], "default_entry_values": [True],
    },
    "link_padding": [{"link_name": x, "padding": 0.01} for x in ("base", "up", "fore", "hand", "finger")],
    "link_scale": [{"link_name": "base", "scale": 1.0}],
    "world": {
        "collision_objects": [
            {"id": "ball", **solid("sphere", [0.1], -1.5, 0.1, 0.4)},
            {
                "header": {"frame_id": "room"}, "id": "desk",
                "pose": {"position": [0.4, 0.3, 0], "orientation": [0, 0.6, 0, -0.8]},
                "primitives": [{"type": 1, "dimensions": [0.4, 0.3, 0.2]}, {"type": 3, "dimensions": [0.3, 0.05]}],
                "primitive_poses": [{}, {"position": [0, 0.2, 0.3], "orientation": {"x": 0.6, "w": 0.8}}],
            },
            {"header": {"frame_id": "base"}, **solid("cylinder", [0.2, 0.1], 0, -1.4, 0.2), "operation": 0},
        ]
    },
}  # fmt: skip
REQUEST: Data = {
    "group_name": "r_arm",
    "start_state": {"joint_state": {"name": ["b", "c", "a"], "position": [0.2, 0.1, 0.1]}, "is_diff": True},
    "goal_constraints": [
        {"joint_constraints": [{"joint_name": x, "position": y} for x, y in (("a", 0.4), ("b", 0.5), ("c", 0))]}
    ],
    "max_velocity_scaling_factor": 0.5,
    "max_acceleration_scaling_factor": 0,
    "planner_id": "RRTConnect",
    "workspace_parameters": {"min_corner": {"x": -1}, "max_corner": {"x": 1}},
}  # fmt: skip
MOTION: Data = {
    "hdplan_trajectory": 1, "joint_names": ["a", "b", "c"], "times": [0, 4],
    "positions": [[0.1, 0.2, 0.1], [0.4, 0.5, 0]], "velocities": [[0, 0, 0], [0, 0, 0]],
}  # fmt: skip
GOOD: dict[str, Data] = {"scene": SCENE, "request": REQUEST, "robot": {"robot": ROBOT}}
OBJECTS, MATRIX, HELD = (
    "world.collision_objects", "allowed_collision_matrix", "robot_state.attached_collision_objects.0",
)  # fmt: skip


class Cell(NamedTuple):
    """The files of a planning scene, a motion, a request and a robot's section."""

    scene: Path
    motion: Path
    request: Path
    robot: str

    def read(self) -> Reading:
        """The world that the checker reads."""
        return read_world(self.scene, self.motion, None, self.request, self.robot)

    def planned(self) -> Data:
        """The world in which hdplan plans."""
        setup = Setup.of(hdplan.load_scene(self.scene, self.request, self.robot))
        return world_of(setup, Trajectory.load(self.motion))

    def prove(self) -> hdplan.Proof:
        return hdplan.prove(*self)

    def check(self, proof: bytes) -> tuple[Verdict, Data]:
        return check(self.scene, self.motion, proof, self.request, self.robot)

    def outcome(self, proof: bytes, hashes: dict[str, str] | None = None) -> str:
        """Why the checker rejects a proof, in which other hashes of files are put: "" where it accepts."""
        head, world, rest = unpacked(proof)
        try:
            self.check(packed({**head, "files": hashes or head["files"]}, world, rest))
        except RejectedError as error:
            return str(error)
        return ""

    def agrees(self) -> Data:
        """The world that the checker reads, which is hdplan's."""
        world = self.read().world
        check_equal(world, self.planned())
        return world

    def refused(self, words: str, hdplans: str = "") -> None:
        """Neither of the two reads the files, each for this reason."""
        with pytest.raises(RejectedError, match=words):
            self.read()
        with pytest.raises(HdplanError, match=hdplans or words):
            self.planned()


def written(folder: Path, motion: Data = MOTION, **changed: Any) -> Cell:
    """Write the cell, the messages and the robot's section changed by name."""
    folder.mkdir(exist_ok=True)
    (folder / "r.urdf").write_text(URDF)
    (folder / "r.srdf").write_text(SRDF)
    for name, content in (GOOD | changed).items():
        (folder / f"{name}.yaml").write_text(content if isinstance(content, str) else json.dumps(content))
    (folder / "m.json").write_text(json.dumps(motion))
    return Cell(folder / "scene.yaml", folder / "m.json", folder / "request.yaml", str(folder / "robot.yaml"))


def put(content: Data, path: str, value: Any) -> Data:
    """A message with another value at a place such as `world.collision_objects.0.id`."""
    other = copy.deepcopy(content)
    *way, last = (int(x) if x.isdigit() else x for x in path.split("."))
    where: Any = other
    for step in way:
        where = where[step]
    where[last] = value
    return other


def position(link: str, region: Data, **more: Any) -> Data:
    return {"link_name": link, "constraint_region": region, **more}


def turned(link: str, *most: float, turn: Any = HALF, **more: Any) -> Data:
    tolerances = {f"absolute_{x}_axis_tolerance": y for x, y in zip("xyz", most, strict=True)}
    return {"link_name": link, "orientation": turn, **tolerances, **more}


BALL, CRATE = solid("sphere", [0.02], 0.3, 0.1, 1.2), solid("box", [0.1, 0.2, 0.3], 0.3, 0.1, 1.2)
DESK = {"header": {"frame_id": "room"}}
