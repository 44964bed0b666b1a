"""Arrays with their first and second derivatives by n parameters: exact derivatives of sums, products and powers.

The reference's formulas are written once, for jets. Without parameters (n = 0) a jet is just its value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.scenes.array_types import Array

TWISTS = 12  # parameters of two moving bodies


@dataclass(frozen=True, eq=False)
class Jet:
    """An array (..., *shape) and its derivatives by n parameters."""

    value: Array  # (..., *shape)
    first: Array  # (..., *shape, n)
    second: Array  # (..., *shape, n, n), symmetric

    def __add__(self, other: Jet) -> Jet:
        """Return the sum; shapes broadcast."""
        return Jet(self.value + other.value, self.first + other.first, self.second + other.second)

    def __sub__(self, other: Jet) -> Jet:
        """Return the difference; shapes broadcast."""
        return self + other * -1.0

    def __mul__(self, factor: float) -> Jet:
        """Return the multiple by a number."""
        return Jet(factor * self.value, factor * self.first, factor * self.second)

    def plus(self, number: float) -> Jet:
        """Return the sum with a number."""
        return Jet(self.value + number, self.first, self.second)

    def part(self, *index: int | slice | None) -> Jet:
        """Return ``value[..., *index]``, of as many axes as the index names."""
        every = (slice(None),)
        return Jet(
            self.value[(..., *index)],
            self.first[(..., *index, *every)],
            self.second[(..., *index, *every, *every)],
        )

    def merged(self) -> Jet:
        """Return the jet with the value's last two axes as one."""
        shape = (*self.value.shape[:-2], self.value.shape[-2] * self.value.shape[-1])
        n = self.first.shape[-1:]
        return Jet(self.value.reshape(shape), self.first.reshape(shape + n), self.second.reshape(shape + n + n))


def stack(jets: list[Jet]) -> Jet:
    """Return jets of one shape as one, along a new last axis of the value."""
    return Jet(
        np.stack([jet.value for jet in jets], axis=-1),
        np.stack([jet.first for jet in jets], axis=-2),
        np.stack([jet.second for jet in jets], axis=-3),
    )


def product(spec: str, left: Jet, right: Jet | Array) -> Jet:
    """Return the product of two factors, ``spec`` as in ``einsum`` without leading axes, e.g. ``"xy,y->x"``.

    Derivatives by Leibniz: (fg)' = f'g + fg', (fg)'' = f''g + f'g' + (f'g')ᵀ + fg''.
    """
    inputs, out = spec.split("->")
    a, b = inputs.split(",")

    def term(x: Array, y: Array, by_x: str = "", by_y: str = "") -> Array:
        return np.asarray(np.einsum(f"...{a}{by_x},...{b}{by_y}->...{out}{by_x}{by_y}", x, y))

    if not isinstance(right, Jet):
        return Jet(term(left.value, right), term(left.first, right, "P"), term(left.second, right, "PQ"))
    mixed = term(left.first, right.first, "P", "Q")
    return Jet(
        term(left.value, right.value),
        term(left.first, right.value, by_x="P") + term(left.value, right.first, by_y="P"),
        term(left.second, right.value, by_x="PQ")
        + term(left.value, right.second, by_y="PQ")
        + mixed
        + mixed.swapaxes(-1, -2),
    )


def inverse_power(square: Jet, softness: float, power: float) -> Jet:
    """Return (square + softness²)^(-power), elementwise."""
    base = square.value + softness**2
    value = base**-power
    slope, curvature = -power * value / base, power * (power + 1.0) * value / base / base
    outer = square.first[..., :, None] * square.first[..., None, :]
    return Jet(
        value,
        slope[..., None] * square.first,
        slope[..., None, None] * square.second + curvature[..., None, None] * outer,
    )


def fixed(pose: Array) -> Jet:
    """Return an array as a jet without parameters."""
    return Jet(pose, np.empty((*pose.shape, 0)), np.empty((*pose.shape, 0, 0)))


def moving(pose: Array, start: int) -> Jet:
    """Return pose·exp(ξ) (..., 4, 4) by twelve twist parameters, of which this pose's six [v, ω] begin at ``start``.

    The twist is in the body's own frame. Exact to second order at ξ = 0, as the derivatives there need.
    """
    generators = np.zeros((TWISTS, 4, 4))
    generators[start : start + 3, :3, 3] = np.eye(3)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        generators[start + 3 + k, i, j], generators[start + 3 + k, j, i] = -1.0, 1.0
    pairs = np.einsum("Pyz,Qzx->yxPQ", generators, generators)
    second = 0.5 * (pairs + pairs.swapaxes(-1, -2))
    return Jet(pose, np.einsum("...wy,Pyx->...wxP", pose, generators), np.einsum("...wy,yxPQ->...wxPQ", pose, second))
