"""Stages of a job that pass into one another without a stop: their planned motions, as one.

Curves that are blended into one another are timed as one motion from rest to rest along all of them (`compound`). Where
a move is one of the two, they are blended by their timing: the second begins a while before the first has ended, and
in the meantime both add up,

    q(t) = q₁(t) + q₂(t − T₁ + τ) − q,    q where the first ends and the second begins,

with the longest τ for which the link stays within the radius, and the limits hold, for which moves may be slowed; a
shorter one, where that does not lead to a certificate. Where the path of such a sum, timed again (`retimed_path`), is
driven sooner, and certified, it takes its place. The marks of stages are at the middles of the blends; each is
certified as it is driven.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.job.blends import UnblendedError, quintic
from hdplan.planner.job.certify import Proven, certified_stage
from hdplan.planner.job.compound import LEAST_ROWS, MOST_ROWS, ROWS, Arc, Driven, Path, parts_of
from hdplan.planner.job.curves import corner_of, leg_of, link_of, radius_link, settled
from hdplan.planner.job.following import NotFollowedError
from hdplan.planner.job.joining import Piece, exactly_timed, one_after_other
from hdplan.planner.job.overlap import columns_of, in_step, longest_overlap, overlapped, slowed
from hdplan.planner.job.places import link_pose
from hdplan.planner.job.retimed import retimed_path
from hdplan.planner.job.stage_scenes import stage_setup, stage_source
from hdplan.planner.job.stops import rests, with_stops
from hdplan.planner.job.world import World
from hdplan.planner.motion.curve import Curve as MotionCurve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.path_spline import PathSpline
from hdplan.planner.timing.retiming import Retimer
from hdplan.planner.timing.tool_limit import ToolLimit, ToolRates
from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import Circle, Curve
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.job import Move, Stage
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.stage import ArmStage
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.timing import Timing

OVERLAP_SHARES = (1.0, 0.6, 0.3, 0.1)  # of the longest overlap of two motions
TIME_FACTORS = (1.0, 1.02, 1.05, 1.1, 1.2, 1.35, 1.5)  # times as long as they would take, of moves
DENSITY_FACTORS = (1, 4, 12)  # times as many configurations along curves
LIMIT_ROUNDING = 1e-9  # [–] relative, by which a limit may be exceeded
LEAST_ROW_GAP = 1e-4  # [s] least distance of an inserted row from others: rounding would count in accelerations
BEYOND_MIDDLE = 0.2  # share of half a blend for which a part's tool rates are planned beyond its middle
ROW_STEPS = 8  # of looking for a row


@dataclass(frozen=True)
class _Unit:
    """A motion from rest to rest, of one stage or of several curves."""

    motion: Trajectory
    marks: tuple[float, ...]  # [s] after its beginning, at which its stages begin; the first is 0


class NotBlendedError(Exception):
    """Stages that are not driven as one, and why."""


INTERRUPTED = "interrupted before that was tried"
Late = Callable[[], str]  # says why there is no more time; nothing while there is


def groups_of(stages: Sequence[Stage]) -> Iterator[range]:
    """Yield the numbers of stages that are driven as one, where there are several."""
    first = 0
    for i, stage in enumerate(stages):
        if not (isinstance(stage, ArmStage) and stage.blend):
            if i > first:
                yield range(first, i + 1)
            first = i + 1


def blended(world: World, pieces: Sequence[Piece], late: Late) -> tuple[list[Piece], list[str]]:
    """Return the pieces of stages, each planned from rest to rest, with those blended that are to be; `world` is what
    there is at first. Where that does not lead to a certificate, takes longer, or time is up, they stop as they were
    planned, with a note. Raises InputError as `certified_stage`."""
    found, notes, names = [*pieces], [], world.job.names
    scene = with_stops(world.scene, [len(pieces) - 1]) if len(pieces) < len(names) else world.scene
    open_ = [range(each[0], min(each[-1] + 1, len(pieces))) for each in groups_of(world.job.stages)]
    while open_:
        group = open_.pop(0)
        if len(group) < 2:  # the last one that was planned
            continue
        before = replace(pieces[group[0] - 1].after if group[0] else world, scene=scene)
        try:
            found[group[0] : group[-1] + 1] = _as_one(before, group, [pieces[k] for k in group], late)
        except (NotBlendedError, KeyboardInterrupt) as error:
            if isinstance(error, KeyboardInterrupt):
                late = functools.partial(str, INTERRUPTED)
            stop = group[(len(group) - 1) // 2]
            notes.append(f"{names[stop]}: not blended into '{names[stop + 1]}': {str(error) or INTERRUPTED}")
            scene = with_stops(scene, [stop])
            open_[:0] = [range(group[0], stop + 1), range(stop + 1, group[-1] + 1)]
    return found, notes


def _as_one(world: World, group: range, pieces: Sequence[Piece], late: Late) -> list[Piece]:
    """Blend one group of stages. Raises NotBlendedError."""
    stages, why, rested = world.job.stages, "", sum(piece.motion.duration or 0.0 for piece in pieces)
    starts = [k for k in group if k == group[0] or not _are_curves(stages, k - 1)]
    runs = [range(first, last) for first, last in itertools.pairwise([*starts, group[-1] + 1])]
    worlds = _worlds(world, group, pieces)

    def in_time() -> None:
        if reason := late():
            raise NotBlendedError(reason)

    for finer in DENSITY_FACTORS if len(runs) < len(group) else DENSITY_FACTORS[:1]:
        in_time()
        try:
            units = [_unit(worlds, run, pieces, run[0] - group[0], finer) for run in runs]
            apart, (units, overlaps) = units, _overlapping(worlds, runs, units, in_time)
        except UnblendedError as error:
            raise InputError(f"{stage_source(world.scene, error.number)}: blend: {error}") from None
        except InputError:
            raise
        except (NotFollowedError, HdplanError) as error:
            raise NotBlendedError(str(error)) from None
        coarse = False  # whether finer steps may help
        for motions in _ways(worlds, group, runs, apart, units, overlaps, in_time):
            in_time()
            seconds = sum(motion.duration or 0.0 for motion in motions)
            if seconds >= rested:
                why, coarse = why or f"it would take {seconds:.4g} s, and {rested:.4g} s with a stop", True
                continue
            if any(rests(motion, -1) for motion in motions[:-1]):
                why = why or "it would stop in the middle, where such a blend is a cusp"
                continue
            made, wrong = _certified(world, group, motions, pieces)
            if wrong is None:
                return made
            why, coarse = why or wrong.text, wrong.status is Status.OFF_PATH
        if not coarse:
            break
    raise NotBlendedError(why)


def _ways(
    worlds: Sequence[World],
    group: range,
    runs: Sequence[range],
    apart: Sequence[_Unit],
    units: Sequence[_Unit],
    overlaps: Sequence[float],
    in_time: Callable[[], None],
) -> Iterator[list[Trajectory]]:
    """Yield the motions of all stages: where units overlap, first along their sums, timed again, from units that are
    not slowed, and then these sums, the longest overlaps first; shorter ones lead to a certificate where these do
    not."""
    if overlaps:
        yield from _sooner(worlds, group, runs, apart, _added(units, overlaps)[0], in_time)
    for share in OVERLAP_SHARES if overlaps else OVERLAP_SHARES[:1]:
        yield _cut(*_added(units, [share * each for each in overlaps]))


def _worlds(world: World, group: range, pieces: Sequence[Piece]) -> list[World]:
    """Return the world before each stage; a curve begins where the stage before would have ended."""
    found, stages = [], world.job.stages
    for number, piece in zip(group, pieces, strict=True):
        if world.corner is not None and isinstance(stage := stages[number], Curve):
            (q,) = piece.motion.positions[:1]
            rotation = link_pose(world.robot, q, link_of(stage, world))[:3, :3]
            world = replace(world, corner=settled(world.corner, rotation))
        found.append(world)
        if number != group[-1]:
            world = replace(piece.after, scene=world.scene, corner=corner_of(world, number))
    return found


def _unit(worlds: Sequence[World], run: range, pieces: Sequence[Piece], first: int, finer: int) -> _Unit:
    """Return the motion of one stage as it was planned, or that of several curves; they begin with the `first` of the
    group."""
    mine = slice(first, first + len(run))
    if len(run) == 1:
        return _Unit(in_step(pieces[first].motion, _rate(worlds[first])), (0.0,))
    try:
        return _along_curves(worlds[mine], run, pieces[mine], finer)
    except UnblendedError as error:
        error.number += run[0]
        raise


def _along_curves(worlds: Sequence[World], run: range, pieces: Sequence[Piece], finer: int) -> _Unit:
    """Return the motion along curves that are blended."""
    world = worlds[0]
    stages = [world.job.stages[k] for k in run]
    robot, driven = stage_setup(world, run[0]).robot, []
    for number, there, stage, piece in zip(run, worlds, stages, pieces, strict=True):
        assert isinstance(stage, Curve)
        leg, _ = leg_of(there, number)
        if isinstance(stage, Circle):
            leg = Arc(leg.poses, leg.free, leg.speed, leg.acceleration)
        driven.append(Driven(robot, piece.motion, leg, link_of(stage, there)))
    parts = parts_of(driven, [stage.blend for stage in stages[:-1] if isinstance(stage, Curve)])
    path = Path(robot, driven[0].link, driven[0].leg.free, parts)
    setup = _as_one_motion(world, run)
    cuts = path.cuts
    count = int(np.clip(np.ceil(ROWS * cuts[-1] / max(path.shortest, 1e-9)), LEAST_ROWS, MOST_ROWS)) * finer
    ends = pieces[0].motion.positions[0], pieces[-1].motion.positions[-1]  # exact: other stages begin there
    motions, marks, begins, retimer = [], [0.0], 0.0, Retimer(setup)
    speeds = np.array([stage.speed for stage in stages])
    for first, last in itertools.pairwise(cuts):
        number = max(5, int(np.ceil(count * (last - first) / cuts[-1])) + 1)
        rows = path.rows(np.linspace(first, last, number))
        rows = _from_to(
            rows, *(end if at in (0.0, cuts[-1]) else None for end, at in zip(ends, (first, last), strict=True))
        )
        waypoints = Trajectory(robot.joint_names, rows, robot.locked)
        drawn = scipy.interpolate.make_interp_spline(np.linspace(0.0, 1.0, len(rows)), rows)
        rates = _tool_rates(path, driven, first, last)
        rated = any(each is not None for rate in rates for each in (rate.speed, rate.acceleration))
        paced = (retimer.with_limit(ToolLimit(robot, path.link, rates)) if rated else retimer).with_speeds(
            speeds, np.asarray(path.middles), first, last
        )
        timed = paced.along(waypoints, PathSpline(drawn.t, drawn.c, drawn.k))
        motion = in_step(timed.trajectory, _rate(world))
        assert motion.times is not None
        for middle in path.middles:
            if first <= middle < last:
                row, fraction = timed.place_of((middle - first) / (last - first))
                near = float(motion.times[row] + fraction * (motion.times[row + 1] - motion.times[row]))
                marks.append(begins + _passes(motion, path.rows(np.array([middle]))[0], near))
        motions.append(motion)
        begins += float(motion.times[-1])
    whole = one_after_other(motions)
    return _Unit(_between(whole, *ends), tuple(marks))


def _from_to(rows: Array, begins: Array | None, ends: Array | None) -> Array:
    """Return rows (N, n) that begin and end at joint values (n,), if these are given: what they are away from there,
    within the tolerances of what leads there, fades over all rows, as a jump would be a jerk."""
    faded = quintic(np.linspace(0.0, 1.0, len(rows)))[:, None]
    off = 0.0 if begins is None else (1.0 - faded) * (begins - rows[0])
    return np.asarray(rows + off + (0.0 if ends is None else faded * (ends - rows[-1])))


def _tool_rates(path: Path, driven: Sequence[Driven], first: float, last: float) -> list[ToolRates]:
    """Return the tool rates of a path between two lengths of it: each stage's from the middle of the blend before it to
    that of the blend after it, planned for a little beyond both, as the law's averaging blurs where one ends."""
    found, middles = [], [0.0, *path.middles, path.cuts[-1]]
    for k, each in enumerate(driven):
        if middles[k + 1] <= first or middles[k] >= last:
            continue
        outer = path.length[max(2 * k - 1, 0)][0], path.length[min(2 * k + 1, len(path.length) - 1)][-1]
        reaches = (
            middle + BEYOND_MIDDLE * (far - middle) for middle, far in zip(middles[k : k + 2], outer, strict=True)
        )
        begin, end = ((reach - first) / (last - first) for reach in reaches)
        begins = path.rows(np.array([middles[k]]))[0] if middles[k] > first else None
        found.append(ToolRates(each.leg.speed, each.leg.acceleration, (begin, end), begins))
    return found


def _overlapping(
    worlds: Sequence[World], runs: Sequence[range], units: Sequence[_Unit], in_time: Callable[[], None]
) -> tuple[list[_Unit], list[float]]:
    """Return units, those of moves maybe slower, and how long each overlaps with the next one [s]: those with which
    all of it takes the least time. Raises HdplanError where the limits leave no room."""
    if len(units) == 1:
        return [*units], []
    stages, first = worlds[0].job.stages, runs[0][0]
    found: list[tuple[float, list[_Unit], list[float]]] = []
    why = HdplanError("the limits leave no room for the two motions to overlap")
    for slower in TIME_FACTORS:
        in_time()
        tried = [*units]
        for k, run in enumerate(runs):
            if isinstance(stages[run[0]], Move):
                tried[k] = replace(units[k], motion=in_step(slowed(units[k].motion, slower), _rate(worlds[0])))
        pairs = zip(runs, itertools.pairwise(tried), strict=False)
        try:
            overlaps = [_overlap(worlds[run[-1] - first], run[-1], *pair) for run, pair in pairs]
        except InputError:
            raise
        except HdplanError as error:
            why = error
            continue
        found.append((sum(unit.motion.duration or 0.0 for unit in tried) - sum(overlaps), tried, overlaps))
    if not found:
        raise why
    return min(found, key=lambda each: each[0])[1:]


def _sooner(
    worlds: Sequence[World],
    group: range,
    runs: Sequence[range],
    units: Sequence[_Unit],
    than: Trajectory,
    in_time: Callable[[], None],
) -> Iterator[list[Trajectory]]:
    """Yield the motions of all stages that are driven along the sums of units, as far as these may overlap by their
    radii, timed again, where that takes less time than a motion does; the quickest first. There are none where tools
    have speeds of their own, or curves are blended into one another: these need more than a path."""
    curves = [stage for k in group if isinstance(stage := worlds[0].job.stages[k], Curve)]
    rated = any(each.tool_speed is not None or each.tool_acceleration is not None for each in curves)
    if rated or len(units) < len(group):
        return
    pairs = zip(runs, itertools.pairwise(units), strict=False)
    try:
        overlaps = [_overlap(worlds[run[-1] - group[0]], run[-1], *pair, limited=False) for run, pair in pairs]
    except HdplanError:  # motions that are not slowed are within a radius for less than a row
        return
    added = [_added(units, [share * each for each in overlaps]) for share in OVERLAP_SHARES[:2]]
    speeds = np.array([worlds[0].job.stages[k].speed for k in group])
    for motion, marks in retimed_path(_as_one_motion(worlds[0], group), added, speeds, in_time):
        if motion.times is None or than.duration is None or motion.times[-1] >= than.duration:
            return
        begins, ends = units[0].motion.positions[0], units[-1].motion.positions[-1]
        yield _cut(_between(motion, begins, ends), marks)


def _overlap(world: World, number: int, one: _Unit, other: _Unit, limited: bool = True) -> float:
    """Return for how long the motion that ends with a stage may overlap with that of the next one [s]; by the radius
    alone, if the limits are not to count."""
    stage = world.job.stages[number]
    assert isinstance(stage, ArmStage)
    here = JointTarget("goal", positions=world.start.positions)
    setup = stage_setup(world, number).changed(goal=here, path=PathConstraints())
    retimer = Retimer(setup)

    def allowed(curve: MotionCurve) -> bool:
        return not limited or all(limit.stretch(curve) <= 1.0 + LIMIT_ROUNDING for limit in retimer.limits)

    around = radius_link(world, number), stage.blend
    try:
        return longest_overlap(setup.robot, *around, one.motion, other.motion, retimer.rate, allowed)
    except UnblendedError as error:
        error.number = number
        raise


def _added(units: Sequence[_Unit], overlaps: Sequence[float]) -> tuple[Trajectory, list[float]]:
    """Return units that overlap as one motion from time 0 on, and the times at which its stages begin."""
    whole, marks = units[0].motion, [*units[0].marks]
    for unit, overlap in zip(units[1:], overlaps, strict=True):
        assert whole.duration is not None
        begins = whole.duration - overlap
        whole = overlapped(whole, unit.motion, overlap)
        marks += [begins + 0.5 * overlap, *(begins + mark for mark in unit.marks[1:])]
    return _between(whole, units[0].motion.positions[0], units[-1].motion.positions[-1]), marks


def _cut(whole: Trajectory, marks: Sequence[float]) -> list[Trajectory]:
    """Return the motions of all stages, each of which begins as the last one late."""
    rows = []
    for mark in marks:
        whole, row = _with_row(whole, mark)
        rows.append(row)
    return [whole.between(*pair) for pair in itertools.pairwise([*rows, len(whole) - 1])]


def _between(motion: Trajectory, begins: Array, ends: Array) -> Trajectory:
    """Return this motion from joint values (n,) to others, from which it differs by rounding: stages around it were
    planned to there, and from there."""
    return replace(motion, positions=np.concatenate([begins[None], motion.positions[1:-1], ends[None]]))


def _rate(world: World) -> float:
    """Return the least rate of rows [1/s]."""
    return (world.scene.timing or Timing()).rate


def _are_curves(stages: Sequence[Stage], number: int) -> bool:
    return all(isinstance(each, Curve) for each in stages[number : number + 2])


def _as_one_motion(world: World, group: range) -> Setup:
    """Return the scene in which stages are timed as one, at the speed that the limits allow."""
    setup, timing = stage_setup(world, group[0]), world.scene.timing or Timing()
    here = JointTarget("goal", positions=world.start.positions)
    whole = Timing(scale=timing.scale, rate=timing.rate)
    return setup.changed(goal=here, path=PathConstraints(), timing=whole)


def _passes(motion: Trajectory, q: Array, near: float) -> float:
    """Return the time at which a motion is nearest to joint values (n,), close to a time."""
    assert motion.times is not None
    time = near
    for _ in range(ROW_STEPS):
        at = motion.at_time(time)
        square = float(at.velocities @ at.velocities)
        if square == 0.0:
            return time
        time = float(np.clip(time + (q - at.positions) @ at.velocities / square, motion.times[0], motion.times[-1]))
    return time


def _with_row(motion: Trajectory, time: float) -> tuple[Trajectory, int]:
    """Return this motion with a row at a time, and the row's number; an existing row, if it is close."""
    columns = columns_of(motion)
    times = columns[1]
    after = int(np.clip(np.searchsorted(times, time), 1, len(times) - 1))
    nearest = after - int(time - times[after - 1] < times[after] - time)
    if abs(time - times[nearest]) < LEAST_ROW_GAP:
        return motion, nearest
    at = motion.at_time(time)
    put = at.positions, np.asarray(time), at.velocities, at.accelerations
    positions, *rates = (np.insert(kept, after, new, axis=0) for kept, new in zip(columns, put, strict=True))
    return Trajectory(motion.joint_names, positions, motion.locked, rates[0], rates[1], rates[2]), after


def _certified(
    world: World, group: range, motions: Sequence[Trajectory], pieces: Sequence[Piece]
) -> tuple[list[Piece], Certificate | None]:
    """Return the pieces of stages that are driven as one, or the certificate of the first one that is not proven."""
    made = []
    for number, given, piece in zip(group, motions, pieces, strict=True):
        motion, before = exactly_timed(given), world
        found, world = certified_stage(before, number, motion)
        if not found.certificate.certified:
            return [], found.certificate
        notes, proven = (*piece.notes, *found.certificate.notes), Proven(before, found, world)
        made.append(Piece(motion, piece.after, notes, blended=number != group[-1], proven=proven))
    return made, None
