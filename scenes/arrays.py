"""What a controller is given, checked before anything is commanded: each refusal names the argument, the joint, the
value and what is allowed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.scenes.errors import InputError

Array = NDArray[np.float64]

LARGEST = 1e6  # [rad], [m] or [s], and per second: beyond, a period's step is lost in rounding


def number(name: str, value: float, low: float = -LARGEST, high: float = LARGEST, *, above: bool = False) -> float:
    """Return a number from `low` (greater, if `above`) to `high`. Raises InputError."""
    try:
        found = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name}: found {value!r}, expected a number") from None
    if not low <= found <= high or (above and found == low):
        allowed = f"more than {low:g}, up to {high:g}" if above else f"{low:g} to {high:g}"
        raise InputError(f"{name}: found {found:g}, allowed is {allowed}")
    return found


def joint_numbers(name: str, values: ArrayLike, joints: Sequence[str], *, positive: bool = False) -> Array:
    """Return one number for each joint (n,), of a size up to LARGEST; above 0 if `positive`. Raises InputError."""
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: expected {len(joints)} numbers, one for each of {', '.join(joints)}") from None
    least = np.finfo(np.float64).tiny if positive else -LARGEST
    if found.shape == (len(joints),) and found.min() >= least and found.max() <= LARGEST:  # not so of nan
        return found
    if found.shape != (len(joints),):
        raise InputError(f"{name}: shape {found.shape}, expected ({len(joints)},), one for each of {', '.join(joints)}")
    at = int(np.argmin((found >= least) & (found <= LARGEST)))
    allowed = f"more than 0, up to {LARGEST:g}" if positive else f"{-LARGEST:g} to {LARGEST:g}"
    raise InputError(f"{name}: found {found[at]:g} for joint '{joints[at]}', allowed is {allowed}")


def quadratic(objective: object, joints: Sequence[str]) -> tuple[Array, Array]:
    """Return a task's H (n, n), symmetric and positive definite, and f (n,). Raises InputError."""
    try:
        hessian, linear = (np.asarray(part, dtype=np.float64) for part in objective)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InputError("task.objective: expected H and f, a matrix and a row of numbers") from None
    linear = joint_numbers("task.objective: f", linear, joints)
    count = len(joints)
    if hessian.shape != (count, count):
        raise InputError(f"task.objective: H of shape {hessian.shape}, expected ({count}, {count})")
    if not np.abs(hessian - hessian.T).max() <= 1e-9 * np.abs(hessian).max() < np.inf:  # not so of nan
        raise InputError("task.objective: H is not symmetric and finite, so that it has no least velocity")
    try:
        np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        raise InputError("task.objective: H is not positive definite, so that it has no least velocity") from None
    return np.ascontiguousarray(hessian), linear
