"""The HD-SDF of two bodies for thousands of poses at once, in JAX: value, gradient and Hessian by both bodies' twists.

Runs on whatever device JAX finds. JAX is optional: it is imported when a distance is asked for.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.batch_tables import Pair, pair_tables
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.holder import check_gamma, resolve_shaping_length
from hdplan.distance.normals import check_witnesses
from hdplan.scenes.errors import InputError, nearest

Array = Any  # NumPy's or JAX's

DTYPES = ("float64", "float32")

# How many poses are worked on at once, powers of two because every number is compiled for anew.
FEWEST, MOST = 8, 8192  # in one call of the compiled function; fewer are filled up, more go block by block
CPU_LANES = 128  # in its innermost loops: enough to vectorize, ...
CPU_NUMBERS = 2**16  # ... few enough that so many numbers stay in the cache
GPU_NUMBERS = 2**25  # a GPU wants many; this takes about 1 GB


@dataclass(frozen=True, eq=False)
class BatchDistance:
    """D of two bodies (Definition ``def:set2set-signed-distance``) at poses (..., 4, 4); leading axes broadcast.

    A lower bound of the signed distance in sign; ``separation`` D̃ (eq. ``eq:Dtilde``) is one in value, and has the sign
    of D where D itself is too small for a number. Made by ``hdsdf_batch``.

    NumPy arrays in give NumPy arrays out; if a pose is a JAX array, JAX arrays that stay on the device come out. For
    them to be of use in float64, JAX must be told to allow it (``jax.enable_x64``); in here it is told, and outside
    nothing is changed. The first call for an order of derivatives compiles for seconds, and so do the first ones for
    numbers of poses within another power of two, up to 8192; distances of pairs with equal numbers of vertices and
    normals share what is compiled, whatever their shaping lengths.

    Raises InputError for poses and witnesses of another shape, number or not finite in ``dtype``.
    """

    pair: Pair  # the bodies, on the device
    gamma: int
    shaping_length: float  # [m]
    witness_count: int
    dtype: str  # "float64" or "float32"

    @property
    def device(self) -> str:
        """What the distance runs on, e.g. ``cpu`` or ``gpu: NVIDIA H100``."""
        (device,) = self.pair.radii.devices()
        return device.platform if device.platform == "cpu" else f"{device.platform}: {device.device_kind}"

    def value(self, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return D and D̃ (...,) [m]. ``witnesses``: (..., W, 3) axes in B's frame, as many as the distance has."""
        distance, separation = self._run(0, pose_a, pose_b, witnesses)
        return distance, separation

    def gradient(
        self, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None = None
    ) -> tuple[Array, Array, Array]:
        """Return D, D̃ and the gradient of D (..., 12) by [v_a, ω_a, v_b, ω_b], each in the body's own frame."""
        distance, separation, gradient = self._run(1, pose_a, pose_b, witnesses)
        return distance, separation, gradient

    def hessian(
        self, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """Return D, D̃, the gradient of D and its Hessian (..., 12, 12) by the same twists ξ: D(pose·exp(ξ)).

        For gamma = 1 the Hessian has jumps; it is one of its one-sided values there.
        """
        distance, separation, gradient, hessian = self._run(2, pose_a, pose_b, witnesses)
        return distance, separation, gradient, hessian

    def _run(self, order: int, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None) -> list[Array]:
        import jax

        from hdplan.distance.batch_kernel import evaluate

        units = check_witnesses(witnesses)
        if units.shape[-2] != self.witness_count:
            raise InputError(f"witnesses: found {units.shape[-2]} at each pose, allowed are {self.witness_count}")
        on_device = isinstance(pose_a, jax.Array) or isinstance(pose_b, jax.Array)
        numpy = jax.numpy if on_device else np
        with jax.enable_x64(self.dtype == "float64"):
            parts = [self._pose("pose_a", pose_a, numpy), self._pose("pose_b", pose_b, numpy)]
            parts.append(numpy.asarray(units, dtype=self.dtype))
            shape = np.broadcast_shapes(*(part.shape[:-2] for part in parts))
            rows = [numpy.broadcast_to(x, shape + x.shape[-2:]).reshape(prod(shape), *x.shape[-2:]) for x in parts]
            length = np.asarray(self.shaping_length, dtype=self.dtype)
            run = partial(evaluate, self.pair, length, gamma=self.gamma, order=order)
            results = _in_blocks(run, rows, self._lanes(jax.default_backend()), numpy)
            return [part.reshape(shape + part.shape[1:]) for part in results]

    def _pose(self, name: str, pose: ArrayLike, numpy: Any) -> Array:
        with np.errstate(over="ignore"):
            matrix = numpy.asarray(pose, dtype=self.dtype)
        if matrix.shape[-2:] != (4, 4) or not bool(numpy.isfinite(matrix).all()):
            raise InputError(f"{name}: found an array of shape {matrix.shape}, allowed are finite arrays (..., 4, 4)")
        return matrix

    def _lanes(self, backend: str) -> int:
        """Return how many poses to work on at once, a power of two."""
        numbers = self.pair.numbers(self.witness_count)
        if backend == "cpu":
            return min(CPU_LANES, _power_of_two(CPU_NUMBERS // numbers))
        return _power_of_two(GPU_NUMBERS // numbers)


def hdsdf_batch(
    body_a: ConvexBody,
    body_b: ConvexBody,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
    witness_count: int = 0,
    dtype: str = "float64",
) -> BatchDistance:
    """Return the distance of ``reference.hdsdf`` for these bodies, for thousands of poses at once.

    Args:
        witness_count: how many witness normals will be given with each pose.
        dtype: of the computation, ``float64`` or ``float32``; the latter is twice as fast on a CPU and resolves gaps
            down to about 1e-6 of the size of the coordinates.

    Other arguments and errors as ``reference.hdsdf``; InputError too where JAX is not installed.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    if dtype not in DTYPES:
        raise InputError(f"dtype: unknown '{dtype}'{nearest(dtype, DTYPES)}, allowed are {', '.join(DTYPES)}")
    if not isinstance(witness_count, int) or witness_count < 0:
        raise InputError(f"witness_count: found {witness_count!r}, allowed is an integer >= 0")
    tables = pair_tables(normals, body_a, body_b)
    try:
        jax = importlib.import_module("jax")
    except ModuleNotFoundError:
        raise InputError("hdsdf_batch: needs jax, which is not installed: pip install hdplan[jax]") from None
    with jax.enable_x64(dtype == "float64"):
        pair = jax.tree.map(lambda part: jax.numpy.asarray(part, dtype=dtype), tables)
    return BatchDistance(pair, int(gamma), length, witness_count, dtype)


def _in_blocks(run: Callable[..., Any], rows: list[Array], lanes: int, numpy: Any) -> list[Array]:
    """Return the results of ``run`` for all rows, called for blocks of few different lengths."""
    count, most = len(rows[0]), max(MOST, lanes)
    found = []
    for start in range(0, max(count, 1), most):
        block = [part[start : start + most] for part in rows]
        missing = max(FEWEST, 1 << (len(block[0]) - 1).bit_length()) - len(block[0])
        if missing:
            more = (numpy.broadcast_to(numpy.eye(*x.shape[1:], dtype=x.dtype), (missing, *x.shape[1:])) for x in block)
            block = [numpy.concatenate(parts) for parts in zip(block, more, strict=True)]
        found.append(run(*block, lanes=min(lanes, len(block[0]))))
    return [numpy.concatenate([numpy.asarray(part) for part in parts])[:count] for parts in zip(*found, strict=True)]


def _power_of_two(number: int) -> int:
    """Return the largest power of two that is not larger, at least ``FEWEST``."""
    return max(FEWEST, 1 << (number.bit_length() - 1))
