"""The interface of a distance of many body pairs, for the problem and the controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from hdplan.distance.compiled.loops import Record
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError


class PairDistance(Protocol):
    """The distance of body pairs at samples, as a penalty needs it."""

    @property
    def functions(self) -> Mapping[str, Any]:
        """The CasADi functions that it evaluates, by purpose; none by default."""
        return {}

    @property
    def shaping(self) -> tuple[int, float, Record | None] | None:
        """γ, the shaping length [m], and the solids between which it is exact, for the loops of C. None without these,
        and by default for a distance that they do not know."""
        return None

    @property
    def how(self) -> str:
        """The backend's name, for the user."""

    def __call__(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return, for S pairs (rows of the term's pairs) at samples, less the margin: the distance D (S,) [m] whose
        hinge is taken; its derivative under a motion of the first body, as a wrench (S, 6), force and torque about the
        world's origin; and a lower bound of the true distance (S,) [m]."""

    def with_hessian(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return D (S,) [m], its wrench (S, 6), and its second derivatives (S, 6, 6) by the same motion exp(ξ), ξ = [v,
        ω]. Raises InputError where they are not known, as by default."""
        raise InputError(f"hessian: no second derivatives are known of {self.how}; allowed: gauss_newton")
