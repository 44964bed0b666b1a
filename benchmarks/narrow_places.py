"""Narrow places of our own for `narrow`: a Panda's hand in a tube, two doors that are not in line, from gap to gap; and
the same kinds at random, and random clutter, each scene by its number."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import may_end

FINGERS = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}
LEVEL = [0.0, 0.5 * float(np.pi), 0.0]  # rpy of a hand that points along x, its width level
UPRIGHT = [0.5 * float(np.pi), 0.0, 0.5 * float(np.pi)]  # its width upright
BACK = [0.0, -1.3, 0.0, -2.9, 0.0, 2.4, 0.785]  # an arm folded back
IN_A_GAP = [1.6719, -0.845, -1.3298, -2.3108, -2.7319, 2.2794, 1.2143]  # the hand between two bars, upright
RANDOM = ("random_tube", "random_doors", "random_bars", "random_clutter")
DRAWN = 2000  # configurations at most, to find two in clutter that are free


def places() -> dict[str, dict[str, Any]]:
    """Return the scenes, as files have them, by their names."""
    return {
        "panda_tube": _scene(_tube(0.21, 0.5), BACK, [0.69, 0.0, 0.5], LEVEL),
        "two_doors": _scene(_doors(0.26, 0.15, -0.15), BACK, [0.75, -0.15, 0.45], LEVEL),
        "bars": _scene(_bars(0.1), IN_A_GAP, [0.62, -0.1, 0.45], UPRIGHT),
    }


def random_place(kind: str, number: int) -> dict[str, Any]:
    """Return a scene of one of the RANDOM kinds, as files have it: the same for the same number."""
    rng = np.random.default_rng((RANDOM.index(kind), number))
    if kind == "random_tube":
        height = float(rng.uniform(0.35, 0.65))
        tube = _tube(float(rng.uniform(0.21, 0.24)), height)
        return _scene(tube, BACK, [float(rng.uniform(0.6, 0.7)), 0.0, height], LEVEL)
    if kind == "random_doors":
        width, (first, second) = float(rng.uniform(0.24, 0.3)), rng.uniform(-0.15, 0.15, 2).tolist()
        goal = [float(rng.uniform(0.66, 0.75)), second, float(rng.uniform(0.4, 0.5))]
        return _scene(_doors(width, first, second), BACK, goal, LEVEL)
    if kind == "random_bars":
        apart = float(rng.uniform(0.095, 0.12))
        gap = apart * float(rng.integers(-2, 3))
        goal = [float(rng.uniform(0.56, 0.66)), gap, float(rng.uniform(0.35, 0.6))]
        return _scene(_bars(apart), BACK, goal, UPRIGHT)
    scene = _scene(_clutter(rng), BACK, [0.5, 0.0, 0.5], LEVEL)
    scene["start"], scene["goal"] = _free_ends(scene, rng)
    return scene


def _scene(
    obstacles: list[dict[str, Any]], start: list[float], position: list[float], rpy: list[float]
) -> dict[str, Any]:
    return {
        "hdplan": 1,
        "robot": {"name": "panda", "locked": FINGERS},
        "obstacles": obstacles,
        "start": {"joints": start},
        "goal": {"pose": {"link": "panda_hand_tcp", "position": position, "rpy": rpy}},
    }


def _box(
    name: str, size: list[float], position: list[float], rpy: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> dict[str, Any]:
    return {"name": name, "shape": {"type": "box", "size": size}, "pose": {"position": position, "rpy": list(rpy)}}


def _tube(width: float, height: float) -> list[dict[str, Any]]:
    """Twelve planks around a free prism of that width, along x: the hand is 20.4 cm wide."""
    thick = 0.01
    out, side = 0.5 * (width + thick), (width + thick) * float(np.tan(np.pi / 12))
    found = []
    for k, turn in enumerate((np.pi / 12 + np.pi / 6 * np.arange(12)).tolist()):
        position = [0.7, out * float(np.cos(turn)), height + out * float(np.sin(turn))]
        found.append(_box(f"plank{k}", [0.3, thick, side], position, (turn, 0.0, 0.0)))
    return found


def _doors(width: float, first: float, second: float) -> list[dict[str, Any]]:
    """Two walls across x, each with a door of that width around a y."""
    found, half = [], 0.5 * width
    for wall, (x, middle) in enumerate(((0.35, first), (0.6, second))):
        left, right = middle + half, middle - half
        found += [
            _box(f"left{wall}", [0.02, 0.8 - left, 1.0], [x, 0.5 * (0.8 + left), 0.5]),
            _box(f"right{wall}", [0.02, 0.8 + right, 1.0], [x, 0.5 * (right - 0.8), 0.5]),
            _box(f"above{wall}", [0.02, width, 0.35], [x, middle, 0.825]),
        ]
    return found


def _bars(apart: float) -> list[dict[str, Any]]:
    """Six upright bars, 2 cm thick: the hand, which is 6.4 cm thick, fits through a gap upright."""
    shape = {"type": "capsule", "radius": 0.01, "length": 1.0}
    return [
        {"name": f"bar{k}", "shape": shape, "pose": {"position": [0.55, y, 0.5]}}
        for k, y in enumerate((apart * np.arange(-2.5, 3.0)).tolist())
    ]


def _clutter(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Boxes, cylinders, capsules and balls around the arm, turned at random."""
    found = []
    for k in range(int(rng.integers(8, 25))):
        a, b, c = rng.uniform(0.04, 0.25, 3).tolist()
        shape: dict[str, Any] = [
            {"type": "box", "size": [a, b, c]},
            {"type": "cylinder", "radius": 0.4 * a, "length": b},
            {"type": "capsule", "radius": 0.3 * a, "length": 2.0 * b},
            {"type": "sphere", "radius": 0.5 * a},
        ][int(rng.integers(4))]
        turn, out, height = rng.uniform((-np.pi, 0.35, 0.0), (np.pi, 0.85, 1.0)).tolist()
        position = [out * float(np.cos(turn)), out * float(np.sin(turn)), height]
        rpy = rng.uniform(-np.pi, np.pi, 3).tolist()
        found.append({"name": f"thing{k}", "shape": shape, "pose": {"position": position, "rpy": rpy}})
    return found


def _free_ends(scene: dict[str, Any], rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    """Two random configurations that the certificate finds free."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.yaml"
        file.write_text(yaml.safe_dump(scene))
        certifier = Certifier(Setup.of(hdplan.load_scene(file)))
    drawn = (q for q in certifier.robot.draw(rng, DRAWN) if may_end(certifier, q))
    start, goal = ({"joints": next(drawn).tolist()} for _ in range(2))
    return start, goal
