"""The interface of an arm for loops: its clock, the measured joints, and their next references.

A simulated body has these (`mujoco_arm.MuJoCoArm`), and so has a real one, in some lines around its driver.
"""

from __future__ import annotations

from typing import Protocol

from hdplan.scenes.array_types import Array


class Arm(Protocol):
    """An arm that follows references, once every period."""

    joint_names: tuple[str, ...]
    """(n,) the order of all values."""
    period: float
    """[s] between two references."""

    def time(self) -> float:
        """Return the time [s] on its clock."""

    def state(self) -> tuple[Array, Array]:
        """Return the positions (n,) [rad or m] and velocities (n,) as measured; values of joints that turn without
        limits continue beyond whole turns, like the references sent to them."""

    def send(self, position: Array, velocity: Array) -> None:
        """Move to a position (n,), with a velocity (n,), within one period; returns at its end."""

    def stop(self) -> None:
        """Come to rest at once, regardless of earlier references."""
