"""Constraints in MoveIt's words: goals and paths mean to the checker what they mean to hdplan."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan import NotProvenError
from hdplan.verify import RejectedError
from hdplan.verify.balls import HERE
from hdplan.verify.constraints import path_of
from hdplan.verify.effects import check_claim
from hdplan.verify.world import World

from .moveit_cell import BALL, CRATE, DESK, REQUEST, Data, position, solid, turned, written

CONSTRAINTS: dict[str, tuple[str, list[Data], list[Data]]] = {  # of which end or path, positions, orientations
    "a ball": ("goal", [position("hand", BALL)], []),
    "a crate on the desk": ("goal", [position("hand", CRATE, **DESK)], []),
    "a large ball": ("goal", [position("hand", solid("sphere", [3], 0, 0, 0))], []),
    "a turn": ("goal", [position("hand", BALL, **DESK)], [turned("hand", 0.1, 0.2, 0.3, **DESK, parameterization=1)]),
    "free about z": ("goal", [position("hand", BALL)], [turned("hand", 2, 2.5, 3.14)]),
    "free about all": ("goal", [position("hand", BALL)], [turned("hand", 4, 4, 4)]),
    "two links": ("goal", [position("hand", BALL), position("fore", CRATE)], [turned("fore", 0.1, 0.1, 0.1)]),
    "upright": ("path", [], [turned("hand", 0.3, 0.2, 6.3)]),
    "upside down": ("path", [], [turned("hand", 0.3, 0.2, 4, turn=[1, 0, 0, 0])]),
    "x upright": ("path", [], [turned("hand", 4, 0.2, 0.3, turn=[0.1, -0.7, 0.1, 0.7])]),
    "x upright, but for rounding": ("path", [], [turned("fore", 4, 0.2, 0.3, turn=[0, 0.5**0.5, 0, 0.5**0.5])]),
    "upright, a little off": ("path", [], [turned("hand", 0.3, 0.2, 4, turn=[0.001, 3e-3, 0, 1])]),
    "upside down, a little off": ("path", [], [turned("hand", 0.3, 0.2, 4, turn=[1, 3e-3, 0, 4e-3], **DESK)]),
    "a box along the way": ("path", [position("hand", CRATE, **DESK, target_point_offset={"z": 0.1})], []),
    "both": ("path", [position("hand", CRATE)], [turned("fore", 0.3, 0.2, 4)]),
}


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_constraints_are_read_as_hdplan_reads_them(name: str, tmp_path: Path) -> None:
    end, places, turns = CONSTRAINTS[name]
    content = {"name": name, "position_constraints": places, "orientation_constraints": turns, "joint_constraints": []}
    more = {"goal_constraints": [content]} if end == "goal" else {"path_constraints": content}
    world = written(tmp_path, request={**REQUEST, **more}).agrees()
    assert bool(world["path"]) == (end == "path")
    assert ("poses" in world["goal"][0]) == (end == "goal")


def test_an_axis_a_little_off_the_vertical_is_kept_within_moveits_tolerances() -> None:
    """A link's axis is as far from up or down as a world allows: MoveIt's angles, intrinsic about x, y and z, are
    within the tolerance, however it turns; and little is given away."""
    rng, frames = np.random.default_rng(0), SimpleNamespace(of=lambda *_: HERE)
    for _ in range(300):
        free, most = str(rng.choice(["x", "z"])), rng.uniform(0.02, 1.4, 3)
        lean, end = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
        way = np.array([*(np.sin(rng.uniform(0, 9.9e-3)) * np.array([np.cos(lean), np.sin(lean)])), 0.0])
        wanted = turning(np.eye(3)["xyz".index(free)], way + [0, 0, end * np.sqrt(1 - way @ way)], rng)
        most["xyz".index(free)] = 4
        content = turned("hand", *most.tolist(), turn=wanted.as_quat().tolist())
        (found,) = path_of({"orientation_constraints": [content]}, frames)
        assert found["tolerance"] > min(*most, 1.5) - 0.01
        tilt, about = found["tolerance"] + found["off"], rng.uniform(0, 2 * np.pi)
        there = [np.sin(tilt) * np.cos(about), np.sin(tilt) * np.sin(about), np.cos(tilt)]
        angles = (wanted.inv() * turning(np.array(found["axis"]), np.array(there), rng)).as_euler("XYZ")
        assert (np.abs(angles) <= most + 1e-9).all()


def test_a_motion_is_proven_to_keep_an_axis_a_little_off_the_vertical(tmp_path: Path) -> None:
    """Its tolerance is without the 2 mrad by which the axis is off: the link is tilted by 0.9 rad at the end."""
    for most, kept in ((0.9021, True), (0.9019, False)):
        path = {"orientation_constraints": [turned("fore", 1.4, most, 4, turn=[0, 0.001, 0, 1])]}
        cell = written(tmp_path, request={**REQUEST, "path_constraints": path})
        if kept:
            assert "path" in cell.prove().text.split("also proven: ")[1].split("\n")[0]
            continue
        with pytest.raises(NotProvenError, match=r"path\.upright"):
            cell.prove()
        with pytest.raises(RejectedError, match=r"path\.upright"):
            check_claim(World(cell.read().world, {}), "path")


def turning(axis: Any, way: Any, rng: np.random.Generator) -> Rotation:
    """A rotation, one of many, that turns one unit vector into another."""
    return Rotation.from_rotvec(rng.uniform(-3, 3) * way) * Rotation.align_vectors(way[None], axis[None])[0]
