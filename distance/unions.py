"""Unions of convex bodies: what is not convex, cut into pieces that are.

Of A = ∪ A_k and B = ∪ B_l, which move as one body each, the distance D is the γ-Hölder minimum of the pieces'

    D(A, B) = ⊕_kl D(A_k, B_l),    N pairs, p = γ + 1 (the HD-SDF's future work, the paper's section V)

*Sign.* A and B share a point only if two pieces do, and then some D_kl <= 0 (``normals``). ⊕ has the sign of the least,
so D > 0 proves that the unions are apart, and D is as tight in sign as the pieces are. Between the two,
N^(-1/p) m <= D <= m for m = min D_kl > 0, and N^(1/p) m <= D <= m for m < 0. D of one piece is its own, to the last bit.

*Smoothness.* D is γ times continuously differentiable in the poses, like D_kl, and without another shaping. Call f
s-flat if it is continuous and, wherever f ≠ 0, γ times continuously differentiable with |∂^k f| <= C |f|^(1-k/s) for
k = 1 … γ, where near every pose one C will do.

1. Smooth functions, such as w·(a_i - b_j), are 1-flat: their derivatives are bounded, and |f|^(1-k) is not small.
2. ⊕ keeps s. For u = ⊕ x_i > 0 the derivatives of u of order n by the x_i are sums of u^(1-n) Π (u/x_i)^(c_i p + n_i),
   n_i times by x_i, Σ n_i = n, c_i >= 1. In the chain rule each stands with n_i derivatives of x_i, of orders that sum
   to k_i, Σ k_i = k, which are at most C x_i^(n_i - k_i/s). Together: C u^(1-k/s) Π (u/x_i)^(c_i p + k_i/s), and
   u <= x_i. For u < 0 only x_i < 0 count: u^(1-n) Π (x_i/u)^(c_i p - n_i) gives C |u|^(1-k/s) Π (x_i/u)^(c_i p - k_i/s),
   with a positive exponent as k_i <= γ < p, and |x_i| <= |u|; so it vanishes as x_i rises to 0, where it leaves the sum.
3. Phi turns s into s p: near 0 |Phi^(i)(u)| <= C |u|^(p-i), so |∂^k Phi(u)| <= C |u|^(p-k/s) <= C |Phi(u)|^(1-k/(s p)).
4. If s > γ, the derivatives up to order γ tend to 0 wherever f does: f is γ times continuously differentiable, and they
   are 0 where f = 0.

D_kl shapes twice, so by 1 to 3 it is p²-flat; by 2 so is D; p² > γ. For γ = 1 the Hessian has jumps, as that of a pair.

*No piece is merged with another*: one given twice counts twice, so that D does not jump as a piece becomes equal to
another. ⊕ takes the pairs in any order.

*In metres.* D̃ of a union is the least of the pieces'. Apart, so is the signed distance d, and D̃ is a lower bound of it.
In overlap every pair must be taken apart, so d(A, B) <= min d(A_k, B_l): the least over the pairs says how deep one
piece is in another, which is an upper bound of d, as the cuts between pieces count as surface. D̃ is a lower bound of
that. Signs agree always.
"""

from __future__ import annotations

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

    def __post_init__(self) -> None:
        """Flatten unions of unions. Raises InputError for none and for what is no body."""
        given = self.pieces
        if isinstance(given, str | bytes | dict) or not hasattr(given, "__iter__"):
            raise InputError(f"pieces: found {describe(given)}, allowed is a list of convex bodies")
        flat: list[ConvexBody] = []
        for number, piece in enumerate(given):
            if not isinstance(piece, ConvexBody | BodyUnion):
                raise InputError(
                    f"pieces[{number}]: found {describe(piece)}, allowed is a ConvexBody or a union of some"
                )
            flat += pieces_of(piece)
        if not flat:
            raise InputError("pieces: found none, at least one is needed")
        object.__setattr__(self, "pieces", tuple(flat))

    def __repr__(self) -> str:
        """Say of how many it is."""
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


def pieces_of(body: Body) -> tuple[ConvexBody, ...]:
    """Return the pieces of a union, or the one convex body itself."""
    return body.pieces if isinstance(body, BodyUnion) else (body,)


def pairs_of(body_a: Body, body_b: Body) -> list[tuple[ConvexBody, ConvexBody]]:
    """Return every pair of a piece of A and one of B. Raises InputError for what is no body."""
    for name, body in (("body_a", body_a), ("body_b", body_b)):
        if not isinstance(body, ConvexBody | BodyUnion):
            raise InputError(f"{name}: found {describe(body)}, allowed is a ConvexBody or a union of some")
    return [(a, b) for a in pieces_of(body_a) for b in pieces_of(body_b)]
