"""The check that a link follows a curve of poses: straight from each to the next, by the shortest turn.

It does if for every instant there is a place u(t) on the curve, from the first pose to the last and never back, at
which the link is within the tolerances. A proof need not say which; any u will do, and one is looked for here, near the
link at NODES of each interval between rows, and even along the curve between them. Between two poses, and on a part -1
<= s <= 1 of the motion, the curve is at c + s c', and its axes at v + s w x v but for |w|^2 / 2, with half of the way
c' and of the turn w that it makes there; so what is to be short is a vector that moves as a bond's does.

Where a stage comes from a move, or goes over into one, the link need not be on the curve within a radius around its
beginning, or its end: then it is within that radius, and so is all of the curve that it leaves out. Speed and
acceleration of its origin are limited wherever the curve is beyond that radius, less the tolerance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .balls import EPS, Ball, above, cross, dot, joined, need, norm, stack, up
from .effects import LIMIT_ROUNDING, Line, chord, everywhere, forward, link_of, parts_of, rates_of, still, times, wedge
from .kernel import INSTANT, Motion, farthest
from .turns import rotation, turns_between
from .world import Bond, World, keys_of, number, placed

KEYS = "kind link free poses position_tolerance orientation_tolerance begin_tolerance end_tolerance speed acceleration"
NODES = 4  # of an interval
AHEAD, BESIDE = 2.0, 1.0  # of the link's own way, in tolerances, and beside it: how far the next place is sought
FINEST = 0.05  # [rad] of turn between two poses: longer ways are divided
CLOSE = 2.0**-36  # of an interval: nodes that are closer to a pose than that are not needed
BEFORE = 1e-6  # of a tolerance
LOG = 1e-11  # [rad] by which a rotation vector may be wrong
MOST_POSES = 200_000


class Curve:
    """The poses that a link is to follow."""

    def __init__(self, world: World, content: Any) -> None:
        """Take them; long turns are divided, so that places near the link are found by straight lines."""
        _, link, self.free, poses, *allowed = keys_of(content, "path.follow", KEYS)
        self.joint, self.own = link_of(world, link)
        need(self.free in ("none", "x", "y", "z") and type(poses) is list and len(poses) > 1, "path.follow")
        self.far, self.angle = (number(x, "path.follow") for x in allowed[:2])
        self.begin, self.end, self.speed, self.acceleration = (
            None if x is None else number(x, "path.follow") for x in allowed[2:]
        )
        need(self.far > 0 and 0 < self.angle < 3, "path.follow: a tolerance")
        read = [pose for (pose,) in placed([("path.follow", x) for x in poses])]
        turn, at = stack([x for x, _ in read]), stack([x for _, x in read])
        about = turns_between(turn.mid[:-1], turn.mid[1:], self.free)
        counts = np.maximum(np.ceil(np.linalg.norm(about, axis=1) / FINEST), 1).astype(int)
        need(counts.sum() < MOST_POSES, "path.follow: more poses than can be checked")
        part = np.concatenate([np.arange(count) / count for count in counts])
        self.segment = np.repeat(np.arange(len(counts)), counts)
        self.step, self.about, self.at, self.turn = at[1:] - at[:-1], about, at, turn
        self.part, self.width = part, np.repeat(1.0 / counts, counts)
        self.axes = [0, 1, 2] if self.free == "none" else ["xyz".index(self.free)]
        places, turns = self.poses(np.append(self.segment, len(counts) - 1), np.append(part, 1.0))
        self.vertices = self.within(places.mid, turns.mid)  # in tolerances
        self.places = places
        self.ways = np.append(0.0, np.cumsum(np.maximum(lengths(np.diff(self.vertices, axis=0)), 1e-12)))

    def within(self, places: Any, turns: Any) -> Any:
        """Poses as points (k, 3 + 3 m), a tolerance apart if one of place or turn is a tolerance off."""
        sides = turns[:, :, self.axes].reshape(len(turns), -1) / (
            self.angle * np.sqrt(2.0 if self.free == "none" else 1.0)
        )
        return np.concatenate([places / self.far, sides], axis=1)

    def poses(self, segment: Any, share: Any) -> tuple[Ball, Ball]:
        """Places (k, 3) and rotations (k, 3, 3) at shares (k,) of segments."""
        there = self.at[segment] + self.step[segment] * Ball(share, 2 * EPS)[:, None]
        about, size = self.about[segment], np.linalg.norm(self.about[segment], axis=1)
        axis = np.where((size > 0)[:, None], about, [1.0, 0.0, 0.0]) / np.where(size > 0, size, 1.0)[:, None]
        turned = rotation(Ball(axis, 4 * EPS), size * share)
        turned = Ball(turned.mid, up(turned.rad + LOG + self.turn.rad.max()))
        return there, dot("kij,kjl->kil", turned, self.turn[segment])

    def between(self, ways: Any) -> tuple[Any, Any, Any]:
        """For two places (k, 2) on the way from one pose to the next: which of these, middle and half of the part."""
        vertex = np.clip(np.searchsorted(self.ways, ways.mean(axis=1), side="right") - 1, 0, len(self.segment) - 1)
        wide = self.ways[vertex + 1] - self.ways[vertex]
        inner = (np.clip((x - self.ways[vertex]) / wide, 0.0, 1.0) for x in ways.T)
        first, last = (self.part[vertex] + x * self.width[vertex] for x in inner)
        return self.segment[vertex], (first + last) / 2, (last - first) / 2

    def beyond(self, radius: float, backwards: bool = False) -> float:
        """The way from the curve's beginning to where it first is so far from there, or a very little before; from its
        end, if `backwards`."""
        at, ways = self.places.mid, self.ways
        at, ways = (at[::-1], ways[-1] - ways[::-1]) if backwards else (at, ways)
        off, radius = at - at[0], max(radius, 0.0)
        far = lengths(off) > radius
        if not far.any():
            return float(ways[-1])
        k = max(int(far.argmax()), 1)
        one, step = off[k - 1], off[k] - off[k - 1]
        a, b, c = step @ step, one @ step, one @ one - radius**2  # a x^2 + 2 b x + c = 0
        share = np.clip((np.sqrt(max(b * b - a * c, 0.0)) - b) / max(a, 1e-300), 0.0, 1.0)
        return max(float(ways[k - 1] + share * (ways[k] - ways[k - 1])) - BEFORE, 0.0)


class Followed:
    """A curve, and the place of one motion on it at every instant: at nodes, in intervals, how far along it."""

    def __init__(self, world: World, curve: Curve) -> None:
        """Look for the places."""
        self.world, self.curve = world, curve
        count = len(world.control.mid)
        nodes = np.append(np.repeat(np.arange(float(count)), NODES) + np.tile(np.arange(NODES) / NODES, count), count)
        instants = np.minimum(nodes, count - INSTANT)[:, None] + [0, INSTANT]
        parts = [Motion(world, x) for x in np.array_split(instants, 1 + len(instants) // 2000)]
        mids = [(x.turn.mid[:, curve.joint], x.at.mid[:, curve.joint]) for x in parts]
        turn, at = (np.concatenate(x) for x in zip(*mids, strict=True))
        here = at + turn @ curve.own[1].mid
        points = curve.within(here, turn @ curve.own[0].mid)
        first, begin = self.joins(points, here, curve.begin, curve.places.mid[0])
        last, end = self.joins(points[::-1], here[::-1], curve.end, curve.places.mid[-1], True)
        last, end = len(nodes) - 1 - last, float(curve.ways[-1] - end)
        nearest_pose = float(curve.ways[np.abs(curve.ways - end).argmin()])
        end = nearest_pose if abs(nearest_pose - end) < 1e-9 else end  # backwards it was rounded
        need(first < last and begin < end, "path.follow: the link is on its curve nowhere between its two radii")
        ways = self.along(points[first : last + 1], begin, end)
        nodes, kept = nodes[first : last + 1], np.append(True, np.diff(ways) > 0)
        passed = curve.ways[(curve.ways > begin) & (curve.ways < end)]  # poses, at which parts end
        cuts = np.interp(passed, ways[kept], nodes[kept])
        near = np.searchsorted(cuts, nodes - CLOSE) < np.searchsorted(cuts, nodes + CLOSE)
        near[[0, -1]] = False
        every = np.concatenate([nodes[~near], cuts])
        order = np.argsort(every, kind="stable")
        self.nodes, self.ways = every[order], np.concatenate([ways[~near], passed])[order]
        apart = (np.diff(self.nodes) >= CLOSE / 2).all() and (np.diff(self.ways) >= 0).all()
        need(apart and self.within_parts(), "path.follow: the link passes poses faster than can be resolved")

    def within_parts(self) -> bool:
        """True if places stay between two poses from each node to the next."""
        ways, known = self.ways, self.curve.ways
        k = np.clip(np.searchsorted(known, (ways[1:] + ways[:-1]) / 2, side="right") - 1, 0, len(known) - 2)
        return bool(((known[k] <= ways[:-1]) & (ways[1:] <= known[k + 1])).all())

    def joins(
        self, points: Any, here: Any, radius: float | None, end: Any, backwards: bool = False
    ) -> tuple[int, float]:
        """The node, and the way from the curve's beginning, at which the link joins it: at once, or the last node at
        which it is on it and still is surely within the radius."""
        if radius is None:
            return 0, 0.0
        curve = self.curve
        vertices = curve.vertices[::-1] if backwards else curve.vertices
        ways = curve.ways[-1] - curve.ways[::-1] if backwards else curve.ways
        near = np.linalg.norm(here - end, axis=1) <= max(radius - 2 * curve.far, radius / 2)
        for i in range(len(points) if near.all() else int(near.argmin()), 0, -1):
            way, off = nearest(points[i - 1], vertices, ways, 0, len(ways) - 1)
            if off <= 1.0:
                return i - 1, way
        return 0, 0.0

    def along(self, points: Any, begin: float, end: float) -> Any:
        """Arc length along the curve to the nearest places of some points, one after the other."""
        vertices, ways = self.curve.vertices, self.curve.ways
        steps = lengths(np.diff(points, axis=0))
        found = np.full(len(points), begin)
        for i in range(1, len(points) - 1):
            low = min(int(np.searchsorted(ways, found[i - 1], side="right")), len(ways) - 1) - 1
            high = int(np.searchsorted(ways, found[i - 1] + AHEAD * steps[i - 1] + BESIDE)) + 1
            way, _ = nearest(points[i], vertices, ways, low, min(high, len(ways) - 1))
            found[i] = min(max(found[i - 1], way), end)
        found[-1] = end
        return found

    def off(self, spans: Any) -> Any:
        """True (k, 2) where the link's place, and its turn, may be beyond the tolerances on parts of the motion."""
        curve, world = self.curve, self.world
        segment, middle, half = curve.between(np.interp(spans, self.nodes, self.ways))
        motion, (turn, at), carried = Motion(world, spans), curve.own, world.carried[curve.joint]
        there, turned = curve.poses(segment, middle)
        place, rate, rest = motion.moved(curve.joint, at[None], False, carried)
        way = (curve.step[segment] * Ball(half, 2 * EPS)[:, None])[:, None]
        far = farthest(place - there[:, None], rate - way, rest)
        local, axes = (Ball(np.swapaxes(x.mid, -1, -2), np.swapaxes(x.rad, -1, -2)) for x in (turn, turned))
        axes = axes[:, curve.axes]
        side, rate, rest = motion.moved(curve.joint, local[curve.axes], True, carried)
        about = Ball(curve.about[segment] * half[:, None], LOG)
        bent = up((about.size * about.size).sum(axis=1)) / 2
        chords = farthest(side - axes, rate - cross(about[:, None], axes), rest + bent)
        most = chord(curve.angle) * (1.4142135623730950 if curve.free == "none" else 1.0)
        return np.stack([~(far <= curve.far + LIMIT_ROUNDING), ~(chords <= most)], axis=1)

    def check_ends(self) -> None:
        """Check that the link is within its radius while it is not on the curve, and so is what it leaves out."""
        curve, count = self.curve, float(len(self.world.control.mid))
        sides = (0, curve.begin, 0.0, self.nodes[0]), (-1, curve.end, self.nodes[-1], count)
        for end, radius, low, high in sides:
            if radius is None:
                continue
            centre, way = curve.places[end], self.ways[end]
            left = curve.ways <= way if end == 0 else curve.ways >= way
            segment, middle, _ = curve.between(np.array([[way, way]]))
            out = norm((joined([curve.places[left], curve.poses(segment, middle)[0]]) - centre).size)
            need((out <= radius).all(), "path.follow: what is left out of the curve is beyond the radius")
            bond = Bond("path.follow", curve.joint, curve.own[1][None], -1, centre[None], radius + LIMIT_ROUNDING)

            def off(spans: Any, bond: Bond = bond) -> Any:
                return ~(Motion(self.world, spans).apart(bond) <= bond.most)[:, None]

            everywhere("path.follow", ["the link, away from its curve,"], spans_of(low, high), off)

    @property
    def rated(self) -> Any:
        """Parts of the motion (k, 2) on which the tool's speed is limited: all but where it joins and leaves."""
        curve, low, high = self.curve, 0.0, float(len(self.world.control.mid))
        if curve.begin is not None:
            way = curve.beyond(curve.begin - curve.far)
            i = int(np.searchsorted(self.ways, way, side="right")) - 1
            low = low if i < 0 else float(self.nodes[i])
        if curve.end is not None:
            way = curve.ways[-1] - curve.beyond(curve.end - curve.far, backwards=True)
            i = int(np.searchsorted(self.ways, way))
            high = high if i == len(self.ways) else float(self.nodes[i])
        return spans_of(low, high) if low < high else spans_of(0.0, float(len(self.world.control.mid)))


def check_follow(world: World, content: Any) -> None:
    """Check that the link follows its curve on the whole motion."""
    need(not world.tracks, "path.follow: beside obstacles that move")
    curve = Curve(world, content)
    followed = Followed(world, curve)
    spans = np.stack([followed.nodes[:-1], followed.nodes[1:]], axis=1)
    everywhere("path.follow", ["the link's place", "the link's turn"], spans, followed.off)
    followed.check_ends()
    for order, most in ((1, curve.speed), (2, curve.acceleration)):
        if most is not None:
            check_tool(world, curve, followed.rated, order, most)


def check_tool(world: World, curve: Curve, spans: Any, order: int, most: float) -> None:
    """Check the speed of the link's origin (1), or its acceleration (2), on parts of the motion."""
    what = f"path.follow.{('speed', 'acceleration')[order - 1]}"
    need(curve.joint >= 0, f"{what}: of a link that stands still")
    rates = rates_of(world, what, order)

    def beyond(spans: Any) -> Any:
        q, v, *more = (parts_of(x, spans) for x in rates)
        zero = Line(*np.zeros((3, *q.mid.shape)))
        found = tool(world, curve, q, v, more[0] if more else zero)[order - 1]
        ends = [norm(np.abs(found.mid + sign * found.slope)) for sign in (1.0, -1.0)]
        size = above(np.maximum(*ends), up(norm(found.rad) + 4 * EPS * norm(np.abs(found.mid) + np.abs(found.slope))))
        return ~(size <= most * (1 + LIMIT_ROUNDING))[:, None]

    everywhere(what, ["the link"], spans, beyond)


def tool(world: World, curve: Curve, q: Line, v: Line, a: Line) -> tuple[Line, Line]:
    """Velocity and acceleration (k, 3) of the link's origin, in the frame of the joint that carries it."""
    frames, moved, known = forward(world, q, v, a)
    zero, rates = Line(*np.zeros((3, len(q.mid), 3))), list[Line]()
    for j, joint in enumerate(world.joints[: world.own]):
        rate = zero if joint.parent < 0 else rates[joint.parent] + wedge(known[joint.parent][0], moved[j])
        rate = times("...ij,...i->...j", frames[j], rate)
        rates.append(rate if joint.turns else rate + times("...,i->...i", v[:, j], still(joint.axis)))
    w, dw, change = known[curve.joint]
    arm = still(curve.own[1])
    return rates[curve.joint] + wedge(w, arm), change + wedge(dw, arm) + wedge(w, wedge(w, arm))


def spans_of(low: float, high: float) -> Any:
    """Parts (k, 2) of a motion from one place to another, none of which goes beyond a row."""
    cuts = np.unique([low, *np.arange(np.ceil(low), np.floor(high) + 1.0), high])
    return np.stack([cuts[:-1], cuts[1:]], axis=1)


def nearest(point: Any, vertices: Any, ways: Any, low: int, high: int) -> tuple[float, float]:
    """The way to the place nearest to a point on some straight parts, and how far it is from there."""
    begins, steps = vertices[low:high], vertices[low + 1 : high + 1] - vertices[low:high]
    off = point - begins
    share = np.clip((off * steps).sum(axis=1) / np.maximum((steps * steps).sum(axis=1), 1e-300), 0.0, 1.0)
    away = lengths(off - share[:, None] * steps)
    k = int(away.argmin())
    return float(ways[low + k] + share[k] * (ways[low + k + 1] - ways[low + k])), float(away[k])


def lengths(vectors: Any) -> Any:
    """Lengths along the last axis."""
    return np.sqrt((vectors * vectors).sum(axis=-1))
