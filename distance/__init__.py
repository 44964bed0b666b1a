"""Signed distances of convex bodies: smooth (``hdsdf`` and its fast versions) and exact (``signed_distance``).

Positive = separated, everywhere; of unions (``ConvexBody.union``), too. ``hdsdf`` is the NumPy reference;
``hdsdf_compiled`` (CasADi, generated C) and ``hdsdf_batch`` (JAX) evaluate the same for many poses, with gradient and
Hessian; ``hdsdf_function`` is it as a CasADi Function. Each is loaded, with what it needs of CasADi, JAX and coal, when
it is asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdplan.scenes.lazy_imports import lazy_imports

if TYPE_CHECKING:
    from hdplan.distance.baselines.coal import signed_distance, signed_distances
    from hdplan.distance.baselines.fcl import fcl_distances
    from hdplan.distance.baselines.ground_truth import Proximity
    from hdplan.distance.batch.distance import hdsdf_batch
    from hdplan.distance.bodies import ConvexBody
    from hdplan.distance.holder import holder_maximum, holder_minimum, shaping
    from hdplan.distance.normals import RUNGS
    from hdplan.distance.numpy_reference.hdsdf import hdsdf, hdsdf_derivatives, separating_axis_distance, separation
    from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled
    from hdplan.distance.symbolic.graph_distance import hdsdf_function
    from hdplan.distance.unions import BodyUnion

__all__ = [
    "RUNGS",
    "BodyUnion",
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

__getattr__ = lazy_imports(
    __name__,
    {
        "BodyUnion": "unions",
        "ConvexBody": "bodies",
        "Proximity": "baselines.ground_truth",
        "RUNGS": "normals",
        "hdsdf": "numpy_reference.hdsdf",
        "hdsdf_batch": "batch.distance",
        "hdsdf_compiled": "symbolic.compiled_pair",
        "hdsdf_derivatives": "numpy_reference.hdsdf",
        "hdsdf_function": "symbolic.graph_distance",
        "fcl_distances": "baselines.fcl",
        "holder_maximum": "holder",
        "holder_minimum": "holder",
        "separating_axis_distance": "numpy_reference.hdsdf",
        "separation": "numpy_reference.hdsdf",
        "shaping": "holder",
        "signed_distance": "baselines.coal",
        "signed_distances": "baselines.coal",
    },
)


def __dir__() -> list[str]:
    """Public names."""
    return sorted(__all__)
