"""Words in the scene, each above what it names: one that would lie over another is raised above it, one that would be
cut off at the edge of the picture is moved back into it.

Where words lie depends on the camera, and all browsers see the same ones: they are arranged for one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import viser
from numpy.typing import ArrayLike

from hdplan.scenes.array_types import Array

SCALE = 0.9  # of the font, by the browser's own
LABELS: Any = {"font_screen_scale": SCALE, "anchor": "bottom-center"}  # above what they name, to both sides of it
FONT = 12.0 * SCALE  # [px] of the font, the same near and far
WIDE, HIGH = 0.5, 1.6  # a letter's width and a line's height with its rim, by the font's size


@dataclass(frozen=True, eq=False)
class Picture:
    """A browser's picture, in which points have places [px]: x to the right and y downward from its middle."""

    eye: Array  # (3,)
    turn: Array  # (3, 3) columns: to the right, downward, ahead
    fov: float  # [rad] of its height
    width: float  # [px]
    height: float  # [px]

    @classmethod
    def of(cls, camera: viser.CameraHandle) -> Picture:
        """Return the picture of a browser's camera."""
        w, x, y, z = camera.wxyz.tolist()
        turn = pin.Quaternion(w, x, y, z).toRotationMatrix()
        return cls(np.array(camera.position), turn, camera.fov, camera.image_width, camera.image_height)

    def places(self, points: Array) -> tuple[Array, Array]:
        """Return the places (k, 2) [px] at which points (k, 3) appear, and the size of a metre there (k,) [px/m]; zeros
        for points behind the eye."""
        right, down, ahead = ((points - self.eye) @ self.turn).T
        seen = np.maximum(ahead, 0.0)
        scale = np.divide(0.5 * self.height / np.tan(0.5 * self.fov), seen, out=np.zeros(len(points)), where=seen > 0.0)
        return np.stack([right, down], axis=1) * scale[:, None], scale


class Label:
    """Words above a place."""

    def __init__(self, server: viser.ViserServer, name: str, text: str = "", visible: bool = False) -> None:
        """Send the node `name`."""
        self._node = server.scene.add_label(name, text, visible=visible, **LABELS)
        self._shift = np.zeros(3)
        self._place = np.zeros(3)

    @property
    def text(self) -> str:
        """The words."""
        return str(self._node.text)

    @text.setter
    def text(self, text: str) -> None:
        self._node.text = text

    @property
    def visible(self) -> bool:
        """True if they are shown."""
        return bool(self._node.visible)

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._node.visible = visible

    @property
    def place(self) -> Array:
        """The place (3,) that they name [m]."""
        return self._place

    @place.setter
    def place(self, place: ArrayLike) -> None:
        self._place = np.asarray(place, dtype=np.float64)
        self._node.position = self._place + self._shift

    def shift(self, by: Array) -> None:
        """Show the words beside their place, by (3,) [m]."""
        if np.abs(by - self._shift).max() > 0.0:
            self._shift = by
            self._node.position = self._place + by


def arrange(labels: Sequence[Label], picture: Picture) -> None:
    """Shift those labels that are shown to where they can be read in a picture; the first ones stay where they are."""
    shown = [label for label in labels if label.visible]
    if not shown or not picture.height:
        return
    places, scale = picture.places(np.array([label.place for label in shown]))
    sizes = FONT * np.array([[WIDE * (len(label.text) + 1), HIGH] for label in shown])
    shifts = apart(places, sizes, 0.5 * picture.width)
    for label, shift, pixels in zip(shown, shifts, scale.tolist(), strict=True):
        label.shift(picture.turn[:, :2] @ shift / pixels if pixels > 0.0 else np.zeros(3))


def apart(places: Array, sizes: Array, edge: float) -> Array:
    """Return the shifts (k, 2) [px] by which no two labels lie over each other, and none beyond the edges at ±`edge`
    where it has room between them; each label, of some width and height (k, 2), stands with the middle of its lower
    side at its place (k, 2), y downward. Of two labels the later one gives way, upward."""
    taken: list[tuple[float, float, float, float]] = []  # left, right, top, bottom
    shifts = np.zeros_like(places)
    for number, ((x, y), (wide, high)) in enumerate(zip(places.tolist(), sizes.tolist(), strict=True)):
        room = max(edge - 0.5 * wide, 0.0)
        middle = min(max(x, -room), room) if abs(x) <= edge else x  # what it names may be out of the picture
        left, right, bottom = middle - 0.5 * wide, middle + 0.5 * wide, y
        beside = [each for each in taken if left < each[1] and each[0] < right]
        while tops := [top for *_, top, low in beside if bottom - high < low and top < bottom]:
            bottom = min(tops)
        taken.append((left, right, bottom - high, bottom))
        shifts[number] = middle - x, bottom - y
    return shifts
