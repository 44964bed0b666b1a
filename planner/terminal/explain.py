"""An explanation of a problem: effects that are on or off and why, bodies, pairs kept and left out, sizes, settings.

In: a built `Problem`. Out: sections of (name, value) rows, for a terminal table or JSON. The trial's times are measured
and vary from run to run.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from typing import assert_never

import numpy as np

from hdplan.planner.geometry.seen import seen_words
from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.problem.clearance import PairTerm
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.unknown import spans
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING, MOVE_AS_ONE, NEIGHBOURS, NEVER_TOUCHING
from hdplan.planner.terminal.explain_cost import functions, trial
from hdplan.planner.terminal.explain_effects import counted, effects
from hdplan.planner.terminal.explain_unknown import unknown
from hdplan.scenes.limits import QUANTITIES
from hdplan.scenes.obstacles import Obstacle, Seen, SteadyMotion, TimedPoses
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.targets import Goals, JointTarget

Rows = list[tuple[str, str]]

MOST_OBSTACLES = 30  # rows, so that the table stays readable
MOST_NAMED = 3  # pairs of links named in one row
REASONS = {  # others are "by" something
    reason: reason for reason in (ALWAYS_TOUCHING, NEVER_TOUCHING, MOVE_AS_ONE, NEIGHBOURS)
}
UNITS = {"clearance": " m", "activation": " m", "shaping_length": " m"}


def explain(problem: Problem) -> dict[str, Rows]:
    """Return the sections of the explanation, in reading order."""
    found = effects(problem)
    sections = {
        "scene": _scene(problem),
        "joints": _joints(problem),
        "on": [(effect.name, effect.on) for effect in found if effect.on],
        "off": [(effect.name, effect.off) for effect in found if not effect.on],
        "obstacles": _obstacles(problem),
        "unknown": unknown(problem.setup),
        "held objects": _attached(problem),
        "pairs": _pairs(problem),
        "size": _size(problem),
        "trial evaluation": trial(problem),
        "settings": _settings(problem),
        "notes": [(str(number), note) for number, note in enumerate(problem.notes, start=1)],
    }
    return {title: rows for title, rows in sections.items() if rows}


def _scene(problem: Problem) -> Rows:
    robot = problem.robot
    held = ", ".join(f"{joint} = {value:g}" for joint, value in robot.locked.items())
    corners = [len(body.body.vertices) for body in problem.bodies]
    around = len({body.link for body in problem.bodies} - {attached.name for attached in robot.attached})
    objects = f" and {counted(len(robot.attached), 'held object')}" if robot.attached else ""
    bodies = (
        f"{len(corners)} around the {around} links with collision geometry{objects}: hulls of {min(corners)} to "
        f"{max(corners)} points, swept by a sphere"
        if corners
        else "none: no link has collision geometry, so nothing can collide"
    )
    return [
        ("file", str(problem.scene.source)),
        ("robot", f"{robot.name}, {counted(robot.n, 'joint')} planned, {len(robot.locked) or 'none'} held"),
        *([("held", held)] if held else []),
        ("outer bodies", bodies),
        *_choice(problem.scene.goal),
    ]


def _choice(goal: JointTarget | Goals) -> Rows:
    """One row for each goal, if the scene leaves a choice; joint values shown are those of the most promising one."""
    if isinstance(goal, JointTarget):
        return []
    from hdplan.planner.certificate.pose_goals import pose_words

    rows: Rows = []
    for target in goal.targets:
        if isinstance(target, JointTarget):
            rows.append((target.field, "one of several configurations"))
        else:
            rows += [(pose.field, pose_words(pose)) for pose in target.poses]
    return rows


def _joints(problem: Problem) -> Rows:
    """One row for each joint: its start and goal, its range, and its other limits if the scene has any."""
    robot = problem.robot
    width = max(map(len, robot.joint_names))
    most = [(limit, QUANTITIES[quantity].units) for quantity, limit in problem.setup.limits.items()]
    rows: Rows = []
    for i, joint in enumerate(robot.joint_names):
        low, high = robot.lower[i], robot.upper[i]
        limits = f"limits {low:7.4g} to {high:<7.4g}" if np.isfinite([low, high]).all() else f"{'turns freely':25}"
        slides = not robot.turning[i]
        own = " ".join(f"{limit[i]:.4g}{_per(units[slides])}" for limit, units in most)
        row = f"{problem.start[i]:8.4g} → {problem.goal[i]:8.4g}  {limits} {own}"
        rows.append((f"{joint:{width}}", row.rstrip()))
    return rows


def _per(unit: str) -> str:
    """Shorten a unit for the table of joints, without its rad or m."""
    per = unit.removeprefix("rad").removeprefix("m")
    return per if per.startswith("/") else f" {per}"


def _obstacles(problem: Problem) -> Rows:
    """One row for each obstacle: its shape, its own clearance, its motion, and the pairs that can reach it."""
    pieces = Counter(piece.name for piece in problem.halfspace_bodies)
    met: Counter[str] = Counter()
    if standing := problem.terms.obstacles:
        met = Counter(problem.halfspace_bodies[index].name for index in standing.pairs.halfspace_body.tolist())
    moving = sum(body.joint > 0 for body in problem.bodies)
    rows: Rows = []
    requested = {obstacle.name: obstacle for obstacle in problem.setup.requested.obstacles}
    for obstacle in problem.scene.obstacles[:MOST_OBSTACLES]:
        words, kind = _words(requested[obstacle.name], obstacle)
        leaves = obstacle.uncertainty.speed if obstacle.uncertainty else 0.0
        pieces[obstacle.name] //= len(spans(obstacle, problem.scene.end_time)) if leaves else 1
        words += f" in {pieces[obstacle.name]} {kind}" if pieces[obstacle.name] > 1 else ""
        words += f", clearance {obstacle.clearance:g} m" if obstacle.clearance is not None else ""
        total = moving * pieces[obstacle.name]
        match obstacle.motion:
            case SteadyMotion(velocity, spin):
                speed, turn = float(np.linalg.norm(velocity)), float(np.linalg.norm(spin))
                kept = f"moves at {speed:g} m/s" + f", turns at {turn:g} rad/s" * bool(turn) + f"; {total} pairs"
            case TimedPoses(times, poses):
                kept = f"passes {len(poses)} poses from {times[0]:g} to {times[-1]:g} s; {total} pairs"
            case None if leaves:
                kept = f"may leave at {leaves:g} m/s; {total} pairs at any time"
            case None:
                number = met[obstacle.name]
                kept = f"{number} of {total} pairs kept" if number else "out of reach, left out"
            case _:
                assert_never(obstacle.motion)
        rows.append((obstacle.name, f"{words}; {kept}"))
    left = len(problem.scene.obstacles) - MOST_OBSTACLES
    return [*rows, ("…", f"and {left} more")] if left > 0 else rows


def _words(requested: Obstacle, read: Obstacle) -> tuple[str, str]:
    """Return words for an obstacle's shape, and for the planner's parts of it."""
    shape = read.shape
    if isinstance(shape, Seen):
        assert isinstance(requested.shape, Seen)
        return seen_words(requested.shape, shape), "boxes"
    return operations(shape).words(shape), "convex pieces"


def _attached(problem: Problem) -> Rows:
    """One row for each held object: its shape, the link that holds it, and the bodies from which it keeps apart."""
    bodies = Counter(body.link for body in problem.bodies)
    rows: Rows = []
    for held in problem.robot.attached:
        links = sum(held.name in pair for pair in problem.robot.self_pairs)
        touching = f", may touch {', '.join(held.touch_links)}" if held.touch_links else ""
        mass = "" if held.mass is None else f", {held.mass:g} kg"
        what = operations(held.shape).words(held.shape)
        words = f"{what}{mass}, held by {held.link}{touching}; outer bodies: {bodies[held.name]}"
        rows.append((held.name, f"{words}; kept apart from obstacles and {counted(links, 'link')}"))
    return rows


def _pairs(problem: Problem) -> Rows:
    """Counts of the pairs, of those that are kept, and the reasons why others are excluded."""
    robot = problem.robot
    rows: Rows = []
    moving = sum(body.joint > 0 for body in problem.bodies)
    standing = [obstacle.name for obstacle in problem.scene.standing]
    if total := moving * sum(piece.name in standing for piece in problem.halfspace_bodies):
        kept = _kept(problem.terms.obstacles)
        why = "" if kept == total else f"; {total - kept} can never meet within the joint limits"
        rows.append(("robot and obstacles", f"{kept} of {total} pairs of bodies kept{why}"))
    if total := moving * sum(piece.name not in standing for piece in problem.halfspace_bodies):
        rows.append(("moving obstacles", f"{_kept(problem.terms.moving_obstacles)} of {total} pairs of bodies kept"))
    links = len(robot.links)
    if total := links * (links - 1) // 2:
        named = set(robot.links)
        reasons = Counter(reason for pair, reason in robot.unchecked.items() if named.issuperset(pair))
        counts = (f"{count} {REASONS.get(reason, f'by {reason}')}" for reason, count in reasons.most_common())
        excluded = f"; excluded: {', '.join(counts)}" if reasons else ""
        rows.append(
            (
                "links and held objects" if robot.attached else "links",
                f"{len(robot.self_pairs)} of {total} pairs checked{excluded}",
            )
        )
    kept = _kept(problem.terms.self_collision)
    if total := kept + len(problem.apart):
        apart = Counter("-".join(sorted(problem.bodies[index].link for index in pair)) for pair in problem.apart)
        most = ", ".join([*list(apart)[:MOST_NAMED], *(["…"] if len(apart) > MOST_NAMED else [])])
        why = f"; {len(problem.apart)} proven to keep apart within the joint limits ({most})" if apart else ""
        rows.append(("bodies of links", f"{kept} of {total} pairs kept{why}"))
    if problem.unresolved:
        overlapping = ", ".join(f"{a}-{b}" for a, b in problem.unresolved)
        rows.append(
            ("left to the certificate", f"{overlapping}: their outer bodies overlap anyway, the real meshes need not")
        )
    return rows


def _size(problem: Problem) -> Rows:
    unknowns = (problem.waypoints - 2) * problem.robot.n
    how = ", ".join(sorted({term.distance.how for term in problem.terms.pairs})) or "not needed"
    return [
        ("unknowns", f"{unknowns}: {problem.waypoints - 2} free waypoints × {counted(problem.robot.n, 'joint')}"),
        ("sampled", f"{len(problem.samples.weight)} configurations between the waypoints"),
        ("distance", how),
        *functions(problem),
    ]


def _settings(problem: Problem) -> Rows:
    rows: Rows = []
    for field in dataclasses.fields(PlannerSettings):
        value = getattr(problem.scene.planner, field.name)
        origin = "default" if value == field.default else "scene"
        value = getattr(problem.scene, field.name) if value is None else value  # as the rest of the scene has it
        shown = str(value).lower() if isinstance(value, str | bool) else f"{value:g}"
        rows.append((field.name, f"{shown}{UNITS.get(field.name, '')} ({origin})"))
    return rows


def _kept(term: PairTerm | None) -> int:
    return len(term.pairs) if term else 0
