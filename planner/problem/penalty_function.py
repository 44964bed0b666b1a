"""The problem's penalty as an external function of CasADi, its gradient and Hessian declared.

In: x as in `program`. Out: the penalty of its waypoints; the exact gradient; the exact Hessian or, in its place, the
Gauss-Newton curvature, one block of (q_k, d_k) for each stage. The three share one evaluation at each x; what the exact
Hessian has beyond the curvature takes another, on request.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from hdplan.scenes.array_types import Array, Rows

if TYPE_CHECKING:
    from hdplan.planner.problem.problem import Problem
    from hdplan.planner.problem.terms import MotionPenalty


def places(n: int, waypoints: int) -> Rows:
    """Indices in x (M, n) of the waypoints between the ends; the steps that follow them have indices larger by n."""
    return 3 * n * np.arange(1, waypoints - 1)[:, None] + np.arange(n)


class PenaltyFunction:
    """The penalty of a problem. It holds functions that CasADi itself does not keep alive.

    CasADi takes an exception in them for a point where the function is not defined, and tries others. Who sets `stop`
    hurries a solver to its end, as none can be interrupted: from the time that it says so, or that an evaluation fails,
    nothing is evaluated any more, and the last values are returned everywhere. The failure is kept in `error`.
    """

    def __init__(self, problem: Problem, exact: bool) -> None:
        """Take a problem, and whether the Hessian is exact."""
        self.problem, self.exact = problem, exact
        self.stop: Callable[[], bool] | None = None
        self.error: BaseException | None = None
        self._last: tuple[bytes, MotionPenalty] | None = None
        self._stopped = False
        n, count = len(problem.start), problem.waypoints
        self._places, size = places(n, count), n * (3 * count - 4)
        block, first = np.arange(2 * n), self._places[:, :1]
        row, column = (first + np.tile(block, 2 * n)).ravel(), (first + np.repeat(block, 2 * n)).ravel()
        x, scalar = ca.Sparsity.dense(size, 1), ca.Sparsity.dense(1, 1)
        place = (first + block).ravel().tolist()  # of steps too: of what is absent CasADi takes no second derivative
        gradient = ca.Sparsity.triplet(1, size, [0] * len(place), place)
        hessian = ca.Sparsity.triplet(size, size, row.tolist(), column.tolist())
        second = _External("jac_jac_penalty", (x, scalar, gradient), (hessian, ca.Sparsity(size, 1)), self._hessian)
        slope = _External("jac_penalty", (x, scalar), (gradient,), self._gradient, second)
        self.function = _External("penalty", (x,), (scalar,), self._value, slope)

    size = 0  # of its parameters

    @property
    def stopped_at(self) -> Array | None:
        """The x of the last evaluation, if nothing was evaluated after it."""
        return np.frombuffer(self._last[0]) if self._stopped and self._last is not None else None

    def _at(self, x: Array) -> MotionPenalty:
        key, problem, last = x.tobytes(), self.problem, self._last
        if last is not None and (self._stopped or key == last[0]):
            return last[1]
        try:
            self._stopped = last is not None and self.stop is not None and self.stop()
            if last is None or not self._stopped:
                last = self._last = key, problem.penalty(self._positions(x))
        except BaseException as error:
            if last is None or self.stop is None:
                raise
            self._stopped, self.error = True, error
        return last[1]

    def _positions(self, x: Array) -> Array:
        return np.vstack([self.problem.start, x[self._places], self.problem.goal])

    def _value(self, x: Array) -> Array:
        return np.array([self._at(x).cost])

    def _gradient(self, x: Array) -> Array:
        slope = self._at(x).gradient[1:-1]
        return np.hstack([slope, np.zeros_like(slope)]).ravel()

    def _hessian(self, x: Array) -> Array:
        """The block between q_k and q_{k+1} is written at stage k, with δq_{k+1} = δq_k + δd_k."""
        found, n = self._at(x), self._places.shape[1]
        diagonal, coupling = found.diagonal, found.coupling
        if self.exact and not self._stopped:
            second_order = self.problem.second_order(self._positions(x))
            diagonal, coupling = diagonal + second_order[0], coupling + second_order[1]
        ahead = coupling[1:-1]  # q_{k+1} (rows) with q_k
        blocks = np.zeros((len(self._places), 2 * n, 2 * n))
        blocks[:, :n, :n] = diagonal[1:-1]
        blocks[:-1, :n, :n] += ahead + ahead.transpose(0, 2, 1)
        blocks[:-1, n:, :n] = ahead
        blocks[:-1, :n, n:] = ahead.transpose(0, 2, 1)
        return blocks.ravel()


class _External(ca.Callback):
    """A function of x in Python, with a declared derivative; CasADi hands derivatives the earlier results too."""

    def __init__(
        self,
        name: str,
        given: Sequence[ca.Sparsity],
        found: Sequence[ca.Sparsity],
        fill: Callable[[Array], Array],
        derivative: _External | None = None,
    ) -> None:
        ca.Callback.__init__(self)
        self.given, self.found, self.fill, self.derivative = given, found, fill, derivative
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.given)

    def get_n_out(self) -> int:
        return len(self.found)

    def get_sparsity_in(self, index: int) -> ca.Sparsity:
        return self.given[index]

    def get_sparsity_out(self, index: int) -> ca.Sparsity:
        return self.found[index]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, given: Sequence[memoryview], found: Sequence[memoryview]) -> int:
        """Through buffers: converting to CasADi's own matrices would cost more than the work."""
        np.frombuffer(found[0])[:] = self.fill(np.frombuffer(given[0]))
        return 0

    def has_jacobian(self) -> bool:
        return self.derivative is not None

    def get_jacobian(
        self, name: str, inames: Sequence[str], onames: Sequence[str], opts: Mapping[str, object]
    ) -> ca.Function:
        assert self.derivative is not None
        return self.derivative

    def has_jac_sparsity(self, output: int, index: int) -> bool:
        """Without it CasADi would take the Hessian for dense, and need seconds to color it."""
        return self.derivative is not None

    def get_jac_sparsity(self, output: int, index: int, symmetric: bool) -> ca.Sparsity:
        assert self.derivative is not None
        return self.derivative.found[index]
