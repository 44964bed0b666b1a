"""The curve that a link is to follow in a stage of a job: where it begins, where it leads, and its blends.

A stage begins where the one before it ended, or, if that is blended into it, where it would have ended: its corner.
Two curves that are blended are one curve; the mark of the second stage is in the middle of the blend. A move has no
curve: within the radius around its corner the link comes onto the curve that follows it, or leaves the one before.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from . import scene as scenes
from .balls import Ball, need, norm
from .curves import ROUNDED, Blend, Leg, arc_about, arc_through, lengths
from .robot import rpy
from .stages import Stage
from .text import listing, number, values

if TYPE_CHECKING:
    from .job import Job

TABLE = ("x", "y", "z", "qx", "qy", "qz", "qw")  # columns of poses in a file, beside a time that says nothing
SAME_PLACE = 1e-14  # of places and rotations
TURNS = 4  # times that a turn about a free axis is sought
KNOWN = 1e-10  # by which placements of links may be off where curves begin there


@dataclass(frozen=True, eq=False)
class Corner:
    """The end of a stage, had it not been blended into the next one."""

    radius: float
    link: str
    at: Any  # (3,)
    turn: Any  # (3, 3)
    free: str  # axis about which the link may be turned there
    leg: Leg | None = None  # the curve that would have led there; none of a move


def tolerances(stage: Stage) -> tuple[float, float]:
    """Greatest distance [m] and angle [rad] of the link from its curve."""
    keys = ("position_tolerance", 1e-3, 0.1), ("orientation_tolerance", 1e-2, 1.0)
    found = [(scenes.one(stage.content.get(key, usual), f"{stage.kind}.{key}"), most) for key, usual, most in keys]
    need(all(0 < x <= most for x, most in found), f"{stage.kind}: a tolerance")
    return found[0][0], found[1][0]


def link_of(job: Job, stage: Stage) -> str:
    """The link, or the held object, that follows a stage's curve."""
    link = stage.content["link"] if "link" in stage.content else job.targets.end_effector()
    need(job.moves(link), f"{stage.kind}.link: '{link}' is not a link or held object that moves")
    return str(link)


def leg_of(job: Job, stage: Stage, corner: Corner | None) -> Leg:
    """The curve of a stage from its beginning to its end, as if it were not blended."""
    content, kind, link = stage.content, stage.kind, link_of(job, stage)
    free = content.get("free_rotation", "none")
    need(free in ("none", "x", "y", "z"), f"{kind}.free_rotation: '{free}'")
    rates = [
        None if (x := content.get(key)) is None else scenes.one(x, key) for key in ("tool_speed", "tool_acceleration")
    ]
    need(all(x is None or x > 0 for x in rates), f"{kind}: a speed or acceleration of the tool")
    if corner is None:
        turn, at = known(job.frames()[link])
    else:
        need(corner.link == link, f"{kind}.link: '{link}', and the stage before it is blended with '{corner.link}'")
        turn, at = corner.turn, corner.at
    frame = content.get("frame", "world")
    own, origin = frame_of(job, kind, frame, (turn, at), corner)
    if kind == "along":
        rotations, places = poses_of(job, content)
        rotations, places = own @ rotations, places @ own.T + origin
        off = lengths(places[0] - at)
        need(off <= tolerances(stage)[0] + ROUNDED, f"along: the first pose is {off:.3g} m from where the link is")
        return Leg(places, rotations, free, (rates[0], rates[1]))
    need(("by" in content) != ("to" in content), f"{kind}: either by or to")
    need("by" in content or not {"frame", "turn"} & {*content}, f"{kind}: frame and turn go with 'by'")
    need("to" in content or "rpy" not in content, f"{kind}.rpy: goes with 'to'")

    def place(key: str) -> Any:
        given = values(content[key], 3, f"{kind}.{key}")
        return given if "to" in content else at + own @ given

    ends, end = place("to" if "to" in content else "by"), turn
    if "rpy" in content:
        end = rpy(values(content["rpy"], 3, "rpy")).mid
    elif "turn" in content:
        angles = values(content["turn"], 3, "turn")
        need((np.abs(angles) <= np.pi).all(), f"{kind}.turn: more than half a turn")
        end = own @ rpy(angles).mid @ own.T @ turn
    arc = None
    if kind == "circle":
        need(("interim" in content) != ("center" in content), "circle: either interim or center")
        around, far = "interim" in content, tolerances(stage)[0]
        arc = arc_through(at, place("interim"), ends) if around else arc_about(at, place("center"), ends, far)
    return Leg(np.stack([at, ends]), np.stack([turn, end]), free, (rates[0], rates[1]), arc)


def known(pose: tuple[Ball, Ball]) -> tuple[Any, Any]:
    """Rotation and place as plain numbers."""
    need(max(x.rad.max() for x in pose) <= KNOWN, "a placement is not known well enough")
    return pose[0].mid, pose[1].mid


def frame_of(job: Job, kind: str, frame: Any, begins: tuple[Any, Any], corner: Corner | None) -> tuple[Any, Any]:
    """Rotation and origin of the frame in which a stage says where to go."""
    if frame == "world":
        return np.eye(3), np.zeros(3)
    if frame == "tool":
        need(corner is None or corner.free == "none", f"{kind}.frame: 'tool' after a blend with a free axis")
        return begins
    need(frame in job.things, f"{kind}.frame: unknown '{frame}'")
    need(corner is None or frame in job.standing, f"{kind}.frame: '{frame}' is held, after a blend")
    return known(job.place(frame))


def poses_of(job: Job, content: dict[str, Any]) -> tuple[Any, Any]:
    """Rotations (N, 3, 3) and places (N, 3) of a list, or of a CSV file."""
    need(("file" in content) != ("poses" in content), "along: either file or poses")
    if "poses" in content:
        read = [known(scenes.pose_of(x, "along.poses")) for x in listing(content["poses"], "along.poses")]
    else:
        path = job.reader.folder / scenes.word(content["file"], "along.file")
        text = job.reader.files.read(f"poses {path.name}", path).decode("utf-8-sig")
        head, *lines = [x for x in csv.reader(text.splitlines(), strict=True) if x]
        names = [x.strip() for x in head]
        need(
            sorted(x for x in names if x != "time") == sorted(TABLE) and len({*names}) == len(names),
            "along.file: columns",
        )
        need(all(len(x) == len(names) for x in lines), "along.file: rows of other lengths")
        rows = [[number(line[names.index(x)], "along.file") for x in TABLE] for line in lines]
        read = [known(scenes.pose_of({"position": x[:3], "quaternion_xyzw": x[3:]}, "along.file")) for x in rows]
    need(2 <= len(read) <= 20_000, "along: 2 to 20000 poses are expected")
    return np.stack([x for x, _ in read]), np.stack([x for _, x in read])


def following(job: Job, number: int) -> dict[str, Any]:
    """The goal of a stage, and its path constraint: its curve from the middle of the blend before it to that of the
    blend after it, as chords, for which less is left of the tolerances."""
    stage, corner = job.stages[number], job.corner
    leg, (far, angle) = leg_of(job, stage, corner), tolerances(stage)
    goes = job.stages[number + 1] if stage.blend else None
    first, last, lost, bent = 0.0, 1.0, 0.0, 0.0
    before, behind = list[Any](), list[Any]()
    if corner is not None:
        first = leg.leaves(corner.radius)
        if corner.leg is not None:
            blend = blended(corner.leg, leg, corner.radius)
            s, lost, bent = blend.chords(1, far, angle)
            before.append(blend.poses(s))
    if goes is not None:
        last = 1.0 - leg.backwards.leaves(stage.blend)
        if goes.curve:
            blend = blended(leg, leg_of(job, goes, corner_after(job, number)), stage.blend)
            s, more, turn = blend.chords(0, far, angle)
            lost, bent = max(lost, more), max(bent, turn)
            behind.append(blend.poses(s))
    need(first <= last, "blend: its radius and that of the stage before it overlap")
    share, more = leg.chords(first if before else 0.0, last if behind else 1.0, far)
    lost = max(lost, more)
    share = share[bool(before) : len(share) - bool(behind)]  # where blends end they have a pose of their own
    places, turns = (np.concatenate(x) for x in zip(*before, leg.poses(share), *behind, strict=True))
    kept = np.append(apart(places, turns), True)
    ends = scenes.frame((Ball(turns[-1], ROUNDED), Ball(places[-1], ROUNDED)))
    target = {"link": link_of(job, stage), **ends, "position_tolerance": far, "orientation_tolerance": angle}
    curve = {
        "kind": "follow",
        "link": target["link"],
        "free": leg.free,
        "poses": [
            {"rotation": x.ravel().tolist(), "position": y.tolist(), "off": ROUNDED}
            for x, y in zip(turns[kept], places[kept], strict=True)
        ],
        "position_tolerance": far - lost,
        "orientation_tolerance": angle - bent,
        "begin_tolerance": corner.radius - lost if corner is not None and corner.leg is None else None,
        "end_tolerance": stage.blend - lost if goes is not None and not goes.curve else None,
        "speed": leg.law[0],
        "acceleration": leg.law[1],
    }
    return {"goal": ({**target, "free": leg.free},), "path": (curve,)}


def apart(places: Any, turns: Any) -> Any:
    """True (N - 1,) for poses that are not, but for rounding, those that follow them."""
    return (lengths(np.diff(places, axis=0)) > SAME_PLACE) | (
        np.abs(np.diff(turns, axis=0)).max(axis=(1, 2)) > SAME_PLACE
    )


def blended(first: Leg, second: Leg, radius: float) -> Blend:
    """Two curves of one link, of which the first goes over into the second."""
    need(first.free == second.free, "blend: the two have other axes about which the link is free")
    return Blend(first, second, radius)


def corner_after(job: Job, number: int) -> Corner | None:
    """The end of a stage that is blended into the next one, had it not been; none between two moves."""
    stage, goes = job.stages[number], job.stages[number + 1]
    if not (stage.curve or goes.curve):
        return None
    link = link_of(job, stage if stage.curve else goes)
    if stage.curve:
        leg = leg_of(job, stage, job.corner)
        return Corner(stage.blend, link, leg.at[-1], leg.rotations[-1], leg.free, leg)
    goal: dict[str, Any]
    targets = job.targets.goals(stage.content)
    need(len(targets) == 1, "blend: a move to several goals, before a curve")
    (goal,) = targets
    if "joints" in goal:
        turn, at = known(job.frames(dict(zip(job.arm, goal["joints"], strict=True)))[link])
        return Corner(stage.blend, link, at, turn, "none")
    pose = goal["poses"][0]
    good = len(goal["poses"]) == 1 and pose["link"] == link and pose["free"] != "all"
    need(good, f"blend: before a curve a move leads to one pose of {link}")
    return Corner(stage.blend, link, np.array(pose["position"]), np.array(pose["rotation"]).reshape(3, 3), pose["free"])


def settled(job: Job, stage: Stage, corner: Corner, rows: Any) -> Corner:
    """A corner whose free axis is turned as the link's is when it first leaves the radius, less what the stage's curve
    has turned it up to there: any turn about that axis would do, and the curve is to be kept to with this one."""
    if corner.free == "none" or corner.leg is not None:
        return corner
    for row in range(len(rows.given[0])):
        turn, at = job.frames({x: rows.at(x, row) for x in job.arm})[corner.link]
        if norm((at - corner.at).size) > corner.radius:
            break
    found, away = turned_as(corner, turn.mid), float(lengths(at.mid - corner.at))
    for _ in range(TURNS):
        leg = leg_of(job, stage, found)
        if leg.arc is None and (lengths(leg.at - leg.at[0]) <= away).all():
            break  # the curve ends before
        _, there = leg.poses(np.array([leg.leaves(away)]))
        found = turned_as(corner, found.turn @ there[0].T @ turn.mid)
    return found


def turned_as(corner: Corner, turn: Any) -> Corner:
    """A corner turned about its free axis as a rotation says, as nearly as it can be."""
    i = "xyz".index(corner.free)
    j, k = (i + 1) % 3, (i + 2) % 3
    between = corner.turn.T @ turn
    angle = np.arctan2(between[k, j] - between[j, k], between[j, j] + between[k, k])
    about = np.eye(3)
    about[[j, k], [j, k]], about[j, k], about[k, j] = np.cos(angle), -np.sin(angle), np.sin(angle)
    return replace(corner, turn=corner.turn @ about, free="none")


def check_radius(job: Job, number: int, arm: dict[str, float]) -> None:
    """Reject a move that goes over into the next stage farther than its radius from where it would have ended: the link
    of the curve that follows, or that of its own pose, or the last one."""
    stage, goes = job.stages[number], job.stages[number + 1]
    targets, here = job.targets.goals(stage.content), job.frames(arm)
    poses = [pose for x in targets for pose in x.get("poses", [])]
    link = link_of(job, goes) if goes.curve else poses[0]["link"] if poses else job.targets.end_effector()
    away = []
    for goal in targets:
        places = [(x["link"], Ball(np.array(x["position"]), x["off"])) for x in goal.get("poses", [])]
        if "joints" in goal:
            places = [(link, job.frames(dict(zip(job.arm, goal["joints"], strict=True)))[link][1])]
        away.append(max(float(norm((here[x][1] - at).size)) for x, at in places))
    need(min(away) <= stage.blend, f"goes over into the next stage {min(away):.4g} m from its goal")
