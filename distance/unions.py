"""Unions of convex bodies: nonconvex bodies, cut into convex pieces.

Of A = ∪ A_k and B = ∪ B_l, which move as one body each, D is the γ-Hölder minimum over the N pairs of pieces,

    D(A, B) = ⊕_kl D(A_k, B_l)                            (what the paper leaves to future work: non-convex shapes)

*Sign.* A and B share a point only if two pieces do, and then some D_kl <= 0 (``normals``). ⊕ has the sign of the least,
so D > 0 proves that the unions are apart; it is positive wherever all D_kl are. With p = γ + 1 and m = min D_kl,
N^(-1/p) m <= D <= m for m > 0, and N^(1/p) m <= D <= m for m < 0. D of one piece is its own, to the last bit.

*Smoothness.* D is γ times continuously differentiable in the poses, like D_kl, and without another shaping. Call f
s-flat if it is continuous and, wherever f ≠ 0, γ times continuously differentiable with |∂^k f| <= C |f|^(1 - k/s) for
k = 1 … γ, where near every pose one C will do.

1. Smooth functions, such as w·(a_i - b_j), are 1-flat: their derivatives are bounded, and |f|^(1 - k) is not small.
2. u = ⊕ x_i is s-flat if all x_i are. For u > 0, a derivative of u by the x_i, n_i times by x_i and Σ n_i = n, is a
   sum of terms u^(1 - n) Π (u/x_i)^(c_i p + n_i), over some i, with c_i >= 1. In the chain rule it stands beside n_i
   derivatives of each x_i, of orders that add up to k_i, Σ k_i = k; they are at most C x_i^(n_i - k_i/s). The product
   is at most C u^(1 - k/s) Π (u/x_i)^(c_i p + k_i/s), and u <= x_i. For u < 0 only x_i < 0 count: the terms are
   |u|^(1 - n) Π (x_i/u)^(c_i p - n_i), the products C |u|^(1 - k/s) Π (x_i/u)^(c_i p - k_i/s), and |x_i| <= |u|. There
   the exponents are positive, as k_i <= γ < p, so x_i leaves the sum at 0 with all of these derivatives.
3. Phi(u) is (s p)-flat if u is s-flat: near 0 |Phi^(i)(u)| <= C |u|^(p - i), so |∂^k Phi(u)| <= C |u|^(p - k/s), and
   |u|^p <= C |Phi(u)|.
4. If s > γ, the derivatives to order γ tend to 0 where f does. So f is γ times continuously differentiable everywhere,
   and they are 0 where f = 0.

D_kl is shaped twice, so it is p²-flat by 1 to 3; so is D by 2; and p² > γ. For γ = 1 the Hessian jumps, as a pair's.

*No piece is merged with another.* One given twice counts twice, so that D does not jump as a piece becomes equal to
another. The order of the pieces does not matter, nor whether some are united before: ⊕ is associative.

*In metres.* D̃ is the least of the pairs'. Apart, d(A, B) = min d(A_k, B_l), and D̃ is a lower bound of it. In overlap
all pairs must be taken apart, so d(A, B) <= min d(A_k, B_l): the least over the pairs, how deep one piece is in
another, is an upper bound of d, as if the cuts between pieces were surface, and D̃ is a lower bound of that alone.
Signs agree always.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.values import describe


@dataclass(frozen=True, eq=False, repr=False)
class BodyUnion:
    """Convex bodies that move as one, all in its own frame; they may overlap. Made by ``ConvexBody.union``."""

    pieces: tuple[ConvexBody, ...]  # at least one

    def __repr__(self) -> str:
        """Return the number of its pieces, for display."""
        count = len(self.pieces)
        return f"<BodyUnion: {count} {'piece' if count == 1 else 'pieces'}>"

    def inflated(self, clearance: float) -> BodyUnion:
        """Return this body grown by ``clearance`` >= 0 [m] in all directions, that is with every piece grown."""
        return BodyUnion(tuple(piece.inflated(clearance) for piece in self.pieces))

    @property
    def centre(self) -> Array:
        """The mean of the pieces' vertices (3,) [m]; a point of their hull, not always of the union."""
        return np.asarray(np.vstack([piece.vertices for piece in self.pieces]).mean(axis=0))

    @property
    def reach(self) -> float:
        """The largest distance from the centre to a point of the union [m]."""
        centre = self.centre
        return max(float(np.linalg.norm(p.vertices - centre, axis=1).max()) + p.radius for p in self.pieces)


Body = ConvexBody | BodyUnion


def union_of(pieces: Iterable[Body]) -> BodyUnion:
    """Return the union of bodies; what is a union itself gives its pieces. Raises InputError for none and no body."""
    if isinstance(pieces, str | bytes | dict) or not isinstance(pieces, Iterable):
        raise InputError(f"pieces: found {describe(pieces)}, allowed is a list of convex bodies")
    flat: list[ConvexBody] = []
    for number, piece in enumerate(pieces):
        flat += pieces_of(_checked(f"pieces[{number}]", piece))
    if not flat:
        raise InputError("pieces: found none, at least one is needed")
    return BodyUnion(tuple(flat))


def pieces_of(body: Body) -> tuple[ConvexBody, ...]:
    """Return the pieces of a union, or the one convex body itself."""
    return body.pieces if isinstance(body, BodyUnion) else (body,)


def pairs_of(body_a: Body, body_b: Body) -> list[tuple[ConvexBody, ConvexBody]]:
    """Return every pair of a piece of A and one of B. Raises InputError for what is no body."""
    pieces_a, pieces_b = (pieces_of(_checked(*named)) for named in (("body_a", body_a), ("body_b", body_b)))
    return [(a, b) for a in pieces_a for b in pieces_b]


def _checked(name: str, body: object) -> Body:
    if not isinstance(body, ConvexBody | BodyUnion):
        raise InputError(f"{name}: found {describe(body)}, allowed is a ConvexBody or a union of some")
    return body
