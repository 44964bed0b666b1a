"""Functions for CasADi graphs whose first and second derivatives are closed forms.

CasADi's own derivatives are wrong where vertices, axes or branches tie: they differentiate the branch that was taken,
while only the sum over all is smooth. So each order is a Function that supplies the next one as its Jacobian, and a
third is refused.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

# CasADi takes a custom Jacobian only where it cannot inline the Function and has no derivative of its own.
CLOSED_OPTIONS: dict[str, Any] = {
    "jac_penalty": 0,
    "never_inline": True,
    "enable_forward": False,
    "enable_reverse": False,
}


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """A scalar expression of some symbols with its derivatives; those by the last symbols may be left out where they
    are 0."""

    value: ca.MX
    slopes: Sequence[ca.MX]  # (1, k) by the k entries of each symbol, columnwise
    curvatures: Sequence[Sequence[ca.MX]]  # (k, l) of each slope by the entries of each symbol

    def __add__(self, other: ClosedForm) -> ClosedForm:
        """The sum of two of the same symbols."""
        rows = itertools.zip_longest(self.curvatures, other.curvatures, fillvalue=())
        return ClosedForm(
            self.value + other.value, _added(self.slopes, other.slopes), [_added(one, two) for one, two in rows]
        )


def _added(one: Sequence[ca.MX], other: Sequence[ca.MX]) -> list[ca.MX]:
    return [a + b for a, b in itertools.zip_longest(one, other, fillvalue=ca.MX(0))]


def closed_function(name: str, given: Sequence[ca.MX], form: ClosedForm, fixed: Sequence[ca.MX] = ()) -> ca.Function:
    """Return the Function (given …, fixed …) -> value, a scalar.

    Args:
        name: of the function.
        given: symbols by which it may be differentiated.
        form: what it returns, with its derivatives by all of `given`.
        fixed: symbols by which it has no derivative: CasADi sees 0.
    """
    every = [*given, *fixed]
    sizes = [symbol.numel() for symbol in every]
    differs = [*[True] * len(given), *[False] * len(fixed)]
    first = [*form.slopes, *(ca.MX(1, symbol.numel()) for symbol in fixed)]
    # CasADi passes results and, to second derivatives, arguments of values alone: not used, so not evaluated.
    ignored = [_unseen(part) for part in (form.value, *first)]
    blocks = []
    for i in range(len(every)):
        known = list(form.curvatures[i]) if i < len(given) else []
        blocks += known + [ca.MX(sizes[i], size) for size in [*sizes, 1][len(known) :]]
    seen = {symbol.__hash__() for block in blocks for symbol in ca.symvar(block)}
    second = ca.Function(
        f"jac_jac_{name}",
        [*(symbol if symbol.__hash__() in seen else _unseen(symbol) for symbol in every), *ignored],
        blocks,
        CLOSED_OPTIONS | {"is_diff_in": [*differs, *[False] * len(ignored)], "enable_jacobian": False},
    )
    options = CLOSED_OPTIONS | {"is_diff_in": [*differs, False], "custom_jacobian": second}
    slope = ca.Function(f"jac_{name}", [*every, ignored[0]], first, options)
    return ca.Function(name, every, [form.value], CLOSED_OPTIONS | {"is_diff_in": differs, "custom_jacobian": slope})


def _unseen(part: ca.MX) -> ca.MX:
    """A symbol of the same shape, without entries."""
    return ca.MX.sym("unseen", ca.Sparsity(*part.shape))
