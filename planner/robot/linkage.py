"""Joints that follow others, the mimic joints of a URDF: parallel linkages, fingers that close together.

A follower is at multiplier · (value of the joint that it follows) + offset, and may be followed itself: chains are
composed. With the n planned joints at q all m joints of the model are at E q + c, E having one entry in each row; the
rates of these follow by E, and derivatives with respect to them are pulled back by Eᵀ. Units: [rad] or [m].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.errors import InputError
from hdplan.scenes.once import ReadOnly, read_only
from hdplan.scenes.robot_files.description import Tree

MOST_FACTOR = 1e3  # multiplier, and offset [rad or m], of a joint that follows


class Rule(NamedTuple):
    """Rule of a joint that follows: factor · (value of its leader) + offset."""

    leader: str  # the joint at the head of the chain, which follows none
    factor: float
    offset: float

    def image(self, low: float, high: float) -> tuple[float, float]:
        """Return the leader's range [rad or m] in which the follower is within [low, high]."""
        one, other = ((end - self.offset) / self.factor for end in (low, high))
        return min(one, other), max(one, other)


def rules_of(tree: Tree, joints: Sequence[str]) -> dict[str, Rule]:
    """Return the rule by which each of the robot's moving `joints` follows another one, if any: chains composed."""
    found = {}
    for joint in joints:
        leader, factor, offset = joint, 1.0, 0.0
        while leader in tree.mimics and leader in joints:
            leader, more, add = tree.mimics[leader]
            factor, offset = factor * more, factor * add + offset
        if leader != joint and leader in joints:
            found[joint] = Rule(leader, factor, offset)
    return found


@dataclass(frozen=True, eq=False)
class Linkage(ReadOnly):
    """The m joints of a model, and how they move with the n planned ones among them."""

    names: tuple[str, ...]  # (m,) in the model's order
    leader: Rows  # (m,) the planned joint that moves each
    factor: Array  # (m,) 1 for the planned ones
    offset: Array  # (m,) 0 for the planned ones
    own: Rows  # (n,) which of the m joints the planned ones are

    @classmethod
    def of(cls, names: tuple[str, ...], rules: Mapping[str, Rule]) -> Linkage:
        """Take the model's joints and the rules of those that follow. Raises InputError for numbers beyond
        MOST_FACTOR."""
        for name, rule in rules.items():
            if not max(abs(rule.factor), abs(rule.offset)) <= MOST_FACTOR:
                raise InputError(
                    f"robot: joint '{name}' follows '{rule.leader}' by a multiplier of {rule.factor:g} and an offset "
                    f"of {rule.offset:g}; at most {MOST_FACTOR:g} are allowed, as its place would be lost in rounding"
                )
        planned = [name for name in names if name not in rules]
        every = [rules.get(name, Rule(name, 1.0, 0.0)) for name in names]
        return cls(
            names,
            np.array([planned.index(rule.leader) for rule in every]),
            np.array([rule.factor for rule in every]),
            np.array([rule.offset for rule in every]),
            np.array([names.index(name) for name in planned]),
        )

    @cached_property
    def follows(self) -> Mask:
        """Mask of the m joints: those that follow another one."""
        return read_only(np.isin(np.arange(len(self.names)), self.own, invert=True))

    @cached_property
    def followed(self) -> Mask:
        """Mask of the planned joints that others follow (n,)."""
        return read_only(np.isin(np.arange(len(self.own)), self.leader[self.follows]))

    @cached_property
    def followers(self) -> tuple[str, ...]:
        """The joints that follow."""
        return tuple(self.names[i] for i in np.flatnonzero(self.follows).tolist())

    @cached_property
    def matrix(self) -> Array:
        """E (m, n)."""
        return read_only(np.eye(len(self.own))[self.leader] * self.factor[:, None])

    def expand(self, q: Array) -> Array:
        """Return the values (..., m) of all joints at configurations (..., n)."""
        return np.asarray(q[..., self.leader] * self.factor + self.offset)

    def fold(self, wrench: Array) -> Array:
        """Return derivatives (..., n) with respect to the planned joints, from those (..., m) with respect to all."""
        return np.asarray(wrench @ self.matrix)

    def fold_blocks(self, curvature: Array) -> Array:
        """Return second derivatives (..., n, n) from those (..., m, m): Eᵀ H E."""
        return np.asarray(self.matrix.T @ curvature @ self.matrix)

    def spread(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return the ranges (m,) of all joints within ranges (n,) of the planned ones."""
        one, other = self.expand(lower), self.expand(upper)
        return np.minimum(one, other), np.maximum(one, other)

    def tightest(self, most: Array) -> Array:
        """Return the greatest absolute rates (n,) of the planned joints that keep all joints within theirs (m,)."""
        found = np.full(len(self.own), np.inf)
        np.minimum.at(found, self.leader, most / np.abs(self.factor))
        return found

    def rule(self, joint: str) -> str:
        """Return a follower's rule in words."""
        at = self.names.index(joint)
        leader = self.names[self.own[self.leader[at]]]
        add = float(self.offset[at])
        offset = f" {'-' if add < 0 else '+'} {abs(add):g}" if add else ""
        return f"'{joint}' follows '{leader}' at {self.factor[at]:g} x its value{offset}"

    @property
    def no_torques(self) -> str:
        """Return the reason why the joints' torques are not known."""
        return f"torques are not known where {self.rule(self.followers[0])}: no URDF says how they share the load"

    def check(self, q: Array, named: Mapping[str, float], where: str, within: float) -> None:
        """Raise InputError where a follower that is `named` with a value is elsewhere, by more than `within`, at
        configuration q (n,)."""
        for joint, value in zip(self.names, self.expand(q).tolist(), strict=True):
            if abs(named.get(joint, value) - value) > within:
                raise InputError(
                    f"{where}: joint '{joint}' is given the value {named[joint]:g}, but would be at {value:g}: "
                    f"{self.rule(joint)}"
                )


def room_of(joint: str, rules: Mapping[str, Rule], ranges: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Return the range that a joint's own limits and those of its followers leave it; empty where low > high."""
    low, high = ranges[joint]
    for follower, rule in rules.items():
        if rule.leader == joint and rule.factor:
            least, most = rule.image(*ranges[follower])
            low, high = max(low, least), min(high, most)
    return low, high
