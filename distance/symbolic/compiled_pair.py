"""The HD-SDF of two bodies for many poses, as generated C: value, gradient and Hessian by the twists of both bodies."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.body_distance import BodyDistance
from hdplan.distance.holder import check_gamma, resolve_shaping_length
from hdplan.distance.normals import candidate_normals, check_witness_count, check_witnesses
from hdplan.distance.poses import check_poses
from hdplan.distance.symbolic.graph_poses import relative_pose
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.distance.symbolic.unions import union_function
from hdplan.distance.unions import Body, pairs_of
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import made_once

SHAPES: tuple[tuple[int, ...], ...] = ((), (), (12,), (12, 12))  # of D, D̃, gradient and Hessian at one pose


class CompiledDistance(BodyDistance[Array]):
    """D of two bodies (Definition III.2) or unions at poses (..., 4, 4); leading axes broadcast.

    A lower bound of the signed distance in sign; ``separation`` D̃ (eq. (5)) is one in value, and has the
    sign of D where D itself is too small for a number. Rounding, and which derivatives exist where:
    ``numpy_reference``. Raises InputError, naming the pose, for poses of another shape, not finite or not rigid. Runs
    as C where a compiler is found, in CasADi's interpreter elsewhere; threads may share it. Made by ``hdsdf_compiled``.
    """

    def __init__(
        self,
        body_a: Body,
        body_b: Body,
        gamma: int,
        shaping_length: float,
        normals: str,
        witness_count: int,
    ) -> None:
        """Take the settings; the functions are built and compiled on first use."""
        self._settings = (body_a, body_b, gamma, normals, witness_count)
        self._functions: dict[int, RowFunction] = {}
        self._length = np.array([[shaping_length]])
        self._witness_count = witness_count

    def __repr__(self) -> str:
        """Return its bodies and settings, for display."""
        body_a, body_b, gamma, normals, _ = self._settings
        return f"<CompiledDistance of {body_a} and {body_b}: gamma {gamma}, normals {normals}>"

    def __getstate__(self) -> dict[str, Any]:
        """The state for another process, which compiles its own functions, or finds them in the cache."""
        return vars(self) | {"_functions": {}}

    def function(self, order: int) -> RowFunction:
        """Return the function of ``twist_function`` for many rows."""
        function = self._functions.get(order)
        if function is None:
            function = self._functions[order] = _row_function(*self._settings, order)
        return function

    def _evaluate(self, order: int, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None) -> list[Array]:
        units = check_witnesses(witnesses)
        check_witness_count(units.shape, self._witness_count)
        a, b = check_poses("pose_a", pose_a), check_poses("pose_b", pose_b)
        if a.ndim == b.ndim == units.ndim == 2:
            once = self.function(order).once(a.ravel(), b.ravel(), self._length[0], units.ravel())
            return [part.reshape(shape) for part, shape in zip(once, SHAPES, strict=False)]
        leading = [a.shape[:-2], b.shape[:-2], (), units.shape[:-2]]
        shape = np.broadcast_shapes(*leading)
        tables, rows = [], []
        for array, axes, width in zip(
            (a, b, self._length, units), leading, (16, 16, 1, 3 * self._witness_count), strict=True
        ):
            count = math.prod(axes)
            tables.append(array.reshape(count, width))
            rows.append(np.broadcast_to(np.arange(count).reshape(axes), shape).ravel())
        results = self.function(order)(tables, rows)
        return [part.reshape(shape + own) for part, own in zip(results, SHAPES, strict=False)]


def hdsdf_compiled(
    body_a: Body,
    body_b: Body,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
    witness_count: int = 0,
) -> CompiledDistance:
    """Return the distance of ``numpy_reference.hdsdf`` for these bodies, fast: for many poses, with derivatives.

    ``witness_count``: how many witness normals will be given with each pose. Other arguments and errors as
    ``numpy_reference.hdsdf``. Another shaping length needs no compilation.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    candidate_normals(normals, *pairs_of(body_a, body_b)[0])  # an unknown name is refused now
    return CompiledDistance(body_a, body_b, int(gamma), length, normals, witness_count)


def twist_function(body_a: Body, body_b: Body, gamma: int, normals: str, witness_count: int, order: int) -> ca.Function:
    """Return D, D̃ and, by order, the gradient (12) and the Hessian (12, 12) of D by both bodies' own twists.

    Inputs, row-major as NumPy lays them out: pose_a (16), pose_b (16), shaping_length [m], witnesses (3 W).

    With the relative motion of A·exp(ξ_a), B·exp(ξ_b) seen from A, exp(-ξ_a + X ξ_b - ½[ξ_a, X ξ_b] + …), X the adjoint
    of B's pose in A's frame, both follow from the derivatives by that motion.
    """
    flat_a, flat_b = ca.MX.sym("pose_a", 16), ca.MX.sym("pose_b", 16)
    length, witnesses = ca.MX.sym("shaping_length"), ca.MX.sym("witnesses", 3 * witness_count)
    rotation, position = relative_pose(ca.reshape(flat_a, 4, 4).T, ca.reshape(flat_b, 4, 4).T)
    relative = union_function(body_a, body_b, gamma, normals, witness_count, order)
    results = list(relative(rotation, position, length, ca.reshape(witnesses, 3, witness_count)))
    if order:
        adjoint = ca.blockcat([[rotation, ca.skew(position) @ rotation], [ca.MX.zeros(3, 3), rotation]])
        to_motion = ca.horzcat(-ca.MX.eye(6), adjoint)
        gradient = results[2]
        results[2] = to_motion.T @ gradient
    if order == 2:
        force, torque = ca.skew(gradient[:3]), ca.skew(gradient[3:])
        bracket = ca.blockcat([[ca.MX.zeros(3, 3), force], [force, torque]]) @ adjoint / 2  # d²/dξ_a dξ_b
        corner = ca.blockcat([[ca.MX.zeros(6, 6), bracket], [bracket.T, ca.MX.zeros(6, 6)]])
        results[3] = to_motion.T @ results[3] @ to_motion + corner
    names = ["distance", "separation", "gradient", "hessian"][: order + 2]
    inputs = ["pose_a", "pose_b", "shaping_length", "witnesses"]
    results = [ca.densify(result) for result in results]
    return ca.Function(f"hdsdf_order_{order}", [flat_a, flat_b, length, witnesses], results, inputs, names)


@made_once(256)
def _row_function(body_a: Body, body_b: Body, gamma: int, normals: str, witness_count: int, order: int) -> RowFunction:
    return RowFunction(twist_function(body_a, body_b, gamma, normals, witness_count, order))
