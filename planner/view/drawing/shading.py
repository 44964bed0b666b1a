"""Colours that distinguish the links of a robot, on a light ground as on a dark one.

Many robots are white all over, or black. Here every link keeps its hue, its lightness is kept away from that of the
ground, and links that follow each other differ in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.skins import Skin

DARKEST, LIGHTEST = 0.22, 0.80  # luma, of 1
LUMA_STEP = 0.16  # of luma from one link to the next
LUMA = (0.299, 0.587, 0.114)  # of red, green and blue (ITU-R BT.601)


def two_toned(robot: Robot, skins: Sequence[Skin]) -> tuple[Skin, ...]:
    """Return the skins in two tones: links at an odd number of joints from the base are the darker ones."""
    return tuple(replace(skin, color=shade(skin.color, _depth(robot, skin.joint) % 2 == 1)) for skin in skins)


def shade(color: Color, darker: bool) -> Color:
    """Return a colour of the same hue whose lightness lies between those of the grounds, in their lighter or darker
    part."""
    luma = luma_of(color)
    wanted = float(np.interp(luma, [0.0, 1.0], [DARKEST + LUMA_STEP, LIGHTEST])) - (LUMA_STEP if darker else 0.0)
    if wanted <= luma:
        scaled = np.array(color) * (wanted / luma)
    else:  # towards white, which keeps the hue where scaling would overflow
        scaled = 255.0 - (255.0 - np.array(color)) * ((1.0 - wanted) / (1.0 - luma))
    red, green, blue = (round(value) for value in scaled.tolist())
    return red, green, blue


def luma_of(color: Color) -> float:
    """Return the lightness of a colour, 0 to 1."""
    return float(np.dot(LUMA, color)) / 255.0


def _depth(robot: Robot, joint: int) -> int:
    """Return the number of joints between a joint and the world."""
    count = 0
    while joint > 0:
        joint, count = int(robot.model.parents[joint]), count + 1
    return count
