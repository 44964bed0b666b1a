"""The kernel: check a proof that a robot's motion is free, in a world that somebody has read. NumPy alone.

    python -m hdplan.verify.kernel WORLD.json MOTION.proof

A world (`docs/world.md`) is joints, bodies, pairs and motion in plain numbers. A proof (`docs/proof.md`) holds no
geometry, only, for every pair of convex pieces, a binary tree of intervals of the motion with a direction n at every
leaf. "Accepted" is a theorem about real numbers; what it rests on is printed with it (`verdict`).

Numbers are enclosed (`balls`); every bound is rounded outward.

Leaves. On a leaf, -1 <= s <= 1, the joints are at q(s) = q_m + s d + e(s), |e_j| <= eps_j: the control points of the
motion's polynomials differ by at most eps from those of the straight line, so the curve does. Seen from the last body
that carries both pieces, a point x of a piece is at x + s (W x x + V) + r(s), with W and V the sums over the joints j
beyond that body of d_j z_j and d_j o_j x z_j (or d_j z_j, if j slides); z_j is the joint's axis, o_j a point on it, at
q_m. With rho_j the greatest distance of the piece from axis j (1 if j slides), |d2x / dq_i dq_j| <= rho_j for i at or
before j, and 0 if i slides, so that

    |r| <= R = 1/2 sum_j |d_j| rho_j (|d_j| [j turns] + 2 sum_(i<j, turns) |d_i|) + sum_j eps_j rho_j.

rho_j is at most the distance of axis j from the centre of a ball around the piece at q_m, plus its radius, plus what
the joints after j move the piece: sum_(k>j) (|d_k| + eps_k) rho_k. What is linear in s is least at s = -1 or 1, so that

    |n| distance >= min_(s = -1, 1) [min_(a in A) n.(a + s a') - max_(b in B) n.(b + s b')] - (R_A + R_B) |n|,

where least and greatest values over a piece are those over its corners, and of the ellipsoid that sweeps them.

Meshes. A mesh may be divided into groups of triangles, whose hulls contain every triangle, whatever the groups. It
encloses what no way to infinity leaves without meeting a triangle. Pieces that share a corner are connected; as they
never meet its triangles, all of them are outside of the mesh all the time if one of their points p is, once: if a ray
p + t n, t >= 0, misses every triangle. Seen from p, let a triangle have the corners u, v, w. It is missed if n.u, n.v,
n.w < 0. If it is met, a u + b v + c w = t n with a, b, c >= 0 and not all 0, so that t n.(u x v), t n.(v x w), t n.(w x
u) are c, a, b times D = (u x v).w; for t = 0 they, without t, are as c : a : b, and D = 0. So it is also missed if two
of these three and D have opposite signs. Where two surfaces never meet and are outside of one another, nothing is
within both: what is would end at one of them, within the other. That no link lies within another one of the same robot
is assumed.
"""

from __future__ import annotations

import itertools
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from .balls import (
    EPS,
    Ball,
    RejectedError,
    above,
    cos_sin,
    cross,
    dot,
    joined,
    need,
    norm,
    rejecting,
    shown,
    stack,
    up,
    where,
)
from .world import Bond, Piece, World, blossom, keys_of, loads, number

MAGIC, VERSION = b"hdplan proof\n", 5
MOST_BYTES, MOST_LINE, MOST_LEAVES = 1 << 27, 1 << 26, 200_000  # of a proof's content
DEEPEST = 44  # of a proof's trees
IN_PART = 4  # exit code
NARROWEST, INSTANT = 2.0**-30, 2.0**-36  # of an interval between two rows; of one that stands for a row
AT_ONCE, MOST_PARTS = 20_000, 50_000  # leaves checked together, and parts of rows within them
CLAIMS = (  # of a proof: clearances, and what `effects` checks, in this order
    *("clearance", "velocity", "acceleration", "jerk", "torque", "path"),
    *("limits", "start", "goal", "duration"),
)


# --- leaves -----------------------------------------------------------------------------------------------------------


def half(a: Any, b: Any) -> Any:
    """Cuts of intervals of the motion: between two rows if they have any within, or else in their middle."""
    return np.where(b - a > 1, np.floor((a + b) / 2), (a + b) / 2)


def leaves(counts: Any, depths: Any, rows: int) -> tuple[Any, Any, Any]:
    """The leaves of binary trees over [0, rows], by their number in each tree (P,) and their depths in order (L,):
    their different intervals (k, 2), which of these each has (L,), and whether those of a tree cover it (P,).

    With 2^DEEPEST for the whole, a leaf of depth k is 2^(DEEPEST - k) long (all together less than 2^63). Leaves that
    follow one another, each from a multiple of its length on, up to the whole are those of a tree."""
    need(depths.max(initial=0) <= DEEPEST and len(depths) <= MOST_LEAVES, "the trees are too deep, or too large")
    length = 1 << (DEEPEST - depths)
    ends, reached = np.cumsum(counts), np.append(0, np.cumsum(length))
    begin = reached[:-1] - np.repeat(reached[ends - counts], counts)
    whole = reached[ends] - reached[ends - counts] == 1 << DEEPEST
    whole[np.repeat(np.arange(len(counts)), counts)[begin % length != 0]] = False
    _, first, node = np.unique(begin << 6 | depths, return_index=True, return_inverse=True)  # a depth is below 2^6
    begin, depth, low, high = begin[first], depths[first], np.zeros(len(first)), np.full(len(first), float(rows))
    for level in range(depth.max(initial=0)):
        middle, later = half(low, high), begin >> (DEEPEST - 1 - level) & 1 == 1
        low, high = np.where((level < depth) & later, middle, low), np.where((level < depth) & ~later, middle, high)
    need((high - low >= NARROWEST).all(), "a leaf is too short")
    return np.stack([low, high], axis=1), node.ravel(), whole


def latest(times: Any, spans: Any) -> Any:
    """Upper bounds (k,) of |time| at rows `spans` (k, 2), 0 where there are no times."""
    if times is None:
        return np.zeros(len(spans))
    first = np.minimum(np.floor(spans).astype(int), len(times) - 2)
    found = np.abs(times[first] + (spans - first) * (times[first + 1] - times[first])).max(axis=1)
    return up(found) + 2.0**-40 * np.abs(times).max()


def picked(values: Any, *rows: Any) -> Any:
    """values[rows], with the rows innermost in memory: sums over what is left of the axes are then fast."""
    if isinstance(values, Ball):
        return Ball(picked(values.mid, *rows), picked(values.rad, *rows))
    at = np.ravel_multi_index(rows, values.shape[: len(rows)], mode="wrap")  # -1 is the last one
    return np.ascontiguousarray(values.reshape(-1, *values.shape[len(rows) :]).T).take(at, axis=-1).T


def farthest(gap: Ball, change: Ball, rests: Any) -> Any:
    """Upper bounds (k,) of the length of gap + s change + r as one vector, -1 <= s <= 1, of points (k, m, 3) or numbers
    (k, m), each of whose r is within `rests` (k,)."""
    ends = [norm((gap + sign * change).size.reshape(len(gap.mid), -1)) for sign in (1.0, -1.0)]
    return above(np.maximum(*ends), up(np.sqrt(gap.mid.shape[1]) * rests))


class Motion:
    """Joints, frames and reaches on intervals of the motion, one row each: see the head of this file."""

    def __init__(self, world: World, spans: Any, lags: bool = True) -> None:
        """Compute them for `spans` (k, 2) of the rows, exact numbers; of the motion as it is commanded, if nothing
        `lags`."""
        self.world, (low, high), degree = world, spans.T, world.control.mid.shape[1] - 1
        first, k, count = np.floor(low).astype(int), len(spans), len(world.joints)
        counts = np.ceil(high).astype(int) - first
        begins = np.cumsum(counts) - counts
        row, span = np.arange(counts.sum()) - np.repeat(begins - first, counts), np.repeat(np.arange(k), counts)
        start, end = (np.clip(x[span] - row, 0, 1)[:, None, None] for x in (low, high))
        part = blossom(world.control[row], start, end)
        self.step: Any = (part.mid[begins + counts - 1, -1] - part.mid[begins, 0]) / 2  # any numbers will do, as
        place = (row - low[span])[:, None] + start[:, 0] + (end - start)[:, 0] * np.arange(degree + 1) / degree
        line = Ball(2 * place / (high - low)[span, None] - 1, 16 * EPS)[:, :, None] * self.step[span, None]
        over = part.mid - line.mid
        edges = np.maximum.reduceat(over.max(axis=1), begins), np.minimum.reduceat(over.min(axis=1), begins)
        self.middle: Any = (edges[0] + edges[1]) / 2  # the middle: `off` is how far the curve is from their line
        self.off: Any = np.maximum.reduceat((part - (line + self.middle[span, None])).size.max(axis=1), begins)
        if world.unknown is not None:
            self.off = up(self.off + world.unknown.joints * lags)
            self.latest = latest(world.times, spans)
        self.most: Any = up(np.abs(self.step) + self.off)
        cos, sin = (x[..., None, None] for x in cos_sin(np.asfortranarray(self.middle)))
        still, once, twice = world.turns  # of each joint in the one before, moved by its value
        turn, at = still + sin * once + (1.0 - cos) * twice, world.origins + world.along * self.middle[:, :, None]
        step = joined([turn, at[..., None]], 3)  # rotation and origin, (3, 4) of every joint in the one before
        step = joined([step, Ball(np.zeros((4, 1, count, k)).T + [0.0, 0.0, 0.0, 1.0])], 2)
        frames = [Ball(np.zeros((4, 3, k)).T + np.eye(3, 4))] * (count + 1)  # in the world, whose own is the last
        for j, joint in enumerate(world.joints):
            frames[j] = dot("kij,kjl->kil", frames[joint.parent], step[:, j])
        frame = stack(frames, 1)
        self.turn, self.at = frame[..., :3], frame[..., 3]
        self.axis = dot("knij,nj->kni", self.turn[:, :-1], world.axis)
        turns, none = world.turning[:, None], Ball(np.zeros_like(self.axis.mid))
        moment = where(turns, cross(self.at[:, :-1], self.axis), self.axis)
        self.screw = joined([where(turns, self.axis, none), moment], 2)  # of each joint: its parts of W and V
        joint = world.joint[world.movers]
        self.ends = dot("kgij,gj->kgi", self.turn[:, joint], world.centers[world.movers]) + self.at[:, joint]
        self.reach = self.reaches(self.ends, world.radii[world.movers], world.carried[joint])

    def reaches(self, ends: Ball, radii: Any, carried: Any) -> Any:
        """Return rho (k, m, n) of balls around points (k, m, 3) that joints carry (m, n)."""
        x = [ends.mid[..., i] - self.at.mid[:, :-1, i].T[:, :, None] for i in range(3)]  # each (n, k, m)
        z = [self.axis.mid[..., i].T[:, :, None] for i in range(3)]
        across = [x[i - 2] * z[i - 1] - x[i - 1] * z[i - 2] for i in range(3)]
        size, away = (up(np.sqrt(up(sum(u * u for u in each)))) for each in (x, across))
        long, tilt, off = (norm(u).T[:, :, None] for u in (self.axis.mid, self.axis.rad, self.at.rad[:, :-1]))
        off = norm(ends.rad) + off + EPS * size
        away = up(away + off * (long + tilt) + size * (tilt + 8 * EPS * long))  # from each axis: |x times z|
        after, most = np.zeros(ends.mid.shape[:2]), self.most.T[:, :, None]
        for j in reversed(range(len(away))):
            far = up(away[j] + radii + after) if self.world.turning[j] else 1.0
            away[j] = np.where(carried[:, j], far, 0.0)
            after = up(after + most[j] * away[j])
        return away.transpose(1, 2, 0)

    def rest(self, step: Any, reach: Any, off: Any) -> Any:
        """Return R."""
        angle = np.abs(step) * self.world.turning
        before = angle @ np.triu(np.ones((angle.shape[1],) * 2), 1)
        return up((reach * (0.5 * np.abs(step) * (angle + 2 * before) + off)).sum(axis=1))

    def moved(self, joint: int, local: Ball, turns: bool, moves: Any) -> tuple[Ball, Ball, Any]:
        """Return points (m, 3) of a joint's frame, or directions (`turns`), as far as some joints move them: x and
        W x x + V (k, m, 3), or W x x, and R (k,) of each."""
        step = self.step * moves
        at = dot("kij,mj->kmi", self.turn[:, joint], local)
        at = at if turns else at + self.at[:, joint, None]
        twist = dot("kn,kni->ki", step, self.screw)[:, None]
        spin, slide = cross(twist[..., :3], at), twist[..., 3:]
        own = self.world.carried[[joint] * len(local.mid)]
        reach = self.world.turning[None] if turns else self.reaches(at, 0.0, own).max(axis=1)
        return at, spin if turns else spin + slide, self.rest(step, reach * moves, self.off)

    def apart(self, bond: Bond) -> Any:
        """Return upper bounds (k,) of how far a bond's points are from where they are to be, as one vector's length:
        that is convex in s, so greatest at s = -1 or 1. What carries both ends changes no length."""
        carried = self.world.carried[[bond.joint, bond.other]]
        sides = zip((bond.joint, bond.other), (bond.local, bond.target), carried & ~carried[::-1], strict=True)
        (one, rate, rest), (other, way, more) = (self.moved(x, y, bond.turns, moves) for x, y, moves in sides)
        gap, change = one - other, rate - way
        if bond.along is not None:
            gap, change = (dot("kmi,i->km", each, bond.along) for each in (gap, change))
        return farthest(gap, change, rest + more)

    def seen(self, joint: int, local: Ball, other: int) -> Ball:
        """Return the position of a point (3,) of a joint's frame in another's, anywhere on the first interval."""
        here = dot("ij,j->i", self.turn[0, joint], local) + self.at[0, joint]
        there = dot("ji,j->i", self.turn[0, other], here - self.at[0, other])
        carried = self.world.carried[[joint, other]]  # what carries both changes nothing
        reach = self.reaches(stack([here, here])[None], 0.0, carried)[0] * (carried & ~carried[::-1])
        return Ball(there.mid, up(there.rad + (self.most[0] * reach).sum()))

    def outside(self, mesh: tuple[Ball, Any], joint: int, pieces: list[Piece], way: Any) -> bool:
        """True if a ray shows that a corner of pieces of one body is outside of a mesh, whose points (m, 3) are in a
        joint's frame, on the first interval: by a ray along the direction `way` (3,) in that frame."""
        (body, *_), corners = pieces, np.concatenate([x.corners for x in pieces])
        toward = self.turn.mid[0, joint] @ way @ self.turn.mid[0, body.joint] @ body.pose[0].mid
        farthest = corners[np.argmax(corners @ toward)]  # any corner will do
        local = dot("ij,j->i", body.pose[0], farthest) + body.pose[1]
        points, triangles = mesh[0] - self.seen(body.joint, local, joint), mesh[1]
        ahead = dot("mi,i->m", points, way)
        seen = points[triangles[~(ahead.mid < -ahead.rad)[triangles].all(axis=1)]]  # all others are behind p
        sides = cross(seen, seen[:, [1, 2, 0]])
        across, volume = dot("fci,i->fc", sides, way), dot("fi,fi->f", sides[:, 0], seen[:, 2])
        signs = [(x.mid > x.rad).astype(int) - (x.mid < -x.rad) for x in (across, volume[:, None])]
        four = np.concatenate(signs, axis=1)
        return bool((four.min(axis=1) * four.max(axis=1) < 0).all())

    def gaps(self, node: Any, pairs: Any, normal: Any) -> Any:
        """Return lower bounds (L,) of the distance of pairs (L, 2) on intervals (L,) by directions (L, 3)."""
        moves, count = self.world.carried[self.world.joint], len(node)
        body, other = pairs.T.ravel(), pairs.T[::-1].ravel()
        moves, way = picked(moves, body) & ~picked(moves, other), np.concatenate([-normal.T, normal.T], axis=1).T
        most, rest = self.extremes(np.tile(node, 2), body, moves, way)
        length = norm(np.abs(normal))
        both = above(most[:, :count], most[:, count:]).max(axis=0)
        least = -above(both, up(length * (rest[:count] + rest[count:]))) / length
        found = np.where(least > 0, least * (1 - 8 * EPS), 2 * least)  # `length` may be too large
        unknown = self.world.unknown
        return found if unknown is None else -above(-found, unknown.closer(self, node, pairs))

    def extremes(self, node: Any, body: Any, moves: Any, d: Any) -> tuple[Any, Any]:
        """Return upper bounds (2, L) of d.(x + s x') over the points x of pieces at s = 1, -1, and R (L,)."""
        world, most, rest = self.world, np.empty((2, len(node))), np.zeros(len(node))
        moving, still = (np.flatnonzero(moves.any(axis=1) == x) for x in (True, False))
        row = np.concatenate([moving, moving, still])  # what stands still is where it is at either end
        at, moves, way = node[moving], picked(moves, moving), picked(d, moving)
        step, reach = picked(self.step, at) * moves, picked(self.reach, at, world.slot[body[moving]]) * moves
        rest[moving] = self.rest(step, reach, picked(self.off, at))
        twist = dot("ln,lni->li", step, picked(self.screw, at))
        spin, slide = cross(way, twist[:, :3]), dot("li,li->l", way, twist[:, 3:])
        node, body, joint = node[row], body[row], world.joint[body[row]]
        way = joined([spin + way, way - spin, Ball(picked(d, still))])  # in the world, the joint's frame, the piece's
        base = joined([slide, -slide, Ball(np.zeros(len(still)))]) + dot("li,li->l", way, picked(self.at, node, joint))
        way = dot("li,lij->lj", way, picked(self.turn, node, joint))
        base = base + dot("li,li->l", way, picked(world.at, body))
        way = dot("li,lij->lj", way, picked(world.turn, body))
        found = above(self.supports(body, way), above(base.mid, base.rad))
        most[:, moving], most[:, still] = found[: 2 * len(moving)].reshape(2, -1), found[2 * len(moving) :]
        return most, rest

    def supports(self, body: Any, d: Ball) -> Any:
        """Return upper bounds (L,) of d.x over the points x of pieces, for directions (L, 3) in their frames."""
        world, most, order = self.world, np.empty(len(body)), np.argsort(body, kind="stable")
        way, ends = d.mid.T.take(order, axis=1), np.flatnonzero(np.diff(body[order], append=-1)) + 1
        for begin, end in itertools.pairwise([0, *ends.tolist()]):
            corners = world.pieces[body[order[begin]]].corners
            count = 1 + 4_000_000 // len(corners)
            for i in range(begin, end, count):
                part = slice(i, min(i + count, end))
                most[order[part]] = (corners @ way[:, part]).max(axis=0)
        off = (d.rad + 8 * EPS * np.abs(d.mid)) * picked(world.size, body) + d.size * world.off[body, None]
        return above(most, up(off.sum(axis=1) + norm(picked(world.sweep, body) * d.size)))


# --- the proof --------------------------------------------------------------------------------------------------------

Trees = tuple[Any, Any, Any, Any, Any]
"""Of every pair the number of leaves (P,), their depths (L,) and directions (L, 3); rows (Q,) and directions (Q, 3)
of the rays that miss meshes."""


def unpack(data: bytes) -> tuple[dict[str, Any], bytes, dict[str, Any], Trees]:
    """Head, world of who wrote it as it stands there, groups of triangles by mesh, and trees of a proof's file."""
    need(data.startswith(MAGIC), "the file is not a proof")
    inflate = zlib.decompressobj()
    line, _, rest = inflate.decompress(data[len(MAGIC) :], MOST_BYTES).partition(b"\n")
    world, _, rest = rest.partition(b"\n")
    need(inflate.eof and not inflate.unused_data, "the proof is cut short, too large, or continues after its end")
    need(max(len(line), len(world)) <= MOST_LINE, "the proof's head or world is too long")
    head, at, arrays = loads(line), 0, list[Any]()
    need(type(head) is dict and head.get("version") == VERSION, f"the proof is not of version {VERSION}")
    keys_of(head, "the proof's head", "version files clearance self_clearance cuts pairs leaves rays claims")
    good = type(head["files"]) is type(head["cuts"]) is dict and type(head["claims"]) is list
    good = good and all(type(x) is str for x in head["claims"]) and {*head["claims"]} <= {*CLAIMS}
    need(good, "the proof's head: files, cuts or claims")
    sizes = [*((x, "<u2") for x in head["cuts"].values()), (head["pairs"], "<u4"), (head["leaves"], "<u1")]
    sizes += [(3 * head["leaves"], "<i4"), (head["rays"], "<u4"), (3 * head["rays"], "<i4")]
    for count, kind in sizes:
        need(type(count) is int and 0 <= count <= 5 * MOST_LEAVES, "the proof counts more than is allowed")
        array = np.frombuffer(rest[at : at + count * int(kind[2])], dtype=kind)
        need(len(array) == count, "the proof is shorter than its head says")
        arrays.append(array.astype(np.int64))
        at += array.nbytes
    need(at == len(rest), "the proof is longer than its head says")
    *groups, counts, depths, normals, rows, ways = arrays
    trees = counts, depths, normals.reshape(-1, 3).astype(np.float64), rows, ways.reshape(-1, 3).astype(np.float64)
    return head, world, dict(zip(head["cuts"], groups, strict=True)), trees


def least_distances(world: World, head: dict[str, Any]) -> Any:
    """The distance (P,) that a proof claims for each pair; of obstacles with a clearance of their own at least that."""
    kinds = ("clearance", "self_clearance")
    claimed = {key: number(head[key], key) for key in kinds if head[key] is not None}
    found = {kinds[int(x)] for x in np.unique(world.within)}
    need(found == {*claimed} and min(claimed.values(), default=1.0) > 0, "clearances are missing, or not above 0")
    usual = world.usual if "clearance" in head["claims"] else 0.0  # of obstacles without one of their own
    own = np.array([world.clearances.get(x.name, usual) * (x.kind == "obstacle") for x in world.pieces])
    between, beside = (claimed.get(key, 0.0) for key in reversed(kinds))
    return np.maximum(np.where(world.within, between, beside), own[world.pairs[:, 1]])


def check_apart(world: World, head: dict[str, Any], trees: Trees) -> None:
    """Check that the leaves cover the motion and keep the pairs apart, and that pieces are outside of meshes."""
    counts, depths, normals, rows, ways = trees
    pieces, least = world.pieces, least_distances(world, head)
    need(len(counts) == len(world.pairs), f"{len(world.pairs)} pairs are to be kept apart, the proof has {len(counts)}")
    need(counts.sum() == len(depths), "the pairs have other leaves than the proof")
    need(normals.any(axis=1).all(), "a direction is 0")
    spans, node, whole = leaves(counts, depths, len(world.control.mid))
    for p in np.flatnonzero(~whole)[:1]:
        both = " and ".join(pieces[i].key for i in world.pairs[p])
        raise RejectedError(f"{both}: the leaves do not cover the motion")
    pair, order = np.repeat(np.arange(len(counts)), counts), np.argsort(node, kind="stable")
    bodies, floor = world.pairs[pair], least[pair]
    parts = np.append(0, np.cumsum(np.ceil(spans[:, 1]) - np.floor(spans[:, 0])))[:-1]  # before each interval
    count = len(world.joints)
    at_once = max(1, min(AT_ONCE, 2_000_000 // ((len(world.movers) + 10) * (count + 12))))
    most_parts = min(MOST_PARTS, 500_000 // max(count, 1))
    chunk = parts[node[order]] // most_parts * len(order) + np.arange(len(order)) // at_once
    for chosen in np.split(order, np.flatnonzero(np.diff(chunk)) + 1) if len(order) else []:
        used, local = np.unique(node[chosen], return_inverse=True)
        found = Motion(world, spans[used]).gaps(local.ravel(), bodies[chosen], normals[chosen])
        for i in np.flatnonzero(~(found >= floor[chosen]))[:1]:
            leaf, (low, high) = chosen[i], spans[node[chosen[i]]]
            where = f"leaf {leaf}, from {low:.6g} to {high:.6g} of {len(world.control.mid)} intervals"
            short = f"its plane keeps them {found[i] * 1e3:.6g} mm apart, not {floor[leaf] * 1e3:.6g} mm"
            raise RejectedError(f"{' and '.join(pieces[i].key for i in bodies[leaf])}: {where}: {short}")
    check_outside(world, rows, ways)


def check_outside(world: World, rows: Any, ways: Any) -> None:
    """Check that pieces are outside of divided meshes, each at a row of the motion, by a ray."""
    need(len(rows) == len(world.outside), f"{len(world.outside)} rays are to miss meshes, the proof has {len(rows)}")
    need(rows.max(initial=0) < len(world.control.mid), "a ray begins after the motion")
    named = {x.body: x for x in world.pieces}
    for row in np.unique(rows).tolist():
        motion = Motion(world, np.array([[row, row + NARROWEST]]))
        for i in np.flatnonzero(rows == row).tolist():
            mesh, pieces = world.outside[i]
            missed = motion.outside(world.surfaces[mesh], named[mesh].joint, pieces, ways[i])
            need(missed, f"{pieces[0].key} and {named[mesh].key}: ray {i} may meet the mesh, at row {row}")


def proven_world(content: Any, head: dict[str, Any], cuts: dict[str, Any], trees: Trees) -> World:
    """The world whose bodies a proof keeps apart."""
    world = World(content, cuts)
    need({*cuts} <= {*world.parts}, "the proof divides what there is not")
    check_apart(world, head, trees)
    return world


def accept(content: Any, proof: bytes) -> tuple[str, bool]:
    """The statement that a proof proves in a world, and whether that is all that the world wants. Raises RejectedError,
    which names leaf, pair and reason."""
    from .verdict import statement

    with rejecting():
        head, _, cuts, trees = unpack(proof)
        return statement(proven_world(content, head, cuts, trees), head)


def main() -> int:
    """Check a proof in a world, from the command line."""
    if len(sys.argv) != 3:
        sys.exit("usage: python -m hdplan.verify.kernel WORLD.json MOTION.proof")
    if lacking := [name for name in sys.argv[1:] if not Path(name).is_file()]:
        print(f"{shown(lacking[0])}: no such file", file=sys.stderr)
        return 2
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # names hold any character
    try:
        with rejecting():
            words, whole = accept(loads(Path(sys.argv[1]).read_bytes()), Path(sys.argv[2]).read_bytes())
    except RejectedError as error:
        print(f"rejected: {error}")
        return 1
    print(words)
    return 0 if whole else IN_PART


if __name__ == "__main__":
    from .bounds import bounded

    bounded()
    sys.exit(main())
