"""The penalties that `penalties` compares, and how they behave where faces are nearly parallel: a box above a wall, and
the corridor.

At gamma 12 the HD-SDF has almost the kinks of a plain maximum of minima, with the same planes: this tells apart what
smoothness does from what exactness does.

Between parallel faces the exact distance has a kink: the witness point jumps from one edge of the face to the other,
and with it the gradient. The HD-SDF weighs all vertices and normals, so its gradient turns smoothly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import hdplan
from hdplan.distance.bodies import ConvexBody
from hdplan.planner.collision.broad_phase import body_pairs
from hdplan.planner.collision.euclidean import FclPairs
from hdplan.planner.collision.halfspace_bodies import from_shape
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box

VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "hdsdf": {"distance": "hdsdf"},
    "hdsdf, gamma 12": {"distance": "hdsdf", "gamma": 12},
    "fcl": {"distance": "fcl"},
}
EDGE, GAP, MARGIN = 0.1, 0.01, 0.02  # [m] of the box, from it to the wall, and of the penalty
TILTS = np.deg2rad(np.linspace(-3.0, 3.0, 601))
MOTION = 1e-3  # [rad] length of a small motion in joint space
MOTIONS = 10  # of them for each configuration
DEEP = 0.005  # [m] of the 20 that the margin has
MUCH = 0.2  # relative change that is counted
ON_THE_WAY = (0.0, 0.25, 0.5, 0.75, 1.0)


def varied(scene: Scene, name: str, **settings: Any) -> Scene:
    """The scene with a variant's settings, and others."""
    planner: Any = replace(scene.planner, **VARIANTS[name], **settings)
    return replace(scene, planner=planner)


@dataclass(frozen=True)
class Tilted:
    """A box tilted above a wall."""

    tilts: Array  # (T,) [rad]
    torques: dict[str, Array]  # penalty -> (T,) dD/dtilt about the box's centre [m/rad]


def tilted() -> Tilted:
    """Tilt a box above a wall by up to 3 degrees either way."""
    bodies = (LinkBody("box", 1, ConvexBody.box((EDGE, EDGE, EDGE))),)
    walls = (from_shape("wall", Box((4 * EDGE, 4 * EDGE, EDGE)), np.eye(4)),)
    pairs = body_pairs(bodies, walls, [(0, 0)], MARGIN, np.zeros((2, 0), dtype=np.bool_))
    rows = np.zeros((len(TILTS), 2, 12))
    rows[:, :, [0, 4, 8]] = 1.0
    rows[:, 1, [0, 2, 6, 8]] = np.column_stack([np.cos(TILTS), np.sin(TILTS), -np.sin(TILTS), np.cos(TILTS)])
    rows[:, 1, 11] = EDGE + GAP
    kinematics = KinematicsBatch(rows, np.zeros((len(TILTS), 0, 6)))
    settings = PlannerSettings()
    distances: dict[str, PairDistance] = {
        "hdsdf": HdsdfPairs(pairs, settings.gamma, settings.shaping_length),
        "hdsdf, gamma 12": HdsdfPairs(pairs, 12, settings.shaping_length),
        "fcl": FclPairs(pairs, bodies, walls),
    }
    index, none = np.arange(len(TILTS)), np.zeros(len(TILTS), dtype=np.int64)
    torques = {}
    for name, distance in distances.items():
        _, wrench, _ = distance(kinematics, index, none)
        torques[name] = (wrench[:, 3:] - np.cross(rows[:, 1, 9:], wrench[:, :3]))[:, 1]
    return Tilted(TILTS, torques)


def table() -> str:
    """Markdown: how much the gradient of the penalty of one configuration, Σ D dD/dq, changes in a small motion, at
    configurations from the straight line to the penalties' motions whose exact depth is at least DEEP.

    Twice: with the links' outer bodies, and with their boxes, whose faces come to be parallel to the walls.
    """
    scene = hdplan.load_scene("panda_corridor")
    rows = []
    for bodies in ("fitted", "box"):
        problems = {name: hdplan.build(varied(scene, name, link_bodies=bodies)) for name in VARIANTS}
        found = {name: hdplan.plan(problem.scene, robot=problem.robot) for name, problem in problems.items()}
        straight = next(seeds(problems["fcl"], 0))
        ends = [result.trajectory.positions for result in found.values()]
        configurations = np.concatenate([straight + part * (end - straight) for end in ends for part in ON_THE_WAY])
        configurations = configurations[problems["fcl"].depth(configurations) >= DEEP]
        shifts = np.random.default_rng(0).normal(size=(MOTIONS, *configurations.shape))
        shifts *= MOTION / np.linalg.norm(shifts, axis=-1, keepdims=True)
        for name, problem in problems.items():
            before = _gradients(problem, configurations)
            after = np.array([_gradients(problem, configurations + shift) for shift in shifts])
            changes = 100 * np.linalg.norm(after - before, axis=-1) / np.linalg.norm(before, axis=-1)
            middle, high, most = np.quantile(changes, [0.5, 0.95, 1.0])
            row = {
                "panda_corridor, links as": bodies,
                "penalty": name,
                "iterations": found[name].iterations,
                f"change of the gradient in {MOTION:g} rad: median": f"{middle:.1f} %",
                "95 %": f"{high:.1f} %",
                "largest": f"{most:.0f} %",
                f"above {100 * MUCH:.0f} %": f"{100 * np.mean(changes > 100 * MUCH):.2f} %",
            }
            rows.append(row)
    return markdown_text(rows)


def _gradients(problem: Problem, configurations: Array) -> Array:
    """The gradient (B, n) of the penalty of each configuration."""
    kinematics = problem.kinematics.evaluate(configurations)
    result = np.zeros_like(configurations)
    for term in problem.terms.pairs:
        inside = term.inside(kinematics)
        np.add.at(result, inside.sample, inside.distance[:, None] * inside.gradient)
    return result
