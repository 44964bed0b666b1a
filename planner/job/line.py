"""A straight line of a link as constraints on the whole way, which the certificate proves at every instant."""

from __future__ import annotations

import numpy as np

from hdplan.planner.job.places import along, fixed_link, pose_of
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import Line
from hdplan.scenes.errors import InputError
from hdplan.scenes.path_constraints import PathConstraints, Relative, Within
from hdplan.scenes.targets import Goals, PoseTarget

SHORTEST_LINE = 1e-6  # [m]
LONGEST_LINE = 1.9  # [m] which `path.relative` must span to one side and the other


def as_constraints(stage: Line, robot: Robot, link: str, begins: Array, ends: Array) -> tuple[Goals, PathConstraints]:
    """Return the goal of a line of a link, from a pose to another (4, 4), and the constraints on its way.

    The link's origin stays in a box around the line that is larger by τ/√3 on every side, τ the tolerance: a corner of
    the box is τ away from the nearest point of the line, and everything else in it is closer. The link's rotation stays
    within its tolerance of the one at the beginning, as its rotation relative to a link that stands fast in the world.
    Raises InputError for a line that is too short or too long, and for a robot without such a link.
    """
    way = ends[:3, 3] - begins[:3, 3]
    length = float(np.linalg.norm(way))
    if not SHORTEST_LINE <= length <= LONGEST_LINE:
        raise InputError(f"line: is {length:.3g} m long; {SHORTEST_LINE:g} to {LONGEST_LINE:g} m are allowed")
    slack, turn = stage.position_tolerance / np.sqrt(3.0), stage.orientation_tolerance
    middle, box = begins.copy(), np.eye(4)
    middle[:3, 3] += 0.5 * way
    box[:3, :3], box[:3, 3] = along(way / length), middle[:3, 3]
    within = Within(link, (length + 2 * slack, 2 * slack, 2 * slack), pose_of(box))
    root, fixed = fixed_link(robot)
    place = pose_of(np.linalg.inv(fixed) @ middle)
    relative = Relative(link, root, place, min(1.0, 0.5 * length + slack), turn)
    target = PoseTarget(link, pose_of(ends), stage.position_tolerance, turn, field="goal")
    return Goals((target,)), PathConstraints(position=within, relative=relative)
