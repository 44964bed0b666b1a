"""The unknown of a world: how far obstacles, joints and the robot's base may be from where it has them.

An obstacle is shifted by at most `shift`, turned about its frame's origin by at most `turn`, and after a time t it may
be `speed` times |t| farther. A turn moves a point by at most 2 sin(angle / 2) times its distance from the origin, and
to turn the obstacle is to turn the piece of the robot the other way. So the two are closer by no more than

    shift + 2 sin(turn / 2) R + speed |t|,

R the smaller of the greatest distances of their points from that origin. The same holds of the base, about its own
origin, for an obstacle as it may be turned itself. Joints that may be off by p stray from a leaf's straight line by so
much more (`kernel.Motion.off`). Nothing lies within a mesh in such a world either: let what is unknown grow from
nothing to what it is, and no surfaces meet on the way.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .balls import Ball, cos_sin, dot, need, norm, up, where
from .world import keys_of, number, numbers

if TYPE_CHECKING:
    from .kernel import Motion
    from .world import World

SIZES = "shift turn speed"
HALF_TURN = 3.1416


class Unknown:
    """Upper bounds, for the pieces (g,) and the joints (n,) of a world."""

    def __init__(self, world: World, section: Any) -> None:
        """Take the world's key `sizes`, once its joints and pieces are known."""
        around, base, joints, rates = keys_of(section, "sizes", "around base joints rates")
        pieces = world.pieces
        need(type(around) is dict, "sizes.around: a mapping is expected")
        need({*around} <= {x.name for x in pieces if x.kind == "obstacle"}, "sizes.around: of no obstacle")
        self.around = {name: sizes_of(each, f"sizes.around.{name}", SIZES) for name, each in around.items()}
        none = np.zeros(3)
        rows = [self.around.get(x.name, none) if x.kind == "obstacle" else none for x in pieces]
        self.shift, angle, self.speed = np.array(rows).reshape(-1, 3).T
        self.turn = chord(angle)
        need(world.times is not None or not self.speed.any(), "sizes.around: of a speed, and the motion has no times")
        self.lever = np.array([lever(x) if turns else 0.0 for x, turns in zip(pieces, angle > 0, strict=True)])
        self.obstacle = np.array([x.kind == "obstacle" for x in pieces], dtype=bool)
        self.base, self.about = np.zeros(2), Ball(np.zeros(3))
        if base is not None:
            *_, about = keys_of(base, "sizes.base", "shift turn about")
            self.about = Ball(numbers(about, (3,), "sizes.base.about"))
            self.base = sizes_of({x: base[x] for x in ("shift", "turn")}, "sizes.base", "shift turn")
        self.joints, self.rates = (
            of_joints(world, x, f"sizes.{key}") for x, key in ((joints, "joints"), (rates, "rates"))
        )
        robot = bool(self.base.any() or self.joints.any())
        need(not robot or not (world.path or "torque" in world.limits), "sizes: of a robot with constraints or torques")

    def closer(self, motion: Motion, node: Any, pairs: Any) -> Any:
        """Upper bounds (L,) of how much closer pairs (L, 2) may be on intervals (L,), but for what joints are off."""
        world, (robot, other) = motion.world, pairs.T
        (one, moved), (two, more) = (placed(motion, node, x) for x in (robot, other))
        joint, travel = world.joint[other], up(moved + more)
        origin = dot("lij,lj->li", motion.turn[node, joint], world.at[other]) + motion.at[node, joint]
        far = norm((one - origin).size) + world.radii[robot] + travel
        found = self.shift[other] + self.turn[other] * np.minimum(self.lever[other], up(far))
        found = found + self.speed[other] * motion.latest[node]
        if self.base.any():
            beside = norm((two - self.about).size) + world.radii[other] + up(self.turn[other] * self.lever[other])
            near = np.minimum(up(norm((one - self.about).size) + world.radii[robot]), up(beside))
            found = found + self.base[0] + chord(self.base[1]) * (near + travel)
        return np.where(self.obstacle[other], up(found), 0.0)


def placed(motion: Motion, node: Any, piece: Any) -> tuple[Ball, Any]:
    """The centres (L, 3) of balls around pieces (L,) at the middle of intervals (L,), and how far those move (L,)."""
    world = motion.world
    slot, moves = np.maximum(world.slot[piece], 0), world.joint[piece] >= 0
    moved = up((motion.most[node] * motion.reach[node, slot]).sum(axis=1))
    return where(moves[:, None], motion.ends[node, slot], world.centers[piece]), np.where(moves, moved, 0.0)


def lever(piece: Any) -> float:
    """Greatest distance of a piece's points from its frame's origin; a ball that sweeps it does not turn."""
    sweep = piece.sweep
    beyond = 0.0 if sweep.max() == sweep.min() else sweep.max()
    return float(up(norm(up(np.abs(piece.corners) + piece.off)).max() + beyond))


def chord(angle: Any) -> Any:
    """Upper bounds of 2 sin(angle / 2)."""
    return up(2 * cos_sin(0.5 * np.asarray(angle))[1].size)


def sizes_of(section: Any, what: str, keys: str) -> Any:
    """Sizes, none below 0, and turns of at most half a turn."""
    found = np.array([number(x, what) for x in keys_of(section, what, keys)])
    need((found >= 0).all() and found[1] <= HALF_TURN, f"{what}: at least 0, and at most half a turn, is expected")
    return found


def of_joints(world: World, given: Any, what: str) -> Any:
    """Greatest deviations of all joints (n,): given for those that follow none, times the factor for others."""
    own, found = numbers(given, (len(world.lead),), what), np.zeros(len(world.joints))
    need((own >= 0).all(), f"{what}: is negative")
    found[world.lead] = own
    for i, joint in enumerate(world.joints):
        if joint.follows:
            found[i] = up(abs(joint.follows[1]) * found[joint.follows[0]])
    return found
