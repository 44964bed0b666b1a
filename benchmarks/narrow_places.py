"""Narrow places of our own for `narrow`: a Panda's hand in a tube, two doors that are not in line, from gap to gap."""

from __future__ import annotations

from typing import Any

import numpy as np

FINGERS = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}
LEVEL = [0.0, 0.5 * float(np.pi), 0.0]  # rpy of a hand that points along x, its width level
UPRIGHT = [0.5 * float(np.pi), 0.0, 0.5 * float(np.pi)]  # its width upright
BACK = [0.0, -1.3, 0.0, -2.9, 0.0, 2.4, 0.785]  # an arm folded back
IN_A_GAP = [1.6719, -0.845, -1.3298, -2.3108, -2.7319, 2.2794, 1.2143]  # the hand between two bars, upright


def places() -> dict[str, dict[str, Any]]:
    """Return the scenes, as files have them, by their names."""
    return {
        "panda_tube": _scene(_tube(), BACK, [0.69, 0.0, 0.5], LEVEL),
        "two_doors": _scene(_doors(), BACK, [0.75, -0.15, 0.45], LEVEL),
        "bars": _scene(_bars(), IN_A_GAP, [0.62, -0.1, 0.45], UPRIGHT),
    }


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


def _tube() -> list[dict[str, Any]]:
    """Twelve planks around a free prism 21 cm wide, along x: the hand is 20.4 cm wide."""
    width, thick = 0.21, 0.01
    out, side = 0.5 * (width + thick), (width + thick) * float(np.tan(np.pi / 12))
    found = []
    for k, turn in enumerate((np.pi / 12 + np.pi / 6 * np.arange(12)).tolist()):
        position = [0.7, out * float(np.cos(turn)), 0.5 + out * float(np.sin(turn))]
        found.append(_box(f"plank{k}", [0.3, thick, side], position, (turn, 0.0, 0.0)))
    return found


def _doors() -> list[dict[str, Any]]:
    """Two walls across x, with doors 26 cm wide, the second 30 cm to the right of the first."""
    found = []
    for wall, (x, middle) in enumerate(((0.35, 0.15), (0.6, -0.15))):
        left, right = middle + 0.13, middle - 0.13
        found += [
            _box(f"left{wall}", [0.02, 0.8 - left, 1.0], [x, 0.5 * (0.8 + left), 0.5]),
            _box(f"right{wall}", [0.02, 0.8 + right, 1.0], [x, 0.5 * (right - 0.8), 0.5]),
            _box(f"above{wall}", [0.02, 0.26, 0.35], [x, middle, 0.825]),
        ]
    return found


def _bars() -> list[dict[str, Any]]:
    """Upright bars with gaps 8 cm wide, through which the hand fits upright: it is 6.4 cm thick."""
    shape = {"type": "capsule", "radius": 0.01, "length": 1.0}
    return [
        {"name": f"bar{k}", "shape": shape, "pose": {"position": [0.55, y, 0.5]}}
        for k, y in enumerate((0.1 * np.arange(-2.5, 3.0)).tolist())
    ]
