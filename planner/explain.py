"""What a problem will hold, in words: terms on and off and why, bodies, pairs kept and left out, unknowns, settings.

In: a built `Problem`. Out: sections of (name, value) rows, for a terminal table or JSON.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from hdplan.planner.problem import SELF_ACTIVATION, Problem
from hdplan.planner.terms import Clearance
from hdplan.scenes.model import PlannerSettings

Rows = list[tuple[str, str]]

UNITS = {"clearance": " m", "activation": " m", "shaping_length": " m"}


def explain(problem: Problem) -> dict[str, Rows]:
    """Return the sections of the explanation, in reading order."""
    return {
        "scene": _scene(problem),
        "terms": _terms(problem),
        "bodies": _bodies(problem),
        "pairs": _pairs(problem),
        "size": _size(problem),
        "settings": _settings(problem),
        "notes": [(str(number), note) for number, note in enumerate(problem.notes, start=1)],
    }


def _scene(problem: Problem) -> Rows:
    robot = problem.robot
    held = ", ".join(f"{joint} = {value:g}" for joint, value in robot.locked.items()) or "none"
    return [
        ("file", str(problem.scene.source)),
        ("robot", robot.name),
        ("planned joints", ", ".join(robot.joint_names)),
        ("held joints", held),
        ("start", _numbers(problem.start)),
        ("goal", _numbers(problem.goal)),
    ]


def _terms(problem: Problem) -> Rows:
    on = {term.name for term in problem.terms}
    settings = problem.scene.planner
    reach = settings.clearance + settings.activation
    if "obstacles" in on:
        obstacles = f"on: penalty where a link comes within {reach:g} m of an obstacle"
    elif problem.plane_bodies:
        obstacles = "off: every obstacle is out of the robot's reach"
    else:
        obstacles = "off: the scene has no obstacles"
    if "self-collision" in on:
        own = f"on: penalty where two links come within {settings.clearance + SELF_ACTIVATION:g} m"
    else:
        own = "off: no pair of links can meet, or all are disabled"
    bounded = int(np.isfinite(problem.robot.lower).sum())
    return [
        ("smoothness", "on, always: squared velocity and acceleration over the motion"),
        ("joint limits", f"on, always: {bounded} of {problem.robot.n} joints have limits, the others turn freely"),
        ("obstacles", obstacles),
        ("self-collision", own),
    ]


def _bodies(problem: Problem) -> Rows:
    by_link: dict[str, list[int]] = {}
    for body in problem.bodies:
        by_link.setdefault(body.link, []).append(len(body.body.vertices))
    pieces: dict[str, int] = {}
    for piece in problem.plane_bodies:
        pieces[piece.name] = pieces.get(piece.name, 0) + 1
    several = ", ".join(f"{name} ({count} pieces)" for name, count in pieces.items() if count > 1)
    links = ", ".join(f"{link} {'+'.join(map(str, counts))}" for link, counts in by_link.items())
    return [
        ("outer bodies of links", f"{len(problem.bodies)} on {len(by_link)} links; vertices: {links}"),
        ("obstacles", f"{len(pieces)}" + (f", of several pieces: {several}" if several else "")),
    ]


def _pairs(problem: Problem) -> Rows:
    rows: Rows = []
    moving = sum(body.joint > 0 for body in problem.bodies)
    kept = _count(problem, "obstacles")
    total = moving * len(problem.plane_bodies)
    rows.append(
        (
            "body and obstacle",
            f"{kept} of {total} kept; {total - kept} are out of reach within the joint limits, for certain",
        )
    )
    links = len(problem.robot.links)
    checked = len(problem.robot.self_pairs)
    rows.append(
        (
            "link and link",
            f"{checked} of {links * (links - 1) // 2} checked; the others are neighbours, move together, "
            "are disabled by the SRDF or the scene, or touch always",
        )
    )
    if problem.unresolved:
        named = ", ".join(f"{a}-{b}" for a, b in problem.unresolved)
        rows.append(
            ("left to the certificate", f"{len(problem.unresolved)} link pairs whose outer bodies overlap: {named}")
        )
    rows.append(("bodies of links, in pairs", f"{_count(problem, 'self-collision')}"))
    return rows


def _size(problem: Problem) -> Rows:
    unknowns = (problem.waypoints - 2) * problem.robot.n
    compiled = {kernel.is_compiled for term in problem.terms for kernel in term.kernels.values()}
    how = "none needed" if not compiled else "compiled C" if compiled == {True} else "CasADi's interpreter"
    return [
        ("unknowns", f"{unknowns} = {problem.waypoints - 2} free waypoints × {problem.robot.n} joints"),
        ("looked at", f"{len(problem.samples.weight)} configurations between the waypoints"),
        ("distance", how),
    ]


def _settings(problem: Problem) -> Rows:
    rows: Rows = []
    for field in dataclasses.fields(PlannerSettings):
        value = getattr(problem.scene.planner, field.name)
        origin = "default" if value == field.default else "scene"
        rows.append((field.name, f"{value:g}{UNITS.get(field.name, '')} ({origin})"))
    return rows


def _count(problem: Problem, name: str) -> int:
    term: Clearance | None = next((term for term in problem.terms if term.name == name), None)
    return len(term.pairs) if term else 0


def _numbers(values: np.ndarray) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in values) + "]"
