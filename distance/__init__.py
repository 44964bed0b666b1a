"""Signed distances of convex bodies: smooth (``hdsdf`` and its fast versions) and exact (``signed_distance``).

Positive = separated, everywhere; of unions (``ConvexBody.union``), too. ``hdsdf`` is the NumPy reference;
``hdsdf_compiled`` (CasADi, generated C) and ``hdsdf_batch`` (JAX) evaluate the same for many poses, with gradient and
Hessian; ``hdsdf_function`` is it as a CasADi Function. Each is loaded, with what it needs of CasADi, JAX and coal, on
first use.
"""

from __future__ import annotations

from hdplan.scenes.lazy_imports import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
