"""The HD-SDF of two bodies for thousands of poses at once, in JAX: value, gradient and Hessian by both bodies' twists.

Runs on whatever device JAX finds. JAX is optional: it is imported on the first use of a distance.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.batch.tables import FARTHEST_POSITION, pair_tables
from hdplan.distance.body_distance import BodyDistance
from hdplan.distance.holder import check_gamma, resolve_shaping_length
from hdplan.distance.normals import check_witness_count, check_witnesses
from hdplan.distance.poses import check_poses
from hdplan.distance.unions import Body, pairs_of, pieces_of
from hdplan.scenes.errors import InputError
from hdplan.scenes.values import Choice, Whole, checked

Array = Any  # NumPy's or JAX's

DTYPES = ("float64", "float32")
MOST_WITNESSES = 1000  # with each pose
SHORTEST_SHAPING = {"float64": 1e-290, "float32": 1e-30}  # [m] with it, Phi maps the largest number < 0 to 0
SIZES = (2, 2, 1, 2)  # array axes of the rotations of A and of B, the offset, and the witnesses

# How many poses are evaluated at once: powers of two, as every number needs its own compilation.
FEWEST_POSES, MOST_POSES = 8, 8192  # in one call of the compiled function; fewer are padded, more go block by block
CPU_LANES = 128  # in its innermost loops: enough to vectorize, ...
CPU_NUMBERS = 2**16  # ... few enough that this many numbers stay in the cache
RESULTS = 12 * 13  # of every pair of pieces, kept until all are there
GPU_NUMBERS = 2**25  # a GPU needs many; this takes about 1 GB


@dataclass(frozen=True, eq=False, repr=False)
class BatchDistance(BodyDistance[Array]):
    """D of two bodies (Definition III.2) or unions at poses (..., 4, 4); leading axes broadcast.

    A lower bound of the signed distance in sign; ``separation`` D̃ (eq. (5)) is one in value, and has the sign of D
    even where D underflows. Made by ``hdsdf_batch``.

    NumPy arrays give NumPy arrays; if a pose is a JAX array, the results are JAX arrays that stay on the device. To use
    those in float64, enable it in JAX (``jax.enable_x64``); inside it is enabled anyway, and the setting outside is
    left unchanged. Positions are subtracted from each other before they are cast to ``dtype``: in float32 a touch may
    appear as a gap of up to 4 units in the last place of the bodies' extents and distance, wherever the origin is.

    Within JAX's transformations (``grad``, ``hessian``, ``jit``, ``vmap``, ``scan``, in any order) it is a function of
    the poses with derivatives in closed form to the second order; a third is refused. They are correct along rigid
    motions at every pose, aligned and touching ones included. D̃ has kinks, where its gradient is a mean of the
    one-sided ones; its second derivatives are left out (0), and so are derivatives by witnesses, which are held fixed.
    The results then have the precision of the poses, but are computed in ``dtype``; and as no error can be raised
    there, poses that are not rigid or not finite give NaN.

    The first call for an order of derivatives takes seconds to compile, and so does the first one for a number of poses
    within another power of two, up to 8192; pairs with equal numbers of vertices and normals share compiled code,
    whatever their shaping lengths.

    Raises InputError for poses and witnesses of another shape or number, not finite or, of poses, not rigid.
    """

    pairs: Any  # of pieces, ``unions.Pairs`` on the device
    numbers: int  # the most that one pair computes with at a pose
    gamma: int
    shaping_length: float  # [m]
    witness_count: int
    dtype: str  # "float64" or "float32"

    def __repr__(self) -> str:
        """Return its settings, and the device on which it runs, for display."""
        return f"<BatchDistance: gamma {self.gamma}, {self.dtype}, on {self.device}>"

    @property
    def device(self) -> str:
        """The device that it runs on, e.g. ``cpu`` or ``gpu: NVIDIA H100``."""
        (device,) = self.pairs[0].radii.devices()
        return device.platform if device.platform == "cpu" else f"{device.platform}: {device.device_kind}"

    def _evaluate(self, order: int, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None) -> list[Array]:
        import jax

        from hdplan.distance.batch.kernel import Places
        from hdplan.distance.batch.traced import Settings, traced
        from hdplan.distance.batch.unions import evaluate

        given = pose_a, pose_b, witnesses
        lanes = self._lanes(jax.default_backend())
        if any(isinstance(part, jax.core.Tracer) for part in given):
            settings = Settings(self.gamma, self.dtype, lanes, order)
            return traced(self.pairs, self.shaping_length, *given, self.witness_count, settings)
        units = check_witnesses(witnesses)
        check_witness_count(units.shape, self.witness_count)
        on_device = isinstance(pose_a, jax.Array) or isinstance(pose_b, jax.Array)
        numpy = jax.numpy if on_device else np
        with jax.enable_x64(True), np.errstate(over="ignore"):
            a, b = (_checked(*named) for named in (("pose_a", pose_a), ("pose_b", pose_b)))
            offset = numpy.asarray(b[..., :3, 3]) - numpy.asarray(a[..., :3, 3])  # before rounding to fewer digits
            parts = [a[..., :3, :3], b[..., :3, :3], offset, units]
            parts = [numpy.asarray(part, dtype=self.dtype) for part in parts]
            near = bool((abs(offset) <= FARTHEST_POSITION[self.dtype]).all())
        if not near:
            most = f"up to {FARTHEST_POSITION[self.dtype]:g} m"
            raise InputError(f"pose_b: found a body too far from the other, allowed in {self.dtype} is {most}")
        with jax.enable_x64(self.dtype == "float64"):
            shape = np.broadcast_shapes(*(part.shape[:-size] for part, size in zip(parts, SIZES, strict=True)))
            rows = [
                numpy.broadcast_to(part, shape + part.shape[-size:]).reshape(prod(shape), *part.shape[-size:])
                for part, size in zip(parts, SIZES, strict=True)
            ]
            length = np.asarray(self.shaping_length, dtype=self.dtype)

            def run(turn_a: Array, turn_b: Array, apart: Array, axes: Array, lanes: int) -> Any:
                places = Places(turn_a, turn_b, apart)
                return evaluate(self.pairs, length, places, axes, gamma=self.gamma, order=order, lanes=lanes)

            results = _in_blocks(run, rows, lanes, numpy)
            return [part.reshape(shape + part.shape[1:]) for part in results]

    def _lanes(self, backend: str) -> int:
        """Return the number of poses to evaluate at once, a power of two."""
        if backend == "cpu":
            return min(CPU_LANES, _power_of_two(CPU_NUMBERS // self.numbers))
        kept = RESULTS * sum(len(group.radii) for group in self.pairs)
        return _power_of_two(GPU_NUMBERS // max(self.numbers, kept))


def hdsdf_batch(
    body_a: Body,
    body_b: Body,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
    witness_count: int = 0,
    dtype: str = "float64",
) -> BatchDistance:
    """Return the distance of ``numpy_reference.hdsdf`` for these bodies, for thousands of poses at once.

    Args:
        witness_count: how many witness normals will be given with each pose.
        dtype: of the computation, ``float64`` or ``float32``; the latter is twice as fast on a CPU and resolves gaps
            down to about 1e-6 of the bodies' extents and their distance from each other, of up to 1e15 m each.

    Other arguments and errors as ``numpy_reference.hdsdf``; InputError too where JAX is not installed.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    dtype = checked(Choice(DTYPES), dtype, "dtype")
    witness_count = checked(Whole(0, MOST_WITNESSES), witness_count, "witness_count")
    if length < SHORTEST_SHAPING[dtype]:
        raise InputError(
            f"shaping_length: found {length:g} m, allowed in {dtype} is {SHORTEST_SHAPING[dtype]:g} m or more"
        )
    tables = [pair_tables(*pair, normals) for pair in pairs_of(body_a, body_b)]
    for name, body in (
        *(("body_a", piece) for piece in pieces_of(body_a)),
        *(("body_b", p) for p in pieces_of(body_b)),
    ):
        if (size := float(np.abs(body.vertices).max()) + body.radius) > FARTHEST_POSITION[dtype]:
            raise InputError(
                f"{name}: found a size of {size:g} m, allowed in {dtype} is up to {FARTHEST_POSITION[dtype]:g} m"
            )
    try:
        jax = importlib.import_module("jax")
    except ModuleNotFoundError:
        raise InputError("hdsdf_batch: needs jax, which is not installed: pip install jax") from None
    from hdplan.distance.batch.unions import stacked

    with jax.enable_x64(dtype == "float64"):
        pairs = stacked(jax.tree.map(lambda part: jax.numpy.asarray(part, dtype=dtype), tables))
    numbers = max(pair.numbers(witness_count) for pair in tables)
    return BatchDistance(pairs, numbers, int(gamma), length, witness_count, dtype)


def _checked(name: str, poses: ArrayLike) -> Array:
    """Return poses (..., 4, 4) that ``check_poses`` accepts, in float64: JAX's on their device, others as NumPy's."""
    jax = importlib.import_module("jax")
    if not isinstance(poses, jax.Array):
        return check_poses(name, poses)
    from hdplan.distance.batch.traced import all_rigid

    if poses.dtype.kind == "c":
        return check_poses(name, np.asarray(poses))
    array = poses.astype(np.float64)  # differences of narrower floats round, those of small integers wrap around
    if array.shape[-2:] != (4, 4) or not all_rigid(array):
        check_poses(name, np.asarray(array))  # the message says what is wrong
    return array


def _in_blocks(run: Callable[..., Any], rows: list[Array], lanes: int, numpy: Any) -> list[Array]:
    """Return the results of ``run`` for all rows, called for blocks of few different lengths."""
    count, most = len(rows[0]), max(MOST_POSES, lanes)
    found = []
    for start in range(0, max(count, 1), most):
        block = [part[start : start + most] for part in rows]
        missing = max(FEWEST_POSES, 1 << (len(block[0]) - 1).bit_length()) - len(block[0])
        if missing:
            fills = (np.eye(*x.shape[1:]) if x.ndim > 2 else np.ones(x.shape[1:]) for x in block)
            block = [
                numpy.concatenate([x, numpy.broadcast_to(fill.astype(x.dtype), (missing, *fill.shape))])
                for x, fill in zip(block, fills, strict=True)
            ]
        found.append(run(*block, lanes=min(lanes, len(block[0]))))
    return [numpy.concatenate([numpy.asarray(part) for part in parts])[:count] for parts in zip(*found, strict=True)]


def _power_of_two(number: int) -> int:
    """Return the largest power of two that is not larger, at least ``FEWEST_POSES``."""
    return max(FEWEST_POSES, 1 << (number.bit_length() - 1))
