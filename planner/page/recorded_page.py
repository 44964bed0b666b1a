"""Motions in a scene as one page of HTML that needs no server and nothing from elsewhere: for any browser with WebGL 2.

`page_of` gathers what is drawn: the robot's meshes (`packing`), compressed, and where everything is, sampled along the
motions. `stage.js` draws it and `page.js` plays it. What is written of clearance holds
at the samples; what is proven stands in the verdict.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
from collections.abc import Callable, Sequence
from importlib import resources
from string import Template
from typing import Any

import numpy as np
import pinocchio as pin

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Closest, proven_length
from hdplan.planner.geometry.drawn_shapes import drawn_box
from hdplan.planner.html_page import HtmlPage
from hdplan.planner.page.gliding import gliding_planes
from hdplan.planner.page.packing import MOST_OF_GHOSTS, Packed
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.camera import FOV, Boxes, best_view
from hdplan.planner.view.drawing.colors import (
    CONTACT,
    FAR_CLEARANCE,
    GOAL,
    LINES,
    LINKS,
    MOTIONS,
    OBSTACLE,
    OUTER,
    PLANE,
    REGION,
    SCALE,
    SHARES,
    START,
    clearance_colors,
    hex_of,
)
from hdplan.planner.view.drawing.creases import creased
from hdplan.planner.view.drawing.ground import ground_of
from hdplan.planner.view.drawing.motion import POSTURES, Share, ShownMotion, few_of, millimetres
from hdplan.planner.view.drawing.outline import Outline
from hdplan.planner.view.drawing.shading import two_toned
from hdplan.planner.view.drawing.skins import (
    ENDLESS,
    INSET,
    collision_skins,
    obstacle_mesh,
    obstacle_parts,
    visual_skins,
)
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.scene import Scene

MOMENTS = 121  # at which the closest pair is computed, and moving obstacles are
ASPECT = 1.3  # of the picture, width by height
GOOD = "#00724f", "#35c795"  # a certified verdict, on a light and on a dark ground
BAD = "#a50026", "#ff7b7b"


Near = Callable[[float], tuple[Closest | None, Closest | None]]


def page_of(
    setup: Setup,
    motions: Sequence[ShownMotion],
    stages: Sequence[dict[str, Any]] = (),
    close: Near | None = None,
    proof: ReadProof | None = None,
) -> HtmlPage:
    """Return the page of motions, at least one, that were measured in this scene; of a job with its stages (name,
    begin, end, certified, words) and with what is close at a time [s]; with the planes of a `proof` of the first
    motion. Raises InputError for obstacles' meshes that cannot be used."""
    scene, robot, packed = setup.scene, setup.robot, Packed()
    timeline = Timeline.of(scene, [motion.curve for motion in motions])
    when = np.linspace(timeline.begin, timeline.end, MOMENTS)
    first, boxes = motions[0], _boxes(scene, timeline)
    near = close or _near(Certifier(setup), first, timeline)
    try:
        seen, left_out = visual_skins(robot, scene.robot)
    except InputError as error:
        seen, left_out = (), (str(error),)
    skins = two_toned(robot, seen or collision_skins(robot))
    ghost = packed.add_all([skin for skin in collision_skins(robot) if skin.joint] or skins, MOST_OF_GHOSTS)
    ends = _poses(robot, first.joints[[0, -1]])
    pairs = [near(now) for now in when.tolist()]
    parameters = [timeline.parameter(first.curve, now) for now in when.tolist()]
    data: dict[str, Any] = {
        "title": f"{scene.name} · {robot.name}",
        "notes": f"left out of the picture: {'; '.join(left_out)}" if left_out else "",
        "timeline": {**vars(timeline), "duration": timeline.duration},
        "when": when,
        "obstacles": _obstacles(scene, timeline, when, packed),
        "robot": packed.add_all(skins),
        "base": _poses(robot, first.joints[:1])[0, 0],
        "ghosts": [{"robot": ghost, "poses": at, "color": c} for at, c in zip(ends, (START, GOAL), strict=True)],
        "inset": INSET,
        "motions": [_motion(robot, timeline, motion, number) for number, motion in enumerate(motions)],
        "labels": [
            {"text": name, "at": at, "color": color, "above": 18}
            for name, at, color in (("start", first.tip[0], START), ("goal", first.tip[-1], GOAL))
        ],
        "closest": [_close(pair) for pair in pairs],
        "planes": [] if proof is None else gliding_planes(proof, first.curve, parameters, pairs),
        "plane": PLANE,
        "stages": list(stages),
        "levels": _levels(scene, motions),
        "joints": _joints(robot),
        "floor": ground_of(robot, scene.robot, scene.obstacles),
        "camera": _camera(robot, motions, boxes),
        "between": LINKS,
        "bad": CONTACT,
        "meshes": packed.meshes,
    }
    words = {
        "TITLE": html.escape(data["title"]),
        "START": hex_of(START),
        "GOAL": hex_of(GOAL),
        "GOOD": GOOD[0],
        "GOODDARK": GOOD[1],
        "BAD": BAD[0],
        "BADDARK": BAD[1],
        "SCALE": ", ".join(hex_of((int(r), int(g), int(b))) for r, g, b in SCALE),
        "HALF": f"{FAR_CLEARANCE * 500:g}",
        "FAR_CLEARANCE": f"{FAR_CLEARANCE * 1000:g}",
        "DATA": json.dumps(data, allow_nan=False, default=_rounded, separators=(",", ":")).replace("<", "\\u003c"),
        "MESHES": base64.b64encode(gzip.compress(packed.data(), 6, mtime=0)).decode(),
        "SCRIPT": "\n".join(_part(name) for name in ("stage.js", "page.js")),
    }
    return HtmlPage(data["title"], Template(_part("page.html")).substitute(words))


def _part(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _rounded(value: Any) -> Any:
    """Return arrays and NumPy's numbers as JSON values, to 10 µm and 10 µrad."""
    return np.asarray(value).round(5).tolist()


def _poses(robot: Robot, joints: Array) -> Array:
    """Return the placements of all joints (K, joints, 7) at configurations (K, n): position, quaternion x y z w."""
    data = robot.model.createData()
    found = np.empty((len(joints), robot.model.njoints, 7))
    for row, q in enumerate(robot.pin_q(joints)):
        pin.forwardKinematics(robot.model, data, q)
        found[row] = [pin.SE3ToXYZQUAT(place) for place in data.oMi]
    return found


def _motion(robot: Robot, timeline: Timeline, motion: ShownMotion, number: int) -> dict[str, Any]:
    return {
        "name": motion.name,
        "verdict": motion.certificate.text,
        "certified": motion.certificate.certified,
        "color": MOTIONS[number % len(MOTIONS)],
        "when": timeline.moments(motion.curve, motion.parameter),
        "joints": motion.joints,
        "poses": _poses(robot, motion.joints).transpose(1, 0, 2),
        "path": motion.tip,
        "tints": clearance_colors(motion.clearance),
        "clearance": _millimetres(motion.clearance),
        "own": _millimetres(motion.self_clearance),
        "shares": [_share(timeline, motion, share) for share in motion.shares or ()],
    }


def _share(timeline: Timeline, motion: ShownMotion, share: Share) -> dict[str, Any]:
    """Return the share of its limits that a quantity takes [%], at the motion's samples."""
    when = timeline.moments(motion.curve, motion.parameter)
    values = np.interp(when, share.times, 100.0 * share.values)
    return {"quantity": share.quantity, "when": when, "values": values, "color": SHARES[share.quantity]}


def _millimetres(clearance: Array) -> Array:
    """Return distances [mm]; none where there is nothing to avoid."""
    return 1e3 * clearance if np.isfinite(clearance).all() else clearance[:0]


def _near(certifier: Certifier, motion: ShownMotion, timeline: Timeline) -> Near:
    """Return the function that finds the closest pairs at a moment of a motion."""

    def near(now: float) -> tuple[Closest | None, Closest | None]:
        q = motion.curve.at_parameter(timeline.parameter(motion.curve, now))
        return certifier.closest(q, timeline.seconds(now))

    return near


def _close(pairs: tuple[Closest | None, Closest | None]) -> list[dict[str, Any] | None]:
    """Return the closest pair with an obstacle, and between links."""
    found: list[dict[str, Any] | None] = []
    for near, own in zip(pairs, (None, LINKS), strict=True):
        color = None if near is None else own or clearance_colors(near.distance)
        label = {} if near is None else {"pair": f"{near.link} – {near.other}", "words": millimetres(near.distance)}
        found.append(None if near is None else {"points": near.points, "color": color, **label})
    return found


def _levels(scene: Scene, motions: Sequence[ShownMotion]) -> list[dict[str, Any]]:
    """Return the lines of the plot: contact, what is required, and, of a single motion, what is proven."""
    levels: list[dict[str, Any]] = [{"at": 0.0, "name": "", "color": CONTACT, "dash": []}]
    if scene.obstacles and scene.planner.clearance > 0.0:
        levels.append({"at": 1e3 * scene.planner.clearance, "name": "required", "color": CONTACT, "dash": [2, 3]})
    proven = motions[0].certificate.clearance
    if len(motions) == 1 and proven is not None:
        levels.append({"at": 1e3 * proven, "name": f"proven ≥ {proven_length(proven)}", "color": OUTER, "dash": [2, 3]})
    return levels


def _joints(robot: Robot) -> list[dict[str, Any]]:
    rows = zip(robot.joint_names, robot.lower.tolist(), robot.upper.tolist(), robot.turning, strict=True)
    return [
        {
            "name": name,
            "low": round(low, 3) if np.isfinite([low, high]).all() else None,
            "high": round(high, 3) if np.isfinite([low, high]).all() else None,
            "unit": "rad" if turns else "m",
            "color": LINES[number % len(LINES)],
        }
        for number, (name, low, high, turns) in enumerate(rows)
    ]


def _obstacles(scene: Scene, timeline: Timeline, when: Array, packed: Packed) -> list[dict[str, Any]]:
    """Pack the obstacles, and the box in which a point of a link is to stay, seen through."""
    found = []
    for obstacle in scene.obstacles:
        mesh = obstacle_mesh(obstacle)
        shown = packed.add(*creased(mesh.vertices, mesh.triangles), OBSTACLE)
        where: dict[str, Any] = {"pose": (*obstacle.pose.position, *obstacle.pose.quaternion_xyzw)}
        if obstacle.motion is not None:
            places = ObstacleMotion.of(obstacle).at(np.array([timeline.seconds(now) for now in when.tolist()]))
            where = {"poses": [pin.SE3ToXYZQUAT(pin.SE3(place)) for place in places]}
        found.append({"mesh": shown, "alpha": 1, **where})
    for region in scene.path.regions:
        width, depth, height = (min(edge, ENDLESS) for edge in region.size)
        box = drawn_box((width, depth, height))
        pose = (*region.pose.position, *region.pose.quaternion_xyzw)
        found.append({"mesh": packed.add(*creased(box.vertices, box.triangles), REGION), "alpha": 0.3, "pose": pose})
    return found


def _boxes(scene: Scene, timeline: Timeline) -> Boxes:
    """Return the boxes around the obstacles, of moving ones at some moments."""
    times = [timeline.seconds(now) for now in np.linspace(timeline.begin, timeline.end, POSTURES).tolist()]
    bounds, poses = [], []
    for obstacle in scene.obstacles:
        moves = obstacle.motion is not None
        places = list(ObstacleMotion.of(obstacle).at(np.array(times))) if moves else [obstacle.pose.matrix]
        bounds += [obstacle_parts(obstacle)] * len(places)
        poses += places
    return Boxes.around(bounds, poses)


def _camera(robot: Robot, motions: Sequence[ShownMotion], boxes: Boxes) -> tuple[Any, ...]:
    """Return eye, target, opening [rad] and width by height of the picture, from where obstacles hide least."""
    outline, path = Outline(robot), np.concatenate([motion.tip for motion in motions])
    postures = [q for motion in motions for q in few_of(motion.joints)]
    interest = np.concatenate([*map(outline.middles, postures), path[::10]])
    view = best_view(np.concatenate([*map(outline.at, postures)]).reshape(-1, 3), interest, path, boxes, ASPECT)
    return view.eye, view.target, float(FOV), ASPECT
