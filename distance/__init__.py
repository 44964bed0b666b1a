"""Signed distances of convex bodies: smooth (``hdsdf`` and its fast versions) and exact (``signed_distance``).

Positive = separated, everywhere. ``hdsdf`` is the NumPy reference; ``hdsdf_compiled`` (CasADi, generated C) and
``hdsdf_batch`` (JAX) evaluate the same for many poses, with gradient and Hessian; ``hdsdf_function`` is it as a CasADi
Function. CasADi, JAX and coal are loaded only when something that needs them is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.holder import holder_maximum, holder_minimum, shaping
from hdplan.distance.normals import RUNGS
from hdplan.distance.reference import hdsdf, hdsdf_derivatives, separating_axis_distance, separation
from hdplan.distance.sat import Proximity

if TYPE_CHECKING:
    from hdplan.distance.batch import hdsdf_batch
    from hdplan.distance.fcl import fcl_distances
    from hdplan.distance.graph_distance import hdsdf_function
    from hdplan.distance.oracle import signed_distance, signed_distances
    from hdplan.distance.pair_distance import hdsdf_compiled

__all__ = [
    "RUNGS",
    "ConvexBody",
    "Proximity",
    "fcl_distances",
    "hdsdf",
    "hdsdf_batch",
    "hdsdf_compiled",
    "hdsdf_derivatives",
    "hdsdf_function",
    "holder_maximum",
    "holder_minimum",
    "separating_axis_distance",
    "separation",
    "shaping",
    "signed_distance",
    "signed_distances",
]

_HEAVY = {
    "hdsdf_batch": "batch",
    "hdsdf_compiled": "pair_distance",
    "hdsdf_function": "graph_distance",
    "fcl_distances": "fcl",
    "signed_distance": "oracle",
    "signed_distances": "oracle",
}


def __getattr__(name: str) -> Any:
    """Import the module of a heavy name when it is first asked for."""
    if name in _HEAVY:
        return getattr(import_module(f"{__name__}.{_HEAVY[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
