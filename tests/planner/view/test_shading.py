"""Shading: no link vanishes on a light or a dark ground, neighbours differ, hues stay."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest

from hdplan.planner.robot.loading import load_robot
from hdplan.planner.view.drawing.shading import DARKEST, LIGHTEST, LUMA_STEP, luma_of, shade, two_toned
from hdplan.planner.view.drawing.skins import visual_skins
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene

ROUNDED = 1.0 / 255.0


@pytest.mark.parametrize("seed", range(50))
def test_colours_are_neither_white_nor_black_and_keep_their_hue(seed: int) -> None:
    rng = np.random.default_rng(seed)
    red, green, blue = (int(value) for value in rng.integers(0, 256, 3))
    lighter, darker = shade((red, green, blue), False), shade((red, green, blue), True)
    for shaded in (lighter, darker):
        assert DARKEST - ROUNDED <= luma_of(shaded) <= LIGHTEST + ROUNDED
        if max(shaded) - min(shaded) > 12:  # hardly any hue is lost in grey
            turn = colorsys.rgb_to_hsv(*shaded)[0] - colorsys.rgb_to_hsv(red, green, blue)[0]
            assert abs((turn + 0.5) % 1.0 - 0.5) < 0.03
    assert luma_of(lighter) - luma_of(darker) == pytest.approx(LUMA_STEP, abs=2 * ROUNDED)


def test_the_lighter_stays_the_lighter() -> None:
    grey = [luma_of(shade((value, value, value), False)) for value in range(256)]
    assert np.all(np.diff(grey) >= 0.0)


@pytest.mark.parametrize("name", ["panda_cage", "ur5_table"])
def test_links_that_follow_each_other_differ(name: str) -> None:
    scene: Scene = load_scene(name)
    robot = load_robot(scene.robot)
    skins, _ = visual_skins(robot, scene.robot)
    of_joint = {skin.joint: skin for skin in skins if skin.joint}
    again = {skin.joint: shaded for skin, shaded in zip(skins, two_toned(robot, skins), strict=True)}
    for joint, skin in of_joint.items():
        before = of_joint.get(int(robot.model.parents[joint]))
        if before is not None and before.color == skin.color:
            assert again[joint].color != again[before.joint].color
