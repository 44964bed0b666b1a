# ruff: noqa: D105
"""The claims of a proof beside clearances: limits, torques, path constraints, start and goal.

Values and rates of the joints are polynomials; on a part of the motion each is m + b s + r with |s| <= 1 (`Line`).
Parts are halved until a limit is kept for sure. Bonds are lengths of vectors that move as bodies do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .balls import CROSS, EPS, Ball, Pose, RejectedError, above, compose, cos_sin, dot, inverse, need, up
from .kernel import AT_ONCE, CLAIMS, INSTANT, Motion
from .world import Bond, World, blossom, keys_of, number, numbers, placed, symmetric, unit_vector

SAME_END, LIMIT_ROUNDING = 1e-6, 1e-9  # [rad, m or s] between ends of motion and world; by which a limit may be passed
RATE_NAMES = ("velocity", "acceleration", "jerk")


MAP = "...ij,...j->...i"  # of vectors by matrices


@dataclass(eq=False)
class Line:
    """Numbers m + b s + r, |s| <= 1 the same for all, |r| <= `rad`; arrays of one shape, the first axis for parts, if
    they are not the same for all."""

    mid: Any
    slope: Any
    rad: Any

    def __getitem__(self, key: Any) -> Line:
        return Line(self.mid[key], self.slope[key], self.rad[key])

    def __add__(self, other: Line) -> Line:
        mid, slope = self.mid + other.mid, self.slope + other.slope
        return Line(mid, slope, up(self.rad + other.rad + EPS * (np.abs(mid) + np.abs(slope))))

    @property
    def size(self) -> Any:
        """An upper bound of the absolute values."""
        return up(np.abs(self.mid) + np.abs(self.slope) + self.rad)


def still(x: Ball) -> Line:
    """The part that does not depend on s."""
    return Line(x.mid, np.zeros_like(x.mid), x.rad)


def times(spec: str, a: Line, b: Line) -> Line:
    """einsum of two, sums of at most 9 products: what is quadratic in s goes to the radius."""

    def sums(x: Any, y: Any) -> Any:
        return np.einsum(spec, x, y)

    one, two = np.abs(a.mid) + np.abs(a.slope), np.abs(b.mid) + np.abs(b.slope)
    rad = sums(np.abs(a.slope), np.abs(b.slope)) + sums(one, b.rad + 16 * EPS * two) + sums(a.rad, two + b.rad)
    return Line(sums(a.mid, b.mid), sums(a.mid, b.slope) + sums(a.slope, b.mid), up(rad))


def wedge(a: Line, b: Line) -> Line:
    """a x b of vectors."""
    parts = (CROSS, a.mid), (CROSS, a.slope), (np.abs(CROSS), a.rad)
    return times(MAP, Line(*(np.einsum("ijk,...k->...ij", x, y) for x, y in parts)), b)


def line_of(control: Ball) -> Line:
    """Polynomials (k, n) by their control points (k, d + 1, n), -1 <= s <= 1: those of m + b s are m + b (2 i / d - 1),
    and a curve is no farther from it than its control points are from these."""
    slope = (control.mid[:, -1] - control.mid[:, 0]) / 2
    degree = control.mid.shape[1] - 1
    line = Ball(2 * np.arange(degree + 1) / max(degree, 1) - 1, 4 * EPS)[None, :, None] * slope[:, None]
    over = control - line
    mid = (over.mid.max(axis=1) + over.mid.min(axis=1)) / 2
    return Line(mid, slope, (over - mid[:, None]).size.max(axis=1))


# --- limits -----------------------------------------------------------------------------------------------------------


def limits_of(world: World, name: str) -> tuple[Any, Any]:
    """The least and the most (n,) of values, rates or torques of all joints, with the allowed excess; infinite
    where nothing limits them."""
    bounds, value = world.limits.get(name), name == "position"
    need(type(bounds) is list and len(bounds) == world.own, f"limits.{name}: one for every joint is expected")
    pairs = (zip(x if value else (x, x), (-np.inf, np.inf), strict=True) for x in bounds)
    ends = [[none if x is None else number(x, f"limits.{name}") for x, none in pair] for pair in pairs]
    low, high = np.array(ends).T
    need(value or (high >= 0).all(), f"limits.{name}: is negative")
    most = high * (1 + LIMIT_ROUNDING)
    return (low - LIMIT_ROUNDING, high + LIMIT_ROUNDING) if value else (-most, most)


def rates_of(world: World, name: str, order: int) -> list[Ball]:
    """The control points of the joints' values and of their time derivatives, as far as they exist: a motion is
    smooth enough by the rule of its interpolation, but for its ends, where it is to be at rest, or to have the rates
    that the world gives them."""
    need(world.clock is not None, f"limits.{name}: the motion has no times")
    need(world.curve.mid.shape[1] >= 2 * order, f"limits.{name}: the motion's interpolation is not smooth enough")
    rates = [world.curve]
    for k in range(order):
        last = rates[-1]
        if k > 0:
            ends = (("start", 0), ("goal", -1))
            jumps = [(rate_there(world, last, place, k) - rate_at(world, end, k)).size.max() for end, place in ends]
            need(max(jumps) <= SAME_END, f"limits.{name}: the motion begins or ends with a jump")
        rates.append(derivative(world, last))
    return rates


def derivative(world: World, control: Ball) -> Ball:
    """The control points of the time derivative of polynomials between rows."""
    share = inverse(Ball(world.clock[1:]) - world.clock[:-1])[:, None, None]
    return (control[:, 1:] - control[:, :-1]) * (float(control.mid.shape[1] - 1) * share)


def rate_at(world: World, end: str, order: int) -> Ball:
    """The rates of all joints (n,) that the world gives the start or the goal: velocities or accelerations, which are 0
    if it says nothing, or leaves a choice."""
    targets, name = getattr(world, end), RATE_NAMES[order - 1]
    need(type(targets) is list and all(type(x) is dict for x in targets), f"{end}: targets are expected")
    moved = [x for x in targets if {*RATE_NAMES} & {*x}]
    need(not moved or len(targets) == 1, f"{end}: has a velocity, and leaves a choice")
    if not moved or name not in moved[0]:
        return Ball(np.zeros(world.own))
    return of_all(world, numbers(moved[0][name], (len(world.lead),), f"{end}.{name}"))


def rate_there(world: World, control: Ball, place: int, order: int) -> Ball:
    """The rates of all joints (n,) at the first row (0) or the last (-1): where the rows have them, these are the
    curve's, or else they are known by its control points."""
    return of_all(world, world.given[order][place]) if order < len(world.given) else control[place, place]


def of_all(world: World, lead: Any) -> Ball:
    """Rates of all joints (n,) by those of the leading ones."""
    led = (x.follows or (i, 1.0, 0.0) for i, x in enumerate(world.joints[: world.own]))
    leaders, factors = zip(*((world.lead.index(i), factor) for i, factor, _ in led), strict=True)
    return Ball(lead[list(leaders)]) * np.array(factors)


def at_rates(world: World, names: list[str], end: str) -> bool:
    """True if the motion's end has these rates of a target; a motion without times has none, and is to need none."""
    control, place = world.curve, 0 if end == "start" else -1
    for order, name in enumerate(names, 1):
        required = rate_at(world, end, order)
        need(world.clock is not None or not required.size.any(), f"{end}.{name}: is not 0, and the motion has no times")
        if world.clock is not None:
            control = derivative(world, control) if control.mid.shape[1] > 1 else control * 0.0
            if not (rate_there(world, control, place, order) - required).size.max() <= SAME_END:
                return False
    return True


def between_rows(control: Ball) -> Any:
    """The intervals (k, 2) of a motion."""
    return np.arange(float(len(control.mid)))[:, None] + [0, 1]


def everywhere(name: str, of: list[str], spans: Any, beyond: Callable[[Any], Any]) -> None:
    """Check that nothing (k, m), named by `of`, is `beyond` a limit on parts (k, 2) of a motion. Where that is not sure
    parts are halved, until it is so at the middle of one."""
    while len(spans):
        spans = spans[np.concatenate([beyond(x).any(axis=1) for x in np.array_split(spans, 1 + len(spans) // 5000)])]
        middle = spans.mean(axis=1)[:, None]
        if not len(spans):
            return
        surely: Any = beyond(np.concatenate([middle, middle + INSTANT], axis=1)[:5000])
        finest = bool(len(spans) > AT_ONCE or spans[0, 1] - spans[0, 0] < 2.0**-20)
        for row, column in np.argwhere(surely | finest)[:1]:
            where = f"{of[column]} is beyond it, or too close to it to be shown"
            raise RejectedError(f"{name}: {where}, after row {spans[row, 0]:.6g}")
        ends = [spans[:, :1], middle], [middle, spans[:, 1:]]
        spans = np.concatenate([np.concatenate(each, axis=1) for each in ends])


def parts_of(control: Ball, spans: Any) -> Line:
    """Polynomials, known by their control points, on parts (k, 2) of the motion."""
    row = np.floor(spans[:, 0]).astype(int)
    return line_of(blossom(control[row], *((x - row)[:, None, None] for x in spans.T)))


def check_limit(world: World, name: str) -> None:
    """Check a limit on the joints' values, or on a time derivative of them."""
    (low, high), order = limits_of(world, name), ("position", *RATE_NAMES).index(name)
    control = rates_of(world, name, order)[-1] if order else world.curve
    if world.unknown is not None and order < 2:  # by as much the joints' own may be off
        off = (world.unknown.joints, world.unknown.rates)[order][: world.own]
        low, high = low + off, high - off

    def outside(spans: Any) -> Any:
        q = parts_of(control, spans)
        reach = up(np.abs(q.slope) + q.rad)
        return ~((-above(-q.mid, reach) >= low) & (above(q.mid, reach) <= high))

    everywhere(f"limits.{name}", [f"joint '{x.name}'" for x in world.joints], between_rows(control), outside)


def check_torques(world: World) -> None:
    """Check the limits of torques: inverse dynamics (Luh, Walker and Paul 1980) of numbers that are linear in s but for
    a radius, from the joints' values and rates on parts of the motion. Gravity is 9.81 m/s^2 along -z."""
    joints, written = world.joints[: world.own], world.loads
    need(not any(x.follows for x in joints), "limits.torque: nothing says how joints that follow others share a load")
    (_, most), rates = limits_of(world, "torque"), rates_of(world, "torque", 2)
    need(type(written) is list and len(written) == len(joints), "loads: one for every joint is expected")
    loads = []
    for i, each in enumerate(written):
        mass, moment, inertia, off = keys_of(each, f"loads[{i}]", "mass moment inertia off")
        need(mass >= 0, f"loads[{i}]: a mass below 0")
        loads.append([Ball(mass, off), Ball(moment, off), Ball(symmetric(inertia), off)])

    def beyond(spans: Any) -> Any:
        return ~(torques(world, loads, *(parts_of(each, spans) for each in rates)) <= most)

    everywhere("limits.torque", [f"joint '{x.name}'" for x in joints], between_rows(world.curve), beyond)


def torques(world: World, loads: list[list[Ball]], q: Line, v: Line, a: Line) -> Any:
    """Upper bounds (k, n) of torques, or forces, of joints at values, velocities and accelerations (k, n)."""
    joints = world.joints[: world.own]
    frames, moved, known = forward(world, q, v, a, 9.81)  # what stands under gravity seems to rise
    force, torque = [], []
    for (mass, first, inertia), (w, dw, acc) in zip(([still(x) for x in each] for each in loads), known, strict=True):
        force.append(times("...,...i->...i", mass, acc) + wedge(dw, first) + wedge(w, wedge(w, first)))
        spin, turning = (times(MAP, inertia, x) for x in (w, dw))
        torque.append(wedge(first, acc) + turning + wedge(w, spin))
    sizes = []
    for j in reversed(range(len(joints))):
        sizes.append(times("...i,i->...", torque[j] if joints[j].turns else force[j], still(joints[j].axis)).size)
        if (parent := joints[j].parent) >= 0:
            pull, twist = (times(MAP, frames[j], x) for x in (force[j], torque[j]))
            force[parent], torque[parent] = force[parent] + pull, torque[parent] + twist + wedge(moved[j], pull)
    return np.stack(sizes[::-1], axis=1)


def forward(
    world: World, q: Line, v: Line, a: Line, rises: float = 0.0
) -> tuple[list[Line], list[Line], list[tuple[Line, Line, Line]]]:
    """For each joint the rotation and the origin in the frame of the joint before, and in its own frame how it turns,
    how that changes, and how its origin accelerates, if the base `rises` so fast."""
    zero = Line(*np.zeros((3, len(q.mid), 3)))
    base = zero, zero, zero + still(Ball([0, 0, rises]))
    frames, moved, known = [], [], list[tuple[Line, Line, Line]]()
    for j, joint in enumerate(world.joints[: world.own]):
        frame, origin = turned_line(world, j, q[:, j]), still(world.origins[j])
        ways = (q, world.along[j]), (v, joint.axis), (a, joint.axis)
        shift, rate, change = (times("...,i->...i", x[:, j], still(way)) for x, way in ways)
        origin = origin + shift
        w, dw, acc = known[joint.parent] if joint.parent >= 0 else base
        acc = acc + wedge(dw, origin) + wedge(w, wedge(w, origin))
        w, dw, acc = (times("...ij,...i->...j", frame, x) for x in (w, dw, acc))
        swerve = wedge(w, rate)
        if joint.turns:
            w, dw = w + rate, dw + swerve + change
        else:
            acc = acc + swerve + swerve + change
        known.append((w, dw, acc))
        frames.append(frame)
        moved.append(origin)
    return frames, moved, known


def turned_line(world: World, joint: int, angle: Line) -> Line:
    """Rotations of a joint in the one before: with a = m + b s + r, sin a and cos a are off their first-order
    expansions at m by at most b^2 / 2 + |r|."""
    cos, sin = cos_sin(angle.mid)
    off = up(angle.slope * angle.slope / 2 + angle.rad)

    def times_(value: Ball, rate: Ball, matrix: Ball) -> Line:
        slope = rate.mid * angle.slope
        rad = up(value.rad + off + up(rate.rad * np.abs(angle.slope)) + EPS * np.abs(slope))
        return times("...,ij->...ij", Line(value.mid, slope, rad), still(matrix))

    unturned, once, twice = (each[joint] for each in world.turns)
    return still(unturned) + times_(sin, cos, once) + times_(1.0 - cos, sin, twice)


# --- poses and path constraints ---------------------------------------------------------------------------------------


def chord(angle: float) -> float:
    """Return a lower bound of 2 sin(angle / 2), the distance between unit vectors at an angle (of at most pi) apart."""
    sin = cos_sin(min(angle, 4.0) / 2 + LIMIT_ROUNDING / 2)[1]
    return np.inf if angle > 3.15 else float(2 * (sin.mid - sin.rad) * (1 - 4 * EPS))


def link_of(world: World, name: Any) -> tuple[int, Pose]:
    """The joint that carries a link or a held object, and where its frame is in that of the joint."""
    found: dict[str, tuple[int, Pose]] = {x.name: (x.joint, x.pose) for x in world.pieces if x.kind == "held"}
    found |= world.links
    need(name in found, f"'{name}' is not a link of the world, and not held")
    return found[name]


def bonds_of_path(world: World, constraints: Any, begins: Callable[[], bool]) -> list[Bond]:
    """Bonds that keep the path constraints; `begins` is True if the motion begins at the start."""
    found = list[Bond]()
    for each in constraints:
        kind = each.get("kind")
        what = f"path.{kind}"
        if kind == "upright":
            _, link, axis, off, tolerance = keys_of(each, what, "kind link axis off tolerance")
            joint, pose = link_of(world, link)
            way = unit_vector(axis, off, what)
            local = dot("ij,j->i", pose[0], way)[None]
            found.append(Bond(what, joint, local, -1, Ball(np.eye(3)[2:]), chord(tolerance - off), True))
        elif kind == "position":
            ((_, link, point, size, (turn, centre)),) = placed([(what, each)], "kind link point size")
            joint, pose = link_of(world, link)
            local = (dot("ij,j->i", pose[0], point) + pose[1])[None]
            need(len(size) == 3, f"{what}.size: three numbers are expected")
            for i, edge in enumerate(size):
                if edge is not None:
                    most = number(edge, what) / 2 + LIMIT_ROUNDING
                    found.append(Bond(what, joint, local, -1, centre[None], most, along=turn[:, i]))
        else:
            need(kind == "relative", f"{what}: is not known")
            keys = "kind link to frame position_tolerance orientation_tolerance"
            _, link, to, place, off, angle = keys_of(each, what, keys)
            one, other = link_of(world, link), link_of(world, to)
            if place is None:
                need(begins(), f"{what}: the motion does not begin at the start")
                begin = Motion(world, np.array([[0.0, INSTANT]]))
                a, b = (compose((begin.turn[0, j], begin.at[0, j]), pose) for j, pose in (one, other))
                there = dot("ji,jk->ik", b[0], a[0]), dot("ji,j->i", b[0], a[1] - b[1])
            else:
                ((there,),) = placed([(what, place)])
            found += bonds_of_pose(what, one, (other[0], compose(other[1], there)), (off, angle, "none"))
    return found


def bonds_of_pose(what: str, link: tuple[int, Pose], to: tuple[int, Pose], tolerances: Any) -> list[Bond]:
    """Bonds that keep a link's frame at another one, within tolerances; about one of its axes it may be free."""
    (joint, pose), (other, target), (off, angle, free) = link, to, tolerances
    bonds = [Bond(what, joint, pose[1][None], other, target[1][None], off + LIMIT_ROUNDING)]
    need(free in ("none", "x", "y", "z", "all"), f"{what}: free '{free}'")
    if free != "all":
        axes = [0, 1, 2] if free == "none" else ["xyz".index(free)]
        one, two = (Ball(x[0].mid.T, x[0].rad.T)[axes] for x in (pose, target))
        # the columns of two rotations an angle apart differ by 2 sqrt(2) sin(angle / 2) in all
        most = chord(angle) * (1.4142135623730950 if free == "none" else 1.0)
        bonds.append(Bond(what, joint, one, other, two, most, True))
    return bonds


def check_path(world: World, constraints: Any, begins: Callable[[], bool]) -> None:
    """Check the path constraints on the whole motion."""
    from .follow import check_follow

    for each in (x for x in constraints if x.get("kind") == "follow"):
        check_follow(world, each)
    for bond in bonds_of_path(world, [x for x in constraints if x.get("kind") != "follow"], begins):

        def off(spans: Any, bond: Bond = bond) -> Any:
            return ~(Motion(world, spans).apart(bond) <= bond.most)[:, None]

        everywhere(bond.what, ["the link"], between_rows(world.control), off)


def reached(world: World, end: str) -> bool:
    """True if the motion begins at one of the world's targets, or ends there."""
    targets = getattr(world, end)
    need(type(targets) is list and targets, f"{end}: targets are expected")
    return any([at_poses(world, x, end) if "poses" in x else at_values(world, x, end) for x in targets])


def at_poses(world: World, target: Any, end: str) -> bool:
    """True if the motion ends with links at poses."""
    (poses,), count = keys_of(target, end, "poses"), float(len(world.control.mid))
    there = placed([(end, x) for x in poses], "link position_tolerance orientation_tolerance free")
    last, bonds = Motion(world, np.array([[count - INSTANT, count]]), lags=False), list[Bond]()
    for link, *within, at in there:
        bonds += bonds_of_pose(end, link_of(world, link), (-1, at), within)
    return end == "goal" and len(there) > 0 and all(bool((last.apart(x) <= x.most).all()) for x in bonds)


def at_values(world: World, target: Any, end: str) -> bool:
    """True if the motion's end is at joint values, and all other joints that a target names at theirs; at a goal,
    joints that turn without limits, and that nothing follows, may be whole turns away."""
    rates = [x for x in ("velocity", "acceleration") if x in target]
    need(rates[:1] != ["acceleration"], f"{end}: an acceleration without a velocity")
    values, others, *_ = keys_of(target, end, " ".join(["joints", "others", *rates]))
    low, high = limits_of(world, "position")
    row, lead = world.rows[0 if end == "start" else -1], world.lead
    off = row - numbers(values, (len(lead),), end)
    followed = {x.follows[0] for x in world.joints if x.follows}
    free = [world.joints[i].turns and i not in followed and np.isinf(low[i]) and np.isinf(high[i]) for i in lead]
    off = off - 2 * np.pi * np.rint(off / (2 * np.pi)) * (np.array(free) & (end == "goal"))
    at = world.curve[-1, -1] if end == "goal" else world.curve[0, 0]
    here = dict(world.held)
    here |= {x.name: float(at.mid[i]) for i, x in enumerate(world.joints[: world.own]) if x.follows}
    need({*others} <= {*here}, f"{end}: names an unknown joint")
    more = [here[name] - number(value, end) for name, value in others.items()]
    return bool((np.abs([*off, *more]) <= SAME_END).all()) and at_rates(world, rates, end)


# --- the claims -------------------------------------------------------------------------------------------------------


def wanted(world: World) -> list[str]:
    """Demands of a world beside clearances, by the claims that meet them."""
    limits = world.limits
    need(type(limits) is dict and {*limits} <= {"position", "torque", *RATE_NAMES}, "limits: of what is not known")
    found = ["limits", "start", "goal", *(x for x in limits if x != "position")]
    return found + ["path"] * bool(world.path) + ["duration"] * (world.duration is not None)


def check_claim(world: World, claim: str) -> None:
    """Check what a proof may claim beside clearances."""
    if claim in ("limits", *RATE_NAMES):
        check_limit(world, "position" if claim == "limits" else claim)
    elif claim == "torque":
        check_torques(world)
    elif claim == "path":
        check_path(world, world.path, lambda: reached(world, "start"))
    elif claim == "duration":
        took = world.clock[-1] - world.clock[0] if world.clock is not None else np.nan
        need(abs(took - number(world.duration, "duration")) <= SAME_END, f"duration: the motion takes {took:g} s")
    else:
        need(reached(world, claim), f"{claim}: the motion's end is elsewhere")


def check_claims(world: World, head: dict[str, Any]) -> None:
    """Check all that a proof claims beside clearances."""
    for claim in CLAIMS:
        if claim in head["claims"] and claim != "clearance":
            check_claim(world, claim)
