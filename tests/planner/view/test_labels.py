"""Words in the scene: none lies over another, and none is cut off at the edge of a picture that has room for it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hdplan.planner.view.drawing.camera import FOV
from hdplan.planner.view.drawing.labels import FONT, HIGH, WIDE, Picture, apart, arrange
from hdplan.planner.view.viewer import Viewer


def boxes(places: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Left, right, top and bottom (k, 4) of words that stand on their places."""
    left, right = places[:, 0] - 0.5 * sizes[:, 0], places[:, 0] + 0.5 * sizes[:, 0]
    return np.stack([left, right, places[:, 1] - sizes[:, 1], places[:, 1]], axis=1)


def over(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """True if two boxes lie over each other, by more than rounding."""
    across = min(one[1], other[1]) - max(one[0], other[0])
    return bool(min(across, min(one[3], other[3]) - max(one[2], other[2])) > 1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_no_two_labels_lie_over_each_other_and_the_first_stays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, sizes = rng.uniform(-100.0, 100.0, (8, 2)), rng.uniform([20.0, 10.0], [150.0, 20.0], (8, 2))
    shifts = apart(places, sizes, 300.0)
    found = boxes(places + shifts, sizes)
    assert not any(over(found[i], found[k]) for i in range(8) for k in range(i))
    assert (shifts[0] == 0.0).all()
    assert (shifts[:, 0] == 0.0).all()  # all have room: only upward
    assert (shifts[:, 1] <= 0.0).all()


def test_labels_apart_stay_where_they_are_and_none_is_cut_off() -> None:
    places, sizes = np.array([[-250.0, 0.0], [0.0, 100.0], [290.0, 0.0], [400.0, 0.0]]), np.full((4, 2), [80.0, 15.0])
    shifts = apart(places, sizes, 300.0)
    assert (shifts[[0, 1, 3]] == 0.0).all()  # the last one names what is out of the picture itself
    assert boxes(places + shifts, sizes)[2, 1] == 300.0


def test_labels_of_a_scene_make_room_in_a_picture_and_go_back(viewer: Viewer) -> None:
    """From far away all that they name is in one place."""
    viewer.show(0.5)
    words = [label for label in viewer.stage.words if label.visible]
    assert len(words) == 3  # start, goal and the closest pair
    sizes = FONT * np.array([[WIDE * len(label.text), HIGH] for label in words])

    def lie_over_each_other(height: float) -> int:
        ahead, eye = np.array([0.6, 0.8, 0.0]), np.array([-36.0, -48.0, 0.0])
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        picture = Picture(eye, np.stack([right, np.cross(ahead, right), ahead], axis=1), float(FOV), height, height)
        before = [label.place.copy() for label in words]
        arrange(words, picture)
        np.testing.assert_array_equal([label.place for label in words], before)
        at = picture.places(np.array([label._node.position for label in words]))[0]
        found = boxes(at, sizes)
        return sum(over(found[i], found[k]) for i in range(3) for k in range(i))

    assert lie_over_each_other(300.0) == 0
    assert any(np.abs(label._node.position - label.place).max() > 0.1 for label in words)
    assert lie_over_each_other(1e6) == 0
    assert all((label._node.position == label.place).all() for label in words)
