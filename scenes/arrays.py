"""Arrays given to a controller, checked before anything is commanded: each error names the argument, the joint, the
value and what is allowed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

LARGEST_STATE = 1e6  # [rad], [m] or [s], and per second: beyond it, the step of one period is lost in rounding


def joint_numbers(name: str, values: ArrayLike, joints: Sequence[str], *, positive: bool = False) -> Array:
    """Return one number for each joint (n,), at most LARGEST_STATE in size; above 0 if `positive`. Raises
    InputError."""
    found = as_numbers(values)
    if found is None:
        raise InputError(f"{name}: expected {len(joints)} numbers, one for each of {', '.join(joints)}")
    least = np.finfo(np.float64).tiny if positive else -LARGEST_STATE
    if found.shape == (len(joints),) and found.min() >= least and found.max() <= LARGEST_STATE:  # false for nan
        return found
    if found.shape != (len(joints),):
        raise InputError(f"{name}: shape {found.shape}, expected ({len(joints)},), one for each of {', '.join(joints)}")
    at = int(np.argmin((found >= least) & (found <= LARGEST_STATE)))
    allowed = f"more than 0, up to {LARGEST_STATE:g}" if positive else f"{-LARGEST_STATE:g} to {LARGEST_STATE:g}"
    raise InputError(f"{name}: found {found[at]:g} for joint '{joints[at]}', allowed is {allowed}")


def as_numbers(values: object) -> Array | None:
    """Return an array of numbers as floats; None for anything else: texts and booleans are not numbers."""
    try:
        found = np.asarray(values)
    except ValueError:  # rows of different lengths
        return None
    return found.astype(np.float64, copy=False) if found.dtype.kind in "iuf" else None


def quadratic(objective: object, joints: Sequence[str]) -> tuple[Array, Array]:
    """Return a task's H (n, n), symmetric and positive definite, and f (n,). Raises InputError."""
    try:
        hessian, linear = (as_numbers(part) for part in objective)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        hessian = linear = None
    if hessian is None or linear is None:
        raise InputError("task.objective: expected H and f, a matrix and a row of numbers")
    linear = joint_numbers("task.objective: f", linear, joints)
    count = len(joints)
    if hessian.shape != (count, count):
        raise InputError(f"task.objective: H of shape {hessian.shape}, expected ({count}, {count})")
    if not np.abs(hessian - hessian.T).max() <= 1e-9 * np.abs(hessian).max() < np.inf:  # false for nan
        raise InputError("task.objective: H is not symmetric and finite, so the task has no optimal velocity")
    try:
        np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        raise InputError("task.objective: H is not positive definite, so the task has no optimal velocity") from None
    return np.ascontiguousarray(hessian), linear
