"""A forger's pen: an arm's files, and proofs that hold any world, with the planes that do best in it."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.verify.kernel import VERSION, Motion, half
from hdplan.verify.world import World

from .worlds import packed, scene_files

Data = dict[str, Any]

BOX = '<geometry><box size="0.05 0.05 0.4"/></geometry>'
URDF = f"""<robot name="r">
<link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="up"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="fore"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="hand"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><origin xyz="0 0 0.15"/><geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="up"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1" effort="30"/></joint>
<joint name="b" type="revolute"><origin xyz="0 0 0.6"/><parent link="up"/><child link="fore"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1" effort="30"/></joint>
<joint name="g" type="revolute"><origin xyz="0 0 0.5"/><parent link="fore"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="30"/></joint></robot>"""
SRDF = """<robot name="r"><group name="arm"><joint name="a"/><joint name="b"/></group>
<group_state name="home" group="arm"><joint name="a" value="0"/><joint name="b" value="0"/></group_state>
<group_state name="reach" group="arm"><joint name="a" value="0.5"/><joint name="b" value="1"/></group_state></robot>"""
ROBOT = {"urdf": "r.urdf", "srdf": "r.srdf", "group": "arm"}
BALL: Data = {"name": "o", "shape": {"type": "sphere", "radius": 0.1}, "pose": {"position": [1.5, 0, 0.3]}}
TOOL: Data = {"name": "tool", "link": "hand", "shape": {"type": "box", "size": [0.01] * 3}}
SCENE: Data = {"robot": ROBOT, "obstacles": [BALL], "start": {"joints": [0, 0]}, "goal": {"joints": [0.1, 0.5]}}
MOTION: Data = {"joint_names": ["a", "b"], "positions": [[0, 0], [0.1, 0.5]]}
TIMED = {**MOTION, "times": [0, 10], "velocities": [[0, 0], [0, 0]]}
LIMITS = ["limits", "start", "goal"]
EVERY = ["clearance", *LIMITS, "velocity", "acceleration", "torque", "path", "duration"]
WAYS = np.rint(1e6 * np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(300, 3))]))


def at(*place: float) -> list[Data]:
    """The obstacle at another place."""
    return [{**BALL, "pose": {"position": [*place]}}]


def files(folder: Path, scene: Data, motion: Data | None = None, urdf: str = URDF) -> tuple[Path, Path]:
    """Write a scene, with some sections changed, its robot and a motion."""
    return scene_files(folder, {**SCENE, **scene}, {**MOTION, **(motion or {})}, {"r.urdf": urdf, "r.srdf": SRDF})


def spans(low: float, high: float, depth: int) -> list[tuple[float, float]]:
    """The leaves of an even tree."""
    if not depth:
        return [(low, high)]
    middle = half(low, high)
    return spans(low, middle, depth - 1) + spans(middle, high, depth - 1)


def forge(content: Data, hashes: dict[str, str], claims: list[str], clearance: float = 1e-6, depth: int = 3) -> bytes:
    """A proof that holds this world, with those of many planes that do best in it, leaf by leaf, whether or not they
    do."""
    world = World(content, {})
    parts = spans(0.0, float(len(world.control.mid)), depth)
    motion, count = Motion(world, np.array(parts)), len(WAYS)
    best = []
    for pair in world.pairs:
        for node in range(len(parts)):
            found = motion.gaps(np.full(count, node), np.tile(pair, (count, 1)), WAYS)
            best.append(WAYS[np.nan_to_num(found, nan=-np.inf).argmax()])
    head = {
        "version": VERSION, "files": hashes, "cuts": {}, "pairs": len(world.pairs), "leaves": len(best), "rays": 0,
        "clearance": None if world.within.all() else clearance, "claims": claims,
        "self_clearance": clearance if world.within.any() else None,
    }  # fmt: skip
    counts, depths = np.full(len(world.pairs), len(parts), "<u4"), np.full(len(best), depth, "<u1")
    normals = np.array(best).reshape(-1, 3).astype("<i4")
    return packed(head, content, b"".join(x.tobytes() for x in (counts, depths, normals)))


def put(world: Data, *path: Any, to: Any) -> Data:
    """The world with another value at a place."""
    other = copy.deepcopy(world)
    where: Any = other
    for key in path[:-1]:
        where = where[key]
    where[path[-1]] = to
    return other
