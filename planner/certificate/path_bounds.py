"""The path constraints of a scene: the value of each at a configuration, and an upper bound on a part of the motion.

On a part of the motion q(s) = q_m + s δ + e(s), |s| ≤ 1, |e_j(s)| ≤ ε_j (`Curve.part`), everything evaluated at q_m:

*Upright.* The link's axis a is rotated by the revolute joints that carry it. With a' = Σ_j δ_j z_j × a and ‖∂²a/∂q_i
∂q_j‖ ≤ 1, the chord to the upward direction z is at most

    ‖a(s) − z‖ ≤ max_{s = ±1} ‖a − z + s a'‖ + ½ (Σ_j |δ_j|)² + Σ_j ε_j,    angle = 2 arcsin(chord/2),

as the norm is convex in s, and a joint deviation of ε_j rotates the axis by no more than that. Coarser: the angle grows
by Σ_j |δ_j| + ε_j at most.

*Within.* Along each axis of the box, the point's coordinate u is bounded, with v' and R of `motion_bounds`, by

    |u(s)| ≤ max_{s = ±1} |u + s u'| + R,    or    |u| + Σ_j (|δ_j| + ε_j) ρ_j.

*Relative.* Joints that carry both links change neither the distance between points on them nor the angle between their
frames, so only those count that carry one of the two: A the first link, B the other. The link's origin p is to be at
the point c of the other link,

    ‖p(s) − c(s)‖ ≤ max_{s = ±1} ‖p − c + s (p' − c')‖ + R_A + R_B,    or    ‖p − c‖ + Σ_{A, B} (|δ_j| + ε_j) ρ_j.

Its rotation P is to be C, the other link's times the required relative rotation. With the chord d = ‖P − C‖_F/√2 = 2
sin(angle/2), P' = [Ω_A]× P, C' = [Ω_B]× C, Ω = Σ δ_j z_j over the revolute joints, and ‖∂²P/∂q_i ∂q_j‖_F = ‖[z_i]×
[z_j]×‖_F = √(1 + (z_i · z_j)²) ≤ √2,

    d(s) ≤ max_{s = ±1} ‖P − C + s (P' − C')‖_F/√2 + ½ (Σ_A |δ_j|)² + ½ (Σ_B |δ_j|)² + Σ_{A, B} ε_j,

as a joint deviation of ε_j moves P by a chord of no more than that. Coarser: the angle grows by Σ_{A, B} |δ_j| + ε_j.

Angles in [rad], distances in [m]. Placements are Pinocchio's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

import numpy as np

from hdplan.planner.certificate.path_parts import Held, Part, WithTolerance, angles_between, no_greater_angle, spun
from hdplan.planner.certificate.verdict import at_most, proven_length
from hdplan.planner.motion.motion_bounds import Chain, cross
from hdplan.planner.robot.link_frame import link_frame, relative_links
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.errors import naming
from hdplan.scenes.once import read_only
from hdplan.scenes.path_constraints import Follow, PathConstraint, Relative, Upright, Within

UP = read_only(np.array([0.0, 0.0, 1.0]))  # in the world


@dataclass(frozen=True, eq=False)
class HeldUpright(WithTolerance):
    """A link's axis, to be kept upright."""

    link: str
    joint: int  # of the model, that carries the link
    axis: Array  # (3,) unit, in the joint's frame
    allowed: float  # [rad]
    field: str = "path.upright"

    def found(self, rotations: Array, origins: Array) -> Array:
        """The angle (k,) to the upward direction, exact: Kahan's formula, as good near 0 and π as elsewhere."""
        axis = rotations[:, self.joint] @ self.axis
        chord, other = np.linalg.norm(axis - UP, axis=1), np.linalg.norm(axis + UP, axis=1)
        return np.asarray(2.0 * np.arctan2(chord, other))

    def bound(self, part: Part, found: Array) -> Array:
        """Upper bounds of the angle (k,) on the parts [rad]."""
        turning = part.chain.carried_by[self.joint] & part.chain.revolute
        axis, off = part.rotations[:, self.joint] @ self.axis, (part.off * turning).sum(axis=1)
        delta = part.delta * turning
        slope, turn = cross(np.einsum("kn,knc->kc", delta, part.axes), axis), np.abs(delta).sum(axis=1)
        ends = np.maximum(np.linalg.norm(axis - UP + slope, axis=1), np.linalg.norm(axis - UP - slope, axis=1))
        return no_greater_angle(ends + 0.5 * turn**2 + off, found + turn + off)

    def broken(self, found: float) -> str:
        """Words such as "panda_hand is tilted by 0.2 rad, 0.1 are allowed"."""
        return f"{self.link} is tilted by {found:.3g} rad, {self.allowed:g} are allowed"

    def kept(self, worst: float) -> str:
        """Words such as "panda_hand upright within 0.083 of 0.1 rad"."""
        return f"{self.link} upright within {at_most(worst)} of {self.allowed:g} rad"


@dataclass(frozen=True, eq=False)
class HeldWithin:
    """A point of a link, to be kept in a box: by how much it is beyond the nearest side, negative inside."""

    link: str
    joint: int
    point: Array  # (3,) in the joint's frame
    box: Array  # (4, 4) the box in the world
    half: Array  # (3,) half its edges; inf where any place will do
    allowed: float = 0.0  # [m]
    field: str = "path.position"

    @property
    def scale(self) -> float:
        """Half the shortest edge."""
        return float(self.half.min())

    def found(self, rotations: Array, origins: Array) -> Array:
        """Distance beyond the box (k,), exact along its axes."""
        place = rotations[:, self.joint] @ self.point + origins[:, self.joint]
        return np.asarray((np.abs(self._in_box(place - self.box[:3, 3])) - self.half).max(axis=1))

    def bound(self, part: Part, found: Array) -> Array:
        """Upper bounds of the distance beyond the box (k,) on the parts [m]."""
        place, motion = part.moved(self.joint, self.point, part.chain.carried_by[self.joint])
        now = self._in_box(place - self.box[:3, 3])
        slope = self._in_box(cross(motion.omega, place) + motion.velocity)
        second = np.maximum(np.abs(now + slope), np.abs(now - slope)) + motion.second[:, None]
        return np.asarray(np.minimum((second - self.half).max(axis=1), found + motion.first))

    def _in_box(self, vectors: Array) -> Array:
        return np.asarray(vectors @ self.box[:3, :3])

    def broken(self, found: float) -> str:
        """Words such as "the point of tool0 is 5 mm outside its box"."""
        side = "outside" if found > 0.0 else "inside"
        return f"the point of {self.link} is {abs(found) * 1e3:.3g} mm {side} its box"

    def kept(self, worst: float) -> str:
        """Words such as "the point of tool0 at least 2 mm inside its box"."""
        return f"the point of {self.link} at least {proven_length(max(0.0, -worst))} inside its box"


@dataclass(frozen=True, eq=False)
class HeldAt(WithTolerance):
    """A link's origin, to be kept at a point of another link."""

    link: str
    to: str
    joints: tuple[int, int]  # that carry the two; 0: the world
    points: tuple[Array, Array]  # (3,) in the joints' frames: the origin, and where it is to be
    allowed: float  # [m]
    field: str = "path.relative.position_tolerance"

    def found(self, rotations: Array, origins: Array) -> Array:
        """The distance (k,) between the two points, exact."""
        one, other = (
            rotations[:, joint] @ point + origins[:, joint]
            for joint, point in zip(self.joints, self.points, strict=True)
        )
        return np.asarray(np.linalg.norm(one - other, axis=1))

    def bound(self, part: Part, found: Array) -> Array:
        """Upper bounds of the distance (k,) on the parts [m]."""
        (here, first), (there, second) = (
            part.moved(joint, point, moves)
            for joint, point, moves in zip(self.joints, self.points, _apart(part.chain, self.joints), strict=True)
        )
        slope = cross(first.omega, here) + first.velocity - cross(second.omega, there) - second.velocity
        ends = np.maximum(*(np.linalg.norm(here - there + sign * slope, axis=1) for sign in (1.0, -1.0)))
        return np.asarray(np.minimum(ends + first.second + second.second, found + first.first + second.first))

    def broken(self, found: float) -> str:
        """Words such as "right_hand is 7 mm away from its place at left_hand, 5 mm are allowed"."""
        away = f"{self.link} is {found * 1e3:.3g} mm away from its place at {self.to}"
        return f"{away}, {self.allowed * 1e3:g} mm are allowed"

    def kept(self, worst: float) -> str:
        """Words such as "right_hand within 3.2 of 5 mm of its place at left_hand"."""
        return f"{self.link} within {at_most(worst * 1e3)} of {self.allowed * 1e3:g} mm of its place at {self.to}"


@dataclass(frozen=True, eq=False)
class HeldTurn(WithTolerance):
    """A link's rotation, to be kept against another link's."""

    link: str
    to: str
    joints: tuple[int, int]  # that carry the two; 0: the world
    turns: tuple[Array, Array]  # (3, 3) in the joints' frames: the link's, and what it is to be
    allowed: float  # [rad]
    field: str = "path.relative.orientation_tolerance"

    def _both(self, rotations: Array) -> tuple[Array, Array]:
        one, other = (rotations[:, joint] @ turn for joint, turn in zip(self.joints, self.turns, strict=True))
        return one, other

    def found(self, rotations: Array, origins: Array) -> Array:
        """The angle (k,) between the two, exact, near 0 and π too."""
        one, other = self._both(rotations)
        return angles_between(other, one)

    def bound(self, part: Part, found: Array) -> Array:
        """Upper bounds of the angle (k,) on the parts [rad]."""
        one, other = self._both(part.rotations)
        slope, bent, turned = np.zeros_like(one), np.zeros(len(one)), np.zeros(len(one))
        for rotation, moves, sign in zip((one, other), _apart(part.chain, self.joints), (1.0, -1.0), strict=True):
            delta, off = (values * (moves & part.chain.revolute) for values in (part.delta, part.off))
            omega, turn = np.einsum("kn,knc->kc", delta, part.axes), np.abs(delta).sum(axis=1)
            slope = slope + sign * spun(omega, rotation)
            bent, turned = bent + 0.5 * turn**2 + off.sum(axis=1), turned + turn + off.sum(axis=1)
        ends = np.maximum(*(np.linalg.norm(one - other + sign * slope, axis=(1, 2)) for sign in (1.0, -1.0)))
        return no_greater_angle(ends / np.sqrt(2.0) + bent, found + turned)

    def broken(self, found: float) -> str:
        """Words such as "right_hand is turned by 0.2 rad against left_hand, 0.05 are allowed"."""
        return f"{self.link} is turned by {found:.3g} rad against {self.to}, {self.allowed:g} are allowed"

    def kept(self, worst: float) -> str:
        """Words such as "right_hand turned within 0.02 of 0.05 rad against left_hand"."""
        return f"{self.link} turned within {at_most(worst)} of {self.allowed:g} rad against {self.to}"


def held_by(setup: Setup) -> tuple[Held, ...]:
    """Return the requirements of the scene's path constraints. Raises InputError for a link that the robot lacks or
    that does not move."""
    with naming(setup.scene.source):
        return tuple(held for constraint in setup.scene.path.given.values() for held in _held(setup, constraint))


def _held(setup: Setup, constraint: PathConstraint) -> tuple[Held, ...]:
    robot = setup.robot
    match constraint:
        case Upright():
            frame = robot.model.frames[link_frame(robot, constraint.link, "path.upright")]
            axis = frame.placement.rotation @ (np.array(constraint.axis) / np.linalg.norm(constraint.axis))
            return (HeldUpright(constraint.link, int(frame.parentJoint), axis, constraint.tolerance),)
        case Within():
            frame = robot.model.frames[link_frame(robot, constraint.link, "path.position")]
            point, half = frame.placement.act(np.array(constraint.point)), 0.5 * np.array(constraint.size)
            return (HeldWithin(constraint.link, int(frame.parentJoint), point, constraint.pose.matrix, half),)
        case Relative():
            joints, (own, other), pose = relative_links(setup.scene, robot, constraint)
            wanted = other @ pose
            places, turns = (own[:3, 3], wanted[:3, 3]), (own[:3, :3], wanted[:3, :3])
            return (
                HeldAt(constraint.link, constraint.to, joints, places, constraint.position_tolerance),
                HeldTurn(constraint.link, constraint.to, joints, turns, constraint.orientation_tolerance),
            )
        case Follow():
            return ()  # which is about a whole motion, not a configuration: `followed_curve`
        case _:
            assert_never(constraint)


def _apart(chain: Chain, joints: tuple[int, int]) -> tuple[Mask, Mask]:
    """Coordinates (n,) that move the first of two joints' frames and not the other, and the other way round."""
    first, second = (chain.carried_by[joint] for joint in joints)
    return first & ~second, second & ~first
