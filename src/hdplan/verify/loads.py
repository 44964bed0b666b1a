"""The loads of the joints: masses of links, payloads and held objects."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import scene as scenes
from .balls import HERE, Ball, Pose, compose, dot, need, up
from .joints import Joints
from .text import listing, mapping, values
from .world import symmetric

MOMENT_SHARE, LEAST_MOMENT = 2e-2, 2e-9  # of the largest moment, and [kg m^2], that written digits leave open


def loads(top: dict[str, Any], joints: Joints) -> list[Any]:
    """Load of each moving joint up to the next: mass, mass times centre, inertia about the joint's origin."""
    found = [[Ball(0.0), Ball(np.zeros(3)), Ball(np.zeros((3, 3)))] for _ in joints.moving]

    def carry(link: str, mass: float, at: Pose, about: Any) -> None:
        joint, pose = joints.at[link]
        if joint < 0:
            return
        turn, centre = compose(pose, at)
        moment, square = centre * mass, dot("i,i->", centre, centre)
        inert = dot("ij,kj->ik", dot("ij,jk->ik", turn, about), turn)
        inert = inert + (np.eye(3) * square - centre[:, None] * centre) * mass
        own = found[joint]
        found[joint] = [x + y for x, y in zip(own, (Ball(mass), moment, inert), strict=True)]

    for link, mass, at, about in joints.tree.masses():
        if joints.at[link][0] >= 0:
            check_body(mass, about, f"link '{link}'")
        carry(link, mass, at, Ball(about))
    if (load := top.get("payload")) is not None:
        section = mapping(load, "payload", "link mass com inertia")
        mass, com = scenes.one(section.get("mass"), "payload"), values(section.get("com", [0.0] * 3), 3, "payload.com")
        need(mass >= 0, "payload: a mass below 0")
        six = values(section.get("inertia", [0.0] * 6), 6, "payload.inertia")
        about = symmetric(six)
        check_body(mass, about, "payload")
        need(section.get("link") in joints.at, "payload: its link is not known")
        carry(section["link"], mass, (HERE[0], Ball(com)), Ball(about))
    for i, entry in enumerate(listing(top.get("attached"), "attached")):
        if (weight := entry.get("mass")) is not None:
            mass, shape = scenes.one(weight, f"attached[{i}].mass"), entry["shape"]
            need(mass >= 0, f"attached[{i}]: a mass below 0")
            at = scenes.pose_of(entry.get("pose"), f"attached[{i}]")
            carry(entry["link"], mass, at, solid_inertia(shape, mass, f"attached[{i}]"))
    moved = [float(mass.mid) for mass, _, _ in found]
    for i, name in reversed([*enumerate(joints.moving)]):
        need(moved[i] > 0, f"limits.torque: joint '{name}' moves no mass, as its URDF gives none")
        if (parent := joints.frames[name][0]) >= 0:
            moved[parent] += moved[i]
    return [
        {
            "mass": float(mass.mid),
            "moment": first.mid.tolist(),
            "inertia": inert.mid[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].tolist(),
            "off": float(max(np.max(x.rad) for x in (mass, first, inert))),
        }
        for mass, first, inert in found
    ]


def check_body(mass: float, about: Any, what: str) -> None:
    """Reject an inertia that no body has: of its principal moments none is negative, or above the sum of the others,
    and without mass all are 0."""
    least, middle, most = np.linalg.eigvalsh(about)
    slack = MOMENT_SHARE * max(abs(least), abs(most)) + LEAST_MOMENT
    good = min(least, least + middle - most) >= -slack and (mass > 0 or most <= LEAST_MOMENT)
    need(good, f"limits.torque: no body has the inertia of {what}")


def solid_inertia(shape: dict[str, Any], mass: float, what: str) -> Ball:
    """The inertia about its centre of a solid of even density: m / 12 (b^2 + c^2) of a box' edges, m / 5 (b^2 + c^2) of
    an ellipsoid's semi-axes; of a cylinder m r^2 / 2 about its axis and m (3 r^2 + l^2) / 12."""
    kind, r = shape.get("type"), shape.get("radius", 0.0)
    three = np.array(shape.get("size", shape.get("radii", [r, r, r])), dtype=np.float64)
    squares = three * three
    need(kind in ("box", "sphere", "ellipsoid", "cylinder"), f"{what}: the inertia of a {kind} cannot be checked")
    if kind == "cylinder":
        diagonal = mass / 12 * np.array([3 * r * r + shape["length"] ** 2] * 2 + [6 * r * r])
    else:
        diagonal = mass / (12 if kind == "box" else 5) * (squares.sum() - squares)
    return Ball(np.diag(diagonal), np.diag(up(2.0**-48 * (diagonal + mass * squares.sum()))))
