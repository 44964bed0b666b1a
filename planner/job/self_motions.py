"""Configurations of a redundant arm at a pose, close to each other along its self-motions.

In closed form the arm moves by itself with the joint that is held for it. Near a singularity others move far while that
one hardly does: at even values of it no configurations lie where the arm is narrowest. So between two values whose
configurations are far apart there are further ones, ever closer.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.kinematics.closed_form import ClosedForm
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.targets import PoseTarget

LARGEST_GAP = 0.3  # [rad] or [m] between neighbours at two values; a larger gap gets another value in the middle
VALUE_HALVINGS = 5  # of the distance of two values


def close_branches(form: ClosedForm, robot: Robot, target: PoseTarget, seed: Array, count: int) -> Array:
    """Return configurations (K, n) that bring a link to a target as `ClosedForm.branches` does, at `count` values of
    what is held; where that is one joint, at further ones between those whose configurations are far apart."""
    values = form.values(seed, count)
    rows = form.branches_at(robot, target, seed, values)
    held = form.planned[list(form.ways[0].held)]
    if len(held) != 1 or held[0] < 0:
        return rows
    values = np.sort(values[:, 0])
    for _ in range(VALUE_HALVINGS):
        first = np.flatnonzero(_far_apart(values, rows, int(held[0])))
        if not len(first):
            break
        between = 0.5 * (values[first] + values[first + 1])
        rows = np.concatenate([rows, form.branches_at(robot, target, seed, between[:, None])])
        values = np.insert(values, first + 1, between)
    return rows


def _far_apart(values: Array, rows: Array, held: int) -> Mask:
    """True (B − 1,) between two values (B,), in order, of a joint, of which one has a configuration far from all of the
    other, of rows (K, n)."""
    rows = rows[np.argsort(rows[:, held], kind="stable")]
    owner = np.searchsorted(0.5 * (values[1:] + values[:-1]), rows[:, held])
    counts = np.bincount(owner, minlength=len(values))
    each = np.full((len(values), max(1, counts.max()), rows.shape[1]), np.nan)
    each[owner, np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)] = rows
    apart = np.abs(each[:-1, :, None] - each[1:, None]).max(axis=3)
    far = ~(apart <= LARGEST_GAP)  # of those that are not there, too
    there = ~np.isnan(each[:, :, 0])
    return np.asarray(((far.all(axis=2) & there[:-1]) | (far.all(axis=1) & there[1:])).any(axis=1))
