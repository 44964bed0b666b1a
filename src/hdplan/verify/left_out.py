"""Balls of clouds and depth images that a scene leaves out, as they are near the robot where its motion starts, or near
another obstacle: its own image, which is modelled itself.

Which these are, the proof may say. Each must have its centre within the margin of a body that the scene names, or in
it: what a closed mesh encloses, and what the meshes of a link surround by more than half.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from . import scene as scenes
from .balls import HERE, Ball, Pose, RejectedError, compose, named, need, norm
from .reach import between
from .targets import Targets
from .text import listing, mapping
from .world import Piece

if TYPE_CHECKING:
    from .reading import Reader

SAME_BALL = 1e-9  # [m] between two balls that are one
BESIDE = 1e-6  # [m] by which a ball that is left out may be farther away than the margin
AT_ONCE = 256  # points that are compared with all corners of a mesh


class Placed(NamedTuple):
    """A body in the world."""

    shape: dict[str, Any]
    turn: Any  # (3, 3)
    at: Any  # (3,)


class Around(NamedTuple):
    """Bodies around which balls may be left out."""

    margin: float
    bodies: list[Placed]
    links: bool  # of the robot
    words: str


def staying(reader: Reader, name: str, section: dict[str, Any], centres: Ball, pose: Pose) -> Any:
    """Mask of an obstacle's balls that stay (m,): all but those that the proof has left out, which the scene must
    allow."""
    claimed = reader.claimed.seen(name)
    listed = "left_out" in claimed
    stay = without(len(centres.mid), claimed) if listed else kept(centres.mid, reader.claimed.points(name))
    if stay.all():
        return stay
    left = centres.mid[~stay] @ pose[0].mid.T + pose[1].mid
    for margin, bodies, links, words in _around(reader, section, name):
        count = len(left)
        for shape, turn, at in bodies:
            left = left[~_near((left - at) @ turn, shape, margin + BESIDE, links)]
        if count > len(left):
            reader.left_out[f"left out, of {len(stay)} balls of {named(name)}: {count - len(left)} {words}"] = None
    need(not len(left), f"'{name}': {len(left)} balls are left out that are not near what the scene names")
    return stay


def without(count: int, claimed: dict[str, Any]) -> Any:
    """Mask of so many balls without the rows that a proof claims."""
    stay, rows = np.ones(count, dtype=bool), claimed["left_out"]
    good = type(rows) is list and {*map(type, rows)} <= {int} and all(0 <= x < count for x in rows)
    need(good, "the proof leaves out a ball that is not seen there")
    stay[rows] = False
    return stay


def kept(centres: Any, claimed: Any) -> Any:
    """Mask of the balls' centres (m, 3): those that a proof claims (k, 3), in the same order."""
    found, waiting = np.zeros(len(centres), dtype=bool), iter(claimed.tolist())
    x, y, z = next(waiting, (np.inf,) * 3)
    for i, (a, b, c) in enumerate(centres.tolist()):
        if abs(a - x) <= SAME_BALL and abs(b - y) <= SAME_BALL and abs(c - z) <= SAME_BALL:
            found[i] = True
            x, y, z = next(waiting, (np.inf,) * 3)
    need(np.isinf(x), "the proof has a ball that is not seen there")
    return found


def _around(reader: Reader, section: dict[str, Any], name: str) -> list[Around]:
    """The bodies where the motion starts, with their margins."""
    robot, found = _robot_at_start(reader), list[Around]()
    if section.get("ignore_robot"):
        margin = scenes.one(section["ignore_robot"], f"{name}.ignore_robot")
        every = [x for each in robot.values() for x in each]
        found.append(Around(margin, every, True, f"within {1e3 * margin:g} mm of the robot at the start"))
    some = section.get("ignore") or []
    for each in some if isinstance(some, list) else [some]:
        keys = mapping(each, f"{name}.ignore", "link obstacle margin")
        need(("link" in keys) != ("obstacle" in keys), f"{name}.ignore: a link or an obstacle")
        margin = scenes.one(keys.get("margin"), f"{name}.ignore.margin")
        if "link" in keys:
            need(keys["link"] in robot, f"{name}.ignore.link: no link '{keys['link']}' with a shape")
            near = Around(margin, robot[keys["link"]], True, f"within {1e3 * margin:g} mm of {named(keys['link'])}")
        else:
            body = _standing(reader, keys["obstacle"], f"{name}.ignore.obstacle")
            near = Around(margin, [body], False, f"within {1e3 * margin:g} mm of {named(str(keys['obstacle']))}")
        found.append(near)
    need(all(0 <= x.margin <= 1 for x in found), f"{name}: a margin of 0 to 1 m is expected")
    return found


def _robot_at_start(reader: Reader) -> dict[str, list[Placed]]:
    """Links and held objects, by name."""
    joints, top, found = reader.joints, reader.top, dict[str, list[Placed]]()
    start = Targets(joints, bool(top.get("from_request"))).target(top["start"], "start")
    at, shapes = joints.standing(dict(zip(joints.lead, start["joints"], strict=True)))
    for link, i, place, kind, sizes in shapes:
        turn, origin = np.array(place["rotation"]).reshape(3, 3), np.array(place["position"])
        found.setdefault(link, []).append(Placed(reader.link_shape(link, i, kind, sizes), turn, origin))
    for body, entry in zip(reader.held_bodies()[0], listing(top.get("attached"), "attached"), strict=True):
        turned, there = compose(at[entry["link"]][1], scenes.pose_of(entry.get("pose"), body["name"]))
        found[body["name"]] = [Placed(body["shape"], turned.mid, there.mid)]
    return found


def _standing(reader: Reader, name: Any, what: str) -> Placed:
    """An obstacle with a shape of its own."""
    for i, entry in enumerate(listing(reader.top.get("obstacles"), "obstacles")):
        if entry.get("name", f"obstacle{i}") == name:
            need("shape" in entry and "motion" not in entry, f"{what}: '{name}' has no shape, or moves")
            shape = scenes.shape_of(entry["shape"], name, reader.folder, reader.files, reader.claimed)
            turn, at = scenes.pose_of(entry.get("pose"), name)
            return Placed(shape, turn.mid, at.mid)
    raise RejectedError(f"{what}: there is no obstacle '{name}'")


def _near(points: Any, shape: dict[str, Any], margin: float, links: bool) -> Any:
    """Mask of the points (m, 3) in the frame of a shape that are within a margin of it, or in it."""
    corners, sweep = np.asarray(shape["points"], dtype=np.float64), np.asarray(shape["sweep"], dtype=np.float64)
    reach = margin + sweep.max()
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    rows = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    found = np.zeros(len(points), dtype=bool)
    if shape["parts"] is None:
        piece = Piece("", "", 0, "", -1, HERE, corners, 0.0, sweep[0])
        away, exact = _beyond(points[rows], corners, sweep[0])
        found[rows] = away <= margin
        for i in rows[away > margin].tolist() if not exact else []:
            point = Piece("", "", 0, "", -1, HERE, points[[i]])
            found[i] = between(*((np.eye(3), np.zeros(3), x) for x in (piece, point))) <= margin
        return found
    mesh = corners[np.asarray(shape["parts"], dtype=np.int64)]
    for some in np.array_split(rows, len(rows) // AT_ONCE + 1):  # most are near a corner
        found[some] = (norm(points[some][:, None] - corners) <= margin).any(axis=1)
    encloses = len(rows) > 0 and (links or _closed(shape["parts"]))
    least, most = mesh.min(axis=1) - margin, mesh.max(axis=1) + margin
    for i in rows[~found[rows]].tolist():
        close = mesh[((points[i] >= least) & (points[i] <= most)).all(axis=1)]  # no other is within the margin
        found[i] = _distance(points[i], close) <= margin or (encloses and _surrounded(points[i], mesh))
    return found


def _beyond(points: Any, corners: Any, sweep: Any) -> tuple[Any, bool]:
    """Distances (k,) of points (k, 3), or a little more, from points of a swept hull, and True if none is nearer:
    those of a box along the axes, maybe without width, swept by a ball or disc. Of other hulls they are infinite."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not {*itertools.product(*zip(low.tolist(), high.tolist(), strict=True))} <= {*map(tuple, corners.tolist())}:
        return np.full(len(points), np.inf), False
    rest, wide = points - np.clip(points, low, high), sweep > 0
    scaled = rest[:, wide] / sweep[wide]
    share = 1.0 / np.maximum(np.sqrt((scaled * scaled).sum(axis=1)), 1.0)
    return norm(np.abs(rest - share[:, None] * rest * wide)), len({*sweep[wide].tolist()}) < 2


def _distance(point: Any, mesh: Any) -> float:
    """The distance of a point from triangles (F, 3, 3), or a little more: from points on their edges, and within."""
    a, ab, ac = mesh[:, 0], mesh[:, 1] - mesh[:, 0], mesh[:, 2] - mesh[:, 0]
    begins, ways = mesh, np.roll(mesh, -1, axis=1) - mesh
    share = ((point - begins) * ways).sum(axis=2) / np.maximum((ways * ways).sum(axis=2), 1e-300)
    least = norm(point - begins - np.clip(share, 0.0, 1.0)[..., None] * ways).min(initial=np.inf)
    normal, p = np.cross(ab, ac), point - a
    area = np.maximum((normal * normal).sum(axis=1), 1e-300)
    v, w = (np.cross(p, ac) * normal).sum(axis=1) / area, (np.cross(ab, p) * normal).sum(axis=1) / area
    within = (v >= 0) & (w >= 0) & (v + w <= 1)
    inner = norm(p - v[:, None] * ab - w[:, None] * ac)[within]
    return float(min(least, inner.min(initial=np.inf)))


def _closed(parts: Any) -> bool:
    """True if every edge of triangles is met once each way."""
    edges = np.concatenate([np.asarray(parts)[:, [i, (i + 1) % 3]] for i in range(3)])
    ways = {*map(tuple, edges.tolist())}
    return len(ways) == len(edges) and all((b, a) in ways for a, b in ways)


def _surrounded(point: Any, mesh: Any) -> bool:
    """True if triangles are seen from a point under more than half of all directions: by their solid angles, as A. Van
    Oosterom and J. Strackee (1983) have them."""
    a, b, c = (mesh - point).transpose(1, 0, 2)
    x, y, z = (np.sqrt((side * side).sum(axis=1)) for side in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    rest = x * y * z + (a * b).sum(axis=1) * z + (b * c).sum(axis=1) * x + (c * a).sum(axis=1) * y
    return bool(abs(2 * np.arctan2(volume, rest).sum()) > 2 * np.pi * (1 - 1e-9))
