"""The common part of the fast distances of two bodies: value, gradient and Hessian at poses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from numpy.typing import ArrayLike

Found = TypeVar("Found")  # the kind of array that comes out


class BodyDistance(ABC, Generic[Found]):
    """D of two bodies (Definition III.2) at poses (..., 4, 4); leading axes broadcast.

    A lower bound of the signed distance in sign; ``separation`` D̃ (eq. (5)) is one in value, and has the sign of D
    even where D underflows. ``witnesses``: (..., W, 3) axes in B's frame, as many as the distance has.
    """

    def value(self, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None = None) -> tuple[Found, Found]:
        """Return D and D̃ (...,) [m]."""
        distance, separation = self._evaluate(0, pose_a, pose_b, witnesses)
        return distance, separation

    def gradient(
        self, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None = None
    ) -> tuple[Found, Found, Found]:
        """Return D, D̃ and the gradient of D (..., 12) by [v_a, ω_a, v_b, ω_b], each in the body's own frame."""
        distance, separation, gradient = self._evaluate(1, pose_a, pose_b, witnesses)
        return distance, separation, gradient

    def hessian(
        self, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None = None
    ) -> tuple[Found, Found, Found, Found]:
        """Return D, D̃, the gradient of D and its Hessian (..., 12, 12) by the same twists ξ: D(pose·exp(ξ)).

        For gamma = 1 the Hessian has jumps; it is one of its one-sided values there.
        """
        distance, separation, gradient, hessian = self._evaluate(2, pose_a, pose_b, witnesses)
        return distance, separation, gradient, hessian

    @abstractmethod
    def _evaluate(self, order: int, pose_a: ArrayLike, pose_b: ArrayLike, witnesses: ArrayLike | None) -> list[Found]:
        """Return D, D̃ and the derivatives up to an order of 0, 1 or 2."""
