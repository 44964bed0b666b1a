"""The distance's three witnesses behind one interface: NumPy, CasADi (compiled) and JAX (batch)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from hdplan.distance.reference import hdsdf_derivatives, separation

Array = NDArray[np.float64]

NAMES = ("numpy", "casadi", "jax")


class Evaluation(NamedTuple):
    """D, D-tilde, and D's derivatives by twists of both bodies, of any shape before the last axes."""

    value: Array
    separation: Array
    gradient: Array
    hessian: Array


Evaluate = Callable[..., Evaluation]  # (pose_a, pose_b[, witnesses])


@cache
def evaluator(name: str, body_a, body_b, dtype: str = "float64", **settings) -> Evaluate:
    """Return the distance of a pair by the witness ``name``, built once per pair and settings.

    Settings: gamma, shaping_length, epsilon, normals; witness_count where witness normals are given.
    """
    if name == "numpy":
        return _numpy(body_a, body_b, **settings)
    if name == "casadi":
        module = pytest.importorskip("hdplan.distance.pair_distance")
        return _all_at_once(module.hdsdf_compiled(body_a, body_b, **settings))
    pytest.importorskip("jax")
    module = pytest.importorskip("hdplan.distance.batch")
    return _all_at_once(module.hdsdf_batch(body_a, body_b, dtype=dtype, **settings))


def _numpy(body_a, body_b, witness_count: int = 0, **settings) -> Evaluate:
    normals = {"normals": settings["normals"]} if "normals" in settings else {}

    def evaluate(pose_a, pose_b, witnesses=None) -> Evaluation:
        found = hdsdf_derivatives(body_a, pose_a, body_b, pose_b, witnesses=witnesses, **settings)
        least = separation(body_a, pose_a, body_b, pose_b, witnesses=witnesses, **normals)
        return Evaluation(found.value, least, found.gradient, found.hessian)

    return evaluate


def _all_at_once(distance) -> Evaluate:
    def evaluate(*poses_and_witnesses) -> Evaluation:
        return Evaluation(*(np.asarray(part, dtype=float) for part in distance.hessian(*poses_and_witnesses)))

    return evaluate
