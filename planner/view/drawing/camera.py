"""A camera's place: the subject framed, from where obstacles hide least of it, and which obstacles stand in
the way of an eye. Pure geometry in the world frame, [m]; z is up.

Obstacles are taken as the boxes that bound them in their own frames, clouds as several: what counts as hidden may
be seen through an obstacle that is not convex; a point inside such a box counts as seen.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import read_only

FOV = np.deg2rad(45.0)  # [rad] of the picture's height: less distorted than the browser's own 75°
FRAME_SIZE = 1.12  # size of the picture by that of what is framed
AZIMUTHS = read_only(np.deg2rad(np.arange(0.0, 360.0, 15.0)))
ELEVATIONS = read_only(np.deg2rad([18.0, 28.0, 40.0, 55.0]))
USUAL = (np.deg2rad(-40.0), np.deg2rad(28.0))  # from the front and the side, a little from above
FORESHORTENED, UNUSUAL = 0.4, 0.15  # cost of a path seen end-on, and of looking from behind, as a share hidden
IN_THE_WAY = 0.02  # share of the points of interest that an obstacle hides before it fades
SIDES = {  # name: azimuth and elevation [rad]; the robot's front is towards x
    "front": (0.0, 0.0),
    "side": (-0.5 * np.pi, 0.0),
    "top": (np.pi, 0.4999 * np.pi),  # not quite: straight down, up would be any direction
}


class View(NamedTuple):
    """A camera."""

    eye: Array  # (3,)
    target: Array  # (3,)


@dataclass(frozen=True, eq=False)
class Boxes:
    """B boxes."""

    rotation: Array  # (o, 3, 3) the axes of each obstacle's boxes, as columns
    center: Array  # (B, 3)
    half: Array  # (B, 3) half edges
    count: Rows  # (o,) of each obstacle's boxes, which come one obstacle after the other

    @classmethod
    def around(cls, bounds: Sequence[Array], poses: Sequence[Array]) -> Boxes:
        """Take the boxes of obstacles between lower and upper corners (b, 2, 3) in frames that stand at `poses`
        (4, 4)."""
        count = np.array([len(each) for each in bounds], dtype=np.int64)
        corners = np.concatenate([np.empty((0, 2, 3)), *bounds])
        frames = np.array(poses, dtype=np.float64).reshape(-1, 4, 4)
        placed = np.repeat(frames, count, axis=0)
        middle = np.einsum("bij,bj->bi", placed[:, :3, :3], corners.mean(axis=1)) + placed[:, :3, 3]
        return cls(frames[:, :3, :3], middle, 0.5 * (corners[:, 1] - corners[:, 0]), count)

    @property
    def _first(self) -> Rows:
        """The rows at which the boxes of each obstacle begin (o,)."""
        return np.cumsum(self.count) - self.count

    def lowest(self) -> Array:
        """Return the heights (B,) of their lowest points."""
        upward = np.repeat(np.abs(self.rotation[:, 2]), self.count, axis=0)
        return np.asarray(self.center[:, 2] - np.einsum("bj,bj->b", upward, self.half))

    def hide(self, eye: Array, points: Array) -> NDArray[np.bool_]:
        """Return (k, B) whether a box is crossed on the way from `eye` (3,) to points (k, 3) behind it."""
        enters, leaves = self._crossed(eye, points)
        return np.asarray((enters < leaves) & (leaves > 0.0) & (leaves < 1.0))

    def before(self, eye: Array, points: Array) -> NDArray[np.bool_]:
        """Return (o,) whether an obstacle is met on the way from `eye` (3,) to one of points (k, 3)."""
        if not len(self.count):
            return np.zeros(0, dtype=bool)
        enters, leaves = self._crossed(eye, points)
        met = ((enters < leaves) & (leaves > 0.0) & (enters < 1.0)).any(axis=0)
        return np.asarray(np.logical_or.reduceat(met, self._first))

    def _crossed(self, eye: Array, points: Array) -> tuple[Array, Array]:
        """Return the places where each box is entered and left (k, B) on the way from `eye` (3,), at 0, to points (k,
        3), at 1, and beyond."""
        entered, left = [np.empty((len(points), 0))], [np.empty((len(points), 0))]
        ends = np.cumsum(self.count)
        for rotation, begin, end in zip(self.rotation, (ends - self.count).tolist(), ends.tolist(), strict=True):
            middle, half = (self.center[begin:end] - eye) @ rotation, self.half[begin:end]
            along = (points - eye) @ rotation  # one for all boxes of an obstacle, of which a cloud has thousands
            inverse = 1.0 / np.where(np.abs(along) < 1e-12, 1e-12, along)
            enters, leaves = np.full((2, len(points), end - begin), [[[-np.inf]], [[np.inf]]])
            for axis in range(3):
                passes, depth = (
                    np.outer(inverse[:, axis], middle[:, axis]),
                    np.outer(abs(inverse[:, axis]), half[:, axis]),
                )
                np.maximum(enters, passes - depth, out=enters)
                np.minimum(leaves, passes + depth, out=leaves)
            entered.append(enters)
            left.append(leaves)
        return np.concatenate(entered, axis=1), np.concatenate(left, axis=1)

    def in_the_way(self, eye: Array, points: Array) -> NDArray[np.bool_]:
        """Return (o,) whether an obstacle hides so much of points (k, 3) that it should be seen through."""
        if not len(self.count):
            return np.zeros(0, dtype=bool)
        hidden = np.logical_or.reduceat(self.hide(eye, points), self._first, axis=1)
        return np.asarray(hidden.mean(axis=0) > IN_THE_WAY)


def best_view(whole: Array, interest: Array, path: Array, boxes: Boxes, aspect: float) -> View:
    """Return the view that frames all points (k, 3) and a path (m, 3), from where boxes hide least of what is of
    interest (i, 3) and the path is seen from its side; of equal ones the most usual. `aspect` is the picture's width by
    its height."""
    framed = np.concatenate([whole, path])
    best, least = view_from(*USUAL, framed, aspect), np.inf
    for azimuth, elevation in DIRECTIONS:
        cost = _unusual(azimuth, elevation)
        if cost >= least:
            break  # all that follow are less usual still
        view = view_from(azimuth, elevation, framed, aspect)
        cost += FORESHORTENED * _foreshortening(view, path)
        if cost < least:  # what is hidden takes longest to be found
            cost += float(boxes.hide(view.eye, interest).any(axis=1).mean())
        if cost < least:
            best, least = view, cost
    return best


def _unusual(azimuth: float, elevation: float) -> float:
    """Return the cost of a direction [rad] that is not the usual one."""
    return UNUSUAL * float(0.5 - 0.5 * np.cos(azimuth - USUAL[0]) + abs(elevation - USUAL[1]))


DIRECTIONS = sorted(itertools.product(AZIMUTHS.tolist(), ELEVATIONS.tolist()), key=lambda each: _unusual(*each))


def view_from(azimuth: float, elevation: float, points: Array, aspect: float) -> View:
    """Return the nearest view from a direction [rad], counted from x and from the horizon, that has all points (k, 3)
    in the picture, with some room."""
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    ahead = -towards
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    x, y, z = ((points - middle) @ np.stack([right, np.cross(right, ahead), ahead], axis=1)).T
    tangent = np.tan(0.5 * FOV) / FRAME_SIZE
    across, far = _fitted(x, z, tangent * aspect)
    upward, far_enough = _fitted(y, z, tangent)
    target = middle + across * right + upward * np.cross(right, ahead)
    return View(target + max(far, far_enough, 0.1) * towards, target)


def _fitted(side: Array, depth: Array, tangent: float) -> tuple[float, float]:
    """Return the sideways position and the distance back of an eye that sees points at `side` (k,) and `depth` (k,)
    within an opening of `tangent` to both sides: |side − x| ≤ tangent · (depth + back)."""
    right, left = float((side - tangent * depth).max()), float((-side - tangent * depth).max())
    return 0.5 * (right - left), 0.5 * (right + left) / tangent


def _foreshortening(view: View, path: Array) -> float:
    """Return the share of a path's length that is lost by looking along it, 0 to 1."""
    steps = np.diff(path, axis=0)
    length = float(np.linalg.norm(steps, axis=1).sum())
    if length <= 0.0:
        return 0.0
    ahead = (view.target - view.eye) / np.linalg.norm(view.target - view.eye)
    return 1.0 - float(np.linalg.norm(steps - np.outer(steps @ ahead, ahead), axis=1).sum()) / length
