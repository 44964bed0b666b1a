"""The checks of a scene's joint limits: what each check must provide, and which ones there are.

A check proves its quantities along the whole executed curve and states itself what is wrong, so that certificate,
pictures and replay need not know which quantities there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows

ROUNDING_JUMP = 1e-6  # [rad/s], [rad/s²] or their like: differences that rounding makes between equal values
LIMIT_ROUNDING = 1e-9  # [–] relative, by which a value may exceed its limit


@dataclass(frozen=True)
class Use:
    """Share of a limit that a motion uses, at the joint and interval where it uses most."""

    quantity: str  # "velocity", "acceleration", "jerk", "torque"
    share: float  # proven bound of the value over the limit; inf where a jump makes it infinite
    joint: str
    interval: int  # between rows `interval` and `interval` + 1
    limit: float  # of that joint

    @property
    def within(self) -> bool:
        """True if the limit holds."""
        return self.share <= 1.0 + LIMIT_ROUNDING


@dataclass(frozen=True)
class LimitFinding:
    """Findings of a check of one motion."""

    uses: tuple[Use, ...]
    complaints: tuple[tuple[Status, str], ...] = ()  # what keeps the motion from being certified, the worst first
    remark: str = ""  # what is proven, in place of the uses' shares
    unfixable: tuple[int, ...] = ()  # intervals between rows in which moving slower does not help
    loads: tuple[str, ...] = ()  # the scene's masses, and lags, that were taken into account, by their fields

    @property
    def covered(self) -> frozenset[str]:
        """The fields of the scene that were checked: "limits.jerk"."""
        return frozenset({*(f"limits.{use.quantity}" for use in self.uses), *self.loads})


class LimitCheck(Protocol):
    """A scene's limits on some quantities of its joints."""

    @property
    def limits(self) -> Mapping[str, Array]:
        """The greatest absolute values (n,) by quantity."""

    def check(self, curve: Curve) -> LimitFinding:
        """Prove the limits along a timed curve, or say where they do not hold."""

    def values(self, quantity: str, curve: Curve, interval: Rows, fraction: Array) -> Array:
        """Return a quantity (k, n) on intervals (k,) of a timed curve at fractions (k,) of them."""

    def overload(self, q: Array) -> str | None:
        """Return the limit, in words, that the robot exceeds even at rest at q (n,); None if it exceeds none."""


def limit_checks(setup: Setup) -> Iterator[LimitCheck]:
    """Yield the checks that a scene needs; the others are not even imported. Raises InputError for limits and loads
    that do not match the robot."""
    if not DERIVATIVES.keys().isdisjoint(setup.limits):
        from hdplan.planner.certificate.rate_check import RateCheck

        yield RateCheck(setup)
    if "torque" in setup.limits:
        from hdplan.planner.certificate.torque_check import TorqueCheck

        yield TorqueCheck(setup)
