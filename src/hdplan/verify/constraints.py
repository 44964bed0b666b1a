"""Goals and path constraints of a motion plan request of MoveIt's, as a world has them.

Where MoveIt's tolerances have another shape than a world's, the stricter one stands for them (docs/command_line.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import scene as scenes
from .balls import HERE, Pose, compose, need
from .messages import Frames, fields, filled, number, pose, solids, vector
from .text import listing

FREE = 3.14  # [rad] from here on a tolerance leaves an axis free
CONE = 1.5  # [rad] an angle below pi/2
SLANT = 1e-2  # [rad] by which an axis that is to be upright may be off
SERIES = 2e-15  # [rad] by which the series of the arc tangent is off up to there
LARGEST = 1.0  # [m] tolerance of a goal's position
USUAL = 0.01  # [rad] tolerance of a goal's orientation


def goal_of(value: Any, frames: Frames) -> Any:
    """The single goal: values of joints, or poses of links."""
    need(len(listing(value, "goal_constraints")) == 1, "request.goal_constraints: one goal is expected")
    section = _given(value[0], "goal_constraints")
    if "joint_constraints" in section:
        need(len(section) == 1, "goal_constraints: by joints and by a pose")
        found = dict[str, float]()
        for i, entry in enumerate(listing(section["joint_constraints"], "joint_constraints")):
            what = f"joint_constraints[{i}]"
            own = fields(entry, "JointConstraint", what)
            name = scenes.word(own.get("joint_name"), what)
            need(name not in found, f"{what}: '{name}' has a goal already")
            found[name] = number(own.get("position"), what)
            for key in ("tolerance_above", "tolerance_below"):
                number(own.get(key, 0.0), f"{what}.{key}", low=0.0)
        frames.check_base(found, "goal_constraints")
        return {"joints": found}
    places, turns = (_by_link(section.get(f"{x}_constraints")) for x in ("position", "orientation"))
    need(places and {*turns} <= {*places}, "goal_constraints: no joints, and no position of each link")
    poses = []
    for link, entry in places.items():
        _, point, shape, (_, at) = _region(entry, frames)
        need(not any(point), "goal_constraints: a target_point_offset")
        need(shape["type"] in ("box", "sphere"), "goal_constraints: a region must be a box or a sphere")
        most = min(shape["size"]) / 2 if shape["type"] == "box" else shape["radius"]
        turn, angle, free = _turn(turns[link], frames) if link in turns else (HERE[0], USUAL, "all")
        within = {"position_tolerance": min(most, LARGEST), "orientation_tolerance": angle}
        poses.append({"link": link, **scenes.frame((turn, at)), **within, "free": free})
    return tuple(poses)


def _given(value: Any, what: str) -> dict[str, Any]:
    """The constraints that are there, by kind."""
    return {x: y for x, y in fields(value, "Constraints", what).items() if x != "name" and filled(y)}


def _by_link(value: Any) -> dict[str, Any]:
    entries = listing(value, "constraints")
    need(all(isinstance(x, dict) for x in entries), "constraints: mappings are expected")
    found = {scenes.word(x.get("link_name"), "constraints"): x for x in entries}
    need(len(found) == len(entries), "constraints: two of one link")
    return found


def _region(value: Any, frames: Frames) -> tuple[str, list[float], dict[str, Any], Pose]:
    """A link, a point in its frame, and the region for it: a shape and where it is."""
    what = "position_constraints"
    section = fields(value, "PositionConstraint", what)
    region = fields(section.get("constraint_region"), "BoundingVolume", what)
    shapes = solids(region, what)
    need(len(shapes) == 1, f"{what}: one region is expected")
    ((shape, place),) = shapes
    point = vector(section.get("target_point_offset", [0.0] * 3), what)
    pose = compose(frames.of(section.get("header"), what), place)
    return scenes.word(section.get("link_name"), what), point, shape, pose


def _turn(value: Any, frames: Frames) -> tuple[Any, float, str]:
    """Orientation of a link, by how much it may be off, and about which of its axes it is free."""
    what = "orientation_constraints"
    section = fields(value, "OrientationConstraint", what)
    most = {x: number(section.get(f"absolute_{x}_axis_tolerance"), what) for x in "xyz"}
    need(min(most.values()) > 0, f"{what}: a tolerance is not above 0")
    free = "".join(x for x in "xyz" if most[x] >= FREE)
    vectors = section.get("parameterization", 0)
    need(type(vectors) is int and vectors in (0, 1), f"{what}.parameterization: 0 or 1 is expected")
    need(free in ("", "xyz") or (free in ("x", "z") and not vectors), f"{what}: free about {free}")
    need("orientation" in section, f"{what}: has no orientation")
    turn, _ = compose(frames.of(section.get("header"), what), pose({"orientation": section["orientation"]}, what))
    if free == "xyz":
        return HERE[0], USUAL, "all"
    return turn, min(CONE, *(x for x in most.values() if x < FREE)), free or "none"


def _slant(way: Any) -> float:
    """The angle [rad] of a unit vector to the vertical, if it is small: arctan t is between the sums of three and of
    four terms of its series, and t is off by at most twice what the vector's numbers are."""
    t = float(np.sqrt(way[0] * way[0] + way[1] * way[1]) / max(abs(way[2]), 0.5))
    return t - t**3 / 3 + t**5 / 5


def path_of(value: Any, frames: Frames) -> tuple[dict[str, Any], ...]:
    """Path constraints, as a world has them."""
    section, found = _given({} if value is None else value, "path_constraints"), list[dict[str, Any]]()
    need("joint_constraints" not in section, "path_constraints: of joints")
    need(all(len(listing(x, "path_constraints")) == 1 for x in section.values()), "path_constraints: two of a kind")
    if "orientation_constraints" in section:
        (entry,) = section["orientation_constraints"]
        turn, angle, free = _turn(entry, frames)
        need(free in ("x", "z"), "path_constraints: an orientation that leaves neither x nor z free")
        way = turn.mid[:, "xyz".index(free)]
        slant = _slant(way)
        upright = f"path_constraints: keeps an axis along {way.tolist()}, and only up or down is checked"
        need(slant <= min(SLANT, angle), upright)
        link, off = scenes.word(entry.get("link_name"), "path_constraints"), 2 * float(turn.rad.max()) + SERIES
        axis = [float(np.sign(way[2])) * (x == free) for x in "xyz"]
        found.append({"kind": "upright", "link": link, "axis": axis, "off": off, "tolerance": angle - slant})
    if "position_constraints" in section:
        link, point, shape, place = _region(section["position_constraints"][0], frames)
        need(shape["type"] == "box", "path_constraints: a region must be a box")
        box = {"kind": "position", "link": link, "point": point, "size": shape["size"]}
        found.append({**box, **scenes.frame(place)})
    return tuple(found)
