"""What a problem will hold, in words: terms on and off and why, bodies, pairs kept and left out, unknowns, settings.

In: a built `Problem`. Out: sections of (name, value) rows, for a terminal table or JSON.
"""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np

from hdplan.planner.pose_goals import pose_words
from hdplan.planner.problem import Floats, Problem, self_margin
from hdplan.planner.robot import Robot
from hdplan.planner.terms import Clearance
from hdplan.scenes.model import (
    Box,
    Capsule,
    Cylinder,
    Goals,
    JointTarget,
    Mesh,
    PathConstraints,
    PlannerSettings,
    Points,
    PoseTarget,
    Shape,
    Sphere,
)

Rows = list[tuple[str, str]]

MOST_OBSTACLES = 30  # rows; a page is to be read
UNITS = {"clearance": " m", "activation": " m", "shaping_length": " m"}


def explain(problem: Problem) -> dict[str, Rows]:
    """Return the sections of the explanation, in reading order."""
    return {
        "scene": _scene(problem),
        "joints": _joints(problem.robot, problem.start, problem.goal),
        "terms": _terms(problem),
        "obstacles": _obstacles(problem),
        **({"attached": _attached(problem)} if problem.robot.attached else {}),
        "pairs": _pairs(problem),
        "size": _size(problem),
        "settings": _settings(problem),
        "notes": [(str(number), note) for number, note in enumerate(problem.notes, start=1)],
    }


def _scene(problem: Problem) -> Rows:
    robot = problem.robot
    held = ", ".join(f"{joint} = {value:g}" for joint, value in robot.locked.items())
    corners = [len(body.body.vertices) for body in problem.bodies]
    around = len({body.link for body in problem.bodies} - {attached.name for attached in robot.attached})
    objects = f" and {_count(len(robot.attached), 'held object')}" if robot.attached else ""
    bodies = (
        f"{len(corners)} around the {around} links with collision geometry{objects}: hulls of {min(corners)} to "
        f"{max(corners)} points, swept by a sphere"
        if corners
        else "none: no link has collision geometry, so nothing can collide"
    )
    return [
        ("file", str(problem.scene.source)),
        ("robot", f"{robot.name}, {_count(robot.n, 'joint')} planned, {len(robot.locked) or 'none'} held"),
        *([("held", held)] if held else []),
        ("outer bodies", bodies),
        *_choice(problem.scene.goal),
    ]


def _choice(goal: JointTarget | Goals) -> Rows:
    """What may end the motion, where the scene leaves a choice; the joints shown are the likely best."""
    targets = goal.targets if isinstance(goal, Goals) else ()
    return [
        (target.field, pose_words(target) if isinstance(target, PoseTarget) else "one of several configurations")
        for target in targets
    ]


def _joints(robot: Robot, start: Floats, goal: Floats) -> Rows:
    width = max(map(len, robot.joint_names))
    rows: Rows = []
    for i, joint in enumerate(robot.joint_names):
        low, high = robot.lower[i], robot.upper[i]
        limits = f"limits {low:7.4g} to {high:.4g}" if np.isfinite([low, high]).all() else "turns freely"
        rows.append((f"{joint:{width}}", f"{start[i]:8.4g} → {goal[i]:8.4g}   {limits}"))
    return rows


def _terms(problem: Problem) -> Rows:
    on = {term.name for term in problem.terms}
    settings = problem.scene.planner
    reach = settings.clearance + settings.activation
    if "obstacles" in on:
        swept = ", swept from waypoint to waypoint" * settings.swept
        obstacles = f"on: grows where a moving link comes within {reach:g} m of an obstacle{swept}"
    elif not problem.bodies:
        obstacles = "off: no link has collision geometry"
    elif problem.plane_bodies:
        obstacles = "off: every obstacle is out of the robot's reach"
    else:
        obstacles = "off: the scene has no obstacles"
    if "self-collision" in on:
        own = f"on: grows where two links come within {self_margin(problem.scene):g} m"
    elif problem.unresolved:
        own = "off: the outer bodies of all pairs of links overlap anyway"
    elif problem.apart:
        own = "off: every pair of links is proven to keep apart within the joint limits"
    else:
        own = "off: no pair of links can meet, or all are disabled" if problem.bodies else obstacles
    bounded = int(np.isfinite(problem.robot.lower).sum())
    free = problem.robot.n - bounded
    limits = f"on: {_count(bounded, 'joint')} kept within limits" if bounded else "off: no joint has limits"
    return [
        ("smoothness", "on, always: squared velocity and acceleration over the motion"),
        ("joint limits", limits + (f"; {_count(free, 'joint')} without" if free and bounded else "")),
        ("obstacles", obstacles),
        ("self-collision", own),
        *_path(problem.scene.path),
        *_torque_terms(problem),
    ]


def _path(path: PathConstraints) -> Rows:
    """What the scene asks of the whole way, if anything."""
    rows: Rows = []
    if path.upright:
        axis = ", ".join(f"{part:g}" for part in path.upright.axis)
        tilt = f"tilted by {path.upright.tolerance:g} rad at most"
        rows.append(("path.upright", f"on: axis ({axis}) of {path.upright.link} points up, {tilt}, all along the way"))
    if path.position:
        size, centre = (
            ", ".join(f"{part:g}" for part in vector) for vector in (path.position.size, path.position.pose.position)
        )
        point = ", ".join(f"{part:g}" for part in path.position.point)
        box = f"the box of size ({size}) m around ({centre})"
        rows.append(("path.position", f"on: point ({point}) of {path.position.link} stays in {box}, all along the way"))
    return rows


def _torque_terms(problem: Problem) -> Rows:
    """What keeps torques within limits, where the scene limits them: in the motion's shape, and in its law of time."""
    if problem.scene.limits.torque is None:
        return []
    from hdplan.planner.dynamics import InverseDynamics
    from hdplan.planner.hinge import BAND
    from hdplan.planner.loads import loaded_model, moved_mass
    from hdplan.planner.static_torque import ARM, StaticTorque

    model = loaded_model(problem.scene, problem.robot)
    term = next((term for term in problem.terms if isinstance(term, StaticTorque)), None)
    if term is None:
        shape = "off: gravity alone can load no joint so much"
    else:
        joints = ", ".join(problem.robot.joint_names[i] for i in term.measure.joints.tolist())
        shape = f"on: grows where gravity alone takes {1 - BAND / ARM:.0%} of the limit of {joints}"
    instructions = InverseDynamics(model).instructions
    added = moved_mass(model) - moved_mass(problem.robot.model)
    loads = f", of which {added:g} kg are loads" if added else ""
    law = f"on: inverse dynamics of {moved_mass(model):.3g} kg{loads}; {instructions} instructions"
    return [("static torque", shape), ("joint torques", law)]


def _obstacles(problem: Problem) -> Rows:
    """One row for each obstacle: its shape, and how much of the robot can reach it."""
    pieces = Counter(piece.name for piece in problem.plane_bodies)
    term = _term(problem, "obstacles")
    met = Counter(problem.plane_bodies[index].name for index in term.pairs.plane_body.tolist()) if term else Counter()
    moving = sum(body.joint > 0 for body in problem.bodies)
    rows: Rows = []
    for obstacle in problem.scene.obstacles[:MOST_OBSTACLES]:
        name, several = obstacle.name, pieces[obstacle.name] > 1
        total = moving * pieces[name]
        kept = f"{met[name]} of {total} pairs kept" if met[name] else "out of reach, left out"
        split = f" in {pieces[name]} convex pieces" if several else ""
        rows.append((name, f"{_shape(obstacle.shape)}{split}; {kept}"))
    if left := len(problem.scene.obstacles) - MOST_OBSTACLES:
        rows += [("…", f"and {left} more")] if left > 0 else []
    return rows


def _attached(problem: Problem) -> Rows:
    """One row for each held object: its shape, the link that holds it, and what it is kept apart from."""
    bodies = Counter(body.link for body in problem.bodies)
    rows: Rows = []
    for held in problem.robot.attached:
        links = sum(held.name in pair for pair in problem.robot.self_pairs)
        mass = f", {held.mass:g} kg" if held.mass else ""
        touching = f", may touch {', '.join(held.touch_links)}" if held.touch_links else ""
        rows.append(
            (
                held.name,
                f"{_shape(held.shape)}{mass}, held by {held.link}{touching}; outer bodies: {bodies[held.name]}; "
                f"kept apart from obstacles and {_count(links, 'link')}",
            )
        )
    return rows


def _pairs(problem: Problem) -> Rows:
    rows: Rows = []
    moving = sum(body.joint > 0 for body in problem.bodies)
    if total := moving * len(problem.plane_bodies):
        kept = _kept(problem, "obstacles")
        why = "" if kept == total else f"; {total - kept} can never meet within the joint limits"
        rows.append(("robot and obstacles", f"{kept} of {total} pairs of bodies kept{why}"))
    links = len(problem.robot.links)
    if total := links * (links - 1) // 2:
        checked = len(problem.robot.self_pairs)
        rows.append(
            (
                "links and held objects" if problem.robot.attached else "links",
                f"{checked} of {total} pairs checked, by {_kept(problem, 'self-collision')} pairs of bodies; the "
                "others are neighbours, do not move against each other, touch always, or are disabled (SRDF, "
                f"robot.ignore_pairs{', touch_links' if problem.robot.attached else ''})",
            )
        )
    if problem.unresolved:
        named = ", ".join(f"{a}-{b}" for a, b in problem.unresolved)
        rows.append(
            ("left to the certificate", f"{named}: their outer bodies overlap anyway, the real meshes need not")
        )
    return rows


def _size(problem: Problem) -> Rows:
    unknowns = (problem.waypoints - 2) * problem.robot.n
    how = ", ".join(sorted({term.distance.how for term in problem.pair_terms})) or "not needed"
    return [
        ("unknowns", f"{unknowns}: {problem.waypoints - 2} free waypoints × {_count(problem.robot.n, 'joint')}"),
        ("looked at", f"{len(problem.samples.weight)} configurations between the waypoints"),
        ("distance", how),
    ]


def _settings(problem: Problem) -> Rows:
    rows: Rows = []
    for field in dataclasses.fields(PlannerSettings):
        value = getattr(problem.scene.planner, field.name)
        origin = "default" if value == field.default else "scene"
        shown = str(value).lower() if isinstance(value, str | bool) else f"{value:g}"
        rows.append((field.name, f"{shown}{UNITS.get(field.name, '')} ({origin})"))
    return rows


def _shape(shape: Shape) -> str:
    match shape:
        case Box(size):
            return f"box {' × '.join(f'{edge:g}' for edge in size)} m"
        case Sphere(radius):
            return f"sphere, radius {radius:g} m"
        case Cylinder(radius, length):
            return f"cylinder, radius {radius:g} m, length {length:g} m"
        case Capsule(radius, length):
            return f"capsule, radius {radius:g} m, length {length:g} m"
        case Points(points):
            return f"hull of {len(points)} points"
        case Mesh(file):
            return f"mesh {file.name}"


def _term(problem: Problem, name: str) -> Clearance | None:
    return next((term for term in problem.pair_terms if term.name == name), None)


def _kept(problem: Problem, name: str) -> int:
    term = _term(problem, name)
    return len(term.pairs) if term else 0


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + "s" * (number != 1)
