"""A term of the user's own, in CasADi alone: a cost, a penalty or a hard constraint at each waypoint between the ends.

In: expressions of a waypoint q_k (n,) and of the step d_k to the next. Out: a term like any other, in C, with CasADi's
derivatives. With h = 1/(N − 1) and the sums over the N − 2 waypoints between the ends

    cost           h Σ_k c(q_k, d_k), beside the smoothness and in its unit
    penalty        h Σ_k ½ |max(s r(q_k, d_k), 0)|², weighed as contacts are, so that r falls to 0 or below
    constraint     lower ≤ g(q_k, d_k) ≤ upper: the same with r the excess over bounds that are a band tighter, and no
                   motion counts as found that leaves the bounds themselves

The scale s is what one unit of r or g counts as in metres inside a margin [m/unit].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.compiled_solver import not_in_c
from hdplan.planner.problem.hinge import BAND
from hdplan.planner.problem.kinks import place_of_jump
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.symbolic_place import SymbolicMotion
from hdplan.planner.problem.terms import MotionPenalty, Term
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError

KINDS = ("cost", "penalty", "constraint")
UNLIKE_STEPS, STEP_ROOM = 0.1, 0.01  # steps at which a term is tried: of the line, and [rad or m] beyond it
CONSTRAINT_ROUNDING = 1e-9  # by which a constraint may be exceeded, in its unit: rounding


@dataclass(frozen=True)
class OwnTerm:
    """A term of your own in symbols, for `plan` and `Problem.with_term`.

    Args:
        name: for messages.
        each: of a waypoint (n,) and the step to the next (n,), both casadi.MX in the order of the robot's joints: a
            scalar for a cost, else a column.
        kind: "cost", "penalty" or "constraint".
        lower: of a constraint, a number or one for each row.
        upper: likewise.
        scale: of a penalty or constraint, the metres inside a margin that one unit counts for [m/unit].
    """

    name: str
    each: Callable[[ca.MX, ca.MX], ca.MX]
    kind: str = "cost"
    lower: ArrayLike = -np.inf
    upper: ArrayLike = np.inf
    scale: float = 1.0

    def of(self, n: int, own: Rows, activation: float, line: Array) -> WrittenTerm:
        """The term of a problem with n planned joints, which are `own` among the model's; `activation` [m] as the
        planner's. The term is evaluated on a motion `line` (N, n). Raises InputError for a term that is not allowed."""
        q, step = ca.MX.sym("q", n), ca.MX.sym("step", n)
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"term: name must be a text, found {self.name!r}")
        if self.kind not in KINDS:
            raise self._wrong(f"kind must be one of {', '.join(KINDS)}, found {self.kind!r}")
        if isinstance(self.scale, bool) or not (isinstance(self.scale, (int, float)) and 0 < self.scale < np.inf):
            raise self._wrong(f"scale must be a positive number, found {self.scale!r}")
        try:
            value = self.each(q, step)
        except RuntimeError as error:  # CasADi's, of sizes that do not fit
            raise self._wrong(f"{str(error).strip().splitlines()[-1]} (q and step have {n} rows)") from None
        except Exception as error:  # of the user's own function
            raise self._wrong(f"the function of (q, step) fails with {type(error).__name__}: {error}") from error
        column = isinstance(value, ca.MX) and value.is_column() and value.numel() > 0
        if not column or (self.kind == "cost" and not value.is_scalar()):
            found = f"casadi.MX of shape {value.shape}" if isinstance(value, ca.MX) else repr(value)
            raise self._wrong(f"a {'scalar' if self.kind == 'cost' else 'column'} casadi.MX is expected, found {found}")
        known = {q.__hash__(), step.__hash__()}
        if strange := [symbol.name() for symbol in ca.symvar(value) if symbol.__hash__() not in known]:
            raise self._wrong(f"depends on '{strange[0]}'; allowed are the waypoint and the step")
        if called := not_in_c(value):
            raise self._wrong(f"calls '{called[0]}', which CasADi cannot write to C")
        low, high = (
            self._bound(name, given, value.numel()) for name, given in (("lower", self.lower), ("upper", self.upper))
        )
        if not np.all(low < high):
            raise self._wrong("lower must be below upper")
        residual, band = self._residual(ca.densify(value), low, high)
        try:
            term = WrittenTerm(
                self,
                ca.Function("own", [q, step], [residual]),
                ca.Function("own_value", [q, step], [ca.densify(value)]),
                own,
                activation,
                band,
                (low, high),
            )
        except RuntimeError:
            raise self._wrong("is not twice differentiable: CasADi finds no second derivatives") from None
        if not all(np.isfinite(part).all() for part in term.rows(line)):
            raise self._wrong("is not twice differentiable along the straight line: its derivatives are not finite")
        if (place := term.jump(line)) is not None:
            raise self._wrong(
                f"is not twice differentiable: its value or gradient jumps at {place:.3g} of the straight line; "
                "allowed is a smooth expression, such as sqrt(x**2 + 1e-4) for |x|, or kind 'penalty' for max(x, 0)"
            )
        return term

    def _residual(self, value: ca.MX, low: Array, high: Array) -> tuple[ca.MX, Array]:
        """Residuals to be kept small, in metres, and of a constraint the band in which it sets in (m,)."""
        if self.kind == "cost":
            return value, np.zeros(1)
        if self.kind == "penalty":
            return self.scale * ca.fmax(value, 0), np.zeros(value.numel())
        room = np.where(np.isfinite(high - low), 0.25 * (high - low), np.inf)
        band = np.minimum(room, BAND / self.scale)
        above = ca.fmax(value - ca.DM(np.minimum(high - band, 1e300)), 0)
        below = ca.fmax(ca.DM(np.maximum(low + band, -1e300)) - value, 0)
        return self.scale * (above + below), self.scale * band

    def _bound(self, name: str, given: ArrayLike, size: int) -> Array:
        try:
            bound = np.broadcast_to(np.asarray(given, dtype=np.float64), size)
        except (TypeError, ValueError):
            raise self._wrong(f"{name}: a number or {size} of them are expected, found {given!r}") from None
        if np.isnan(bound).any():
            raise self._wrong(f"{name}: NaN")
        return bound

    def _wrong(self, words: str) -> InputError:
        return InputError(f"term '{self.name}': {words}")


class WrittenTerm(Term):
    """One's own term, as a part of a problem."""

    def __init__(
        self,
        definition: OwnTerm,
        residual: ca.Function,
        value: ca.Function,
        own: Rows,
        activation: float,
        band: Array,
        bounds: tuple[Array, Array],
    ) -> None:
        """Take the residual, of a cost the cost itself, and differentiate it."""
        self.definition, self.name, self.own, self.activation, self.band, self.bounds = (
            definition,
            definition.name,
            own,
            activation,
            band,
            bounds,
        )
        self.is_cost = definition.kind == "cost"
        q, step = residual.mx_in()
        found = residual(q, step)
        self.each = ca.Function("own_term", [q, step], [found if self.is_cost else ca.sumsqr(found) / 2])
        (total,) = self.each.call([q, step])
        slope = ca.horzcat(*(ca.gradient(total, part).T for part in (q, step)))
        hessian = ca.vertcat(*(ca.jacobian(slope, part).T for part in (q, step)))
        jacobian = ca.horzcat(*(ca.jacobian(found, part) for part in (q, step)))
        square = hessian if self.is_cost else jacobian.T @ jacobian
        results = [total, slope, square, hessian, found, value(q, step)]
        self._run = RowFunction(ca.Function("own_rows", [q, step], [ca.densify(part) for part in results]))

    def rows(self, positions: Array) -> list[Array]:
        """Rows of the M waypoints between the ends: value (M, 1), slope, curvature, Hessian, residual, what was
        written."""
        inner, step = positions[1:-1], np.diff(positions, axis=0)[1:]
        every = np.arange(len(inner))
        return self._run([inner, step], [every, every])

    def jump(self, line: Array) -> float | None:
        """Place in [0, 1] of a straight line (N, n) at which the term jumps or has a kink, with steps that turn round
        and are longer than those of the line; None if none is found."""
        n, step = line.shape[1], UNLIKE_STEPS * (line[-1] - line[0]) + STEP_ROOM

        def sampled(points: Array) -> tuple[Array, Array, Array]:
            every = np.arange(len(points))
            value, slope, _, hessian, *_ = self._run([points[:, :n], points[:, n:]], [every, every])
            return value, slope, hessian.reshape(-1, 2 * n, 2 * n)

        return place_of_jump(sampled, np.append(line[0], -step), np.append(line[-1], 0.9 * step))

    def excess(self, positions: Array) -> float:
        """Excess of a motion over the bounds of a constraint at its waypoints, in the constraint's unit; 0 if not."""
        value = self.rows(positions)[-1]
        return float(np.maximum(self.bounds[0] - value, value - self.bounds[1]).max(initial=0.0))

    def planned(self, positions: Array) -> MotionPenalty:
        """The term at waypoints (N, n) of the planned joints."""
        count, n = positions.shape
        value, slope, curvature, *_, residual, _ = self.rows(positions)
        blocks, depth = curvature.reshape(-1, 2 * n, 2 * n), np.zeros(count - 1)
        if self.is_cost:
            blocks = _semidefinite(blocks)
        elif self.definition.kind == "constraint":  # a penalty alone keeps no motion from being clear
            used = self.activation * residual / self.band + np.maximum(residual - self.band, 0)
            depth[1:] = used.max(axis=1, initial=0.0)
        gradient = np.zeros((count, n))
        gradient[1:-1], ahead = slope[:, :n] - slope[:, n:], slope[:, n:]
        gradient[2:] += ahead
        diagonal, coupling = _to_waypoints(blocks, count)
        weight = 1 / (count - 1)
        return MotionPenalty(
            weight * float(value.sum()), weight * gradient, weight * diagonal, weight * coupling, depth
        )

    def planned_second_order(self, positions: Array) -> tuple[Array, Array]:
        """Second-order part of the Hessian beyond the curvature."""
        count, n = positions.shape
        _, _, curvature, hessian, *_ = (part.reshape(len(part), -1) for part in self.rows(positions))
        first, second = (part.reshape(-1, 2 * n, 2 * n) for part in (curvature, hessian))
        diagonal, coupling = _to_waypoints(second - (_semidefinite(first) if self.is_cost else first), count)
        return diagonal / (count - 1), coupling / (count - 1)

    def over_motion(self, positions: Array, kinematics: Kinematics) -> MotionPenalty:
        """The penalty on waypoints (N, m) of all joints of the model."""
        found, m = self.planned(positions[:, self.own]), positions.shape[1]
        spread = np.zeros((len(positions), m))
        spread[:, self.own] = found.gradient
        diagonal, coupling = (self._spread(part, m) for part in (found.diagonal, found.coupling))
        return MotionPenalty(found.cost, spread, diagonal, coupling, found.depth)

    def second_order(self, kinematics: KinematicsBatch, samples: Samples) -> None:
        """Zero: the term has no part at the samples."""

    def second_order_over_motion(self, positions: Array, kinematics: Kinematics) -> tuple[Array, Array]:
        """The second-order residual with all joints of the model."""
        diagonal, coupling = self.planned_second_order(positions[:, self.own])
        return self._spread(diagonal, positions.shape[1]), self._spread(coupling, positions.shape[1])

    def written_over_motion(self, motion: SymbolicMotion) -> ca.MX:
        """Sum of the term over the waypoints."""
        rows = self.own.tolist()
        return self.written(motion.first[rows, :], motion.step[rows, :])

    def written(self, first: ca.MX, step: ca.MX) -> ca.MX:
        """Sum of the term over intervals of the planned joints (n, N − 1)."""
        count = first.shape[1]
        return ca.sum2(self.each.map(count - 1)(first[:, 1:], step[:, 1:])) / count

    def _spread(self, blocks: Array, m: int) -> Array:
        result = np.zeros((len(blocks), m, m))
        result[np.ix_(np.arange(len(blocks)), self.own, self.own)] = blocks
        return result


def _to_waypoints(blocks: Array, count: int) -> tuple[Array, Array]:
    """Map from second derivatives by q_k and d_k = q_{k+1} − q_k (N − 2, 2 n, 2 n) to blocks (N, n, n) and
    (N − 1, n, n) of the waypoints."""
    n = blocks.shape[1] // 2
    own, mixed, ahead = blocks[:, :n, :n], blocks[:, n:, :n], blocks[:, n:, n:]
    diagonal, coupling = np.zeros((count, n, n)), np.zeros((count - 1, n, n))
    diagonal[1:-1] = own - mixed - mixed.swapaxes(1, 2) + ahead
    diagonal[2:] += ahead
    coupling[1:] = mixed - ahead
    return diagonal, coupling


def _semidefinite(blocks: Array) -> Array:
    """The nearest positive semidefinite matrices."""
    values, vectors = np.linalg.eigh(0.5 * (blocks + blocks.swapaxes(1, 2)))
    result: Array = (vectors * np.maximum(values, 0.0)[:, None]) @ vectors.swapaxes(1, 2)
    return result


def hard_constraints(terms: Sequence[Term]) -> list[WrittenTerm]:
    """Return the terms that are constraints."""
    return [term for term in terms if isinstance(term, WrittenTerm) and term.definition.kind == "constraint"]


def left(terms: Sequence[Term], positions: Array) -> tuple[str, ...]:
    """Return the constraints among terms, in words, that a motion (N, n) violates, and by how much."""
    found = [(term.name, term.excess(positions)) for term in hard_constraints(terms)]
    return tuple(
        f"term '{name}': its bounds are exceeded by {excess:.3g} at a waypoint"
        for name, excess in found
        if not excess <= CONSTRAINT_ROUNDING
    )
