"""The handle of what is selected, in the browser's scene: viser's, as large in the picture however far away it is."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdplan.planner.view.drawing.camera import FOV
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import read_only
from hdplan.scenes.poses import Pose

SIZE = 90.0  # [px] of its arms
LOW_WINDOW = 600.0  # [px] height of a window in which the arms are long
STILL = 1e-6  # [m], and of a rotation's entries
GRIPS = read_only(  # in arms: its middle, along each axis, and between two
    np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0) for z in (0.0, 0.5, 1.0) if not x * y * z])
)


def add_handle(server: Any, number: int, pose: Pose, turning: bool) -> Any:
    """Draw the handle of this number at a pose, and return it; one that does not turn moves alone."""
    x, y, z, w = pose.quaternion_xyzw
    return server.scene.add_transform_controls(
        f"/handle/{number}",
        scale=SIZE,
        fixed=True,
        line_width=4.0,
        position=pose.position,
        wxyz=(w, x, y, z),
        depth_test=False,
        disable_rotations=not turning,
    )


def is_moved(pose: Pose, place: Pose) -> bool:
    """True if a handle's pose is not the place where it was put, as far as browsers can tell: one that is pressed and
    let go stays."""
    return bool(np.abs(pose.matrix - place.matrix).max() > STILL)


def handle_points(pose: Pose, eye: Array) -> Array:
    """Return points (k, 3) all over the handle at a pose, as large as it is from `eye` (3,) in a low window."""
    place = pose.matrix
    arm = 2.0 * np.tan(0.5 * FOV) * SIZE / LOW_WINDOW * np.linalg.norm(place[:3, 3] - eye)
    return np.asarray(place[:3, 3] + arm * GRIPS @ place[:3, :3].T)


def pose_of(handle: Any) -> Pose:
    """Return the pose of a handle of viser. Raises InputError for values that are not a pose."""
    px, py, pz = (float(value) for value in handle.position)
    w, x, y, z = (float(value) for value in handle.wxyz)
    norm = float(np.sqrt(w * w + x * x + y * y + z * z))
    if not (np.isfinite([px, py, pz, norm]).all() and norm > 0.0):
        raise InputError(f"handle: found position ({px:g}, {py:g}, {pz:g}), quaternion {(x, y, z, w)}: no pose")
    return Pose((px, py, pz), (x / norm, y / norm, z / norm, w / norm))
