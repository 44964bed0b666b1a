"""A ball on three sliders, whose motions are those of a point in R³, and crates with a window around its goal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import hdplan
from hdplan import Scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.infeasibility import looks
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array

from ..urdf import joint_text, link_text, write_robot

RADIUS = 0.05  # [m] of the ball
SPAN = 0.5  # [m] that each slider goes to either side
SIDE = 0.3  # [m] of a crate, inside


def sliders(folder: Path, **tool: Any) -> Path:
    """Write the URDF of a tool on three sliders, a ball unless it has another shape."""
    links = ("root", "first", "second", "tool")
    joints = (
        joint_text("xyz"[i], links[i], links[i + 1], axis, kind="prismatic", limits=(-SPAN, SPAN))
        for i, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))
    )
    return write_robot(
        folder / "sliders.urdf", *map(link_text, links[:3]), link_text("tool", **tool or {"sphere": RADIUS}), *joints
    )


def turned(rng: np.random.Generator) -> Array:
    """A random quaternion (4,)."""
    quaternion = rng.normal(size=4)
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def crate(
    rng: np.random.Generator, center: Array, quaternion: Array, wall: float, window: float
) -> tuple[hdplan.Obstacle, ...]:
    """Six walls, so thick, one of which has a square window somewhere, of this width."""
    half, full = 0.5 * SIDE, SIDE + 2.0 * wall
    out = half + 0.5 * wall
    boxes: dict[str, tuple[list[float], list[float]]] = {
        "left": ([0, -out, 0], [full, wall, full]),
        "right": ([0, out, 0], [full, wall, full]),
        "floor": ([0, 0, -out], [full, SIDE, wall]),
        "roof": ([0, 0, out], [full, SIDE, wall]),
        "back": ([-out, 0, 0], [wall, SIDE, SIDE]),
    }
    if window == 0.0:
        boxes["front"] = [out, 0, 0], [wall, SIDE, SIDE]
    else:
        rest = 0.5 * (SIDE - window)
        y, z = rng.uniform(-0.6, 0.6, 2) * rest
        boxes["front1"] = [out, -half + 0.5 * (rest + y), 0], [wall, rest + y, SIDE]
        boxes["front2"] = [out, half - 0.5 * (rest - y), 0], [wall, rest - y, SIDE]
        boxes["front3"] = [out, y, -half + 0.5 * (rest + z)], [wall, window, rest + z]
        boxes["front4"] = [out, y, half - 0.5 * (rest - z)], [wall, window, rest - z]
    rotation = hdplan.Pose([0, 0, 0], quaternion.tolist()).matrix[:3, :3]
    return tuple(
        hdplan.Obstacle(name, hdplan.Box(size), hdplan.Pose((center + rotation @ at).tolist(), quaternion.tolist()))
        for name, (at, size) in boxes.items()
    )


def crated(urdf: Path, seed: int, window: float, **changes: Any) -> Scene:
    """A scene whose goal is in a crate, and whose start is outside."""
    rng = np.random.default_rng(seed)
    center, quaternion = rng.uniform(-0.1, 0.1, 3), turned(rng)
    rotation = hdplan.Pose([0, 0, 0], quaternion.tolist()).matrix[:3, :3]
    walls = crate(rng, center, quaternion, float(rng.choice([0.001, 0.02])), window)
    start, goal = center + rotation @ [0.35 * (-1) ** seed, 0, 0], center + rotation @ rng.uniform(-0.05, 0.05, 3)
    fields: dict[str, Any] = {"start": start.tolist(), "goal": goal.tolist(), "obstacles": walls, **changes}
    return Scene(name="crate", robot=hdplan.RobotSpec(urdf=str(urdf)), **fields)


def proven(scene: Scene, required: float = 0.0) -> str:
    """Claims that are proven of a scene without any search."""
    found = next(filter(None, looks(Certifier(Setup.of(scene)), required, {})), ())
    return "; ".join(each.words for each in found)
